"""Bodies from a table of spheres, CSV (units in its header) or NPZ (SI, plain numbers only)."""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from thirdbody import units
from thirdbody.bodies.clump import Clump, clump_with_frame, repeated_spheres
from thirdbody.errors import Fault, InputError, nearest
from thirdbody.input_files import LARGEST, MAX_ROWS, SHOWN, SMALLEST, csv_lines, is_number, npz_arrays, read_bytes, refuse
from thirdbody.rotations import quaternion_product

SUFFIXES = (".csv", ".npz")
# Optional quantities of a body, and their numbers of components.
_PER_BODY = {"quaternion": 4, "velocity": 3, "angular_velocity": 3}
# Tolerance of unit quaternions: seven written digits are accepted; a larger deviation was meant as something else.
_UNIT = 1e-6
# Cost of mass properties and poses of closely packed spheres: 3 s and 60 MB for 100, 13 s and 0.4 GB for 200.
MAX_SPHERES = 100
# Copies of one shape differ by the rounding of their positions; in units of the largest radius.
_ALIKE = 11
# Signatures of other file types under a wrong suffix.
_MAGIC = {
    b"PK\x03\x04": "a ZIP archive (an NPZ file or a spreadsheet)",
    b"\x93NUMPY": "a single array (NPY)",
    b"\x89HDF": "an HDF5 file",
    **{b"\x80" + bytes([k]): "a pickle, which is never loaded" for k in range(2, 6)},
}
# Columns of a CSV table, name: group, dimension.
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
# Of a table as text: a million spheres with all columns take 200 MB, in memory some ten times as much.
_MAX_TEXT, _MAX_COLUMNS = 250_000_000, 2 * len(_COLUMNS)
_TITLE = re.compile(r"\s*([^\[\]()]*?)\s*(?:[\[(]([^\[\]()]*)[\])])?\s*")


class Bodies(NamedTuple):
    """Bodies of a table in ascending order of their ids.

    positions (m, 3) [m] of the centres of mass, quaternions (m, 4) from principal frame to world; velocity (m, 3) [m/s] and
    angular_velocity (m, 3) [rad/s], or None.
    """

    clumps: list[Clump]
    positions: np.ndarray
    quaternions: np.ndarray
    has_orientations: bool
    velocity: np.ndarray | None
    angular_velocity: np.ndarray | None


class _Table(NamedTuple):
    """Spheres in SI: center (n, 3), radius (n,), id of the body of each (n,); ids (m,) ascending, the order of per_body.

    lines (n,): the line of each sphere in a text file; None for arrays.
    """

    file: str
    center: np.ndarray
    radius: np.ndarray
    clump: np.ndarray
    ids: np.ndarray
    per_body: Mapping[str, np.ndarray]
    lines: np.ndarray | None = None

    def fault(self, key: str, row: int, message: str) -> Fault:
        """Return a fault, reported at one of the spheres."""
        return Fault(key, message, self.file, None if self.lines is None else int(self.lines[row]))

    def named(self, rows: np.ndarray) -> str:
        """Name spheres by their lines or indices, the first few: "lines 4, 9"."""
        numbers = rows if self.lines is None else self.lines[rows]
        word = "sphere" if self.lines is None else "line"
        listed = ", ".join(str(number) for number in numbers[:5]) + (", ..." if len(numbers) > 5 else "")
        return f"{word}{'s' if len(numbers) > 1 else ''} {listed}"


