"""Implicit integrator of many bodies that touch only flat plates: of open contacts and of spheres there are no tables.

Bodies are advanced batch by batch, each by one of the threads. Only closed contacts keep their rows between two calls
(`engine.contact_rows`); rows of all candidates of a body, and its spheres, exist while it is advanced, with the same bits
(`kernels.implicit.ensemble`). A clump of six spheres then takes 3.5 kB, not 7.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from thirdbody.engine.candidates import AllRows, ClosedRows
from thirdbody.engine.implicit import Implicit
from thirdbody.engine.islands import BATCH
from thirdbody.engine.state import Array, State, table
from thirdbody.jit.arguments import address
from thirdbody.jit.threads import allowed_threads, distribute
from thirdbody.kernels.implicit import driver
from thirdbody.kernels.implicit.ensemble import OneBody, Span, advance_batch
from thirdbody.kernels.implicit.workspace import ADVANCE
from thirdbody.kernels.memory import ClosedContacts
from thirdbody.kernels.tables import sphere

BATCHES = 16
"""Batches of a thread in a call: at its end others wait for half a batch on average."""


class Scratch(NamedTuple):
    """Tables of a thread: those of one body, and the closed contacts of a batch."""

    one: OneBody
    closed: ClosedContacts


def is_ensemble(state: State) -> bool:
    """Return whether the bodies are more than a batch, and meet flat plates only, without measures that sum over contacts."""
    return state.n_bodies > BATCH and not (state.world.debris_meets or state.world.rough or state.physics.measures)


class ImplicitEnsemble(Implicit):
    """`Implicit` for a state that fits `is_ensemble`."""

    def start(self) -> None:
        """Make every sphere a candidate with both plates, for the whole run, and keep only rows of closed contacts."""
        super().start()
        state, slots = self.state, self.state.slots
        edges = np.append(slots.edges[:-1:BATCH], slots.edges[-1]).astype(np.int64)
        # batches: the candidates of a body follow each other, in the order of the bodies
        assert slots.count == slots.n_plates and np.array_equal(slots.incidence[::2], 2 * np.arange(0, slots.count, 2))
        slots.rows = ClosedRows.of(edges, BATCH, slots.H, slots.R)
        slots.outer, slots.near, slots.closed = slots.outer[:0].copy(), slots.near[:0].copy(), slots.closed[:0].copy()
        if state.S is not state.B:
            state.drop_spheres()

    def _make_scratch(self) -> Scratch:
        """Return tables with room for the rows and the spheres of any body, and for the closed contacts of any batch."""
        state, rows = self.state, self.state.slots.rows
        assert isinstance(rows, ClosedRows)
        spheres = int(np.diff(state.start).max()) if state.sphere_table is None else 0
        H, R = (np.zeros((self.max_per_body, width)) for width in rows.widths)
        radii = state.radii if state.sphere_table is None else np.zeros(0)
        return Scratch(OneBody(H, R, table(spheres, sphere.WIDTH), radii), rows.scratch())

    def _contact_tables(self) -> dict[str, Array]:
        rows, state = self.state.slots.rows, self.state
        if isinstance(rows, AllRows):
            return super()._contact_tables()
        H, R = (np.zeros((0, width)) for width in rows.widths)
        return {"S": np.zeros((0, sphere.WIDTH)) if state.sphere_table is None else state.S, "H": H, "R": R}

    @property
    def per_call(self) -> int:
        """Largest number of bodies in a call."""
        return BATCH if isinstance(self.state.slots.rows, AllRows) else BATCH * BATCHES * allowed_threads()

    def advance_islands(self, first: int, last: int, until: float, tries: float = math.inf) -> None:
        """Advance bodies `first` to `last` - 1 to a time [s], with at most `tries` trial steps each (`Implicit`)."""
        rows = self.state.slots.rows
        if isinstance(rows, AllRows):
            super().advance_islands(first, last, until, tries)
            return
        context, tables, step = self.packed(), self.packed_islands(), address(driver.advance_islands, ADVANCE)

        def worker() -> Callable[[int], None]:
            own, packed, scratch = self._make_scratch(), context.copy(), self.scratch()

            def advance(number: int) -> None:
                low, high = max(first, number * BATCH), min(last, (number + 1) * BATCH)
                if self._waiting(low, high, until):
                    span = Span(number * BATCH, min((number + 1) * BATCH, self.state.n_bodies), low, high, step)
                    closed = rows.compact[number]
                    n = advance_batch(span, until, tries, packed, tables, scratch, (closed.contacts(), own.closed), own.one)
                    closed.replace(own.closed, n)

            return advance

        distribute(range(first // BATCH, -(-last // BATCH)), worker)
