"""Bounds of the explicit time step: the largest natural frequency and the largest damping rate of every body and patch, with
the contacts as they will be when the bound is asked for next."""

import math

import numpy as np
from numba import njit, types

from .contacts import separation
from .layout import (
    B_F,
    B_I,
    B_MASS,
    B_Q,
    I_HISTORY,
    I_MASS,
    I_OVERLAP,
    I_RADIUS,
    I_TYPE,
    I_VN,
    P_F,
    P_FREE,
    P_LOAD,
    P_MASS,
    P_SPRING,
    P_V,
    S_ARM,
    S_R,
    S_V,
    TILE,
)  # fmt: skip
from .options import INNER, OPTIONS
from .rotation import matrix
from .signatures import LAW


@njit(**INNER)
def add_contact(K, C, b, B, r, n, k_n, k_t, c_n, c_t):
    """Add J^T (k_t 1 + (k_n - k_t) n n^T) J to body b's stiffness, in body axes and mass-normalised, J = (1, -[r]x), and the
    same of the dashpots to its damping."""
    a, b_, c, d, e, f, g, h, i = matrix(B[b, B_Q], B[b, B_Q + 1], B[b, B_Q + 2], B[b, B_Q + 3])
    x, y, z = a * r[0] + d * r[1] + g * r[2], b_ * r[0] + e * r[1] + h * r[2], c * r[0] + f * r[1] + i * r[2]
    m = (a * n[0] + d * n[1] + g * n[2], b_ * n[0] + e * n[1] + h * n[2], c * n[0] + f * n[1] + i * n[2])
    root = 1.0 / math.sqrt(B[b, B_MASS])
    i_x, i_y, i_z = 1.0 / math.sqrt(B[b, B_I]), 1.0 / math.sqrt(B[b, B_I + 1]), 1.0 / math.sqrt(B[b, B_I + 2])
    J = np.zeros((3, 6))
    J[0, 0], J[1, 1], J[2, 2] = root, root, root
    J[0, 4], J[0, 5] = z * i_y, -y * i_z
    J[1, 3], J[1, 5] = -z * i_x, x * i_z
    J[2, 3], J[2, 4] = y * i_x, -x * i_y
    for p in range(6):
        along_p = m[0] * J[0, p] + m[1] * J[1, p] + m[2] * J[2, p]
        for q in range(6):
            along_q = m[0] * J[0, q] + m[1] * J[1, q] + m[2] * J[2, q]
            dot = J[0, p] * J[0, q] + J[1, p] * J[1, q] + J[2, p] * J[2, q]
            K[b, p, q] += k_t * dot + (k_n - k_t) * along_p * along_q
            C[b, p, q] += c_t * dot + (c_n - c_t) * along_p * along_q


@njit(**INNER)
def add_rolling(K, C, b, B, n, k_r, c_r):
    """Add k_r (1 - n n^T), which resists all rotation but that about n, to body b's stiffness, and c_r to its damping."""
    a, b_, c, d, e, f, g, h, i = matrix(B[b, B_Q], B[b, B_Q + 1], B[b, B_Q + 2], B[b, B_Q + 3])
    m = (a * n[0] + d * n[1] + g * n[2], b_ * n[0] + e * n[1] + h * n[2], c * n[0] + f * n[1] + i * n[2])
    for p in range(3):
        for q in range(3):
            same = 1.0 if p == q else 0.0
            share = (same - m[p] * m[q]) / math.sqrt(B[b, B_I + p] * B[b, B_I + q])
            K[b, 3 + p, 3 + q] += k_r * share
            C[b, 3 + p, 3 + q] += c_r * share


@njit(**INNER)
def largest_eigenvalue(K):
    """An upper bound of the largest eigenvalue of a positive semidefinite 6x6 matrix, at most 12 % high: tr(K^16)^(1/16)."""
    scale = 0.0
    for p in range(6):
        scale += K[p, p]
    if scale <= 0.0:
        return 0.0
    a = np.empty((6, 6))
    for p in range(6):
        for q in range(6):
            a[p, q] = K[p, q] / scale
    for _ in range(4):
        square = np.zeros((6, 6))
        for p in range(6):
            for q in range(6):
                for r in range(6):
                    square[p, q] += a[p, r] * a[r, q]
        a = square
    trace = 0.0
    for p in range(6):
        trace += a[p, p]
    return scale * trace ** (1.0 / 16.0)


_F2, _F1 = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C")
_I1 = types.Array(types.int64, 1, "C")
STIFFNESS = types.void(
    types.int64, _I1, _I1, _I1, _I1, _F2, _F2, _F2, _F1, types.float64, types.float64, types.float64,
    types.float64, types.FunctionType(LAW), _F2, _F2
)


