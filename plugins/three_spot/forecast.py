"""Forecast of a body between the plates, compiled: possible states without rolling, from geometry and friction only.

With one friction mu and no weight the particle is a strut: the upper resultant acts in the convex hull P of the horizontal
positions of the upper spots, the lower one in Q below, and both lie on one line of action. So the force leans by q - p over the
height h, and T/N = (q - p)/h for some point of the difference set {q - p}. Sticking needs a point within mu h of the origin: the
friction is at least the required one, the distance of the hulls over their height. Sliding along e needs the point mu h e itself,
since every spot pulls the particle along e with mu N: the friction lies in [t_min, t_max]. Generalises E. Willert's Eqs. 16, 19
and 20. Without allocations: {q - p} meets the line of the drag where a slice of P and a slice of Q at the same distance across
the drag face each other. The length of the slices, max of Q minus min of P, is concave and piecewise linear across, so its
maximum is on the line of some spot. Cost grows as (n + m)(n^2 + m^2): a microsecond for six spots.

A body that can neither stick nor slide rolls; one that can stick but not slide tips over when the drag continues. Feasible is not
realised: the label is the observed state. Body forces (weight and other effects) enter by linear programmes (`weighted_forecast`)
where they move the line of action by `NEGLIGIBLE` contact radii or more: programmes cost 0.1 ms and more per body.
"""

import math

import numpy as np
from numba import njit

from thirdbody.plugin import CAN_SLIDE, CAN_STICK, helper, loaded_contact, observed_body

from .support import (
    ABOVE,
    BELOW,
    BOTH,
    NEITHER,
    NORMAL,
    POINT,
    Array,
    Posture,
    load_mean,
    only_plates,
    output,
    side_of,
    support_of,
)
from .weighted_forecast import body_size, weighted_forecast

TOLERANCE = 1e-12  # of the largest |q - p|

FARTHEST = 1e9  # finite value for an infinite ratio in outputs

NEGLIGIBLE = 0.01
"""Shift of the line of action by body forces that is neglected, over the contact radius: the contact area is no better known."""

HEAVIEST = 1e6  # body force over load beyond which there is no forecast
GENTLE = 0.01  # slope of a plate over the friction coefficient that is neglected: t_min and t_max are known to about 2 %

MANY = 16
"""Spots of a side from which on a forecast takes the corners of their hull: its cost grows with the cube of their number."""


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
    """(mu_required, t_min, t_max) of a body between parallel plates, no weight. `upper`, `lower` (>= n, >= 2): x, y of the loaded
    spots in their first rows and columns [m]; `h` distance of the sides [m]; (ex, ey) drag of the upper side, of any length.
    Sticking is possible iff mu >= mu_required, sliding along e iff t_min <= mu <= t_max. Instead of errors: where the line of the
    drag misses {q - p}, t_min = inf, t_max = -inf, so that no mu lies between; without a direction likewise, mu_required as
    usual; without spots on a side or h <= 0 both are impossible: (inf, inf, -inf). Never NaN for finite input. Read-only."""
    if n_upper <= 0 or n_lower <= 0 or not h > 0.0:
        return math.inf, math.inf, -math.inf
    size = 0.0  # largest |q - p|
    for i in range(n_upper):
        for j in range(n_lower):
            size = max(size, math.hypot(lower[j, 0] - upper[i, 0], lower[j, 1] - upper[i, 1]))
    near = TOLERANCE * size
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


@helper
def friction_coefficient(C: Array, n: int, sides: int) -> float:
    """Minimum friction coefficient of the loaded spots on `sides` (bits; NEITHER: all)."""
    minimum = FARTHEST
    for i in range(n):
        if C[i, loaded_contact.LOAD] > 0.0 and (sides == NEITHER or side_of(C, i) == sides):
            minimum = min(minimum, C[i, loaded_contact.FRICTION_LIMIT] / C[i, loaded_contact.LOAD])
    return minimum


@helper
def on_slopes(C: Array, n: int) -> bool:
    """Return whether a plate slopes at a spot by more than `GENTLE` of its friction: the theory is that of parallel planes."""
    for i in range(n):
        n_x, n_y, n_z = C[i, NORMAL], C[i, NORMAL + 1], C[i, NORMAL + 2]
        limit = GENTLE * C[i, loaded_contact.FRICTION_LIMIT] * abs(n_z)
        if C[i, loaded_contact.LOAD] * math.hypot(n_x, n_y) > limit:
            return True
    return False


