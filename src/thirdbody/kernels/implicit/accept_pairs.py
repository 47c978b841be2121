"""Contacts between the bodies of an island in an accepted step: history, records, work, energy; and the error of their friction.

Each body gets half of what friction and dashpots dissipate in a contact. What the forces of a contact do on its two bodies, less
the energy that it stores and dissipates, is the loss of the integrator (`accept_step.update_ledger`); each body gets the part
that it has in that work. Work that a contact hands on from one body to the other is that of the mean of its forces at both ends
of the step, as is the work of the plates: else what rolling bodies exchange would count as lost by one and created by the other.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.books import normal_loss_of
from thirdbody.kernels.explicit.tiles import BODY_FRACTION
from thirdbody.kernels.implicit import books
from thirdbody.kernels.implicit.contact import (
    NOWHERE,
    contact_force,
    contact_moment,
    contact_point,
    cross,
    difference,
    dot,
    vector_at,
)
from thirdbody.kernels.implicit.tables import step_memory, step_start
from thirdbody.kernels.implicit.workspace import body_at, pair_at, pair_tile, space_at
from thirdbody.kernels.plates import centre, is_closed, surface_velocity, three
from thirdbody.kernels.rolling_kinematics import has_moments, has_twist
from thirdbody.kernels.tables import body, body_extra, record, run_totals, sphere
from thirdbody.kernels.tile import TILE, geometry, law_output
from thirdbody.kernels.vectors import box_of, image


@njit(**BARE)
def pair_overlap(k, context, box):
    """Return the overlap of candidate k, a pair of spheres [m], negative: a gap; and the unit normal from partner to owner."""
    S, i, j = context.S, context.own[k], context.partner[k]
    x, y, z = difference(centre(i, S), centre(j, S))
    x, y = image(x, box.length_x, box.inverse_x), image(y, box.length_y, box.inverse_y)
    distance = math.sqrt(x * x + y * y + z * z)
    inverse = 1.0 / max(distance, 1e-300)
    return S[i, sphere.RADIUS] + S[j, sphere.RADIUS] - distance, (x * inverse, y * inverse, z * inverse)


@njit(**BARE)
def ends_of(k, context, island):
    """Return the spheres of candidate k, owner and partner, and the positions of their bodies in the island."""
    i, j = context.own[k], context.partner[k]
    return i, j, island.all.position[context.body[i]], island.all.position[context.body[j]]


@njit(**BARE)
def partner_point(q, j, S, G):
    """Return the point of contact q on its partner, sphere j, from the centre of mass of the partner's body (3,) [m]."""
    n, a = vector_at(q, geometry.NORMAL, G), G[q + geometry.PARTNER_ARM * TILE]
    return S[j, sphere.ARM] + a * n[0], S[j, sphere.ARM + 1] + a * n[1], S[j, sphere.ARM + 2] + a * n[2]


@njit(**BARE)
def wrench_of(f, point, partner_point, moment, context):
    """Return a force f on the owner of a contact [N], and the torques on the bodies of owner and partner [N m]."""
    (x, y, z), (u, v, w) = cross(point, f), cross(f, partner_point)
    if has_moments(context):
        m_x, m_y, m_z = moment
        x, y, z, u, v, w = x + m_x, y + m_y, z + m_z, u - m_x, v - m_y, w - m_z
    return f, (x, y, z), (u, v, w)


@njit(**BARE)
def pair_wrench(q, k, context, tile):
    """Return the `wrench_of` contact q, candidate k."""
    S, G, moment = context.S, tile.geometry, contact_moment(q, context, tile) if has_moments(context) else NOWHERE
    point, partner = contact_point(q, context.own[k], S, G), partner_point(q, context.partner[k], S, G)
    return wrench_of(contact_force(q, tile), point, partner, moment, context)


@njit(**BARE)
def pair_opening_work(k, context, motion):
    """Return the `books.opening_work` [J] of candidate k."""
    S, j, contact = context.S, context.partner[k], pair_overlap(k, context, box_of(context.D))
    s, (n_x, n_y, n_z) = S[j, sphere.RADIUS], contact[1]
    u = surface_velocity(j, S, books.STEP_COLUMNS, (s * n_x, s * n_y, s * n_z))
    return books.opening_work(k, context.initial_overlaps[k], contact, u, context, motion.dt)