@njit(**INNER)
def approach(i, j, body, S, B, P, n_x, n_y, n_z, horizon):
    """How much deeper a contact can get within the horizon (s), from its speed and the forces of now; never negative."""
    b = body[i]
    v = S[i, S_V] * n_x + S[i, S_V + 1] * n_y + S[i, S_V + 2] * n_z
    a = (B[b, B_F] * n_x + B[b, B_F + 1] * n_y + B[b, B_F + 2] * n_z) / B[b, B_MASS]
    if j >= 0:
        b = body[j]
        v -= S[j, S_V] * n_x + S[j, S_V + 1] * n_y + S[j, S_V + 2] * n_z
        a -= (B[b, B_F] * n_x + B[b, B_F + 1] * n_y + B[b, B_F + 2] * n_z) / B[b, B_MASS]
    elif j < -1:
        p = -j - 2
        v -= P[p, P_V] * n_z
        a -= P[p, P_FREE] * (P[p, P_F] - P[p, P_LOAD]) / P[p, P_MASS] * n_z
    # a contact that is being stopped is deepest when it stands still
    t = min(horizon, -v / a) if a > 0.0 and v < 0.0 else horizon
    return max(-v * t - 0.5 * a * t * t, 0.0)


@njit(STIFFNESS, **OPTIONS)
def frequencies(n, own, partner, kind, body, S, B, P, pairs, l_x, l_y, horizon, limit, stiffness, bodies, patches):
    """Squared natural frequencies, 1/s^2, and damping rates, 1/s, all bounds from above.

    `bodies` (n, 4): frequencies of all motion, of translation only, of rotation only; damping rate. `patches` (n, 2).
    Contacts are taken as deep as they can get within the `horizon` (s), but no new depth beyond `limit` times the radius.
    A contact between two bodies that both move counts twice in each (|J1 x1 - J2 x2|^2 <= 2 |J1 x1|^2 + 2 |J2 x2|^2).
    """
    I, O = np.empty((I_HISTORY + 1) * TILE), np.zeros(6 * TILE)  # noqa: E741
    K, C = np.zeros((B.shape[0], 6, 6)), np.zeros((B.shape[0], 6, 6))
    plate = P.shape[0] - 1
    for p in range(plate + 1):
        # a patch's own dashpot is integrated implicitly: it bounds nothing
        patches[p, 0], patches[p, 1] = 0.0, 0.0
    for k in range(n):
        overlap, n_x, n_y, n_z = separation(k, own, partner, S, P, l_x, l_y)
        i, j = own[k], partner[k]
        overlap = max(overlap, min(overlap + approach(i, j, body, S, B, P, n_x, n_y, n_z, horizon), limit * S[i, S_R]))
        if overlap <= 0.0:
            continue
        radius, mass = S[i, S_R], B[body[i], B_MASS]
        if j >= 0:
            other = B[body[j], B_MASS]
            radius, mass = S[i, S_R] * S[j, S_R] / (S[i, S_R] + S[j, S_R]), mass * other / (mass + other)
        for f in range(I_HISTORY):
            I[f * TILE] = 0.0
        I[I_OVERLAP * TILE], I[I_RADIUS * TILE], I[I_MASS * TILE], I[I_TYPE * TILE] = overlap, radius, mass, kind[k]
        I[I_VN * TILE] = -1.0
        stiffness(I, O, 1, pairs)
        k_n, k_t, k_r = O[0], O[TILE], O[2 * TILE]
        c_n, c_t, c_r = O[3 * TILE], O[4 * TILE], O[5 * TILE]
        twice = 1.0
        if j < -1 and P[-j - 2, P_FREE] != 0.0:
            twice = 2.0
            patches[-j - 2, 0] += 2.0 * k_n / P[-j - 2, P_MASS]
            patches[-j - 2, 1] += 2.0 * c_n / P[-j - 2, P_MASS]
        n_ = (n_x, n_y, n_z)
        if j >= 0:
            twice = 2.0
            r = (S[j, S_ARM] + S[j, S_R] * n_x, S[j, S_ARM + 1] + S[j, S_R] * n_y, S[j, S_ARM + 2] + S[j, S_R] * n_z)
            add_contact(K, C, body[j], B, r, n_, 2.0 * k_n, 2.0 * k_t, 2.0 * c_n, 2.0 * c_t)
            if k_r > 0.0 or c_r > 0.0:
                add_rolling(K, C, body[j], B, n_, 2.0 * k_r, 2.0 * c_r)
        r = (S[i, S_ARM] - S[i, S_R] * n_x, S[i, S_ARM + 1] - S[i, S_R] * n_y, S[i, S_ARM + 2] - S[i, S_R] * n_z)
        add_contact(K, C, body[i], B, r, n_, twice * k_n, twice * k_t, twice * c_n, twice * c_t)
        if k_r > 0.0 or c_r > 0.0:
            add_rolling(K, C, body[i], B, n_, twice * k_r, twice * c_r)
    for p in range(plate):
        patches[p, 0] += 2.0 * P[p, P_SPRING] / P[p, P_MASS]
        patches[plate, 0] += 2.0 * P[p, P_SPRING] / P[plate, P_MASS] * P[plate, P_FREE]
    for b in range(B.shape[0]):
        bodies[b, 0] = largest_eigenvalue(K[b])
        bodies[b, 1] = K[b, 0, 0] + K[b, 1, 1] + K[b, 2, 2]
        bodies[b, 2] = K[b, 3, 3] + K[b, 4, 4] + K[b, 5, 5]
        bodies[b, 3] = largest_eigenvalue(C[b])
