"""One body between the first bodies at the end of a trial step of an implicit method: its forces, and how they change.

The coordinates y of a step are the displacement of the centre of mass (3, m), the rotation vector of the step times the arm of
the body (3, m, world axes), and the rise of the body's patch of the upper plate (m). `place` moves body, spheres and patch to
the end of the step, `balance` asks the laws there and gives what is unbalanced (7, N), `linearise` how that changes with y
(7, 7, N/m). Nothing is remembered until `accept`. All contact geometry, slip and history is that of the explicit integrator
(`contacts`), so both see the same laws in the same way; here a spot that closes within the step slips for the rest of it only.
"""

import math

import numpy as np
from numba import njit

from .bodies import place_spheres
from .contacts import apply, record, release, separation, stage
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
    F_F,
    F_SLIP,
    F_WORK,
    I_HISTORY,
    I_OVERLAP,
    I_SX,
    I_SY,
    J_INVERSE,
    J_TRAVEL,
    K_NORMAL,
    K_ROLL,
    K_XD,
    K_XX,
    K_XY,
    K_YD,
    K_YX,
    K_YY,
    O_A,
    O_FN,
    O_HISTORY,
    O_POWER,
    O_TX,
    O_TY,
    P_DAMPING,
    P_FREE,
    P_LOAD,
    P_MASS,
    P_SPRING,
    P_V,
    P_Z,
    Q_X,
    Q_Y,
    S_ARM,
    S_R,
    T_DL,
    T_DRISE,
    T_DV,
    T_Y,
    TILE,
)  # fmt: skip
from .options import CHUNK, INNER
from .rolling import MOMENTS, apply_rolling, record_rolling, stage_rolling
from .rotation import matrix, normalised

FREEDOMS = 7
"""Coordinates of a body and its patch."""

# Z: the state of a body and its patch at the start of a step
Z_X, Z_V, Z_Q, Z_L, Z_W, Z_PATCH, Z_RISE, Z_ARM, Z_PLATE = 0, 3, 6, 10, 13, 16, 17, 18, 19
Z_NOW, Z_BEFORE = 20, 21  # the formula of the step: rate of change = (NOW change - BEFORE last change)/dt
Z_COLS = 22

# what `balance` tells beside the unbalanced forces
E_NORMAL, E_DEEPEST, E_RADIUS, E_RATIO, E_SLOT, E_POWER = range(6)
E_COLS = 6


@njit(**CHUNK)
def begin(b, p, B, P, Z, start, offsets, S):
    """Note where a step of body b begins."""
    for k in range(3):
        Z[Z_X + k], Z[Z_V + k] = B[b, B_X + k], B[b, B_V + k]
        Z[Z_L + k], Z[Z_W + k] = B[b, B_L + k], B[b, B_W + k]
    for k in range(4):
        Z[Z_Q + k] = B[b, B_Q + k]
    Z[Z_PATCH], Z[Z_RISE] = P[p, P_Z], P[p, P_V]
    far = 0.0
    for s in range(start[b], start[b + 1]):
        square = offsets[s, 0] ** 2 + offsets[s, 1] ** 2 + offsets[s, 2] ** 2
        far = max(far, math.sqrt(square) + S[s, S_R])
    Z[Z_ARM] = far


@njit(**INNER)
def turned_by(q, x, y, z):
    """q after a turn by the rotation vector (x, y, z), world axes, exactly."""
    size = math.sqrt(x * x + y * y + z * z)
    # sin(size/2)/size, which loses nothing at zero
    s = 0.5 * (1.0 - size * size / 24.0) if size < 1e-4 else math.sin(0.5 * size) / size
    w, a, b, c = math.cos(0.5 * size), s * x, s * y, s * z
    return normalised(
        (w * q[0] - a * q[1] - b * q[2] - c * q[3], w * q[1] + a * q[0] + b * q[3] - c * q[2],
         w * q[2] + b * q[0] + c * q[1] - a * q[3], w * q[3] + c * q[0] + a * q[2] - b * q[1])
    )  # fmt: skip


