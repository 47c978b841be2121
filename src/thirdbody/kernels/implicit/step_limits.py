"""Causes that limit the step length of the implicit integrator, counted per body."""

import math
from enum import IntEnum

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.implicit.residual import MAX_ROTATION


class StepLimit(IntEnum):
    """Causes that limit a step, in the order of their counters (`step_memory.LIMITED`): those due to a body come first."""

    ERROR = 0
    """A longer step would exceed the error allowed by `solver.tolerance`."""
    LANDING = 1
    """A longer step failed while a contact closed."""
    NEWTON = 2
    """Newton's method did not converge for a longer step, or needed many iterations."""
    ROTATION = 3
    """Largest rotation of the body in one step."""
    LARGEST_STEP = 4
    """Largest drag in one step (`solver.largest_step`)."""
    REVERSAL = 5
    """The step ends where the prescribed motion or load changes."""
    OUTPUT = 6
    """The step ends at an output."""
    GROWTH = 7
    """Nothing: the step grows by the largest allowed ratio."""


TRAVEL = 0.12
"""Largest displacement of a sphere relative to a rough plate in one step, in radii: minima of the distance are searched for after
each step, in all directions."""

OF_A_BODY = 4
"""Number of causes due to a body; the others are due to the scene."""

CAUSES = tuple(limit.name.lower() for limit in StepLimit)
"""Names of the causes by code, as in `summary()`."""

WORDS = (
    "the error of a step (solver.tolerance)", "spots that touch for the first time", "failures of Newton's method",
    "the rotation of a body", "the largest step of the drag (solver.largest_step)", "reversals of the motion",
    "the output interval (output.every)", "growth from a short step",
)  # fmt: skip
"""Descriptions of the causes by code, which complete `steps limited by`."""


@njit(**BARE)
def lands(context, b, m, space):
    """Return whether one of the m contacts of body b closed within the step."""
    for q in range(m):
        if space.before[space.slots[q] - context.edges[b]] < 0.0:
            return True
    return False


@njit(**BARE_CHUNK)
def why_cut(landing, converged, error, rotation):
    """Return the code of the cause of a rejected step."""
    if landing:
        return np.int64(StepLimit.LANDING)
    if not converged:
        return np.int64(StepLimit.NEWTON)
    by_error = error > 1.0 and 1.0 / math.sqrt(error) < MAX_ROTATION / max(rotation, 1e-30)
    return np.int64(StepLimit.ERROR if by_error else StepLimit.ROTATION)
