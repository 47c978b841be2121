"""Bytes that a step moves, by table: every row that it needs comes into the cache once and goes back once if it was written.

A step passes through the bodies group by group, and what a group needs stays in the near cache until it is done. So a row of a
table counts once a step, whatever number of passes use it, and as a whole: neighbours in the table share cache lines. Tiles of
contacts, the gaps of a group and the forces on its bodies never leave the cache and do not count; a row of remote forces that is
used again within a step counts once. Over the bandwidth of a triad, the sum is the least time of a step whose tables fit into no
near cache.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from thirdbody.engine.remote_rows import remote_rows
from thirdbody.kernels.columns import body, body_extra, orientation
from thirdbody.kernels.sphere_rotation import INNER, OUTER, STEPS

ROTATED = len((*OUTER, *INNER)) / STEPS
"""Fraction of the steps that rotate single spheres."""

READ, WRITTEN = 1, 2
"""Times that a row crosses the border of the cache; one that is written is read first."""


@dataclass(frozen=True)
class Moved:
    """A table: rows that a step needs, bytes of each, and how often they cross the border of the cache."""

    name: str
    rows: int
    row_bytes: int
    crossings: int

    @property
    def bytes(self) -> int:
        """Bytes a step."""
        return self.rows * self.row_bytes * self.crossings


def moved(state: Any) -> list[Moved]:
    """All tables of a step of the explicit engine between flat plates, without body effects and measures."""
    slots = state.slots
    closed, spheres = slots.closed == 1, state.B[:, body.SPHERE_INERTIA] != 0.0
    clumps, placed = int((~spheres).sum()), int(np.diff(slots.beginning)[~spheres].sum())
    touching, rows = int(closed.sum()), len(np.unique(remote_rows(slots, state.body, 1)))
    tables = [
        Moved("bodies", state.n_bodies, 8 * body.WIDTH, WRITTEN),
        Moved("orientations", clumps + int(spheres.sum() * ROTATED), 8 * orientation.WIDTH, WRITTEN),
        Moved("bodies of several spheres", clumps, 8 * body_extra.WIDTH_WITHOUT_EFFECTS, WRITTEN),
        Moved("spheres of their own", 0 if state.S is state.B else placed, state.S[:1].nbytes, WRITTEN),
        Moved("their places in the body", placed, state.offsets[:1].nbytes, READ),
        Moved("histories of contacts", touching, slots.H[:1].nbytes, WRITTEN),
        Moved("remote forces", rows, slots.F[:1].nbytes, WRITTEN),
        Moved("lists: rows and bodies of remote forces", len(slots.remote_body), 8, READ),
        Moved("lists: owner and partner", slots.count, 8, READ),
        Moved("lists: in contact", slots.count, slots.closed.itemsize, WRITTEN),
        Moved("lists: row of the remote force", touching, 4, READ),
        Moved("lists: material", touching if state.physics.kinds.size > 1 else 0, 4, READ),
        Moved("lists: body of a sphere", 0 if state.S is state.B else 2 * touching, 8, READ),
    ]
    return [table for table in tables if table.rows]


def print_traffic(name: str, tables: list[Moved], spheres: int, bandwidth: float, nanoseconds: float, console: Console) -> None:
    """Print bytes per sphere and step by table, and their least time against that of a step (both per sphere).

    `bandwidth`: of a triad far beyond all caches [GB/s]; `nanoseconds`: the step loop, undisturbed.
    """
    total = sum(table.bytes for table in tables) / spheres
    page = Table("table", "rows/sphere", "bytes a row", "bytes/sphere-step", title=f"{name}: bytes that cross the cache")
    for table in tables:
        crossings = "read and written" if table.crossings == WRITTEN else "read"
        figures = f"{table.rows / spheres:.3g}", f"{table.row_bytes}", f"{table.bytes / spheres:.0f}"
        page.add_row(f"{table.name}, {crossings}", *figures)
    page.add_section()
    page.add_row("sum", "", "", f"{total:.0f}")
    page.add_row("at the triad's bandwidth", "", "", f"{total / bandwidth:.1f} ns of {nanoseconds:.1f} ns")
    console.print(page)
