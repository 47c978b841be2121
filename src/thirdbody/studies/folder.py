"""Folder of a study: its plan, its table, its runs; the replacement of an older one; the reader of a sweep.

A sweep has `points.csv`, `scene.toml`, `sweep.json` with all points, and a folder per point; a study of cost its picture and
`cost.json` besides. Nothing else is ever replaced or deleted.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from thirdbody.atomic_files import new_folder, write_output
from thirdbody.errors import Fault, InputError, Interrupted, OutputError, ThirdbodyError, UsageError
from thirdbody.export.tables import as_text
from thirdbody.runner.run_folder import FILES, lock_folder, make_folder
from thirdbody.studies.plan import POINTS, AxisColumn, Plan
from thirdbody.studies.point import DONE, RESULT_FILE, WAITING, Point, PointResult, read_result
from thirdbody.studies.results import result
from thirdbody.system.processes import optional
from thirdbody.trajectory.open_file import FILE_NAME
from thirdbody.trajectory.run_file import RunFile

SWEEP_FILE, SCENE_FILE, TABLE = "sweep.json", "scene.toml", "points.csv"
FORMAT = 1

RUNS = "variants"  # in the folder of a study of cost: the runs of its variants
# Files that a study of cost leaves and a sweep does not.
RESULTS = ("cost.json", "cost.png", "cost.pdf", "effects.json", "effects.png", "effects.pdf")

_WHOLE = (SCENE_FILE, SWEEP_FILE, TABLE, *RESULTS)
_OURS = [path for name in _WHOLE for path in (name, f".{name}.*.part")]
_OURS += [f"{RUNS}/*/{path}" for name in (*FILES, RESULT_FILE) for path in (name, f"{name}.part", f".{name}.*.part")]

# Largest fraction of the time of a study that writing its table takes: a large one is not replaced after each point.
FRACTION_OF_TIME = 0.05


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
        "format": FORMAT, "title": plan.title, "design": plan.design, "lengths": plan.lengths,
        "columns": [{"key": column.key, "unit": column.unit, "axis": column.axis} for column in plan.columns],
        "results": plan.results, "keep": point.keep,
        "plugins": [str(file) for file in point.plugins], "scene_folder": str(point.scene_folder),
        "points": [
            {"folder": one.folder.name, "settings": settings, "values": [column.values[one.number] for column in plan.columns]}
            for one, settings in zip(plan.points, plan.settings, strict=True)
        ],
    }  # fmt: skip
    make_folder(folder, exist_ok=True)
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


@dataclass(frozen=True)
class SweepPoint(PointResult):
    """One point: its result, its `folder`, and the `values` of the axes by key (SI)."""

    folder: Path = Path()
    values: Mapping[str, float | str] = field(default_factory=dict)
    opened: Callable[[Path], Any] = field(default=RunFile, repr=False)

    @property
    def run(self) -> Any:
        """Its run, opened. Raises InputError where there is none: not yet run, or kept as `summary` only."""
        if not (self.folder / FILE_NAME).is_file():
            why = "only its results were kept" if self.status == DONE else f"it is {self.status}"
            raise InputError(f"point {self.number} has no run in {self.folder}: {why}")
        return self.opened(self.folder)


class SweepTable:
    """The points of a sweep on the disk, finished or not; see `thirdbody.Sweep`. Raises InputError."""

    opened: Callable[[Path], Any] = RunFile
    """Opens the run of a point."""

    def __init__(self, path: str | os.PathLike[str]):
        document = read_document(Path(path))
        self.path = sweep_folder(Path(path))
        self.title, self.design = str(document["title"]), str(document["design"])
        self.lengths: list[int] = document["lengths"]
        self.columns = tuple(
            AxisColumn(entry["key"], entry["unit"], tuple(point["values"][k] for point in document["points"]), entry["axis"])
            for k, entry in enumerate(document["columns"])
        )
        self.axes = {column.key: column.unit for column in self.columns}
        self.results = {name: result(name).unit for name in document["results"]}
        runs = self.path / (RUNS if "study" in document else POINTS)
        self.points = [self._point(number, runs / entry["folder"]) for number, entry in enumerate(document["points"])]

    def _point(self, number: int, folder: Path) -> SweepPoint:
        values = {column.key: column.values[number] for column in self.columns}
        saved = read_result(Point(number, folder, "", self.path, tuple(self.results))) or PointResult(number, WAITING)
        return SweepPoint(**vars(saved), folder=folder, values=values, opened=type(self).opened)

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        done = sum(point.status == DONE for point in self.points)
        return f"<Sweep of '{self.title}': {done} of {len(self.points)} points done, axes {', '.join(self.axes)}>"

    def column(self, name: str) -> list[Any]:
        """Return the values of an axis or a result at all points, NaN where there is none.

        Parameters
        ----------
        name : str
            A key of `axes` or `results`.

        Returns
        -------
        list
        """
        if name in self.axes:
            return [point.values[name] for point in self.points]
        return [point.results.get(name, math.nan) for point in self.points]

    def to_pandas(self) -> Any:
        """Return the table as a pandas DataFrame.

        Returns
        -------
        pandas.DataFrame
            A row per point: axes, `status`, `reason`, `exit_code`, `seconds`, results. Units are in `.attrs["units"]`.

        Raises
        ------
        ImportError
            pandas is not installed; it is needed here only.
        """
        pandas = optional("pandas", "to_pandas()")
        outcome = {name: [getattr(point, name) for point in self.points] for name in ("status", "reason", "exit_code", "seconds")}
        outcome["exit_code"] = pandas.array(outcome["exit_code"], dtype="Int64")
        data = pandas.DataFrame(
            {key: self.column(key) for key in self.axes} | outcome | {name: self.column(name) for name in self.results}
        )
        data.index.name = "point"
        data.attrs["units"] = self.axes | {"seconds": "s"} | self.results
        return data

    def to_xarray(self) -> Any:
        """Return the results as an xarray Dataset.

        Returns
        -------
        xarray.Dataset
            A grid has a dimension per axis, named by its first key, others one dimension `point`; keys are coordinates. Points
            without a result are NaN. Units are in the `attrs` of each variable.

        Raises
        ------
        ImportError
            xarray is not installed; it is needed here only.
        """
        xarray = optional("xarray", "to_xarray()")
        dimensions, shape, grid = ["point"], [len(self.points)], self.design == "grid"
        if grid:
            dimensions = list({column.axis: column.key for column in reversed(self.columns)}.values())[::-1]
            shape = self.lengths
        data = {
            name: (dimensions, np.array(self.column(name)).reshape(shape), {"units": unit}) for name, unit in self.results.items()
        }
        status = np.array([point.status for point in self.points]).reshape(shape)
        coordinates: dict[str, Any] = {}
        for column in self.columns:
            axis = column.axis if grid else 0
            values = np.moveaxis(np.array(column.values).reshape(shape), axis, 0).reshape(shape[axis], -1)[:, 0]
            coordinates[column.key] = (dimensions[axis], values, {"units": column.unit})
        return xarray.Dataset(data | {"status": (dimensions, status)}, coordinates, {"title": self.title})


class Average(NamedTuple):
    """Means of the results at distinct values of one or two axes, (n,) each, over points that are done.

    `errors`: standard errors of the means; for a single point the error of its own friction coefficient, else 0. `largest`: the
    largest number of points of one mean; `averaged`: keys that differ between them.
    """

    x_key: str
    y_key: str | None
    x: np.ndarray
    y: np.ndarray
    values: dict[str, np.ndarray]
    errors: dict[str, np.ndarray]
    largest: int
    averaged: tuple[str, ...]


def average(sweep: SweepTable, x: str, y: str | None) -> Average:
    """Return the means over all axes but these. Raises UsageError for an axis whose values are no numbers."""
    for key in (x, y):
        if key is not None and any(isinstance(value, str) for value in sweep.column(key)):
            raise UsageError(f"{key}: its values are texts, and a picture needs numbers; name another axis")
    groups: dict[tuple[float, float], list[int]] = {}
    for point in sweep.points:
        if point.status == DONE:
            position = float(point.values[x]), 0.0 if y is None else float(point.values[y])
            groups.setdefault(position, []).append(point.number)
    values, errors = dict[str, np.ndarray](), dict[str, np.ndarray]()
    of_friction = np.nan_to_num(sweep.column("friction_coefficient_error"))
    for name in sweep.results:
        column = np.array(sweep.column(name), float)
        known = [column[rows][np.isfinite(column[rows])] for rows in groups.values()]
        values[name] = np.array([part.mean() if len(part) else math.nan for part in known])
        errors[name] = np.array([part.std(ddof=1) / math.sqrt(len(part)) if len(part) > 1 else 0.0 for part in known])
        if name == "friction_coefficient":
            errors[name] = np.array([of_friction[rows[0]] if len(rows) == 1 else error
                                     for rows, error in zip(groups.values(), errors[name], strict=True)])  # fmt: skip
    positions = np.array(list(groups), float).reshape(-1, 2)
    size = max(map(len, groups.values()), default=0)
    drawn = {column.axis for column in sweep.columns if column.key in (x, y)}  # keys that move with them are not averaged
    averaged = tuple(column.key for column in sweep.columns if column.axis not in drawn and len(set(column.values)) > 1)
    return Average(x, y, positions[:, 0], positions[:, 1], values, errors, size, averaged)
