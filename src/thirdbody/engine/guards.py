"""Limits of a run that every integrator keeps."""

from __future__ import annotations

from dataclasses import dataclass

from ..kernels import layout as at
from .state import State

OVERLAP_GUARD = 0.3
"""Largest overlap over the smaller radius: beyond it Hertz' theory and the clump's shape mean nothing."""

TRAVEL_GUARD = 0.25
"""Largest way of a body in one step over the radius of its first sphere: beyond it contacts are skipped."""

FLOOR = 1.0
"""A body whose centre is lower than this many of its own radii below the lower plate has left."""


@dataclass(frozen=True)
class Guards:
    """Dimensionless limits of a run."""

    overlap: float = OVERLAP_GUARD
    travel: float = TRAVEL_GUARD

    def put(self, state: State) -> None:
        """Write the limits into the tables of a state."""
        state.D[at.D_GUARD_OVERLAP], state.D[at.D_GUARD_TRAVEL] = self.overlap, self.travel
        if state.world.lower is not None:
            state.D[at.D_FLOOR] = -FLOOR * float(state.rayleigh_radius.max())
