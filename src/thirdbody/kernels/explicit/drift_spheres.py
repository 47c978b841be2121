"""Drift of single-sphere bodies, with extrema per chunk; a body is named only when a guard trips."""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import (
    all_below,
    broadcast,
    broadcast_lane,
    extract,
    flush_below,
    less_mask,
    load,
    select_greater,
    set4,
    store,
    with_last,
)
from thirdbody.kernels.rigid_body import (
    BODIES,
    MAX_DISTANCE,
    NEGLIGIBLE_SPEED,
    NEGLIGIBLE_SPIN,
    check_position,
    is_aliased,
    store_three,
)
from thirdbody.kernels.sphere_rotation import rotate_sphere
from thirdbody.kernels.tables import body, domain, orientation, sphere


@njit(**BARE)
def drift_ball(b, s, context, step, extrema):
    """Apply half kick and full drift to body b, the single sphere s; return the updated extrema `extrema`.

    `extrema`: see `empty_extrema`. The last step's closing kick comes first if it is pending. The column that follows each vector
    is preserved. A single-sphere body has no arm, and is rotated in few steps only (`kernels.sphere_rotation`).
    """
    S, B, dt = context.S, context.B, step.dt
    x = load(B, b, body.POSITION)
    v = load(B, b, body.VELOCITY)
    w = load(B, b, body.SPIN)
    force = load(B, b, body.FORCE)
    torque = load(B, b, body.TORQUE)
    none, again = broadcast(0.0), broadcast(step.pending)
    fraction = broadcast(0.5 * dt) / set4(
        extract(v, 3), extract(w, 3), S[s, sphere.RADIUS], 1.0
    )  # dt/2 over mass, inertia and radius in one division
    change, rotation = broadcast_lane(fraction, 0) * with_last(force, none), broadcast_lane(fraction, 1) * with_last(torque, none)
    v, w = (
        flush_below(v + again * change, NEGLIGIBLE_SPEED) + change,
        flush_below(w + again * rotation, NEGLIGIBLE_SPIN) + rotation,
    )
    x = with_last(x + broadcast(dt) * v, x)
    store(B, b, body.POSITION, x)
    store(B, b, body.VELOCITY, v)
    store(B, b, body.SPIN, w)
    if step.turn != 0.0:
        q = load(context.orientations, b, orientation.QUATERNION)
        store(context.orientations, b, orientation.QUATERNION, rotate_sphere(q, w, step.turn))
    if not is_aliased(S):
        store_three(S, s, np.int64(sphere.POSITION), x)
        store(S, s, sphere.MID_VELOCITY, v)
        store(S, s, sphere.MID_SPIN, w)
        force, torque = none, w  # what follows them in the row of a sphere has no meaning
    store(S, s, sphere.END_VELOCITY, with_last(v + change, force))
    store(S, s, sphere.END_SPIN, with_last(w + rotation, torque))
    square, (fastest, farthest, strange, low, high) = norm_squared(v), extrema
    return (
        max(fastest, square), max(farthest, square * extract(fraction, 2) * extract(fraction, 2)), strange + none * x,
        select_greater(low, x, x, low), select_greater(x, high, x, high),
    )  # fmt: skip


@njit(**BARE)
def empty_extrema():
    """Return the extrema of no spheres.

    Squares of the largest speed and of half the largest ratio of path to radius; sums that are not 0 if a coordinate is not
    finite; lower and upper bounds of the positions.
    """
    return 0.0, 0.0, broadcast(0.0), broadcast(np.inf), broadcast(-np.inf)


@njit(**BARE)
def check_sphere_limits(c, start, S, B, D, limits, dt, extrema):
    """Reduce the extrema `extrema` of chunk c's single spheres as `check_limits` does. Bodies are searched only if a guard
    trips."""
    fastest, farthest, strange, low, high = extrema
    distance, step = math.sqrt(fastest) * dt, 2.0 * math.sqrt(farthest)
    outside = less_mask(low, limits[0]) | less_mask(limits[1], high)
    there = all_below(high, MAX_DISTANCE) & all_below(broadcast(0.0) - low, MAX_DISTANCE) & all_below(strange, 1.0)
    if (outside == 0) & there & (step <= D[domain.TRAVEL_GUARD]):
        return distance, step, np.int64(0), np.int64(0), np.int64(0)
    body, bad, out = find_offender(c, start, S, B, dt, limits)
    return distance, step, body, bad, out


@njit(**BARE_CHUNK)
def find_offender(c, start, S, B, dt, limits):
    """Find the offending single-sphere bodies of chunk c after their drift.

    Returns the one with the longest path over its radius, the last that is not finite, and the last that left the domain (+ 1; 0:
    none).
    """
    maximum, body_number, bad, out = -1.0, np.int64(0), np.int64(0), np.int64(0)
    for b in range(c * BODIES, min((c + 1) * BODIES, B.shape[0])):
        if B[b, body.SPHERE_INERTIA] != 0.0:
            step = math.sqrt(norm_squared(load(B, b, body.VELOCITY))) * dt / S[start[b], sphere.RADIUS]
            bad, out = check_position(b, load(B, b, body.POSITION), step, limits, bad, out)
            maximum, body_number = (step, np.int64(b)) if step > maximum else (maximum, body_number)
    return body_number, bad, out


@njit(**BARE)
def norm_squared(v):
    """Return the square of the vector of the first three numbers of v."""
    p = v * v
    return extract(p, 0) + extract(p, 1) + extract(p, 2)
