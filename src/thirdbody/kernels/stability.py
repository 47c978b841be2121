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
    S_MASS,
    S_R,
    S_V,
    TILE,
)  # fmt: skip
from .options import BARE, BARE_CHUNK, DIRECT, NO_COUNTS
from .rotation import matrix
from .signatures import LAW


@njit(**BARE_CHUNK)
def add_contact(K, C, b, B, r, n, k_n, k_t, c_n, c_t, J):
    """Add J^T (k_t 1 + (k_n - k_t) n n^T) J to body b's stiffness, in body axes and mass-normalised, J = (1, -[r]x), and the
    same of the dashpots to its damping: their lower triangles. J (3, 6): scratch, zero where J is."""
    a, b_, c, d, e, f, g, h, i = matrix(B[b, B_Q], B[b, B_Q + 1], B[b, B_Q + 2], B[b, B_Q + 3])
    x, y, z = a * r[0] + d * r[1] + g * r[2], b_ * r[0] + e * r[1] + h * r[2], c * r[0] + f * r[1] + i * r[2]
    m = (a * n[0] + d * n[1] + g * n[2], b_ * n[0] + e * n[1] + h * n[2], c * n[0] + f * n[1] + i * n[2])
    root = 1.0 / math.sqrt(B[b, B_MASS])
    i_x, i_y, i_z = 1.0 / math.sqrt(B[b, B_I]), 1.0 / math.sqrt(B[b, B_I + 1]), 1.0 / math.sqrt(B[b, B_I + 2])
    J[0, 0], J[1, 1], J[2, 2] = root, root, root
    J[0, 4], J[0, 5] = z * i_y, -y * i_z
    J[1, 3], J[1, 5] = -z * i_x, x * i_z
    J[2, 3], J[2, 4] = y * i_x, -x * i_y
    d_k, d_c = k_n - k_t, c_n - c_t
    for p in range(6):
        along_p = m[0] * J[0, p] + m[1] * J[1, p] + m[2] * J[2, p]
        for q in range(p + 1):
            along = along_p * (m[0] * J[0, q] + m[1] * J[1, q] + m[2] * J[2, q])
            dot = J[0, p] * J[0, q] + J[1, p] * J[1, q] + J[2, p] * J[2, q]
            K[b, p, q] += k_t * dot + d_k * along
            C[b, p, q] += c_t * dot + d_c * along


@njit(**BARE_CHUNK)
def add_rolling(K, C, b, B, n, k_r, c_r):
    """Add k_r (1 - n n^T), which resists all rotation but that about n, to body b's stiffness, and c_r to its damping: their
    lower triangles."""
    a, b_, c, d, e, f, g, h, i = matrix(B[b, B_Q], B[b, B_Q + 1], B[b, B_Q + 2], B[b, B_Q + 3])
    m = (a * n[0] + d * n[1] + g * n[2], b_ * n[0] + e * n[1] + h * n[2], c * n[0] + f * n[1] + i * n[2])
    for p in range(3):
        for q in range(p + 1):
            same = 1.0 if p == q else 0.0
            share = (same - m[p] * m[q]) / math.sqrt(B[b, B_I + p] * B[b, B_I + q])
            K[b, 3 + p, 3 + q] += k_r * share
            C[b, 3 + p, 3 + q] += c_r * share


@njit(**BARE_CHUNK)
def largest_eigenvalue(K, a, square):
    """An upper bound of the largest eigenvalue of a positive semidefinite 6x6 matrix, at most 12 % high: tr(K^16)^(1/16).

    K: its lower triangle; a, square (6, 6): scratch.
    """
    scale = 0.0
    for p in range(6):
        scale += K[p, p]
    if scale <= 0.0:
        return 0.0
    for p in range(6):
        for q in range(6):
            a[p, q] = K[max(p, q), min(p, q)] / scale
    for _ in range(4):
        for p in range(6):
            for q in range(6):
                total = 0.0
                for r in range(6):
                    total += a[p, r] * a[r, q]
                square[p, q] = total
        a, square = square, a
    trace = 0.0
    for p in range(6):
        trace += a[p, p]
    return scale * trace ** (1.0 / 16.0)


