"""Contacts of a tile, field by field: what the tables say of each, then the geometry of all at once.

The first kind of function reads rows and only copies and adds; the second works on whole fields, which the compiler turns into
vector instructions (as long as its loop starts at zero and has no loop inside). IEEE arithmetic contact by contact: the same bits
as one by one.
"""

import math

import numpy as np
from numba import njit

from .layout import (
    G_ARM_I,
    G_ARM_J,
    G_D,
    G_E,
    G_F,
    G_MJ,
    G_N,
    G_O,
    G_ON,
    G_P,
    G_Q,
    G_RI,
    G_RJ,
    G_RO,
    G_RW,
    G_U,
    G_V,
    G_W,
    H_E,
    H_LAW,
    H_ON,
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
    O_FN,
    O_TX,
    O_TY,
    S_MASS,
    S_O,
    S_R,
    S_U,
    S_V,
    S_W,
    S_X,
    S_Z,
    TILE,
)  # fmt: skip
from .options import BARE, BARE_CHUNK
from .periodic import image

AT_END = (G_V - G_U) * TILE
"""From a field of the step to that of its end; the columns of spheres are S_V - S_U apart."""


@njit(**BARE)
def set3(at, x, y, z, G):
    """Write a vector into a place of three fields, the first of them at `at`."""
    G[at], G[at + TILE], G[at + 2 * TILE] = x, y, z


@njit(**BARE)
def remember(q, k, kind, H, I, G, n_history):  # noqa: E741
    """Put what slot k remembers into place q."""
    G[q + G_ON * TILE] = H[k, H_ON]
    for d in range(3):
        G[q + (G_E + d) * TILE] = H[k, H_E + d]
    I[q + I_TYPE * TILE] = kind[k]
    for h in range(n_history):
        I[q + (I_HISTORY + h) * TILE] = H[k, H_LAW + h]


@njit(**BARE)
def stage_plate(q, k, overlap, own, partner, kind, S, H, v_x, v_y, rise, I, G, n_history):  # noqa: E741
    """Put slot k, a contact with a plate, into place q; the upper plate moves with v_x, v_y and `rise`."""
    i = own[k]
    up = 1.0 if partner[k] < -1 else 0.0
    r = S[i, S_R]
    G[q + G_N * TILE], G[q + (G_N + 1) * TILE], G[q + (G_N + 2) * TILE] = 0.0, 0.0, 1.0 - 2.0 * up
    G[q + G_P * TILE], G[q + (G_P + 1) * TILE], G[q + (G_P + 2) * TILE] = 0.0, 0.0, 1.0 - 2.0 * up
    for d in range(3):
        for t in range(2):
            at = q + d * TILE + t * AT_END
            w = S[i, S_W + d + t * (S_V - S_U)]
            G[at + G_U * TILE] = S[i, S_U + d + t * (S_V - S_U)]
            G[at + G_W * TILE], G[at + G_RW * TILE] = w, r * w
    for t in range(2):
        at = q + t * AT_END
        G[at + G_U * TILE] -= up * v_x
        G[at + (G_U + 1) * TILE] -= up * v_y
        G[at + (G_U + 2) * TILE] -= up * rise
    G[q + G_ARM_I * TILE], G[q + G_ARM_J * TILE] = r - 0.5 * overlap, 0.0
    G[q + G_RI * TILE], G[q + G_RJ * TILE] = r, r
    I[q + I_OVERLAP * TILE], I[q + I_RADIUS * TILE], I[q + I_MASS * TILE] = overlap, r, S[i, S_MASS]
    remember(q, k, kind, H, I, G, n_history)


