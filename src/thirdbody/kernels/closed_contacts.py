"""Rows of closed contacts only, and rows of all candidates of one body."""

from typing import NamedTuple

import numpy as np
from numba import njit, types

from thirdbody.jit.options import BARE_CHUNK
from thirdbody.kernels.tables import contact_state

Array = np.ndarray


class ClosedContacts(NamedTuple):
    """Closed contacts of a batch: their candidates, counted from the first one of the batch, in order, and their rows."""

    on: Array
    H: Array
    R: Array


_TABLE = types.Array(types.float64, 2, "C")
CLOSED = types.NamedTuple((types.Array(types.int32, 1, "C"), _TABLE, _TABLE), ClosedContacts)
"""Type of these tables."""


@njit(**BARE_CHUNK)
def expand(n, p, first, closed, H, R):
    """Write the rows of the n candidates of a body, from `first` on: zeros for open ones. p: row of its first closed one."""
    for k in range(n):
        if p < closed.on.shape[0] and closed.on[p] == first + k:
            for column in range(H.shape[1]):
                H[k, column] = closed.H[p, column]
            for column in range(R.shape[1]):
                R[k, column] = closed.R[p, column]
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
            for column in range(H.shape[1]):
                closed.H[p, column] = H[k, column]
            for column in range(R.shape[1]):
                closed.R[p, column] = R[k, column]
            p += 1
    return p


@njit(**BARE_CHUNK)
def keep(low, high, p, closed, new):
    """Copy rows `low` to `high` - 1 of a body that is not advanced, from row p on; return the row after them."""
    for k in range(low, high):
        new.on[p] = closed.on[k]
        for column in range(closed.H.shape[1]):
            new.H[p, column] = closed.H[k, column]
        for column in range(closed.R.shape[1]):
            new.R[p, column] = closed.R[k, column]
        p += 1
    return p
