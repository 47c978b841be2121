"""Histories and records of candidates: a row for each of them, or rows of closed contacts only, batch by batch of bodies.

Of the twelve candidates of a clump of six spheres between two plates, some four are closed. An open one has no history
(`kernels.memory.reset_history`), and its record is never read.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thirdbody.kernels.memory import ClosedContacts
from thirdbody.kernels.tables import contact_state

Array = NDArray[np.float64]
Numbers = NDArray[np.int32]

SPARE = 1.1
"""Room in the rows of a batch over their number when they were allocated: few batches need new ones later."""

EXPECTED = 4.0
"""Closed contacts of a body, to estimate the memory of a run before its first step: 3.1 to 3.9 were counted in clumps of 4 to 8
spheres between pressing and 5 um of drag."""


@dataclass
class AllRows:
    """A row for each candidate: histories H; records R, or no rows where they are not needed."""

    H: Array
    R: Array

    @property
    def widths(self) -> tuple[int, int]:
        """Number of columns of histories and of records."""
        return self.H.shape[1], self.R.shape[1]

    def expected_bytes(self, _bodies: int) -> int:
        """Return the bytes that the rows will take besides those of H and R: none."""
        return 0

    def closed(self) -> NDArray[np.int64]:
        """Return the numbers of the closed candidates."""
        return np.flatnonzero(self.H[:, contact_state.SLIP] > 0.0)

    def histories(self, closed: NDArray[np.int64], columns: Any) -> Array:
        """Return columns of the histories of closed candidates."""
        return self.H[:, columns][closed]

    def records(self, closed: NDArray[np.int64], *columns: Any) -> list[Array]:
        """Return columns of the records of closed candidates, an array for each column or slice of them."""
        return [self.R[:, each][closed] for each in columns]


@dataclass
class Batch:
    """Closed candidates `on`, counted from the first one of the batch, and their rows; the tables may have spare rows."""

    on: Numbers
    H: Array
    R: Array

    @classmethod
    def of(cls, on: Numbers, H: Array, R: Array) -> Batch:
        """Return copies, with spare rows."""
        n = int(SPARE * len(on))
        batch = cls(on, np.empty((n, H.shape[1])), np.empty((n, R.shape[1])))
        batch.H[: len(on)], batch.R[: len(on)] = H, R
        return batch

    def contacts(self) -> ClosedContacts:
        """Return the tables for kernels."""
        return ClosedContacts(self.on, self.H, self.R)

    def replace(self, contacts: ClosedContacts, n: int) -> None:
        """Take copies of the first n of these contacts."""
        self.on = contacts.on[:n].copy()
        if n > len(self.H):
            larger = Batch.of(self.on, contacts.H[:n], contacts.R[:n])
            self.H, self.R = larger.H, larger.R
        else:
            self.H[:n], self.R[:n] = contacts.H[:n], contacts.R[:n]


@dataclass
class ClosedRows:
    """Rows of closed contacts only. `edges` (batches + 1,): first candidate of each batch of `size` bodies."""

    edges: NDArray[np.int64]
    size: int
    widths: tuple[int, int]
    compact: list[Batch] = field(default_factory=list)

    @classmethod
    def of(cls, edges: NDArray[np.int64], size: int, H: Array, R: Array) -> ClosedRows:
        """Return the closed ones of all rows."""
        rows = cls(edges, size, (H.shape[1], R.shape[1]))
        for low, high in zip(edges, edges[1:], strict=False):
            on = np.flatnonzero(H[low:high, contact_state.SLIP]).astype(np.int32)
            rows.compact.append(Batch.of(on, H[low:high][on], R[low:high][on]))
        return rows

    @classmethod
    def restored(cls, edges: NDArray[np.int64], size: int, closed: NDArray[np.int64], rows: tuple[Array, Array]) -> ClosedRows:
        """Return the rows of closed candidates, as `closed` and `pieces` gave them."""
        H, R = rows
        result, cuts = cls(edges, size, (H.shape[1], R.shape[1])), np.searchsorted(closed, edges)
        for first, low, high in zip(edges, cuts, cuts[1:], strict=False):
            on = (closed[low:high] - first).astype(np.int32)
            result.compact.append(Batch(on, H[low:high].copy(), R[low:high].copy()))
        return result

    def expand(self, number: int) -> tuple[Array, Array]:
        """Return the rows of all candidates of a batch, in new tables: zeros for open ones."""
        batch, n = self.compact[number], int(self.edges[number + 1] - self.edges[number])
        H, R = (np.zeros((n, width)) for width in self.widths)
        H[batch.on], R[batch.on] = batch.H[: len(batch.on)], batch.R[: len(batch.on)]
        return H, R

    def closed(self) -> NDArray[np.int64]:
        """Return the numbers of the closed candidates."""
        return np.concatenate([batch.on + first for batch, first in zip(self.compact, self.edges, strict=False)])

    def pieces(self) -> tuple[list[Array], list[Array]]:
        """Return histories and records of the closed candidates, batch by batch, without copies."""
        return [each.H[: len(each.on)] for each in self.compact], [each.R[: len(each.on)] for each in self.compact]

    def histories(self, closed: NDArray[np.int64], columns: Any) -> Array:
        """Return columns of the histories of closed candidates."""
        return self._columns(0, closed, columns)[0]

    def records(self, closed: NDArray[np.int64], *columns: Any) -> list[Array]:
        """Return columns of the records of closed candidates, an array for each column or slice of them."""
        return self._columns(1, closed, *columns)

    def _columns(self, which: int, closed: NDArray[np.int64], *columns: Any) -> list[Array]:
        """Return columns of histories (0) or records (1)."""
        pieces, none, end = self.pieces()[which], np.empty((1, self.widths[which])), 0
        result = [np.empty((sum(map(len, pieces)), *none[:, each].shape[1:])) for each in columns]
        for rows in pieces:
            begin, end = end, end + len(rows)
            for each, array in zip(columns, result, strict=True):  # all of a batch while it is in the cache
                array[begin:end] = rows[:, each]
        if len(closed) == end:
            return result
        some = np.searchsorted(self.closed(), closed)
        return [array[some] for array in result]

    @property
    def number(self) -> int:
        """Number of batches."""
        return len(self.edges) - 1

    def scratch(self) -> ClosedContacts:
        """Return tables with room for the closed contacts of any batch."""
        largest = int(np.diff(self.edges).max(initial=0))
        H, R = (np.zeros((largest, width)) for width in self.widths)
        return ClosedContacts(np.zeros(largest, np.int32), H, R)

    @property
    def H(self) -> Array:
        """Histories of all candidates: a table made anew, for readers that are not made for many bodies."""
        return self._whole(0)

    @property
    def R(self) -> Array:
        """Records of all candidates, as H."""
        return self._whole(1)

    def _whole(self, which: int) -> Array:
        table = np.zeros((int(self.edges[-1]), self.widths[which]))
        table[self.closed()] = np.concatenate(self.pieces()[which])
        return table

    def expected_bytes(self, bodies: int) -> int:
        """Return the bytes that the rows are expected to take during a run."""
        return int(SPARE * EXPECTED * bodies * (4 + 8 * sum(self.widths)))
