"""Labels of all bodies, computed only when requested.

A module apart, so that the step loop compiles without it.
"""

import numpy as np
from numba import njit, types

from thirdbody.jit.options import BARE, DIRECT, NO_COUNTS
from thirdbody.kernels.columns import loaded_contact, run_totals
from thirdbody.kernels.contact_history import labeller_column
from thirdbody.kernels.labeller_input import body_contacts, body_row
from thirdbody.kernels.signatures import LABEL, OBSERVE

_F2, _F1 = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C")
_I1 = types.Array(types.int32, 1, "C")
LABEL_BODIES = types.void(
    _I1, _I1, _I1, _I1, _F2, _F2, _F2, _F2, _F1, _F2, types.UniTuple(types.float64, 2), types.float64,
    types.int64, types.int64, types.FunctionType(OBSERVE), types.FunctionType(LABEL), _F2, _F1, _F2,
)  # fmt: skip


@njit(**BARE)
def compact_loaded(C, n):
    """Move the rows of contacts that carry a load to the front of the table C; return their number.

    Where a sphere leaves a plate its dashpot can cancel the elastic force: the contact is closed, but carries nothing.
    """
    m = np.int64(0)
    for i in range(n):
        if C[i, loaded_contact.NORMAL_FORCE] != 0.0 or C[i, loaded_contact.LOAD] > 0.0:
            for k in range(C.shape[1]):
                C[m, k] = C[i, k]
            m += 1
    return m


@njit(LABEL_BODIES, **DIRECT, **NO_COUNTS)
def label_bodies(edges, incidence, own, partner, H, R, B, E, A, M, drag, speed, n_history, width, observe, label, out, O, table):  # noqa: E741
    """Compute state, reason, margins and extras of every body from the contacts that carry a load.

    M: a copy of the labeller's memory. Scratch: O (observed_body.WIDTH,), table (largest number of contacts of a body, width).
    """
    for b in range(B.shape[0]):
        n = body_contacts(b, edges, incidence, own, partner, H, R, width, labeller_column(n_history), table)
        body_row(b, B, E, A, drag, speed, O)
        if A[run_totals.ELAPSED] > 0.0:
            observe(table[:n], n, O, M[b])
        n = compact_loaded(table, n)
        label(table[:n], n, O, M[b], out[b])
