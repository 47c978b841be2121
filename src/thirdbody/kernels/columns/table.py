"""Declaration of a table: meaning, unit and position of each of its columns."""

from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """One quantity of a table: first column, number of columns, unit ("" for none) and meaning."""

    name: str
    first: int
    width: int
    unit: str
    meaning: str


class Table:
    """The columns of a table, in order.

    Each declaration returns the index of its first column, a plain int: kernels read it as an attribute of the module that
    declares the table, which numba compiles as a constant.
    """

    def __init__(self, symbol: str, rows: str) -> None:
        """Create an empty table. `symbol`: name of the array in kernels; `rows`: what a row (or a table of one row) describes."""
        self.symbol, self.rows = symbol, rows
        self.columns: list[Column] = []
        self.width = 0

    def scalar(self, name: str, unit: str, meaning: str, at: int | None = None) -> int:
        """Declare one column, after the last one or at column `at`; return its index."""
        return self._declare(name, 1, unit, meaning, at)

    def vector(self, name: str, width: int, unit: str, meaning: str, at: int | None = None) -> tuple[int, slice]:
        """Declare `width` columns; return the index of the first one, and all of them as a slice."""
        first = self._declare(name, width, unit, meaning, at)
        return first, slice(first, first + width)

    def skip(self, width: int) -> int:
        """Leave `width` columns unused; return the width of the table so far."""
        self.width += width
        return self.width

    def names(self) -> tuple[str, ...]:
        """Return the names of all quantities in order."""
        return tuple(column.name for column in self.columns)

    def _declare(self, name: str, width: int, unit: str, meaning: str, at: int | None) -> int:
        first = self.width if at is None else at
        self.columns.append(Column(name, first, width, unit, meaning))
        self.width = max(self.width, first + width)
        return first

    def __getitem__(self, name: str) -> Column:
        """Return the column of this name. Raises KeyError without one."""
        for column in self.columns:
            if column.name == name:
                return column
        raise KeyError(name)

    def __iter__(self) -> Iterator[Column]:
        return iter(self.columns)

    def markdown(self) -> str:
        """Return the table as documentation: one line per quantity."""
        lines = [f"`{self.symbol}`: {self.rows}", "", "| columns | name | unit | meaning |", "|---|---|---|---|"]
        for c in self.columns:
            where = f"{c.first}" if c.width == 1 else f"{c.first}-{c.first + c.width - 1}"
            lines.append(f"| {where} | {c.name} | {c.unit or '-'} | {c.meaning} |")
        return "\n".join(lines)
