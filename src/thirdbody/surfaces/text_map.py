"""Height maps as text: a line of numbers per row of points, between commas, semicolons, tabs or blanks."""

from __future__ import annotations

import numpy as np

from thirdbody.errors import Fault, InputError
from thirdbody.surfaces.grid import MAX_POINTS
from thirdbody.surfaces.height_map import HeightMap, checked_map

COMMENTS = ("#", "%", "//")
"""How lines begin that are passed over, as are lines without any number before the first row."""

EMPTY = {"": "nan", "-": "nan", "--": "nan"}
"""Cells without a height, beside `nan`."""

MAX_FAULTS = 10


def text_map(file: str, data: bytes, unit: float, spacing: tuple[float, float]) -> HeightMap:
    """Return the height map in the bytes of a text file; `file` is its name in messages. The first row lies at y = 0.

    unit, spacing: of the heights, and of the points along x and y [m]. Between semicolons or tabs a comma is a decimal comma.
    Raises InputError with the lines that are no row of the map.
    """
    lines = [(number, line) for number, line in enumerate(data.decode("utf-8-sig", "replace").splitlines(), 1)
             if line.strip() and not line.lstrip().startswith(COMMENTS)]  # fmt: skip
    faults, rows = list[Fault](), list[np.ndarray]()
    for number, line in lines:
        cells = _cells(line)
        if not rows and len(cells) * len(lines) > MAX_POINTS:
            raise InputError(Fault("", f"has {len(cells) * len(lines):.3g} points, at most {MAX_POINTS:.3g} are read", file))
        try:
            row = np.array(cells, np.float64)
        except ValueError:
            words = [(column, cell) for column, cell in enumerate(cells, 1) if not _is_number(cell)]
            if rows or len(words) < len(cells):
                text = f"'{words[0][1][:40]}' is no number; a comment begins with {', '.join(COMMENTS)}"
                faults.append(Fault(f"column {words[0][0]}", text, file, number))
        else:
            if rows and len(row) != len(rows[0]):
                faults.append(Fault("", f"has {len(row)} values, expected {len(rows[0])} as in the first row", file, number))
            else:
                rows.append(row)
        if len(faults) == MAX_FAULTS:
            break
    if faults or not rows:
        raise InputError(faults or Fault("", "holds no row of numbers", file))
    heights = np.array(rows) * unit
    if np.isnan(heights[:, -1]).all():  # a delimiter at the end of each line
        heights = heights[:, :-1]
    return checked_map(heights, spacing, file)


def _cells(line: str) -> list[str]:
    """Return the cells of a line as Python writes numbers."""
    sign = next((sign for sign in "\t;," if sign in line.strip()), None)
    cells = [cell.strip() for cell in line.split(sign)]
    return [EMPTY.get(cell, cell if sign == "," else cell.replace(",", ".")) for cell in cells]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
