"""Geometry and wrench of contacts between two bodies of an island."""

import math

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.implicit.residual import contact_force, contact_moment, contact_point, vector_at
from thirdbody.kernels.implicit.vector_algebra import cross
from thirdbody.kernels.periodic import image
from thirdbody.kernels.rolling_kinematics import has_moments
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.tile import TILE, geometry


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
