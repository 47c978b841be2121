"""Folder of a study: its plan, its table, its runs; the replacement of an older one.

A sweep has `points.csv`, `scene.toml`, `sweep.json` with all points, and a folder per point; a study of cost its picture and
`cost.json` besides. Nothing else is ever replaced or deleted.
"""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from thirdbody.atomic_files import new_folder, write_output
from thirdbody.errors import Fault, InputError, Interrupted, OutputError, ThirdbodyError
from thirdbody.export.tables import as_text
from thirdbody.runner.run_folder import FILES, lock_folder
from thirdbody.studies.plan import Plan
from thirdbody.studies.point import RESULT_FILE, WAITING, PointResult
from thirdbody.studies.results import result

SWEEP_FILE, SCENE_FILE, TABLE = "sweep.json", "scene.toml", "points.csv"
FORMAT = 1

RUNS = "variants"
"""In the folder of a study of cost: the runs of its variants."""

RESULTS = ("cost.json", "cost.png", "cost.pdf", "effects.json", "effects.png", "effects.pdf")
"""Files that a study of cost leaves and a sweep does not."""

_WHOLE = (SCENE_FILE, SWEEP_FILE, TABLE, *RESULTS)
_OURS = [path for name in _WHOLE for path in (name, f".{name}.*.part")]
_OURS += [f"{RUNS}/*/{path}" for name in (*FILES, RESULT_FILE) for path in (name, f"{name}.part", f".{name}.*.part")]

FRACTION_OF_TIME = 0.05
"""Largest fraction of the time of a study that writing its table takes: a large one is not replaced after each point."""


class Table:
    """The table of a study, `points.csv`: a row per point from the start on, always replaced as a whole."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        self.plan, self.path = plan, folder / TABLE
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
        write_output(self.path, self.text().encode())
        self._written = time.perf_counter()
        self._cost = self._written - began

    def text(self) -> str:
        """Return the table as CSV; numbers with all their digits, empty cells for what there is not."""
        plan, text = self.plan, io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        axes = [_heading(column.key, column.unit) for column in plan.columns]
        results = [_heading(name, result(name).unit) for name in plan.results]
        writer.writerow(["point", "folder", *axes, "status", "reason", "exit_code", "seconds [s]", *results])
        for point, row in zip(plan.points, self.rows, strict=True):
            values = [column.values[point.number] for column in plan.columns]
            cells = [as_text(value) if isinstance(value, str) else value for value in values]
            code = "" if row.exit_code is None else row.exit_code
            outcome = [row.status, as_text(row.reason), code, row.seconds or ""]
            writer.writerow([point.number, point.folder.name, *cells, *outcome, *(row.results.get(n, "") for n in plan.results)])
        return text.getvalue()


def _heading(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} [{unit}]"


def is_sweep_folder(path: Path) -> bool:
    """Return whether a path is the folder of a sweep, or its table."""
    return os.path.isfile(sweep_folder(path) / SWEEP_FILE)


def sweep_folder(path: Path) -> Path:
    """Return the folder of a sweep, which its table names as well."""
    return path.parent if path.name == TABLE else path


def save_plan(plan: Plan, folder: Path, more: Mapping[str, Any] | None = None) -> None:
    """Write the plan, and `more` of a study, into the folder of a sweep, which is made. Raises OutputError."""
    point = plan.points[0]
    document = {
        "format": FORMAT,
        "title": plan.title,
        "design": plan.design,
        "lengths": plan.lengths,
        "columns": [{"key": column.key, "unit": column.unit, "axis": column.axis} for column in plan.columns],
        "results": plan.results,
        "keep": point.keep,
        "plugins": [str(file) for file in point.plugins],
        "scene_folder": str(point.scene_folder),
        "points": [
            {"folder": one.folder.name, "settings": settings, "values": [column.values[one.number] for column in plan.columns]}
            for one, settings in zip(plan.points, plan.settings, strict=True)
        ],
    }
    write_output(folder / SCENE_FILE, plan.scene.encode())
    write_output(folder / SWEEP_FILE, json.dumps(document | dict(more or {})).encode())


def read_document(path: Path) -> dict[str, Any]:
    """Return what `save_plan` wrote. Raises InputError."""
    file = sweep_folder(path) / SWEEP_FILE
    if not os.path.isfile(file):
        raise InputError(f"{path}: no sweep is there (it has no {SWEEP_FILE})")
    try:
        document = json.loads(file.read_bytes())
        if document["format"] != FORMAT:
            raise InputError(Fault("", f"format {document['format']}, this version reads {FORMAT}", str(file)))
    except OSError as error:
        raise InputError(Fault("", f"cannot be read ({error.strerror or error})", str(file))) from error
    except (ValueError, KeyError, TypeError):
        raise InputError(Fault("", "is damaged", str(file))) from None
    return dict(document)


@contextmanager
def new_study_folder(folder: Path, overwrite: bool) -> Iterator[Path]:
    """Yield the folder in which to compute the study of cost that becomes `folder`.

    An existing one stays until the new one is complete; of a new one that is refused nothing stays. Raises OutputError if the
    folder exists, unless it is that of a study, with nothing else in it, and may be overwritten.
    """
    if os.path.lexists(folder) and not (folder.is_dir() and not os.listdir(folder)):
        if not overwrite:
            raise OutputError(f"{folder}: exists already; --overwrite replaces it, --resume goes on, -o names another folder")
        if folder.is_dir() and not {RUNS, *RESULTS} & set(os.listdir(folder)):
            raise OutputError(f"{folder}: is not the folder of a study (it has no {RUNS}) and will not be overwritten")
        with lock_folder(folder), new_folder(folder, True, _OURS) as work_folder:
            yield work_folder
        return
    missing = [path for path in (folder, *folder.absolute().parents) if not os.path.lexists(path)]
    try:
        yield folder
    except Interrupted:
        raise
    except ThirdbodyError:
        for name in _WHOLE:
            with suppress(OSError):
                (folder / name).unlink(missing_ok=True)
        shutil.rmtree(folder / RUNS, ignore_errors=True)
        for path in missing:  # from the innermost outwards; one that is not empty stays
            with suppress(OSError):
                path.rmdir()
        raise
