"""Access to tables by column name, for Python code outside the kernels."""

import numpy as np
from numpy.typing import NDArray

from thirdbody.kernels.columns.table import Table

Array = NDArray[np.float64]


class Rows:
    """Tables with the same rows, by column name.

    `rows.force` is a view, (n,) or (n, width), of the columns of that name in any of the tables. Assign through the view:
    `rows.force[:] = 0.0`.
    """

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
