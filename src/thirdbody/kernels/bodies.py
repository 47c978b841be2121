"""The body passes: half kick and drift of rigid clumps, and where their spheres are.

Velocity Verlet. Bodies come in chunks of fixed size; the motion of a chunk is computed field by field, which the compiler turns
into vector instructions: IEEE arithmetic body by body, so the same bits as one by one.
"""

import math

import numpy as np
from numba import njit

from .four import AHEAD, LINE, all_below, below, crossed, fetch, lane, load, of, put, splat, spread, store, transposed, with_last
from .layout import (
    B_ARM,
    B_BALL,
    B_F,
    B_I,
    B_L,
    B_MASS,
    B_PUSH,
    B_Q,
    B_T,
    B_V,
    B_W,
    B_X,
    D_FLOOR,
    D_LX,
    D_LY,
    S_ARM,
    S_O,
    S_R,
    S_U,
    S_V,
    S_W,
    S_X,
    X_Q,
    X_X,
)  # fmt: skip
from .options import BARE, BARE_CHUNK, DIRECT, NO_COUNTS
from .rotation import free_rotation, matrix, spin, turned

BODIES = 64
"""Bodies per chunk."""

FLAT, PAIRED, GUESTS = range(3)
"""Rows of `cuts`: where the slots of a chunk with plates begin, those that its spheres own with others, and what others left for
its bodies."""

# columns of `moves`, one row per chunk of bodies
MOVE_WAY, MOVE_STEP, MOVE_BODY, MOVE_BAD, MOVE_OUT, MOVE_POWER = range(6)
MOVE_COLS = 6

# Z: fields of a chunk of bodies, stride BODIES: first the columns of B up to the moments
Z_W, Z_END_W, Z_END_V, Z_TURN, Z_WAY = 28, 31, 34, 37, 46  # spin of the step, at its end, velocity there, matrix, longest way
Z_COLS = 47


@njit(**BARE)
def keep_last(S, s, c, v):
    """Write the first three numbers of v into row s from column c on; the column behind them is another thing."""
    store(S, s, c, with_last(v, load(S, s, c)))


@njit(**BARE)
def place_sphere(s, offsets, x, turn, v, w, v_end, w_end, h, S):
    """Position, arm and velocities of sphere s: of the step (arm half a step of length 2 h ago), and at its end. All are fours;
    `turn`: the columns of the matrix."""
    arm = turn[0] * spread(offsets[s, 0]) + turn[1] * spread(offsets[s, 1]) + turn[2] * spread(offsets[s, 2])
    middle = arm - spread(h) * crossed(w, arm)
    keep_last(S, s, np.int64(S_X), x + arm)
    keep_last(S, s, np.int64(S_U), v + crossed(w, middle))
    keep_last(S, s, np.int64(S_ARM), arm)
    store(S, s, S_W, w)
    store(S, s, S_V, v_end + crossed(w_end, arm))
    store(S, s, S_O, w_end)


@njit(**BARE)
def vector(v):
    """A tuple of three as a four."""
    return of(v[0], v[1], v[2], 0.0)


@njit(**BARE)
def columns(turn):
    """The columns of a matrix, a tuple of nine row by row, as fours."""
    return of(turn[0], turn[3], turn[6], 0.0), of(turn[1], turn[4], turn[7], 0.0), of(turn[2], turn[5], turn[8], 0.0)


@njit(**BARE_CHUNK)
def place_body(b, start, offsets, S, x, q, v, w, v_end, w_end, dt):
    """Positions, arms and velocities of body b's spheres, m and rad, with position x and orientation q at the end of a step."""
    turn, at = columns(matrix(q[0], q[1], q[2], q[3])), vector(x)
    u, o, u_end, o_end = vector(v), vector(w), vector(v_end), vector(w_end)
    for s in range(start[b], start[b + 1]):
        place_sphere(s, offsets, at, turn, u, o, u_end, o_end, 0.5 * dt, S)


@njit(**BARE_CHUNK)
def spin_body(b, B):
    """The angular velocity of body b, from its angular momentum and orientation."""
    w = spin(quaternion(b, B), (B[b, B_L], B[b, B_L + 1], B[b, B_L + 2]), (B[b, B_I], B[b, B_I + 1], B[b, B_I + 2]))
    B[b, B_W], B[b, B_W + 1], B[b, B_W + 2] = w


