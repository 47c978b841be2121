"""The forecast of a body between the plates: which states without rolling are possible, from geometry and friction alone.

Sticking is possible while the required friction (distance of the hulls of the upper and the lower spots over their height) is
there; sliding along the drag while the friction lies in [t_min, t_max] (`forecast`). A body that can neither stick nor slide
rolls; one that can stick but not slide tips over when the drag goes on. Feasible is not realised: the label beside it tells
what the body does.
"""

from __future__ import annotations

import math

import numpy as np

from thirdbody.plugin import C_LIMIT, C_LOAD, C_POINT, O_DRAG

from .forecast import forecast
from .posture import ABOVE, BELOW, BOTH, Array, Posture, helper, only_plates, plain, side_of

CAN_STICK, CAN_SLIDE, UNTOLD = 1.0, 2.0, 4.0
"""Bits of `forecast`; UNTOLD where there is none: not held from both plates."""

NONE_YET = plain(0)

FARTHEST = 1e9
"""Stands for an infinite ratio: outputs stay finite."""


@helper
def friction_coefficient(C: Array, n: int) -> float:
    """Least friction coefficient of the loaded spots: one side slides, the other may stick."""
    least = FARTHEST
    for i in range(n):
        if C[i, C_LOAD] > 0.0:
            least = min(least, C[i, C_LIMIT] / C[i, C_LOAD])
    return least


@helper
def write_outlook(C: Array, n: int, b: Array, pose: Posture, out: Array, first: int) -> None:
    """Write forecast, mu_required, t_min, t_max into out[first:]; zeros and UNTOLD where the theory does not speak."""
    out[first] = UNTOLD
    if pose[0] != BOTH or not only_plates(C, n) or pose[2] <= 0.0:
        return
    upper, lower = np.empty((n, 2)), np.empty((n, 2))
    n_upper, n_lower = NONE_YET, NONE_YET
    for i in range(n):
        side = side_of(C, i)
        if side == ABOVE:
            upper[n_upper, 0], upper[n_upper, 1] = C[i, C_POINT], C[i, C_POINT + 1]
            n_upper += 1
        elif side == BELOW:
            lower[n_lower, 0], lower[n_lower, 1] = C[i, C_POINT], C[i, C_POINT + 1]
            n_lower += 1
    required, low, high = forecast(upper, n_upper, lower, n_lower, pose[2], b[O_DRAG], b[O_DRAG + 1])
    mu = friction_coefficient(C, n)
    out[first] = (CAN_STICK if mu >= required else 0.0) + (CAN_SLIDE if low <= mu <= high else 0.0)
    for k, value in enumerate((required, low, high)):
        out[first + 1 + k] = math.copysign(min(abs(value), FARTHEST), value)
