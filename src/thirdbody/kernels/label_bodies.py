"""Labels of all bodies, computed only when requested.

A module apart, so that the step loop compiles without it.
"""

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, DIRECT, NO_COUNTS, entry
from thirdbody.kernels.labeller_input import Observed, body_contacts, body_row
from thirdbody.kernels.signatures import LABEL, OBSERVE
from thirdbody.kernels.tables import loaded_contact, run_totals

_F2, _F1 = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C")
_I1 = types.Array(types.int32, 1, "C")
OBSERVED = types.NamedTuple((_I1,) * 4 + (_F2,) * 6 + (_F1, types.int64, types.int64), Observed)
LABEL_BODIES = types.void(OBSERVED, _F1, types.int64, types.int64, _F2, _F1, _F2)

observe_at, label_at = function_at(OBSERVE), function_at(LABEL)


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


@entry(LABEL_BODIES, nogil=True, **DIRECT, **NO_COUNTS)
def label_bodies(context, A, observe, label, out, observed, table):
    """Compute state, reason, margins and extras of every body from the contacts that carry a load.

    `context`: with a copy of the labeller's memory; `observe`, `label`: addresses of the labeller's functions. Scratch:
    `observed` (observed_body.WIDTH,) and `table` (largest number of contacts of a body, width).
    """
    for b in range(context.B.shape[0]):
        n = body_contacts(b, context, table)
        body_row(b, context, A, observed)
        if A[run_totals.ELAPSED] > 0.0:
            observe_at(observe)(table[:n], n, observed, context.M[b])
        n = compact_loaded(table, n)
        label_at(label)(table[:n], n, observed, context.M[b], out[b])
