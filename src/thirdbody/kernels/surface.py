"""The surface of first bodies: what kernels know of its shape.

Coordinates are those of the first body: x and y move with it, z is the height above its plane on the side of the debris
(`first_body`). The part of a surface with which a sphere has at most one contact is a *basin*; each contact of a sphere with one
first body lies in a basin of its own, and keeps its history as long as it stays there. This is the flat plate, with one basin.
Functions are inlined, so constants, like the x of a normal, cost nothing.
"""

from numba import njit

from thirdbody.jit.options import BARE

FLAT = True
"""Whether all first bodies are planes: the implicit Jacobian is then compiled without the turning of normals (`jacobian`)."""

BASINS = 1
"""Number of basins: a sphere has at most as many contacts with one first body."""


@njit(**BARE)
def distance(upper, basin, x):
    """Return the distance of a point x (3,) from the surface of a basin [m], negative below it; inf without such a basin."""
    return x[2]


@njit(**BARE)
def normal(upper, basin, x):
    """Return the unit normal of the surface where it is closest to a point, towards the debris."""
    return 0.0, 0.0, 1.0


@njit(**BARE)
def curvature(upper, basin, x):
    """Return the curvature of the surface there [1/m]: 0 for a plane, positive where it bulges."""
    return 0.0
