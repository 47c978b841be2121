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
from thirdbody.kernels.implicit.accept_pairs import (
    accept_pairs,
    ends_of,
    pair_overlap,
    pair_work_errors,
    pair_wrench,
    partner_point,
)
from thirdbody.kernels.implicit.contact import NOWHERE, ZERO_TENSOR, Side, contact_of, cross, dot, owner_side
from thirdbody.kernels.implicit.correction_limits import AT_LIMIT, BACK, OVERLAP_GROWTH
from thirdbody.kernels.implicit.curved import add_curved
from thirdbody.kernels.implicit.jacobian import give_springs, tangents_at
from thirdbody.kernels.implicit.residual import contact_point, depth_at, frame_of, law_at, scale_slip, vector_at
from thirdbody.kernels.implicit.tables import step_contacts, step_settings, step_start
from thirdbody.kernels.implicit.workspace import (
    ACCEPT,
    ERRORS,
    FREEDOMS,
    GATHER,
    LIMIT,
    PART,
    START,
    TANGENTS,
    island_at,
    pair_at,
    pair_tile,
    space_at,
    tile_count,
)
from thirdbody.kernels.rolling_kinematics import gather_rolling
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output, rolling_input
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
        n, slots, tile = tile_count(t, m), scratch.pair_slots[t], pair_tile(t, scratch)
        for e in range(n, n + SPARE):
            slots[e] = slots[n - 1]  # read ahead
        gather_pair_contacts(n, slots, context, tile)
        pair_geometry(n, motion.dt, box, tile)
        transport_frames(n, motion.dt, tile)
        slip_increment(n, motion.dt, tile)
        for q in range(n):
            finish_gathering(q, slots[q], motion, context, island, scratch, tile)
    return m


@njit(**BARE)
def finish_gathering(q, k, motion, context, island, scratch, tile):
    """Gather the rotation of contact q, candidate k, and scale its slip where it closes within the step."""
    _, _, a, b = ends_of(k, context, island)
    if context.rolling > 0:
        gather_rolling(q, k, context, motion, tile)
    now = scratch.starts[a, step_start.NOW] + scratch.starts[b, step_start.NOW]
    at, before = (law_input.HISTORY + context.n_history) * TILE + q, context.initial_overlaps[k]
    tile.inputs[at + rolling_input.INVERSE_DT * TILE] = 0.5 * now / motion.dt
    tile.inputs[at + rolling_input.MOVED * TILE] = depth_at(q, context, tile.inputs) - before
    scale_slip(q, before, context, tile.inputs)