@njit(**BARE_CHUNK)
def stage_pairs(n, slots, first, own, partner, kind, S, H, l_x, l_y, c_x, c_y, I, G, n_history):  # noqa: E741
    """Put the contacts between spheres, slots[first:first + n], into the first places; c = 1/l, 0 if not periodic."""
    for q in range(n):
        k = np.uint64(slots[first + q])
        i, j = np.uint64(own[k]), np.uint64(partner[k])  # unsigned: no question whether an index counts from the end
        r_i, r_j = S[i, S_R], S[j, S_R]
        d_x, d_y = S[i, S_X] - S[j, S_X], S[i, S_X + 1] - S[j, S_X + 1]
        G[q + G_N * TILE] = image(d_x, l_x, c_x)
        G[q + (G_N + 1) * TILE] = image(d_y, l_y, c_y)
        G[q + (G_N + 2) * TILE] = S[i, S_Z] - S[j, S_Z]
        u_x, u_y, u_z = S[i, S_U] - S[j, S_U], S[i, S_U + 1] - S[j, S_U + 1], S[i, S_U + 2] - S[j, S_U + 2]
        v_x, v_y, v_z = S[i, S_V] - S[j, S_V], S[i, S_V + 1] - S[j, S_V + 1], S[i, S_V + 2] - S[j, S_V + 2]
        a_x, a_y, a_z, b_x, b_y, b_z = S[i, S_W], S[i, S_W + 1], S[i, S_W + 2], S[j, S_W], S[j, S_W + 1], S[j, S_W + 2]
        e_x, e_y, e_z, f_x, f_y, f_z = S[i, S_O], S[i, S_O + 1], S[i, S_O + 2], S[j, S_O], S[j, S_O + 1], S[j, S_O + 2]
        set3(q + G_U * TILE, u_x, u_y, u_z, G)
        set3(q + G_W * TILE, a_x + b_x, a_y + b_y, a_z + b_z, G)
        set3(q + G_RW * TILE, r_i * a_x + r_j * b_x, r_i * a_y + r_j * b_y, r_i * a_z + r_j * b_z, G)
        set3(q + G_V * TILE, v_x, v_y, v_z, G)
        set3(q + G_O * TILE, e_x + f_x, e_y + f_y, e_z + f_z, G)
        set3(q + G_RO * TILE, r_i * e_x + r_j * f_x, r_i * e_y + r_j * f_y, r_i * e_z + r_j * f_z, G)
        G[q + G_RI * TILE], G[q + G_RJ * TILE] = r_i, r_j
        I[q + I_MASS * TILE], G[q + G_MJ * TILE] = S[i, S_MASS], S[j, S_MASS]
        remember(q, k, kind, H, I, G, n_history)


@njit(**BARE_CHUNK)
def meet(n, dt, I, G):  # noqa: E741
    """Normals, overlaps, arms, effective radii and masses of n contacts between spheres.

    Slip is a displacement of the step, so its arms are those of the middle of the step: hence the normal of half a step ago.
    """
    half = 0.5 * dt
    for q in range(n):
        x, y, z = G[q + G_N * TILE], G[q + (G_N + 1) * TILE], G[q + (G_N + 2) * TILE]
        r_i, r_j = G[q + G_RI * TILE], G[q + G_RJ * TILE]
        m_i, m_j = I[q + I_MASS * TILE], G[q + G_MJ * TILE]
        distance = math.sqrt(x * x + y * y + z * z)
        inverse = 1.0 / max(distance, 1e-300)
        reach = r_i + r_j
        overlap = reach - distance
        p_x, p_y, p_z = x - half * G[q + G_U * TILE], y - half * G[q + (G_U + 1) * TILE], z - half * G[q + (G_U + 2) * TILE]
        back = 1.0 / max(math.sqrt(p_x * p_x + p_y * p_y + p_z * p_z), 1e-300)
        G[q + G_N * TILE], G[q + (G_N + 1) * TILE], G[q + (G_N + 2) * TILE] = x * inverse, y * inverse, z * inverse
        G[q + G_P * TILE], G[q + (G_P + 1) * TILE], G[q + (G_P + 2) * TILE] = p_x * back, p_y * back, p_z * back
        G[q + G_ARM_I * TILE], G[q + G_ARM_J * TILE] = r_i - 0.5 * overlap, r_j - 0.5 * overlap
        I[q + I_OVERLAP * TILE] = overlap
        I[q + I_RADIUS * TILE] = r_i * r_j / reach
        I[q + I_MASS * TILE] = m_i * m_j / (m_i + m_j)


@njit(**BARE_CHUNK)
def turn_frames(n, dt, G):
    """Carry the frames of n contacts with their normals, turned by half the sum of the spins; made anew at first touch."""
    half = 0.5 * dt
    for q in range(n):
        n_x, n_y, n_z = G[q + G_N * TILE], G[q + (G_N + 1) * TILE], G[q + (G_N + 2) * TILE]
        p_x, p_y, p_z = G[q + G_P * TILE], G[q + (G_P + 1) * TILE], G[q + (G_P + 2) * TILE]
        e_x, e_y, e_z = G[q + G_E * TILE], G[q + (G_E + 1) * TILE], G[q + (G_E + 2) * TILE]
        twist = half * (G[q + G_W * TILE] * p_x + G[q + (G_W + 1) * TILE] * p_y + G[q + (G_W + 2) * TILE] * p_z)
        e_x, e_y, e_z = (
            e_x + twist * (p_y * e_z - p_z * e_y), e_y + twist * (p_z * e_x - p_x * e_z), e_z + twist * (p_x * e_y - p_y * e_x),
        )  # fmt: skip
        # at first touch any direction that is never parallel to the normal; the law cannot tell which
        new = G[q + G_ON * TILE] == 0.0
        steep = abs(n_z) > 0.5
        e_x = (1.0 if steep else 0.0) if new else e_x
        e_y = 0.0 if new else e_y
        e_z = (0.0 if steep else 1.0) if new else e_z
        # along the bisector of old and new normal: a projection along the new one alone would turn the frame by O(step)
        along = (e_x * n_x + e_y * n_y + e_z * n_z) / (p_x * n_x + p_y * n_y + p_z * n_z)
        e_x, e_y, e_z = e_x - along * p_x, e_y - along * p_y, e_z - along * p_z
        scale = 1.0 / math.sqrt(e_x * e_x + e_y * e_y + e_z * e_z)
        e_x, e_y, e_z = e_x * scale, e_y * scale, e_z * scale
        G[q + G_E * TILE], G[q + (G_E + 1) * TILE], G[q + (G_E + 2) * TILE] = e_x, e_y, e_z
        G[q + G_D * TILE], G[q + (G_D + 1) * TILE] = n_y * e_z - n_z * e_y, n_z * e_x - n_x * e_z
        G[q + (G_D + 2) * TILE] = n_x * e_y - n_y * e_x