@njit(**INNER)
def place(b, p, y, dt, Z, T, start, offsets, S, X0, B, P):
    """Move body b, its spheres and its patch p to the end of the step: mean velocities of the step, then those at its end."""
    inverse, arm = 1.0 / dt, 1.0 / Z[Z_ARM]
    now, last = Z[Z_NOW] * inverse, Z[Z_BEFORE] * inverse
    for k in range(3):
        B[b, B_X + k] = Z[Z_X + k] + y[k]
        B[b, B_V + k] = y[k] * inverse
    q = turned_by((Z[Z_Q], Z[Z_Q + 1], Z[Z_Q + 2], Z[Z_Q + 3]), y[3] * arm, y[4] * arm, y[5] * arm)
    for k in range(4):
        B[b, B_Q + k] = q[k]
    w = (y[3] * arm * inverse, y[4] * arm * inverse, y[5] * arm * inverse)
    w_end = ((now * y[3] - last * T[T_Y + 3]) * arm, (now * y[4] - last * T[T_Y + 4]) * arm, (now * y[5] - last * T[T_Y + 5]) * arm)
    v_end = (now * y[0] - last * T[T_Y], now * y[1] - last * T[T_Y + 1], now * y[2] - last * T[T_Y + 2])
    place_spheres(b, start, offsets, S, X0, B, w, w_end, v_end, q, dt, 0.0)
    for k in range(3):
        B[b, B_V + k], B[b, B_W + k] = v_end[k], w_end[k]
    P[p, P_Z], P[p, P_V] = Z[Z_PATCH] + y[6], now * y[6] - last * T[T_Y + 6]


@njit(**INNER)
def inertia_of(b, B):
    """Moments of inertia about world axes: xx, yy, zz, xy, xz, yz."""
    a, b_, c, d, e, f, g, h, i = matrix(B[b, B_Q], B[b, B_Q + 1], B[b, B_Q + 2], B[b, B_Q + 3])
    i_x, i_y, i_z = B[b, B_I], B[b, B_I + 1], B[b, B_I + 2]
    return (
        a * a * i_x + b_ * b_ * i_y + c * c * i_z, d * d * i_x + e * e * i_y + f * f * i_z, g * g * i_x + h * h * i_y + i * i * i_z,
        a * d * i_x + b_ * e * i_y + c * f * i_z, a * g * i_x + b_ * h * i_y + c * i * i_z, d * g * i_x + e * h * i_y + f * i * i_z,
    )  # fmt: skip


@njit(**INNER)
def momentum_of(b, B):
    """Angular momentum, world axes, from spin and orientation."""
    xx, yy, zz, xy, xz, yz = inertia_of(b, B)
    x, y, z = B[b, B_W], B[b, B_W + 1], B[b, B_W + 2]
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z


@njit(**INNER)
def loaded_spots(b, dt, rate, before, edges, incidence, own, partner, kind, S, B, P, body, H, v_x, v_y, I, G, slots, n_history,
                 rolling):  # noqa: E741  # fmt: skip
    """Stage the loaded spots of body b in the law's tile; returns how many, or -1 if they are more than the tile holds."""
    m = np.int64(0)
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        overlap, n_x, n_y, n_z = separation(k, own, partner, S, P, 0.0, 0.0)
        if overlap <= 0.0:
            continue
        if m == TILE:
            return np.int64(-1)
        stage(m, k, overlap, n_x, n_y, n_z, own, partner, kind, S, B, P, body, H, dt, v_x, v_y, I, G, n_history)
        slots[m] = k
        at = (I_HISTORY + n_history) * TILE + m
        if rolling > 0:
            stage_rolling(m, k, own, partner, S, P, dt, v_x, v_y, I, G, n_history)
        I[at + J_INVERSE * TILE] = rate
        gap = before[e - edges[b]]
        if gap < 0.0:
            share = overlap / (overlap - gap)
            I[I_SX * TILE + m] *= share
            I[I_SY * TILE + m] *= share
            if rolling > 0:
                I[at + J_TRAVEL * TILE] *= share
        m += 1
    return m


