"""Islands of bodies that could meet, as they are at the start, and as they are expected during a run."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from thirdbody.engine.neighbours import search_pairs
from thirdbody.engine.state import State

STRIDE, MARGIN = 0.25, 1.0
"""Drag between two searches, in radii of the smallest sphere; largest gap of candidates between bodies, in strides. A body that
rides on the upper plate nears one that lies on the lower plate by a stride."""

LARGEST = 300
"""Largest number of bodies of an island for which the implicit integrator pays.

Processor time per body at 1 mm/s, clumps of the main scene at an area fraction of 0.5 (`tests/bench/island_sizes.py`): explicit
steps cost 50 to 125, 57 and 10 times as much as implicit ones in islands of 7, 27 and 143 bodies. A step of a body costs 20, 23
and 56 us there, since the band gets wider, and its steps are those of the most restless body of the island: 310, 430 and 1000
per um. By that trend both cost the same at some 500 bodies; where a body chatters (1e5 steps per um), at less than 90 already. A
body of a chain costs the same up to 300 bodies.
"""

GROWTH, LARGEST_GROWTH = 1.3, 2.0
"""Bodies that an island has during a run besides the first one, over those at the start: on average, and of the largest island.

Measured for 100 to 2000 bodies of the main scene at area fractions of 0.05 to 0.55, for balls and for scanned particles: 1.2 to
1.5, and 1 to 2."""


class ExpectedIslands(NamedTuple):
    """Islands of a layer.

    `stride`: the drag [m] within which their bodies could meet; `area_fraction`: of the domain, covered by the bodies as balls of
    their volumes; `fraction_of_bodies` in islands of two and more at the start; `mean`, `largest`: expected number of bodies in
    the island of a body, and in the largest one, during the run.
    """

    stride: float
    area_fraction: float
    fraction_of_bodies: float
    mean: float
    largest: int


def island_stride(state: State) -> float:
    """Return the drag [m] between two searches for islands; infinite where bodies do not meet."""
    return STRIDE * float(state.spheres.radius.min()) if state.world.debris_meets else math.inf


def expected_islands(state: State) -> ExpectedIslands:
    """Return the islands that a state at the start lets expect; a body without neighbours is an island of one."""
    sizes, stride = _island_sizes(state), island_stride(state)
    n, apart = state.n_bodies, int(np.count_nonzero(sizes == 1))
    largest = 1 + round(LARGEST_GROWTH * (int(sizes.max(initial=1)) - 1)) if state.world.debris_meets else 1
    return ExpectedIslands(
        stride=stride,
        area_fraction=math.pi * float((state.rayleigh_radius**2).sum()) / (state.world.size[0] * state.world.size[1]),
        fraction_of_bodies=1.0 - apart / n,
        mean=min(n, 1.0 + GROWTH * (float((sizes.astype(float) ** 2).sum()) / n - 1.0)),
        largest=min(n, largest),
    )


def _island_sizes(state: State) -> np.ndarray:
    """Return the numbers of bodies of all islands at the start."""
    n = state.n_bodies
    own, partner = search_pairs(state, MARGIN * island_stride(state)) if state.world.debris_meets else ((), ())
    if not len(own):
        return np.ones(n, np.int64)
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(own)), (state.body[own], state.body[partner])), shape=(n, n))
    return np.bincount(connected_components(graph, directed=False)[1])
