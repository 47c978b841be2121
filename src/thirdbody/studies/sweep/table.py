"""The table of a sweep, `points.csv`: a row per point from the start on, always replaced as a whole."""

from __future__ import annotations

import csv
import io
import time
from pathlib import Path

from thirdbody.atomic_files import write_whole
from thirdbody.errors import OutputError
from thirdbody.export.csv_tables import as_text
from thirdbody.studies.sweep.plan import Plan
from thirdbody.studies.sweep.point import WAITING, PointResult
from thirdbody.studies.sweep.results import result

FILE = "points.csv"

FIXED = ("point", "folder")
OUTCOME = ("status", "reason", "exit_code", "seconds")
"""Columns before the axes, and between axes and results."""

FRACTION_OF_TIME = 0.05
"""Largest fraction of the time of a sweep that writing its table takes: a large one is not replaced after each point."""


def heading(name: str, unit: str) -> str:
    """Return the header of a column: `load [N]`, or the name of a pure number."""
    return name if unit == "1" else f"{name} [{unit}]"


class Table:
    """Rows of a sweep; `record` takes a result and replaces the file."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        self.plan, self.path = plan, folder / FILE
        self.rows = [PointResult(point.number, WAITING) for point in plan.points]
        self.counts = {WAITING: len(self.rows)}
        self._written, self._cost = 0.0, 0.0

    def record(self, row: PointResult) -> None:
        """Enter the result of a point, and replace the file unless that was done a moment ago. Raises OutputError."""
        self.enter(row)
        if time.perf_counter() - self._written > self._cost / FRACTION_OF_TIME:
            self.write()

    def enter(self, row: PointResult) -> None:
        """Put the result of a point into its row; `counts` are the numbers of points by status."""
        self.counts[self.rows[row.number].status] -= 1
        self.counts[row.status] = self.counts.get(row.status, 0) + 1
        self.rows[row.number] = row

    def write(self) -> None:
        """Replace the file. Raises OutputError and leaves the one before."""
        began = time.perf_counter()
        try:
            write_whole(self.path, self.text().encode())
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written ({error.strerror or error})") from error
        self._written = time.perf_counter()
        self._cost = self._written - began

    def text(self) -> str:
        """Return the table as CSV; numbers with all their digits, empty cells for what there is not."""
        plan, text = self.plan, io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        axes = [heading(column.key, column.unit) for column in plan.columns]
        results = [heading(name, result(name).unit) for name in plan.results]
        writer.writerow([*FIXED, *axes, *OUTCOME[:-1], heading("seconds", "s"), *results])
        for point, row in zip(plan.points, self.rows, strict=True):
            values = [column.values[point.number] for column in plan.columns]
            cells = [as_text(value) if isinstance(value, str) else value for value in values]
            code = "" if row.exit_code is None else row.exit_code
            outcome = [row.status, as_text(row.reason), code, row.seconds or ""]
            writer.writerow([point.number, point.folder.name, *cells, *outcome, *(row.results.get(n, "") for n in plan.results)])
        return text.getvalue()
