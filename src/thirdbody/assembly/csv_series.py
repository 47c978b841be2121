"""A quantity over time from a CSV file."""

import csv
import math
from collections.abc import Callable

from thirdbody import units
from thirdbody.bodies.bounded_read import MAX_ROWS, read_bytes
from thirdbody.errors import InputError
from thirdbody.scene.model import Scene

Fault = Callable[[str], InputError]

MAX_BYTES = 100 * MAX_ROWS
"""Bytes of the largest file: rows of two numbers of 15 digits take half of it."""


def rows_of(scene: Scene, location: tuple, file: str, word: str, dimension: str) -> list[tuple[float, float]]:
    """Read rows (time [s], value in SI) of a file with the header `time (unit), <word> (unit)`.

    Time and displacement begin at 0, a load is never negative. Raises InputError at the key `location` of the scene, with the
    line.
    """
    path = scene.beside(file)

    def fault(message: str) -> InputError:
        return InputError(scene.fault(location, f"{path}: {message}"))

    try:
        data = read_bytes(path)
    except InputError as error:
        raise InputError([scene.fault(location, str(entry)) for entry in error.faults]) from None
    if len(data) > MAX_BYTES or max(data.count(b"\n"), data.count(b"\r")) > MAX_ROWS:
        raise fault(f"is too large: at most {MAX_ROWS} rows and {MAX_BYTES / 1e6:.0f} MB are read")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise fault(f"is not UTF-8 text ({error.reason} at byte {error.start})") from None
    lines = _lines(text, fault)
    scales = _header(lines[0][1] if lines else [], word, dimension, fault)
    rows: list[tuple[float, float]] = []
    for number, row in lines[1:]:
        rows.append(_row(row, scales, lambda message, number=number: fault(f"line {number}: {message}")))  # type: ignore[misc]
        if dimension == "force" and rows[-1][1] < 0.0:
            raise fault(f"line {number}: a load is never negative")
        if len(rows) > 1 and rows[-1][0] <= rows[-2][0]:
            raise fault(f"line {number}: times must grow")
    if len(rows) < 2:
        raise fault("needs at least two rows")
    if rows[0][0] != 0.0 or (dimension == "length" and rows[0][1] != 0.0):
        raise fault("the first row must be time 0" + (f", {word} 0" if dimension == "length" else ""))
    return rows


def _lines(text: str, fault: Fault) -> list[tuple[int, list[str]]]:
    """Return number and cells of the lines that are not empty."""
    reader = csv.reader(text.splitlines())
    try:
        return [(reader.line_num, row) for row in reader if row]
    except csv.Error as error:
        raise fault(f"line {reader.line_num}: {error}") from None


def _row(cells: list[str], scales: tuple[float, float], fault: Fault) -> tuple[float, float]:
    try:
        t, x = (float(cell) * scale for cell, scale in zip(cells, scales, strict=True))
    except ValueError:
        raise fault(f"expected 2 numbers, got {', '.join(cells)}") from None
    if not (math.isfinite(t) and math.isfinite(x)):
        raise fault("not a finite number")
    return t, x


def _header(cells: list[str], word: str, dimension: str, fault: Fault) -> tuple[float, float]:
    """Return the scales of the two columns from a header such as `time (us), displacement (um)`."""
    scales = []
    for cell, (name, kind) in zip(cells, (("time", "time"), (word, dimension)), strict=False):
        given, _, unit = cell.strip().partition("(")
        if given.strip() != name or not unit.endswith(")"):
            raise fault(f"line 1: expected '{name} (unit)', got '{cell.strip()}'")
        try:
            scales.append(units.parse(f"1 {unit[:-1]}", kind))
        except ValueError as error:
            raise fault(f"line 1: {error}") from None
    if len(scales) != 2 or len(cells) != 2:
        raise fault(f"line 1: expected the header 'time (unit), {word} (unit)'")
    return scales[0], scales[1]
