"""Reader of a sweep: its points, its table as pandas or xarray data, means over its axes."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from thirdbody.errors import InputError, UsageError
from thirdbody.studies.folder import RUNS, read_document, sweep_folder
from thirdbody.studies.plan import POINTS, AxisColumn
from thirdbody.studies.point import DONE, WAITING, Point, PointResult, read_result
from thirdbody.studies.results import result
from thirdbody.system.processes import optional
from thirdbody.trajectory.open_file import FILE_NAME
from thirdbody.trajectory.run_file import RunFile


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
    values, errors, of_friction = {}, {}, np.nan_to_num(sweep.column("friction_coefficient_error"))
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
