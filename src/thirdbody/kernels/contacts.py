"""The contact pass: candidate pairs -> gaps -> law tiles -> forces in slots, chunk by chunk.

A chunk is a fixed range of slots, whatever the number of threads, and writes only its own slots and its own row of `sums`,
so the result has the same bits for any number of threads.
"""

import math

import numpy as np
from numba import njit

from .layout import (
    B_MASS,
    F_F,
    F_SLIP,
    F_TI,
    F_TJ,
    F_WORK,
    H_E,
    H_LAW,
    H_ON,
    H_SLIP,
    H_STORED,
    I_HISTORY,
    I_MASS,
    I_OVERLAP,
    I_RADIUS,
    I_SX,
    I_SY,
    I_TYPE,
    I_VN,
    I_VX,
    I_VY,
    J_COLS,
    O_A,
    O_CRITICAL,
    O_FN,
    O_HISTORY,
    O_LIMIT,
    O_LOAD,
    O_POWER,
    O_SLIP,
    O_STORED_N,
    O_STORED_T,
    O_TX,
    O_TY,
    O_WORK,
    P_Z,
    Q_COLS,
    R_A,
    R_CRITICAL,
    R_CURVATURE,
    R_CURVATURE_J,
    R_EFFECTIVE,
    R_FN,
    R_LIMIT,
    R_LOAD,
    R_N,
    R_OVERLAP,
    R_POINT,
    R_POINT_J,
    R_STORED_N,
    R_STORED_T,
    R_T,
    R_VI,
    R_VJ,
    S_ARM,
    S_O,
    S_R,
    S_U,
    S_V,
    S_W,
    S_X,
    S_Y,
    S_Z,
    TILE,
)  # fmt: skip
from .options import INNER
from .rolling import MOMENTS, apply_rolling, record_rolling, stage_rolling
from .surface import partner_velocity, surface_velocity

CHUNK = 1024
"""Slots per chunk."""

# columns of `sums`, one row per chunk
SUM_WORK, SUM_POWER, SUM_OVERLAP, SUM_SLOT, SUM_BAD = range(5)
SUM_COLS = 8

GEOMETRY = 11
"""Floats kept per staged contact beside the law's tile: normal, e_1, e_2 (3 each), and the two arm lengths."""


@njit(**INNER)
def nearest_image(d, length):
    """Separation d in a period of `length`; 0 means not periodic."""
    return d - length * np.rint(d / length) if length > 0.0 else d


@njit(**INNER)
def separation(k, own, partner, S, P, l_x, l_y):
    """Overlap of candidate k (not positive: apart) and the unit normal, partner to owner, of one that touches."""
    i, j = own[k], partner[k]
    if j == -1:
        return S[i, S_R] - S[i, S_Z], 0.0, 0.0, 1.0
    if j < -1:
        return S[i, S_R] - (P[-j - 2, P_Z] - S[i, S_Z]), 0.0, 0.0, -1.0
    d_x = nearest_image(S[i, S_X] - S[j, S_X], l_x)
    d_y = nearest_image(S[i, S_Y] - S[j, S_Y], l_y)
    d_z = S[i, S_Z] - S[j, S_Z]
    square = d_x * d_x + d_y * d_y + d_z * d_z
    reach = S[i, S_R] + S[j, S_R]
    if square >= reach * reach:
        return -1.0, 0.0, 0.0, 0.0
    d = math.sqrt(square)
    inverse = 1.0 / max(d, 1e-300)
    return reach - d, d_x * inverse, d_y * inverse, d_z * inverse


