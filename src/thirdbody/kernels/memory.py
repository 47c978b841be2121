"""What contacts remember from step to step, in rows of H."""

import numpy as np
from numba import njit

from .four import at_least, get, lane, store, transposed
from .layout import G_E, G_ON, H_E, H_LAW, H_LEAST, H_STORED, O_HISTORY, O_SLIP, O_STORED_T, TILE
from .options import BARE, BARE_CHUNK


@njit(**BARE)
def release(k, H):
    """A contact that opened: what its tangential spring still held is dissipated (returned), its memory wiped."""
    lost = H[k, H_STORED]
    for h in range(H.shape[1]):
        H[k, h] = 0.0
    return lost


@njit(**BARE)
def learn(k, q, axis, told, O, H, n_history):  # noqa: E741
    """Slot k learns the axis of its frame, and that it touches; energy and history, whose first numbers are `told`, from place
    q."""
    store(H, k, H_E, axis)
    if n_history >= 3:
        store(H, k, H_STORED, told)
    else:
        H[k, H_STORED] = lane(told, 0)
    for h in range(3 if n_history >= 3 else 0, n_history):
        H[k, H_LAW + h] = O[q + (O_HISTORY + h) * TILE]


@njit(**BARE_CHUNK)
def keep(n, slots, first, O, G, H, n_history):  # noqa: E741
    """What the slots[first:first + n] remember of the step, from a tile."""
    for q in range(0, n, 4):
        e, h, p = q + G_E * TILE, q + O_HISTORY * TILE, first + q
        on = at_least(get(G, q + G_ON * TILE) + get(O, q + O_SLIP * TILE), H_LEAST)
        axes = transposed(get(G, e), get(G, e + TILE), get(G, e + 2 * TILE), on)
        # of a law that remembers less, the last of these are something else
        told = transposed(get(O, q + O_STORED_T * TILE), get(O, h), get(O, h + TILE), get(O, h + 2 * TILE))
        learn(np.uint64(slots[p]), q, axes[0], told[0], O, H, n_history)
        if q + 1 < n:
            learn(np.uint64(slots[p + 1]), q + 1, axes[1], told[1], O, H, n_history)
        if q + 2 < n:
            learn(np.uint64(slots[p + 2]), q + 2, axes[2], told[2], O, H, n_history)
        if q + 3 < n:
            learn(np.uint64(slots[p + 3]), q + 3, axes[3], told[3], O, H, n_history)
