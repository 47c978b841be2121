"""Bodies from a CSV table: one sphere per row, units in the header."""

import csv
import io
import math
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from thirdbody.bodies.bounded_read import MAX_ROWS
from thirdbody.bodies.sphere_table import PER_BODY, SphereTable, refuse
from thirdbody.errors import Fault, InputError, nearest

Parse = Callable[[str, str], float]
"""Conversion of a text with unit ("5 um") and a dimension ("length") to SI. Raises ValueError with the reason."""

# name: group, dimension
_COLUMNS = {
    "clump": ("clump", "dimensionless"),
    **{f"{axis}": ("center", "length") for axis in "xyz"},
    "radius": ("radius", "length"),
    **{f"q{part}": ("quaternion", "dimensionless") for part in "wxyz"},
    **{f"v{axis}": ("velocity", "velocity") for axis in "xyz"},
    **{f"w{axis}": ("angular_velocity", "angular_velocity") for axis in "xyz"},
}
_LONG = {"center": "", "quaternion": "q", "velocity": "v", "angular_velocity": "w"}
_ALIASES = {f"{word}_{part}": short + part for word, short in _LONG.items() for part in "wxyz" if short + part in _COLUMNS}
_NEEDED = ("clump", "x", "y", "z", "radius")
_EXAMPLE = "clump,x [um],y [um],z [um],radius [um]"
# Of a table as text: a million spheres with all columns take 200 MB.
MAX_TABLE_BYTES, MAX_COLUMNS = 250_000_000, 2 * len(_COLUMNS)

_TITLE = re.compile(r"\s*([^\[\]()]*?)\s*(?:[\[(]([^\[\]()]*)[\])])?\s*")


@dataclass(frozen=True)
class _Column:
    """A column of the file: name, title in the file, unit and dimension."""

    name: str
    title: str
    unit: str
    dimension: str


def read_csv(file: str, data: bytes, parse: Parse) -> SphereTable:
    """Return the table in the bytes of a CSV file; `file` is its name in messages, `parse` reads quantities with units.

    InputError with all faults of the header, else of the cells, else between the rows of a clump.
    """
    _refuse_large(file, data)
    rows = _rows(file, _text(file, data))
    if not rows:
        raise InputError(Fault("", f"is empty: the first line names the columns, such as {_EXAMPLE}", file))
    columns = _header(file, *rows[0], parse)
    if len(rows) == 1:
        raise InputError(Fault("", "holds no spheres: nothing follows the header", file))
    values = _values(file, columns, rows[1:], parse)
    return _sphere_table(file, columns, values, np.array([line for line, _ in rows[1:]]))


def _refuse_large(file: str, data: bytes) -> None:
    """Raise InputError for more text than a table of bodies needs: cells take some ten times as much memory."""
    if len(data) > MAX_TABLE_BYTES:
        message = f"has {len(data) / 1e6:.0f} MB of text, at most {MAX_TABLE_BYTES / 1e6:.0f} MB are read: save it as NPZ"
        raise InputError(Fault("", message, file))
    if (rows := data.count(b"\n") - 1) > MAX_ROWS:
        raise InputError(Fault("", f"has {rows} rows, at most {MAX_ROWS} spheres are read from one file", file))
    if (cells := data.count(b",")) > MAX_COLUMNS * MAX_ROWS:
        raise InputError(Fault("", f"has {cells} cells, at most {MAX_COLUMNS * MAX_ROWS} are read", file))


def _text(file: str, data: bytes) -> str:
    if b"\0" in data[:4096]:
        wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
        what = "is UTF-16 text; save it as UTF-8" if wide else "holds binary data, not the text of a CSV table"
        raise InputError(Fault("", what, file))
    try:
        return data.decode("utf-8-sig")  # spreadsheets begin their UTF-8 with a byte order mark
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        message = f"byte 0x{data[error.start]:02x} is not UTF-8 text; save the table as CSV in UTF-8"
        raise InputError(Fault("", message, file, line)) from None


