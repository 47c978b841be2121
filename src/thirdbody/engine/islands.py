"""Islands: sets of bodies that could meet before the next search, connected by their candidates; each other body is one alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from thirdbody.engine.candidates import Candidates
from thirdbody.engine.state import Ints, State
from thirdbody.jit.threads import PIECES
from thirdbody.kernels.implicit.workspace import IslandTables

BATCH = 512
"""Bodies per call, or per part of one; one step of so many is enough between two looks at the clock."""


@dataclass(frozen=True)
class Islands:
    """Islands as tables of the kernels (`IslandTables`), with their sizes (n,).

    `number` (n_bodies,): the island of each body; `pieces`: ranges of `order` of similar cost, for threads.
    """

    tables: Any  # its fields are made at run time, so type checkers do not see them
    sizes: Ints
    number: Ints
    pieces: list[tuple[int, int]]

    @property
    def count(self) -> int:
        """Number of islands."""
        return len(self.sizes)

    @property
    def in_islands(self) -> int:
        """Number of bodies that are not alone."""
        return int(self.sizes[self.sizes > 1].sum())

    def largest(self, freedoms: int) -> tuple[int, int, int]:
        """Return the largest numbers of bodies, of pairs, and of numbers in the band of the Jacobian of an island."""
        widths = freedoms * (self.tables.widths + 1) - 1
        band = freedoms * self.sizes * (3 * widths + 1)
        pairs = int(np.diff(self.tables.pair_edges).max(initial=0))
        return int(self.sizes.max(initial=1)), max(pairs, 1), int(band.max(initial=1))

    def waiting(self, stopped: np.ndarray, late: np.ndarray) -> int:
        """Return the number of bodies in islands of which no body has `stopped` and whose first is `late` (n_bodies,), bool."""
        first = self.tables.body_edges[:-1]
        going = ~np.maximum.reduceat(stopped[self.tables.bodies], first)
        return int(self.sizes[going & late[self.tables.bodies[first]]].sum())


def single_bodies(n: int) -> Islands:
    """Return n islands of one body."""
    each, none = np.arange(n), np.zeros(0, np.int64)
    tables = IslandTables(  # type: ignore[call-arg]
        bodies=each, body_edges=np.arange(n + 1), position=np.zeros(n, np.int64), pairs=none,
        pair_edges=np.zeros(n + 1, np.int64), widths=np.zeros(n, np.int64), order=each,
    )  # fmt: skip
    return Islands(tables, np.ones(n, np.int64), each, [])


def islands_of(state: State, slots: Candidates, threads: int) -> Islands:
    """Return the islands that the candidates between bodies connect, in the order of their expected cost, falling.

    The bodies of an island are in an order in which those that could meet are close (reverse Cuthill-McKee), so that its
    Jacobian is a narrow band.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee

    k = np.arange(slots.n_plates, slots.count)
    a, b, n = state.body[slots.own[k]], state.body[slots.partner[k]], state.n_bodies
    graph = coo_matrix((np.ones(2 * len(k)), (np.concatenate((a, b)), np.concatenate((b, a)))), shape=(n, n)).tocsr()
    count, number = connected_components(graph, directed=False)
    number = number.astype(np.int64)
    sizes = np.bincount(number, minlength=count)
    near = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)
    bodies = near[np.argsort(number[near], kind="stable")]
    body_edges = np.concatenate(([0], np.cumsum(sizes)))
    position = np.empty(n, np.int64)
    position[bodies] = np.arange(n) - np.repeat(body_edges[:-1], sizes)
    of_pair = number[a]
    pairs = k[np.argsort(of_pair, kind="stable")]
    pair_edges = np.concatenate(([0], np.cumsum(np.bincount(of_pair, minlength=count))))
    widths = np.zeros(count, np.int64)
    np.maximum.at(widths, of_pair, np.abs(position[a] - position[b]))
    costs = sizes * (1.0 + widths) ** 2
    order = np.argsort(-costs, kind="stable")
    tables = IslandTables(  # type: ignore[call-arg]
        bodies=bodies, body_edges=body_edges, position=position, pairs=pairs, pair_edges=pair_edges, widths=widths, order=order,
    )  # fmt: skip
    return Islands(tables, sizes, number, _pieces(costs[order], threads))


def _pieces(costs: np.ndarray, threads: int) -> list[tuple[int, int]]:
    """Return ranges of about the same cost, or of one island that costs more."""
    total, n = np.cumsum(costs), PIECES * threads if threads > 1 else 1
    edges = np.searchsorted(total, total[-1] * np.arange(1, n) / n) + 1
    edges = np.unique(np.concatenate(([0], np.minimum(edges, len(costs)), [len(costs)])))
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
