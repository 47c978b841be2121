"""Forecast of a body, compiled: whether it can stick and slide.

With one friction mu and no weight the particle is a strut: the upper resultant acts in the convex hull P of the horizontal
positions of the upper spots, the lower one in Q below, and both lie on one line of action. So the force leans by q - p over the
height h, and T/N = (q - p)/h for some point of the difference set {q - p}. Sticking needs a point within mu h of the origin;
sliding along e needs the point mu h e itself, since every spot pulls the particle along e with mu N. Generalises E. Willert's
Eqs. 16, 19 and 20. Without allocations: {q - p} meets the line of the drag where a slice of P and a slice of Q at the same
distance across the drag face each other. The length of the slices, max of Q minus min of P, is
concave and piecewise linear across, so its maximum is on the line of some spot. Cost grows as (n + m)(n^2 + m^2): a microsecond
for six spots.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from thirdbody.plugin import helper

Array = NDArray[np.float64]

TOLERANCE = 1e-12  # of the largest |q - p|


@helper
def patch_size(upper: Array, n_upper: int, lower: Array, n_lower: int) -> float:
    """Largest |q - p| [m]: the scale of all tolerances; independent of the origin."""
    size = 0.0
    for i in range(n_upper):
        for j in range(n_lower):
            size = max(size, math.hypot(lower[j, 0] - upper[i, 0], lower[j, 1] - upper[i, 1]))
    return size


@helper
def slice_ends(spots: Array, n: int, x: float, y: float, ex: float, ey: float, near: float) -> tuple[float, float]:
    """Minimum and maximum position along e of the spots' hull on the line through (x, y) along e; (inf, -inf) off the hull."""
    low, high = math.inf, -math.inf
    for i in range(n):
        a = (spots[i, 0] - x) * ex + (spots[i, 1] - y) * ey
        c = (spots[i, 1] - y) * ex - (spots[i, 0] - x) * ey
        if abs(c) <= near:
            low, high = min(low, a), max(high, a)
            continue
        for j in range(i):
            d = (spots[j, 1] - y) * ex - (spots[j, 0] - x) * ey
            if (c < 0.0 < d or d < 0.0 < c) and abs(d) > near:
                b = (spots[j, 0] - x) * ex + (spots[j, 1] - y) * ey
                crossing = a + (b - a) * (c / (c - d))
                low, high = min(low, crossing), max(high, crossing)
    return low, high


@helper
def drag_interval(
    upper: Array, n_upper: int, lower: Array, n_lower: int, ex: float, ey: float, near: float
) -> tuple[float, float]:
    """Minimum and maximum a with a e in {q - p} [m]; (inf, -inf) if there is none."""
    low, high = math.inf, -math.inf
    for k in range(n_upper + n_lower):
        x = upper[k, 0] if k < n_upper else lower[k - n_upper, 0]
        y = upper[k, 1] if k < n_upper else lower[k - n_upper, 1]
        p = slice_ends(upper, n_upper, x, y, ex, ey, near)
        q = slice_ends(lower, n_lower, x, y, ex, ey, near)
        if p[0] <= p[1] and q[0] <= q[1]:
            low, high = min(low, q[0] - p[1]), max(high, q[1] - p[0])
    return low, high


@helper
def corner_distance(corners: Array, n: int, chords: Array, m: int) -> float:
    """Minimum distance of a corner from a chord between two of the other spots [m]; for separate hulls, with both roles."""
    minimum = math.inf
    for i in range(n):
        for j in range(m):
            x, y = corners[i, 0] - chords[j, 0], corners[i, 1] - chords[j, 1]
            minimum = min(minimum, math.hypot(x, y))
            for k in range(j):
                ux, uy = chords[k, 0] - chords[j, 0], chords[k, 1] - chords[j, 1]
                square = ux * ux + uy * uy
                part = min(max((x * ux + y * uy) / square, 0.0), 1.0) if square > 0.0 else 0.0
                minimum = min(minimum, math.hypot(x - part * ux, y - part * uy))
    return minimum


@njit(error_model="numpy", cache=True)  # `balance` calls it, too; all that it calls is in this file, which numba watches
def forecast(
    upper: Array, n_upper: int, lower: Array, n_lower: int, h: float, ex: float, ey: float
) -> tuple[float, float, float]:
    """(mu_required, t_min, t_max) of a body between parallel plates, no weight.

    `upper`, `lower` (>= n, >= 2): x, y of the loaded spots in their first rows and columns [m]; `h` distance of the sides [m];
    (ex, ey) drag of the upper side, of any length. Sticking is possible iff mu >= mu_required, sliding along e iff t_min <= mu <=
    t_max. Instead of errors: where the line of the drag misses {q - p}, t_min = inf, t_max = -inf, so that no mu lies between;
    without a direction likewise, mu_required as usual; without spots on a side or h <= 0 both are impossible: (inf, inf, -inf).
    Never NaN for finite input. Read-only.
    """
    if n_upper <= 0 or n_lower <= 0 or not h > 0.0:
        return math.inf, math.inf, -math.inf
    near = TOLERANCE * patch_size(upper, n_upper, lower, n_lower)
    speed = math.hypot(ex, ey)
    dragged = speed > 0.0
    ux, uy = (ex / speed, ey / speed) if dragged else (1.0, 0.0)
    low, high = drag_interval(upper, n_upper, lower, n_lower, ux, uy, near)
    apart = 0.0
    if not low <= 0.0 <= high:  # the hulls meet iff the origin lies in {q - p}
        apart = min(corner_distance(upper, n_upper, lower, n_lower), corner_distance(lower, n_lower, upper, n_upper))
    if dragged:
        return apart / h, low / h, high / h
    return apart / h, math.inf, -math.inf
