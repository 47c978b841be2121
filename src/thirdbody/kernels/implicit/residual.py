"""One body between the first bodies at the end of a trial step of an implicit method: its forces, and how they change.

Tables come in groups, named alike in all these kernels:

| group | tables |
|---|---|
| spots | own, partner, kind, edges, incidence: the candidates, which here are all pairs of a sphere and a plate |
| shape | body, start, patch, offsets |
| state | S, B, P, H, R, E |
| known | pairs, parameters of effects, n_history, rolling, width of a labeller's rows, has_effects, labels, stored
(`spring_energy`),
          places of the remembered force and moment in the history |
| work | I, O, K, G: the law's tile; slots: candidates in it; before: gaps at the start of the step; then see `march` |

The coordinates y of a step are the displacement of the centre of mass (3, m), the rotation vector of the step times the arm of
the body (3, m, world axes), and the rise of the body's patch of the upper plate (m). `set_configuration` moves body, spheres
and patch to
the end of the step, `residual` asks the laws there and gives what is unbalanced (7, N); how that changes with y stands in
`jacobian`. Nothing is remembered until `commit`. All contact geometry, slip and history is that of the explicit integrator
(`contacts`), so both see the same laws in the same way; here a spot that closes within the step slips for the rest of it only.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import CHUNK, INNER
from thirdbody.kernels.contact_geometry import force_and_torques, gather_plate_contact, slip_increment, transport_frames
from thirdbody.kernels.contact_history import reset_history, spring_energy, store_history
from thirdbody.kernels.explicit.contact_dissipation import book
from thirdbody.kernels.explicit.contact_forces import SUM_LOW, SUM_UP, SUM_WORK, record
from thirdbody.kernels.implicit.friction_work import dragged_off
from thirdbody.kernels.layout import (
    B_F,
    B_MASS,
    B_Q,
    B_SLIP,
    B_T,
    B_V,
    B_W,
    B_WORK,
    B_X,
    E_EF,
    E_ET,
    E_I,
    E_L,
    G_ARM_I,
    G_D,
    G_E,
    G_F,
    G_N,
    H_ON,
    I_HISTORY,
    I_OVERLAP,
    I_SX,
    I_SY,
    I_VN,
    I_VX,
    I_VY,
    J_INVERSE,
    J_TRAVEL_X,
    J_TRAVEL_Y,
    J_X,
    J_Y,
    O_A,
    O_FN,
    O_HISTORY,
    O_POWER,
    O_SLIP,
    O_STORED_N,
    O_STORED_T,
    O_TX,
    O_TY,
    O_WORK,
    P_DAMPING,
    P_FREE,
    P_LOAD,
    P_MASS,
    P_SPRING,
    P_V,
    P_Z,
    Q_X,
    Q_Y,
    R_FN,
    R_STORED_N,
    S_ARM,
    S_R,
    T_DL,
    T_DRISE,
    T_DV,
    T_Y,
    TILE,
)
from thirdbody.kernels.narrow_phase import overlap_and_normal
from thirdbody.kernels.rigid_body import place_body
from thirdbody.kernels.rolling_kinematics import MOMENTS, gather_rolling, record_rolling
from thirdbody.kernels.rotation import matrix, rotate

FREEDOMS = 7
"""Coordinates of a body and its patch."""

# Z: the state of a body and its patch at the start of a step
Z_X, Z_V, Z_Q, Z_L, Z_W, Z_PATCH, Z_RISE, Z_ARM, Z_PLATE = 0, 3, 6, 10, 13, 16, 17, 18, 19
Z_NOW, Z_BEFORE = 20, 21  # the formula of the step: rate of change = (NOW change - BEFORE last change)/dt
Z_PLATE_RISE, Z_PULL = 22, 23  # rise of the plate that a patch is sprung to; what holds a body without inertia back, N/m
Z_MASS = 24  # share of its mass that a body without inertia keeps
Z_LOAD = 25  # load of the patch as the step begins
Z_OLD = 26  # weight of the force at the start of the step in what the plate and friction take: a half, or 0
Z_COLS = 27

# what `residual` tells beside the unbalanced forces
E_NORMAL, E_DEEPEST, E_RADIUS, E_RATIO, E_SLOT, E_POWER = range(6)
E_COLS = 6


TURN = 0.05
"""Largest rotation of a step, rad: the slip of a step is that of a turn about one axis."""


@njit(**CHUNK)
def save_start(b, p, shape, state, Z):
    """Note where a step of body b begins."""
    (S, B, P, _, _, E), (_, start, _, offsets) = state, shape
    for k in range(3):
        Z[Z_X + k], Z[Z_V + k] = B[b, B_X + k], B[b, B_V + k]
        Z[Z_L + k], Z[Z_W + k] = E[b, E_L + k], B[b, B_W + k]
    for k in range(4):
        Z[Z_Q + k] = B[b, B_Q + k]
    Z[Z_PATCH], Z[Z_RISE], Z[Z_LOAD] = P[p, P_Z], P[p, P_V], P[p, P_LOAD]
    far = 0.0
    for s in range(start[b], start[b + 1]):
        square = offsets[s, 0] ** 2 + offsets[s, 1] ** 2 + offsets[s, 2] ** 2
        far = max(far, math.sqrt(square) + S[s, S_R])
    Z[Z_ARM] = far


@njit(**INNER)
def set_configuration(b, p, y, dt, Z, T, shape, state):
    """Move body b, its spheres and its patch p to the end of the step: mean velocities of the step, then those at its end."""
    (S, B, P, _, _, _), (_, start, _, offsets) = state, shape
    inverse, arm = 1.0 / dt, 1.0 / Z[Z_ARM]
    now, last = Z[Z_NOW] * inverse, Z[Z_BEFORE] * inverse
    for k in range(3):
        B[b, B_X + k] = Z[Z_X + k] + y[k]
        B[b, B_V + k] = y[k] * inverse
    q = rotate((Z[Z_Q], Z[Z_Q + 1], Z[Z_Q + 2], Z[Z_Q + 3]), y[3] * arm, y[4] * arm, y[5] * arm)
    for k in range(4):
        B[b, B_Q + k] = q[k]
    w = (y[3] * arm * inverse, y[4] * arm * inverse, y[5] * arm * inverse)
    w_end = (
        (now * y[3] - last * T[T_Y + 3]) * arm, (now * y[4] - last * T[T_Y + 4]) * arm, (now * y[5] - last * T[T_Y + 5]) * arm,
    )  # fmt: skip
    v_end = (now * y[0] - last * T[T_Y], now * y[1] - last * T[T_Y + 1], now * y[2] - last * T[T_Y + 2])
    x, v = (B[b, B_X], B[b, B_X + 1], B[b, B_X + 2]), (B[b, B_V], B[b, B_V + 1], B[b, B_V + 2])
    place_body(b, start, offsets, S, x, q, v, w, v_end, w_end, dt)
    for k in range(3):
        B[b, B_V + k], B[b, B_W + k] = v_end[k], w_end[k]
    P[p, P_Z], P[p, P_V] = Z[Z_PATCH] + y[6], now * y[6] - last * T[T_Y + 6]


@njit(**INNER)
def inertia_of(b, B, E):
    """Moments of inertia about world axes: xx, yy, zz, xy, xz, yz."""
    a, b_, c, d, e, f, g, h, i = matrix(B[b, B_Q], B[b, B_Q + 1], B[b, B_Q + 2], B[b, B_Q + 3])
    i_x, i_y, i_z = E[b, E_I], E[b, E_I + 1], E[b, E_I + 2]
    return (
        a * a * i_x + b_ * b_ * i_y + c * c * i_z, d * d * i_x + e * e * i_y + f * f * i_z,
        g * g * i_x + h * h * i_y + i * i * i_z, a * d * i_x + b_ * e * i_y + c * f * i_z,
        a * g * i_x + b_ * h * i_y + c * i * i_z, d * g * i_x + e * h * i_y + f * i * i_z,
    )  # fmt: skip


@njit(**INNER)
def momentum_of(b, B, E):
    """Angular momentum, world axes, from spin and orientation."""
    xx, yy, zz, xy, xz, yz = inertia_of(b, B, E)
    x, y, z = B[b, B_W], B[b, B_W + 1], B[b, B_W + 2]
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z


@njit(**INNER)
def active_contacts(b, dt, rate, v_x, v_y, spots, shape, state, known, work):
    """Stage the loaded spots of body b in the law's tile; returns how many, or -1 if they are more than the tile holds.

    `rate`: change of a velocity per change of place over the step, 1/s; v_x, v_y: mean velocity of the upper plate.
    """
    own, partner, kind, edges, incidence = spots
    (S, _, P, H, _, _), n_history, rolling = state, known[2], known[3]
    I, G, slots, before = work[0], work[3], work[4], work[5]  # noqa: E741
    m = np.int64(0)
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        overlap = overlap_and_normal(k, own, partner, S, P, 0.0, 0.0)[0]
        if overlap <= 0.0:
            continue
        if m == TILE:
            return np.int64(-1)
        rise = P[max(-partner[k] - 2, 0), P_V]
        gather_plate_contact(m, k, overlap, own, partner, kind, S, H, v_x, v_y, rise, I, G, n_history)
        slots[m] = k
        m += 1
    transport_frames(m, dt, G)
    slip_increment(m, dt, I, G)
    for q in range(m):
        at = (I_HISTORY + n_history) * TILE + q
        if rolling > 0:
            gather_rolling(q, slots[q], own, partner, S, P, dt, v_x, v_y, I, G, n_history)
        I[at + J_INVERSE * TILE] = rate
        gap = before[slots[q] - edges[b]]
        if gap < 0.0:
            fraction = I[I_OVERLAP * TILE + q] / (I[I_OVERLAP * TILE + q] - gap)
            I[I_SX * TILE + q] *= fraction
            I[I_SY * TILE + q] *= fraction
            if rolling > 0:
                I[at + J_X * TILE] *= fraction
                I[at + J_Y * TILE] *= fraction
                I[at + J_TRAVEL_X * TILE] *= fraction
                I[at + J_TRAVEL_Y * TILE] *= fraction
    return m


@njit(**INNER)
def residual(b, p, m, y, dt, time, inertial, spots, state, known, work, Z, T, law, effects, r, diagnostics):
    """Unbalanced forces r (7) of body b and its patch, with m staged spots; `diagnostics` gets what else a step wants to know
    (E_*)."""
    own, partner, edges = spots[0], spots[1], spots[3]
    S, B, P, _, _, E = state
    pairs, parameters, n_history, rolling, _, has_effects = known[:6]
    I, O, _, G, slots, before = work[0], work[1], work[2], work[3], work[4], work[5]  # noqa: E741
    law(I, O, m, pairs)
    for k in range(FREEDOMS):
        r[k] = 0.0
    normal, deepest, radius, ratio, slot, power = 0.0, 0.0, 0.0, 0.0, -1.0, 0.0
    for q in range(m):
        i, up = own[slots[q]], partner[slots[q]] < -1
        n, t_1, t_2, a = O[O_FN * TILE + q], O[O_TX * TILE + q], O[O_TY * TILE + q], G[q + G_ARM_I * TILE]
        f_x = n * G[q + G_N * TILE] + t_1 * G[q + G_E * TILE] + t_2 * G[q + G_D * TILE]
        f_y = n * G[q + (G_N + 1) * TILE] + t_1 * G[q + (G_E + 1) * TILE] + t_2 * G[q + (G_D + 1) * TILE]
        f_z = n * G[q + (G_N + 2) * TILE] + t_1 * G[q + (G_E + 2) * TILE] + t_2 * G[q + (G_D + 2) * TILE]
        r_x, r_y = S[i, S_ARM] - a * G[q + G_N * TILE], S[i, S_ARM + 1] - a * G[q + (G_N + 1) * TILE]
        r_z = S[i, S_ARM + 2] - a * G[q + (G_N + 2) * TILE]
        r[0] += f_x
        r[1] += f_y
        r[2] += f_z
        r[3] += r_y * f_z - r_z * f_y
        r[4] += r_z * f_x - r_x * f_z
        r[5] += r_x * f_y - r_y * f_x
        if rolling == MOMENTS:
            at = (O_HISTORY + n_history) * TILE + q
            for d in range(3):
                r[3 + d] += O[at + Q_X * TILE] * G[q + (G_E + d) * TILE] + O[at + Q_Y * TILE] * G[q + (G_D + d) * TILE]
        if up:
            r[6] -= f_z
        overlap = I[I_OVERLAP * TILE + q]
        normal += abs(n)
        deepest, radius = max(deepest, overlap), max(radius, O[O_A * TILE + q])
        power += O[O_POWER * TILE + q] * mean_velocity_factor(q, dt, before[slots[q] - edges[b]], I)
        if overlap > ratio * S[i, S_R]:
            ratio, slot = overlap / S[i, S_R], slots[q]
    diagnostics[E_NORMAL], diagnostics[E_DEEPEST], diagnostics[E_RADIUS], diagnostics[E_RATIO], diagnostics[E_SLOT] = (
        normal,
        deepest,
        radius,
        ratio,
        slot,
    )
    diagnostics[E_POWER] = power
    for k in range(3):
        B[b, B_F + k], B[b, B_T + k] = r[k], r[3 + k]
    if has_effects:
        effects(B, E, b, b + 1, time, dt, parameters)
        for k in range(3):
            r[k] += E[b, E_EF + k]
            r[3 + k] += E[b, E_ET + k]
    inertial_forces(b, p, y, dt, Z, T, B, E, P, inertial, r)
    for k in range(3):
        r[3 + k] /= Z[Z_ARM]


@njit(**INNER)
def mean_velocity_factor(q, dt, before, I):  # noqa: E741
    """Mean velocity of the step over that at its end, for the spot at place q.

    A dashpot's force is that of the end of the step, but it acts along the way of the step: what it takes is force times way.
    """
    n, x, y = I[I_VN * TILE + q], I[I_VX * TILE + q], I[I_VY * TILE + q]
    square = n * n + x * x + y * y
    along = -n * (I[I_OVERLAP * TILE + q] - before) + x * I[I_SX * TILE + q] + y * I[I_SY * TILE + q]
    return min(max(along / (dt * square), 0.0), 2.0) if square > 0.0 else 1.0


@njit(**INNER)
def inertial_forces(b, p, y, dt, Z, T, B, E, P, inertial, r):
    """Take off what accelerates the body; add load, dashpot, spring and inertia of its patch.

    Without inertia (`inertial` 0) every step begins at rest, and a weak pull towards where it began lets a body that slides on
    all its spots, and could be anywhere, be somewhere; a share of the mass holds back what jumps within a step.
    """
    now, last, pull, fraction = Z[Z_NOW] / dt, inertial * Z[Z_BEFORE] / dt, Z[Z_PULL], Z[Z_MASS]
    l_1 = momentum_of(b, B, E)
    for k in range(3):
        r[k] -= fraction * B[b, B_MASS] * (now * (B[b, B_V + k] - inertial * Z[Z_V + k]) - last * T[T_DV + k]) + pull * y[k]
        r[3 + k] -= fraction * (now * (l_1[k] - inertial * Z[Z_L + k]) - last * T[T_DL + k]) + pull * y[3 + k] * Z[Z_ARM]
    if P[p, P_FREE] == 0.0:
        r[6] = 0.0
        return
    rise = P[p, P_V]
    r[6] -= P[p, P_LOAD] + P[p, P_DAMPING] * rise
    r[6] -= fraction * P[p, P_MASS] * (now * (rise - inertial * Z[Z_RISE]) - last * T[T_DRISE]) + pull * y[6]
    r[6] -= P[p, P_SPRING] * (P[p, P_Z] - Z[Z_PLATE])


@njit(**INNER)
def unbooked_energy(q, k, stored, O, H):  # noqa: E741
    """Energy, J, that the contact of slot k, at place q, held and did not book although it carries nothing any more.

    Where the dashpot of a sphere that leaves cancels its normal force, friction ends in one step at a limit of zero. No force
    does work then: all that was stored is dissipated, as it is where a contact opens (`memory.release`).
    """
    if O[O_TX * TILE + q] != 0.0 or O[O_TY * TILE + q] != 0.0 or O[O_STORED_T * TILE + q] != 0.0:
        return 0.0
    return max(spring_energy(k, stored, H) - O[O_WORK * TILE + q], 0.0)


@njit(**INNER)
def recoil(b, m, dt, spots, state, work):
    """What the dashpots of spots that carried nothing as the step began dissipate beyond what `residual` told, J.

    Such a spot is on its way out, its elastic force cancelled by its dashpot, which takes all that is still stored. As nothing
    accelerates the body, one step can lead from there to the open contact, and the force at its end knows nothing of it.
    """
    edges, incidence = spots[3], spots[4]
    H, R, O, I, slots, before = state[3], state[4], work[1], work[0], work[4], work[5]  # noqa: E741
    total, q = 0.0, np.int64(0)
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        staged = q < m and slots[q] == k
        if H[k, H_ON] != 0.0 and R[k, R_FN] == 0.0:
            if not staged:
                total += R[k, R_STORED_N]
            elif O[O_FN * TILE + q] == 0.0:
                taken = O[O_POWER * TILE + q] * mean_velocity_factor(q, dt, before[e - edges[b]], I) * dt
                total += R[k, R_STORED_N] - O[O_STORED_N * TILE + q] - taken
        if staged:
            q += 1
    return total


@njit(**INNER)
def commit(b, m, dt, v_x, v_y, spots, state, known, work, Z, sums):
    """Take the staged spots as the end of a step: history, friction work and slip, records; into `sums` work and the forces of
    the plates on the body.

    Bodies exchange the work of the mean force of a step, so friction takes that (`booking`). Not where forces jump
    (`steps.weight_of_old`): there laws tell what the force at the end of the step takes, as the plate's work is counted.
    """
    own, partner, _, edges, incidence = spots
    S, B, P, H, R, _ = state
    n_history, rolling, moment = known[2], known[3], known[9]
    force = known[8] if Z[Z_OLD] > 0.0 else np.int64(-1)
    I, O, G, slots = work[0], work[1], work[3], work[4]  # noqa: E741
    force_and_torques(m, I, O, G)
    if force >= 0:
        book(m, force, moment, known[7], n_history, I, O)
    for i in range(m if force < 0 else 0):
        O[O_WORK * TILE + i] += unbooked_energy(i, slots[i], known[7], O, H)
    store_history(m, slots, 0, O, G, H, n_history)
    q = np.int64(0)
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if q < m and slots[q] == k:
            record(q, k, I, O, G, own, partner, S, P, R, v_x, v_y)
            if rolling == MOMENTS:
                record_rolling(q, k, O, G, R, n_history)
            sums[0, SUM_WORK] += O[O_WORK * TILE + q]
            B[b, B_WORK] += O[O_WORK * TILE + q]  # all of it: what a spot meets is a plate
            B[b, B_SLIP] += O[O_SLIP * TILE + q]
            side = SUM_LOW if partner[k] == -1 else SUM_UP
            for d in range(3):
                sums[0, side + d] += G[q + (G_F + d) * TILE]
            q += 1
        elif H[k, H_ON] != 0.0:
            dragged = dragged_off(k, work[5][e - edges[b]], dt, v_x, v_y, spots, state, force) if force >= 0 else 0.0
            lost = max(reset_history(k, known[7], H) + dragged, 0.0)
            sums[0, SUM_WORK] += lost
            B[b, B_WORK] += lost
