"""Islands: sets of bodies that could meet before the next search, connected by their candidates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from thirdbody.engine.candidates import Candidates
from thirdbody.engine.state import Ints, State
from thirdbody.kernels.implicit.island_bundles import IslandTables


@dataclass(frozen=True)
class Islands:
    """Islands of at least two bodies, as tables of the kernels (`IslandTables`), with their sizes (n,).

    `member` (n_bodies,): whether a body is in one; `number` (n_bodies,): the same for all bodies that are connected.
    """

    tables: Any  # its fields are made at run time, so type checkers do not see them
    sizes: Ints
    member: np.ndarray
    number: Ints

    @property
    def count(self) -> int:
        """Number of islands."""
        return len(self.sizes)

    @property
    def parts(self) -> int:
        """Number of parts of the work."""
        return len(self.tables.part_edges) - 1


def islands_of(state: State, slots: Candidates, parts: int) -> Islands:
    """Return the islands that the candidates between bodies connect, shared among `parts` threads by their expected cost.

    The bodies of an island are in an order in which those that could meet are close (reverse Cuthill-McKee), so that its
    Jacobian is a narrow band.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee

    k = np.arange(slots.n_plates, slots.count)
    a, b, n = state.body[slots.own[k]], state.body[slots.partner[k]], state.n_bodies
    graph = coo_matrix((np.ones(2 * len(k)), (np.concatenate((a, b)), np.concatenate((b, a)))), shape=(n, n)).tocsr()
    components, number = connected_components(graph, directed=False)
    sizes = np.bincount(number, minlength=components)
    member = sizes[number] > 1
    near = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)
    near = near[member[near]]
    bodies = near[np.argsort(number[near], kind="stable")]
    large = np.flatnonzero(sizes > 1)
    body_edges = np.concatenate(([0], np.cumsum(sizes[large])))
    position = np.zeros(n, np.int64)
    position[bodies] = np.arange(len(bodies)) - np.repeat(body_edges[:-1], sizes[large])
    row = np.full(components, -1)
    row[large] = np.arange(len(large))
    of_pair = row[number[a]]
    pairs = k[np.argsort(of_pair, kind="stable")]
    pair_edges = np.concatenate(([0], np.cumsum(np.bincount(of_pair, minlength=len(large)))))
    widths = np.zeros(len(large), np.int64)
    np.maximum.at(widths, of_pair, np.abs(position[a] - position[b]))
    order, part_edges = _shared(sizes[large] * (1.0 + widths) ** 2, parts)
    tables = IslandTables(  # type: ignore[call-arg]
        bodies=bodies, body_edges=body_edges, position=position, pairs=pairs, pair_edges=pair_edges, widths=widths, order=order,
        part_edges=part_edges, all_edges=slots.edges, all_incidence=slots.incidence,
    )  # fmt: skip
    return Islands(tables, sizes[large], member, number)


def _shared(costs: np.ndarray, parts: int) -> tuple[Ints, Ints]:
    """Return the islands in the order of the parts, and where each part begins: the costliest one to the part with least work."""
    work, lists = np.zeros(parts), [[] for _ in range(parts)]  # type: tuple[np.ndarray, list[list[int]]]
    for island in np.argsort(-costs, kind="stable"):
        part = int(np.argmin(work))
        work[part] += costs[island]
        lists[part].append(int(island))
    edges = np.concatenate(([0], np.cumsum([len(part) for part in lists])))
    return np.array([island for part in lists for island in part], np.int64), edges.astype(np.int64)
