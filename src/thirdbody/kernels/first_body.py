"""First bodies, between which the debris is: all that kernels know of them.

A first body is named by the partner code of a candidate (`predicates`), and with it the basin of the contact. For a sphere it has
an overlap, a unit normal from the first body to the sphere, an effective radius and a surface velocity. The plane of the lower
one is z = 0 and at rest, that of a patch of the upper one is at its height and looks down. Where both plates are flat, answers
come from these planes, otherwise from the table of closest points (`surface_contact`), which must be up to date.
"""

import math

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.predicates import is_upper, patch_of_partner
from thirdbody.kernels.tables import patch, sphere, surface_contact


@njit(**BARE)
def is_rough(context):
    """Return whether a plate is rough; then all contacts with plates are in the table Q."""
    return context.Q.shape[0] > 0


@njit(**BARE)
def to_surface(partner, x, P):
    """Return a point in the coordinates of a first body: x and y move with it, z is the height above its plane [m]."""
    p, upper = patch_of_partner(partner), is_upper(partner)
    along = x[0] - P[p, patch.DISPLACEMENT] if upper else x[0]
    across = x[1] - P[p, patch.DISPLACEMENT + 1] if upper else x[1]
    top = P[p, patch.HEIGHT]
    return along, across, top - x[2] if upper else x[2]


@njit(**BARE)
def height_above(partner, i, S, P):
    """Return the height of the centre of sphere i above the plane of a first body, on the side of the debris [m]."""
    z, top = S[i, sphere.Z], P[patch_of_partner(partner), patch.HEIGHT]
    return top - z if is_upper(partner) else z


@njit(**BARE)
def plane_overlap(k, context):
    """Return the overlap of candidate k with the plane of its first body [m]; <= 0 if apart."""
    i, S = context.own[k], context.S
    return S[i, sphere.RADIUS] - height_above(context.partner[k], i, S, context.P)


@njit(**BARE)
def surface_overlap(k, context):
    """Return the overlap of candidate k with its rough first body [m]; <= 0 if apart, -inf in a basin without a minimum."""
    return context.S[context.own[k], sphere.RADIUS] - context.Q[k, surface_contact.DISTANCE]


@njit(**BARE)
def overlap(k, context):
    """Return the overlap of candidate k with its first body [m]; <= 0 if apart."""
    return surface_overlap(k, context) if is_rough(context) else plane_overlap(k, context)


@njit(**BARE)
def three(Q, k, column):
    """Return three numbers of row k."""
    return Q[k, column], Q[k, column + 1], Q[k, column + 2]


@njit(**BARE)
def normal(k, context):
    """Return the unit normal from the first body of candidate k to its sphere."""
    if is_rough(context):
        return three(context.Q, k, surface_contact.NORMAL)
    return 0.0, 0.0, -1.0 if is_upper(context.partner[k]) else 1.0


@njit(**BARE)
def normal_change(k, move, Q):
    """Return the change of the normal of candidate k with a displacement of its sphere relative to the first body."""
    t = surface_contact.NORMAL_GRADIENT
    x, y, z = move
    return (
        Q[k, t] * x + Q[k, t + 3] * y + Q[k, t + 4] * z,
        Q[k, t + 3] * x + Q[k, t + 1] * y + Q[k, t + 5] * z,
        Q[k, t + 4] * x + Q[k, t + 5] * y + Q[k, t + 2] * z,
    )


@njit(**BARE)
def normal_before(k, move, context):
    """Return the unit normal of candidate k before its sphere moved by `move` (3,) relative to the first body [m]."""
    n_x, n_y, n_z = normal(k, context)
    if not is_rough(context):
        return n_x, n_y, n_z
    d_x, d_y, d_z = normal_change(k, move, context.Q)
    n_x, n_y, n_z = n_x - d_x, n_y - d_y, n_z - d_z
    inverse = 1.0 / math.sqrt(n_x * n_x + n_y * n_y + n_z * n_z)
    return n_x * inverse, n_y * inverse, n_z * inverse


@njit(**BARE)
def effective_radius(k, context):
    """Return the effective radius of candidate k, a contact with a first body [m]."""
    return context.Q[k, surface_contact.RADIUS] if is_rough(context) else context.S[context.own[k], sphere.RADIUS]


@njit(**BARE)
def radius_of_curvature(k, context):
    """Return the radius of curvature of a first body at candidate k [m], that of a sphere of the same effect; 0: flat."""
    if not is_rough(context):
        return 0.0
    bend = 1.0 / context.Q[k, surface_contact.RADIUS] - 1.0 / context.S[context.own[k], sphere.RADIUS]
    return 1.0 / bend if bend != 0.0 else 0.0


@njit(**BARE)
def velocity(partner, P, motion):
    """Return the velocity of the surface of a first body [m/s]."""
    v_z = P[patch_of_partner(partner), patch.VELOCITY]
    if is_upper(partner):
        return motion.v_x, motion.v_y, v_z
    return 0.0, 0.0, 0.0


@njit(**BARE)
def centre(i, S):
    """Return the centre of sphere i [m]."""
    return S[i, sphere.X], S[i, sphere.Y], S[i, sphere.Z]
