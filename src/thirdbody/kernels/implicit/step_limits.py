"""Causes that limit the step length of the implicit integrator, counted per body."""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.implicit.residual import MAX_ROTATION

(ERROR, LANDING, NEWTON, ROTATION, LARGEST, REVERSAL, OUTPUT, GROWTH) = range(8)
"""Codes of the causes, in the order of their counters (`step_memory.LIMITED`):

| code | what limits the step |
|---|---|
| ERROR | a longer step would exceed the error allowed by `solver.tolerance` |
| LANDING | a longer step failed while a contact closed |
| NEWTON | Newton's method did not converge for a longer step, or needed many iterations |
| TURNING | largest rotation of the body in one step |
| LARGEST | largest drag in one step (`solver.largest_step`) |
| REVERSAL | the step ends where the prescribed motion or load changes |
| OUTPUT | the step ends at an output |
| GROWTH | nothing: the step grows by the largest allowed ratio |
"""

OF_A_BODY = 4
"""Number of causes due to a body, which come first; the others are due to the scene."""

CAUSES = (
    "error", "landing", "newton", "rotation", "largest_step", "reversal", "output", "growth",
)  # fmt: skip
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
        return np.int64(LANDING)
    if not converged:
        return np.int64(NEWTON)
    return np.int64(ERROR if error > 1.0 and 1.0 / math.sqrt(error) < MAX_ROTATION / max(rotation, 1e-30) else ROTATION)
