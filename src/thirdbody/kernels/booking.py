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

from .layout import (
    G_P,
    G_STORED,
    G_U,
    I_HISTORY,
    I_SX,
    I_SY,
    J_X,
    J_Y,
    O_HISTORY,
    O_LOST,
    O_POWER,
    O_STORED_T,
    O_WORK,
    TILE,
)  # fmt: skip
from .options import BARE, BARE_CHUNK


@njit(**BARE_CHUNK)
def take_work(n, x, y, old, new, I, O, G):  # noqa: E741
    """Add to G_STORED the work done on the springs of n contacts by the displacements in fields x and y of I, against the mean
    of the forces in fields `old` of I and `new` of O."""
    old, new, x, y = np.uint64(old * TILE), np.uint64(new * TILE), np.uint64(x * TILE), np.uint64(y * TILE)
    for q in range(n):
        p = np.uint64(q)
        along = (I[p + old] + O[p + new]) * I[p + x]
        across = (I[p + old + TILE] + O[p + new + TILE]) * I[p + y]
        G[p + G_STORED * TILE] -= 0.5 * (along + across)


@njit(**BARE_CHUNK)
def book(n, force, moment, n_history, I, O, G):  # noqa: E741
    """Replace what the laws of n contacts booked as lost by friction. G_STORED: the energy of their springs before the step.

    `force`, `moment`: place of the remembered force and moment in the history; moment -1: the scene has none.
    """
    take_work(n, np.int64(I_SX), np.int64(I_SY), I_HISTORY + force, O_HISTORY + force, I, O, G)
    if moment >= 0:
        turn = I_HISTORY + n_history
        take_work(n, turn + J_X, turn + J_Y, I_HISTORY + moment, O_HISTORY + moment, I, O, G)
    for q in range(n):
        taken = max(G[q + G_STORED * TILE] - O[q + O_STORED_T * TILE], 0.0)
        O[q + O_WORK * TILE] += taken - O[q + O_LOST * TILE]


@njit(**BARE)
def book_opened(n, force, moment, n_history, I, O, G):  # noqa: E741
    """The same for n contacts that opened within the step: what they lost goes to O_WORK."""
    for q in range(n):
        O[q + O_WORK * TILE] = O[q + O_LOST * TILE] = O[q + O_STORED_T * TILE] = 0.0
        for k in range(2):
            O[q + (O_HISTORY + force + k) * TILE] = 0.0
            O[q + (O_HISTORY + max(moment, 0) + k) * TILE] = 0.0
    book(n, force, moment, n_history, I, O, G)


@njit(**BARE_CHUNK)
def take_pressing(n, place, dt, I, O, G):  # noqa: E741
    """Put into G_STORED the work that the normal dashpots of n contacts take in the step."""
    old, new = np.uint64((I_HISTORY + place) * TILE), np.uint64((O_HISTORY + place) * TILE)
    half = 0.5 * dt
    for q in range(n):
        p = np.uint64(q)
        x, y, z = G[p + G_P * TILE], G[p + (G_P + 1) * TILE], G[p + (G_P + 2) * TILE]
        apart = G[p + G_U * TILE] * x + G[p + (G_U + 1) * TILE] * y + G[p + (G_U + 2) * TILE] * z
        G[p + G_STORED * TILE] = -half * (I[p + old] + O[p + new]) * apart


@njit(**BARE_CHUNK)
def book_dashpots(n, place, n_history, dt, I, O, G):  # noqa: E741
    """Put into O_POWER what the dashpots of n contacts take in the step, J.

    `place`: of their forces in the history, where they are the last.
    """
    take_pressing(n, place, dt, I, O, G)
    if n_history >= place + 3:
        take_work(n, np.int64(I_SX), np.int64(I_SY), I_HISTORY + place + 1, O_HISTORY + place + 1, I, O, G)
    if n_history >= place + 5:
        turn = I_HISTORY + n_history
        take_work(n, turn + J_X, turn + J_Y, I_HISTORY + place + 3, O_HISTORY + place + 3, I, O, G)
    for q in range(n):
        O[q + O_POWER * TILE] = max(G[q + G_STORED * TILE], 0.0)


@njit(**BARE)
def book_opened_dashpots(n, place, n_history, dt, I, O, G):  # noqa: E741
    """Return what the dashpots of n contacts that opened within the step took in it, J."""
    for h in range(place, n_history):
        for q in range(n):
            O[q + (O_HISTORY + h) * TILE] = 0.0
    book_dashpots(n, place, n_history, dt, I, O, G)
    total = 0.0
    for q in range(n):
        total += O[q + O_POWER * TILE]
    return total
