"""First bodies, between which the debris is: all that kernels know of their surfaces.

A first body is named by the partner code of a candidate (`predicates`): the lower one, or a patch of the upper one. For a sphere
at x (3,) [m] it has an overlap, a unit normal from the first body to the sphere, a curvature and a surface velocity. This is
the flat plate: the lower one is the plane z = 0 at rest, a patch of the upper one a plane at its height. (A surface that is not
flat also needs `patch.DISPLACEMENT`.) Functions are inlined, so constants, like the x of a normal, cost nothing.
"""

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.columns import patch, sphere
from thirdbody.kernels.predicates import is_upper, patch_of_partner

FLAT = True
"""Whether all first bodies are planes: the implicit Jacobian is then compiled without the turning of normals (`jacobian`)."""


@njit(**BARE)
def overlap(partner, x, radius, P):
    """Return the overlap of a sphere with a first body [m]; <= 0 if apart."""
    top = P[patch_of_partner(partner), patch.HEIGHT]
    return radius - (top - x[2] if is_upper(partner) else x[2])


@njit(**BARE)
def normal(partner, x, P):
    """Return the unit normal from a first body to a sphere."""
    return 0.0, 0.0, -1.0 if is_upper(partner) else 1.0


@njit(**BARE)
def curvature(partner, x, P):
    """Return the curvature of a first body next to a sphere [1/m]: 0 for a plane, positive where it bulges."""
    return 0.0


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