def _rows(file: str, text: str) -> list[tuple[int, list[str]]]:
    """Return line number and cells of every row that is not blank."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        return [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise InputError(Fault("", f"is no CSV table from here on ({error})", file, reader.line_num)) from None


def _header(file: str, line: int, titles: list[str], parse: Parse) -> list[_Column]:
    """Return the columns. Raises InputError for unknown, missing and repeated ones, and for missing units."""
    if len(titles) == 1 and (separator := next((s for s in ";\t" if s in titles[0]), "")):
        message = f"columns are separated by {separator!r}, expected ',' (and a point as decimal sign), such as {_EXAMPLE}"
        raise InputError(Fault("header", message, file, line))
    if all(_is_number(title) for title in titles):
        raise InputError(Fault("header", f"expected the names of the columns, such as {_EXAMPLE}; got numbers", file, line))
    if len(titles) > MAX_COLUMNS:
        raise InputError(Fault("header", f"names {len(titles)} columns, at most {MAX_COLUMNS} are read", file, line))
    columns: list[_Column] = []
    faults = []
    for title in titles:
        try:
            columns.append(_column(title.strip(), [column.name for column in columns], parse))
        except ValueError as error:
            faults.append(Fault(title.strip() or "header", str(error), file, line))
    if not faults:  # an unknown name may be the one that is missing
        faults = [Fault("header", message, file, line) for message in _missing({column.name for column in columns})]
    refuse(faults)
    return columns


def _column(title: str, before: list[str], parse: Parse) -> _Column:
    """Return the column with a title such as "x [um]". Raises ValueError."""
    match = _TITLE.fullmatch(title)
    word, unit = (match[1].lower(), (match[2] or "").strip()) if match else (title, "")
    name = _ALIASES.get(word, word)
    if name not in _COLUMNS:
        raise ValueError(f"unknown column, {nearest(word, _COLUMNS)}" if word else "a column has no name")
    if name in before:
        raise ValueError(f"column {name} is given twice")
    _, dimension = _COLUMNS[name]
    if not unit and dimension != "dimensionless":
        raise ValueError(f"{name} has no unit: write a unit of {dimension.replace('_', ' ')} in brackets after the name")
    parse(f"1 {unit}", dimension)
    return _Column(name, title, unit, dimension)


def _missing(names: set[str]) -> list[str]:
    """Return what is wrong with the set of columns."""
    lacking = [name for name in _NEEDED if name not in names]
    report = [f"{_are_missing(lacking)}, expected {_EXAMPLE}"] if lacking else []
    for group in PER_BODY:
        wanted = [name for name, (of, *_) in _COLUMNS.items() if of == group]
        absent = [name for name in wanted if name not in names]
        if absent and len(absent) < len(wanted):
            report.append(f"{_are_missing(absent)}: {group.replace('_', ' ')} needs {', '.join(wanted)}")
    return report


def _are_missing(names: list[str]) -> str:
    return f"columns {', '.join(names)} are missing" if len(names) > 1 else f"column {names[0]} is missing"


def _values(file: str, columns: list[_Column], rows: list[tuple[int, list[str]]], parse: Parse) -> dict[str, np.ndarray]:
    """Return the values (n,) of every column in SI. Raises InputError with all faulty cells."""
    faults = []
    values: dict[str, list[float]] = {column.name: [] for column in columns}
    for line, cells in rows:
        if len(cells) != len(columns):
            why = "a cell is missing, or the file is cut short" if len(cells) < len(columns) else "a comma too many"
            message = f"{len(cells)} cells, but the header names {len(columns)} columns: {why}"
            faults.append(Fault("row", message, file, line))
            continue
        for column, cell in zip(columns, cells, strict=True):
            try:
                values[column.name].append(_value(column, cell.strip(), parse))
            except ValueError as error:
                faults.append(Fault(column.title, str(error), file, line))
    refuse(faults)
    return {name: np.array(column, np.int64 if name == "clump" else np.float64) for name, column in values.items()}


def _value(column: _Column, cell: str, parse: Parse) -> float:
    """Return the cell in SI. Raises ValueError."""
    if not cell:
        raise ValueError("the cell is empty")
    shown = f"'{cell[:40]}'"
    if column.name == "clump":
        if not (cell.isascii() and cell.isdigit() and len(cell) <= 18):
            raise ValueError(f"{shown} is not a whole number from 0 to 10^18, the id of the body")
        return int(cell)
    if not _is_number(cell):
        raise ValueError(f"{shown} is not a number")
    number = float(cell)
    if not math.isfinite(number):
        raise ValueError(f"{shown} is not a finite number")
    if column.name == "radius" and number <= 0.0:
        raise ValueError(f"{shown} must be greater than 0")
    return parse(f"{cell} {column.unit}", column.dimension)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _sphere_table(file: str, columns: list[_Column], values: dict[str, np.ndarray], lines: np.ndarray) -> SphereTable:
    """Return the table of the columns. Raises InputError where the rows of one clump disagree about their body."""
    ids, first, body = np.unique(values["clump"], return_index=True, return_inverse=True)
    faults = []
    per_body: dict[str, np.ndarray | None] = dict.fromkeys(PER_BODY)
    for group in PER_BODY:
        names = [name for name, (of, *_) in _COLUMNS.items() if of == group and name in values]
        if not names:
            continue
        rows = np.column_stack([values[name] for name in names])
        per_body[group] = rows[first]
        odd = (rows != rows[first][body]).any(axis=1)
        for k in np.flatnonzero(odd)[np.unique(body[odd], return_index=True)[1]]:
            message = f"the {group.replace('_', ' ')} of clump {ids[body[k]]} differs from that in line {lines[first[body[k]]]}; "
            faults.append(Fault(", ".join(names), message + "it is one for all spheres of a clump", file, int(lines[k])))
    refuse(faults)
    center = np.column_stack([values[axis] for axis in "xyz"])
    return SphereTable(file, center, values["radius"], values["clump"], ids, **per_body, lines=lines)
