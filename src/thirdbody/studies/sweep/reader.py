"""Reader of a sweep: its points, its table as pandas or xarray data, its plot."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody.errors import InputError
from thirdbody.studies.sweep.plan import POINTS, AxisColumn
from thirdbody.studies.sweep.point import DONE, WAITING, Point, PointResult, read_result
from thirdbody.studies.sweep.results import result
from thirdbody.studies.sweep.sweep_folder import columns_of, read_document, sweep_folder
from thirdbody.trajectory.reader import FILE_NAME, Run, open_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class SweepPoint:
    """One point: `values` of the axes by key (SI), `status`, `reason`, `exit_code`, `seconds`, `results` by name, `folder`."""

    number: int
    folder: Path
    values: dict[str, float | str]
    status: str = WAITING
    reason: str = ""
    exit_code: int | None = None
    seconds: float = 0.0
    results: dict[str, float] = field(default_factory=dict)

    @property
    def run(self) -> Run:
        """Its run, opened. Raises InputError where there is none: not yet run, or kept as `summary` only."""
        if not (self.folder / FILE_NAME).is_file():
            why = "only its results were kept" if self.status == DONE else f"it is {self.status}"
            raise InputError(f"point {self.number} has no run in {self.folder}: {why}")
        return open_run(self.folder)


class Sweep:
    """A sweep on the disk, finished or not; read when opened.

    Parameters
    ----------
    path : str or Path
        Its folder, or the `points.csv` in it.

    Notes
    -----
    `points` lists all points in the order of the table; each has `values` of the axes (SI), `status`, `reason`, `exit_code`,
    `seconds`, `results`, `folder` and `run`. `axes` and `results` give the units by name, "1" for pure numbers and texts.

    Raises
    ------
    InputError
        There is no sweep, or it is damaged.
    """

    def __init__(self, path: str | os.PathLike[str]):
        document = read_document(Path(path))
        self.path = sweep_folder(Path(path))
        self.title, self.design = str(document["title"]), str(document["design"])
        self.lengths: list[int] = document["lengths"]
        self.columns: tuple[AxisColumn, ...] = columns_of(document)
        self.axes = {column.key: column.unit for column in self.columns}
        self.results = {name: result(name).unit for name in document["results"]}
        self.points = [self._point(number, entry["folder"]) for number, entry in enumerate(document["points"])]

    def _point(self, number: int, folder: str) -> SweepPoint:
        values = {column.key: column.values[number] for column in self.columns}
        own = self.path / POINTS / folder
        saved = read_result(Point(number, own, "", self.path, tuple(self.results))) or PointResult(number, WAITING)
        return SweepPoint(
            number, own, values, saved.status, saved.reason, saved.exit_code, saved.seconds, dict(saved.results)
        )  # fmt: skip

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
        try:
            import pandas
        except ImportError as error:
            raise ImportError("to_pandas() needs pandas: pip install pandas") from error
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
        try:
            import xarray
        except ImportError as error:
            raise ImportError("to_xarray() needs xarray: pip install xarray") from error
        import numpy as np

        dimensions, shape = self._shape()
        data = {
            name: (dimensions, np.array(self.column(name)).reshape(shape), {"units": unit}) for name, unit in self.results.items()
        }
        status = np.array([point.status for point in self.points]).reshape(shape)
        coordinates: dict[str, Any] = {}
        for column in self.columns:
            own = dimensions[column.axis] if self.design == "grid" else "point"
            values = np.array(column.values).reshape(shape)
            if self.design == "grid":
                values = np.moveaxis(values, column.axis, 0).reshape(shape[column.axis], -1)[:, 0]
            coordinates[column.key] = (own, values, {"units": column.unit})
        return xarray.Dataset(data | {"status": (dimensions, status)}, coordinates, {"title": self.title})

    def _shape(self) -> tuple[list[str], list[int]]:
        """Return names and lengths of the dimensions."""
        if self.design != "grid":
            return ["point"], [len(self.points)]
        names: dict[int, str] = {}
        for column in self.columns:
            names.setdefault(column.axis, column.key)
        return list(names.values()), self.lengths

    def plot(
        self,
        out: str | os.PathLike[str] | None = None,
        panels: Sequence[str] | None = None,
        x: str | None = None,
        y: str | None = None,
    ) -> Figure:
        """Draw curves of the results over one axis, or maps over two; return the figure.

        Parameters
        ----------
        out : str or Path, optional
            Picture file: .png, .pdf or .svg.
        panels : sequence of str, optional
            Results to draw; None: friction, fractions of states.
        x, y : str, optional
            Axes of the picture; None: chosen by their number of values. Seeds, and axes that are not drawn, are averaged, with
            the standard error as a bar.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from thirdbody.studies.sweep.plot import draw_sweep

        return draw_sweep(self, None if out is None else Path(out), panels, x, y)