@njit(**DIRECT, **NO_COUNTS)
def place_all(start, offsets, S, B):
    """All spheres where their bodies are now, with the velocities of now; and the spins of the bodies."""
    for b in range(B.shape[0]):
        x, v, q = (B[b, B_X], B[b, B_X + 1], B[b, B_X + 2]), (B[b, B_V], B[b, B_V + 1], B[b, B_V + 2]), quaternion(b, B)
        spin_body(b, B)
        w = (B[b, B_W], B[b, B_W + 1], B[b, B_W + 2])
        place_body(b, start, offsets, S, x, q, v, w, v, w, 0.0)


@njit(**BARE)
def quaternion(b, B):
    """Orientation of body b."""
    return B[b, B_Q], B[b, B_Q + 1], B[b, B_Q + 2], B[b, B_Q + 3]


@njit(**BARE)
def three(Z, at):
    """Three fields of a place of a chunk, the first of them at `at`: a sum, since a bare number would be compiled once more."""
    return Z[at], Z[at + BODIES], Z[at + 2 * BODIES]


@njit(**BARE)
def put_three(Z, at, x, y, z):
    """Write three fields of a place of a chunk, the first of them at `at`."""
    Z[at], Z[at + BODIES], Z[at + 2 * BODIES] = x, y, z


@njit(**BARE_CHUNK)
def move(n, dt, Z):
    """Half kick and full drift of n bodies, and the longest way of a point of each in this step.

    No loop stands inside the loop: the compiler makes vector instructions of innermost loops only.
    """
    half = 0.5 * dt
    for p in range(n):
        kick = half / Z[p + B_MASS * BODIES]
        f_x, f_y, f_z = three(Z, p + B_F * BODIES)
        v_x, v_y, v_z = three(Z, p + B_V * BODIES)
        v_x, v_y, v_z = v_x + kick * f_x, v_y + kick * f_y, v_z + kick * f_z
        x, y, z = three(Z, p + B_X * BODIES)
        x, y, z = x + dt * v_x, y + dt * v_y, z + dt * v_z
        t_x, t_y, t_z = three(Z, p + B_T * BODIES)
        l_x, l_y, l_z = three(Z, p + B_L * BODIES)
        momentum = (l_x + half * t_x, l_y + half * t_y, l_z + half * t_z)
        inertia = three(Z, p + B_I * BODIES)
        at = p + B_Q * BODIES
        old = (Z[at], Z[at + BODIES], Z[at + 2 * BODIES], Z[at + 3 * BODIES])
        new = free_rotation(old, momentum, inertia, dt)
        w_0, w_1 = spin(old, momentum, inertia), spin(new, momentum, inertia)
        w = (0.5 * (w_0[0] + w_1[0]), 0.5 * (w_0[1] + w_1[1]), 0.5 * (w_0[2] + w_1[2]))
        end = (momentum[0] + half * t_x, momentum[1] + half * t_y, momentum[2] + half * t_z)
        arm = Z[p + B_ARM * BODIES]
        put_three(Z, p + B_X * BODIES, x, y, z)
        put_three(Z, p + B_V * BODIES, v_x, v_y, v_z)
        put_three(Z, p + B_L * BODIES, momentum[0], momentum[1], momentum[2])
        Z[at], Z[at + BODIES], Z[at + 2 * BODIES], Z[at + 3 * BODIES] = new
        put_three(Z, p + Z_W * BODIES, w[0], w[1], w[2])
        w_end = spin(new, end, inertia)
        put_three(Z, p + Z_END_W * BODIES, w_end[0], w_end[1], w_end[2])
        put_three(Z, p + Z_END_V * BODIES, v_x + kick * f_x, v_y + kick * f_y, v_z + kick * f_z)
        turn = matrix(new[0], new[1], new[2], new[3])
        put_three(Z, p + Z_TURN * BODIES, turn[0], turn[1], turn[2])
        put_three(Z, p + (Z_TURN + 3) * BODIES, turn[3], turn[4], turn[5])
        put_three(Z, p + (Z_TURN + 6) * BODIES, turn[6], turn[7], turn[8])
        fast = math.sqrt(v_x * v_x + v_y * v_y + v_z * v_z) + math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) * arm
        Z[p + Z_WAY * BODIES] = fast * dt


@njit(**BARE)
def judge(b, way, share, x, limits, seen):
    """What was `seen` of a chunk, and body b: the longest way and the largest share of a radius, with its body, and the last body
    that is not finite or left the domain (+ 1; 0: none). Of balls squares of speeds are compared instead: no root."""
    longest, step, body, bad, out = seen
    body = b if share > step else body
    bad, out = judge_place(b, x, share, limits, bad, out)
    return max(longest, way), max(step, share), body, bad, out


