"""Fields of laws between the rows of contacts and tiles: columns around them, and fields in one piece per contact."""

from __future__ import annotations

from collections import namedtuple

import numpy as np
import pytest
from numba import njit

from thirdbody.kernels.bundles import Tile
from thirdbody.kernels.columns import contact_state, geometry, law_input, law_output
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.contact_fields import load_field, pieces
from thirdbody.kernels.contact_geometry import gather_history, load_history
from thirdbody.kernels.contact_history import store_history

NUMBER = TILE
Rows = namedtuple("Rows", "H kind n_history field_begin field_size")  # noqa: PYI024


@njit
def load(slots, context, tile):
    """Load contact by contact, as contacts with plates."""
    for q in range(len(slots)):
        load_history(q, slots[q], context, tile)


@njit
def gather(slots, context, tile):
    """Load four contacts at a time, as contacts between spheres."""
    for q in range(0, len(slots), 4):
        gather_history(q, (slots[q], slots[q + 1], slots[q + 2], slots[q + 3]), context, tile)
    for q in range(len(slots)):
        load_field(q, slots[q], context, tile)


@njit
def store(slots, context, tile):
    """Store all."""
    store_history(len(slots), slots, context, tile)


def tile_for(history):
    """An empty tile."""
    return Tile(
        np.zeros((law_input.HISTORY + max(history, 4)) * TILE), np.zeros((law_output.HISTORY + history) * TILE),
        np.zeros(0), np.ones(geometry.WIDTH * TILE),
    )  # fmt: skip


@pytest.mark.parametrize("read", [load, gather])
@pytest.mark.parametrize(
    ("history", "begin", "size"), [(5, 5, 0), (2, 2, 0), (7, 2, 5), (9, 1, 6), (12, 5, 6), (16, 8, 8)], ids=str
)
def test_rows_survive_loading_and_storing(read, history, begin, size):
    """Every place of a field: first columns (which are loaded in fours) or later, other history behind it."""
    rng = np.random.default_rng(history)
    rows = rng.uniform(1.0, 2.0, (NUMBER, max(contact_state.LAW + history, contact_state.MIN_WIDTH)))
    slots = rng.permutation(NUMBER)
    context = Rows(rows.copy(), np.zeros(NUMBER, np.int32), history, begin, size)
    tile = tile_for(history)
    read(slots, context, tile)
    inputs = tile.inputs.reshape(-1, TILE)[law_input.HISTORY :][:history]
    laws = rows[slots, contact_state.LAW : contact_state.LAW + history]
    assert np.array_equal(pieces(inputs[begin : begin + size]), laws[:, begin : begin + size])
    others = np.r_[:begin, begin + size : history]
    assert np.array_equal(inputs[others], laws[:, others].T)
    tile.outputs.reshape(-1, TILE)[law_output.HISTORY :] = 2.0 * inputs
    store(slots, context, tile)
    assert np.array_equal(context.H[slots, contact_state.LAW : contact_state.LAW + history], 2.0 * laws)