@helper
def side_positions(C: Array, n: int, side: int) -> Array:
    """(m, 2): x, y of the spots of a side from the centre of mass [m]; of `MANY` and more, the corners of their hull."""
    positions, m = np.empty((n, 2)), 0
    for i in range(n):
        if side_of(C, i) == side:
            positions[m, 0], positions[m, 1] = C[i, loaded_contact.POINT], C[i, loaded_contact.POINT + 1]
            m += 1
    return positions[:m] if m < MANY else hull_corners(positions[:m])


@helper
def hull_corners(positions: Array) -> Array:
    """(k, 2): corners of the convex hull of (m, 2) positions, by gift wrapping (Jarvis 1973). What spots inside the hull can
    carry the corners can, too: same friction and height."""
    first = 0
    for i in range(len(positions)):
        if positions[i, 0] < positions[first, 0]:
            first = i
    corners, k, here = np.empty_like(positions), 0, first
    while k < len(positions):
        corners[k, 0], corners[k, 1] = positions[here, 0], positions[here, 1]
        k += 1
        farthest, b_x, b_y = here, 0.0, 0.0
        for i in range(len(positions)):
            a_x, a_y = positions[i, 0] - positions[here, 0], positions[i, 1] - positions[here, 1]
            side = b_x * a_y - b_y * a_x
            if side < 0.0 or (side == 0.0 and a_x * a_x + a_y * a_y > b_x * b_x + b_y * b_y):
                farthest, b_x, b_y = i, a_x, a_y
        if farthest in (here, first):
            break
        here = farthest
    return corners[:k]


@helper
def is_foreseen(C: Array, n: int, pose: Posture) -> bool:
    """Return whether the theory applies: between plates that are parallel planes. Elsewhere there is no forecast."""
    return pose[0] == BOTH and only_plates(C, n) and pose[2] > 0.0 and not on_slopes(C, n)


@helper
def write_ratios(C: Array, n: int, required: float, low: float, high: float, out: Array) -> None:
    """Write the forecast that follows from mu_required, t_min and t_max, and these."""
    mu = friction_coefficient(C, n, NEITHER)
    out[output.FORECAST] = (CAN_STICK if mu >= required else 0.0) + (CAN_SLIDE if low <= mu <= high else 0.0)
    out[output.MU_REQUIRED] = math.copysign(min(abs(required), FARTHEST), required)
    out[output.T_MIN] = math.copysign(min(abs(low), FARTHEST), low)
    out[output.T_MAX] = math.copysign(min(abs(high), FARTHEST), high)


@helper
def write_plain_forecast(C: Array, n: int, observed: Array, out: Array) -> None:
    """`write_forecast` of a body without body forces."""
    pose = support_of(C, n)
    if is_foreseen(C, n, pose):
        upper, lower = side_positions(C, n, ABOVE), side_positions(C, n, BELOW)
        e_x, e_y = observed[observed_body.DRAG], observed[observed_body.DRAG + 1]
        required, low, high = forecast(upper, len(upper), lower, len(lower), pose[2], e_x, e_y)
        write_ratios(C, n, required, low, high, out)


@helper
def write_forecast(C: Array, n: int, observed: Array, out: Array) -> None:
    """Write forecast, mu_required, t_min and t_max, where the theory applies."""
    pose = support_of(C, n)
    if not is_foreseen(C, n, pose):
        return
    upper, lower = side_positions(C, n, ABOVE), side_positions(C, n, BELOW)
    load, wrench = 0.0, np.empty(6)  # normal force of the upper spots [N]
    for i in range(n):
        if side_of(C, i) == ABOVE:
            load += max(C[i, loaded_contact.LOAD], 0.0)
    for k in range(6):
        wrench[k] = observed[observed_body.EFFECT_FORCE + k]
    heights = load_mean(C, n, ABOVE, POINT)[2], load_mean(C, n, BELOW, POINT)[2]
    size = body_size(upper, lower, heights)
    # shift of the line of action by body forces over the size, due to force or moment
    force, moment = max(abs(wrench[0]), abs(wrench[1]), abs(wrench[2])), max(abs(wrench[3]), abs(wrench[4]), abs(wrench[5]))
    fraction = 0.0
    if force != 0.0 or moment != 0.0:
        fraction = max(force / load, moment / load / size) if load > 0.0 and size > 0.0 else math.inf
    if fraction * size < NEGLIGIBLE * pose[1]:
        write_plain_forecast(C, n, observed, out)
    elif fraction <= HEAVIEST and heights[0] > heights[1]:
        # a side may have a contact without load at this instant
        frictions = min(friction_coefficient(C, n, ABOVE), HEAVIEST), min(friction_coefficient(C, n, BELOW), HEAVIEST)
        drag = observed[observed_body.DRAG], observed[observed_body.DRAG + 1]
        required, low, high = weighted_forecast(upper, lower, heights, wrench, load, frictions, drag)
        write_ratios(C, n, required, low, high, out)
