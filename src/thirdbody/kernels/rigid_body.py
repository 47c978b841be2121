"""Where bodies are, where their spheres are, and what is noted of a chunk of them.

Bodies come in chunks of fixed size, so that sums over them have the same bits for any number of threads.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK, DIRECT, NO_COUNTS
from thirdbody.jit.simd import all_below, broadcast, cross, less_mask, load, set4, store, with_last
from thirdbody.kernels.layout import (
    B_BALL,
    B_Q,
    B_V,
    B_W,
    B_X,
    D_FLOOR,
    D_LX,
    D_LY,
    E_ARM,
    E_I,
    E_L,
    E_PUSH,
    S_ARM,
    S_COLS,
    S_O,
    S_U,
    S_V,
    S_W,
    S_X,
    X_Q,
    X_X,
)
from thirdbody.kernels.rotation import matrix, spin

BODIES = 64
"""Bodies per chunk."""

FLAT, PAIRED, GUESTS = range(3)
"""Rows of `cuts`: where the slots of a chunk with plates begin, those that its spheres own with others, and what others left for
its bodies."""

# columns of `moves`, one row per chunk of bodies
MOVE_WAY, MOVE_STEP, MOVE_BODY, MOVE_BAD, MOVE_OUT, MOVE_POWER = range(6)
MOVE_COLS = 6

FAR = 1e150
"""m: nothing is so far away, and its square is a number."""

RESTING_SPEED, RESTING_SPIN, RESTING_MOMENTUM = 1e-60, 1e-60, 1e-90
"""m/s, rad/s and kg m2/s, some fifty orders below any motion: a ball that a dashpot brings to rest between two plates decays for
ever, and arithmetic on denormal numbers is thirty times slower."""


@njit(**BARE)
def store_three(S, s, c, v):
    """Write the first three numbers of v into row s from column c on; the column behind them is another thing."""
    store(S, s, c, with_last(v, load(S, s, c)))


@njit(**BARE)
def place_sphere(s, offsets, x, turn, v, w, v_end, w_end, h, S):
    """Position, arm and velocities of sphere s: of the step (arm half a step of length 2 h ago), and at its end. All are fours;
    `rotation`: the columns of the matrix."""
    arm = turn[0] * broadcast(offsets[s, 0]) + turn[1] * broadcast(offsets[s, 1]) + turn[2] * broadcast(offsets[s, 2])
    middle = arm - broadcast(h) * cross(w, arm)
    store_three(S, s, np.int64(S_X), x + arm)
    store_three(S, s, np.int64(S_U), v + cross(w, middle))
    store_three(S, s, np.int64(S_ARM), arm)  # where bodies and spheres are one table, this is 0 and what forces begin with
    store(S, s, S_W, w)
    store_three(S, s, np.int64(S_V), v_end + cross(w_end, arm))
    store(S, s, S_O, w_end)


@njit(**BARE)
def is_aliased(S):
    """Whether the rows of the bodies tell of their spheres, too (`layout`): then no sphere has an arm."""
    return S.shape[1] != S_COLS


@njit(**BARE)
def arm_to_sphere(s, S):
    """The centre of sphere s from its body's centre of mass."""
    return broadcast(0.0) if is_aliased(S) else load(S, s, S_ARM)


@njit(**BARE)
def vector(v):
    """A tuple of three as a four."""
    return set4(v[0], v[1], v[2], 0.0)


@njit(**BARE)
def columns(turn):
    """The columns of a matrix, a tuple of nine row by row, as fours."""
    return set4(turn[0], turn[3], turn[6], 0.0), set4(turn[1], turn[4], turn[7], 0.0), set4(turn[2], turn[5], turn[8], 0.0)


@njit(**BARE_CHUNK)
def place_body(b, start, offsets, S, x, q, v, w, v_end, w_end, dt):
    """Positions, arms and velocities of body b's spheres, m and rad, with position x and orientation q at the end of a step."""
    rotation, at = columns(matrix(q[0], q[1], q[2], q[3])), vector(x)
    u, o, u_end, o_end = vector(v), vector(w), vector(v_end), vector(w_end)
    for s in range(start[b], start[b + 1]):
        place_sphere(s, offsets, at, rotation, u, o, u_end, o_end, 0.5 * dt, S)


