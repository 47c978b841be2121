"""Separations in a periodic domain; a side of length 0 is not periodic."""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.jit.simd import broadcast, round_to_nearest


@njit(**BARE)
def nearest_image(d, length):
    """Separation d in a period of `length`."""
    return d - length * np.rint(d / length) if length > 0.0 else d


@njit(**BARE)
def inverse(length):
    """1/length for `image`, 0 where nothing is periodic."""
    return 1.0 / length if length > 0.0 else 0.0


@njit(**BARE)
def image(d, length, inverse):
    """Separation d in a period of `length` with its `inverse`: no division and no branch, for loops over candidates."""
    return d - length * np.rint(d * inverse)


@njit(**BARE)
def images(d, length, inverse):
    """`image` of four separations."""
    return d - broadcast(length) * round_to_nearest(d * broadcast(inverse))
