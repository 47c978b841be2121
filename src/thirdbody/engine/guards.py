"""Energy ledger and validity limits of a run, for all integrators, and the names of bodies and plates in messages."""

import numpy as np

from thirdbody.engine.state import State
from thirdbody.engine.upper_plate import direct_reaction
from thirdbody.errors import GuardStop
from thirdbody.kernels.tables import LOWER, body, body_extra, domain, drive, height_field, patch, record, run_totals

LINES = (
    "kinetic", "elastic_normal", "elastic_tangential", "damping", "friction", "plate_work", "body_effects", "numerical",
    "residual",
)  # fmt: skip

Stored = tuple[float, float, float, float, float, float]


def stored_energies(state: State) -> Stored:
    """Return the energies [J] at the last observed step: kinetic, elastic normal and tangential, foundation, direct contact,
    springs of the drive."""
    B, E, P, kinetic = state.B, state.E, state.P, 0.0
    # of direct contact: the integral of the force from the present gap of the plate on
    direct = sum(direct_reaction(row, 0.0)[0] * float(row[patch.DIRECT_LENGTH]) for row in P[P[:, patch.DIRECT_PREFACTOR] > 0.0])
    if state.inertial:
        kinetic = 0.5 * float(np.sum(B[:, body.MASS] * np.sum(B[:, body.VELOCITY3] ** 2, axis=1)))
        kinetic += 0.5 * float(np.sum(E[:, body_extra.ANGULAR_MOMENTUM3] * B[:, body.SPIN3]))
        kinetic += 0.5 * float(np.sum(P[:, patch.FREE] * P[:, patch.MASS] * P[:, patch.VELOCITY] ** 2))
    pulled = 0.0
    if state.sprung:
        Y = state.drive
        along = Y[drive.STIFFNESS2] > 0.0
        pulled = 0.5 * float(np.sum(Y[drive.STIFFNESS2] * (Y[drive.BASE2] - Y[drive.DISPLACEMENT2]) ** 2))
        kinetic += 0.5 * float(state.inertial * Y[drive.MASS] * np.sum(along * Y[drive.VELOCITY2] ** 2))
    springs = 0.5 * float(np.sum(P[:, patch.SPRING] * (P[:, patch.HEIGHT] - P[-1, patch.HEIGHT]) ** 2))
    if state.summed:
        normal, tangential = float(state.A[run_totals.STORED_NORMAL]), float(state.A[run_totals.STORED_TANGENTIAL])
        return kinetic, normal, tangential, springs, direct, pulled
    rows = state.slots.rows
    stored = rows.records(rows.closed(), record.STORED_NORMAL, record.STORED_TANGENTIAL)
    normal, tangential = (float(each.sum()) for each in stored)
    return kinetic, normal, tangential, springs, direct, pulled


class Ledger:
    """Energy balance.

    plate work + work of effects = change of stored energy + dissipation + residual. The relative residual is scaled by max(sum of
    |plate work increments|, largest stored plus kinetic energy). For velocity Verlet, numerical loss cannot be separated from
    truncation error: `numerical` is zero, and the residual is the truncation error. Friction dissipates the work of the mean
    force of each step (`kernels.books`), so the residual comes from springs and dashpots in the normal
    direction, from rotations, and from laws that create energy. The implicit integrator (BDF2 with backward-Euler starts) damps;
    its loss is computed in every step and reported as `numerical`."""

    def __init__(self, state: State):
        self.start = sum(stored_energies(state))
        self.peak = self.start

    def watch(self, state: State) -> Stored:
        """Update the largest total energy from the record of the last step; return `stored_energies`."""
        result = stored_energies(state)
        self.peak = max(self.peak, sum(result))
        return result

    def lines(self, state: State, result: Stored | None = None) -> dict[str, float]:
        """Return the lines [J] of the ledger that exist in the scene, with the absolute `residual`; `result`: of
        `stored_energies`."""
        kinetic, normal, tangential, springs, direct, pulled = result or stored_energies(state)
        A = state.A
        gained = A[run_totals.PLATE_WORK] + A[run_totals.EFFECT_WORK]
        damping, friction, numerical = A[run_totals.DAMPING_WORK], A[run_totals.FRICTION_WORK], A[run_totals.NUMERICAL_LOSS]
        worn = state.wear.energy if state.wear else 0.0
        spent = kinetic + normal + tangential + springs + direct + pulled - self.start
        spent += damping + friction + A[run_totals.DIRECT_WORK]
        spent += numerical + worn
        works = damping, friction, A[run_totals.PLATE_WORK], A[run_totals.EFFECT_WORK], numerical
        values = kinetic, normal, tangential, *works, gained - spent
        lines = {name: float(value) for name, value in zip(LINES, values, strict=True)}
        if state.physics.loss:
            lines[state.physics.loss] = float(state.E[:, body_extra.NORMAL_LOSS].sum())
            lines["friction"] -= lines[state.physics.loss]
        if state.wear:
            lines["wear"] = worn
        if not state.physics.has_effects:  # omitted rather than zero
            del lines["body_effects"]
        upper = state.world.upper
        if upper and upper.foundation:
            lines["foundation"] = springs
        if state.sprung:
            lines["drive_spring"] = pulled
        if upper and upper.direct:
            lines["direct_elastic"] = direct
        if upper and (upper.direct or upper.zone):
            lines["direct_friction"] = float(A[run_totals.DIRECT_WORK])
        return lines

    def relative_residual(self, state: State, residual: float, energy: float = 0.0) -> float:
        """Return |residual| over the scale defined in the class docstring; `energy`: present energy [J] if `watch` missed it."""
        scale = max(float(state.A[run_totals.PLATE_WORK_SIZE]), self.peak, energy)
        return abs(residual) / scale if scale > 0.0 else 0.0


