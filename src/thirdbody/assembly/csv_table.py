"""CSV tables that a scene names: a header with units, then rows of numbers."""

import math
from collections.abc import Callable, Mapping

from thirdbody import units
from thirdbody.errors import Fault, InputError
from thirdbody.input_files import MAX_ROWS, csv_lines, read_bytes
from thirdbody.scene.model import Scene

MAX_BYTES = 100 * MAX_ROWS
"""Bytes of the largest file: rows of four numbers of 15 digits fit."""

Report = Callable[[str], InputError]
Rows = list[tuple[int, tuple[float, ...]]]


def numbers_of(
    scene: Scene, location: tuple, file: str, columns: Mapping[str, str], optional: Mapping[str, str] | None = None
) -> tuple[Rows, Report]:
    """Return line and numbers in SI of each row of a file, and what makes a fault of it: an error of the message.

    The header is `name (unit), ...`. `columns`: names and dimensions, in this order; after them the `optional` ones, which the
    file may leave out. Raises InputError at the key `location` of the scene, with the line.
    """
    path = scene.beside(file)

    def fault(message: str) -> InputError:
        return InputError(scene.fault(location, f"{path}: {message}"))

    try:
        data = read_bytes(path)
        if len(data) > MAX_BYTES or max(data.count(b"\n"), data.count(b"\r")) > MAX_ROWS:
            message = f"is too large: at most {MAX_ROWS} rows and {MAX_BYTES / 1e6:.0f} MB are read"
            raise InputError(Fault("", message, str(path)))
        lines = csv_lines(str(path), data)
    except InputError as error:
        raise InputError([scene.fault(location, str(entry)) for entry in error.faults]) from None
    header = lines[0][1] if lines else []
    scales = _scales(header, dict(columns) | (dict(optional or {}) if len(header) > len(columns) else {}), fault)
    rows: Rows = []
    for number, row in lines[1:]:
        try:
            values = tuple(float(cell) * scale for cell, scale in zip(row, scales, strict=True))
        except ValueError:
            raise fault(f"line {number}: expected {len(scales)} numbers, got {', '.join(row)}") from None
        if not all(math.isfinite(value) for value in values):
            raise fault(f"line {number}: not a finite number")
        rows.append((number, values))
    return rows, fault


def _scales(cells: list[str], columns: Mapping[str, str], fault: Report) -> list[float]:
    scales = []
    for cell, (name, kind) in zip(cells, columns.items(), strict=False):
        given, _, unit = cell.strip().partition("(")
        if given.strip() != name or not unit.endswith(")"):
            raise fault(f"line 1: expected '{name} (unit)', got '{cell.strip()}'")
        try:
            scales.append(units.parse(f"1 {unit[:-1]}", kind))
        except ValueError as error:
            raise fault(f"line 1: {error}") from None
    if len(scales) != len(columns) or len(cells) != len(columns):
        header = ", ".join(f"{name} (unit)" for name in columns)
        raise fault(f"line 1: expected the header '{header}'")
    return scales
