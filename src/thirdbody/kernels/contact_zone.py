"""Contact of the first bodies as a whole: its pressure profile, the gap around it, and the loads of the patches that follow.

Positions are those in the upper body, from the middle of the contact. A patch inside carries its nominal load times the pressure
there over the reference pressure; outside it carries none and moves with the gap. What patches carry less than at the start is
carried by direct contact of the first bodies.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.tables import body, domain, patch, zone
from thirdbody.kernels.vectors import nearest_image

UNIFORM, PUNCH, BALL, CYLINDER, MAP, WORN_BALL = range(6)


@njit(**BARE)
def has_zone(context):
    return context.zone.shape[0] > 0


@njit(**BARE)
def locate(b, context, dx, dy):
    """Return where body b is in the upper body [m], after it moves by (dx, dy) relative to it."""
    Z, B, P, p = context.zone, context.B, context.P, context.patch[b]
    x = B[b, body.POSITION] - P[p, patch.DISPLACEMENT] - Z[zone.CENTRE] + dx
    y = B[b, body.POSITION + 1] - P[p, patch.DISPLACEMENT + 1] - Z[zone.CENTRE + 1] + dy
    return nearest_image(x, context.D[domain.LENGTH_X]), nearest_image(y, context.D[domain.LENGTH_Y])


@njit(**BARE)
def is_beyond(b, context):
    """Return whether body b is beyond an open end of the domain."""
    B, D, Z = context.B, context.D, context.zone
    for k in range(2):
        if D[domain.LENGTH_X + k] == 0.0 and abs(B[b, body.POSITION + k] - Z[zone.CENTRE + k]) > Z[zone.CENTRE + k]:
            return True
    return False


@njit(**BARE)
def map_values(x, y, Z):
    """Return the pressure over the largest one, and the gap [m], at a position of a map: bilinear between its nodes; beyond its
    border no pressure, and the gap of the nearest point."""
    n_x, n_y = np.int64(Z[zone.COUNT]), np.int64(Z[zone.COUNT + 1])
    u, v = (x - Z[zone.FIRST]) * Z[zone.RATE], (y - Z[zone.FIRST + 1]) * Z[zone.RATE + 1]
    # of NaN the first node: what is not finite must not be an index
    a, b = min(u, n_x - 1.0) if u > 0.0 else 0.0, min(v, n_y - 1.0) if v > 0.0 else 0.0
    i, j = min(np.int64(a), n_x - 2), min(np.int64(b), n_y - 2)
    s, t, k = a - i, b - j, zone.WIDTH + j * n_x + i
    g, corners = k + n_x * n_y, ((1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t)
    p = corners[0] * Z[k] + corners[1] * Z[k + 1] + corners[2] * Z[k + n_x] + corners[3] * Z[k + n_x + 1]
    above = corners[0] * Z[g] + corners[1] * Z[g + 1] + corners[2] * Z[g + n_x] + corners[3] * Z[g + n_x + 1]
    return p if a == u and b == v else 0.0, above


@njit(**BARE)
def pressure(x, y, Z):
    """Return the pressure at a position over the reference pressure: of a ball or a cylinder Hertz' ellipse (K. L. Johnson,
    Contact Mechanics, 1985, 4.2); of a worn ball uniform within its scar."""
    kind, a = Z[zone.KIND], Z[zone.HALF_WIDTH]
    if kind == UNIFORM:
        return 1.0
    if kind == PUNCH:
        fraction, edge = 1.0, Z[zone.EDGE]
        for distance, half in ((abs(x), a), (abs(y), Z[zone.HALF_WIDTH + 1])):
            fraction *= min(max(0.5 + (half - distance) / edge, 0.0), 1.0) if half > 0.0 else 1.0
        return fraction
    if kind == MAP:
        return map_values(x, y, Z)[0]
    square = (x * x + (0.0 if kind == CYLINDER else y * y)) / (a * a)
    if kind == WORN_BALL:
        return Z[zone.SCAR_PRESSURE] if square < 1.0 else 0.0
    return math.sqrt(1.0 - square) if square < 1.0 else 0.0


@njit(**BARE)
def gap(x, y, Z):
    """Return how far apart the first bodies are at a position [m]; 0 inside. A punch has a chamfer of 45 degrees. For a ball and
    a cylinder it includes the displacement outside Hertz' pressure (K. L. Johnson, Contact Mechanics, 1985, 3.42 and 4.2); around
    the scar of a worn ball it is that of the unloaded ball."""
    kind, a, radius = Z[zone.KIND], Z[zone.HALF_WIDTH], Z[zone.RADIUS]
    if kind == MAP:
        return map_values(x, y, Z)[1]
    if kind == PUNCH:
        out_x = max(abs(x) - a - 0.5 * Z[zone.EDGE], 0.0) if a > 0.0 else 0.0
        b = Z[zone.HALF_WIDTH + 1]
        return math.hypot(out_x, max(abs(y) - b - 0.5 * Z[zone.EDGE], 0.0) if b > 0.0 else 0.0)
    r = abs(x) if kind == CYLINDER else math.hypot(x, y)
    if kind == UNIFORM or r <= a:
        return 0.0
    if kind == WORN_BALL:
        return (r * r - a * a) / (2.0 * radius)
    root = math.sqrt(r * r - a * a)
    if kind == BALL:
        return (a * root + (r * r - 2.0 * a * a) * math.acos(a / r)) / (math.pi * radius)
    return (r * root - a * a * math.log((r + root) / a)) / (2.0 * radius)


@njit(**BARE)
def load_of(b, context, height, at, before, after, dt):
    """Return the load [N] on the patch of body b, at a height before the step [m]: that of the position `at`; outside, what moves
    the patch with the gap against its dashpot, from the position `before` to that `after` the step: it presses a body there by no
    more. A patch that is too low for the gap is lifted, critically damped, so that errors of steps do not add up."""
    P, Z, p = context.P, context.zone, context.patch[b]
    load = P[p, patch.NOMINAL_LOAD] * pressure(at[0], at[1], Z)
    if load > 0.0 or dt == 0.0:
        return load
    now = gap(before[0], before[1], Z)
    too_low = max(P[p, patch.OUTSIDE_HEIGHT] + now - height, 0.0)
    rate = min(1.0 / dt, 0.25 * P[p, patch.DAMPING] / P[p, patch.MASS])
    return P[p, patch.DAMPING] * ((now - gap(after[0], after[1], Z)) / dt - rate * too_low)


@njit(**BARE)
def edge_between(inside, outside, Z):
    """Return where the straight way from a position inside to one outside leaves the contact, to 1e-9 of its length."""
    (x, y), (far_x, far_y) = inside, outside
    for _ in range(30):
        middle_x, middle_y = 0.5 * (x + far_x), 0.5 * (y + far_y)
        if pressure(middle_x, middle_y, Z) > 0.0:
            x, y = middle_x, middle_y
        else:
            far_x, far_y = middle_x, middle_y
    return x, y


@njit(**BARE)
def book_zone(b, context, motion):
    """Note whether body b is in the contact, where it left, and the path since. Returns by how much less it carries than at the
    start [N]."""
    P, p = context.P, context.patch[b]
    x, y = locate(b, context, 0.0, 0.0)
    inside = 1.0 if pressure(x, y, context.zone) > 0.0 else 0.0
    if P[p, patch.INSIDE] < 0.0 or (inside == 0.0 and is_beyond(b, context)):
        inside = -1.0
    path = P[p, patch.OUTSIDE_PATH] + motion.dt * math.sqrt(motion.v_x * motion.v_x + motion.v_y * motion.v_y)
    if inside > 0.0:
        P[p, patch.EDGE], P[p, patch.EDGE + 1] = x, y
    elif P[p, patch.INSIDE] > 0.0:
        last = P[p, patch.EDGE], P[p, patch.EDGE + 1]
        known = last[0] == last[0]  # not NaN: it did not leave in the first step
        P[p, patch.EDGE], P[p, patch.EDGE + 1] = edge_between(last if known else (x, y), (x, y), context.zone)
    P[p, patch.INSIDE], P[p, patch.OUTSIDE_PATH] = inside, 0.0 if inside > 0.0 else path
    height = P[p, patch.HEIGHT] - gap(x, y, context.zone)
    P[p, patch.OUTSIDE_HEIGHT] = height if inside > 0.0 else max(height, P[p, patch.OUTSIDE_HEIGHT])
    return P[p, patch.FIRST_LOAD] - max(inside, 0.0) * P[p, patch.LOAD]