@njit(**INNER)
def balance(b, p, m, dt, own, partner, S, B, P, I, O, G, slots, Z, T, law, pairs, n_history, rolling, effects, parameters,
            has_effects, time, inertial, r, told):  # noqa: E741  # fmt: skip
    """Unbalanced forces r (7) of body b and its patch, with m staged spots; `told` gets what else a step wants to know (E_*)."""
    law(I, O, m, pairs)
    for k in range(FREEDOMS):
        r[k] = 0.0
    normal, deepest, radius, ratio, slot, power = 0.0, 0.0, 0.0, 0.0, -1.0, 0.0
    for q in range(m):
        i, up = own[slots[q]], partner[slots[q]] < -1
        n, t_1, t_2, a = O[O_FN * TILE + q], O[O_TX * TILE + q], O[O_TY * TILE + q], G[q, 9]
        f_x = n * G[q, 0] + t_1 * G[q, 3] + t_2 * G[q, 6]
        f_y = n * G[q, 1] + t_1 * G[q, 4] + t_2 * G[q, 7]
        f_z = n * G[q, 2] + t_1 * G[q, 5] + t_2 * G[q, 8]
        r_x, r_y, r_z = S[i, S_ARM] - a * G[q, 0], S[i, S_ARM + 1] - a * G[q, 1], S[i, S_ARM + 2] - a * G[q, 2]
        r[0] += f_x
        r[1] += f_y
        r[2] += f_z
        r[3] += r_y * f_z - r_z * f_y
        r[4] += r_z * f_x - r_x * f_z
        r[5] += r_x * f_y - r_y * f_x
        if rolling == MOMENTS:
            at = (O_HISTORY + n_history) * TILE + q
            for d in range(3):
                r[3 + d] += O[at + Q_X * TILE] * G[q, 3 + d] + O[at + Q_Y * TILE] * G[q, 6 + d]
        if up:
            r[6] -= f_z
        overlap = I[I_OVERLAP * TILE + q]
        normal += abs(n)
        deepest, radius = max(deepest, overlap), max(radius, O[O_A * TILE + q])
        power += O[O_POWER * TILE + q]
        if overlap > ratio * S[i, S_R]:
            ratio, slot = overlap / S[i, S_R], slots[q]
    told[E_NORMAL], told[E_DEEPEST], told[E_RADIUS], told[E_RATIO], told[E_SLOT] = normal, deepest, radius, ratio, slot
    told[E_POWER] = power
    for k in range(3):
        B[b, B_F + k], B[b, B_T + k] = r[k], r[3 + k]
    if has_effects:
        effects(B, b, b + 1, time, dt, parameters)
        for k in range(3):
            r[k] += B[b, B_EF + k]
            r[3 + k] += B[b, B_ET + k]
    inertial_forces(b, p, dt, Z, T, B, P, inertial, r)
    for k in range(3):
        r[3 + k] /= Z[Z_ARM]


@njit(**INNER)
def inertial_forces(b, p, dt, Z, T, B, P, inertial, r):
    """Take off what accelerates the body; add load, dashpot, spring and inertia of its patch. `inertial` 0: no momentum."""
    now, last = Z[Z_NOW] / dt, inertial * Z[Z_BEFORE] / dt
    l_1 = momentum_of(b, B)
    for k in range(3):
        r[k] -= B[b, B_MASS] * (now * (B[b, B_V + k] - inertial * Z[Z_V + k]) - last * T[T_DV + k])
        r[3 + k] -= now * (l_1[k] - inertial * Z[Z_L + k]) - last * T[T_DL + k]
    if P[p, P_FREE] == 0.0:
        r[6] = 0.0
        return
    rise = P[p, P_V]
    r[6] -= P[p, P_LOAD] + P[p, P_DAMPING] * rise
    r[6] -= P[p, P_MASS] * (now * (rise - inertial * Z[Z_RISE]) - last * T[T_DRISE])
    r[6] -= P[p, P_SPRING] * (P[p, P_Z] - Z[Z_PLATE])


