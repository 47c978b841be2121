"""How a ball moves in a step, and what a chunk of them tells: no arms, no matrices, and nobody is named unless a guard trips."""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import above, all_below, below, lane, load, of, splat, spread, store, where_above, with_last
from thirdbody.kernels.layout import B_BALL, B_F, B_Q, B_T, B_V, B_W, B_X, D_GUARD_TRAVEL, S_O, S_R, S_U, S_V, S_W, S_X
from thirdbody.kernels.rigid_body import BODIES, FAR, RESTING_SPEED, RESTING_SPIN, in_one, judge_place, keep_last
from thirdbody.kernels.rotation import turned


@njit(**BARE)
def drift_ball(b, s, S, B, dt, left, seen):
    """Half kick and full drift of body b, which is sphere s, behind the last step's closing kick if it is `left` (1, else 0); and
    what was `seen` of balls (`none_seen`). The columns behind vectors stay what they are, and a ball has no arm."""
    x, v, w, force, torque = load(B, b, B_X), load(B, b, B_V), load(B, b, B_W), load(B, b, B_F), load(B, b, B_T)
    none, again = spread(0.0), spread(left)
    share = spread(0.5 * dt) / of(lane(v, 3), lane(w, 3), S[s, S_R], 1.0)  # over mass, inertia and radius, all at once
    change, turn = splat(share, 0) * with_last(force, none), splat(share, 1) * with_last(torque, none)
    v, w = above(v + again * change, RESTING_SPEED) + change, above(w + again * turn, RESTING_SPIN) + turn
    x = with_last(x + spread(dt) * v, x)
    store(B, b, B_X, x)
    store(B, b, B_V, v)
    store(B, b, B_W, w)
    store(B, b, B_F, with_last(none, force))
    store(B, b, B_T, with_last(none, torque))
    store(B, b, B_Q, turned(load(B, b, B_Q), spread(dt) * w))
    if not in_one(S):
        keep_last(S, s, np.int64(S_X), x)
        store(S, s, S_U, v)
        store(S, s, S_W, w)
    keep_last(S, s, np.int64(S_V), v + change)
    store(S, s, S_O, w + turn)
    square, (fastest, farthest, strange, low, high) = squared(v), seen
    return (
        max(fastest, square), max(farthest, square * lane(share, 2) * lane(share, 2)), strange + none * x,
        where_above(low, x, x, low), where_above(x, high, x, high),
    )  # fmt: skip


@njit(**BARE)
def none_seen():
    """What is seen of no balls: squares of the largest speed and of half the longest way over the radius; sums that are not 0 if
    a place is no number; ends of the room that they are in."""
    return 0.0, 0.0, spread(0.0), spread(np.inf), spread(-np.inf)


@njit(**BARE)
def judge_balls(c, start, S, B, D, limits, dt, seen):
    """What `judge` tells, of the balls of chunk c; who it was is looked for only if somebody has to be named."""
    fastest, farthest, strange, low, high = seen
    way, step = math.sqrt(fastest) * dt, 2.0 * math.sqrt(farthest)
    outside = below(low, limits[0]) | below(limits[1], high)
    there = all_below(high, FAR) & all_below(spread(0.0) - low, FAR) & all_below(strange, 1.0)
    if (outside == 0) & there & (step <= D[D_GUARD_TRAVEL]):
        return way, step, np.int64(0), np.int64(0), np.int64(0)
    body, bad, out = blame(c, start, S, B, dt, limits)
    return way, step, body, bad, out


@njit(**BARE_CHUNK)
def blame(c, start, S, B, dt, limits):
    """Of the balls of chunk c, which have drifted: the one with the longest way over its radius, the last that is not finite and
    the last that left the domain (+ 1; 0: none)."""
    most, body, bad, out = -1.0, np.int64(0), np.int64(0), np.int64(0)
    for b in range(c * BODIES, min((c + 1) * BODIES, B.shape[0])):
        if B[b, B_BALL] != 0.0:
            step = math.sqrt(squared(load(B, b, B_V))) * dt / S[start[b], S_R]
            bad, out = judge_place(b, load(B, b, B_X), step, limits, bad, out)
            most, body = (step, np.int64(b)) if step > most else (most, body)
    return body, bad, out


@njit(**BARE)
def squared(v):
    """Square of the vector of the first three numbers of v."""
    p = v * v
    return lane(p, 0) + lane(p, 1) + lane(p, 2)
