"""Stacks of bodies of equally many spheres: numpy takes them all at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np


def alike(sizes: Sequence[int] | np.ndarray, margin: int) -> Iterator[tuple[int, np.ndarray]]:
    """Numbers of spheres n and members (m,) of stacks of bodies that have n each, of at most room / n^3 bodies.

    The room keeps tables over triples of spheres in the cache and memory bounded.
    """
    sizes = np.asarray(sizes)
    for n in np.unique(sizes):
        members = np.flatnonzero(sizes == n)
        maximum = max(1, margin // int(n) ** 3)
        for first in range(0, len(members), maximum):
            yield int(n), members[first : first + maximum]