@njit(**BARE)
def judge_place(b, x, share, limits, bad, out):
    """Body b, if it or its `share` is not finite (+ 1), or `bad`; if it left the domain, or `out`."""
    low, high = limits
    bad = bad if all_below(x * x, 1e300) & (share < 1e300) else b + 1
    out = b + 1 if (below(x, low) | below(high, x)) != 0 else out
    return bad, out


@njit(**BARE)
def seen_of_both(balls, clumps, dt):
    """What was seen of the balls, in squares, and of the clumps of a chunk."""
    fastest, rate, ball, bad, out = balls
    longest, step, body, bad_clump, out_clump = clumps
    share = math.sqrt(rate) * dt
    body = ball if share > step else body
    return max(math.sqrt(fastest) * dt, longest), max(share, step), body, max(bad, bad_clump), max(out, out_clump)


@njit(**BARE)
def limits_of(D):
    """Lower and upper ends of the domain; a periodic or endless one has no sides."""
    l_x, l_y = D[D_LX], D[D_LY]
    low_x, high_x = (0.0, -l_x) if l_x < 0.0 else (-np.inf, np.inf)
    low_y, high_y = (0.0, -l_y) if l_y < 0.0 else (-np.inf, np.inf)
    return of(low_x, low_y, D[D_FLOOR], -np.inf), of(high_x, high_y, np.inf, np.inf)


@njit(**BARE)
def squared(v):
    """Square of the vector of the first three numbers of v."""
    p = v * v
    return lane(p, 0) + lane(p, 1) + lane(p, 2)


@njit(**BARE)
def forget(b, B):
    """The contacts add up the forces on body b anew, but go on with its friction work and slip."""
    keep_last(B, b, np.int64(B_F), spread(0.0))
    keep_last(B, b, np.int64(B_T), spread(0.0))


@njit(**BARE_CHUNK)
def forget_plates(first, last, own, body, B):
    """The same for the push of the upper plate on the bodies that can touch it, slots first to last."""
    for k in range(first, last):
        B[np.uint64(body[own[k]]), B_PUSH] = 0.0


@njit(**BARE)
def drift_ball(b, s, S, B, dt):
    """Half kick and full drift of body b, which is sphere s; returns the squares of its speed and of its speed over radius, and
    its place. The columns behind position, velocity and momentum stay what they are, and a ball has no arm."""
    x, momentum, force, torque = load(B, b, B_X), load(B, b, B_L), load(B, b, B_F), load(B, b, B_T)
    size, none, half = load(S, s, S_X), spread(0.0), spread(0.5 * dt)
    inverse = spread(1.0) / of(lane(x, 3), lane(momentum, 3), lane(size, 3), 1.0)  # of mass, inertia and radius: all at once
    rate = splat(inverse, 1)
    change, push = half * splat(inverse, 0) * with_last(force, none), half * with_last(torque, none)
    v, momentum = load(B, b, B_V) + change, momentum + push
    x = x + spread(dt) * v
    store(B, b, B_X, x)
    store(B, b, B_V, v)
    store(B, b, B_L, momentum)
    store(B, b, B_F, with_last(none, force))
    store(B, b, B_T, with_last(none, torque))
    store(S, s, S_X, with_last(x, size))
    store(S, s, S_U, with_last(v, x))
    w = with_last(momentum * rate, change)
    store(S, s, S_W, w)
    store(S, s, S_V, v + change)
    store(S, s, S_O, with_last((momentum + push) * rate, change))
    angle, square = spread(dt) * w, squared(v)
    new = turned(quaternion(b, B), lane(angle, 0), lane(angle, 1), lane(angle, 2))
    B[b, B_Q], B[b, B_Q + 1], B[b, B_Q + 2], B[b, B_Q + 3] = new
    return square, square * lane(inverse, 2) * lane(inverse, 2), x


@njit(**BARE)
def farthest(X0, B):
    """How far a point of a body is from where the last search saw it, at most."""
    far = 0.0
    for b in range(B.shape[0]):
        x, y, z = B[b, B_X] - X0[b, X_X], B[b, B_X + 1] - X0[b, X_X + 1], B[b, B_X + 2] - X0[b, X_X + 2]
        same = 0.0
        for k in range(4):
            same += B[b, B_Q + k] * X0[b, X_Q + k]
        # a point at the end of the arm goes the chord: twice the arm times the sine of half the angle
        chord = 2.0 * B[b, B_ARM] * math.sqrt(max(1.0 - same * same, 0.0))
        far = max(far, math.sqrt(x * x + y * y + z * z) + chord)
    return far


