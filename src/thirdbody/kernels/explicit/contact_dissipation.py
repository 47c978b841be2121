"""Dissipation by friction and dashpots of contacts in a step of velocity Verlet.

A law books the work of the force at the end of the step, as the implicit integrator applies it. Bodies that move by velocity
Verlet exchange the work of the mean of the forces at both ends: where a force jumps within a step (a contact that closes, opens
or reverses while it slides) the two differ by half the jump times the slip, an error of first order. So here friction dissipates
the work of the mean force less the change of the energy in the springs. A step in which that is negative creates energy: it
counts as zero, and the energy remains visible as residual.

Only laws whose force (or moment) is in their history can be booked so; for others their own booking holds. The forces of the
dashpots follow the history of the laws, and dashpots dissipate the work of their mean force. Where a contact reverses within a
step, that is negative by the order of the cube of the step; where the step is unstable, it is negative and large. It counts as
zero, too: else the energy that such a step creates would be hidden from the guard.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import LANES, broadcast, clamp_below, get, put
from thirdbody.kernels.columns import geometry, law_input, law_output, rolling_input, rolling_output
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.packed_triple import pack_triple, unpack_triple


@njit(**BARE)
def work_of_mean(q, old, new, x, y, I, O):  # noqa: E741
    """Return the work, at elements q to q + 3, of the mean of an old and a new vector [J].

    The vectors are fields from `old` of I on and from `new` of O on; the displacements are fields x and y of I.
    """
    along = (get(I, q + old * TILE) + get(O, q + new * TILE)) * get(I, q + x * TILE)
    across = (get(I, q + (old + 1) * TILE) + get(O, q + (new + 1) * TILE)) * get(I, q + y * TILE)
    return broadcast(0.5) * (along + across)


@njit(**BARE_CHUNK)
def book(n, force, moment, stored, n_history, I, O):  # noqa: E741
    """Replace the friction loss that the laws of n contacts booked by that of the mean force.

    `force`, `moment`, `stored`: columns of the history with the force, the moment and the energy of the springs; moment -1: the
    scene has none.
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
    """Do the same for n contacts that opened within the step: their loss goes to law_output.DISSIPATED."""
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
    """Load the last forces and moments, if any, of the dashpots of n contacts over their velocities."""
    old = I[(law_input.HISTORY + place) * TILE :]
    for q in range(n):
        p = np.uint64(q)
        I[p + law_input.NORMAL_VELOCITY * TILE], I[p + law_input.VELOCITY_X * TILE], I[p + law_input.VELOCITY_Y * TILE] = (
            unpack_triple(old[p])
        )
    if moment:
        old, to = I[(law_input.HISTORY + place + 1) * TILE :], I[(law_input.HISTORY + n_history) * TILE :]
        for q in range(n):
            p = np.uint64(q)
            to[p + rolling_input.RATE_X * TILE], to[p + rolling_input.RATE_Y * TILE], _ = unpack_triple(old[p])


@njit(**BARE_CHUNK)
def store_dashpot_forces(n, place, moment, n_history, O):  # noqa: E741
    """Store the forces and, if any, the moments of the dashpots of n contacts in the history."""
    new, behind = O[(law_output.HISTORY + place) * TILE :], O[(law_output.HISTORY + n_history) * TILE :]
    for q in range(n):
        p = np.uint64(q)
        x, y = behind[p + rolling_output.VISCOUS_X * TILE], behind[p + rolling_output.VISCOUS_Y * TILE]
        new[p] = pack_triple(behind[p + rolling_output.VISCOUS_NORMAL * TILE], x, y)
    if moment:
        for q in range(n):
            p = np.uint64(q)
            x, y = behind[p + rolling_output.VISCOUS_MOMENT_X * TILE], behind[p + rolling_output.VISCOUS_MOMENT_Y * TILE]
            new[p + TILE] = pack_triple(x, y, 0.0)


@njit(**BARE_CHUNK)
def book_dashpots(n, place, n_history, dt, I, O, G):  # noqa: E741
    """Write the energy that the dashpots of n contacts dissipate into law_output.DASHPOT_POWER [J].

    Also stores their forces. `place`: column of the history with the force, packed into one number (`packed_triple`); the moment,
    if any, is in the next column.
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
    """Return the energy that the dashpots of n contacts dissipated in the step in which they opened [J]."""
    for h in range(rolling_output.VISCOUS_NORMAL, rolling_output.VISCOUS_MOMENT_Y + 1):
        for q in range(n):
            O[q + (law_output.HISTORY + n_history + h) * TILE] = 0.0
    book_dashpots(n, place, n_history, dt, I, O, G)
    total = 0.0
    for q in range(n):
        total += O[q + law_output.DASHPOT_POWER * TILE]
    return total