def load_bodies(path: Path) -> Bodies:
    """Return the bodies in a CSV file (units in its header) or an NPZ file (SI, no pickles).

    Spheres with one `clump` id are one rigid body with the mass properties of their union. Their centers are world coordinates. A
    quaternion rotates the body as given in the file about its centre of mass, which stays in place: the centers are then in the
    clump's own axes, shifted to the position of the body. The velocity is that of the centre of mass. InputError: all faults,
    each with the file and its line, or array and index; at most ten and the number of the rest.
    """
    table = _read(path)
    _refuse_sizes(table)
    order = np.argsort(table.clump, kind="stable")
    members = np.split(order, np.searchsorted(table.clump[order], table.ids[1:]))
    orientations, faults = _normalised_quaternions(table, members)
    known: dict[tuple[bytes, bytes], tuple[Clump, np.ndarray, np.ndarray]] = {}
    clumps, positions, quaternions = [], [], []
    for b, rows in enumerate(members):
        name = f"clump {table.ids[b]}"
        if len(rows) > MAX_SPHERES:
            message = f"{len(rows)} spheres, at most {MAX_SPHERES} make a body; is the column of ids the right one?"
            faults.append(table.fault(name, rows[0], message))
            continue
        anchor, radii = table.center[rows[0]], table.radius[rows]
        arms = table.center[rows] - anchor
        key = radii.tobytes(), (np.round(arms / radii.max(), _ALIKE) + 0.0).tobytes()
        if key not in known and (repeated := repeated_spheres(arms, radii)):
            for k, first in repeated:
                message = f"{table.named(rows[[k]])} repeats {table.named(rows[[first]])}: the same center and radius; remove one"
                faults.append(table.fault(name, rows[k], message))
            continue
        try:
            known[key] = known[key] if key in known else clump_with_frame(arms, radii)
        except InputError as error:
            loose = rows[[int(fault.key[len("spheres[") : -1]) for fault in error.faults]]
            message = f"{table.named(loose)} not connected to {table.named(rows[:1])}: a rigid body must be in one piece"
            faults.append(table.fault(name, rows[0], message))
            continue
        body, arm, frame = known[key]
        clumps.append(body)
        positions.append(anchor + arm)
        quaternions.append(frame if orientations is None else quaternion_product(orientations[b], frame))
    refuse(faults)
    motion = table.per_body.get("velocity"), table.per_body.get("angular_velocity")
    return Bodies(clumps, np.array(positions), np.array(quaternions), orientations is not None, *motion)


def _read(path: Path) -> _Table:
    file, suffix = str(path), path.suffix.lower()
    if suffix not in SUFFIXES:
        known = " or ".join(SUFFIXES)
        raise InputError(Fault("", f"'{path.suffix}' is not a table of bodies that can be read; save it as {known}", file))
    data = read_bytes(path)
    if not data:
        raise InputError(Fault("", "is empty", file))
    other = next((what for magic, what in _MAGIC.items() if data.startswith(magic)), "")
    if suffix == ".npz":
        if not data.startswith(b"PK"):
            raise InputError(Fault("", f"is {other or 'no ZIP archive'}, expected an NPZ file (numpy.savez)", file))
        return _read_npz(file, data)
    if other:
        raise InputError(Fault("", f"is {other}, expected a CSV table", file))
    return _read_csv(file, data)


def _refuse_sizes(table: _Table) -> None:
    furthest = np.maximum(table.radius, np.abs(table.center).max(axis=1))
    odd = np.flatnonzero((table.radius < SMALLEST) | (furthest > LARGEST))
    if not len(odd):
        return
    k, more = int(odd[0]), f", and {len(odd) - 1} more" if len(odd) > 1 else ""
    centre = ", ".join(f"{v:.3g}" for v in table.center[k])
    message = f"radius {table.radius[k]:.3g} m at ({centre}) m{more}: outside {SMALLEST:g} to {LARGEST:g} m; is the unit right?"
    raise InputError(table.fault("sphere" if table.lines is not None else f"sphere[{k}]", k, message))


def _normalised_quaternions(table: _Table, members: list[np.ndarray]) -> tuple[np.ndarray | None, list[Fault]]:
    if "quaternion" not in table.per_body:
        return None, []
    quaternion = table.per_body["quaternion"]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        norms = np.linalg.norm(quaternion, axis=1)
        normalised = quaternion / norms[:, None]
    faults = []
    for b in np.flatnonzero(~(np.abs(norms - 1.0) <= _UNIT)):
        message = f"its quaternion (w, x, y, z) has length {norms[b]:.9g}, expected 1 to within {_UNIT:g}"
        faults.append(table.fault(f"clump {table.ids[b]}", members[b][0], message))
    return normalised, faults