@njit(**BARE)
def stage_four(p, staged, B, Z):
    """Put the four bodies staged[p:p + 4] into the places from p on."""
    b = np.uint64(staged[p]), np.uint64(staged[p + 1]), np.uint64(staged[p + 2]), np.uint64(staged[p + 3])
    for k in range(0, B_I + 4, 4):
        fields = transposed(load(B, b[0], k), load(B, b[1], k), load(B, b[2], k), load(B, b[3], k))
        at = p + k * BODIES
        put(Z, at, fields[0])
        put(Z, at + BODIES, fields[1])
        put(Z, at + 2 * BODIES, fields[2])
        put(Z, at + 3 * BODIES, fields[3])


@njit(**BARE)
def unstage_body(p, b, Z, B):
    """Take the motion of body b from place p of the chunk."""
    for k in range(3):
        B[b, B_X + k], B[b, B_V + k] = Z[p + (B_X + k) * BODIES], Z[p + (B_V + k) * BODIES]
        B[b, B_L + k] = Z[p + (B_L + k) * BODIES]
    for k in range(4):
        B[b, B_Q + k] = Z[p + (B_Q + k) * BODIES]
    forget(b, B)


@njit(**BARE)
def place_staged(p, b, start, near, beginning, everything, offsets, S, Z, dt):
    """Place those of body b's spheres that can meet something (`near`), or `everything`, from place p of the chunk."""
    turn = columns((
        *three(Z, p + Z_TURN * BODIES), *three(Z, p + (Z_TURN + 3) * BODIES), *three(Z, p + (Z_TURN + 6) * BODIES),
    ))  # fmt: skip
    x, v = vector(three(Z, p + B_X * BODIES)), vector(three(Z, p + B_V * BODIES))
    w, w_end = vector(three(Z, p + Z_W * BODIES)), vector(three(Z, p + Z_END_W * BODIES))
    v_end = vector(three(Z, p + Z_END_V * BODIES))
    begin = start[b] if everything else np.int64(beginning[b])
    end = start[b + 1] if everything else np.int64(beginning[b + 1])
    for e in range(begin, end):
        place_sphere(e if everything else np.int64(near[e]), offsets, x, turn, v, w, v_end, w_end, 0.5 * dt, S)


@njit(**BARE)
def foretell(b, start, S, B):
    """Ask for what the drift of body b will need, if it is a ball: a processor that sees where a table is read ahead of it does
    so within a page only, and a page is a dozen bodies."""
    s = np.uint64(start[b])
    for line in range(0, B_I, LINE):
        fetch(B, np.uint64(b), np.int64(line))
        fetch(S, s, np.int64(line))


@njit(**BARE_CHUNK)
def drift_chunk(c, start, near, beginning, everything, offsets, S, B, D, dt, moves, Z, staged):
    """Drift the bodies of chunk c and place those of their spheres that can meet something (`near`), or `everything`."""
    balls = seen = (0.0, 0.0, np.int64(0), np.int64(0), np.int64(0))
    limits, n = limits_of(D), np.int64(0)  # not the literal 0, for which the callees would be compiled once more
    for b in range(c * BODIES, min((c + 1) * BODIES, B.shape[0])):
        foretell(min(b + AHEAD, B.shape[0] - 1), start, S, B)
        if B[b, B_BALL] != 0.0:
            square, share, x = drift_ball(b, start[b], S, B, dt)
            balls = judge(b, square, share, x, limits, balls)
        else:
            staged[n] = b
            n += 1
    for p in range(n, n + -n % 4):
        staged[p] = staged[n - 1]  # up to a multiple of four
    for p in range(0, n, 4):
        stage_four(np.int64(p), staged, B, Z)
    move(n, dt, Z)
    for p in range(n):
        i = np.int64(staged[p])
        unstage_body(p, i, Z, B)
        way = Z[p + Z_WAY * BODIES]
        seen = judge(i, way, way / S[start[i], S_R], load(B, i, B_X), limits, seen)
        place_staged(p, i, start, near, beginning, everything, offsets, S, Z, dt)
    seen = seen_of_both(balls, seen, dt)
    moves[c, MOVE_WAY], moves[c, MOVE_STEP], moves[c, MOVE_BODY], moves[c, MOVE_BAD], moves[c, MOVE_OUT] = seen
