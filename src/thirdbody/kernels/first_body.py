"""First bodies, between which the debris is: all that kernels know of them. Their shape is in `surface`.

A first body is named by the partner code of a candidate (`predicates`), and with it the basin of the contact. For a sphere at x
(3,) [m] it has an overlap, a unit normal from the first body to the sphere, a curvature and a surface velocity. The plane of the
lower one is z = 0 and at rest, that of a patch of the upper one is at its height and looks down.
"""

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels import surface
from thirdbody.kernels.columns import patch, sphere
from thirdbody.kernels.predicates import basin_of_partner, is_upper, patch_of_partner


@njit(**BARE)
def to_surface(partner, x, P):
    """Return a point in the coordinates of a first body (`surface`) [m]."""
    p, upper = patch_of_partner(partner), is_upper(partner)
    along = x[0] - P[p, patch.DISPLACEMENT] if upper else x[0]
    across = x[1] - P[p, patch.DISPLACEMENT + 1] if upper else x[1]
    top = P[p, patch.HEIGHT]
    return along, across, top - x[2] if upper else x[2]


@njit(**BARE)
def overlap(partner, x, radius, P):
    """Return the overlap of a sphere with a first body [m]; <= 0 if apart."""
    return radius - surface.distance(is_upper(partner), basin_of_partner(partner), to_surface(partner, x, P))


@njit(**BARE)
def normal(partner, x, P):
    """Return the unit normal from a first body to a sphere."""
    upper = is_upper(partner)
    n_x, n_y, n_z = surface.normal(upper, basin_of_partner(partner), to_surface(partner, x, P))
    return n_x, n_y, -n_z if upper else n_z


@njit(**BARE)
def curvature(partner, x, P):
    """Return the curvature of a first body next to a sphere [1/m]: 0 for a plane, positive where it bulges."""
    return surface.curvature(is_upper(partner), basin_of_partner(partner), to_surface(partner, x, P))


@njit(**BARE)
def velocity(partner, P, motion):
    """Return the velocity of the surface of a first body [m/s]."""
    v_z = P[patch_of_partner(partner), patch.VELOCITY]
    if is_upper(partner):
        return motion.v_x, motion.v_y, v_z
    return 0.0, 0.0, 0.0


@njit(**BARE)
def effective_radius(radius, curvature):
    """Return the effective radius of a sphere on a surface [m]."""
    return radius if curvature == 0.0 else radius / (1.0 + radius * curvature)


@njit(**BARE)
def centre(i, S):
    """Return the centre of sphere i [m]."""
    return S[i, sphere.X], S[i, sphere.Y], S[i, sphere.Z]
