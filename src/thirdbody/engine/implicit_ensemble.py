"""Implicit integrator of many bodies that touch only flat plates: tables of contacts and spheres exist for one batch at a time.

Bodies are advanced batch by batch, each by one of the threads. Only closed contacts keep their rows between two calls
(`engine.contact_rows`); spheres are placed from their bodies (`engine.state.place_some`), with the same bits. A clump of six
spheres then takes 3.5 kB, not 7.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numba
import numpy as np

from thirdbody.engine.contact_rows import AllRows, ClosedRows
from thirdbody.engine.implicit import BATCH, Implicit
from thirdbody.engine.state import Array, State, place_some, table
from thirdbody.jit.packed_arguments import first_words
from thirdbody.jit.threads import distribute
from thirdbody.kernels.columns import sphere
from thirdbody.kernels.implicit import bdf2 as kernel
from thirdbody.kernels.implicit.bundles import KINDS

WORDS = first_words(KINDS)
"""Where the address of each table is in the packed arguments."""

BATCHES = 16
"""Batches of a thread in a call: at its end others wait for half a batch on average."""


class Scratch(NamedTuple):
    """Histories, records and spheres of a batch."""

    H: Array
    R: Array
    S: Array


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

    def _make_scratch(self) -> Scratch:
        """Return tables with room for the rows and the spheres of any batch."""
        state, rows = self.state, self.state.slots.rows
        assert isinstance(rows, ClosedRows)
        starts = np.append(state.start[:-1:BATCH], state.start[-1])
        largest = int(np.diff(starts).max()) if state.sphere_table is None else 0
        return Scratch(*rows.scratch(), table(largest, sphere.WIDTH))

    def keep_all_rows(self) -> None:
        """Go on with rows for all candidates and a table of all spheres, as a part of a run, or its whole, does."""
        state, slots = self.state, self.state.slots
        slots.rows, state.S = AllRows(slots.H, slots.R), state.S

    def _contact_tables(self) -> dict[str, Array]:
        rows, state = self.state.slots.rows, self.state
        if isinstance(rows, AllRows):
            return super()._contact_tables()
        H, R = (np.zeros((0, width)) for width in rows.widths)
        return {"S": np.zeros((0, sphere.WIDTH)) if state.sphere_table is None else state.S, "H": H, "R": R}

    @property
    def per_call(self) -> int:
        """Largest number of bodies in a call."""
        return BATCH if isinstance(self.state.slots.rows, AllRows) else BATCH * BATCHES * numba.get_num_threads()

    def advance_bodies(self, first: int, last: int, until: float, tries: float = math.inf) -> None:
        """Advance bodies `first` to `last` - 1 to a time [s], with at most `tries` trial steps each (`Implicit`)."""
        if isinstance(self.state.slots.rows, AllRows):
            super().advance_bodies(first, last, until, tries)
            return
        context = self._context()

        def worker() -> Callable[[int], None]:
            scratch = self._make_scratch()

            def advance(number: int) -> None:
                low, high = max(first, number * BATCH), min(last, (number + 1) * BATCH)
                if self._waiting(low, high, until):
                    self._advance_batch(
                        number, lambda packed: kernel.advance_bodies(low, high, until, tries, packed), scratch, context
                    )

            return advance

        distribute(range(first // BATCH, -(-last // BATCH)), worker)

    def _advance_batch(self, number: int, advance: Callable[[Array], None], scratch: Scratch, context: Array) -> None:
        """Advance bodies of a batch, with rows for all its candidates and spheres while it is advanced."""
        state, rows = self.state, self.state.slots.rows
        assert isinstance(rows, ClosedRows)
        _, H, R = rows.batch(number, scratch.H, scratch.R)
        if state.sphere_table is None:
            place_some(state, number * BATCH, min((number + 1) * BATCH, state.n_bodies), scratch.S)
        advance(self._context_of(number, scratch, context))
        rows.keep(number, H, R)

    def _context_of(self, number: int, scratch: Scratch, context: Array) -> Array:
        """Return the packed arguments for a batch: the tables begin with its rows, which kernels count from the first of all."""
        packed, rows, start = context.copy(), self.state.slots.rows, self.state.start
        assert isinstance(rows, ClosedRows)
        first = {"H": (scratch.H, rows.edges[number]), "R": (scratch.R, rows.edges[number])}
        if self.state.sphere_table is None:
            first["S"] = scratch.S, start[number * BATCH]
        for name, (array, skipped) in first.items():
            packed[WORDS[name]] = array.ctypes.data - int(skipped) * array.strides[0]
        return packed
