"""Separations in a periodic domain; an axis of length 0 is not periodic."""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.jit.simd import broadcast, round_to_nearest
from thirdbody.kernels.bundles import Box
from thirdbody.kernels.tables import domain


@njit(**BARE)
def nearest_image(d, length):
    """Return the separation d to the nearest image in a period of `length`."""
    return d - length * np.rint(d / length) if length > 0.0 else d


@njit(**BARE)
def inverse(length):
    """Return 1/length for `image`, 0 where the axis is not periodic."""
    return 1.0 / length if length > 0.0 else 0.0


@njit(**BARE)
def image(d, length, inverse):
    """Return the separation d to the nearest image, without division or branch. For loops over candidates."""
    return d - length * np.rint(d * inverse)


@njit(**BARE)
def images(d, length, inverse):
    """Return `image` of four separations."""
    return d - broadcast(length) * round_to_nearest(d * broadcast(inverse))


@njit(**BARE)
def box_of(D):
    """Return the periodic lengths of the domain and their inverses."""
    l_x, l_y = max(D[domain.LENGTH_X], 0.0), max(D[domain.LENGTH_Y], 0.0)
    return Box(l_x, l_y, inverse(l_x), inverse(l_y), D[domain.REACH])
