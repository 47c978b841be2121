"""Candidate contacts: pairs that may touch, with their histories and records."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thirdbody.engine.contact_rows import AllRows, ClosedRows
from thirdbody.kernels.plates import BASINS
from thirdbody.kernels.table import Rows
from thirdbody.kernels.tables import DEBRIS, LOWER, UPPER, contact_state, record, remote_force, surface_contact

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Numbers = NDArray[np.int32]
"""Indices of candidates and spheres; 32 bits halve the memory traffic of the step loop."""


@dataclass
class Candidates:
    """Sorted candidate contacts, those with plates first.

    Q: closest points of rough plates, one row per candidate with a plate, or no rows. `rows`: histories H, and records R of the
    last observed step, or no rows of R. F: remote forces. `closed` (n,): 1: in contact, else 0.
    `edges` (n_bodies + 1,): first entry of each body in `incidence` (2 * candidate, +1 if the body is the partner).
    `near`: spheres that have candidates; those of each body start at `beginning` (n_bodies + 1,).
    `outer` (n,): number of the remote force on the partner's body, `remote_body`; -1: both bodies are in one group.
    `cuts` (3, chunks + 1): see `kernels.bodies`. `lowest` (groups,): first group whose contacts act on bodies of the group.
    `needs`: offsets (groups + 1,) of the lists of other groups whose bodies the group's contacts need, then these lists.
    """

    own: Numbers
    partner: Numbers
    kind: Numbers
    closed: NDArray[np.int8]
    outer: Numbers
    edges: Numbers
    incidence: Numbers
    near: Numbers
    beginning: Numbers
    remote_body: Numbers
    cuts: Numbers
    lowest: Numbers
    needs: Numbers
    n_plates: int
    Q: Array
    F: Array
    rows: AllRows | ClosedRows

    @property
    def H(self) -> Array:
        """Histories, a row for each candidate: a copy where only closed contacts have rows."""
        return self.rows.H

    @property
    def R(self) -> Array:
        """Records of the candidates, as H."""
        return self.rows.R

    @property
    def count(self) -> int:
        """Number of candidates."""
        return len(self.own)

    @property
    def sides(self) -> Ints:
        """Partner (n,) of each candidate: LOWER, UPPER or DEBRIS (`columns.sides`)."""
        return sides_of(self.partner)

    @property
    def patches(self) -> Ints:
        """Patch of the upper plate (n,) that is the partner of each candidate; negative for any other partner."""
        return (-1 - self.partner.astype(np.int64)) // BASINS - 1

    @property
    def histories(self) -> Rows:
        """Contact histories by name (`kernels.tables.contact_state`)."""
        return Rows((self.H, contact_state))

    @property
    def records(self) -> Rows:
        """Records of the candidates by name (`kernels.tables.record`)."""
        return Rows((self.R, record))

    @property
    def max_per_body(self) -> int:
        """Largest number of candidates of one body."""
        return int(np.diff(self.edges).max(initial=0))


def sides_of(partner: Numbers) -> Ints:
    """Return LOWER, UPPER or DEBRIS (`columns.sides`) for each partner code (`kernels.plates`)."""
    return np.where(partner >= 0, DEBRIS, np.where(partner < -BASINS, UPPER, LOWER))


def empty_slots(memory: int, record: int) -> Candidates:
    """Return a table of candidates without rows; `memory`, `record`: columns of H and R."""
    none, cuts = np.zeros(0, np.int32), np.zeros((3, 1), np.int32)
    H, F, R = np.zeros((0, memory)), np.zeros((0, remote_force.WIDTH_WITHOUT_NORMAL_LOSS)), np.zeros((0, record))
    Q = np.zeros((0, surface_contact.WIDTH))
    return Candidates(
        none, none, none, none.astype(np.int8), none, none, none, none, none, none, cuts, none, none, 0, Q, F, AllRows(H, R)
    )  # fmt: skip
