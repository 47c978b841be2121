"""Three numbers of one kind packed into the bits of one.

The number has the power of two of the largest of the three (11 bits), followed by each of them as an integer multiple of 2^-15 of
that power (17 bits each). So each is stored to 2^-16 of the largest, rounded to nearest: without bias. NaN and infinity are not
preserved: a contact whose force is not finite stops the run at once.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE

POWER = 0x7FF << 52
"""Bits of the power of two of a number."""

FIELD, SIGN = (1 << 17) - 1, 1 << 16
"""Bits of one of the three, and that of its sign."""

ROUND = 1.5 * 2.0**37
"""The last bit of a number of this size is 2^-15: adding it rounds a number to a multiple of that."""

WHOLE, ZERO = (1023 + 37) << 52, 2.0**37 + 2.0
"""Bits of 2^37, and the number whose field is that of zero with its sign inverted."""

SMALLEST = 1e-280
"""Largest of three numbers that all count as zero, so that every power of two has a reciprocal."""

ROUNDING = 1.0 + 2.0**-16
"""Factor that raises the power of two of numbers that round to the next one."""


@njit(**BARE)
def bits_of(x):
    """Return the bits of a number."""
    return np.float64(x).view(np.int64)


@njit(**BARE)
def number_of(bits):
    """Return the number of these bits."""
    return np.int64(bits).view(np.float64)


@njit(**BARE)
def pack_triple(x, y, z):
    """Return the number that packs three."""
    power = bits_of(max(max(abs(x), abs(y)), max(abs(z), SMALLEST)) * ROUNDING) & POWER
    fraction = number_of((2046 << 52) - power)  # one over the power of two
    a, b, c = bits_of(x * fraction + ROUND) & FIELD, bits_of(y * fraction + ROUND) & FIELD, bits_of(z * fraction + ROUND) & FIELD
    return number_of(power | (a << 34) | (b << 17) | c)


@njit(**BARE)
def one_of(bits, power):
    """Return the number in the last field."""
    return (number_of((bits & FIELD ^ SIGN) | WHOLE) - ZERO) * power


@njit(**BARE)
def unpack_triple(one):
    """Return the three numbers that one packs; zeros of zero."""
    bits = bits_of(one)
    power = number_of(bits & POWER)
    return one_of(bits >> 34, power), one_of(bits >> 17, power), one_of(bits, power)