@njit(**BARE)
def drawn(q, at, normal, I, G):  # noqa: E741
    """Relative velocity of the two surfaces, from fields `at` behind those of the step and the normal in field `normal`."""
    half = 0.5 * I[q + I_OVERLAP * TILE]
    x, y, z = G[q + normal * TILE], G[q + (normal + 1) * TILE], G[q + (normal + 2) * TILE]
    v, w, rw = q + at + G_U * TILE, q + at + G_W * TILE, q + at + G_RW * TILE
    o_x, o_y, o_z = G[rw] - half * G[w], G[rw + TILE] - half * G[w + TILE], G[rw + 2 * TILE] - half * G[w + 2 * TILE]
    return (
        G[v] - (o_y * z - o_z * y), G[v + TILE] - (o_z * x - o_x * z), G[v + 2 * TILE] - (o_x * y - o_y * x),
    )  # fmt: skip


@njit(**BARE_CHUNK)
def slide(n, dt, I, G):  # noqa: E741
    """Slip of the step and velocities at its end of n contacts, along their normals and the axes of their frames."""
    for q in range(n):
        e_x, e_y, e_z = G[q + G_E * TILE], G[q + (G_E + 1) * TILE], G[q + (G_E + 2) * TILE]
        d_x, d_y, d_z = G[q + G_D * TILE], G[q + (G_D + 1) * TILE], G[q + (G_D + 2) * TILE]
        x, y, z = drawn(q, np.int64(0), np.int64(G_P), I, G)
        I[q + I_SX * TILE] = (x * e_x + y * e_y + z * e_z) * dt
        I[q + I_SY * TILE] = (x * d_x + y * d_y + z * d_z) * dt
        x, y, z = drawn(q, np.int64(AT_END), np.int64(G_N), I, G)
        I[q + I_VN * TILE] = x * G[q + G_N * TILE] + y * G[q + (G_N + 1) * TILE] + z * G[q + (G_N + 2) * TILE]
        I[q + I_VX * TILE] = x * e_x + y * e_y + z * e_z
        I[q + I_VY * TILE] = x * d_x + y * d_y + z * d_z


@njit(**BARE_CHUNK)
def push(n, O, G):  # noqa: E741
    """Forces of n contacts in world axes, and the normal times their tangential parts."""
    for q in range(n):
        f_n, t_1, t_2 = O[q + O_FN * TILE], O[q + O_TX * TILE], O[q + O_TY * TILE]
        n_x, n_y, n_z = G[q + G_N * TILE], G[q + (G_N + 1) * TILE], G[q + (G_N + 2) * TILE]
        e_x, e_y, e_z = G[q + G_E * TILE], G[q + (G_E + 1) * TILE], G[q + (G_E + 2) * TILE]
        d_x, d_y, d_z = G[q + G_D * TILE], G[q + (G_D + 1) * TILE], G[q + (G_D + 2) * TILE]
        G[q + G_F * TILE] = f_n * n_x + t_1 * e_x + t_2 * d_x
        G[q + (G_F + 1) * TILE] = f_n * n_y + t_1 * e_y + t_2 * d_y
        G[q + (G_F + 2) * TILE] = f_n * n_z + t_1 * e_z + t_2 * d_z
        G[q + G_Q * TILE] = t_1 * d_x - t_2 * e_x
        G[q + (G_Q + 1) * TILE] = t_1 * d_y - t_2 * e_y
        G[q + (G_Q + 2) * TILE] = t_1 * d_z - t_2 * e_z
