"""BDF2 driver of islands: those whose patches are their own, advanced to a common time by individual steps."""

from numba import njit, types

from thirdbody.jit.arguments import PACKED
from thirdbody.jit.options import BARE, DIRECT, entry
from thirdbody.kernels.implicit.bundles import context_of
from thirdbody.kernels.implicit.island_bundles import tables_of
from thirdbody.kernels.implicit.island_step import island_of, island_step, pool_of_part
from thirdbody.kernels.implicit.step_control import Stop
from thirdbody.kernels.implicit.tables import step_memory
from thirdbody.kernels.tables import run_totals


@njit(**BARE)
def is_going(context, island, until):
    """Return whether the island has not reached the time `until` [s], and no body of it has stopped."""
    for a in range(island.bodies.shape[0]):
        if context.memory[island.bodies[a], step_memory.CODE] != Stop.NONE.value:
            return False
    return context.totals[island.bodies[0], run_totals.TIME] < until


@entry(types.void(types.int64, types.float64, types.float64, PACKED, PACKED), nogil=True, **DIRECT)
def advance_part(part, until, tries, packed, packed_tables):
    """Advance the islands of a part to the time `until` [s], with at most `tries` trial steps each.

    In sequence, with one workspace. `packed`: a packed `ImplicitContext`; `packed_tables`: packed `IslandTables`. The parts do
    not change a bit of the result. Threads of Python call this: in a `prange` it would take twice as long to compile.
    """
    context, tables = context_of(packed), tables_of(packed_tables)
    pool = pool_of_part(part, context, tables)
    for p in range(tables.part_edges[part], tables.part_edges[part + 1]):
        island = island_of(tables.order[p], context, tables)
        T = context.memory[island.bodies[0]]
        last = T[step_memory.TRIES] + tries
        while is_going(context, island, until) and T[step_memory.TRIES] < last:
            island_step(context, tables, island, until, pool)
