"""History of contacts from step to step, in rows of H."""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import LANES, broadcast, clamp_below, get, store, transpose
from thirdbody.kernels.contact_fields import store_field
from thirdbody.kernels.tables import contact_state
from thirdbody.kernels.tile import TILE, geometry, law_output


@njit(**BARE)
def labeller_column(n_history):
    """Return the column of H after the history of the laws, where the memory of the labeller begins."""
    return max(contact_state.LAW + n_history, contact_state.MIN_WIDTH)


@njit(**BARE)
def spring_energy(k, context):
    """Return the energy of the tangential and rolling springs of candidate k [J]; 0 if the laws have none."""
    return context.H[k, contact_state.LAW + context.stored] if context.stored >= 0 else 0.0


@njit(**BARE)
def reset_history(k, context):
    """Clear the history of a contact that opened. Returns the energy of its springs (`spring_energy`), which is dissipated.

    What measures have summed stays until it is collected (`engine.measures`).
    """
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
    """Store the history of candidate k from the fifth number on, where one of the laws has a field."""
    H, O, end = context.H, tile.outputs, context.field_begin + context.field_size  # noqa: E741
    for h in range(LANES, context.field_begin):
        H[k, contact_state.LAW + h] = O[q + (law_output.HISTORY + h) * TILE]
    store_field(q, k, context, tile)
    for h in range(max(LANES, end), context.n_history):
        H[k, contact_state.LAW + h] = O[q + (law_output.HISTORY + h) * TILE]


@njit(**BARE_CHUNK)
def store_history(n, slots, context, tile):
    """Store the history of the contacts slots[:n] after the step, from a tile."""
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