class _Column(NamedTuple):
    name: str
    title: str
    unit: str
    dimension: str


def _read_csv(file: str, data: bytes) -> _Table:
    """InputError with all faults of the header, else of the cells, else between the rows of a clump."""
    if len(data) > _MAX_TEXT:
        message = f"has {len(data) / 1e6:.0f} MB of text, at most {_MAX_TEXT / 1e6:.0f} MB are read: save it as NPZ"
        raise InputError(Fault("", message, file))
    if (count := data.count(b"\n") - 1) > MAX_ROWS:
        raise InputError(Fault("", f"has {count} rows, at most {MAX_ROWS} spheres are read from one file", file))
    rows = csv_lines(file, data)
    if not rows:
        raise InputError(Fault("", f"is empty: the first line names the columns, such as {_EXAMPLE}", file))
    columns = _header(file, *rows[0])
    if len(rows) == 1:
        raise InputError(Fault("", "holds no spheres: nothing follows the header", file))
    values = _values(file, columns, rows[1:])
    lines = np.array([line for line, _ in rows[1:]])
    ids, first, body = np.unique(values["clump"], return_index=True, return_inverse=True)
    faults, per_body = [], {}
    for group in _PER_BODY:
        names = [name for name, (of, _) in _COLUMNS.items() if of == group and name in values]
        if not names:
            continue
        table = np.column_stack([values[name] for name in names])
        per_body[group] = table[first]
        odd = (table != table[first][body]).any(axis=1)
        for k in np.flatnonzero(odd)[np.unique(body[odd], return_index=True)[1]]:
            message = f"the {group.replace('_', ' ')} of clump {ids[body[k]]} differs from that in line {lines[first[body[k]]]}; "
            faults.append(Fault(", ".join(names), message + "it is one for all spheres of a clump", file, int(lines[k])))
    refuse(faults)
    center = np.column_stack([values[axis] for axis in "xyz"])
    return _Table(file, center, values["radius"], values["clump"], ids, per_body, lines)


def _header(file: str, line: int, titles: list[str]) -> list[_Column]:
    if len(titles) == 1 and (separator := next((s for s in ";\t" if s in titles[0]), "")):
        message = f"columns are separated by {separator!r}, expected ',' (and a point as decimal sign), such as {_EXAMPLE}"
        raise InputError(Fault("header", message, file, line))
    if all(is_number(title) for title in titles):
        raise InputError(Fault("header", f"expected the names of the columns, such as {_EXAMPLE}; got numbers", file, line))
    if len(titles) > _MAX_COLUMNS:
        raise InputError(Fault("header", f"names {len(titles)} columns, at most {_MAX_COLUMNS} are read", file, line))
    columns: list[_Column] = []
    faults = []
    for title in titles:
        try:
            columns.append(_column(title.strip(), [column.name for column in columns]))
        except ValueError as error:
            faults.append(Fault(title.strip() or "header", str(error), file, line))
    if not faults:  # an unknown name may be the one that is missing
        names = {column.name for column in columns}
        lacking = [name for name in _NEEDED if name not in names]
        reports = [f"{_are_missing(lacking)}, expected {_EXAMPLE}"] if lacking else []
        for group in _PER_BODY:
            wanted = [name for name, (of, _) in _COLUMNS.items() if of == group]
            absent = [name for name in wanted if name not in names]
            if absent and len(absent) < len(wanted):
                reports.append(f"{_are_missing(absent)}: {group.replace('_', ' ')} needs {', '.join(wanted)}")
        faults = [Fault("header", report, file, line) for report in reports]
    refuse(faults)
    return columns