@njit(**BARE_CHUNK)
def pair_work_errors(context, island, m, motion, scratch):
    """Write the errors of the friction work of m contacts between bodies, and the energy that they can store, to both bodies."""
    for a in range(island.n):
        scratch.errors[a, 0], scratch.errors[a, 1] = 0.0, 0.0
    p = np.int64(0)
    for e in range(island.n_pairs):
        k = pair_at(e, island)
        _, _, a, b = ends_of(k, context, island)
        error, stored = 0.0, 0.0
        if p < m and scratch.pair_slots[p // TILE, p % TILE] == k:
            q, (tile, _) = p % TILE, pair_tile(p // TILE, m, scratch)
            error = books.contact_difference(q, context.initial_overlaps[k], context, tile)
            stored = books.contact_energy(q, tile)
            p += 1
        elif is_closed(k, context.H):
            error = abs(pair_opening_work(k, context, motion))
        for c in (a, b):
            scratch.errors[c, 0] += error
            scratch.errors[c, 1] += stored


@njit(**BARE)
def work_on(a, force, torque, scratch):
    """Return the work [J] in the step of a force and a torque on the body at position a."""
    y, per_arm = space_at(a, scratch).y, 1.0 / scratch.starts[a, step_start.ARM]
    return dot(force, (y[0], y[1], y[2])) + dot(torque, (y[3], y[4], y[5])) * per_arm


@njit(**BARE)
def works_on(a, b, wrench, scratch):
    """Return the works [J] in the step of a force on body a and its opposite on body b, with a torque on each."""
    f, torque, back = wrench
    return work_on(a, f, torque, scratch), work_on(b, (-f[0], -f[1], -f[2]), back, scratch)


@njit(**BARE)
def works_of_old(k, a, b, context, scratch):
    """Return the works [J] in the step of the last force of candidate k on both bodies; 0 where it was open."""
    if not is_closed(k, context.H):
        return 0.0, 0.0
    R, n, moment = context.R, context.R[k, record.NORMAL_FORCE], NOWHERE
    (n_x, n_y, n_z), (t_x, t_y, t_z) = three(R, k, record.NORMAL), three(R, k, record.TANGENTIAL_FORCE)
    if has_moments(context):
        moment = three(R, k, record.MOMENT)
        if has_twist(context):
            (m_x, m_y, m_z), twist = moment, R[k, record.TWIST_MOMENT]
            moment = m_x + twist * n_x, m_y + twist * n_y, m_z + twist * n_z
    f = n * n_x + t_x, n * n_y + t_y, n * n_z + t_z
    wrench = wrench_of(f, three(R, k, record.POINT), three(R, k, record.PARTNER_POINT), moment, context)
    return works_on(a, b, wrench, scratch)


@njit(**BARE)
def add_losses(b, friction, damped, lost, context):
    """Add to the totals of a body its part of what friction and dashpots dissipated in a contact, and `lost` [J]."""
    A = context.totals[b]
    A[run_totals.FRICTION_WORK] += BODY_FRACTION * friction
    A[run_totals.DAMPING_WORK] += BODY_FRACTION * damped
    A[run_totals.NUMERICAL_LOSS] += lost
    context.B[b, body.FRICTION_WORK] += BODY_FRACTION * friction


@njit(**BARE)
def accept_closed(q, tile, context, island, scratch, smooth):
    """Add contact q of a tile to both bodies. `smooth`: see `accept_pairs`."""
    (_, _, a, b), O, B = ends_of(tile.slots[q], context, island), tile.outputs, context.B  # noqa: E741
    wrench, b_i, b_j = pair_wrench(q, tile.slots[q], context, tile), body_at(a, island), body_at(b, island)
    (mean_a, mean_b), weight = works_of_old(tile.slots[q], a, b, context, scratch), 0.5 if smooth else 0.0
    end_a, end_b = works_on(a, b, wrench, scratch)
    mean_a, mean_b = weight * mean_a + (1.0 - weight) * end_a, weight * mean_b + (1.0 - weight) * end_b
    part = abs(mean_a) / max(abs(mean_a) + abs(mean_b), 1e-300)
    friction, damped = O[law_output.DISSIPATED * TILE + q], O[law_output.DASHPOT_POWER * TILE + q]
    stored = O[law_output.STORED_NORMAL * TILE + q] + O[law_output.STORED_TANGENTIAL * TILE + q]
    lost = -(mean_a + mean_b) - (stored - books.stored_energy(tile.slots[q], context)) - friction - damped
    add_losses(b_i, friction, damped, part * lost + mean_a - end_a, context)
    add_losses(b_j, friction, damped, (1.0 - part) * lost + mean_b - end_b, context)
    for c, sign, torque in ((b_i, 1.0, wrench[1]), (b_j, -1.0, wrench[2])):
        for d in range(3):
            B[c, body.FORCE + d] += sign * wrench[0][d]
            B[c, body.TORQUE + d] += torque[d]
        if context.loss_column >= 0:
            context.E[c, body_extra.NORMAL_LOSS] += BODY_FRACTION * normal_loss_of(q, context.loss_column, tile)
        B[c, body.SLIP_DISTANCE] += O[law_output.SLIP * TILE + q]
        T = context.memory[c]
        T[step_memory.MAX_ENERGY] = max(T[step_memory.MAX_ENERGY], books.contact_energy(q, tile))


@njit(**BARE_CHUNK)
def accept_pairs(context, island, m, motion, scratch):
    """Accept the m contacts between bodies, after the step of the bodies themselves was accepted."""
    smooth, p = True, np.int64(0)
    for a in range(island.n):  # forces jump on no body: what is dissipated is the work of their mean (`weight_of_old`)
        smooth = smooth and scratch.starts[a, step_start.OLD_WEIGHT] > 0.0
    weight = 0.5 if smooth else 0.0
    for e in range(island.n_pairs):
        k = pair_at(e, island)
        if p < m and scratch.pair_slots[p // TILE, p % TILE] == k:
            p += 1
        elif is_closed(k, context.H):
            _, _, a, b = ends_of(k, context, island)
            mean_a, mean_b = works_of_old(k, a, b, context, scratch)
            mean_a, mean_b, gained = weight * mean_a, weight * mean_b, -books.stored_energy(k, context)
            dragged = pair_opening_work(k, context, motion) if smooth and context.force >= 0 else 0.0
            friction, damped = books.end_at(context.end_contact)(k, context.initial_overlaps[k], dragged, smooth, context)
            lost = 0.5 * (-(mean_a + mean_b) - gained - friction - damped)
            add_losses(body_at(a, island), friction, damped, lost + mean_a, context)
            add_losses(body_at(b, island), friction, damped, lost + mean_b, context)
    for t in range((m + TILE - 1) // TILE):
        tile, n = pair_tile(t, m, scratch)
        books.book_at(context.book_contacts)(n, context.initial_overlaps, np.int64(0), smooth, motion.dt, context, tile)
        for q in range(n):
            accept_closed(q, tile, context, island, scratch, smooth)
        books.write_at(context.write_contacts)(n, motion, context, tile)
