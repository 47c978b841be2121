"""Islands: sets of bodies that could meet before the next search, connected by their candidates; each other body is one alone."""

import math
import threading
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from thirdbody.engine.candidates import Candidates
from thirdbody.engine.neighbours import search_pairs
from thirdbody.engine.state import Ints, State
from thirdbody.jit.arguments import Packer
from thirdbody.jit.threads import PIECES
from thirdbody.kernels.implicit.workspace import FREEDOMS, SCRATCH, IslandTables, make_scratch


@dataclass(frozen=True)
class Islands:
    tables: Any  # its fields are made at run time, so type checkers do not see them
    sizes: Ints  # (n,)
    number: Ints  # (n_bodies,): the island of each body
    pieces: list[tuple[int, int]]  # ranges of `order` of similar cost, for threads

    @property
    def count(self) -> int:
        return len(self.sizes)

    @property
    def in_islands(self) -> int:
        return int(self.sizes[self.sizes > 1].sum())

    def largest(self) -> tuple[int, int, int]:
        """Return the largest numbers of bodies, of pairs, and of numbers in the band of the Jacobian of an island."""
        widths = FREEDOMS * (self.tables.widths + 1) - 1
        band = FREEDOMS * self.sizes * (3 * widths + 1)
        pairs = int(np.diff(self.tables.pair_edges).max(initial=0))
        return int(self.sizes.max(initial=1)), max(pairs, 1), int(band.max(initial=1))

    def waiting(self, stopped: np.ndarray, late: np.ndarray) -> int:
        """Return the number of bodies in islands of which no body has `stopped` and whose first is `late` (n_bodies,), bool."""
        first = self.tables.body_edges[:-1]
        going = ~np.maximum.reduceat(stopped[self.tables.bodies], first)
        return int(self.sizes[going & late[self.tables.bodies[first]]].sum())


class ThreadScratch:
    def __init__(self) -> None:
        self._sizes, self._packers = (1, 1, 1, 1), {}  # type: tuple[int, ...], dict[int, Packer]

    def __getstate__(self) -> dict[str, Any]:  # a copy makes its own scratch
        return {"_sizes": self._sizes, "_packers": {}}

    def fit(self, sizes: tuple[int, ...]) -> None:
        """Provide for islands of at most so many bodies, pairs, numbers in the band, and candidates of a body."""
        if any(new > old for new, old in zip(sizes, self._sizes, strict=True)):
            self._sizes, self._packers = tuple(map(max, sizes, self._sizes)), {}

    def of_thread(self, context: Any) -> Any:
        scratch = self._packers.get(threading.get_ident())
        if scratch is None:
            scratch = self._packers[threading.get_ident()] = Packer(SCRATCH)
            scratch(make_scratch(context, *self._sizes))
        return scratch(scratch.given)


def single_bodies(n: int) -> Islands:
    each, none = np.arange(n), np.zeros(0, np.int64)
    tables = IslandTables(  # type: ignore[call-arg]
        bodies=each, body_edges=np.arange(n + 1), position=np.zeros(n, np.int64), pairs=none,
        pair_edges=np.zeros(n + 1, np.int64), widths=np.zeros(n, np.int64), order=each,
    )  # fmt: skip
    return Islands(tables, np.ones(n, np.int64), each, [])


def islands_of(state: State, slots: Candidates, threads: int) -> Islands:
    """Return the islands that the candidates between bodies connect, in the order of their expected cost, falling; their bodies
    so that those that could meet are close (reverse Cuthill-McKee), and the Jacobian is a narrow band."""
    k = np.arange(slots.n_plates, slots.count)
    a, b, n = state.body[slots.own[k]], state.body[slots.partner[k]], state.n_bodies
    number, near = _connected(a, b, n)
    sizes = np.bincount(number)
    bodies = near[np.argsort(number[near], kind="stable")]
    body_edges = np.concatenate(([0], np.cumsum(sizes)))
    position = np.empty(n, np.int64)
    position[bodies] = np.arange(n) - np.repeat(body_edges[:-1], sizes)
    of_pair = number[a]
    pairs = k[np.argsort(of_pair, kind="stable")]
    pair_edges = np.concatenate(([0], np.cumsum(np.bincount(of_pair, minlength=len(sizes)))))
    widths = np.zeros(len(sizes), np.int64)
    np.maximum.at(widths, of_pair, np.abs(position[a] - position[b]))
    costs = sizes * (1.0 + widths) ** 2
    order = np.argsort(-costs, kind="stable")
    tables = IslandTables(  # type: ignore[call-arg]
        bodies=bodies, body_edges=body_edges, position=position, pairs=pairs, pair_edges=pair_edges, widths=widths, order=order,
    )  # fmt: skip
    return Islands(tables, sizes, number, _pieces(costs[order], threads))


