"""What limits the length of a step of the implicit integrator, counted per body."""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import CHUNK, INNER
from thirdbody.kernels.implicit.residual import TURN

(ERROR, LANDING, NEWTON, TURNING, LARGEST, REVERSAL, OUTPUT, GROWTH) = range(8)
"""Codes of the causes, in the order of their counters (`step_memory.LIMITED`):

| code | the step is as short as it is because |
|---|---|
| ERROR | a longer one would pass the error that `solver.tolerance` allows |
| LANDING | a longer one failed where a spot touches for the first time |
| NEWTON | Newton's method found no balance for a longer one, or needed many iterations |
| TURNING | the body may not turn farther in one step |
| LARGEST | the drag may not go farther in one step (`solver.largest_step`) |
| REVERSAL | it ends where the prescribed motion or load changes |
| OUTPUT | it ends at an output |
| GROWTH | nothing: it grows from one step to the next |
"""

OF_A_BODY = 4
"""The first so many are due to a body, the others to the scene."""

CAUSES = (
    "error", "landing", "newton", "rotation", "largest_step", "reversal", "output", "growth",
)  # fmt: skip
"""Names of the causes by code, as `summary()` gives them."""

WORDS = (
    "the error of a step (solver.tolerance)", "spots that touch for the first time", "failures of Newton's method",
    "the rotation of a body", "the largest step of the drag (solver.largest_step)", "reversals of the motion",
    "the output interval (output.every)", "growth from a short step",
)  # fmt: skip
"""The same for a line of text, after `steps limited by`."""


@njit(**INNER)
def lands(b, m, spots, work):
    """Whether one of the m staged spots of body b was open when the step began."""
    for q in range(m):
        if work[5][work[4][q] - spots[3][b]] < 0.0:
            return True
    return False


@njit(**CHUNK)
def why_cut(landing, result, error, turn):
    """What asks for a shorter step (`limits`)."""
    if landing:
        return np.int64(LANDING)
    if not result:
        return np.int64(NEWTON)
    return np.int64(ERROR if error > 1.0 and 1.0 / math.sqrt(error) < TURN / max(turn, 1e-30) else TURNING)
