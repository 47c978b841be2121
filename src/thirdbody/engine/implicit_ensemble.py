"""Implicit integrator of many bodies that touch only flat plates: of open contacts and of spheres there are no tables.

Bodies are advanced batch by batch, each by one of the threads. Only closed contacts keep their rows between two calls
(`engine.candidates`); rows of all candidates of a body, and its spheres, exist while it is advanced, with the same bits
(`kernels.implicit.driver`). A clump of six spheres then takes 3.5 kB, not 7.4.
"""

import math
from collections.abc import Callable

import numpy as np

from thirdbody.engine.candidates import ClosedRows
from thirdbody.engine.implicit import Implicit
from thirdbody.engine.state import State, table
from thirdbody.engine.units import BATCH
from thirdbody.jit.arguments import address
from thirdbody.jit.threads import allowed_threads, distribute
from thirdbody.kernels.implicit import driver
from thirdbody.kernels.implicit.driver import OneBody, Span, advance_batch
from thirdbody.kernels.implicit.workspace import ADVANCE
from thirdbody.kernels.memory import ClosedContacts
from thirdbody.kernels.tables import sphere

BATCHES = 16  # batches of a thread in a call: at its end others wait for half a batch on average


def is_ensemble(state: State) -> bool:
    """Return whether the bodies are more than a batch, and meet flat plates only, without measures that sum over contacts."""
    return state.n_bodies > BATCH and not (state.world.debris_meets or state.world.rough or state.physics.measures)


class ImplicitEnsemble(Implicit):
    """`Implicit` for a state that fits `is_ensemble`."""

    def start(self) -> None:
        super().start()
        state, slots = self.state, self.state.slots
        edges = np.append(slots.edges[:-1:BATCH], slots.edges[-1]).astype(np.int64)
        # batches: the candidates of a body follow each other, in the order of the bodies
        assert slots.count == slots.n_plates and np.array_equal(slots.incidence[::2], 2 * np.arange(0, slots.count, 2))
        closed = slots.rows.closed()
        slots.rows = ClosedRows.of(edges, BATCH, closed, (slots.H[closed], slots.R[closed]))
        slots.outer, slots.near, slots.closed = slots.outer[:0].copy(), slots.near[:0].copy(), slots.closed[:0].copy()
        self.start_depths = np.zeros(0)
        if state.S is not state.B:
            state.radii, state.sphere_table = state.S[:, sphere.RADIUS].copy(), None

    @property
    def per_call(self) -> int:
        return BATCH * BATCHES * allowed_threads()

    def advance_islands(self, first: int, last: int, until: float, tries: float = math.inf) -> None:
        state, rows = self.state, self.state.slots.rows
        assert isinstance(rows, ClosedRows)
        context, tables, step = self.packed(), self.pack_islands(self.islands.tables), address(driver.advance_islands, ADVANCE)
        spheres = int(np.diff(state.start).max()) if state.sphere_table is None else 0
        largest = int(np.diff(rows.edges).max(initial=0))

        def worker() -> Callable[[int], None]:
            packed, scratch = context.copy(), self.scratch()
            H, R = (np.zeros((self.max_per_body, width)) for width in rows.widths)
            one = OneBody(H, R, table(spheres, sphere.WIDTH), np.zeros(self.max_per_body), state.radii)
            new = ClosedContacts(np.zeros(largest, np.int32), *(np.zeros((largest, width)) for width in rows.widths))

            def advance(number: int) -> None:
                low, high = max(first, number * BATCH), min(last, (number + 1) * BATCH)
                if self._waiting(low, high, until):
                    span = Span(number * BATCH, min((number + 1) * BATCH, state.n_bodies), low, high, step)
                    n = advance_batch(span, until, tries, packed, tables, scratch, (rows.compact[number], new), one)
                    rows.replace(number, new, n)

            return advance

        distribute(range(first // BATCH, -(-last // BATCH)), worker)