OVERLAP_GUARD = 0.3  # largest overlap over the smaller radius: beyond it Hertz' theory and the clump's shape are invalid

TRAVEL_GUARD = 0.25
"""Largest displacement of a body in one step over the radius of its first sphere: beyond it contacts can be missed."""

FLOOR = 1.0
"""Depth of a centre of mass below the lowest point of the lower plate at which a body has left, in radii of the largest body."""

RESIDUAL_GUARD = 0.1
"""Largest residual of the energy balance over its scale (`Ledger.relative_residual`). Valid runs stay below 1e-2; in an unstable
run the residual exceeds any limit within some hundred steps."""

NORM_GUARD = 1e-6
"""Largest deviation of the norm of a quaternion from 1; rounding causes less than 1e-12 over a million steps."""


def set_guards(state: State) -> None:
    state.D[domain.OVERLAP_GUARD], state.D[domain.TRAVEL_GUARD] = OVERLAP_GUARD, TRAVEL_GUARD
    if state.world.lower is not None:
        lowest = float(state.lower_surface[height_field.MIN_HEIGHT]) if len(state.lower_surface) else 0.0
        state.D[domain.FLOOR] = lowest - FLOOR * float(state.rayleigh_radius.max())


class EnergyGuard:
    """Checks the energy balance and the orientations at instants at which the ledger is complete. `patience` 2: a single
    violation is tolerated, as the step in which a load jumps is booked with half of its work, which can be all the energy at that
    instant."""

    def __init__(self, ledger: Ledger, patience: int = 1) -> None:
        self.ledger, self.patience = ledger, patience
        self.above = 0  # consecutive checks with a residual above the limit

    def check(self, state: State, result: Stored | None = None) -> None:
        """Raise GuardStop on violation; the last step must be recorded. `result`: of `stored_energies`."""
        when = f"stopped at t = {state.time:.6g} s (step {int(state.A[run_totals.STEPS])})"
        norms = np.sqrt(np.sum(state.bodies.quaternion**2, axis=1))
        bad = np.flatnonzero(~(np.abs(norms - 1.0) <= NORM_GUARD))
        if len(bad):
            raise GuardStop(
                f"{when}: the orientation of body {state.order[bad[0]]} is no rotation any more: its quaternion has the length "
                f"{norms[bad[0]]:.9g} (guard: 1 within {NORM_GUARD:g}); a smaller time step is needed"
            )
        energy = 0.0 if result is None else sum(result)
        off = self.ledger.relative_residual(state, self.ledger.lines(state, result)["residual"], energy)
        self.above = 0 if off <= RESIDUAL_GUARD else self.above + 1  # NaN counts as above
        if self.above >= self.patience:
            raise GuardStop(
                f"{when}: the energy balance does not close: its residual is {off:.2g} of the largest energy "
                f"(guard: {RESIDUAL_GUARD:g}); a smaller solver.time_step is needed, or a contact law that creates no energy "
                "(thirdbody laws --check)"
            )


def name_of(number: int, state: State) -> str:
    where = ", ".join(f"{x:.4g}" for x in state.bodies.position[number])
    return f"body {state.order[number]} at ({where}) m"


def partner_of(state: State, slot: int, body: int) -> str:
    slots = state.slots
    if slots.partner[slot] < 0:
        return f"the {'lower' if slots.sides[slot] == LOWER else 'upper'} plate"
    owner, partner = state.body[slots.own[slot]], state.body[slots.partner[slot]]
    return f"body {state.order[partner if owner == body else owner]}"
