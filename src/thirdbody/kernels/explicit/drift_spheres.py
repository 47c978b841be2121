"""How a ball moves in a step, and what a chunk of them tells: no arms, no matrices, and nobody is named unless a guard trips."""

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
from thirdbody.kernels.layout import B_BALL, B_F, B_Q, B_T, B_V, B_W, B_X, D_GUARD_TRAVEL, S_O, S_R, S_U, S_V, S_W, S_X
from thirdbody.kernels.rigid_body import BODIES, FAR, RESTING_SPEED, RESTING_SPIN, check_position, is_aliased, store_three
from thirdbody.kernels.rotation import rotate_small


@njit(**BARE)
def drift_ball(b, s, S, B, dt, left, seen):
    """Half kick and full drift of body b, which is sphere s, behind the last step's closing kick if it is `left` (1, else 0); and
    what was `seen` of balls (`empty_extrema`). The columns behind vectors stay what they are, and a ball has no arm."""
    x, v, w, force, torque = load(B, b, B_X), load(B, b, B_V), load(B, b, B_W), load(B, b, B_F), load(B, b, B_T)
    none, again = broadcast(0.0), broadcast(left)
    fraction = broadcast(0.5 * dt) / set4(
        extract(v, 3), extract(w, 3), S[s, S_R], 1.0
    )  # over mass, inertia and radius, all at once
    change, rotation = broadcast_lane(fraction, 0) * with_last(force, none), broadcast_lane(fraction, 1) * with_last(torque, none)
    v, w = flush_below(v + again * change, RESTING_SPEED) + change, flush_below(w + again * rotation, RESTING_SPIN) + rotation
    x = with_last(x + broadcast(dt) * v, x)
    store(B, b, B_X, x)
    store(B, b, B_V, v)
    store(B, b, B_W, w)
    store(B, b, B_F, with_last(none, force))
    store(B, b, B_T, with_last(none, torque))
    store(B, b, B_Q, rotate_small(load(B, b, B_Q), broadcast(dt) * w))
    if not is_aliased(S):
        store_three(S, s, np.int64(S_X), x)
        store(S, s, S_U, v)
        store(S, s, S_W, w)
    store_three(S, s, np.int64(S_V), v + change)
    store(S, s, S_O, w + rotation)
    square, (fastest, farthest, strange, low, high) = norm_squared(v), seen
    return (
        max(fastest, square), max(farthest, square * extract(fraction, 2) * extract(fraction, 2)), strange + none * x,
        select_greater(low, x, x, low), select_greater(x, high, x, high),
    )  # fmt: skip


@njit(**BARE)
def empty_extrema():
    """What is seen of no balls: squares of the largest speed and of half the longest way over the radius; sums that are not 0 if
    a place is no number; ends of the room that they are in."""
    return 0.0, 0.0, broadcast(0.0), broadcast(np.inf), broadcast(-np.inf)


@njit(**BARE)
def check_sphere_limits(c, start, S, B, D, limits, dt, seen):
    """What `judge` tells, of the balls of chunk c; who it was is looked for only if somebody has to be named."""
    fastest, farthest, strange, low, high = seen
    distance, step = math.sqrt(fastest) * dt, 2.0 * math.sqrt(farthest)
    outside = less_mask(low, limits[0]) | less_mask(limits[1], high)
    there = all_below(high, FAR) & all_below(broadcast(0.0) - low, FAR) & all_below(strange, 1.0)
    if (outside == 0) & there & (step <= D[D_GUARD_TRAVEL]):
        return distance, step, np.int64(0), np.int64(0), np.int64(0)
    body, bad, out = find_offender(c, start, S, B, dt, limits)
    return distance, step, body, bad, out


@njit(**BARE_CHUNK)
def find_offender(c, start, S, B, dt, limits):
    """Of the balls of chunk c, which have drifted: the one with the longest way over its radius, the last that is not finite and
    the last that left the domain (+ 1; 0: none)."""
    maximum, body, bad, out = -1.0, np.int64(0), np.int64(0), np.int64(0)
    for b in range(c * BODIES, min((c + 1) * BODIES, B.shape[0])):
        if B[b, B_BALL] != 0.0:
            step = math.sqrt(norm_squared(load(B, b, B_V))) * dt / S[start[b], S_R]
            bad, out = check_position(b, load(B, b, B_X), step, limits, bad, out)
            maximum, body = (step, np.int64(b)) if step > maximum else (maximum, body)
    return body, bad, out


@njit(**BARE)
def norm_squared(v):
    """Square of the vector of the first three numbers of v."""
    p = v * v
    return extract(p, 0) + extract(p, 1) + extract(p, 2)