_F3, _F2, _F1 = (types.Array(types.float64, n, "C") for n in (3, 2, 1))
_I1, _S1 = types.Array(types.int64, 1, "C"), types.Array(types.int32, 1, "C")
STIFFNESS = types.void(
    types.int64, _S1, _S1, _S1, _I1, _F2, _F2, _F2, _F1, types.float64, types.float64, types.float64,
    types.float64, types.FunctionType(LAW), _F2, _F2, _F3, _F3, _F1, _F1, _F2, _F2
)  # fmt: skip


@njit(**BARE)
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


@njit(**BARE_CHUNK)
def norm(K):
    """Frobenius norm of a symmetric matrix from its lower triangle: no bound of `largest_eigenvalue` exceeds it."""
    total = 0.0
    for p in range(6):
        for q in range(p):
            total += 2.0 * K[p, q] * K[p, q]
        total += K[p, p] * K[p, p]
    return math.sqrt(total)


@njit(**BARE)
def longest_step(square, rate):
    """Longest stable step of an oscillator (`engine.timestep.stable_step`), s."""
    return 2.0 / max(rate + math.sqrt(rate * rate + square), 1e-300)


@njit(**BARE_CHUNK)
def judge(b, K, C, square, other, bodies, shortest):
    """Squared frequencies and damping rate of body b, if it can shorten the `shortest` steps, by frequency and by both."""
    by_frequency, by_both = shortest
    most, worst = norm(K[b]), norm(C[b])
    if longest_step(most, 0.0) >= by_frequency and longest_step(most, worst) >= by_both:
        return shortest
    every, rate = largest_eigenvalue(K[b], square, other), largest_eigenvalue(C[b], square, other)
    bodies[b, 0], bodies[b, 3] = every, rate
    bodies[b, 1] = K[b, 0, 0] + K[b, 1, 1] + K[b, 2, 2]
    bodies[b, 2] = K[b, 3, 3] + K[b, 4, 4] + K[b, 5, 5]
    return min(by_frequency, longest_step(every, 0.0)), min(by_both, longest_step(every, rate))


@njit(**BARE_CHUNK)
def stiffest(K):
    """The body with the largest stiffness by its norm."""
    found, most = np.int64(0), 0.0
    for b in range(K.shape[0]):
        here = norm(K[b])
        if here > most:
            found, most = np.int64(b), here
    return found


@njit(**BARE_CHUNK)
def add_tile(m, lanes, own, partner, body, S, B, P, answer, patches, K, C, J):
    """Add a tile of m contacts, whose slots and normals stand in `lanes`, to the matrices of their bodies and to the patches."""
    for t in range(m):
        i, j = own[int(lanes[t, 0])], partner[int(lanes[t, 0])]
        n_x, n_y, n_z = lanes[t, 1], lanes[t, 2], lanes[t, 3]
        k_n, k_t, k_r = answer[t], answer[t + TILE], answer[t + 2 * TILE]
        c_n, c_t, c_r = answer[t + 3 * TILE], answer[t + 4 * TILE], answer[t + 5 * TILE]
        twice = 1.0
        if j < -1 and P[-j - 2, P_FREE] != 0.0:
            twice = 2.0
            patches[-j - 2, 0] += 2.0 * k_n / P[-j - 2, P_MASS]
            patches[-j - 2, 1] += 2.0 * c_n / P[-j - 2, P_MASS]
        n = (n_x, n_y, n_z)
        if j >= 0:
            twice = 2.0
            r = (S[j, S_ARM] + S[j, S_R] * n_x, S[j, S_ARM + 1] + S[j, S_R] * n_y, S[j, S_ARM + 2] + S[j, S_R] * n_z)
            add_contact(K, C, body[j], B, r, n, 2.0 * k_n, 2.0 * k_t, 2.0 * c_n, 2.0 * c_t, J)
            if k_r > 0.0 or c_r > 0.0:
                add_rolling(K, C, body[j], B, n, 2.0 * k_r, 2.0 * c_r)
        r = (S[i, S_ARM] - S[i, S_R] * n_x, S[i, S_ARM + 1] - S[i, S_R] * n_y, S[i, S_ARM + 2] - S[i, S_R] * n_z)
        add_contact(K, C, body[i], B, r, n, twice * k_n, twice * k_t, twice * c_n, twice * c_t, J)
        if k_r > 0.0 or c_r > 0.0:
            add_rolling(K, C, body[i], B, n, twice * k_r, twice * c_r)


