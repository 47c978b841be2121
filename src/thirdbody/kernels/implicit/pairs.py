"""Contacts between the bodies of an island in an implicit step: the part `pairs_part` of a step (`workspace.PART`).

Its answers: the number of contacts at TRIAL; the largest fraction of the correction, given and returned, at LIMIT; the
largest angle by which a normal turns in half a step, and whether a contact closed, at ERRORS.

Each body gets half of what friction and dashpots dissipate in a contact. What the forces of a contact do on its two bodies, less
the energy that it stores and dissipates, is the loss of the integrator (`accept_step.update_ledger`); each body gets the part
that it has in that work. Work that a contact hands on from one body to the other is that of the mean of its forces at both ends
of the step: else what rolling bodies exchange would count as lost by one and created by the other.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK, NO_COUNTS, POINTED, entry
from thirdbody.kernels.books import normal_loss_of
from thirdbody.kernels.contact_geometry import SPARE, gather_pair_contacts, pair_overlap, slip_increment, transport_frames
from thirdbody.kernels.explicit.contact_forces import BODY_FRACTION
from thirdbody.kernels.implicit import books, contact, newton
from thirdbody.kernels.implicit.contact import NOWHERE, contact_point, cross, dot, vector_at
from thirdbody.kernels.implicit.jacobian import add_general, give_springs, tangents_at
from thirdbody.kernels.implicit.residual import complete_contact, law_at, observe_contact
from thirdbody.kernels.implicit.workspace import FREEDOMS, PART, STAGE, body_at, island_at, pair_at, pair_tile, space_at
from thirdbody.kernels.plates import is_closed, three
from thirdbody.kernels.rolling_kinematics import has_moments, has_twist
from thirdbody.kernels.step_tables import step_contacts, step_memory, step_settings, step_start
from thirdbody.kernels.tables import body, body_extra, record, run_totals, sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output
from thirdbody.kernels.vectors import box_of


@njit(**BARE)
def ends_of(k, context, island):
    """Return the spheres of candidate k, owner and partner, and the positions of their bodies in the island."""
    i, j = context.own[k], context.partner[k]
    return i, j, island.all.position[context.body[i]], island.all.position[context.body[j]]


@njit(**BARE)
def partner_point(q, j, S, G):
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
    S, G, moment = context.S, tile.geometry, contact.contact_moment(q, context, tile) if has_moments(context) else NOWHERE
    point, partner = contact_point(q, context.own[k], S, G), partner_point(q, context.partner[k], S, G)
    return wrench_of(contact.contact_force(q, tile), point, partner, moment, context)


@njit(**BARE_CHUNK)
def evaluate_pairs(context, island, motion, scratch):
    """Evaluate the contacts of the island between bodies; add their forces to both residuals, torques over the arms as there.
    Return their number."""
    m, S, box = np.int64(0), context.S, box_of(context.D)
    for e in range(island.n_pairs):
        k = pair_at(e, island)
        if pair_overlap(k, context, box)[0] + box.reach > 0.0:
            scratch.pair_slots[m // TILE, m % TILE] = k
            m += 1
    for t in range((m + TILE - 1) // TILE):
        (tile, n), slots = pair_tile(t, m, scratch), scratch.pair_slots[t]
        for e in range(n, n + SPARE):
            slots[e] = slots[n - 1]  # read ahead
        gather_pair_contacts(n, slots, motion.dt, box, context, tile)
        transport_frames(n, motion.dt, tile)
        slip_increment(n, motion.dt, tile)
        for q in range(n):
            _, _, a, b = ends_of(slots[q], context, island)
            weight = 0.5 * (scratch.starts[a, step_start.NOW] + scratch.starts[b, step_start.NOW])
            complete_contact(q, slots[q], weight, motion, context, tile)
        law_at(context.law)(tile.inputs, tile.outputs, n, context.pairs)
        for q in range(n):
            i, j, a, b = ends_of(slots[q], context, island)
            f, torque, back = pair_wrench(q, slots[q], context, tile)
            r_a, r_b = space_at(a, scratch).residual, space_at(b, scratch).residual
            per_a, per_b = 1.0 / scratch.starts[a, step_start.ARM], 1.0 / scratch.starts[b, step_start.ARM]
            for d in range(3):
                r_a[d] += f[d]
                r_b[d] -= f[d]
                r_a[3 + d] += torque[d] * per_a
                r_b[3 + d] += back[d] * per_b
            for c in (a, b):
                observe_contact(q, slots[q], min(S[i, sphere.RADIUS], S[j, sphere.RADIUS]), tile, scratch.diagnostics[c])
    return m


@njit(**BARE)
def relative_move(a, point, b, other_point, scratch):
    one, other = space_at(a, scratch).correction, space_at(b, scratch).correction
    per_a, per_b = 1.0 / scratch.starts[a, step_start.ARM], 1.0 / scratch.starts[b, step_start.ARM]
    moved, behind = newton.displacement(one, per_a, point, False), newton.displacement(other, per_b, other_point, False)
    return contact.difference(moved, behind)


@njit(**BARE_CHUNK)
def limit_pairs(context, island, m, fraction, scratch):
    S, expected, box = context.S, context.settings[step_settings.EXPECTED_OVERLAP], box_of(context.D)
    for e in range(island.n_pairs):
        k = pair_at(e, island)
        i, j, a, b = ends_of(k, context, island)
        overlap, n = pair_overlap(k, context, box)
        relative = relative_move(a, three(S, i, sphere.ARM), b, three(S, j, sphere.ARM), scratch)
        deepest = min(scratch.diagnostics[a, step_contacts.MAX_OVERLAP], scratch.diagnostics[b, step_contacts.MAX_OVERLAP])
        change, margin = -dot(n, relative), newton.OVERLAP_GROWTH * max(expected, deepest) + max(-overlap, 0.0)
        if change * fraction > margin:
            fraction = margin / change
    for t in range((m + TILE - 1) // TILE):
        (tile, many), G = pair_tile(t, m, scratch), scratch.pair_geometry[t]
        for q in range(many):
            if newton.is_slipping(q, tile.outputs):
                i, j, a, b = ends_of(tile.slots[q], context, island)
                relative = relative_move(a, contact_point(q, i, S, G), b, partner_point(q, j, S, G), scratch)
                fraction = newton.limit_reversal(q, relative, fraction, tile)
    return fraction


@njit(**BARE_CHUNK)
def add_tangents(m, dt, context, island, scratch):
    S, w = context.S, np.int64(island.half_width)
    for t in range((m + TILE - 1) // TILE):
        (tile, n), G = pair_tile(t, m, scratch), scratch.pair_geometry[t]
        give_springs(n, context, tile)
        tangents_at(context.tangents)(tile.inputs, tile.tangents, n, context.pairs)
        for q in range(n):
            k = tile.slots[q]
            i, j, a, b = ends_of(k, context, island)
            per_a, per_b = 1.0 / scratch.starts[a, step_start.ARM], 1.0 / scratch.starts[b, step_start.ARM]
            centre, point, arm = three(S, j, sphere.ARM), partner_point(q, j, S, G), G[q + geometry.PARTNER_ARM * TILE]
            sides = contact.owner_side(q, i, FREEDOMS * a, per_a, S, G), contact.Side(FREEDOMS * b, -1, per_b, centre, point, arm)
            # the normal turns with the displacement: (1 - nn)/D
            x, y, z = vector_at(q, geometry.NORMAL, G)
            c = 1.0 / (S[i, sphere.RADIUS] + S[j, sphere.RADIUS] - tile.inputs[law_input.OVERLAP * TILE + q])
            bend = c * (1.0 - x * x), c * (1.0 - y * y), c * (1.0 - z * z), -c * x * y, -c * x * z, -c * y * z
            shape = bend, NOWHERE, contact.ZERO_TENSOR
            add_general(contact.contact_of(q, dt, sides, shape, context, tile), scratch.band, 3 * w, w)


@njit(**BARE_CHUNK)
def pair_work_errors(context, island, m, motion, scratch):
    for a in range(island.n):
        scratch.errors[a, 0], scratch.errors[a, 1] = 0.0, 0.0
    p = np.int64(0)
    for e in range(island.n_pairs):
        k = pair_at(e, island)
        _, _, a, b = ends_of(k, context, island)
        error, stored = 0.0, 0.0
        if p < m and scratch.pair_slots[p // TILE, p % TILE] == k:
            q, (tile, _) = p % TILE, pair_tile(p // TILE, m, scratch)
            error = books.contact_difference(q, context, tile)
            stored = books.storable_energy(q, tile)
            p += 1
        elif is_closed(k, context.H):
            error = abs(books.opening_work(k, context, motion))
        for c in (a, b):
            scratch.errors[c, 0] += error
            scratch.errors[c, 1] += stored


@njit(**BARE)
def works_on(a, b, wrench, scratch):
    """Return the works [J] in the step of a force on the body at position a, its opposite on that at b, and a torque on each."""
    (f, torque, back), y, z = wrench, space_at(a, scratch).y, space_at(b, scratch).y
    per_a, per_b = 1.0 / scratch.starts[a, step_start.ARM], 1.0 / scratch.starts[b, step_start.ARM]
    on_a = dot(f, (y[0], y[1], y[2])) + dot(torque, (y[3], y[4], y[5])) * per_a
    return on_a, dot((-f[0], -f[1], -f[2]), (z[0], z[1], z[2])) + dot(back, (z[3], z[4], z[5])) * per_b


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
    A = context.totals[b]
    A[run_totals.FRICTION_WORK] += BODY_FRACTION * friction
    A[run_totals.DAMPING_WORK] += BODY_FRACTION * damped
    A[run_totals.NUMERICAL_LOSS] += lost
    context.B[b, body.FRICTION_WORK] += BODY_FRACTION * friction


@njit(**BARE_CHUNK)
def accept_pairs(context, island, m, motion, scratch):
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
            friction, damped = books.end_at(context.end_contact)(k, smooth, motion, context)
            lost = 0.5 * (-(mean_a + mean_b) - gained - friction - damped)
            add_losses(body_at(a, island), friction, damped, lost + mean_a, context)
            add_losses(body_at(b, island), friction, damped, lost + mean_b, context)
    for t in range((m + TILE - 1) // TILE):
        tile, n = pair_tile(t, m, scratch)
        books.book_at(context.book_contacts)(n, smooth, motion.dt, context, tile)
        for q in range(n):
            (_, _, a, b), O, B = ends_of(tile.slots[q], context, island), tile.outputs, context.B  # noqa: E741
            wrench, b_i, b_j = pair_wrench(q, tile.slots[q], context, tile), body_at(a, island), body_at(b, island)
            mean_a, mean_b = works_of_old(tile.slots[q], a, b, context, scratch)
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
                T[step_memory.MAX_ENERGY] = max(T[step_memory.MAX_ENERGY], books.storable_energy(q, tile))
        books.write_at(context.write_contacts)(n, motion, context, tile)


@entry(PART, **POINTED, **NO_COUNTS)
def pairs_part(stage, h, _, m, motion, context, islands, scratch):
    island = island_at(h, islands)
    if stage == STAGE.START:
        for e in range(island.n_pairs):
            k, box = pair_at(e, island), box_of(context.D)
            context.start_depths[k] = pair_overlap(k, context, box)[0] + box.reach
    elif stage == STAGE.TRIAL:
        scratch.answer[0] = evaluate_pairs(context, island, motion, scratch)
    elif stage == STAGE.TANGENTS:
        add_tangents(m, motion.dt, context, island, scratch)
    elif stage == STAGE.LIMIT:
        scratch.answer[0] = limit_pairs(context, island, m, scratch.answer[0], scratch)
    elif stage == STAGE.ERRORS:
        square, scratch.answer[1] = 0.0, 0.0
        for p in range(m):
            q, G = p % TILE, scratch.pair_geometry[p // TILE]
            x, y, z = cross(vector_at(q, geometry.NORMAL, G), vector_at(q, geometry.MID_NORMAL, G))
            square = max(square, x * x + y * y + z * z)
            if context.start_depths[scratch.pair_slots[p // TILE, q]] < 0.0:
                scratch.answer[1] = 1.0
        scratch.answer[0] = math.sqrt(square)
        if context.force >= 0:
            pair_work_errors(context, island, m, motion, scratch)
    elif stage == STAGE.ACCEPT:
        accept_pairs(context, island, m, motion, scratch)
