"""The order in which a run keeps its bodies: neighbours in space near each other in memory.

The step reads both bodies of a contact; in a large crowd in any order nearly every one of them comes from slow memory, and most
contacts are between bodies of different groups (`kernels.explicit.contact_forces`).
"""

from __future__ import annotations

import numpy as np

from thirdbody.engine.state import Array, Ints
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.rigid_body import BODIES

FEWEST = BODIES * GROUP
"""Bodies up to which all are one group."""

WIDTH = 1.25
"""Width of a column of bodies over the mean diameter."""


def in_columns(positions: Array, diameter: float) -> Ints:
    """The order of bodies at (n, 3), m, of this mean diameter: column by column of a square grid, along Morton's curve, which
    keeps near columns together (Morton 1966), and from below in each. The same for the same bodies."""
    if len(positions) <= FEWEST:
        return np.arange(len(positions))
    cells = np.floor((positions[:, :2] - positions[:, :2].min(axis=0)) / (WIDTH * diameter)).astype(np.int64)
    curve = _spread(cells[:, 0]) | _spread(cells[:, 1]) << 1
    return np.lexsort((positions[:, 2], curve))


def _spread(numbers: Ints) -> Ints:
    """Every bit of numbers below 2^31 moved to twice its place."""
    numbers = np.minimum(numbers, 2**31 - 1)
    for shift, mask in ((16, 0x0000FFFF0000FFFF), (8, 0x00FF00FF00FF00FF), (4, 0x0F0F0F0F0F0F0F0F), (2, 0x3333333333333333),
                        (1, 0x5555555555555555)):  # fmt: skip
        numbers = (numbers | numbers << shift) & mask
    return numbers