@njit(**INNER)
def carry_frame(H, k, n_x, n_y, n_z, p_x, p_y, p_z, twist):
    """First axis of the contact frame, carried with the normal and turned by `twist` about it; made anew at first touch."""
    if H[k, H_ON] == 0.0:
        # any direction that is never parallel to the normal; the law cannot tell which
        if abs(n_z) > 0.5:
            e_x, e_y, e_z = 1.0, 0.0, 0.0
        else:
            e_x, e_y, e_z = 0.0, 0.0, 1.0
    else:
        e_x, e_y, e_z = H[k, H_E], H[k, H_E + 1], H[k, H_E + 2]
        e_x, e_y, e_z = (
            e_x + twist * (p_y * e_z - p_z * e_y), e_y + twist * (p_z * e_x - p_x * e_z), e_z + twist * (p_x * e_y - p_y * e_x),
        )  # fmt: skip
    # along the bisector of old and new normal: a projection along the new one alone would turn the frame by O(step)
    along = (e_x * n_x + e_y * n_y + e_z * n_z) / (p_x * n_x + p_y * n_y + p_z * n_z)
    e_x, e_y, e_z = e_x - along * p_x, e_y - along * p_y, e_z - along * p_z
    scale = 1.0 / math.sqrt(e_x * e_x + e_y * e_y + e_z * e_z)
    return e_x * scale, e_y * scale, e_z * scale


@njit(**INNER)
def mid_normal(S, i, j, distance, half, n_x, n_y, n_z):
    """Unit normal half a step ago: slip is a displacement of the step, so its arms are those of the middle of the step."""
    x = distance * n_x - half * (S[i, S_U] - S[j, S_U])
    y = distance * n_y - half * (S[i, S_U + 1] - S[j, S_U + 1])
    z = distance * n_z - half * (S[i, S_U + 2] - S[j, S_U + 2])
    inverse = 1.0 / max(math.sqrt(x * x + y * y + z * z), 1e-300)
    return x * inverse, y * inverse, z * inverse


@njit(**INNER)
def stage(q, k, overlap, n_x, n_y, n_z, own, partner, kind, S, B, P, body, H, dt, v_x, v_y, I, G, n_history):  # noqa: E741
    """Put contact k into place q of the law's tile: effective radius and mass, slip of the step, velocities, history."""
    i, j = own[k], partner[k]
    r_i = S[i, S_R]
    m_i = B[body[i], B_MASS]
    radius, mass, arm_j, r_j = r_i, m_i, 0.0, 0.0
    arm_i = r_i - 0.5 * overlap
    p_x, p_y, p_z = n_x, n_y, n_z
    w_x, w_y, w_z = S[i, S_W], S[i, S_W + 1], S[i, S_W + 2]
    if j >= 0:
        r_j = S[j, S_R]
        arm_j = r_j - 0.5 * overlap
        m_j = B[body[j], B_MASS]
        radius, mass = r_i * r_j / (r_i + r_j), m_i * m_j / (m_i + m_j)
        p_x, p_y, p_z = mid_normal(S, i, j, r_i + r_j - overlap, 0.5 * dt, n_x, n_y, n_z)
        w_x, w_y, w_z = w_x + S[j, S_W], w_y + S[j, S_W + 1], w_z + S[j, S_W + 2]
    twist = w_x * p_x + w_y * p_y + w_z * p_z
    e_x, e_y, e_z = carry_frame(H, k, n_x, n_y, n_z, p_x, p_y, p_z, 0.5 * dt * twist)
    f_x, f_y, f_z = n_y * e_z - n_z * e_y, n_z * e_x - n_x * e_z, n_x * e_y - n_y * e_x
    a_x, a_y, a_z = surface_velocity(S, i, S_U, S_W, -arm_i * p_x, -arm_i * p_y, -arm_i * p_z)
    b_x, b_y, b_z = partner_velocity(S, P, j, S_U, S_W, arm_j * p_x, arm_j * p_y, arm_j * p_z, v_x, v_y)
    I[I_SX * TILE + q] = ((a_x - b_x) * e_x + (a_y - b_y) * e_y + (a_z - b_z) * e_z) * dt
    I[I_SY * TILE + q] = ((a_x - b_x) * f_x + (a_y - b_y) * f_y + (a_z - b_z) * f_z) * dt
    a_x, a_y, a_z = surface_velocity(S, i, S_V, S_O, -arm_i * n_x, -arm_i * n_y, -arm_i * n_z)
    b_x, b_y, b_z = partner_velocity(S, P, j, S_V, S_O, arm_j * n_x, arm_j * n_y, arm_j * n_z, v_x, v_y)
    I[I_VN * TILE + q] = (a_x - b_x) * n_x + (a_y - b_y) * n_y + (a_z - b_z) * n_z
    I[I_VX * TILE + q] = (a_x - b_x) * e_x + (a_y - b_y) * e_y + (a_z - b_z) * e_z
    I[I_VY * TILE + q] = (a_x - b_x) * f_x + (a_y - b_y) * f_y + (a_z - b_z) * f_z
    I[I_OVERLAP * TILE + q], I[I_RADIUS * TILE + q], I[I_MASS * TILE + q] = overlap, radius, mass
    I[I_TYPE * TILE + q] = kind[k]
    for h in range(n_history):
        I[(I_HISTORY + h) * TILE + q] = H[k, H_LAW + h]
    G[q, 0], G[q, 1], G[q, 2], G[q, 3], G[q, 4], G[q, 5] = n_x, n_y, n_z, e_x, e_y, e_z
    G[q, 6], G[q, 7], G[q, 8], G[q, 9], G[q, 10] = f_x, f_y, f_z, arm_i, arm_j