def _column(title: str, before: list[str]) -> _Column:
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
    units.parse(f"1 {unit}", dimension)
    return _Column(name, title, unit, dimension)


def _are_missing(names: list[str]) -> str:
    return f"columns {', '.join(names)} are missing" if len(names) > 1 else f"column {names[0]} is missing"


def _values(file: str, columns: list[_Column], rows: list[tuple[int, list[str]]]) -> dict[str, np.ndarray]:
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
                values[column.name].append(_value(column, cell.strip()))
            except ValueError as error:
                faults.append(Fault(column.title, str(error), file, line))
    refuse(faults)
    return {name: np.array(column, np.int64 if name == "clump" else np.float64) for name, column in values.items()}


def _value(column: _Column, cell: str) -> float:
    if not cell:
        raise ValueError("the cell is empty")
    shown = f"'{cell[:40]}'"
    if column.name == "clump":
        if not (cell.isascii() and cell.isdigit() and len(cell) <= 18):
            raise ValueError(f"{shown} is not a whole number from 0 to 10^18, the id of the body")
        return int(cell)
    if not is_number(cell):
        raise ValueError(f"{shown} is not a number")
    number = float(cell)
    if not math.isfinite(number):
        raise ValueError(f"{shown} is not a finite number")
    if column.name == "radius" and number <= 0.0:
        raise ValueError(f"{shown} must be greater than 0")
    return units.parse(f"{cell} {column.unit}", column.dimension)


def _read_npz(file: str, data: bytes) -> _Table:
    """InputError with all faults of the names, else of the sizes, else of types, else of shapes, else of the values."""
    arrays = npz_arrays(file, data, ("center", "radius", "clump"), tuple(_PER_BODY))
    for name, array in arrays.items():
        if (count := max(array.shape, default=0)) > MAX_ROWS:
            raise InputError(Fault(name, f"has {count} rows, at most {MAX_ROWS} spheres are read from one file", file))
    faults = []
    for name, array in arrays.items():
        kinds, wanted = ("iu", "whole numbers, the ids of bodies") if name == "clump" else ("fiu", "real numbers")
        if array.dtype.kind not in kinds:
            faults.append(Fault(name, f"holds {array.dtype}, expected {wanted}", file))
    refuse(faults)
    if len(shape := arrays["clump"].shape) != 1 or not shape[0]:
        message = "holds no spheres" if shape == (0,) else f"has shape {shape}, expected (n,): one id for each sphere"
        raise InputError(Fault("clump", message, file))
    n, ids = shape[0], np.unique(arrays["clump"])
    shapes = {"center": (n, 3), "radius": (n,), "clump": (n,)} | {name: (len(ids), width) for name, width in _PER_BODY.items()}
    why = f"clump names {n} spheres", f"clump names {len(ids)} bodies, in the order of rising ids"
    refuse(
        Fault(name, f"has shape {array.shape}, expected {shapes[name]}: {why[name in _PER_BODY]}", file)
        for name, array in arrays.items()
        if array.shape != shapes[name]
    )
    faults, total = [], 0
    for name, array in arrays.items():
        indices = np.argwhere(~np.isfinite(array))
        total += len(indices)
        for index in indices[:SHOWN].tolist():
            faults.append(Fault(f"{name}{index}", f"{array[tuple(index)]} is not a finite number", file))
    rules = (("radius", np.less_equal, "{:g} m must be greater than 0"), ("clump", np.less, "{} must be at least 0"))
    for name, beyond, message in rules:
        rows = np.flatnonzero(beyond(arrays[name], 0))
        total += len(rows)
        faults += [Fault(f"{name}[{k}]", message.format(arrays[name][k]), file) for k in rows[:SHOWN]]
    refuse(faults, total)
    floats = {name: array.astype(np.float64) for name, array in arrays.items() if name != "clump"}
    return _Table(file, floats.pop("center"), floats.pop("radius"), arrays["clump"], ids, floats)
