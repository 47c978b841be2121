"""Parts of arrays of constant size, fields of laws between the rows of contacts and tiles."""

from collections import namedtuple

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from thirdbody.jit.arguments import array_part
from thirdbody.kernels.arguments import Tile
from thirdbody.kernels.contact_geometry import gather_history, load_history
from thirdbody.kernels.memory import load_field, pieces, store_history
from thirdbody.kernels.tables import contact_state
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output

Rows = namedtuple("Rows", "H kind n_history field_begin field_size")  # noqa: PYI024


@njit
def doubled(array, first):
    part = array_part(3, array, first)
    for i in range(len(part)):
        part[i] *= 2.0
    return len(part)


def test_a_part_is_a_view():
    array = np.arange(10.0)
    assert doubled(array, 4) == 3
    assert array.tolist() == [0.0, 1.0, 2.0, 3.0, 8.0, 10.0, 12.0, 7.0, 8.0, 9.0]
    assert array_part(3, array, 4).tolist() == [8.0, 10.0, 12.0]
    with pytest.raises(TypingError):  # gaps
        doubled(np.zeros((4, 4))[:, 1], 0)


@njit
def load(slots, context, tile):
    for q in range(len(slots)):
        load_history(q, slots[q], context, tile)


@njit
def gather(slots, context, tile):
    for q in range(0, len(slots), 4):
        gather_history(q, (slots[q], slots[q + 1], slots[q + 2], slots[q + 3]), context, tile)
    for q in range(len(slots)):
        load_field(q, slots[q], context, tile)


@njit
def store(slots, context, tile):
    store_history(len(slots), slots, context, tile)


@pytest.mark.parametrize("read", [load, gather])
def test_rows_survive_loading_and_storing(read):
    """Every place of a field: first columns (which are loaded in fours) or later, other history behind it."""
    for history, begin, size in ((5, 5, 0), (2, 2, 0), (7, 2, 5), (9, 1, 6), (12, 5, 6), (16, 8, 8)):
        rng = np.random.default_rng(history)
        rows = rng.uniform(1.0, 2.0, (TILE, max(contact_state.LAW + history, contact_state.MIN_WIDTH)))
        slots = rng.permutation(TILE)
        context = Rows(rows.copy(), np.zeros(TILE, np.int32), history, begin, size)
        widths = law_input.HISTORY + max(history, 4), law_output.HISTORY + history
        tile = Tile(*(np.zeros(width * TILE) for width in widths), np.zeros(0), np.ones(geometry.WIDTH * TILE))
        read(slots, context, tile)
        inputs = tile.inputs.reshape(-1, TILE)[law_input.HISTORY :][:history]
        laws = rows[slots, contact_state.LAW : contact_state.LAW + history]
        assert np.array_equal(pieces(inputs[begin : begin + size]), laws[:, begin : begin + size]), history
        others = np.r_[:begin, begin + size : history]
        assert np.array_equal(inputs[others], laws[:, others].T), history
        tile.outputs.reshape(-1, TILE)[law_output.HISTORY :] = 2.0 * inputs
        store(slots, context, tile)
        assert np.array_equal(context.H[slots, contact_state.LAW : contact_state.LAW + history], 2.0 * laws), history