@njit(**BARE_CHUNK)
def spin_body(b, B, E):
    """The angular velocity of body b, from its angular momentum and orientation; of a ball the momentum from the velocity."""
    if B[b, B_BALL] != 0.0:
        store_three(E, b, np.int64(E_L), broadcast(B[b, B_BALL]) * load(B, b, B_W))
    else:
        w = spin(quaternion(b, B), (E[b, E_L], E[b, E_L + 1], E[b, E_L + 2]), (E[b, E_I], E[b, E_I + 1], E[b, E_I + 2]))
        B[b, B_W], B[b, B_W + 1], B[b, B_W + 2] = w


@njit(**DIRECT, **NO_COUNTS)
def place_all(start, offsets, S, B, E):
    """All spheres where their bodies are now, with the velocities of now; and the spins of the bodies."""
    for b in range(B.shape[0]):
        x, v, q = (B[b, B_X], B[b, B_X + 1], B[b, B_X + 2]), (B[b, B_V], B[b, B_V + 1], B[b, B_V + 2]), quaternion(b, B)
        spin_body(b, B, E)
        if is_aliased(S):
            store_three(S, b, np.int64(S_V), load(B, b, B_V))
            store_three(S, b, np.int64(S_O), load(B, b, B_W))
        else:
            w = (B[b, B_W], B[b, B_W + 1], B[b, B_W + 2])
            place_body(b, start, offsets, S, x, q, v, w, v, w, 0.0)


@njit(**BARE)
def quaternion(b, B):
    """Orientation of body b."""
    return B[b, B_Q], B[b, B_Q + 1], B[b, B_Q + 2], B[b, B_Q + 3]


@njit(**BARE)
def check_position(b, x, share, limits, bad, out):
    """Body b, if it or its `share` is not finite (+ 1), or `bad`; if it left the domain, or `out`."""
    low, high = limits
    bad = bad if all_below(x, FAR) & all_below(broadcast(0.0) - x, FAR) & (share < FAR) else b + 1
    out = b + 1 if (less_mask(x, low) | less_mask(high, x)) != 0 else out
    return bad, out


@njit(**BARE)
def limits_of(D):
    """Lower and upper ends of the domain; a periodic or endless one has no sides."""
    l_x, l_y = D[D_LX], D[D_LY]
    low_x, high_x = (0.0, -l_x) if l_x < 0.0 else (-np.inf, np.inf)
    low_y, high_y = (0.0, -l_y) if l_y < 0.0 else (-np.inf, np.inf)
    return set4(low_x, low_y, D[D_FLOOR], -np.inf), set4(high_x, high_y, np.inf, np.inf)


@njit(**BARE_CHUNK)
def reset_plate_forces(first, last, own, body, E):
    """The contacts add up anew the push of the upper plate on the bodies that can touch it, slots first to last."""
    for k in range(first, last):
        E[np.uint64(body[own[k]]), E_PUSH] = 0.0


@njit(**BARE)
def largest_displacement(X0, B, E):
    """How far a point of a body is from where the last search saw it, at most."""
    far = 0.0
    for b in range(B.shape[0]):
        x, y, z = B[b, B_X] - X0[b, X_X], B[b, B_X + 1] - X0[b, X_X + 1], B[b, B_X + 2] - X0[b, X_X + 2]
        same = 0.0
        for k in range(4):
            same += B[b, B_Q + k] * X0[b, X_Q + k]
        # a point at the end of the arm goes the chord: twice the arm times the sine of half the angle
        chord = 2.0 * E[b, E_ARM] * math.sqrt(max(1.0 - same * same, 0.0))
        far = max(far, math.sqrt(x * x + y * y + z * z) + chord)
    return far
