"""Contacts between the bodies of an island in an accepted step: history, records, work, energy; and the error of their friction.

Each body gets half of what friction and dashpots dissipate in a contact. What the forces of a contact do on its two bodies, less
the energy that it stores and dissipates, is the loss of the integrator (`accept_step.update_ledger`); each body gets the part
that it has in that work.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.columns import (
    body,
    contact_state,
    law_output,
    record,
    run_totals,
    sphere,
    step_memory,
    step_settings,
    step_start,
)
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.contact_history import reset_history, store_history
from thirdbody.kernels.explicit.contact_dissipation import book
from thirdbody.kernels.explicit.contact_forces import write_record
from thirdbody.kernels.explicit.contact_tiles import BODY_FRACTION
from thirdbody.kernels.implicit.accept_step import unbooked_energy
from thirdbody.kernels.implicit.friction_work import FLOOR, contact_difference, contact_energy, energy_scale, work_error_of_plates
from thirdbody.kernels.implicit.island_bundles import active_at, pair_tile, space_at, tile_count
from thirdbody.kernels.implicit.pair_contacts import ends_of, pair_overlap, pair_wrench
from thirdbody.kernels.implicit.residual import mean_velocity_factor
from thirdbody.kernels.predicates import is_closed
from thirdbody.kernels.surface_velocity import surface_velocity


@njit(**BARE)
def pair_opening_work(k, context, motion, box):
    """Return the slip work [J] of the tangential spring of candidate k, which opens within the step (`opening_work`)."""
    S, H, i, j = context.S, context.H, context.own[k], context.partner[k]
    overlap, (n_x, n_y, n_z) = pair_overlap(k, context, box)
    columns, r, s = (np.int64(sphere.MID_VELOCITY), np.int64(sphere.MID_SPIN)), S[i, sphere.RADIUS], S[j, sphere.RADIUS]
    v = surface_velocity(i, S, columns, (-r * n_x, -r * n_y, -r * n_z))
    u = surface_velocity(j, S, columns, (s * n_x, s * n_y, s * n_z))
    f_1, f_2 = H[k, contact_state.LAW + context.force], H[k, contact_state.LAW + context.force + 1]
    e_x, e_y, e_z = H[k, contact_state.AXIS], H[k, contact_state.AXIS + 1], H[k, contact_state.AXIS + 2]
    f_x = f_1 * e_x + f_2 * (n_y * e_z - n_z * e_y)
    f_y = f_1 * e_y + f_2 * (n_z * e_x - n_x * e_z)
    f_z = f_1 * e_z + f_2 * (n_x * e_y - n_y * e_x)
    before = context.initial_overlaps[k]
    fraction = before / max(before - overlap, 1e-300)
    return -0.5 * fraction * motion.dt * (f_x * (v[0] - u[0]) + f_y * (v[1] - u[1]) + f_z * (v[2] - u[2]))


@njit(**BARE_CHUNK)
def pair_work_errors(context, island, m, motion, pool):
    """Write the errors of the friction work of m contacts between bodies, and the energy that they can store, to both bodies."""
    for a in range(island.bodies.shape[0]):
        pool.errors[a, 0], pool.errors[a, 1] = 0.0, 0.0
    p = np.int64(0)
    for e in range(island.pairs.shape[0]):
        k = island.pairs[e]
        _, _, a, b = ends_of(k, context, island)
        error, stored = 0.0, 0.0
        if p < m and pool.pair_slots[p // TILE, p % TILE] == k:
            q, tile = p % TILE, pair_tile(p // TILE, pool)
            error = contact_difference(q, context.initial_overlaps[k], context, tile)
            stored = contact_energy(q, tile)
            p += 1
        elif is_closed(k, context.H):
            error = abs(pair_opening_work(k, context, motion, island.box))
        for c in (a, b):
            pool.errors[c, 0] += error
            pool.errors[c, 1] += stored


@njit(**BARE_CHUNK)
def work_error_of_island(context, island, m, motion, pool):
    """Return the largest error of the friction work of a body over the tolerance (`friction_work.work_error`)."""
    if context.force < 0:
        return 0.0
    largest = 0.0
    pair_work_errors(context, island, m, motion, pool)
    for a in range(island.bodies.shape[0]):
        active, space = active_at(a, context, island), space_at(a, pool)
        error = work_error_of_plates(context, active, pool.counts[a], motion, space) + pool.errors[a, 0]
        scale = energy_scale(context, active, pool.counts[a], space) + FLOOR * pool.errors[a, 1]
        largest = max(largest, error / max(context.settings[step_settings.WORK] * scale, 1e-300))
    return largest


@njit(**BARE)
def work_on(a, force, torque, context, island, pool):
    """Return the work [J] in the step of a force and a torque on the body at position a."""
    y, arm = pool.coordinates[a, 0], 1.0 / context.starts[island.bodies[a], step_start.ARM]
    return force[0] * y[0] + force[1] * y[1] + force[2] * y[2] + (torque[0] * y[3] + torque[1] * y[4] + torque[2] * y[5]) * arm


@njit(**BARE)
def add_wrench(b, sign, force, torque, B):
    """Add `sign` times a force, and a torque, to those on body b."""
    for d in range(3):
        B[b, body.FORCE + d] += sign * force[d]
        B[b, body.TORQUE + d] += torque[d]


@njit(**BARE)
def add_losses(b, friction, damped, lost, context):
    """Add to the totals of a body its part of what friction and dashpots dissipated in a contact, and `lost` [J]."""
    A = context.totals[b]
    A[run_totals.FRICTION_WORK] += BODY_FRACTION * friction
    A[run_totals.DAMPING_WORK] += BODY_FRACTION * damped
    A[run_totals.NUMERICAL_LOSS] += lost
    context.B[b, body.FRICTION_WORK] += BODY_FRACTION * friction


@njit(**BARE)
def stored_energy(k, context):
    """Return the elastic energy of candidate k at its last record [J]; 0 where it was open."""
    return context.R[k, record.STORED_NORMAL] + context.R[k, record.STORED_TANGENTIAL] if is_closed(k, context.H) else 0.0


@njit(**BARE)
def pair_recoil(q, k, dt, context, tile):
    """Return the dashpot dissipation [J] of contact q, candidate k, that is about to open (`accept_step.recoil`); q -1: open."""
    R, O = context.R, tile.outputs  # noqa: E741
    if not is_closed(k, context.H) or R[k, record.NORMAL_FORCE] != 0.0:
        return 0.0
    if q < 0:
        return R[k, record.STORED_NORMAL]
    if O[law_output.NORMAL_FORCE * TILE + q] != 0.0:
        return 0.0
    power = O[law_output.DASHPOT_POWER * TILE + q] * mean_velocity_factor(q, dt, context.initial_overlaps[k], tile.inputs)
    return R[k, record.STORED_NORMAL] - O[law_output.STORED_NORMAL * TILE + q] - power * dt


@njit(**BARE)
def accept_closed(q, k, context, island, motion, pool, tile):
    """Book contact q, candidate k, on both bodies, and write its record; its history is stored afterwards.

    The tile has the friction loss that is booked.
    """
    i, j, a, b = ends_of(k, context, island)
    b_i, b_j, O, dt = island.bodies[a], island.bodies[b], tile.outputs, motion.dt  # noqa: E741
    f, torque, back = pair_wrench(q, k, context, tile)
    done_a = work_on(a, f, torque, context, island, pool)
    done_b = work_on(b, (-f[0], -f[1], -f[2]), back, context, island, pool)
    part = abs(done_a) / max(abs(done_a) + abs(done_b), 1e-300)
    power = O[law_output.DASHPOT_POWER * TILE + q] * mean_velocity_factor(q, dt, context.initial_overlaps[k], tile.inputs)
    damped, friction = power * dt + pair_recoil(q, k, dt, context, tile), O[law_output.DISSIPATED * TILE + q]
    gained = O[law_output.STORED_NORMAL * TILE + q] + O[law_output.STORED_TANGENTIAL * TILE + q] - stored_energy(k, context)
    lost = -(done_a + done_b) - gained - friction - damped
    add_losses(b_i, friction, damped, part * lost, context)
    add_losses(b_j, friction, damped, (1.0 - part) * lost, context)
    add_wrench(b_i, 1.0, f, torque, context.B)
    add_wrench(b_j, -1.0, f, back, context.B)
    context.B[b_i, body.SLIP_DISTANCE] += O[law_output.SLIP * TILE + q]
    context.B[b_j, body.SLIP_DISTANCE] += O[law_output.SLIP * TILE + q]
    write_record(q, k, context, motion, tile)


@njit(**BARE)
def accept_opened(k, of_mean, context, island, motion, tile):
    """End candidate k, which opened within the step, and book what it stored on both bodies."""
    _, _, a, b = ends_of(k, context, island)
    gained, damped = -stored_energy(k, context), pair_recoil(np.int64(-1), k, motion.dt, context, tile)
    dragged = pair_opening_work(k, context, motion, island.box) if of_mean else 0.0
    friction = max(reset_history(k, context) + dragged, 0.0)
    lost = 0.5 * (-gained - friction - damped)
    add_losses(island.bodies[a], friction, damped, lost, context)
    add_losses(island.bodies[b], friction, damped, lost, context)


@njit(**BARE)
def is_of_mean(context, island):
    """Return whether friction dissipates the work of the mean force of the step on all bodies (`friction_work.weight_of_old`)."""
    mean = context.force >= 0
    for a in range(island.bodies.shape[0]):
        mean = mean and context.starts[island.bodies[a], step_start.OLD_WEIGHT] > 0.0
    return mean


@njit(**BARE_CHUNK)
def accept_pairs(context, island, m, motion, pool):
    """Accept the m contacts between bodies, after the step of the bodies themselves was accepted."""
    of_mean, p = is_of_mean(context, island), np.int64(0)
    for e in range(island.pairs.shape[0]):
        k = island.pairs[e]
        if p < m and pool.pair_slots[p // TILE, p % TILE] == k:
            p += 1
        elif is_closed(k, context.H):
            accept_opened(k, of_mean, context, island, motion, pair_tile(np.int64(0), pool))
    for t in range((m + TILE - 1) // TILE):
        n, slots, tile = tile_count(t, m), pool.pair_slots[t], pair_tile(t, pool)
        if of_mean:
            book(n, context, tile)
        for q in range(0 if of_mean else n):
            tile.outputs[law_output.DISSIPATED * TILE + q] += unbooked_energy(q, slots[q], context, tile.outputs)
        for q in range(n):
            accept_closed(q, slots[q], context, island, motion, pool, tile)
        store_history(n, slots, context, tile)
        for q in range(n):
            remember_pair(q, slots[q], context, island, tile)


@njit(**BARE)
def remember_pair(q, k, context, island, tile):
    """Let both bodies remember the energy that contact q can store."""
    _, _, a, b = ends_of(k, context, island)
    energy = contact_energy(q, tile)
    for c in (a, b):
        T = context.memory[island.bodies[c]]
        T[step_memory.MAX_ENERGY] = max(T[step_memory.MAX_ENERGY], energy)
