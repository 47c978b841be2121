"""A `kernels.surface` for tests: the lower plate has ribs, half cylinders along y side by side; the upper plate is flat.

A sphere touches two ribs at once, on either side of a groove. The number of a rib modulo `BASINS` is its basin, so the ribs of a
groove are different ones; of all ribs of a basin the nearest counts, for the others are out of reach. A period of the domain must
be a whole number of `BASINS` ribs. Contacts have the radius of the sphere alone.
"""

import math

from numba import njit

from thirdbody.jit.options import BARE

FLAT = False
BASINS = 2

RADIUS, PITCH = 5e-6, 10e-6
"""Radius of a rib, distance of the axes of two ribs [m]."""

AXIS = -3e-6
"""Height of the axes [m]: no sphere that rests between two ribs is below z = 0, where scenes have their plate."""


@njit(**BARE)
def from_axis(basin, x):
    """Return the shortest way (x, z) from the axis of a rib of a basin to a point [m]."""
    period, along = PITCH * BASINS, x[0] - PITCH * basin
    return along - period * math.floor(along / period + 0.5), x[2] - AXIS


@njit(**BARE)
def distance(upper, basin, x):
    if upper:
        return x[2] if basin == 0 else math.inf
    along, up = from_axis(basin, x)
    return math.sqrt(along * along + up * up) - RADIUS


@njit(**BARE)
def normal(upper, basin, x):
    if upper:
        return 0.0, 0.0, 1.0
    along, up = from_axis(basin, x)
    inverse = 1.0 / max(math.sqrt(along * along + up * up), 1e-300)
    return along * inverse, 0.0, up * inverse


@njit(**BARE)
def curvature(upper, basin, x):
    return 0.0
