"""Means of the results of a sweep over the axes that a picture does not show."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from thirdbody.errors import UsageError
from thirdbody.studies.sweep.point import DONE

if TYPE_CHECKING:
    from thirdbody.studies.sweep.reader import Sweep


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


def average(sweep: Sweep, x: str, y: str | None) -> Average:
    """Return the means over all axes but these. Raises UsageError for an axis whose values are no numbers."""
    for key in (x, y):
        if key is not None and any(isinstance(value, str) for value in sweep.column(key)):
            raise UsageError(f"{key}: its values are texts, and a picture needs numbers; name another axis")
    groups: dict[tuple[float, float], list[int]] = {}
    for point in sweep.points:
        if point.status == DONE:
            position = float(point.values[x]), 0.0 if y is None else float(point.values[y])
            groups.setdefault(position, []).append(point.number)
    columns = {name: np.array(sweep.column(name), float) for name in sweep.results}
    values: dict[str, list[float]] = {name: [] for name in columns}
    errors: dict[str, list[float]] = {name: [] for name in columns}
    for rows in groups.values():
        for name, column in columns.items():
            mean, error = _mean(column[rows])
            if len(rows) == 1 and name == "friction_coefficient" and "friction_coefficient_error" in columns:
                error = float(np.nan_to_num(columns["friction_coefficient_error"][rows[0]]))
            values[name].append(mean)
            errors[name].append(error)
    positions = np.array(list(groups), float).reshape(-1, 2)
    size = max(map(len, groups.values()), default=0)
    return Average(x, y, positions[:, 0], positions[:, 1], {name: np.array(column) for name, column in values.items()},
                   {name: np.array(column) for name, column in errors.items()}, size, _averaged(sweep, x, y))  # fmt: skip


def _mean(values: np.ndarray) -> tuple[float, float]:
    """Return mean and standard error of the values that are numbers; NaN without any."""
    known = values[np.isfinite(values)]
    if not len(known):
        return math.nan, 0.0
    error = float(known.std(ddof=1)) / math.sqrt(len(known)) if len(known) > 1 else 0.0
    return float(known.mean()), error


def _averaged(sweep: Sweep, x: str, y: str | None) -> tuple[str, ...]:
    """Return the keys of the axes that are averaged: those that move with a drawn one are not."""
    drawn = {column.axis for column in sweep.columns if column.key in (x, y)}
    return tuple(column.key for column in sweep.columns if column.axis not in drawn and len(set(column.values)) > 1)
