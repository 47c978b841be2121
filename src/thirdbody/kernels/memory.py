"""Memory of contacts from step to step: rows of histories, fields of laws, rows of closed contacts only; parameters of a tile."""

from collections import namedtuple

import numpy as np
from numba import njit, types

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import LANES, broadcast, clamp_below, get, store, transpose
from thirdbody.kernels.tables import contact_state
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output


def pieces(columns: np.ndarray) -> np.ndarray:
    """Return the fields (TILE, size) of the contacts of a tile as a view of their place, the columns (size, TILE)."""
    return columns.reshape(TILE, len(columns))


@njit(**BARE)
def load_field(q, k, context, tile):
    I, H, begin, size = tile.inputs, context.H, context.field_begin, context.field_size  # noqa: E741
    at = (law_input.HISTORY + begin) * TILE + q * size
    for f in range(size):
        I[at + f] = H[k, contact_state.LAW + begin + f]


@njit(**BARE)
def spring_energy(k, context):
    return context.H[k, contact_state.LAW + context.stored] if context.stored >= 0 else 0.0


@njit(**BARE)
def reset_history(k, context):
    """Clear the history of a contact that opened, but for measures; return the energy of its tangential springs [J]: lost."""
    lost, H = spring_energy(k, context), context.H
    for h in range(H.shape[1] - context.measured):
        H[k, h] = 0.0
    return lost


@njit(**BARE)
def store_one(k, q, axis, first, context, tile):
    """Store frame axis, slip and history of candidate k. `first`: four numbers of the history; the rest are in element q."""
    H, O = context.H, tile.outputs  # noqa: E741
    store(H, k, contact_state.AXIS, axis)
    store(H, k, contact_state.LAW, first)
    if context.field_size == 0:
        for h in range(LANES, context.n_history):
            H[k, contact_state.LAW + h] = O[q + (law_output.HISTORY + h) * TILE]
    else:
        store_around_field(q, k, context, tile)


@njit(**BARE_CHUNK)
def store_around_field(q, k, context, tile):
    H, O, begin, size = context.H, tile.outputs, context.field_begin, context.field_size  # noqa: E741
    at = (law_output.HISTORY + begin) * TILE + q * size
    for f in range(size):
        H[k, contact_state.LAW + begin + f] = O[at + f]
    for h in range(LANES, context.n_history):
        if not begin <= h < begin + size:
            H[k, contact_state.LAW + h] = O[q + (law_output.HISTORY + h) * TILE]


@njit(**BARE_CHUNK)
def store_history(n, slots, context, tile):
    O, G, n_history, none = tile.outputs, tile.geometry, context.n_history, broadcast(0.0)  # noqa: E741
    for q in range(0, n, LANES):
        e, h = q + geometry.AXIS * TILE, q + law_output.HISTORY * TILE
        on = clamp_below(get(G, q + geometry.PREVIOUS_SLIP * TILE) + get(O, q + law_output.SLIP * TILE), contact_state.CLOSED)
        axes = transpose(get(G, e), get(G, e + TILE), get(G, e + 2 * TILE), on)
        report = transpose(
            get(O, h) if n_history > 0 else none, get(O, h + TILE) if n_history > 1 else none,
            get(O, h + 2 * TILE) if n_history > 2 else none, get(O, h + 3 * TILE) if n_history > 3 else none,
        )  # fmt: skip
        store_one(np.uint64(slots[q]), q, axes[0], report[0], context, tile)
        if q + 1 < n:
            store_one(np.uint64(slots[q + 1]), q + 1, axes[1], report[1], context, tile)
        if q + 2 < n:
            store_one(np.uint64(slots[q + 2]), q + 2, axes[2], report[2], context, tile)
        if q + 3 < n:
            store_one(np.uint64(slots[q + 3]), q + 3, axes[3], report[3], context, tile)


ClosedContacts = namedtuple("ClosedContacts", "on H R")
"""Closed contacts of a batch: their candidates, counted from the first one of the batch, in order, and their rows."""

_TABLE = types.Array(types.float64, 2, "C")
CLOSED = types.NamedTuple((types.Array(types.int32, 1, "C"), _TABLE, _TABLE), ClosedContacts)  # type of these tables


@njit(**BARE)
def copy_row(H, R, k, to_H, to_R, to):
    for column in range(H.shape[1]):
        to_H[to, column] = H[k, column]
    for column in range(R.shape[1]):
        to_R[to, column] = R[k, column]


@njit(**BARE_CHUNK)
def expand(n, p, first, closed, H, R):
    """Write the rows of the n candidates of a body, from `first` on: zeros for open ones. p: row of its first closed one."""
    for k in range(n):
        if p < closed.on.shape[0] and closed.on[p] == first + k:
            copy_row(closed.H, closed.R, p, H, R, k)
            p += 1
        else:
            H[k, :] = 0.0
            R[k, :] = 0.0


@njit(**BARE_CHUNK)
def compact(n, p, first, H, R, closed):
    """Write the closed ones of the rows of a body's candidates from row p on; return the row after them."""
    for k in range(n):
        if H[k, contact_state.SLIP] != 0.0:
            closed.on[p] = first + k
            copy_row(H, R, k, closed.H, closed.R, p)
            p += 1
    return p


@njit(**BARE_CHUNK)
def keep(low, high, p, closed, new):
    for k in range(low, high):
        new.on[p] = closed.on[k]
        copy_row(closed.H, closed.R, k, new.H, new.R, p)
        p += 1
    return p


@njit(**BARE)
def broadcast_parameters(I, n_contacts, pairs, width, U):  # noqa: E741
    """Copy the row of `pairs` of each contact's pair type to its element in U; mostly all contacts are of one type."""
    first, alike = I[law_input.PAIR_TYPE * TILE], True
    for q in range(n_contacts):
        alike &= I[q + law_input.PAIR_TYPE * TILE] == first
    if alike:
        for f in range(width):
            value = pairs[int(first) * width + f]
            for q in range(0, n_contacts, LANES):
                for k in range(LANES):
                    U[f * TILE + q + k] = value
    else:
        mixed_parameters(I, n_contacts, pairs, width, U)


@njit(**BARE_CHUNK)
def mixed_parameters(I, n_contacts, pairs, width, U):  # noqa: E741
    for q in range(n_contacts):
        o = int(I[q + law_input.PAIR_TYPE * TILE]) * width
        for f in range(width):
            U[f * TILE + q] = pairs[o + f]