@njit(STIFFNESS, **DIRECT, **NO_COUNTS)
def frequencies(n, own, partner, kind, body, S, B, P, pairs, l_x, l_y, horizon, limit, stiffness, bodies, patches, K, C,
                told, answer, scratch, lanes):  # fmt: skip
    """Squared natural frequencies, 1/s^2, and damping rates, 1/s, all bounds from above.

    `bodies` (n, 4): frequencies of all motion, of translation only, of rotation only; damping rate; zeros for a body that cannot
    have the shortest step, which mostly its norm tells. `patches` (n, 2).
    Contacts are taken as deep as they can get within the `horizon` (s), but no new depth beyond `limit` times the radius.
    A contact between two bodies that both move counts twice in each (|J1 x1 - J2 x2|^2 <= 2 |J1 x1|^2 + 2 |J2 x2|^2).
    Room, zero at first: `matrices`. numpy makes it for nothing; each `zeros` in here would be compiled for 0.1 s.
    """
    J, square, other = scratch[:3], scratch[3:9], scratch[9:]
    plate, m = P.shape[0] - 1, np.int64(0)
    for k in range(n):
        overlap, n_x, n_y, n_z = separation(k, own, partner, S, P, l_x, l_y)
        i, j = own[k], partner[k]
        overlap = max(overlap, min(overlap + approach(i, j, body, S, B, P, n_x, n_y, n_z, horizon), limit * S[i, S_R]))
        if overlap > 0.0:
            radius, mass = S[i, S_R], S[i, S_MASS]
            if j >= 0:
                radius, mass = radius * S[j, S_R] / (radius + S[j, S_R]), mass * S[j, S_MASS] / (mass + S[j, S_MASS])
            told[m + I_OVERLAP * TILE], told[m + I_RADIUS * TILE], told[m + I_MASS * TILE] = overlap, radius, mass
            told[m + I_TYPE * TILE], told[m + I_VN * TILE] = kind[k], -1.0
            lanes[m, 0], lanes[m, 1], lanes[m, 2], lanes[m, 3] = k, n_x, n_y, n_z
            m += 1
        if m == TILE or (k == n - 1 and m > 0):
            stiffness(told, answer, m, pairs)
            add_tile(m, lanes, own, partner, body, S, B, P, answer, patches, K, C, J)
            m = np.int64(0)
    for p in range(plate):
        patches[p, 0] += 2.0 * P[p, P_SPRING] / P[p, P_MASS]
        patches[plate, 0] += 2.0 * P[p, P_SPRING] / P[plate, P_MASS] * P[plate, P_FREE]
    shortest = judge(stiffest(K), K, C, square, other, bodies, (np.inf, np.inf))
    for b in range(B.shape[0]):
        shortest = judge(b, K, C, square, other, bodies, shortest)


def matrices(n_bodies):
    """Room for `frequencies`, zero: stiffness and damping of every body (n, 6, 6), a tile in and out, scratch (15, 6), and a row
    for each contact of a tile."""
    room = np.zeros((n_bodies, 6, 6)), np.zeros((n_bodies, 6, 6))
    return *room, np.zeros((I_HISTORY + 1) * TILE), np.zeros(6 * TILE), np.zeros((15, 6)), np.zeros((TILE, 4))
