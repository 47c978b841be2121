"""Contacts between the bodies of an island in an implicit step: gathering, forces, and limits on corrections.

A contact acts on the body of its owner with a force, and on that of its partner with the opposite one. Geometry, slip and history
are those of the explicit integrator (`contact_geometry`).
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.contact_geometry import SPARE, gather_pair_contacts, pair_geometry, slip_increment, transport_frames
from thirdbody.kernels.implicit.island_bundles import pair_tile, tile_count
from thirdbody.kernels.implicit.newton import AT_LIMIT, BACK, OVERLAP_GROWTH
from thirdbody.kernels.implicit.residual import (
    closed_fraction,
    contact_force,
    contact_moment,
    contact_point,
    depth_at,
    frame_of,
    law_at,
    scale_slip,
    vector_at,
)
from thirdbody.kernels.implicit.tables import step_contacts, step_settings, step_start
from thirdbody.kernels.implicit.vector_algebra import cross, dot
from thirdbody.kernels.periodic import image
from thirdbody.kernels.rolling_kinematics import gather_rolling, has_moments
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output, rolling_input


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
    return i, j, island.position[context.body[i]], island.position[context.body[j]]


@njit(**BARE)
def save_pair_overlaps(context, island):
    """Save the overlaps of all candidates of the island at the start of a step (`initial_overlaps`)."""
    for e in range(island.pairs.shape[0]):
        k = island.pairs[e]
        context.initial_overlaps[k] = pair_overlap(k, context, island.box)[0] + island.box.reach


@njit(**BARE_CHUNK)
def gather_pairs(context, island, motion, pool):
    """Gather the contacts of the island between bodies into tiles; return their number."""
    m = np.int64(0)
    for e in range(island.pairs.shape[0]):
        k = island.pairs[e]
        if pair_overlap(k, context, island.box)[0] + island.box.reach > 0.0:
            pool.pair_slots[m // TILE, m % TILE] = k
            m += 1
    for t in range((m + TILE - 1) // TILE):
        n, slots, tile = tile_count(t, m), pool.pair_slots[t], pair_tile(t, pool)
        for e in range(n, n + SPARE):
            slots[e] = slots[n - 1]  # read ahead
        gather_pair_contacts(n, slots, context, tile)
        pair_geometry(n, motion.dt, island.box, tile)
        transport_frames(n, motion.dt, tile)
        slip_increment(n, motion.dt, tile)
        for q in range(n):
            finish_gathering(q, slots[q], context, island, motion, tile)
    return m


@njit(**BARE)
def finish_gathering(q, k, context, island, motion, tile):
    """Gather the rotation of contact q, candidate k, and scale its slip where it closes within the step."""
    _, _, a, b = ends_of(k, context, island)
    if context.rolling > 0:
        gather_rolling(q, k, context, motion, tile)
    now = context.starts[island.bodies[a], step_start.NOW] + context.starts[island.bodies[b], step_start.NOW]
    at, before = (law_input.HISTORY + context.n_history) * TILE + q, context.initial_overlaps[k]
    tile.inputs[at + rolling_input.INVERSE_DT * TILE] = 0.5 * now / motion.dt
    tile.inputs[at + rolling_input.MOVED * TILE] = depth_at(q, context, tile.inputs) - before
    scale_slip(q, before, context, tile.inputs)


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


@njit(**BARE_CHUNK)
def add_pair_forces(context, island, m, pool):
    """Evaluate the laws for the m contacts between bodies; add their forces to the residuals of both."""
    for t in range((m + TILE - 1) // TILE):
        n, slots, tile = tile_count(t, m), pool.pair_slots[t], pair_tile(t, pool)
        law_at(context.law)(tile.inputs, tile.outputs, n, context.pairs)
        for q in range(n):
            _, _, a, b = ends_of(slots[q], context, island)
            f, torque, back = pair_wrench(q, slots[q], context, tile)
            r_a, r_b = pool.coordinates[a, 2], pool.coordinates[b, 2]
            arm_a = 1.0 / context.starts[island.bodies[a], step_start.ARM]
            arm_b = 1.0 / context.starts[island.bodies[b], step_start.ARM]
            for d in range(3):
                r_a[d] += f[d]
                r_b[d] -= f[d]
                r_a[3 + d] += torque[d] * arm_a
                r_b[3 + d] += back[d] * arm_b
            observe_pair(q, slots[q], context, tile, pool.diagnostics[a])
            observe_pair(q, slots[q], context, tile, pool.diagnostics[b])


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
def moved(a, point, context, island, pool):
    """Return the displacement (3,) [m] by the correction of a point of the body at position a."""
    x, arm = pool.coordinates[a, 3], 1.0 / context.starts[island.bodies[a], step_start.ARM]
    return (
        x[0] + (x[4] * point[2] - x[5] * point[1]) * arm,
        x[1] + (x[5] * point[0] - x[3] * point[2]) * arm,
        x[2] + (x[3] * point[1] - x[4] * point[0]) * arm,
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
def limit_pair_overlaps(context, island, fraction, pool):
    """Return the fraction, at most `fraction`, of the correction for which no pair sinks in too far (`newton`)."""
    expected = context.settings[step_settings.EXPECTED_OVERLAP]
    for e in range(island.pairs.shape[0]):
        k = island.pairs[e]
        i, j, a, b = ends_of(k, context, island)
        overlap, n = pair_overlap(k, context, island.box)
        relative = minus(
            moved(a, arm_of(i, context.S), context, island, pool), moved(b, arm_of(j, context.S), context, island, pool)
        )
        deepest = min(pool.diagnostics[a, step_contacts.MAX_OVERLAP], pool.diagnostics[b, step_contacts.MAX_OVERLAP])
        change, margin = -dot(n, relative), OVERLAP_GROWTH * max(expected, deepest) + max(-overlap, 0.0)
        if change * fraction > margin:
            fraction = margin / change
    return fraction


@njit(**BARE_CHUNK)
def limit_pair_reversal(context, island, m, fraction, pool):
    """Return the fraction, at most `fraction`, of the correction that reverses no slip (`newton.limit_slip_reversal`)."""
    for t in range((m + TILE - 1) // TILE):
        n, slots, tile = tile_count(t, m), pool.pair_slots[t], pair_tile(t, pool)
        I, O, G = tile.inputs, tile.outputs, tile.geometry  # noqa: E741
        for q in range(n):
            limit = O[law_output.FRICTION_LIMIT * TILE + q]
            t_x, t_y = O[law_output.TANGENTIAL_X * TILE + q], O[law_output.TANGENTIAL_Y * TILE + q]
            if t_x * t_x + t_y * t_y < AT_LIMIT * limit * limit:
                continue
            i, j, a, b = ends_of(slots[q], context, island)
            one = moved(a, contact_point(q, i, context.S, G), context, island, pool)
            relative = minus(one, moved(b, partner_point(q, j, context.S, G), context, island, pool))
            s_x, s_y = I[law_input.SLIP_X * TILE + q], I[law_input.SLIP_Y * TILE + q]
            (_, e, g), size = frame_of(q, G), math.sqrt(s_x * s_x + s_y * s_y)
            back = -(dot(relative, e) * s_x + dot(relative, g) * s_y)
            margin = size * (size + BACK * O[law_output.CRITICAL_SLIP * TILE + q])
            if back * fraction > margin > 0.0:
                fraction = margin / back
    return fraction


@njit(**BARE)
def pair_lands(context, m, pool):
    """Return whether one of the m contacts between bodies closed within the step."""
    for p in range(m):
        if context.initial_overlaps[pool.pair_slots[p // TILE, p % TILE]] < 0.0:
            return True
    return False


@njit(**BARE)
def turn_of_normals(m, pool):
    """Return the largest angle [rad] by which the normal of one of the m contacts between bodies turns in half a step."""
    square = 0.0
    for p in range(m):
        q, G = p % TILE, pool.pair_geometry[p // TILE]
        x, y, z = cross(vector_at(q, geometry.NORMAL, G), vector_at(q, geometry.MID_NORMAL, G))
        square = max(square, x * x + y * y + z * z)
    return math.sqrt(square)


@njit(**BARE)
def closed_part(q, k, context, tile):
    """Return the fraction of the step in which contact q, candidate k, was closed."""
    return closed_fraction(q, context.initial_overlaps[k], context, tile.inputs)