@njit(**INNER)
def linearise(b, p, m, dt, before, edges, own, partner, S, B, P, I, O, K, G, slots, Z, tangents, pairs, n_history, rolling,
              J):  # noqa: E741  # fmt: skip
    """J (7, 7): how the unbalanced forces change with the coordinates, at the spots as staged."""
    tangents(I, K, m, pairs)
    for i in range(FREEDOMS):
        for j in range(FREEDOMS):
            J[i, j] = 0.0
    for q in range(m):
        add_spot(q, slots[q], before[slots[q] - first_slot(b, edges)], own, partner, S, I, O, K, G, n_history, rolling, J)
    arm = 1.0 / Z[Z_ARM]
    xx, yy, zz, xy, xz, yz = inertia_of(b, B)
    rate = Z[Z_NOW] / dt
    square = rate * rate
    for k in range(3):
        J[k, k] -= B[b, B_MASS] * square
    J[3, 3] -= xx * square
    J[4, 4] -= yy * square
    J[5, 5] -= zz * square
    J[3, 4] -= xy * square
    J[4, 3] -= xy * square
    J[3, 5] -= xz * square
    J[5, 3] -= xz * square
    J[4, 5] -= yz * square
    J[5, 4] -= yz * square
    for i in range(FREEDOMS):
        for k in range(3, 6):
            J[i, k] *= arm
    for k in range(3, 6):
        for j in range(FREEDOMS):
            J[k, j] *= arm
    if P[p, P_FREE] == 0.0:
        for k in range(6):
            J[6, k], J[k, 6] = 0.0, 0.0
        J[6, 6] = -1.0
    else:
        J[6, 6] -= P[p, P_DAMPING] * rate + P[p, P_MASS] * square + P[p, P_SPRING]


@njit(**INNER)
def first_slot(b, edges):
    """The first slot of body b: slots of plates belong to one body each and stand in the order of the bodies."""
    return edges[b]


@njit(**INNER)
def add_spot(q, slot, gap, own, partner, S, I, O, K, G, n_history, rolling, J):  # noqa: E741
    """Add the spot at place q of the tile to J, with rotations in radians: stiffness, turn of its arm, growth of its patch."""
    i, up, n_z = own[slot], partner[slot] < -1, G[q, 2]
    a_x, a_y, a_z = S[i, S_ARM], S[i, S_ARM + 1], S[i, S_ARM + 2]
    x, y, z = a_x, a_y, a_z - G[q, 9] * n_z
    e_x, e_y, g_x, g_y = G[q, 3], G[q, 4], G[q, 6], G[q, 7]
    n, t_1, t_2 = O[O_FN * TILE + q], O[O_TX * TILE + q], O[O_TY * TILE + q]
    f_x, f_y, f_z = t_1 * e_x + t_2 * g_x, t_1 * e_y + t_2 * g_y, n * n_z
    xx, xy, yx, yy = K[K_XX * TILE + q], K[K_XY * TILE + q], K[K_YX * TILE + q], K[K_YY * TILE + q]
    xd, yd = K[K_XD * TILE + q], K[K_YD * TILE + q]
    if gap < 0.0:
        # the share of the slip grows with the overlap that is reached
        overlap = I[I_OVERLAP * TILE + q]
        share = overlap / (overlap - gap)
        growth = -gap / ((overlap - gap) * (overlap - gap)) / share
        xd += (xx * I[I_SX * TILE + q] + xy * I[I_SY * TILE + q]) * growth
        yd += (yx * I[I_SX * TILE + q] + yy * I[I_SY * TILE + q]) * growth
        xx, xy, yx, yy = share * xx, share * xy, share * yx, share * yy
    for c in range(FREEDOMS):
        # overlap, slip and arm per coordinate
        d, s_1, s_2, u_x, u_y, u_z = spot_moves(c, a_x, a_y, a_z, x, y, z, n_z, e_x, e_y, g_x, g_y, up)
        u_z += 0.5 * n_z * d
        f_n = K[K_NORMAL * TILE + q] * d
        d_1, d_2 = xx * s_1 + xy * s_2 + xd * d, yx * s_1 + yy * s_2 + yd * d
        d_x, d_y, d_z = d_1 * e_x + d_2 * g_x, d_1 * e_y + d_2 * g_y, f_n * n_z
        J[0, c] += d_x
        J[1, c] += d_y
        J[2, c] += d_z
        J[3, c] += y * d_z - z * d_y + u_y * f_z - u_z * f_y
        J[4, c] += z * d_x - x * d_z + u_z * f_x - u_x * f_z
        J[5, c] += x * d_y - y * d_x + u_x * f_y - u_y * f_x
        if up:
            J[6, c] -= d_z
        if rolling == MOMENTS:
            add_moment(q, c, d, e_x, e_y, g_x, g_y, K, J)


