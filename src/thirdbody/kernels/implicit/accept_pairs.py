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
from thirdbody.kernels.explicit.contact_forces import BODY_FRACTION
from thirdbody.kernels.implicit.books import book_at, end_at, write_at
from thirdbody.kernels.implicit.contact import cross
from thirdbody.kernels.implicit.residual import contact_force, contact_moment, contact_point, vector_at
from thirdbody.kernels.implicit.tables import step_memory, step_start
from thirdbody.kernels.implicit.work import contact_difference, contact_energy, opening_work
from thirdbody.kernels.implicit.workspace import body_at, pair_at, pair_tile, space_at, tile_count
from thirdbody.kernels.plates import is_closed, surface_velocity
from thirdbody.kernels.rolling_kinematics import has_moments, has_twist
from thirdbody.kernels.tables import body, body_extra, record, run_totals, sphere
from thirdbody.kernels.tile import TILE, geometry, law_output
from thirdbody.kernels.vectors import box_of, image


@njit(**BARE)
def pair_overlap(k, context, box):
    """Return the overlap of candidate k, a pair of spheres [m], negative: a gap; and the unit normal from partner to owner."""
    S, i, j = context.S, context.own[k], context.partner[k]
    x = image(S[i, sphere.X] - S[j, sphere.X], box.length_x, box.inverse_x)
    y = image(S[i, sphere.Y] - S[j, sphere.Y], box.length_y, box.inverse_y)
    z = S[i, sphere.Z] - S[j, sphere.Z]
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
def pair_wrench(q, k, context, tile):
    """Return the force of contact q on its owner [N], and its torques on the bodies of owner and partner [N m]."""
    i, j, S, G = context.own[k], context.partner[k], context.S, tile.geometry
    f = contact_force(q, tile)
    x, y, z = cross(contact_point(q, i, S, G), f)
    u, v, w = cross(f, partner_point(q, j, S, G))
    if has_moments(context):
        m_x, m_y, m_z = contact_moment(q, context, tile)
        x, y, z, u, v, w = x + m_x, y + m_y, z + m_z, u - m_x, v - m_y, w - m_z
    return f, (x, y, z), (u, v, w)