def _connected(a: Ints, b: Ints, n: int) -> tuple[Ints, Ints]:
    """Return the island (n,) of each body, numbered by their first bodies, and all bodies (n,) in reverse Cuthill-McKee order.
    Both as of scipy.sparse.csgraph, whose import would take a tenth of a start."""
    ends = np.unique(np.concatenate((a * n + b, b * n + a)))
    degree = np.bincount(ends // n, minlength=n)
    near, edges, degrees = (ends % n).tolist(), [0, *np.cumsum(degree).tolist()], degree.tolist()
    order, island = list[int](), [-1] * n
    for seed in np.argsort(degree.astype(np.int32)).tolist():
        queue = [seed] if island[seed] < 0 else []
        for body in queue:  # which grows
            island[body] = seed
            new = [other for other in near[edges[body] : edges[body + 1]] if island[other] < 0]
            for other in new:
                island[other] = seed
            queue += sorted(new, key=degrees.__getitem__)
        order += queue
    first = np.full(n, n)
    np.minimum.at(first, island, np.arange(n))
    return np.unique(first[island], return_inverse=True)[1], np.array(order, np.int64)[::-1]


def _pieces(costs: np.ndarray, threads: int) -> list[tuple[int, int]]:
    """Return ranges of about the same cost, or of one island that costs more."""
    total, n = np.cumsum(costs), PIECES * threads if threads > 1 else 1
    edges = np.searchsorted(total, total[-1] * np.arange(1, n) / n) + 1
    edges = np.unique(np.concatenate(([0], np.minimum(edges, len(costs)), [len(costs)])))
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


STRIDE, MARGIN = 0.25, 1.0
"""Drag between two searches, in radii of the smallest sphere; largest gap of candidates between bodies, in strides. A body that
rides on the upper plate nears one that lies on the lower plate by a stride."""

LARGEST = 300
"""Largest number of bodies of an island for which the implicit integrator pays.

Processor time per body at 1 mm/s, clumps of the main scene at an area fraction of 0.5 (`tests/bench/island_sizes.py`): explicit
steps cost 50 to 125, 57 and 10 times as much as implicit ones in islands of 7, 27 and 143 bodies, since the band gets wider, and
the steps are those of the most restless body. By that trend both cost the same at some 500 bodies; where a body chatters (1e5
steps per um), at less than 90 already."""

GROWTH, LARGEST_GROWTH = 1.3, 2.0
"""Bodies that an island has during a run besides the first one, over those at the start: on average, and of the largest island.
Measured for 100 to 2000 bodies at area fractions of 0.05 to 0.55: 1.2 to 1.5, and 1 to 2."""


class ExpectedIslands(NamedTuple):
    stride: float  # drag [m] within which their bodies could meet
    area_fraction: float  # of the domain, covered by the bodies as balls of their volumes
    fraction_of_bodies: float  # in islands of two and more at the start
    mean: float  # expected number of bodies in the island of a body
    largest: int  # the same in the largest one during the run


def island_stride(state: State) -> float:
    return STRIDE * float(state.spheres.radius.min()) if state.world.debris_meets else math.inf


def expected_islands(state: State) -> ExpectedIslands:
    """Return the islands that a state at the start lets expect; a body without neighbours is an island of one."""
    n, stride = state.n_bodies, island_stride(state)
    sizes = np.ones(n, np.int64)
    if state.world.debris_meets:
        own, partner = search_pairs(state, MARGIN * stride)
        sizes = np.bincount(_connected(state.body[own], state.body[partner], n)[0])
    return ExpectedIslands(
        stride=stride,
        area_fraction=math.pi * float((state.rayleigh_radius**2).sum()) / (state.world.size[0] * state.world.size[1]),
        fraction_of_bodies=1.0 - int(np.count_nonzero(sizes == 1)) / n,
        mean=min(n, 1.0 + GROWTH * (float((sizes.astype(float) ** 2).sum()) / n - 1.0)),
        largest=min(n, 1 + round(LARGEST_GROWTH * (int(sizes.max(initial=1)) - 1))),
    )
