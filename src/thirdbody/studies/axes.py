"""Axes of a sweep, keys of a scene with their values as a list or an interval; designs: from axes to the values of each point."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from itertools import product
from typing import Any, Literal

from pydantic import ValidationError, create_model

from thirdbody import units
from thirdbody.schema.fields import Count, as_float, show
from thirdbody.schema.parts import Location, Part, Wrong, wrongs_of
from thirdbody.units import DIMENSIONS

_FIELDS: dict[str, Any] = {
    "from": (Any, ...),
    "to": (Any, ...),
    "count": (Count | None, None),
    "scale": (Literal["linear", "log", "whole"], "linear"),
}
# Table `{from, to, count, scale}` of a key; `from` is no name in Python, hence the call.
IntervalTable: Any = create_model("IntervalTable", __base__=Part, **_FIELDS)
SAMPLED = ("sobol", "latin_hypercube")  # designs of low-discrepancy or stratified samples of the space of the axes
MAX_POINTS = 1_000_000  # largest number of points of a sweep: each is a file at least
Settings = dict[str, Any]  # values by key, as `Scene.with_settings` takes them
Report = Callable[[Location, str], None]  # takes a fault: its place and its text


@dataclass(frozen=True)
class Interval:
    """Values from `low` to `high` (SI) of a dimension, or of pure numbers: `count` of them, or sampled where that is None.

    `first`, `last`: the ends as given. `scale`: linear, log, or whole for whole numbers only.
    """

    low: float
    high: float
    dimension: str
    count: int | None
    scale: str
    first: Any
    last: Any

    def values(self) -> list[Any]:
        """Return all `count` values, equally far apart; each is the nearest number to the exact one."""
        count = self.count or 1
        inner = [self._between(Fraction(k, count - 1)) for k in range(1, count - 1)]
        return [self.first, *inner, self.last][:count]

    def at(self, fraction: float) -> Any:
        """Return the value at a fraction, at least 0 and below 1, of the interval."""
        if self.scale == "whole":  # each as often as the others
            return int(self.low + math.floor(fraction * (self.high - self.low + 1.0)))
        return self._between(Fraction(fraction))

    def _between(self, fraction: Fraction) -> Any:
        if self.scale == "log":
            value = self.low * (self.high / self.low) ** float(fraction)
        else:
            low, high = (Fraction(Decimal(repr(end))) for end in (self.low, self.high))
            value = float(low + (high - low) * fraction)
        if self.dimension != "dimensionless":
            return units.format_si(value, self.dimension)
        if self.scale == "whole":
            return round(value)
        whole = isinstance(self.first, int) and isinstance(self.last, int) and value.is_integer()
        return int(value) if whole else value


@dataclass(frozen=True)
class Column:
    """One key of a scene, such as `pairs.0.friction`, its values, and where in the file they are."""

    key: str
    values: tuple[Any, ...] | Interval
    location: Location = ()

    @property
    def count(self) -> int | None:
        """Number of values; None for an interval to be sampled."""
        return self.values.count if isinstance(self.values, Interval) else len(self.values)

    def listed(self) -> Sequence[Any]:
        """Return all values."""
        return self.values.values() if isinstance(self.values, Interval) else self.values

    def at(self, fraction: float) -> Any:
        """Return the value at a fraction, at least 0 and below 1, of the interval or list."""
        if isinstance(self.values, Interval):
            return self.values.at(fraction)
        return self.values[int(fraction * len(self.values))]


Axis = tuple[Column, ...]  # keys that move together: one dimension of the design


def read_column(key: str, given: Any, location: Location, report: Report, sampled: bool) -> Column:
    """Return the column of a key; faults of its values are reported, and leave it without values."""
    if hasattr(given, "tolist"):
        given = given.tolist()
    if isinstance(given, Mapping):
        return Column(key, _read_interval(given, location, report, sampled) or (), location)
    if not isinstance(given, list | tuple):
        report(location, f"expected a list of values or a table {{from, to, count}}, got {show(given)}")
        return Column(key, (), location)
    if not given:
        report(location, "expected at least one value")
    return Column(key, tuple(given), location)


def _read_interval(given: Mapping[str, Any], location: Location, report: Report, sampled: bool) -> Interval | None:
    """Return the interval of a table, or None after its faults are reported."""
    try:
        table = IntervalTable.model_validate(dict(given))
    except ValidationError as error:
        for inner, text in wrongs_of(error):
            report((*location, *inner), text)
        return None
    first, last, count, scale = getattr(table, "from"), table.to, table.count, table.scale
    if sampled and count is not None:
        report((*location, "count"), "a sampled design has no count of its own: `samples` gives the number of points")
    elif not sampled and count is None:
        report((*location, "count"), "required key is missing: the number of values, such as count = 5")
    ends, fault = list[tuple[float, str]](), ""
    for key, value in (("from", first), ("to", last)):
        try:
            ends.append(number_in_si(value))
        except ValueError as error:
            report((*location, key), str(error))
    if len(ends) < 2:
        return None
    (low, dimension), (high, other) = ends
    if dimension != other:
        phrases = " and ".join(DIMENSIONS[name].phrase for name in (dimension, other))
        fault = f"{show(first)} and {show(last)} are {phrases}: give both in units of the same kind"
    elif scale == "whole" and not (isinstance(first, int) and isinstance(last, int) and first <= last):
        fault = f'scale = "whole" needs ends that are whole numbers, the lower one first, got {show(first)} and {show(last)}'
    elif scale == "log" and not (low > 0.0 and high > 0.0):
        fault = f'scale = "log" needs ends above 0, got {show(first)} and {show(last)}'
    if fault:
        report(location, fault)
        return None
    return Interval(float(low), float(high), dimension, count, scale, first, last)


def number_in_si(value: Any) -> tuple[float, str]:
    """Return a number or a quantity in SI, and its dimension. Raises ValueError for anything else."""
    if isinstance(value, str):
        return units.parse_any(value, tuple(DIMENSIONS))
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(as_float(value)):
        raise ValueError(f"expected a number or a quantity with its unit, got {show(value)}")
    return value, "dimensionless"


def design_faults(design: str, axes: Sequence[Axis], samples: int | None) -> Iterator[Wrong]:
    """Yield what a design lacks."""
    sampled, lengths = design in SAMPLED, {axis[0].key: axis[0].count or 0 for axis in axes}
    count = samples or 0 if sampled else math.prod(lengths.values()) if design == "grid" else max(lengths.values(), default=1)
    if sampled and samples is None:
        yield ("samples",), f"required key is missing: the number of points of design = '{design}'"
    elif not sampled and samples is not None:
        yield ("samples",), f"only {' and '.join(SAMPLED)} designs have samples; the counts of a {design} give its points"
    elif design == "sobol" and count & (count - 1):
        lower = 1 << (count.bit_length() - 1)
        yield ("samples",), f"Sobol points come in powers of two, such as {lower} or {2 * lower}, got {count}"
    elif design == "zip" and len(set(lengths.values())) > 1:
        listed = ", ".join(f"{key} {count}" for key, count in lengths.items())
        yield ("design",), f"'zip' takes the values side by side, and their numbers differ: {listed}"
    elif count > MAX_POINTS:
        yield ("design",), f"{count} points, at most {MAX_POINTS} are computed"


def settings_of_points(design: str, axes: Sequence[Axis], samples: int | None, seed: int) -> list[Settings]:
    """Return the settings of all points of a sound design, the last axis running fastest."""
    if design in SAMPLED:
        import numpy as np
        from scipy.stats import qmc

        kind: Any = qmc.Sobol if design == "sobol" else qmc.LatinHypercube
        rows: Any = kind(len(axes), scramble=True, seed=np.random.default_rng(seed)).random(samples or 0).tolist()
    else:
        indices = [range(axis[0].count or 0) for axis in axes]
        rows = product(*indices) if design == "grid" else zip(*indices, strict=True)
    lists = {} if design in SAMPLED else {column.key: column.listed() for axis in axes for column in axis}
    return [
        {
            column.key: lists[column.key][at] if lists else column.at(at)
            for axis, at in zip(axes, row, strict=True)
            for column in axis
        }
        for row in rows
    ]
