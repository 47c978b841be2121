"""Contacts between the bodies of an island in an implicit step: the part `pairs_part` of a step (`workspace.PART`).

A contact acts on the body of its owner with a force, and on that of its partner with the opposite one. Geometry, slip and history
are those of the explicit integrator (`contact_geometry`). Its answers: the number of contacts after GATHER; the largest fraction
of the correction, given and returned, at LIMIT; the largest angle by which a normal turns in half a step, and whether a contact
closed, at ERRORS.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK, NO_COUNTS, POINTED, entry
from thirdbody.kernels.contact_geometry import SPARE, gather_pair_contacts, pair_geometry, slip_increment, transport_frames
from thirdbody.kernels.implicit import accept_pairs as accept
from thirdbody.kernels.implicit import newton
from thirdbody.kernels.implicit.accept_pairs import ends_of, pair_overlap, partner_point
from thirdbody.kernels.implicit.contact import (
    NOWHERE,
    ZERO_TENSOR,
    Side,
    add_curved,
    contact_of,
    contact_point,
    cross,
    difference,
    dot,
    owner_side,
    vector_at,
)
from thirdbody.kernels.implicit.jacobian import give_springs, tangents_at
from thirdbody.kernels.implicit.residual import complete_contact, law_at, observe_contact
from thirdbody.kernels.implicit.tables import step_contacts, step_settings, step_start
from thirdbody.kernels.implicit.workspace import FREEDOMS, PART, STAGE, island_at, pair_at, pair_tile, space_at
from thirdbody.kernels.plates import three
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.tile import TILE, geometry, law_input
from thirdbody.kernels.vectors import box_of


@njit(**BARE_CHUNK)
def gather_pairs(context, island, motion, scratch):
    """Gather the contacts of the island between bodies into tiles; return their number."""
    m, box = np.int64(0), box_of(context.D)
    for e in range(island.n_pairs):
        k = pair_at(e, island)
        if pair_overlap(k, context, box)[0] + box.reach > 0.0:
            scratch.pair_slots[m // TILE, m % TILE] = k
            m += 1
    for t in range((m + TILE - 1) // TILE):
        (tile, n), slots = pair_tile(t, m, scratch), scratch.pair_slots[t]
        for e in range(n, n + SPARE):
            slots[e] = slots[n - 1]  # read ahead
        gather_pair_contacts(n, slots, context, tile)
        pair_geometry(n, motion.dt, box, tile)
        transport_frames(n, motion.dt, tile)
        slip_increment(n, motion.dt, tile)
        for q in range(n):
            _, _, a, b = ends_of(slots[q], context, island)
            weight = 0.5 * (scratch.starts[a, step_start.NOW] + scratch.starts[b, step_start.NOW])
            complete_contact(q, slots[q], context.initial_overlaps[slots[q]], weight, motion, context, tile)
    return m


@njit(**BARE_CHUNK)
def add_pair_forces(context, island, m, scratch):
    """Evaluate the laws for the m contacts between bodies; add their forces to the residuals of both."""
    for t in range((m + TILE - 1) // TILE):
        (tile, n), S = pair_tile(t, m, scratch), context.S
        law_at(context.law)(tile.inputs, tile.outputs, n, context.pairs)
        for q in range(n):
            k = tile.slots[q]
            i, j, a, b = ends_of(k, context, island)
            f, torque, back = accept.pair_wrench(q, k, context, tile)
            r_a, r_b = space_at(a, scratch).residual, space_at(b, scratch).residual
            per_a, per_b = 1.0 / scratch.starts[a, step_start.ARM], 1.0 / scratch.starts[b, step_start.ARM]
            for d in range(3):
                r_a[d] += f[d]
                r_b[d] -= f[d]
                r_a[3 + d] += torque[d] * per_a
                r_b[3 + d] += back[d] * per_b
            for c in (a, b):
                radius = min(S[i, sphere.RADIUS], S[j, sphere.RADIUS])
                observe_contact(q, k, radius, tile, scratch.diagnostics[c])


@njit(**BARE)
def relative_move(a, point, b, partner_point, scratch):
    """Return the displacement (3,) [m] by the correction of a point of the body at position a relative to one of that at b."""
    one, other = space_at(a, scratch).correction, space_at(b, scratch).correction
    per_a, per_b = 1.0 / scratch.starts[a, step_start.ARM], 1.0 / scratch.starts[b, step_start.ARM]
    moved, behind = newton.displacement(one, per_a, point, False), newton.displacement(other, per_b, partner_point, False)
    return difference(moved, behind)


@njit(**BARE_CHUNK)
def limit_pair_overlaps(context, island, fraction, scratch):
    """Return the fraction, at most `fraction`, of the correction for which no pair sinks in too far."""
    expected, box = context.settings[step_settings.EXPECTED_OVERLAP], box_of(context.D)
    for e in range(island.n_pairs):
        k = pair_at(e, island)
        i, j, a, b = ends_of(k, context, island)
        overlap, n = pair_overlap(k, context, box)
        relative = relative_move(a, three(context.S, i, sphere.ARM), b, three(context.S, j, sphere.ARM), scratch)
        deepest = min(scratch.diagnostics[a, step_contacts.MAX_OVERLAP], scratch.diagnostics[b, step_contacts.MAX_OVERLAP])
        change, margin = -dot(n, relative), newton.OVERLAP_GROWTH * max(expected, deepest) + max(-overlap, 0.0)
        if change * fraction > margin:
            fraction = margin / change
    return fraction


@njit(**BARE_CHUNK)
def limit_pair_reversal(context, island, m, fraction, scratch):
    """Return the fraction, at most `fraction`, of the correction that reverses no slip (`newton.limit_reversal`)."""
    S = context.S
    for t in range((m + TILE - 1) // TILE):
        tile, n = pair_tile(t, m, scratch)
        for q in range(n):
            if newton.is_slipping(q, tile.outputs):
                (i, j, a, b), G = ends_of(tile.slots[q], context, island), tile.geometry
                relative = relative_move(a, contact_point(q, i, S, G), b, partner_point(q, j, S, G), scratch)
                fraction = newton.limit_reversal(q, relative, fraction, tile)
    return fraction


@njit(**BARE)
def turn_of_normals(m, scratch):
    """Return the largest angle [rad] by which the normal of one of the m contacts between bodies turns in half a step."""
    square = 0.0
    for p in range(m):
        q, G = p % TILE, scratch.pair_geometry[p // TILE]
        x, y, z = cross(vector_at(q, geometry.NORMAL, G), vector_at(q, geometry.MID_NORMAL, G))
        square = max(square, x * x + y * y + z * z)
    return math.sqrt(square)


@njit(**BARE_CHUNK)
def add_tangents(m, dt, context, island, scratch):
    """Add the m contacts between bodies to the band."""
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
            sides = owner_side(q, i, FREEDOMS * a, per_a, S, G), Side(FREEDOMS * b, -1, per_b, centre, point, arm)
            # the normal turns with the displacement: (1 - nn)/D
            x, y, z = vector_at(q, geometry.NORMAL, G)
            c = 1.0 / (S[i, sphere.RADIUS] + S[j, sphere.RADIUS] - tile.inputs[law_input.OVERLAP * TILE + q])
            bend = c * (1.0 - x * x), c * (1.0 - y * y), c * (1.0 - z * z), -c * x * y, -c * x * z, -c * y * z
            contact = contact_of(q, context.initial_overlaps[k], dt, sides, (bend, NOWHERE, ZERO_TENSOR), context, tile)
            add_curved(contact, scratch.band, 3 * w, w)


@entry(PART, **POINTED, **NO_COUNTS)
def pairs_part(stage, h, _, m, motion, context, islands, scratch):
    """Do what a stage of a step requires for the contacts between the bodies of island h, m of them once they are gathered."""
    island = island_at(h, islands)
    if stage == STAGE.START:
        for e in range(island.n_pairs):
            k, box = pair_at(e, island), box_of(context.D)
            context.initial_overlaps[k] = pair_overlap(k, context, box)[0] + box.reach
    elif stage == STAGE.GATHER:
        m = gather_pairs(context, island, motion, scratch)
        add_pair_forces(context, island, m, scratch)
        scratch.answer[0] = m
    elif stage == STAGE.TANGENTS:
        add_tangents(m, motion.dt, context, island, scratch)
    elif stage == STAGE.LIMIT:
        fraction = limit_pair_overlaps(context, island, scratch.answer[0], scratch)
        scratch.answer[0] = limit_pair_reversal(context, island, m, fraction, scratch)
    elif stage == STAGE.ERRORS:
        scratch.answer[0], scratch.answer[1] = turn_of_normals(m, scratch), 0.0
        for p in range(m):
            if context.initial_overlaps[scratch.pair_slots[p // TILE, p % TILE]] < 0.0:
                scratch.answer[1] = 1.0
        if context.force >= 0:
            accept.pair_work_errors(context, island, m, motion, scratch)
    elif stage == STAGE.ACCEPT:
        accept.accept_pairs(context, island, m, motion, scratch)
