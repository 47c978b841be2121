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
from thirdbody.kernels.columns import geometry, law_input, law_output, rolling_input, rolling_output
from thirdbody.kernels.columns.tile import TILE
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
        work = work_of_mean(
            q, law_input.HISTORY + force, law_output.HISTORY + force, np.int64(law_input.SLIP_X), np.int64(law_input.SLIP_Y), I, O
        )
        taken = get(I, q + (law_input.HISTORY + stored) * TILE) - work
        if moment >= 0:
            rotation = law_input.HISTORY + n_history
            taken = taken - work_of_mean(
                q,
                law_input.HISTORY + moment,
                law_output.HISTORY + moment,
                rotation + rolling_input.TURN_X,
                rotation + rolling_input.TURN_Y,
                I,
                O,
            )
        taken = clamp_below(taken - get(O, q + law_output.STORED_TANGENTIAL * TILE), 0.0)
        put(
            O,
            q + law_output.DISSIPATED * TILE,
            get(O, q + law_output.DISSIPATED * TILE) + (taken - get(O, q + law_output.FRICTION_LOSS * TILE)),
        )


@njit(**BARE)
def book_opened(n, force, moment, stored, n_history, I, O):  # noqa: E741
    """The same for n contacts that opened within the step: what they lost goes to law_output.DISSIPATED."""
    for q in range(n):
        O[q + law_output.DISSIPATED * TILE] = O[q + law_output.FRICTION_LOSS * TILE] = O[
            q + law_output.STORED_TANGENTIAL * TILE
        ] = 0.0
        for k in range(2):
            O[q + (law_output.HISTORY + force + k) * TILE] = 0.0
            O[q + (law_output.HISTORY + max(moment, 0) + k) * TILE] = 0.0
    book(n, force, moment, stored, n_history, I, O)


@njit(**BARE_CHUNK)
def load_dashpot_forces(n, place, moment, n_history, I):  # noqa: E741
    """Put the forces and, if any, the moments of the dashpots of n contacts in place of the velocities that they answered to."""
    old = I[(law_input.HISTORY + place) * TILE :]
    for q in range(n):
        p = np.uint64(q)
        I[p + law_input.NORMAL_VELOCITY * TILE], I[p + law_input.VELOCITY_X * TILE], I[p + law_input.VELOCITY_Y * TILE] = (
            three_of(old[p])
        )
    if moment:
        old, to = I[(law_input.HISTORY + place + 1) * TILE :], I[(law_input.HISTORY + n_history) * TILE :]
        for q in range(n):
            p = np.uint64(q)
            to[p + rolling_input.RATE_X * TILE], to[p + rolling_input.RATE_Y * TILE], _ = three_of(old[p])


@njit(**BARE_CHUNK)
def store_dashpot_forces(n, place, moment, n_history, O):  # noqa: E741
    """Put the forces and, if any, the moments of the dashpots of n contacts into the history."""
    new, behind = O[(law_output.HISTORY + place) * TILE :], O[(law_output.HISTORY + n_history) * TILE :]
    for q in range(n):
        p = np.uint64(q)
        x, y = behind[p + rolling_output.VISCOUS_X * TILE], behind[p + rolling_output.VISCOUS_Y * TILE]
        new[p] = three_in_one(behind[p + rolling_output.VISCOUS_NORMAL * TILE], x, y)
    if moment:
        for q in range(n):
            p = np.uint64(q)
            x, y = behind[p + rolling_output.VISCOUS_MOMENT_X * TILE], behind[p + rolling_output.VISCOUS_MOMENT_Y * TILE]
            new[p + TILE] = three_in_one(x, y, 0.0)


@njit(**BARE_CHUNK)
def book_dashpots(n, place, n_history, dt, I, O, G):  # noqa: E741
    """Put into law_output.DASHPOT_POWER what the dashpots of n contacts take in the step, J, and remember their forces.

    `place`: of their force in the history, in one number (`three_in_one`); their moment, if any, is the number behind it.
    """
    moment = n_history >= place + 2
    behind = law_output.HISTORY + n_history
    rotation = law_input.HISTORY + n_history
    half = broadcast(0.5 * dt)
    load_dashpot_forces(n, place, moment, n_history, I)
    for q in range(0, n, LANES):
        x = get(G, q + geometry.MID_NORMAL * TILE)
        y = get(G, q + (geometry.MID_NORMAL + 1) * TILE)
        z = get(G, q + (geometry.MID_NORMAL + 2) * TILE)
        apart = (
            get(G, q + geometry.MID_VELOCITY * TILE) * x
            + get(G, q + (geometry.MID_VELOCITY + 1) * TILE) * y
            + get(G, q + (geometry.MID_VELOCITY + 2) * TILE) * z
        )
        work = (
            half
            * (get(I, q + law_input.NORMAL_VELOCITY * TILE) + get(O, q + (behind + rolling_output.VISCOUS_NORMAL) * TILE))
            * apart
        )
        work = work + work_of_mean(
            q,
            np.int64(law_input.VELOCITY_X),
            behind + rolling_output.VISCOUS_X,
            np.int64(law_input.SLIP_X),
            np.int64(law_input.SLIP_Y),
            I,
            O,
        )
        if moment:
            work = work + work_of_mean(
                q,
                rotation + rolling_input.RATE_X,
                behind + rolling_output.VISCOUS_MOMENT_X,
                rotation + rolling_input.TURN_X,
                rotation + rolling_input.TURN_Y,
                I,
                O,
            )
        put(O, q + law_output.DASHPOT_POWER * TILE, clamp_below(broadcast(0.0) - work, 0.0))
    store_dashpot_forces(n, place, moment, n_history, O)


@njit(**BARE)
def book_opened_dashpots(n, place, n_history, dt, I, O, G):  # noqa: E741
    """Return what the dashpots of n contacts that opened within the step took in it, J."""
    for h in range(rolling_output.VISCOUS_NORMAL, rolling_output.VISCOUS_MOMENT_Y + 1):
        for q in range(n):
            O[q + (law_output.HISTORY + n_history + h) * TILE] = 0.0
    book_dashpots(n, place, n_history, dt, I, O, G)
    total = 0.0
    for q in range(n):
        total += O[q + law_output.DASHPOT_POWER * TILE]
    return total
