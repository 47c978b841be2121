"""Contact of the first bodies as a whole: its pressure profile, the gap around it, and the loads of the patches that follow.

Positions are those in the upper body, from the middle of the contact. A patch inside carries its nominal load times the pressure
there over the reference pressure; outside it carries none and moves with the gap. What patches carry less than at the start is
carried by direct contact of the first bodies.
"""

import math

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.tables import body, domain, patch, zone
from thirdbody.kernels.vectors import nearest_image

UNIFORM, PUNCH, BALL, CYLINDER, WORN_BALL = range(5)


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
def load_of(b, context, at, before, after, dt):
    """Return the load [N] on the patch of body b: that of the position `at`; outside, what moves the patch with the gap against
    its dashpot, from the position `before` to that `after` a step: it presses a body there by no more."""
    P, Z, p = context.P, context.zone, context.patch[b]
    load = P[p, patch.NOMINAL_LOAD] * pressure(at[0], at[1], Z)
    if load > 0.0 or dt == 0.0:
        return load
    return P[p, patch.DAMPING] * (gap(before[0], before[1], Z) - gap(after[0], after[1], Z)) / dt


@njit(**BARE)
def book_zone(b, context, motion):
    """Note whether body b is in the contact, and the path outside. Returns by how much less it carries than at the start [N]."""
    P, p = context.P, context.patch[b]
    x, y = locate(b, context, 0.0, 0.0)
    inside = 1.0 if pressure(x, y, context.zone) > 0.0 else 0.0
    path = P[p, patch.OUTSIDE_PATH] + motion.dt * math.sqrt(motion.v_x * motion.v_x + motion.v_y * motion.v_y)
    P[p, patch.INSIDE], P[p, patch.OUTSIDE_PATH] = inside, (1.0 - inside) * path
    return P[p, patch.FIRST_LOAD] - inside * P[p, patch.LOAD]
