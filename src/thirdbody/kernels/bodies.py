"""The body passes: half kick and drift of rigid clumps, and the gather of contact forces with the closing half kick.

Velocity Verlet. Chunks of bodies are fixed, and every body sums its contacts in the order of their slots: the same bits for
any number of threads.
"""

import numpy as np
from numba import njit

from .layout import (
    B_EF,
    B_ET,
    B_F,
    B_I,
    B_L,
    B_LOW,
    B_MASS,
    B_Q,
    B_SLIP,
    B_T,
    B_UP,
    B_V,
    B_W,
    B_WORK,
    B_X,
    D_LX,
    D_LY,
    F_F,
    F_SLIP,
    F_TI,
    F_TJ,
    F_WORK,
    S_ARM,
    S_O,
    S_R,
    S_U,
    S_V,
    S_W,
    S_X,
    S_Y,
    S_Z,
)  # fmt: skip
from .options import INNER, OPTIONS
from .rotation import free_rotation, matrix, spin

BODIES = 64
"""Bodies per chunk."""

RESTING_SPEED, RESTING_MOMENTUM = 1e-60, 1e-90
"""m/s and kg m2/s, some fifty orders below any motion: a ball that a dashpot brings to rest between two plates decays for ever,
and arithmetic on denormal numbers is thirty times slower."""

# columns of `moves`, one row per chunk of bodies
(MOVE_FAR, MOVE_STEP, MOVE_BAD, MOVE_OUT, MOVE_UP, MOVE_LOW, MOVE_POWER, MOVE_BODY, MOVE_WAY) = 0, 1, 2, 3, 4, 7, 10, 11, 12
MOVE_COLS = 13


@njit(**OPTIONS)
def place_spheres(b, start, offsets, S, X0, B, w, w_end, v_end, q, dt, far):
    """Positions, arms and velocities of body b's spheres; returns the largest squared way since the last search."""
    a_, b_, c_, d_, e_, f_, g_, h_, i_ = matrix(q[0], q[1], q[2], q[3])
    for s in range(start[b], start[b + 1]):
        o_x, o_y, o_z = offsets[s, 0], offsets[s, 1], offsets[s, 2]
        r_x = a_ * o_x + b_ * o_y + c_ * o_z
        r_y = d_ * o_x + e_ * o_y + f_ * o_z
        r_z = g_ * o_x + h_ * o_y + i_ * o_z
        S[s, S_ARM], S[s, S_ARM + 1], S[s, S_ARM + 2] = r_x, r_y, r_z
        S[s, S_X], S[s, S_Y], S[s, S_Z] = B[b, B_X] + r_x, B[b, B_X + 1] + r_y, B[b, B_X + 2] + r_z
        # the displacement of the step is that of the arm half a step ago
        h = 0.5 * dt
        m_x = r_x - h * (w[1] * r_z - w[2] * r_y)
        m_y = r_y - h * (w[2] * r_x - w[0] * r_z)
        m_z = r_z - h * (w[0] * r_y - w[1] * r_x)
        S[s, S_U] = B[b, B_V] + w[1] * m_z - w[2] * m_y
        S[s, S_U + 1] = B[b, B_V + 1] + w[2] * m_x - w[0] * m_z
        S[s, S_U + 2] = B[b, B_V + 2] + w[0] * m_y - w[1] * m_x
        S[s, S_V] = v_end[0] + w_end[1] * r_z - w_end[2] * r_y
        S[s, S_V + 1] = v_end[1] + w_end[2] * r_x - w_end[0] * r_z
        S[s, S_V + 2] = v_end[2] + w_end[0] * r_y - w_end[1] * r_x
        for k in range(3):
            S[s, S_W + k], S[s, S_O + k] = w[k], w_end[k]
        t_x, t_y, t_z = S[s, S_X] - X0[s, 0], S[s, S_Y] - X0[s, 1], S[s, S_Z] - X0[s, 2]
        far = max(far, t_x * t_x + t_y * t_y + t_z * t_z)
    return far


@njit(**INNER)
def drift_body(b, start, offsets, S, X0, B, dt, far):
    """Half kick and full drift of body b; returns the largest squared way of its spheres since the last search."""
    kick = 0.5 * dt / B[b, B_MASS]
    for k in range(3):
        B[b, B_V + k] += kick * B[b, B_F + k]
        B[b, B_L + k] += 0.5 * dt * B[b, B_T + k]
        B[b, B_X + k] += dt * B[b, B_V + k]
    inertia = (B[b, B_I], B[b, B_I + 1], B[b, B_I + 2])
    momentum = (B[b, B_L], B[b, B_L + 1], B[b, B_L + 2])
    old = (B[b, B_Q], B[b, B_Q + 1], B[b, B_Q + 2], B[b, B_Q + 3])
    new = free_rotation(old, momentum, inertia, dt)
    for k in range(4):
        B[b, B_Q + k] = new[k]
    w_0, w_1 = spin(old, momentum, inertia), spin(new, momentum, inertia)
    w = (0.5 * (w_0[0] + w_1[0]), 0.5 * (w_0[1] + w_1[1]), 0.5 * (w_0[2] + w_1[2]))
    end = (
        momentum[0] + 0.5 * dt * B[b, B_T],
        momentum[1] + 0.5 * dt * B[b, B_T + 1],
        momentum[2] + 0.5 * dt * B[b, B_T + 2],
    )
    v_end = (B[b, B_V] + kick * B[b, B_F], B[b, B_V + 1] + kick * B[b, B_F + 1], B[b, B_V + 2] + kick * B[b, B_F + 2])
    return place_spheres(b, start, offsets, S, X0, B, w, spin(new, end, inertia), v_end, new, dt, far)