@njit(**INNER)
def release(k, H, F, sums, c):
    """A contact that opened: what its tangential spring still held is dissipated, its memory is wiped."""
    if H[k, H_ON] != 0.0:
        sums[c, SUM_WORK] += H[k, H_STORED]
        F[k, F_WORK] = H[k, H_STORED]
        F[k, F_SLIP] = 0.0
        for h in range(H.shape[1]):
            H[k, h] = 0.0
        for f in range(F_WORK):
            F[k, f] = 0.0
    else:
        F[k, F_WORK] = 0.0


@njit(**INNER)
def apply(q, k, O, G, own, partner, S, H, F, n_history, sums, c):  # noqa: E741
    """Take the law's answer for place q of the tile into slot k: force, torques about both centres, history, sums."""
    i, j = own[k], partner[k]
    n_x, n_y, n_z = G[q, 0], G[q, 1], G[q, 2]
    f_n, t_1, t_2 = O[O_FN * TILE + q], O[O_TX * TILE + q], O[O_TY * TILE + q]
    f_x = f_n * n_x + t_1 * G[q, 3] + t_2 * G[q, 6]
    f_y = f_n * n_y + t_1 * G[q, 4] + t_2 * G[q, 7]
    f_z = f_n * n_z + t_1 * G[q, 5] + t_2 * G[q, 8]
    a = G[q, 9]
    r_x, r_y, r_z = S[i, S_ARM] - a * n_x, S[i, S_ARM + 1] - a * n_y, S[i, S_ARM + 2] - a * n_z
    F[k, F_F], F[k, F_F + 1], F[k, F_F + 2] = f_x, f_y, f_z
    F[k, F_TI], F[k, F_TI + 1], F[k, F_TI + 2] = r_y * f_z - r_z * f_y, r_z * f_x - r_x * f_z, r_x * f_y - r_y * f_x
    if j >= 0:
        a = G[q, 10]
        r_x, r_y, r_z = S[j, S_ARM] + a * n_x, S[j, S_ARM + 1] + a * n_y, S[j, S_ARM + 2] + a * n_z
        F[k, F_TJ], F[k, F_TJ + 1], F[k, F_TJ + 2] = r_z * f_y - r_y * f_z, r_x * f_z - r_z * f_x, r_y * f_x - r_x * f_y
    F[k, F_WORK], F[k, F_SLIP] = O[O_WORK * TILE + q], O[O_SLIP * TILE + q]
    H[k, H_ON] = 1.0
    H[k, H_E], H[k, H_E + 1], H[k, H_E + 2] = G[q, 3], G[q, 4], G[q, 5]
    H[k, H_STORED] = O[O_STORED_T * TILE + q]
    H[k, H_SLIP] += O[O_SLIP * TILE + q]
    for h in range(n_history):
        H[k, H_LAW + h] = O[(O_HISTORY + h) * TILE + q]
    sums[c, SUM_WORK] += O[O_WORK * TILE + q]
    sums[c, SUM_POWER] += O[O_POWER * TILE + q]
    if not abs(f_x) + abs(f_y) + abs(f_z) < 1e300:
        sums[c, SUM_BAD] = k + 1.0


