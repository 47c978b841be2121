"""Stacks of bodies with equal numbers of spheres, for vectorised numpy."""

from collections.abc import Iterator, Sequence

import numpy as np


def alike(sizes: Sequence[int] | np.ndarray, margin: int) -> Iterator[tuple[int, np.ndarray]]:
    """Yield sphere count n and members (m,) of stacks of bodies with n spheres each, of at most margin / n^3 bodies.

    The margin keeps tables over triples of spheres in the cache and bounds the memory.
    """
    sizes = np.asarray(sizes)
    for n in np.unique(sizes):
        members = np.flatnonzero(sizes == n)
        maximum = max(1, margin // int(n) ** 3)
        for first in range(0, len(members), maximum):
            yield int(n), members[first : first + maximum]
