"""Declaration of a table of numbers: name, unit, meaning and place of each of its columns.

Kernels write `B[b, body.FORCE + d]`: the index of the first column of a quantity, which numba compiles as a constant. Python code
around them writes `B[:, body.FORCE3]`, a slice over all three columns, or `body.view(B).force`. `WIDTH` is the number of columns;
`print(body.markdown())` describes a table.
"""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Column(NamedTuple):
    name: str
    first: int
    width: int
    unit: str
    meaning: str


class _Declared(NamedTuple):
    """A column as it is declared; `at`: a column, or the name of one of this table; None: behind the last one."""

    width: int
    unit: str
    meaning: str
    at: int | str | None
    kind: str = "quantity"


def number(unit: str, meaning: str, at: int | str | None = None) -> _Declared:
    """Return the declaration of a quantity of one column, for `Table`.

    Parameters
    ----------
    unit : str
        Its unit, "" for none.
    meaning : str
        What it is.
    at : int or str, optional
        Where it is: a column, or the name of one of the same table. Default: behind the last one.

    Returns
    -------
    object
        The declaration.
    """
    return _Declared(1, unit, meaning, at)


def vector(width: int, unit: str, meaning: str, at: int | str | None = None) -> _Declared:
    """Return the declaration of a quantity of several columns, for `Table`.

    Parameters
    ----------
    width : int
        Number of columns.
    unit, meaning, at
        As of `number`.

    Returns
    -------
    object
        The declaration.
    """
    return _Declared(width, unit, meaning, at)


def skip(width: int) -> _Declared:
    """Return the declaration of columns that are left unused, for `Table`.

    Parameters
    ----------
    width : int
        Number of columns.

    Returns
    -------
    object
        The declaration.
    """
    return _Declared(width, "", "", None, "skip")


def mark() -> _Declared:
    """Return the declaration of a constant, the width of the table so far."""
    return _Declared(0, "", "", None, "mark")


class Table(ModuleType):
    """The columns of a table, in order: `force=vector(3, ...)` makes `FORCE`, the first column, and `FORCE3`, a slice.

    A module for numba, which compiles the attributes of modules as constants."""

    def __init__(self, symbol: str, rows: str, **columns: _Declared) -> None:
        """Declare a table. `symbol`: name of the array in kernels; `rows`: what a row (or a table of one row) describes."""
        super().__init__(f"table of {rows}", f"Columns of {rows}, as compiled functions read them.")
        self.symbol, self.rows = symbol, rows
        self.columns: list[Column] = []
        end = 0
        for name, (width, unit, meaning, at, kind) in columns.items():
            first = getattr(self, at.upper()) if isinstance(at, str) else end if at is None else at
            end = max(end, first + width)
            if kind == "skip":
                continue
            setattr(self, name.upper(), first)
            if kind == "quantity":
                self.columns.append(Column(name, first, width, unit, meaning))
            if width > 1:
                setattr(self, f"{name.upper()}{width}", slice(first, first + width))
        self.WIDTH = vars(self).get("WIDTH", end)

    if TYPE_CHECKING:

        def __setattr__(self, name: str, value: Any) -> None: ...

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how a copy is made: numba copies kernels with the names that they use."""
        return _restored, ({name: value for name, value in vars(self).items() if not name.startswith("__")},)

    def names(self) -> tuple[str, ...]:
        return tuple(column.name for column in self.columns)

    def view(self, array: Array) -> Rows:
        return Rows((array, self))

    def __getitem__(self, name: str) -> Column:
        """Return the column of this name. Raises KeyError without one."""
        return {column.name: column for column in self.columns}[name]

    def __iter__(self) -> Iterator[Column]:
        return iter(self.columns)

    def markdown(self) -> str:
        """Return the table as documentation: one line per quantity."""
        lines = [f"`{self.symbol}`: {self.rows}", "", "| columns | name | unit | meaning |", "|---|---|---|---|"]
        for c in self.columns:
            where = f"{c.first}" if c.width == 1 else f"{c.first}-{c.first + c.width - 1}"
            lines.append(f"| {where} | {c.name} | {c.unit or '-'} | {c.meaning} |")
        return "\n".join(lines)


def _restored(contents: dict[str, Any]) -> Table:
    table = Table(contents["symbol"], contents["rows"])
    vars(table).update(contents)
    return table


class Rows:
    """Arrays with the same rows, by column name.

    `rows.force` is a view, (n,) or (n, width), of the columns of that name in any of the tables. Assign through the view:
    `rows.force[:] = 0.0`."""

    __slots__ = ("_parts",)

    def __init__(self, *parts: tuple[Array, Table]) -> None:
        self._parts = parts

    def __getattr__(self, name: str) -> Array:
        for array, table in self._parts:
            for column in table.columns:
                if column.name == name:
                    whole = slice(column.first, column.first + column.width)
                    return array[:, column.first if column.width == 1 else whole]
        raise AttributeError(f"no column is named {name}: {', '.join(n for _, table in self._parts for n in table.names())}")
