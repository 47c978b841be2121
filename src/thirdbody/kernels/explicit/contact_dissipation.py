"""What friction and dashpots take from contacts in a step of velocity Verlet.

A law books the work of the force at the end of the step, as the implicit integrator applies it. Bodies that move by velocity
Verlet exchange the work of the mean of the forces at both ends: where a force jumps within a step (a contact that closes, opens
or turns round while it slides) the two differ by half the jump times the slip, an error of first order. So here friction takes
what the mean force does beyond what the spring stores. A step in which that is negative makes energy: it counts as nothing, and
the energy stays visible as residual.

Only laws that remember their force (or moment) can be booked so; the others keep what they book themselves. The forces of the
dashpots are remembered behind the history of the laws, and they take what their mean force does. Where a contact turns round
within a step that is negative by the cube of the step; where the step is unstable it is negative at large, and counts as nothing
too, or the energy that such a step makes would be hidden from the guard.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import LANES, broadcast, clamp_below, get, put
from thirdbody.kernels.layout import (
    G_P,
    G_U,
    I_HISTORY,
    I_SX,
    I_SY,
    I_VN,
    I_VX,
    I_VY,
    J_RATE_X,
    J_RATE_Y,
    J_X,
    J_Y,
    O_HISTORY,
    O_LOST,
    O_POWER,
    O_STORED_T,
    O_WORK,
    Q_VISCOUS_MX,
    Q_VISCOUS_MY,
    Q_VISCOUS_N,
    Q_VISCOUS_X,
    Q_VISCOUS_Y,
    TILE,
)
from thirdbody.kernels.packed_triple import three_in_one, three_of


@njit(**BARE)
def work_of_mean(q, old, new, x, y, I, O):  # noqa: E741
    """Work at places q to q + 3 of the mean of two vectors, in fields from `old` of I on and from `new` of O on, over the
    displacements in fields x and y of I."""
    along = (get(I, q + old * TILE) + get(O, q + new * TILE)) * get(I, q + x * TILE)
    across = (get(I, q + (old + 1) * TILE) + get(O, q + (new + 1) * TILE)) * get(I, q + y * TILE)
    return broadcast(0.5) * (along + across)


@njit(**BARE_CHUNK)
def book(n, force, moment, stored, n_history, I, O):  # noqa: E741
    """Replace what the laws of n contacts booked as lost by friction.

    `force`, `moment`, `stored`: places in the history of the remembered force and moment, and of the energy of the springs;
    moment -1: the scene has none.
    """
    for q in range(0, n, LANES):
        work = work_of_mean(q, I_HISTORY + force, O_HISTORY + force, np.int64(I_SX), np.int64(I_SY), I, O)
        taken = get(I, q + (I_HISTORY + stored) * TILE) - work
        if moment >= 0:
            rotation = I_HISTORY + n_history
            taken = taken - work_of_mean(q, I_HISTORY + moment, O_HISTORY + moment, rotation + J_X, rotation + J_Y, I, O)
        taken = clamp_below(taken - get(O, q + O_STORED_T * TILE), 0.0)
        put(O, q + O_WORK * TILE, get(O, q + O_WORK * TILE) + (taken - get(O, q + O_LOST * TILE)))


@njit(**BARE)
def book_opened(n, force, moment, stored, n_history, I, O):  # noqa: E741
    """The same for n contacts that opened within the step: what they lost goes to O_WORK."""
    for q in range(n):
        O[q + O_WORK * TILE] = O[q + O_LOST * TILE] = O[q + O_STORED_T * TILE] = 0.0
        for k in range(2):
            O[q + (O_HISTORY + force + k) * TILE] = 0.0
            O[q + (O_HISTORY + max(moment, 0) + k) * TILE] = 0.0
    book(n, force, moment, stored, n_history, I, O)


@njit(**BARE_CHUNK)
def load_dashpot_forces(n, place, moment, n_history, I):  # noqa: E741
    """Put the forces and, if any, the moments of the dashpots of n contacts in place of the velocities that they answered to."""
    old = I[(I_HISTORY + place) * TILE :]
    for q in range(n):
        p = np.uint64(q)
        I[p + I_VN * TILE], I[p + I_VX * TILE], I[p + I_VY * TILE] = three_of(old[p])
    if moment:
        old, to = I[(I_HISTORY + place + 1) * TILE :], I[(I_HISTORY + n_history) * TILE :]
        for q in range(n):
            p = np.uint64(q)
            to[p + J_RATE_X * TILE], to[p + J_RATE_Y * TILE], _ = three_of(old[p])


@njit(**BARE_CHUNK)
def store_dashpot_forces(n, place, moment, n_history, O):  # noqa: E741
    """Put the forces and, if any, the moments of the dashpots of n contacts into the history."""
    new, behind = O[(O_HISTORY + place) * TILE :], O[(O_HISTORY + n_history) * TILE :]
    for q in range(n):
        p = np.uint64(q)
        x, y = behind[p + Q_VISCOUS_X * TILE], behind[p + Q_VISCOUS_Y * TILE]
        new[p] = three_in_one(behind[p + Q_VISCOUS_N * TILE], x, y)
    if moment:
        for q in range(n):
            p = np.uint64(q)
            x, y = behind[p + Q_VISCOUS_MX * TILE], behind[p + Q_VISCOUS_MY * TILE]
            new[p + TILE] = three_in_one(x, y, 0.0)


@njit(**BARE_CHUNK)
def book_dashpots(n, place, n_history, dt, I, O, G):  # noqa: E741
    """Put into O_POWER what the dashpots of n contacts take in the step, J, and remember their forces.

    `place`: of their force in the history, in one number (`three_in_one`); their moment, if any, is the number behind it.
    """
    moment, behind, rotation, half = n_history >= place + 2, O_HISTORY + n_history, I_HISTORY + n_history, broadcast(0.5 * dt)
    load_dashpot_forces(n, place, moment, n_history, I)
    for q in range(0, n, LANES):
        x, y, z = get(G, q + G_P * TILE), get(G, q + (G_P + 1) * TILE), get(G, q + (G_P + 2) * TILE)
        apart = get(G, q + G_U * TILE) * x + get(G, q + (G_U + 1) * TILE) * y + get(G, q + (G_U + 2) * TILE) * z
        work = half * (get(I, q + I_VN * TILE) + get(O, q + (behind + Q_VISCOUS_N) * TILE)) * apart
        work = work + work_of_mean(q, np.int64(I_VX), behind + Q_VISCOUS_X, np.int64(I_SX), np.int64(I_SY), I, O)
        if moment:
            work = work + work_of_mean(q, rotation + J_RATE_X, behind + Q_VISCOUS_MX, rotation + J_X, rotation + J_Y, I, O)
        put(O, q + O_POWER * TILE, clamp_below(broadcast(0.0) - work, 0.0))
    store_dashpot_forces(n, place, moment, n_history, O)


@njit(**BARE)
def book_opened_dashpots(n, place, n_history, dt, I, O, G):  # noqa: E741
    """Return what the dashpots of n contacts that opened within the step took in it, J."""
    for h in range(Q_VISCOUS_N, Q_VISCOUS_MY + 1):
        for q in range(n):
            O[q + (O_HISTORY + n_history + h) * TILE] = 0.0
    book_dashpots(n, place, n_history, dt, I, O, G)
    total = 0.0
    for q in range(n):
        total += O[q + O_POWER * TILE]
    return total