@njit(**INNER)
def drift_chunk(c, start, offsets, S, X0, B, D, dt, floor, moves):
    """Drift the bodies of chunk c; note how far they went, and the first that is not finite or left the domain."""
    first, last = c * BODIES, min((c + 1) * BODIES, B.shape[0])
    far, step, way = 0.0, 0.0, 0.0
    moves[c, MOVE_BAD], moves[c, MOVE_OUT] = 0.0, 0.0
    for b in range(first, last):
        far = drift_body(b, start, offsets, S, X0, B, dt, far)
        s = start[b]
        u_x, u_y, u_z = S[s, S_U], S[s, S_U + 1], S[s, S_U + 2]
        speed = (u_x * u_x + u_y * u_y + u_z * u_z) ** 0.5 * dt
        way = max(way, speed)
        if speed / S[s, S_R] > step:
            step, moves[c, MOVE_BODY] = speed / S[s, S_R], b
        if not abs(B[b, B_X]) + abs(B[b, B_X + 1]) + abs(B[b, B_X + 2]) + speed < 1e300:
            moves[c, MOVE_BAD] = b + 1.0
        if B[b, B_X + 2] < floor or outside(B[b, B_X], D[D_LX]) or outside(B[b, B_X + 1], D[D_LY]):
            moves[c, MOVE_OUT] = b + 1.0
    moves[c, MOVE_FAR], moves[c, MOVE_STEP], moves[c, MOVE_WAY] = far, step, way


@njit(**INNER)
def outside(x, length):
    """Whether x left an open domain, whose length is told as a negative number; periodic ones cannot be left."""
    return length < 0.0 and (x < 0.0 or x > -length)


@njit(**INNER)
def gather_body(b, incidence, edges, partner, F, B):
    """Sum the slots of body b, in their order, into its force, torque, plate forces, friction work and slip."""
    for k in range(B_UP, B_LOW + 3):
        B[b, k] = 0.0
    f_x, f_y, f_z, t_x, t_y, t_z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        j = partner[k]
        if incidence[e] & 1:
            f_x -= F[k, F_F]
            f_y -= F[k, F_F + 1]
            f_z -= F[k, F_F + 2]
            t_x += F[k, F_TJ]
            t_y += F[k, F_TJ + 1]
            t_z += F[k, F_TJ + 2]
        else:
            f_x += F[k, F_F]
            f_y += F[k, F_F + 1]
            f_z += F[k, F_F + 2]
            t_x += F[k, F_TI]
            t_y += F[k, F_TI + 1]
            t_z += F[k, F_TI + 2]
            if j < 0:
                side = B_LOW if j == -1 else B_UP
                for d in range(3):
                    B[b, side + d] += F[k, F_F + d]
        # work done between two bodies is shared by them
        B[b, B_WORK] += F[k, F_WORK] * (0.5 if j >= 0 else 1.0)
        B[b, B_SLIP] += F[k, F_SLIP]
    B[b, B_F], B[b, B_F + 1], B[b, B_F + 2] = f_x, f_y, f_z
    B[b, B_T], B[b, B_T + 1], B[b, B_T + 2] = t_x, t_y, t_z


@njit(**INNER)
def settled(x, least):
    """x, or zero once it has decayed so far that its square would be a denormal number."""
    return x if abs(x) > least else 0.0


@njit(**INNER)
def kick_body(b, B, force, torque, dt):
    """Half kick of body b by the three forces from column `force` and torques from column `torque`; its spin follows."""
    for k in range(3):
        B[b, B_V + k] = settled(B[b, B_V + k] + 0.5 * dt / B[b, B_MASS] * B[b, force + k], RESTING_SPEED)
        B[b, B_L + k] = settled(B[b, B_L + k] + 0.5 * dt * B[b, torque + k], RESTING_MOMENTUM)
    q = (B[b, B_Q], B[b, B_Q + 1], B[b, B_Q + 2], B[b, B_Q + 3])
    w = spin(q, (B[b, B_L], B[b, B_L + 1], B[b, B_L + 2]), (B[b, B_I], B[b, B_I + 1], B[b, B_I + 2]))
    B[b, B_W], B[b, B_W + 1], B[b, B_W + 2] = w


@njit(**INNER)
def gather_chunk(c, incidence, edges, partner, F, B, dt, time, effects, effect_parameters, has_effects, moves):
    """Forces and closing half kick of the bodies of chunk c; body effects see velocities at the end of the step."""
    first, last = c * BODIES, min((c + 1) * BODIES, B.shape[0])
    for b in range(first, last):
        gather_body(b, incidence, edges, partner, F, B)
        kick_body(b, B, np.int64(B_F), np.int64(B_T), dt)
    for k in range(MOVE_UP, MOVE_POWER + 1):
        moves[c, k] = 0.0
    if has_effects:
        effects(B, first, last, time, dt, effect_parameters)
        for b in range(first, last):
            kick_body(b, B, np.int64(B_EF), np.int64(B_ET), dt)
            for k in range(3):
                B[b, B_F + k] += B[b, B_EF + k]
                B[b, B_T + k] += B[b, B_ET + k]
                moves[c, MOVE_POWER] += B[b, B_EF + k] * B[b, B_V + k] + B[b, B_ET + k] * B[b, B_W + k]
    for b in range(first, last):
        for k in range(3):
            moves[c, MOVE_UP + k] += B[b, B_UP + k]
            moves[c, MOVE_LOW + k] += B[b, B_LOW + k]
