"""Candidate contacts: pairs that may touch, with their histories and records.

Histories and records have a row for each candidate, or rows of closed contacts only, batch by batch of bodies. An open one has no
history (`kernels.memory.reset_history`), and its record is never read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thirdbody.kernels.memory import ClosedContacts
from thirdbody.kernels.plates import BASINS
from thirdbody.kernels.table import Rows
from thirdbody.kernels.tables import DEBRIS, LOWER, UPPER, contact_state, record, remote_force, surface_contact

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Numbers = NDArray[np.int32]  # indices of candidates and spheres; 32 bits halve the memory traffic of the step loop
SPARE = 1.1  # room in the rows of a batch over their number when they were allocated: few batches need new ones later

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
        return self.H.shape[1], self.R.shape[1]

    def closed(self) -> Ints:
        return np.flatnonzero(self.H[:, contact_state.SLIP] > 0.0)

    def histories(self, closed: Ints, columns: Any) -> Array:
        return self.H[:, columns][closed]

    def records(self, closed: Ints, *columns: Any) -> list[Array]:
        return [self.R[:, each][closed] for each in columns]


@dataclass
class ClosedRows:
    """Rows of closed contacts only."""

    edges: Ints  # (batches + 1,): first candidate of each batch
    size: int  # bodies of a batch
    widths: tuple[int, int]  # columns of H and R
    compact: list[ClosedContacts]  # those of each batch, whose H and R may have spare rows

    @classmethod
    def of(cls, edges: Ints, size: int, closed: Ints, rows: tuple[Array, Array]) -> ClosedRows:
        H, R = rows
        result, cuts = cls(edges, size, (H.shape[1], R.shape[1]), []), np.searchsorted(closed, edges)
        for first, low, high in zip(edges, cuts, cuts[1:], strict=False):
            on = (closed[low:high] - first).astype(np.int32)
            result.compact.append(ClosedContacts(on, H[low:high].copy(), R[low:high].copy()))
        return result

    def replace(self, batch: int, contacts: ClosedContacts, n: int) -> None:
        _, H, R = self.compact[batch]
        if n > len(H):
            H, R = (np.empty((int(SPARE * n), width)) for width in self.widths)
        H[:n], R[:n] = contacts.H[:n], contacts.R[:n]
        self.compact[batch] = ClosedContacts(contacts.on[:n].copy(), H, R)

    def closed(self) -> Ints:
        return np.concatenate([batch.on + first for batch, first in zip(self.compact, self.edges, strict=False)])

    def pieces(self) -> tuple[list[Array], list[Array]]:
        """Return histories and records of the closed candidates, batch by batch, without copies."""
        return [each.H[: len(each.on)] for each in self.compact], [each.R[: len(each.on)] for each in self.compact]

    def histories(self, closed: Ints, columns: Any) -> Array:
        return self._columns(0, closed, columns)[0]

    def records(self, closed: Ints, *columns: Any) -> list[Array]:
        return self._columns(1, closed, *columns)

    def _columns(self, which: int, closed: Ints, *columns: Any) -> list[Array]:
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
    def H(self) -> Array:
        """Histories of all candidates: a table made anew, for readers that are not made for many bodies."""
        return self._whole(0)

    @property
    def R(self) -> Array:
        return self._whole(1)

    def _whole(self, which: int) -> Array:
        table = np.zeros((int(self.edges[-1]), self.widths[which]))
        table[self.closed()] = np.concatenate(self.pieces()[which])
        return table

    def expected_bytes(self, bodies: int) -> int:
        return int(SPARE * EXPECTED * bodies * (4 + 8 * sum(self.widths)))


@dataclass
class Candidates:
    """Sorted candidate contacts, those with plates first."""

    own: Numbers
    partner: Numbers
    kind: Numbers
    closed: NDArray[np.int8]  # 1: in contact, else 0
    outer: Numbers  # number of the remote force on the partner's body; -1: both bodies are in one group
    edges: Numbers  # (n_bodies + 1,): first entry of each body in `incidence`
    incidence: Numbers  # 2 * candidate, +1 if the body is the partner
    near: Numbers  # spheres that have candidates
    beginning: Numbers  # (n_bodies + 1,): first one of each body in `near`
    remote_body: Numbers  # the body on which each remote force acts
    cuts: Numbers  # (3, chunks + 1): see `kernels.bodies`
    lowest: Numbers  # (groups,): first group whose contacts act on bodies of the group
    needs: Numbers  # offsets (groups + 1,) of the lists of other groups whose bodies the group's contacts need, then these lists
    n_plates: int
    Q: Array  # closest points of rough plates, a row per candidate with a plate, or no rows
    F: Array  # remote forces
    rows: AllRows | ClosedRows  # histories H, and records R of the last observed step, or no rows of R

    @property
    def H(self) -> Array:
        return self.rows.H

    @property
    def R(self) -> Array:
        return self.rows.R

    @property
    def count(self) -> int:
        return len(self.own)

    @property
    def sides(self) -> Ints:
        """Partner (n,) of each candidate: LOWER, UPPER or DEBRIS (`kernels.tables`)."""
        return sides_of(self.partner)

    @property
    def patches(self) -> Ints:
        """Patch of the upper plate (n,) that is the partner of each candidate; negative for any other partner."""
        return (-1 - self.partner.astype(np.int64)) // BASINS - 1

    @property
    def histories(self) -> Rows:
        return Rows((self.H, contact_state))

    @property
    def records(self) -> Rows:
        return Rows((self.R, record))

    @property
    def max_per_body(self) -> int:
        return int(np.diff(self.edges).max(initial=0))


def sides_of(partner: Numbers) -> Ints:
    return np.where(partner >= 0, DEBRIS, np.where(partner < -BASINS, UPPER, LOWER))


def empty_slots(memory: int, record: int) -> Candidates:
    none, cuts = np.zeros(0, np.int32), np.zeros((3, 1), np.int32)
    H, F, R = np.zeros((0, memory)), np.zeros((0, remote_force.WIDTH_WITHOUT_NORMAL_LOSS)), np.zeros((0, record))
    Q = np.zeros((0, surface_contact.WIDTH))
    return Candidates(
        none, none, none, none.astype(np.int8), none, none, none, none, none, none, cuts, none, none, 0, Q, F, AllRows(H, R)
    )  # fmt: skip
