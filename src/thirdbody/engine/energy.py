"""Energy ledger at a synchronised instant [J]."""

import numpy as np

from thirdbody.engine.state import State
from thirdbody.engine.upper_plate import direct_energy
from thirdbody.kernels.tables import body, body_extra, patch, record, run_totals

LINES = (
    "kinetic", "elastic_normal", "elastic_tangential", "damping", "friction", "plate_work", "body_effects", "numerical",
    "residual",
)  # fmt: skip

BOOKED = (
    run_totals.DAMPING_WORK, run_totals.FRICTION_WORK, run_totals.PLATE_WORK, run_totals.EFFECT_WORK, run_totals.NUMERICAL_LOSS,
)  # fmt: skip
"""Totals of a run that are lines of the ledger as they are, `damping` to `numerical`."""

Stored = tuple[float, float, float, float, float]


def stored_energies(state: State) -> Stored:
    """Return the energies [J] at the last observed step: kinetic, elastic normal and tangential, foundation, direct contact."""
    B, E, P, kinetic, direct = state.B, state.E, state.P, 0.0, direct_energy(state.P)
    if state.inertial:
        kinetic = 0.5 * float(np.sum(B[:, body.MASS] * np.sum(B[:, body.VELOCITY3] ** 2, axis=1)))
        kinetic += 0.5 * float(np.sum(E[:, body_extra.ANGULAR_MOMENTUM3] * B[:, body.SPIN3]))
        kinetic += 0.5 * float(np.sum(P[:, patch.FREE] * P[:, patch.MASS] * P[:, patch.VELOCITY] ** 2))
    springs = 0.5 * float(np.sum(P[:, patch.SPRING] * (P[:, patch.HEIGHT] - P[-1, patch.HEIGHT]) ** 2))
    if state.summed:
        return kinetic, float(state.A[run_totals.STORED_NORMAL]), float(state.A[run_totals.STORED_TANGENTIAL]), springs, direct
    rows = state.slots.rows
    stored = rows.records(rows.closed(), record.STORED_NORMAL, record.STORED_TANGENTIAL)
    normal, tangential = (float(each.sum()) for each in stored)
    return kinetic, normal, tangential, springs, direct


class Ledger:
    """Energy balance.

    plate work + work of effects = change of stored energy + dissipation + residual. The relative residual is scaled by max(sum of
    |plate work increments|, largest stored plus kinetic energy). For velocity Verlet, numerical loss cannot be separated from
    truncation error: `numerical` is zero, and the residual is the truncation error. Friction dissipates the work of the mean
    force of each step (`kernels.books`), so the residual comes from springs and dashpots in the normal
    direction, from rotations, and from laws that create energy. The implicit integrator (BDF2 with backward-Euler starts) damps;
    its loss is computed in every step and reported as `numerical`.
    """

    def __init__(self, state: State):
        self.start = sum(stored_energies(state))
        self.peak = self.start

    def watch(self, state: State) -> Stored:
        """Update the largest total energy from the record of the last step; return `stored_energies`."""
        result = stored_energies(state)
        self.peak = max(self.peak, sum(result))
        return result

    def lines(self, state: State, result: Stored | None = None) -> dict[str, float]:
        """Return the lines [J] of the ledger that exist in the scene, with the absolute `residual`.

        `result`: `stored_energies` of this instant, if known.
        """
        kinetic, normal, tangential, springs, direct = result or stored_energies(state)
        A = state.A
        gained = A[run_totals.PLATE_WORK] + A[run_totals.EFFECT_WORK]
        spent = kinetic + normal + tangential + springs + direct - self.start
        spent += A[run_totals.DAMPING_WORK] + A[run_totals.FRICTION_WORK] + A[run_totals.DIRECT_WORK]
        spent += A[run_totals.NUMERICAL_LOSS]
        values = kinetic, normal, tangential, *(A[k] for k in BOOKED), gained - spent
        lines = {name: float(value) for name, value in zip(LINES, values, strict=True)}
        if state.physics.loss:
            lines[state.physics.loss] = float(state.E[:, body_extra.NORMAL_LOSS].sum())
            lines["friction"] -= lines[state.physics.loss]
        if not state.physics.has_effects:  # omitted rather than zero
            del lines["body_effects"]
        upper = state.world.upper
        if upper and upper.foundation:
            lines["foundation"] = springs
        if upper and upper.direct:
            lines |= {"direct_elastic": direct, "direct_friction": float(A[run_totals.DIRECT_WORK])}
        return lines

    def relative_residual(self, state: State, residual: float, energy: float = 0.0) -> float:
        """Return |residual| over the scale defined in the class docstring; `energy`: present energy [J] if `watch` missed it."""
        scale = max(float(state.A[run_totals.PLATE_WORK_SIZE]), self.peak, energy)
        return abs(residual) / scale if scale > 0.0 else 0.0
