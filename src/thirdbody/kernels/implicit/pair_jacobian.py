"""Jacobian of the residuals of an island: that of each body with its plates (`jacobian`), and its contacts with other bodies.

A contact between spheres i and j, of the bodies a and b, has the unit normal n from j to i and the axes e and g = n x e. It lies
at r_a = c_i - A_i n from the centre of mass of a, and at r_b = c_j + A_j n from that of b; c are the centres of the spheres,
A = R - overlap/2. It acts on a with the force f and the torque r_a x f + M, on b with -f and -r_b x f - M. If a moves by u and
turns by w, its sphere moves by c = u + w x c_i and its surface by s = u + w x r_a relative to b; for b both are negative:

    overlap and slip:   dd = -n.c             ds_1 = e.s      ds_2 = g.s
    normal:             dn = (c - n (n.c))/D  with the distance D = R_i + R_j - d
    frame:              turns by W = n x dn + (w.n/2) n: with the mean of the two spins about the normal
    slip in the frame:  ds_1 += S.(W x e)     ds_2 += S.(W x g)    with the displacement S of the step
    force:              df = dN n + dT_1 e + dT_2 g + W x f,       moment alike, with the relative rotation
    arms:               dr_a = w x c_i + dd n/2 - A_i dn           dr_b = w x c_j - dd n/2 + A_j dn

As in `jacobian`, this is exact at the start of a step; left out is what grows with rotations in the step.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.implicit.band_matrix import entry, row_length
from thirdbody.kernels.implicit.bundles import FREEDOMS
from thirdbody.kernels.implicit.island_bundles import active_at, pair_tile, space_at, tile_count
from thirdbody.kernels.implicit.jacobian import (
    NO_TANGENT,
    assemble_jacobian,
    give_springs,
    rolling_tangent_at,
    tangent_at,
    tangents_at,
    twist_tangent_at,
)
from thirdbody.kernels.implicit.pair_contacts import arm_of, closed_part, ends_of, partner_point
from thirdbody.kernels.implicit.residual import contact_force, contact_moment, contact_point, frame_of, vector_at
from thirdbody.kernels.implicit.tables import step_start
from thirdbody.kernels.implicit.vector_algebra import cross, dot, scaled_sum
from thirdbody.kernels.rolling_kinematics import has_moments, has_twist
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.tile import TILE, geometry, law_input

Vector = tuple[float, float, float]


class PairContact(NamedTuple):
    """A contact between bodies as the Jacobian sees it (notation of this module)."""

    frame: tuple[Vector, Vector, Vector]
    point: Vector
    """r_a"""
    partner_point: Vector
    """r_b"""
    arm: float
    partner_arm: float
    bend: float
    """1/D"""
    force: Vector
    moment: Vector
    displacement: Vector
    """Displacement of the step along the normal and the axes."""
    tangent: tuple[float, float, float, float, float, float, float]
    rolling: bool
    rolling_tangent: tuple[float, float, float, float, float, float]
    twist_tangent: tuple[float, float]
    rows: tuple[int, int]
    """First rows of both bodies in the system of equations."""
    scales: tuple[float, float]
    """One over the arms of both bodies [1/m]."""


@njit(**BARE)
def pair_contact(q, k, dt, context, island, tile):
    """Return contact q, candidate k, as a `PairContact`."""
    i, j, a, b = ends_of(k, context, island)
    S, G, fraction, frame = context.S, tile.geometry, closed_part(q, k, context, tile), frame_of(q, tile.geometry)
    rolling, overlap = has_moments(context), tile.inputs[law_input.OVERLAP * TILE + q]
    displacement = (
        dt * dot(vector_at(q, geometry.MID_VELOCITY, G), frame[0]),
        tile.inputs[law_input.SLIP_X * TILE + q] / fraction,
        tile.inputs[law_input.SLIP_Y * TILE + q] / fraction,
    )
    scales = (
        1.0 / context.starts[island.bodies[a], step_start.ARM], 1.0 / context.starts[island.bodies[b], step_start.ARM],
    )  # fmt: skip
    return PairContact(
        frame, contact_point(q, i, S, G), partner_point(q, j, S, G), G[q + geometry.ARM * TILE],
        G[q + geometry.PARTNER_ARM * TILE], 1.0 / (S[i, sphere.RADIUS] + S[j, sphere.RADIUS] - overlap), contact_force(q, tile),
        contact_moment(q, context, tile) if rolling else (0.0, 0.0, 0.0), displacement,
        tangent_at(q, context.initial_overlaps[k], context, tile), rolling,
        rolling_tangent_at(q, fraction, tile.tangents) if rolling else NO_TANGENT,
        twist_tangent_at(q, fraction, tile.tangents) if has_twist(context) else (0.0, 0.0), (FREEDOMS * a, FREEDOMS * b), scales,
    )  # fmt: skip


@njit(**BARE)
def unit(c):
    """Return the displacement and the rotation for a change of coordinate c of a body."""
    u = (1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0)
    return u, (1.0 if c == 3 else 0.0, 1.0 if c == 4 else 0.0, 1.0 if c == 5 else 0.0)


@njit(**BARE_CHUNK)
def add_pair_column(side, c, centre, contact, half_width, J):
    """Add the changes of forces and torques with coordinate c of the owner's (`side` 0) or the partner's body to J.

    `centre`: of the sphere, from the centre of mass of its body [m].
    """
    (n, e, g), f, sign = contact.frame, contact.force, 1.0 - 2.0 * side
    u, w = unit(c)
    swing, point = cross(w, centre), contact.point if side == 0 else contact.partner_point
    moved, surface = scaled_sum(sign, u, sign, swing, 0.0, u), scaled_sum(sign, u, sign, cross(w, point), 0.0, u)
    d, along = -dot(n, moved), dot(n, moved)
    dn = scaled_sum(contact.bend, moved, -contact.bend * along, n, 0.0, n)
    turn = scaled_sum(1.0, cross(n, dn), 0.5 * dot(w, n), n, 0.0, n)
    s_n, s_1, s_2 = contact.displacement
    total = scaled_sum(s_n, n, s_1, e, s_2, g)
    s_1, s_2 = dot(e, surface) + dot(total, cross(turn, e)), dot(g, surface) + dot(total, cross(turn, g))
    k_n, xx, xy, yx, yy, xd, yd = contact.tangent
    df = scaled_sum(k_n * d, n, xx * s_1 + xy * s_2 + xd * d, e, yx * s_1 + yy * s_2 + yd * d, g)
    df = scaled_sum(1.0, df, 1.0, cross(turn, f), 0.0, f)
    dr = scaled_sum(1.0 - side, swing, 0.5 * d, n, -contact.arm, dn)
    dr_b = scaled_sum(side, swing, -0.5 * d, n, contact.partner_arm, dn)
    torque = scaled_sum(1.0, cross(dr, f), 1.0, cross(contact.point, df), 0.0, f)
    back = scaled_sum(-1.0, cross(dr_b, f), -1.0, cross(contact.partner_point, df), 0.0, f)
    if contact.rolling:
        dm = change_of_moment(d, (sign * dot(w, n), sign * dot(w, e), sign * dot(w, g)), turn, contact)
        torque, back = scaled_sum(1.0, torque, 1.0, dm, 0.0, f), scaled_sum(1.0, back, -1.0, dm, 0.0, f)
    (a, b), (arm_a, arm_b), column = contact.rows, contact.scales, contact.rows[side] + c
    scale = contact.scales[side] if c > 2 else 1.0
    for k in range(3):
        J[entry(a + k, column, half_width)] += scale * df[k]
        J[entry(b + k, column, half_width)] -= scale * df[k]
        J[entry(a + 3 + k, column, half_width)] += scale * arm_a * torque[k]
        J[entry(b + 3 + k, column, half_width)] += scale * arm_b * back[k]


@njit(**BARE)
def change_of_moment(d, rotation, turn, contact):
    """Return the change of the moment on the owner with a change of the overlap, relative rotation and turn of the frame."""
    (n, e, g), (xx, xy, yx, yy, xd, yd), (rotation_0, rotation_1, rotation_2) = contact.frame, contact.rolling_tangent, rotation
    m_1 = xx * rotation_1 + xy * rotation_2 + xd * d
    m_2 = yx * rotation_1 + yy * rotation_2 + yd * d
    m_0 = contact.twist_tangent[0] * rotation_0 + contact.twist_tangent[1] * d
    return scaled_sum(1.0, scaled_sum(m_1, e, m_2, g, 1.0, cross(turn, contact.moment)), m_0, n, 0.0, n)


@njit(**BARE_CHUNK)
def assemble_island(context, island, m, dt, coupled, pool):
    """Write the Jacobian of the island, with m contacts between its bodies, to `pool.band`.

    `coupled`: with the derivatives with respect to patches of prescribed height (`assemble_jacobian`).
    """
    bodies, half_width, J = island.bodies.shape[0], island.half_width, pool.band
    for e in range(FREEDOMS * bodies * row_length(half_width)):
        J[e] = 0.0
    for a in range(bodies):
        space, first = space_at(a, pool), FREEDOMS * a
        assemble_jacobian(context, active_at(a, context, island), pool.counts[a], dt, coupled, space)
        for i in range(FREEDOMS):
            for j in range(FREEDOMS):
                J[entry(first + i, first + j, half_width)] = space.jacobian[i, j]
    for t in range((m + TILE - 1) // TILE):
        n, slots, tile = tile_count(t, m), pool.pair_slots[t], pair_tile(t, pool)
        give_springs(n, context, tile)
        tangents_at(context.tangents)(tile.inputs, tile.tangents, n, context.pairs)
        for q in range(n):
            contact = pair_contact(q, slots[q], dt, context, island, tile)
            i, j = context.own[slots[q]], context.partner[slots[q]]
            for c in range(6):
                add_pair_column(np.int64(0), c, arm_of(i, context.S), contact, half_width, J)
                add_pair_column(np.int64(1), c, arm_of(j, context.S), contact, half_width, J)
