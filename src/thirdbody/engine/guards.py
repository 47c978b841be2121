"""Validity limits of a run, for all integrators, and the names of bodies and plates in messages."""

import numpy as np

from thirdbody.engine.energy import Ledger, Stored
from thirdbody.engine.state import State
from thirdbody.errors import GuardStop
from thirdbody.kernels.tables import LOWER, domain, height_field, run_totals

OVERLAP_GUARD = 0.3
"""Largest overlap over the smaller radius: beyond it Hertz' theory and the clump's shape are invalid."""

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
    """Write the limits that kernels watch into the tables of a state."""
    state.D[domain.OVERLAP_GUARD], state.D[domain.TRAVEL_GUARD] = OVERLAP_GUARD, TRAVEL_GUARD
    if state.world.lower is not None:
        lowest = float(state.lower_surface[height_field.MIN_HEIGHT]) if len(state.lower_surface) else 0.0
        state.D[domain.FLOOR] = lowest - FLOOR * float(state.rayleigh_radius.max())


class EnergyGuard:
    """Checks the energy balance and the orientations at instants at which the ledger is complete.

    A single violation is tolerated where forces may jump (`patience` = 2): the step in which a load jumps is booked with half of
    its work, which can be all the energy at that instant.
    """

    def __init__(self, ledger: Ledger, patience: int = 1) -> None:
        self.ledger, self.patience = ledger, patience
        self.above = 0  # consecutive checks with a residual above the limit

    def check(self, state: State, result: Stored | None = None) -> None:
        """Raise GuardStop on violation; the last step must be recorded. `result`: see `Ledger.lines`."""
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
    """Return text that names a body by its number in the scene and its position."""
    where = ", ".join(f"{x:.4g}" for x in state.bodies.position[number])
    return f"body {state.order[number]} at ({where}) m"


def partner_of(state: State, slot: int, body: int) -> str:
    """Return text that names what a body touches in a contact."""
    slots = state.slots
    if slots.partner[slot] < 0:
        return f"the {'lower' if slots.sides[slot] == LOWER else 'upper'} plate"
    owner, partner = state.body[slots.own[slot]], state.body[slots.partner[slot]]
    return f"body {state.order[partner if owner == body else owner]}"