@njit(**INNER)
def record(q, k, I, O, G, own, partner, S, P, R, v_x, v_y):  # noqa: E741
    """Everything that output and labels need of one contact, as the step computed it."""
    i, j = own[k], partner[k]
    n_x, n_y, n_z, a_i, a_j = G[q, 0], G[q, 1], G[q, 2], G[q, 9], G[q, 10]
    t_1, t_2 = O[O_TX * TILE + q], O[O_TY * TILE + q]
    for d in range(3):
        n = G[q, d]
        R[k, R_POINT + d] = S[i, S_ARM + d] - a_i * n
        R[k, R_POINT_J + d] = S[j, S_ARM + d] + a_j * n if j >= 0 else 0.0
        R[k, R_N + d] = n
        R[k, R_T + d] = t_1 * G[q, 3 + d] + t_2 * G[q, 6 + d]
    R[k, R_CURVATURE], R[k, R_CURVATURE_J] = S[i, S_R], S[j, S_R] if j >= 0 else 0.0
    R[k, R_A], R[k, R_OVERLAP] = O[O_A * TILE + q], I[I_OVERLAP * TILE + q]
    R[k, R_FN], R[k, R_LOAD] = O[O_FN * TILE + q], O[O_LOAD * TILE + q]
    R[k, R_LIMIT], R[k, R_CRITICAL] = O[O_LIMIT * TILE + q], O[O_CRITICAL * TILE + q]
    R[k, R_STORED_N], R[k, R_STORED_T] = O[O_STORED_N * TILE + q], O[O_STORED_T * TILE + q]
    R[k, R_EFFECTIVE] = I[I_RADIUS * TILE + q]
    a_x, a_y, a_z = surface_velocity(S, i, S_V, S_O, -a_i * n_x, -a_i * n_y, -a_i * n_z)
    b_x, b_y, b_z = partner_velocity(S, P, j, S_V, S_O, a_j * n_x, a_j * n_y, a_j * n_z, v_x, v_y)
    R[k, R_VI], R[k, R_VI + 1], R[k, R_VI + 2] = a_x, a_y, a_z
    R[k, R_VJ], R[k, R_VJ + 1], R[k, R_VJ + 2] = b_x, b_y, b_z


@njit(**INNER)
def contact_chunk(
    c, n, own, partner, kind, S, B, P, body, H, F, R, sums, law, pairs, dt, v_x, v_y, l_x, l_y, n_history, rolling, observed
):
    """Forces of the candidate slots of chunk c: filter by gap, then the law in tiles of TILE active contacts."""
    first, last = c * CHUNK, min((c + 1) * CHUNK, n)
    for s in range(SUM_COLS):
        sums[c, s] = 0.0
    I = np.empty((I_HISTORY + n_history + J_COLS) * TILE)  # noqa: E741
    O = np.empty((O_HISTORY + n_history + Q_COLS) * TILE)  # noqa: E741
    G = np.empty((TILE, GEOMETRY))
    slots = np.empty(TILE, np.int64)
    m = np.int64(0)  # not the literal 0, for which the callees would be compiled once more
    for k in range(first, last):
        overlap, n_x, n_y, n_z = separation(k, own, partner, S, P, l_x, l_y)
        if overlap > 0.0:
            ratio = overlap / min(S[own[k], S_R], S[partner[k], S_R] if partner[k] >= 0 else S[own[k], S_R])
            if ratio > sums[c, SUM_OVERLAP]:
                sums[c, SUM_OVERLAP], sums[c, SUM_SLOT] = ratio, k
            stage(m, k, overlap, n_x, n_y, n_z, own, partner, kind, S, B, P, body, H, dt, v_x, v_y, I, G, n_history)
            slots[m] = k
            m += 1
        else:
            release(k, H, F, sums, c)
        if m == TILE or (k == last - 1 and m > 0):
            if rolling > 0:
                for q in range(m):
                    stage_rolling(q, slots[q], own, partner, S, P, dt, v_x, v_y, I, G, n_history)
            law(I, O, m, pairs)
            for q in range(m):
                apply(q, slots[q], O, G, own, partner, S, H, F, n_history, sums, c)
                if observed:
                    record(q, slots[q], I, O, G, own, partner, S, P, R, v_x, v_y)
            if rolling == MOMENTS:
                for q in range(m):
                    apply_rolling(q, slots[q], partner, O, G, F, n_history)
                    if observed:
                        record_rolling(q, slots[q], O, G, R, n_history)
            m = np.int64(0)
