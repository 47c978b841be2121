"""Forecast of a body between the plates: possible states without rolling, from geometry and friction only.

Sticking is possible if the friction is at least the required one (distance of the hulls of the upper and the lower spots over
their height); sliding along the drag if the friction lies in [t_min, t_max] (`forecast`). A body that can neither stick nor slide
rolls; one that can stick but not slide tips over when the drag continues. Feasible is not realised: the label is the observed
state. Body forces (weight and other effects) enter by linear programmes (`weighted_forecast`) where they move the line of action
by `NEGLIGIBLE` contact radii or more: programmes cost 0.1 ms and more per body, closed forms a microsecond.
"""

import math

import numpy as np

from thirdbody.plugin import CAN_SLIDE, CAN_STICK, NO_FORECAST, loaded_contact, observed_body

from .forecast import forecast
from .support_geometry import (
    ABOVE,
    BELOW,
    BOTH,
    NEITHER,
    NORMAL,
    Array,
    Posture,
    helper,
    is_plain,
    load_mean,
    only_plates,
    side_of,
)
from .weighted_forecast import body_size, weighted_forecast

FARTHEST = 1e9
"""Finite value for an infinite ratio in outputs."""

NEGLIGIBLE = 0.01
"""Shift of the line of action by body forces that is neglected, over the contact radius: the contact area is no better known."""

HEAVIEST = 1e6
"""Body force over load beyond which there is no forecast."""

GENTLE = 0.01
"""Slope of a plate over the friction coefficient that is neglected: t_min and t_max are known to about 2 %."""

MANY = 16
"""Spots of a side from which on a forecast takes the corners of their hull: its cost grows with the cube of their number."""

POINT = is_plain(loaded_contact.POINT)


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
def upper_load(C: Array, n: int) -> float:
    """Normal force of the upper spots [N]."""
    total = 0.0
    for i in range(n):
        if side_of(C, i) == ABOVE:
            total += max(C[i, loaded_contact.LOAD], 0.0)
    return total


@helper
def side_positions(C: Array, n: int, side: int) -> Array:
    """(m, 2): x, y of the spots of a side from the centre of mass [m]; of `MANY` and more, the corners of their hull."""
    m = 0
    for i in range(n):
        if side_of(C, i) == side:
            m += 1
    positions = np.empty((m, 2))
    m = 0
    for i in range(n):
        if side_of(C, i) == side:
            positions[m, 0], positions[m, 1] = C[i, loaded_contact.POINT], C[i, loaded_contact.POINT + 1]
            m += 1
    return positions if m < MANY else hull_corners(positions)


@helper
def hull_corners(positions: Array) -> Array:
    """(k, 2): corners of the convex hull of (m, 2) positions, by gift wrapping (Jarvis 1973).

    What spots inside the hull can carry the corners can, too: same friction and height.
    """
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
def body_force_fraction(wrench: Array, load: float, size: float) -> float:
    """Shift of the line of action by body forces over `size`, due to force or moment; inf without load."""
    force = max(abs(wrench[0]), abs(wrench[1]), abs(wrench[2]))
    moment = max(abs(wrench[3]), abs(wrench[4]), abs(wrench[5]))
    if force == 0.0 and moment == 0.0:
        return 0.0
    return max(force / load, moment / load / size) if load > 0.0 and size > 0.0 else math.inf


@helper
def write_ratios(C: Array, n: int, required: float, low: float, high: float, out: Array, first: int) -> None:
    """Write the forecast that follows from mu_required, t_min and t_max, and these, into out[first:]."""
    mu = friction_coefficient(C, n, NEITHER)
    out[first] = (CAN_STICK if mu >= required else 0.0) + (CAN_SLIDE if low <= mu <= high else 0.0)
    out[first + 1] = math.copysign(min(abs(required), FARTHEST), required)
    out[first + 2] = math.copysign(min(abs(low), FARTHEST), low)
    out[first + 3] = math.copysign(min(abs(high), FARTHEST), high)


@helper
def write_plain_outlook(C: Array, n: int, observed: Array, pose: Posture, out: Array, first: int) -> None:
    """`write_outlook` of a body without body forces."""
    out[first] = NO_FORECAST
    if pose[0] != BOTH or not only_plates(C, n) or pose[2] <= 0.0 or on_slopes(C, n):
        return
    upper, lower = side_positions(C, n, ABOVE), side_positions(C, n, BELOW)
    required, low, high = forecast(
        upper, len(upper), lower, len(lower), pose[2], observed[observed_body.DRAG], observed[observed_body.DRAG + 1]
    )
    write_ratios(C, n, required, low, high, out, first)


@helper
def write_outlook(C: Array, n: int, observed: Array, pose: Posture, out: Array, first: int) -> None:
    """Write forecast, mu_required, t_min, t_max into out[first:]; zeros and NO_FORECAST where the theory does not apply."""
    out[first] = NO_FORECAST
    if pose[0] != BOTH or not only_plates(C, n) or pose[2] <= 0.0 or on_slopes(C, n):
        return
    upper, lower = side_positions(C, n, ABOVE), side_positions(C, n, BELOW)
    load, wrench = upper_load(C, n), np.empty(6)
    for k in range(6):
        wrench[k] = observed[observed_body.EFFECT_FORCE + k]
    heights = load_mean(C, n, ABOVE, POINT)[2], load_mean(C, n, BELOW, POINT)[2]
    size = body_size(upper, lower, heights)
    fraction = body_force_fraction(wrench, load, size)
    if fraction * size < NEGLIGIBLE * pose[1]:
        write_plain_outlook(C, n, observed, pose, out, first)
    elif fraction <= HEAVIEST and heights[0] > heights[1]:
        # a side may have a contact without load at this instant
        frictions = min(friction_coefficient(C, n, ABOVE), HEAVIEST), min(friction_coefficient(C, n, BELOW), HEAVIEST)
        drag = observed[observed_body.DRAG], observed[observed_body.DRAG + 1]
        required, low, high = weighted_forecast(upper, lower, heights, wrench, load, frictions, drag)
        write_ratios(C, n, required, low, high, out, first)
