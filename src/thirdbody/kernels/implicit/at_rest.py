"""Contacts with plates evaluated anew where they are, because the surfaces of the plates have changed.

It is a step in which nothing moves, as short as any: slip, and work of dashpots in it, are those of rounding.
"""

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import PACKED
from thirdbody.jit.options import BARE_CHUNK, NO_COUNTS, OPTIONS, entry
from thirdbody.kernels.arguments import Motion
from thirdbody.kernels.implicit import books, workspace
from thirdbody.kernels.implicit.accept_step import commit
from thirdbody.kernels.implicit.control import BodyStop
from thirdbody.kernels.implicit.residual import active_contacts, measure_arm, residual, save_start
from thirdbody.kernels.implicit.workspace import FREEDOMS, body_at, last_candidate, space_at
from thirdbody.kernels.step_tables import contact_sums, step_memory, step_settings, step_start
from thirdbody.kernels.tables import run_totals


@njit(**BARE_CHUNK)
def evaluate_body(a, context, island, scratch):
    """Store histories, records and forces of the contacts of a body with plates; its next step starts anew, by backward Euler."""
    b, space = body_at(a, island), space_at(a, scratch)
    Z, T, A, dt = space.start, context.memory[b], context.totals[b], context.settings[step_settings.SHORTEST]
    speed = A[run_totals.PLATE_SPEED]
    motion = Motion(dt, speed * A[run_totals.HEADING], speed * A[run_totals.HEADING + 1])
    measure_arm(context, b, space)
    save_start(a, context, island, scratch)
    Z[step_start.NOW], Z[step_start.LAST], Z[step_start.OLD_WEIGHT] = 1.0, 0.0, 0.5
    for k in range(FREEDOMS):
        space.trial[k] = 0.0
    for k in range(contact_sums.WIDTH):
        space.sums[0, k] = 0.0
    m = active_contacts(a, motion, context, island, scratch)
    if m < 0:
        T[step_memory.CODE] = np.int64(BodyStop.CROWDED)
        return
    residual(a, m, motion, context, island, scratch)
    A[run_totals.DAMPING_WORK] += commit(context, b, m, motion, space)
    A[run_totals.FRICTION_WORK] += space.sums[0, contact_sums.FRICTION_WORK]
    for k in range(3):
        A[run_totals.UPPER_FORCE + k] = -space.sums[0, contact_sums.UPPER_FORCE + k]
        A[run_totals.LOWER_FORCE + k] = -space.sums[0, contact_sums.LOWER_FORCE + k]
    T[step_memory.STORED], T[step_memory.LAST_DT], T[step_memory.JUMPED] = 0.0, 0.0, 0.0
    for e in range(context.plate_edges[b], last_candidate(b, context)):
        T[step_memory.STORED] += books.stored_energy(context.plate_incidence[e] >> 1, context)


@entry(types.void(types.int64, types.int64, PACKED, PACKED, PACKED), nogil=True, **OPTIONS, **NO_COUNTS)
def evaluate_islands(first, last, packed, tables, packed_scratch):
    """Evaluate the bodies of the islands `order[first:last]`."""
    context, islands, scratch = workspace.unpack(packed, tables, packed_scratch)
    for p in range(first, last):
        island = workspace.island_at(islands.order[p], islands)
        for a in range(island.n):
            evaluate_body(a, context, island, scratch)