@njit(**BARE)
def pair_opening_work(k, context, motion):
    """Return the `opening_work` [J] of candidate k."""
    S, j, contact = context.S, context.partner[k], pair_overlap(k, context, box_of(context.D))
    s, (n_x, n_y, n_z), columns = S[j, sphere.RADIUS], contact[1], (np.int64(sphere.MID_VELOCITY), np.int64(sphere.MID_SPIN))
    u = surface_velocity(j, S, columns, (s * n_x, s * n_y, s * n_z))
    return opening_work(k, context.initial_overlaps[k], contact, u, context, motion.dt)


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
            q, tile = p % TILE, pair_tile(p // TILE, scratch)
            error = contact_difference(q, context.initial_overlaps[k], context, tile)
            stored = contact_energy(q, tile)
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
    return (
        force[0] * y[0] + force[1] * y[1] + force[2] * y[2] + (torque[0] * y[3] + torque[1] * y[4] + torque[2] * y[5]) * per_arm
    )


@njit(**BARE)
def works_on(a, b, wrench, scratch):
    """Return the works [J] in the step of a force on body a and its opposite on body b, with a torque on each."""
    f, torque, back = wrench
    work_a = work_on(a, f, torque, scratch)
    return work_a, work_on(b, (-f[0], -f[1], -f[2]), back, scratch)


@njit(**BARE)
def works_of_old(k, context, island, scratch):
    """Return the works [J] in the step of the last force of candidate k on both bodies; 0 where it was open."""
    if not is_closed(k, context.H):
        return 0.0, 0.0
    (_, _, a, b), R = ends_of(k, context, island), context.R
    n, n_x, n_y, n_z = R[k, record.NORMAL_FORCE], R[k, record.NORMAL], R[k, record.NORMAL + 1], R[k, record.NORMAL + 2]
    t = record.TANGENTIAL_FORCE
    f = (n * n_x + R[k, t], n * n_y + R[k, t + 1], n * n_z + R[k, t + 2])
    x, y, z = cross((R[k, record.POINT], R[k, record.POINT + 1], R[k, record.POINT + 2]), f)
    arm = (R[k, record.PARTNER_POINT], R[k, record.PARTNER_POINT + 1], R[k, record.PARTNER_POINT + 2])
    u, v, w = cross(f, arm)
    if has_moments(context):
        m_x, m_y, m_z = R[k, record.MOMENT], R[k, record.MOMENT + 1], R[k, record.MOMENT + 2]
        if has_twist(context):
            twist = R[k, record.TWIST_MOMENT]
            m_x, m_y, m_z = m_x + twist * n_x, m_y + twist * n_y, m_z + twist * n_z
        x, y, z, u, v, w = x + m_x, y + m_y, z + m_z, u - m_x, v - m_y, w - m_z
    return works_on(a, b, (f, (x, y, z), (u, v, w)), scratch)


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
def accept_closed(p, k, context, island, scratch, smooth):
    """Add contact p, candidate k, to both bodies. `smooth`: see `accept_pairs`."""
    (_, _, a, b), tile = ends_of(k, context, island), pair_tile(p // TILE, scratch)
    q, b_i, b_j, O = p % TILE, body_at(a, island), body_at(b, island), tile.outputs  # noqa: E741
    f, torque, back = pair_wrench(q, k, context, tile)
    (mean_a, mean_b), weight = works_of_old(k, context, island, scratch), 0.5 if smooth else 0.0
    end_a, end_b = works_on(a, b, (f, torque, back), scratch)
    mean_a, mean_b = weight * mean_a + (1.0 - weight) * end_a, weight * mean_b + (1.0 - weight) * end_b
    part = abs(mean_a) / max(abs(mean_a) + abs(mean_b), 1e-300)
    friction, damped = O[law_output.DISSIPATED * TILE + q], O[law_output.DASHPOT_POWER * TILE + q]
    gained = O[law_output.STORED_NORMAL * TILE + q] + O[law_output.STORED_TANGENTIAL * TILE + q] - stored_energy(k, context)
    lost = -(mean_a + mean_b) - gained - friction - damped
    add_losses(b_i, friction, damped, part * lost + mean_a - end_a, context)
    add_losses(b_j, friction, damped, (1.0 - part) * lost + mean_b - end_b, context)
    add_wrench(b_i, 1.0, f, torque, context.B)
    add_wrench(b_j, -1.0, f, back, context.B)
    if context.loss_column >= 0:
        for owner in (b_i, b_j):
            context.E[owner, body_extra.NORMAL_LOSS] += BODY_FRACTION * normal_loss_of(q, context.loss_column, tile)
    context.B[b_i, body.SLIP_DISTANCE] += O[law_output.SLIP * TILE + q]
    context.B[b_j, body.SLIP_DISTANCE] += O[law_output.SLIP * TILE + q]
    for c in (b_i, b_j):
        T = context.memory[c]
        T[step_memory.MAX_ENERGY] = max(T[step_memory.MAX_ENERGY], contact_energy(q, tile))


@njit(**BARE_CHUNK)
def accept_pairs(context, island, m, motion, scratch):
    """Accept the m contacts between bodies, after the step of the bodies themselves was accepted."""
    smooth, p = True, np.int64(0)
    for a in range(island.n):  # forces jump on no body: what is dissipated is the work of their mean (`work.weight_of_old`)
        smooth = smooth and scratch.starts[a, step_start.OLD_WEIGHT] > 0.0
    weight = 0.5 if smooth else 0.0
    for e in range(island.n_pairs):
        k = pair_at(e, island)
        if p < m and scratch.pair_slots[p // TILE, p % TILE] == k:
            p += 1
        elif is_closed(k, context.H):
            _, _, a, b = ends_of(k, context, island)
            mean_a, mean_b = works_of_old(k, context, island, scratch)
            mean_a, mean_b, gained = weight * mean_a, weight * mean_b, -stored_energy(k, context)
            dragged = pair_opening_work(k, context, motion) if smooth and context.force >= 0 else 0.0
            friction, damped = end_at(context.end_contact)(k, context.initial_overlaps[k], dragged, smooth, context)
            lost = 0.5 * (-(mean_a + mean_b) - gained - friction - damped)
            add_losses(body_at(a, island), friction, damped, lost + mean_a, context)
            add_losses(body_at(b, island), friction, damped, lost + mean_b, context)
    for t in range((m + TILE - 1) // TILE):
        n, tile = tile_count(t, m), pair_tile(t, scratch)
        book_at(context.book_contacts)(n, context.initial_overlaps, np.int64(0), smooth, motion.dt, context, tile)
        for q in range(n):
            accept_closed(t * TILE + q, tile.slots[q], context, island, scratch, smooth)
        write_at(context.write_contacts)(n, motion, context, tile)
