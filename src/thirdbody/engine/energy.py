"""The energy ledger at a synchronised instant, J."""

from __future__ import annotations

import numpy as np

from thirdbody.engine.state import State
from thirdbody.kernels.columns import body, body_extra, patch, record, run_totals

LINES = (
    "kinetic", "elastic_normal", "elastic_tangential", "damping", "friction", "plate_work", "body_effects", "numerical",
    "residual",
)  # fmt: skip


Stored = tuple[float, float, float, float]


def stored_energies(state: State) -> Stored:
    """Kinetic, elastic normal, elastic tangential and foundation energy, as of the last observed step."""
    P, kinetic = state.P, _kinetic(state) if state.inertial else 0.0
    springs = 0.5 * float(np.sum(P[:, patch.SPRING] * (P[:, patch.HEIGHT] - P[-1, patch.HEIGHT]) ** 2))
    if state.summed:
        return kinetic, float(state.A[run_totals.STORED_NORMAL]), float(state.A[run_totals.STORED_TANGENTIAL]), springs
    loaded, R = state.slots.histories.slip > 0.0, state.slots.R
    return kinetic, float(R[loaded, record.STORED_NORMAL].sum()), float(R[loaded, record.STORED_TANGENTIAL].sum()), springs


def _kinetic(state: State) -> float:
    """Kinetic energy of bodies and free patches, J."""
    B, E, P = state.B, state.E, state.P
    kinetic = 0.5 * float(np.sum(B[:, body.MASS] * np.sum(B[:, body.VELOCITY3] ** 2, axis=1)))
    kinetic += 0.5 * float(np.sum(E[:, body_extra.ANGULAR_MOMENTUM3] * B[:, body.SPIN3]))
    kinetic += 0.5 * float(np.sum(P[:, patch.FREE] * P[:, patch.MASS] * P[:, patch.VELOCITY] ** 2))
    return kinetic


class Ledger:
    """Closes the energy balance: plate work + effects = change of stored energy + dissipation + residual.

    The residual is divided by max(sum of |plate work increments|, largest stored plus kinetic energy). Velocity Verlet has
    no loss of its own that could be told apart from truncation: its `numerical` is zero, and truncation is the residual. What
    friction takes there is the work of the mean force of each step (`kernels.explicit.contact_dissipation`), so that the
    residual tells of springs and
    dashpots in the normal direction, of rotations, and of laws that make energy.
    Backward Euler damps; what it loses is computed in every step and stands on the line `numerical`.
    """

    def __init__(self, state: State):
        self.start = sum(stored_energies(state))
        self.peak = self.start

    def watch(self, state: State) -> Stored:
        """Note the largest stored plus kinetic energy; needs a record of the last step. Returns what is `stored_energies`."""
        result = stored_energies(state)
        self.peak = max(self.peak, sum(result))
        return result

    def lines(self, state: State, result: Stored | None = None) -> dict[str, float]:
        """The lines of the ledger that the scene has, J; `residual` is the absolute one. `result`: what is `stored_energies`,
        if known."""
        kinetic, normal, tangential, springs = result or stored_energies(state)
        A = state.A
        gained = A[run_totals.PLATE_WORK] + A[run_totals.EFFECT_WORK]
        spent = kinetic + normal + tangential + springs - self.start + A[run_totals.DAMPING_WORK] + A[run_totals.FRICTION_WORK]
        spent += A[run_totals.NUMERICAL_LOSS]
        values = (
            kinetic,
            normal,
            tangential,
            A[run_totals.DAMPING_WORK],
            A[run_totals.FRICTION_WORK],
            A[run_totals.PLATE_WORK],
            A[run_totals.EFFECT_WORK],
            A[run_totals.NUMERICAL_LOSS],
            gained - spent,
        )
        lines = {name: float(value) for name, value in zip(LINES, values, strict=True)}
        if not state.physics.has_effects:  # absent, not a line of zeros
            del lines["body_effects"]
        upper = state.world.upper
        return lines if upper is None or upper.foundation is None else lines | {"foundation": springs}

    def relative_residual(self, state: State, residual: float) -> float:
        """|residual| by the contract's definition, dimensionless."""
        scale = max(float(state.A[run_totals.PLATE_WORK_SIZE]), self.peak)
        return abs(residual) / scale if scale > 0.0 else 0.0
