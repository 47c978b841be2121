"""Contact of the first bodies as a whole: its pressure by place, the gap around it, and the loads of the patches that follow.

Places are those in the upper body, from the middle of the contact. A patch inside carries its nominal load times the pressure
there over the reference pressure; outside it carries none and rises with the gap (K. L. Johnson, Contact Mechanics, 1985, 3.42
and 4.2). What patches carry less than at the start is carried by direct contact of the first bodies.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.tables import body, patch, zone

UNIFORM, PUNCH, BALL, CYLINDER = range(4)


@njit(**BARE)
def has_zone(context):
    return context.zone.shape[0] > 0


@njit(**BARE)
def locate(b, context, dx, dy):
    """Return where body b is in the upper body [m], after it moves by (dx, dy) relative to it."""
    Z, B, P, p = context.zone, context.B, context.P, context.patch[b]
    x = B[b, body.POSITION] - P[p, patch.DISPLACEMENT] - Z[zone.CENTRE] + dx
    y = B[b, body.POSITION + 1] - P[p, patch.DISPLACEMENT + 1] - Z[zone.CENTRE + 1] + dy
    l_x, l_y = Z[zone.PERIOD], Z[zone.PERIOD + 1]
    x -= l_x * np.rint(x / l_x) if l_x > 0.0 else 0.0
    y -= l_y * np.rint(y / l_y) if l_y > 0.0 else 0.0
    return x, y


@njit(**BARE)
def pressure(x, y, Z):
    """Return the pressure at a place over the reference pressure."""
    kind, a = Z[zone.KIND], Z[zone.HALF_WIDTH]
    if kind == UNIFORM:
        return 1.0
    if kind == PUNCH:
        fraction, edge = 1.0, Z[zone.EDGE]
        for distance, half in ((abs(x), a), (abs(y), Z[zone.HALF_WIDTH + 1])):
            fraction *= min(max(0.5 + (half - distance) / edge, 0.0), 1.0) if half > 0.0 else 1.0
        return fraction
    square = (x * x + (y * y if kind == BALL else 0.0)) / (a * a)
    return math.sqrt(1.0 - square) if square < 1.0 else 0.0


@njit(**BARE)
def gap(x, y, Z):
    """Return how far apart the first bodies are at a place [m]; 0 inside. A punch has a chamfer of 45 degrees."""
    kind, a, radius = Z[zone.KIND], Z[zone.HALF_WIDTH], Z[zone.RADIUS]
    if kind == PUNCH:
        out_x = max(abs(x) - a - 0.5 * Z[zone.EDGE], 0.0) if a > 0.0 else 0.0
        b = Z[zone.HALF_WIDTH + 1]
        return math.hypot(out_x, max(abs(y) - b - 0.5 * Z[zone.EDGE], 0.0) if b > 0.0 else 0.0)
    r = math.hypot(x, y) if kind == BALL else abs(x)
    if (kind != BALL and kind != CYLINDER) or r <= a:
        return 0.0
    root = math.sqrt(r * r - a * a)
    if kind == BALL:
        return (a * root + (r * r - 2.0 * a * a) * math.acos(a / r)) / (math.pi * radius)
    return (r * root - a * a * math.log((r + root) / a)) / (2.0 * radius)


@njit(**BARE)
def enter_or_leave(b, context):
    """Let the patch of body b follow the gap from where its load vanishes on, and its load again from there. Returns the kinetic
    energy [J] that the first body gives to the patch."""
    P, p = context.P, context.patch[b]
    x, y = locate(b, context, 0.0, 0.0)
    inside = 1.0 if pressure(x, y, context.zone) > 0.0 else 0.0
    change = inside - P[p, patch.FREE]
    P[p, patch.FREE] = inside
    if change < 0.0:
        P[p, patch.EDGE_HEIGHT] = P[p, patch.HEIGHT] - gap(x, y, context.zone)
    return 0.5 * change * P[p, patch.MASS] * P[p, patch.VELOCITY] ** 2


@njit(**BARE)
def unloaded(b, context):
    """Return by how much less the patch of body b carries than at the start [N]."""
    P, p = context.P, context.patch[b]
    return P[p, patch.FIRST_LOAD] - P[p, patch.LOAD]
