"""Dissipation by friction and dashpots of contacts in a step of velocity Verlet; parts of it serve implicit steps, too.

A law books the work of the force at the end of the step. Bodies that move by velocity Verlet exchange the work of the mean of the
forces at both ends: where a force jumps within a step, an error of first order. So here friction dissipates the work of the mean
force less the change of the energy in the springs. A step in which that is negative creates energy: it counts as zero, and the
energy remains visible as residual. Only laws whose force (or moment) is in their history can be booked so.

Dashpots dissipate the work of the mean of their forces, which follow the history of the laws; negative work counts as zero, too:
else the energy that an unstable step creates would be hidden from the guard.

Losses of normal laws, per body: the history has what the law has dissipated since the contact closed, in `context.loss_column`.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import LANES, broadcast, clamp_below, get, put
from thirdbody.kernels.plates import is_plate
from thirdbody.kernels.rolling_kinematics import has_twist
from thirdbody.kernels.tables import body_extra, remote_force
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output, rolling_input, rolling_output

POWER = 0x7FF << 52  # bits of the power of two of a number
FIELD, SIGN = (1 << 17) - 1, 1 << 16  # bits of one of the three, and that of its sign
ROUND = 1.5 * 2.0**37  # the last bit of a number of this size is 2^-15: adding it rounds a number to a multiple of that

WHOLE, ZERO = (1023 + 37) << 52, 2.0**37 + 2.0
"""Bits of 2^37, and the number whose field is that of zero with its sign inverted."""

SMALLEST = 1e-280  # largest of three numbers that all count as zero, so that every power of two has a reciprocal
ROUNDING = 1.0 + 2.0**-16  # factor that raises the power of two of numbers that round to the next one


@njit(**BARE)
def bits_of(x):
    return np.float64(x).view(np.int64)


@njit(**BARE)
def number_of(bits):
    return np.int64(bits).view(np.float64)


@njit(**BARE)
def pack_triple(x, y, z):
    power = bits_of(max(max(abs(x), abs(y)), max(abs(z), SMALLEST)) * ROUNDING) & POWER
    fraction = number_of((2046 << 52) - power)  # one over the power of two
    a, b, c = bits_of(x * fraction + ROUND) & FIELD, bits_of(y * fraction + ROUND) & FIELD, bits_of(z * fraction + ROUND) & FIELD
    return number_of(power | (a << 34) | (b << 17) | c)


@njit(**BARE)
def one_of(bits, power):
    return (number_of((bits & FIELD ^ SIGN) | WHOLE) - ZERO) * power


@njit(**BARE)
def unpack_triple(one):
    bits = bits_of(one)
    power = number_of(bits & POWER)
    return one_of(bits >> 34, power), one_of(bits >> 17, power), one_of(bits, power)


@njit(**BARE)
def normal_loss_of(q, column, tile):
    return tile.outputs[(law_output.HISTORY + column) * TILE + q] - tile.inputs[(law_input.HISTORY + column) * TILE + q]


@njit(**BARE_CHUNK)
def add_normal_losses(n, slots, context, tile):
    """Add the losses of the contacts slots[:n] to their bodies, to each half; in another group to its row of F."""
    E, body_of = context.E, context.body
    for q in range(n):
        k, work = np.int64(slots[q]), normal_loss_of(q, context.loss_column, tile)
        i, j = context.own[k], context.partner[k]
        part = work if is_plate(j) else 0.5 * work
        E[body_of[i], body_extra.NORMAL_LOSS] += part
        if context.outer[k] >= 0:
            context.F[context.outer[k], remote_force.NORMAL_LOSS] = part
        elif not is_plate(j):
            E[body_of[j], body_extra.NORMAL_LOSS] += part


@njit(**BARE)
def work_of_sum(q, old, new, x, tile):
    """Return the work [J], at elements q to q + 3, of the sum of a field of the inputs and one of the outputs along another."""
    return (get(tile.inputs, q + old * TILE) + get(tile.outputs, q + new * TILE)) * get(tile.inputs, q + x * TILE)


@njit(**BARE)
def work_of_mean(q, old, new, x, tile):
    """Return the work [J] of the mean of two vectors of two fields each, from `old` and `new` on, along one from x on."""
    return broadcast(0.5) * (work_of_sum(q, old, new, x, tile) + work_of_sum(q, old + 1, new + 1, x + 1, tile))


@njit(**BARE_CHUNK)
def book(n, context, tile):
    """Replace the friction loss that the laws of n contacts booked by that of the mean force; moment, twist -1: none."""
    I, O, moment, twist = tile.inputs, tile.outputs, context.moment, context.twist  # noqa: E741
    old, new = law_input.HISTORY + context.force, law_output.HISTORY + context.force
    for q in range(0, n, LANES):
        work = work_of_mean(q, old, new, np.int64(law_input.SLIP_X), tile)
        dissipated = get(I, q + (law_input.HISTORY + context.stored) * TILE) - work
        if moment >= 0:
            rotation = law_input.HISTORY + context.n_history + rolling_input.ROTATION_X
            dissipated = dissipated - work_of_mean(q, law_input.HISTORY + moment, law_output.HISTORY + moment, rotation, tile)
        if twist >= 0:
            rotation = law_input.HISTORY + context.n_history + rolling_input.TWIST
            work = work_of_sum(q, law_input.HISTORY + twist, law_output.HISTORY + twist, rotation, tile)
            dissipated = dissipated - broadcast(0.5) * work
        dissipated = clamp_below(dissipated - get(O, q + law_output.STORED_TANGENTIAL * TILE), 0.0)
        booked = get(O, q + law_output.DISSIPATED * TILE)
        put(O, q + law_output.DISSIPATED * TILE, booked + (dissipated - get(O, q + law_output.FRICTION_LOSS * TILE)))


@njit(**BARE)
def book_opened(n, context, tile):
    O, force, moment = tile.outputs, law_output.HISTORY + context.force, law_output.HISTORY + max(context.moment, 0)  # noqa: E741
    twist = law_output.HISTORY + max(context.twist, 0)
    for q in range(n):
        O[q + law_output.DISSIPATED * TILE], O[q + law_output.FRICTION_LOSS * TILE] = 0.0, 0.0
        O[q + law_output.STORED_TANGENTIAL * TILE], O[q + twist * TILE] = 0.0, 0.0
        for k in range(2):
            O[q + (force + k) * TILE], O[q + (moment + k) * TILE] = 0.0, 0.0
    book(n, context, tile)


@njit(**BARE_CHUNK)
def store_dashpot_forces(n, context, O):  # noqa: E741
    new, behind = O[(law_output.HISTORY + context.dashpots) * TILE :], O[(law_output.HISTORY + context.n_history) * TILE :]
    for q in range(n):
        p = np.uint64(q)
        x, y = behind[p + rolling_output.VISCOUS_X * TILE], behind[p + rolling_output.VISCOUS_Y * TILE]
        new[p] = pack_triple(behind[p + rolling_output.VISCOUS_NORMAL * TILE], x, y)
    if has_dashpot_moments(context):
        for q in range(n):
            p = np.uint64(q)
            x, y = behind[p + rolling_output.VISCOUS_MOMENT_X * TILE], behind[p + rolling_output.VISCOUS_MOMENT_Y * TILE]
            twist = behind[p + rolling_output.VISCOUS_TWIST * TILE] if has_twist(context) else 0.0
            new[p + TILE] = pack_triple(x, y, twist)


@njit(**BARE)
def has_dashpot_moments(context):
    return context.n_history >= context.dashpots + 2


@njit(**BARE)
def separation_rate(q, G):
    n, v = q + geometry.MID_NORMAL * TILE, q + geometry.MID_VELOCITY * TILE
    x, y, z = get(G, n), get(G, n + TILE), get(G, n + 2 * TILE)
    return get(G, v) * x + get(G, v + TILE) * y + get(G, v + 2 * TILE) * z


@njit(**BARE_CHUNK)
def book_dashpots(n, dt, context, tile):
    """Write the energy that the dashpots of n contacts dissipate into law_output.DASHPOT_POWER [J]; store their forces."""
    I, O, half = tile.inputs, tile.outputs, broadcast(0.5 * dt)  # noqa: E741
    behind, rotation = law_output.HISTORY + context.n_history, law_input.HISTORY + context.n_history
    old = I[(law_input.HISTORY + context.dashpots) * TILE :]
    for q in range(n):  # the last forces and moments, over the velocities
        p = np.uint64(q)
        I[p + law_input.NORMAL_VELOCITY * TILE], I[p + law_input.VELOCITY_X * TILE], I[p + law_input.VELOCITY_Y * TILE] = (
            unpack_triple(old[p])
        )
    if has_dashpot_moments(context):
        last, to = I[(law_input.HISTORY + context.dashpots + 1) * TILE :], I[rotation * TILE :]
        for q in range(n):
            p = np.uint64(q)
            to[p + rolling_input.RATE_X * TILE], to[p + rolling_input.RATE_Y * TILE], twist = unpack_triple(last[p])
            if has_twist(context):
                to[p + rolling_input.TWIST_RATE * TILE] = twist
    for q in range(0, n, LANES):
        force = get(I, q + law_input.NORMAL_VELOCITY * TILE) + get(O, q + (behind + rolling_output.VISCOUS_NORMAL) * TILE)
        velocity, slip = np.int64(law_input.VELOCITY_X), np.int64(law_input.SLIP_X)
        across = work_of_mean(q, velocity, behind + rolling_output.VISCOUS_X, slip, tile)
        work = half * force * separation_rate(q, tile.geometry) + across
        if has_dashpot_moments(context):
            rate, moment = rotation + rolling_input.RATE_X, behind + rolling_output.VISCOUS_MOMENT_X
            work = work + work_of_mean(q, rate, moment, rotation + rolling_input.ROTATION_X, tile)
        if has_twist(context):
            rate, moment = rotation + rolling_input.TWIST_RATE, behind + rolling_output.VISCOUS_TWIST
            work = work + broadcast(0.5) * work_of_sum(q, rate, moment, rotation + rolling_input.TWIST, tile)
        put(O, q + law_output.DASHPOT_POWER * TILE, clamp_below(broadcast(0.0) - work, 0.0))
    store_dashpot_forces(n, context, O)


@njit(**BARE)
def book_opened_dashpots(n, dt, context, tile):
    O, behind = tile.outputs, law_output.HISTORY + context.n_history  # noqa: E741
    for q in range(n):
        for h in range(rolling_output.VISCOUS_NORMAL, rolling_output.VISCOUS_MOMENT_Y + 1):
            O[q + (behind + h) * TILE] = 0.0
        if has_twist(context):
            O[q + (behind + rolling_output.VISCOUS_TWIST) * TILE] = 0.0
    book_dashpots(n, dt, context, tile)
    total = 0.0
    for q in range(n):
        total += O[q + law_output.DASHPOT_POWER * TILE]
    return total
