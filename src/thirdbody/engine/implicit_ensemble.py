"""Implicit integrator of many bodies that touch only flat plates: tables of contacts and spheres exist for one batch at a time.

Bodies are advanced batch by batch. Only closed contacts keep their rows between two calls (`engine.contact_rows`); spheres are
placed from their bodies (`engine.state.place_some`), with the same bits. A clump of six spheres then takes 3.5 kB, not 7.4.
"""

from __future__ import annotations

import math

import numpy as np

from thirdbody.engine.contact_rows import AllRows, ClosedRows
from thirdbody.engine.implicit import BATCH, Implicit
from thirdbody.engine.state import Array, State, place_some, table
from thirdbody.jit.packed_arguments import first_words
from thirdbody.kernels.columns import sphere
from thirdbody.kernels.implicit import bdf2 as kernel
from thirdbody.kernels.implicit.bundles import KINDS

WORDS = first_words(KINDS)
"""Where the address of each table is in the packed arguments."""


def is_ensemble(state: State) -> bool:
    """Return whether the bodies are more than a batch, and meet flat plates only, without measures that sum over contacts."""
    return state.n_bodies > BATCH and not state.world.rough and not state.physics.measures


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
        self._make_scratch()

    def _make_scratch(self) -> None:
        state, rows = self.state, self.state.slots.rows
        assert isinstance(rows, ClosedRows)
        self._H, self._R = rows.scratch()
        starts = np.append(state.start[:-1:BATCH], state.start[-1])
        largest = int(np.diff(starts).max()) if state.sphere_table is None else 0
        self._S = table(largest, sphere.WIDTH)

    def keep_all_rows(self) -> None:
        """Go on with rows for all candidates and a table of all spheres, as a part of a run, or its whole, does."""
        state, slots = self.state, self.state.slots
        slots.rows, state.S = AllRows(slots.H, slots.R), state.S

    def _contact_tables(self) -> dict[str, Array]:
        state = self.state
        if isinstance(state.slots.rows, AllRows):
            return super()._contact_tables()
        return {"S": self._S if state.sphere_table is None else state.S, "H": self._H, "R": self._R}

    def advance_bodies(self, first: int, last: int, until: float, tries: float = math.inf) -> None:
        """Advance bodies `first` to `last` - 1 to a time [s], with at most `tries` trial steps each (`Implicit`)."""
        rows = self.state.slots.rows
        if isinstance(rows, AllRows):
            super().advance_bodies(first, last, until, tries)
            return
        for number in range(first // BATCH, -(-last // BATCH)):
            low, high = number * BATCH, min((number + 1) * BATCH, self.state.n_bodies)
            n = int(rows.edges[number + 1] - rows.edges[number])
            rows.expand(number, self._H[:n], self._R[:n])
            if self.state.sphere_table is None:
                place_some(self.state, low, high, self._S)
            kernel.advance_bodies(max(first, low), min(last, high), until, tries, self._context_of(number))
            rows.keep(number, self._H[:n], self._R[:n])

    def _context_of(self, number: int) -> Array:
        """Return the packed arguments for a batch: the tables begin with its rows, which kernels count from the first of all."""
        packed, rows, start = self._context().copy(), self.state.slots.rows, self.state.start
        assert isinstance(rows, ClosedRows)
        skipped = {"H": (self._H, rows.edges[number]), "R": (self._R, rows.edges[number])}
        if self.state.sphere_table is None:
            skipped["S"] = self._S, start[number * BATCH]
        for name, (array, first) in skipped.items():
            packed[WORDS[name]] -= int(first) * array.strides[0]
        return packed
