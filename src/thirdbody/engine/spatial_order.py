"""Spatial order of the bodies in memory: neighbours in space are close in memory.

A step reads both bodies of each contact. With many bodies in arbitrary order, nearly all of these reads miss the cache, and most
contacts are between bodies of different groups (`kernels.explicit.contact_forces`).
"""

import numpy as np

from thirdbody.engine.state import Array, Ints
from thirdbody.kernels.bodies import BODIES
from thirdbody.kernels.explicit.contact_forces import GROUP

FEWEST = BODIES * GROUP
"""Number of bodies up to which all form one group and keep their order."""

WIDTH = 1.25
"""Width of a column of the grid over the mean diameter of the bodies."""


def in_columns(positions: Array, diameter: float) -> Ints:
    """Return a spatial order (n,) of bodies, deterministically.

    `positions` (n, 3) [m]; `diameter`: mean [m]. Columns of a square grid follow a Morton curve, which keeps neighbouring columns
    close (Morton 1966); upwards in each column.
    """
    if len(positions) <= FEWEST:
        return np.arange(len(positions))
    cells = np.floor((positions[:, :2] - positions[:, :2].min(axis=0)) / (WIDTH * diameter)).astype(np.int64)
    curve = _interleave_zeros(cells[:, 0]) | _interleave_zeros(cells[:, 1]) << 1
    return np.lexsort((positions[:, 2], curve))


def _interleave_zeros(numbers: Ints) -> Ints:
    """Move bit k of numbers below 2^31 to bit 2 k."""
    numbers = np.minimum(numbers, 2**31 - 1)
    for shift, mask in ((16, 0x0000FFFF0000FFFF), (8, 0x00FF00FF00FF00FF), (4, 0x0F0F0F0F0F0F0F0F), (2, 0x3333333333333333),
                        (1, 0x5555555555555555)):  # fmt: skip
        numbers = (numbers | numbers << shift) & mask
    return numbers