@njit(**BARE_CHUNK)
def add_pair_forces(context, island, m, scratch):
    """Evaluate the laws for the m contacts between bodies; add their forces to the residuals of both."""
    for t in range((m + TILE - 1) // TILE):
        n, slots, tile = tile_count(t, m), scratch.pair_slots[t], pair_tile(t, scratch)
        law_at(context.law)(tile.inputs, tile.outputs, n, context.pairs)
        for q in range(n):
            _, _, a, b = ends_of(slots[q], context, island)
            f, torque, back = pair_wrench(q, slots[q], context, tile)
            r_a, r_b = space_at(a, scratch).residual, space_at(b, scratch).residual
            per_a = 1.0 / scratch.starts[a, step_start.ARM]
            per_b = 1.0 / scratch.starts[b, step_start.ARM]
            for d in range(3):
                r_a[d] += f[d]
                r_b[d] -= f[d]
                r_a[3 + d] += torque[d] * per_a
                r_b[3 + d] += back[d] * per_b
            observe_pair(q, slots[q], context, tile, scratch.diagnostics[a])
            observe_pair(q, slots[q], context, tile, scratch.diagnostics[b])


@njit(**BARE)
def observe_pair(q, k, context, tile, diagnostics):
    """Add contact q, candidate k, to the maxima and to the sum of normal forces of one of its bodies (`step_contacts`)."""
    I, O, S = tile.inputs, tile.outputs, context.S  # noqa: E741
    overlap = I[law_input.OVERLAP * TILE + q]
    radius = min(S[context.own[k], sphere.RADIUS], S[context.partner[k], sphere.RADIUS])
    diagnostics[step_contacts.NORMAL_FORCE] += abs(O[law_output.NORMAL_FORCE * TILE + q])
    diagnostics[step_contacts.MAX_OVERLAP] = max(diagnostics[step_contacts.MAX_OVERLAP], overlap)
    diagnostics[step_contacts.MAX_RADIUS] = max(diagnostics[step_contacts.MAX_RADIUS], O[law_output.CONTACT_RADIUS * TILE + q])
    if overlap > diagnostics[step_contacts.MAX_RATIO] * radius:
        diagnostics[step_contacts.MAX_RATIO], diagnostics[step_contacts.SLOT] = overlap / radius, k


@njit(**BARE)
def moved(a, point, scratch):
    """Return the displacement (3,) [m] by the correction of a point of the body at position a."""
    x, per_arm = space_at(a, scratch).correction, 1.0 / scratch.starts[a, step_start.ARM]
    return (
        x[0] + (x[4] * point[2] - x[5] * point[1]) * per_arm,
        x[1] + (x[5] * point[0] - x[3] * point[2]) * per_arm,
        x[2] + (x[3] * point[1] - x[4] * point[0]) * per_arm,
    )


@njit(**BARE)
def minus(a, b):
    """Return the difference of two vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(**BARE)
def arm_of(i, S):
    """Return the centre of sphere i from the centre of mass of its body [m]."""
    return S[i, sphere.ARM], S[i, sphere.ARM + 1], S[i, sphere.ARM + 2]


@njit(**BARE_CHUNK)
def limit_pair_overlaps(context, island, fraction, scratch):
    """Return the fraction, at most `fraction`, of the correction for which no pair sinks in too far."""
    expected, box = context.settings[step_settings.EXPECTED_OVERLAP], box_of(context.D)
    for e in range(island.n_pairs):
        k = pair_at(e, island)
        i, j, a, b = ends_of(k, context, island)
        overlap, n = pair_overlap(k, context, box)
        relative = minus(moved(a, arm_of(i, context.S), scratch), moved(b, arm_of(j, context.S), scratch))
        deepest = min(scratch.diagnostics[a, step_contacts.MAX_OVERLAP], scratch.diagnostics[b, step_contacts.MAX_OVERLAP])
        change, margin = -dot(n, relative), OVERLAP_GROWTH * max(expected, deepest) + max(-overlap, 0.0)
        if change * fraction > margin:
            fraction = margin / change
    return fraction


@njit(**BARE_CHUNK)
def limit_pair_reversal(context, island, m, fraction, scratch):
    """Return the fraction, at most `fraction`, of the correction that reverses no slip (`limit_slip_reversal`)."""
    for t in range((m + TILE - 1) // TILE):
        n, slots, tile = tile_count(t, m), scratch.pair_slots[t], pair_tile(t, scratch)
        I, O, G = tile.inputs, tile.outputs, tile.geometry  # noqa: E741
        for q in range(n):
            limit = O[law_output.FRICTION_LIMIT * TILE + q]
            t_x, t_y = O[law_output.TANGENTIAL_X * TILE + q], O[law_output.TANGENTIAL_Y * TILE + q]
            if t_x * t_x + t_y * t_y < AT_LIMIT * limit * limit:
                continue
            i, j, a, b = ends_of(slots[q], context, island)
            one = moved(a, contact_point(q, i, context.S, G), scratch)
            relative = minus(one, moved(b, partner_point(q, j, context.S, G), scratch))
            s_x, s_y = I[law_input.SLIP_X * TILE + q], I[law_input.SLIP_Y * TILE + q]
            (_, e, g), size = frame_of(q, G), math.sqrt(s_x * s_x + s_y * s_y)
            back = -(dot(relative, e) * s_x + dot(relative, g) * s_y)
            margin = size * (size + BACK * O[law_output.CRITICAL_SLIP * TILE + q])
            if back * fraction > margin > 0.0:
                fraction = margin / back
    return fraction


@njit(**BARE)
def pair_lands(context, m, scratch):
    """Return whether one of the m contacts between bodies closed within the step."""
    for p in range(m):
        if context.initial_overlaps[scratch.pair_slots[p // TILE, p % TILE]] < 0.0:
            return True
    return False


@njit(**BARE)
def turn_of_normals(m, scratch):
    """Return the largest angle [rad] by which the normal of one of the m contacts between bodies turns in half a step."""
    square = 0.0
    for p in range(m):
        q, G = p % TILE, scratch.pair_geometry[p // TILE]
        x, y, z = cross(vector_at(q, geometry.NORMAL, G), vector_at(q, geometry.MID_NORMAL, G))
        square = max(square, x * x + y * y + z * z)
    return math.sqrt(square)


@njit(**BARE)
def bend_between(i, j, overlap, n, S):
    """Return how the normal n of two spheres turns with their relative displacement, a symmetric tensor [1/m]."""
    c, (x, y, z) = 1.0 / (S[i, sphere.RADIUS] + S[j, sphere.RADIUS] - overlap), n
    return c * (1.0 - x * x), c * (1.0 - y * y), c * (1.0 - z * z), -c * x * y, -c * x * z, -c * y * z


@njit(**BARE_CHUNK)
def add_tangents(m, dt, context, island, scratch):
    """Add the m contacts between bodies to the band."""
    S, w = context.S, np.int64(island.half_width)
    for t in range((m + TILE - 1) // TILE):
        n, slots, tile = tile_count(t, m), scratch.pair_slots[t], pair_tile(t, scratch)
        give_springs(n, context, tile)
        tangents_at(context.tangents)(tile.inputs, tile.tangents, n, context.pairs)
        for q in range(n):
            k, G = slots[q], tile.geometry
            i, j, a, b = ends_of(k, context, island)
            sides = (
                owner_side(q, i, FREEDOMS * a, 1.0 / scratch.starts[a, step_start.ARM], S, G),
                Side(
                    FREEDOMS * b, -1, 1.0 / scratch.starts[b, step_start.ARM], arm_of(j, S), partner_point(q, j, S, G),
                    G[q + geometry.PARTNER_ARM * TILE],
                ),
            )  # fmt: skip
            bend = bend_between(i, j, tile.inputs[law_input.OVERLAP * TILE + q], vector_at(q, geometry.NORMAL, G), S)
            contact = contact_of(q, context.initial_overlaps[k], dt, sides, (bend, NOWHERE, ZERO_TENSOR), context, tile)
            add_curved(contact, scratch.band, 3 * w, w)


@entry(PART, **POINTED, **NO_COUNTS)
def pairs_part(stage, h, _, m, motion, context, islands, scratch):
    """Do what a stage of a step requires for the contacts between the bodies of island h, m of them once they are gathered."""
    island = island_at(h, islands)
    if stage == START:
        box = box_of(context.D)
        for e in range(island.n_pairs):
            k = pair_at(e, island)
            context.initial_overlaps[k] = pair_overlap(k, context, box)[0] + box.reach
    elif stage == GATHER:
        m = gather_pairs(context, island, motion, scratch)
        add_pair_forces(context, island, m, scratch)
        scratch.answer[0] = m
    elif stage == TANGENTS:
        add_tangents(m, motion.dt, context, island, scratch)
    elif stage == LIMIT:
        fraction = limit_pair_overlaps(context, island, scratch.answer[0], scratch)
        scratch.answer[0] = limit_pair_reversal(context, island, m, fraction, scratch)
    elif stage == ERRORS:
        scratch.answer[0], scratch.answer[1] = turn_of_normals(m, scratch), 1.0 if pair_lands(context, m, scratch) else 0.0
        if context.force >= 0:
            pair_work_errors(context, island, m, motion, scratch)
    elif stage == ACCEPT:
        accept_pairs(context, island, m, motion, scratch)
