"""Arguments of the island kernels that travel together.

An island is a set of bodies that could meet each other before the next search. Its bodies share their steps, and its equations
are solved together.
"""

from collections import namedtuple
from typing import NamedTuple

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import Kinds, make_unpacker
from thirdbody.jit.options import BARE, CHUNK
from thirdbody.kernels.bundles import Tile
from thirdbody.kernels.contact_geometry import SPARE
from thirdbody.kernels.explicit.tables import contact_sums
from thirdbody.kernels.implicit.bundles import FREEDOMS, Workspace, active_body
from thirdbody.kernels.implicit.tables import step_contacts
from thirdbody.kernels.tables import observed_body
from thirdbody.kernels.tile import TILE, contact_tangent, geometry, law_input, law_output, rolling_input, rolling_output

Array = np.ndarray

_I1, _S1 = types.Array(types.int64, 1, "C"), types.Array(types.int32, 1, "C")

TABLES: Kinds = {
    # bodies of all islands, island by island; where each island begins, and their number; position of each body in its island
    "bodies": _I1, "body_edges": _I1, "position": _I1,
    # candidates between the bodies of an island; where those of each island begin; largest difference of positions of a pair
    "pairs": _I1, "pair_edges": _I1, "widths": _I1,
    # islands of each part of the work; where each part begins
    "order": _I1, "part_edges": _I1,
    # all candidates of each body (`engine.state.Candidates.edges`, `.incidence`); in the context: those with plates
    "all_edges": _S1, "all_incidence": _S1,
}  # fmt: skip
"""Types of the tables of the islands, by name."""

IslandTables = namedtuple("IslandTables", tuple(TABLES))  # type: ignore[misc]
"""Tables of the islands; kernels unpack it from an array."""

tables_of = make_unpacker(TABLES, IslandTables)
"""tables_of(packed): the `IslandTables` in an array of int64."""


class Island(NamedTuple):
    """The island that is advanced."""

    bodies: Array
    """Its bodies."""
    pairs: Array
    """Candidates between them."""
    position: Array
    """Position of each body of the run in its island."""
    half_width: int
    """Half width of the band of its Jacobian."""
    box: NamedTuple
    """Periodic lengths (`kernels.bundles.Box`)."""


class Pool(NamedTuple):
    """Scratch for an island: a row for each body, for each tile of contacts between bodies, and the system of equations."""

    inputs: Array
    outputs: Array
    tangents: Array
    geometry: Array
    slots: Array
    before: Array
    coordinates: Array
    """Rows y, trial, residual and correction of each body (n, 4, 7)."""
    jacobian: Array
    diagnostics: Array
    sums: Array
    observed: Array
    rows: Array
    counts: Array
    """Number of contacts of each body with plates."""
    scales: Array
    """Of each body: sum of all acting forces [N], and one over that sum at the start of the iteration."""
    errors: Array
    """Of each body: error of the friction work of its contacts with others, and the energy that these can store [J]."""
    pair_inputs: Array
    pair_outputs: Array
    pair_tangents: Array
    pair_geometry: Array
    pair_slots: Array
    """Candidates of the contacts in each tile, padded."""
    band: Array
    """Jacobian: row i holds the columns from i - half_width to i + 2 half_width."""
    solution: Array
    pivots: Array


@njit(**CHUNK)
def make_pool(context, bodies, pairs, band):
    """Return the scratch for islands of at most so many bodies, candidates between them, and numbers in the band."""
    history, tiles, row = context.n_history, (pairs + TILE - 1) // TILE, context.max_per_body
    given = (law_input.HISTORY + history + rolling_input.WIDTH) * TILE
    results = (law_output.HISTORY + history + rolling_output.WIDTH) * TILE
    slopes, shape = contact_tangent.SPOTS_WIDTH * TILE, geometry.WIDTH * TILE
    return Pool(  # inputs as in `make_workspace`
        np.zeros((bodies, given)), np.empty((bodies, results)), np.empty((bodies, slopes)), np.empty((bodies, shape)),
        np.zeros((bodies, TILE), np.int64), np.zeros((bodies, row)), np.zeros((bodies, 4, FREEDOMS)),
        np.empty((bodies, FREEDOMS, FREEDOMS)), np.zeros((bodies, step_contacts.WIDTH)),
        np.zeros((bodies, 1, contact_sums.WIDTH)), np.zeros(observed_body.WIDTH), np.empty((row, context.width)),
        np.zeros(bodies, np.int64), np.zeros((bodies, 2)), np.zeros((bodies, 2)), np.empty((tiles, given)),
        np.empty((tiles, results)), np.empty((tiles, slopes)), np.empty((tiles, shape)),
        np.zeros((tiles, TILE + SPARE), np.int64), np.empty(band), np.empty(FREEDOMS * bodies),
        np.zeros(FREEDOMS * bodies, np.int64),
    )  # fmt: skip


@njit(**BARE)
def space_at(a, pool):
    """Return the scratch of the body at position a of the island."""
    tile = Tile(pool.inputs[a], pool.outputs[a], pool.tangents[a], pool.geometry[a])
    rows = pool.coordinates[a]
    return Workspace(
        tile, pool.slots[a], pool.before[a], rows[0], rows[1], rows[2], rows[3], pool.jacobian[a],
        pool.pivots[FREEDOMS * a : FREEDOMS * a + FREEDOMS], pool.diagnostics[a], pool.sums[a], pool.observed, pool.rows,
    )  # fmt: skip


@njit(**BARE)
def pair_tile(t, pool):
    """Return tile t of the contacts between bodies."""
    return Tile(pool.pair_inputs[t], pool.pair_outputs[t], pool.pair_tangents[t], pool.pair_geometry[t])


@njit(**BARE)
def tile_count(t, m):
    """Return the number of contacts in tile t, of m contacts between bodies."""
    return min(np.int64(TILE), m - t * TILE)


@njit(**BARE)
def active_at(a, context, island):
    """Return the body at position a of the island."""
    return active_body(island.bodies[a], context)