@njit(**INNER)
def spot_moves(c, a_x, a_y, a_z, x, y, z, n_z, e_x, e_y, g_x, g_y, up):
    """Changes with coordinate c: overlap, slip along both axes of the frame, and the arm of the sphere (3)."""
    if c == 0:
        return 0.0, e_x, g_x, 0.0, 0.0, 0.0
    if c == 1:
        return 0.0, e_y, g_y, 0.0, 0.0, 0.0
    if c == 2:
        return -n_z, 0.0, 0.0, 0.0, 0.0, 0.0
    if c == 3:
        return -n_z * a_y, -e_y * z, -g_y * z, 0.0, -a_z, a_y
    if c == 4:
        return n_z * a_x, e_x * z, g_x * z, a_z, 0.0, -a_x
    if c == 5:
        return 0.0, e_y * x - e_x * y, g_y * x - g_x * y, -a_y, a_x, 0.0
    return (n_z if up else 0.0), 0.0, 0.0, 0.0, 0.0, 0.0


@njit(**INNER)
def add_moment(q, c, d, e_x, e_y, g_x, g_y, K, J):
    """Add the moment of a rolling law, which resists the rotation about the axes of the frame."""
    turn_1 = e_x if c == 3 else (e_y if c == 4 else 0.0)
    turn_2 = g_x if c == 3 else (g_y if c == 4 else 0.0)
    at = K_ROLL * TILE + q
    m_1 = K[at] * turn_1 + K[at + TILE] * turn_2 + K[at + 4 * TILE] * d
    m_2 = K[at + 2 * TILE] * turn_1 + K[at + 3 * TILE] * turn_2 + K[at + 5 * TILE] * d
    J[3, c] += m_1 * e_x + m_2 * g_x
    J[4, c] += m_1 * e_y + m_2 * g_y


@njit(**CHUNK)
def accept(b, m, edges, incidence, own, partner, S, B, P, H, F, R, I, O, G, slots, sums, v_x, v_y, n_history, rolling):  # noqa: E741
    """Take the staged spots as the end of a step: history, forces of plates, friction work and slip, records."""
    q = np.int64(0)
    for k in range(B_UP, B_LOW + 3):
        B[b, k] = 0.0
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if q < m and slots[q] == k:
            apply(q, k, O, G, own, partner, S, H, F, n_history, sums, 0)
            record(q, k, I, O, G, own, partner, S, P, R, v_x, v_y)
            if rolling == MOMENTS:
                apply_rolling(q, k, partner, O, G, F, n_history)
                record_rolling(q, k, O, G, R, n_history)
            side = B_LOW if partner[k] == -1 else B_UP
            for d in range(3):
                B[b, side + d] += F[k, F_F + d]
            q += 1
        else:
            release(k, H, F, sums, 0)
        B[b, B_WORK] += F[k, F_WORK]
        B[b, B_SLIP] += F[k, F_SLIP]
    B[b, B_L], B[b, B_L + 1], B[b, B_L + 2] = momentum_of(b, B)
