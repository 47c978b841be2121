"""Axes of a sweep: keys of a scene and the values that they get, as a list or as an interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Annotated, Any, Literal

from pydantic import create_model

from thirdbody import units
from thirdbody.errors import Fault
from thirdbody.schema.fields import Choice, Count, as_float, show
from thirdbody.schema.parts import Location, Part
from thirdbody.units import DIMENSIONS

_FIELDS: dict[str, Any] = {
    "from": (Any, ...),
    "to": (Any, ...),
    "count": (Count | None, None),
    "scale": (Annotated[Literal["linear", "log", "whole"], Choice()], "linear"),
}
IntervalTable: Any = create_model("IntervalTable", __base__=Part, **_FIELDS)
"""Table `{from, to, count, scale}` of a key; `from` is no name in Python, hence the call."""


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


Axis = tuple[Column, ...]
"""Keys that move together: one dimension of the design."""

Report = Callable[[Location, str], None]
"""Takes a fault: its place and its text."""


def read_column(key: str, given: Any, location: Location, report: Report, sampled: bool) -> Column:
    """Return the column of a key; faults of its values are reported, and leave it without values."""
    if hasattr(given, "tolist"):
        given = given.tolist()
    if isinstance(given, Mapping):
        interval = _read_interval(given, location, report, sampled)
        return Column(key, interval if interval is not None else (), location)
    if isinstance(given, list | tuple):
        if not given:
            report(location, "expected at least one value")
        return Column(key, tuple(given), location)
    report(location, f"expected a list of values or a table {{from, to, count}}, got {show(given)}")
    return Column(key, (), location)


def _read_interval(given: Mapping[str, Any], location: Location, report: Report, sampled: bool) -> Interval | None:
    from pydantic import ValidationError

    from thirdbody.schema.parts import wrongs_of

    try:
        table = IntervalTable.model_validate(dict(given))
    except ValidationError as error:
        for inner, text in wrongs_of(error):
            report((*location, *inner), text)
        return None
    return _interval(getattr(table, "from"), table.to, table.count, table.scale, _Given(location, report, sampled))


@dataclass(frozen=True)
class _Given:
    """Where an interval is given, where its faults go, and whether it is sampled."""

    location: Location
    report: Report
    sampled: bool

    def fault(self, text: str, key: str | None = None) -> None:
        self.report(self.location if key is None else (*self.location, key), text)


def _interval(first: Any, last: Any, count: int | None, scale: str, given: _Given) -> Interval | None:
    """Return the interval between two values, or None after its faults are reported."""
    if given.sampled and count is not None:
        given.fault("a sampled design has no count of its own: `samples` gives the number of points", "count")
    elif not given.sampled and count is None:
        given.fault("required key is missing: the number of values, such as count = 5", "count")
    low, high = _number(first, "from", given), _number(last, "to", given)
    if low is None or high is None:
        return None
    if low[1] != high[1]:
        phrases = " and ".join(DIMENSIONS[name].phrase for name in (low[1], high[1]))
        given.fault(f"{show(first)} and {show(last)} are {phrases}: give both in units of the same kind")
        return None
    if scale == "whole" and not (isinstance(first, int) and isinstance(last, int) and first <= last):
        given.fault(f'scale = "whole" needs ends that are whole numbers, the lower one first, got {show(first)} and {show(last)}')
        return None
    if scale == "log" and not (low[0] > 0.0 and high[0] > 0.0):
        given.fault(f'scale = "log" needs ends above 0, got {show(first)} and {show(last)}')
        return None
    return Interval(low[0], high[0], low[1], count, scale, first, last)


def _number(value: Any, key: str, given: _Given) -> tuple[float, str] | None:
    """Return the value in SI and its dimension, or None after its fault is reported."""
    try:
        if isinstance(value, str):
            return units.parse_any(value, tuple(DIMENSIONS))
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(as_float(value)):
            raise ValueError(f"expected a number or a quantity with its unit, got {show(value)}")
        return float(value), "dimensionless"
    except ValueError as error:
        given.fault(str(error), key)
        return None


def lengths_fault(columns: Sequence[Column]) -> str:
    """Return the fault of keys that move together with different numbers of values; empty if there is none."""
    counts = {column.key: column.count for column in columns}
    if len(set(counts.values())) <= 1:
        return ""
    return "moved together, but with " + ", ".join(f"{count or 'sampled'} values of {key}" for key, count in counts.items())


def fault_of_axis(axes: Sequence[Axis], fault: Fault, words: Callable[[str], tuple[str, ...]]) -> Column | None:
    """Return the column whose key contains the place of a fault of the scene; None where no axis is to blame."""
    location = words(fault.key)
    for axis in axes:
        for column in axis:
            key = words(column.key)
            if location[: len(key)] == key:
                return column
    return None
