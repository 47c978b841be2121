"""History of contacts from step to step, in rows of H."""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import LANES, broadcast, clamp_below, get, store, transpose
from thirdbody.kernels.columns import contact_state, geometry, law_output
from thirdbody.kernels.columns.tile import TILE


@njit(**BARE)
def labeller_column(n_history):
    """Return the column of H after the history of the laws, where the memory of the labeller begins."""
    return max(contact_state.LAW + n_history, contact_state.MIN_WIDTH)


@njit(**BARE)
def spring_energy(k, stored, H):
    """Return the energy of the tangential and rolling springs of candidate k [J]. `stored`: its history column; -1: no
    springs."""
    return H[k, contact_state.LAW + stored] if stored >= 0 else 0.0


@njit(**BARE)
def reset_history(k, stored, H):
    """Clear the history of a contact that opened. Returns the energy of its springs (`spring_energy`), which is dissipated
    [J]."""
    lost = spring_energy(k, stored, H)
    for h in range(H.shape[1]):
        H[k, h] = 0.0
    return lost


@njit(**BARE)
def store_one(k, q, axis, first, O, H, n_history):  # noqa: E741
    """Store frame axis, slip and history of candidate k. `first`: four numbers of the history; the rest are in element q."""
    store(H, k, contact_state.AXIS, axis)
    store(H, k, contact_state.LAW, first)
    for h in range(LANES, n_history):
        H[k, contact_state.LAW + h] = O[q + (law_output.HISTORY + h) * TILE]


@njit(**BARE_CHUNK)
def store_history(n, slots, first, O, G, H, n_history):  # noqa: E741
    """Store the history of the contacts slots[first:first + n] after the step, from a tile."""
    none = broadcast(0.0)
    for q in range(0, n, LANES):
        e, h, p = q + geometry.AXIS * TILE, q + law_output.HISTORY * TILE, first + q
        on = clamp_below(get(G, q + geometry.PREVIOUS_SLIP * TILE) + get(O, q + law_output.SLIP * TILE), contact_state.CLOSED)
        axes = transpose(get(G, e), get(G, e + TILE), get(G, e + 2 * TILE), on)
        report = transpose(
            get(O, h) if n_history > 0 else none, get(O, h + TILE) if n_history > 1 else none,
            get(O, h + 2 * TILE) if n_history > 2 else none, get(O, h + 3 * TILE) if n_history > 3 else none,
        )  # fmt: skip
        store_one(np.uint64(slots[p]), q, axes[0], report[0], O, H, n_history)
        if q + 1 < n:
            store_one(np.uint64(slots[p + 1]), q + 1, axes[1], report[1], O, H, n_history)
        if q + 2 < n:
            store_one(np.uint64(slots[p + 2]), q + 2, axes[2], report[2], O, H, n_history)
        if q + 3 < n:
            store_one(np.uint64(slots[p + 3]), q + 3, axes[3], report[3], O, H, n_history)
