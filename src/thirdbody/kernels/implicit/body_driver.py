"""The driver of bodies that touch only the plates."""

import numpy as np
from numba import types

from thirdbody.jit.arguments import PACKED
from thirdbody.jit.options import DIRECT, entry
from thirdbody.kernels.implicit.bdf2 import advance_body
from thirdbody.kernels.implicit.bundles import context_of, make_workspace
from thirdbody.kernels.implicit.tables import step_start


@entry(types.void(types.int64, types.int64, types.float64, types.float64, PACKED), nogil=True, **DIRECT)
def advance_bodies(low, high, until, tries, packed):
    """Advance bodies `low` to `high` - 1 in sequence to the time `until` [s], with individual time steps.

    A body stops after `tries` trial steps; the next call continues it bit for bit. A body stopped by a guard has its code in
    `memory` (step_memory.CODE) and stays at the end of its last step. `packed`: a packed `ImplicitContext`. Threads may advance
    different bodies at once.
    """
    context = context_of(packed)
    space, start = make_workspace(context), np.zeros(step_start.WIDTH)
    for b in range(low, high):
        advance_body(b, until, tries, context, start, space)
