"""Measured surfaces from files: NPZ, X3P (ISO 25178-72) and text here, the formats of instruments by SurfaceTopography."""

from __future__ import annotations

import hashlib
import io
import math
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from thirdbody import units
from thirdbody.errors import Fault, InputError, MissingLibrary, UsageError
from thirdbody.input_files import is_number, member, npz_arrays, opened_archive, read_bytes
from thirdbody.surfaces.grid import MAX_POINTS
from thirdbody.surfaces.scan import TEXTS, HeightMap, checked_map

# How lines of a text begin that are passed over, as are lines without any number before the first row; cells without a height.
_COMMENTS, _EMPTY = ("#", "%", "//"), {"": "nan", "-": "nan", "--": "nan"}
_MAX_FAULTS = 10
# Of X3P: the largest number of points along an axis that is taken for one; types of the heights by their letter, and those that
# some writers use for whole numbers instead.
_MAX_COUNT = 1e9
_TYPES = {"I": "<i2", "L": "<i4", "F": "<f4", "D": "<f8"}
_UNSIGNED = {"I": "<u2", "L": "<u4"}
_MATRIX, _LINK = "Record3/MatrixDimension/", "Record3/DataLink/"


def read_scan(path: Path, key: str = "", unit: float | None = None, spacing: tuple[float, float] | None = None) -> HeightMap:
    """Return the height map of a file. Raises InputError; `key` is that of the scene which names the file.

    unit, spacing: of the heights of a text file, and of its points along x and y [m].
    """
    suffix = path.suffix.lower()
    if suffix in TEXTS and unit is not None and spacing is not None:
        return _text_map(str(path), read_bytes(path, key), unit, spacing)
    if suffix not in _READERS:
        known = " or ".join((*_READERS, *TEXTS))
        hint = "`thirdbody surface FILE -o scan.npz` converts other formats"
        raise InputError(Fault(key, f"has the suffix '{path.suffix}', expected {known}; {hint}", str(path)))
    return _READERS[suffix](str(path), read_bytes(path, key))


def read_any_scan(path: Path, unit: str | None = None, spacing: str | None = None) -> HeightMap:
    """Return the height map of a file of any format that can be read; `unit` is that of a file which names none.

    spacing: that of the points of a text file, one length, or two with a comma, along x and y.

    Raises InputError for the file, UsageError for a unit that does not belong there, MissingLibrary for a format that needs
    SurfaceTopography.
    """
    if path.suffix.lower() in TEXTS:
        if unit is None or spacing is None:
            raise UsageError(f"{path}: text names neither its unit nor its points: give --unit um --spacing '0.5 um'")
        try:
            steps = [units.parse(text, "length") for text in spacing.split(",")]
        except ValueError as error:
            raise UsageError(f"--spacing: {error}") from None
        if len(steps) > 2:
            raise UsageError(f"--spacing: '{spacing}': expected one length, or two, along x and y")
        return read_scan(path, "", _unit(path, None, unit), (steps[0], steps[-1]))
    if spacing is not None:
        raise UsageError("--spacing: for text files (.csv, .txt); others have it")
    if path.suffix.lower() in _READERS:
        if unit is not None:
            raise UsageError("--unit: NPZ and X3P files name their unit themselves")
        return read_scan(path)
    read_bytes(path)  # its faults are clearer than those of a reader of many formats
    try:
        from SurfaceTopography.IO import open_topography
    except ImportError:
        raise MissingLibrary(f"{path}: this format is read by SurfaceTopography: pip install 'thirdbody[topography]'") from None
    try:
        with open_topography(str(path)) as file:
            topography = file.topography()
            if (points := math.prod(topography.nb_grid_pts)) > MAX_POINTS:  # before they take memory
                raise InputError(Fault("", f"has {points:.3g} points, at most {MAX_POINTS:.3g} are read", str(path)))
            heights, sizes, named = topography.heights(), topography.physical_sizes, topography.unit
            regular = topography.dim == 2 and topography.is_uniform
    except InputError:
        raise
    except MemoryError:
        raise InputError(Fault("", "does not fit into memory", str(path))) from None
    except Exception as error:  # forty readers of foreign formats: a damaged file may raise anything
        reason = f"{type(error).__name__}: {error}".strip().splitlines()[0][:200]
        raise InputError(Fault("", f"SurfaceTopography cannot read it ({reason})", str(path))) from None
    if not regular:
        raise InputError(Fault("", "is no height map on a regular grid", str(path)))
    scale = _unit(path, named, unit)
    heights = np.ascontiguousarray(np.ma.filled(np.ma.asarray(heights, float), np.nan).T) * scale
    steps = [float(length) * scale / n for length, n in zip(sizes, heights.shape[::-1], strict=True)]
    return checked_map(heights, (steps[0], steps[1]), str(path))


def _unit(path: Path, named: str | None, given: str | None) -> float:
    if named and given is not None:
        raise UsageError(f"--unit: {path} names its unit, {named}")
    if not named and given is None:
        raise UsageError(f"{path}: names no unit: give the one of its lengths, such as --unit um")
    text = str(named or given)
    try:
        return units.parse_unit(text)
    except ValueError as error:
        if named:
            raise InputError(Fault("unit", str(error), str(path))) from None
        raise UsageError(f"--unit: {error}") from None


def _text_map(file: str, data: bytes, unit: float, spacing: tuple[float, float]) -> HeightMap:
    """Return the map in a text: a line of numbers per row of points, between commas, semicolons, tabs or blanks.

    The first row lies at y = 0. Between semicolons or tabs a comma is a decimal comma.
    """
    lines = [(number, line) for number, line in enumerate(data.decode("utf-8-sig", "replace").splitlines(), 1)
             if line.strip() and not line.lstrip().startswith(_COMMENTS)]  # fmt: skip
    faults, rows = list[Fault](), list[np.ndarray]()
    for number, line in lines:
        sign = next((sign for sign in "\t;," if sign in line.strip()), None)
        cells = [cell.strip() for cell in line.split(sign)]
        cells = [_EMPTY.get(cell, cell if sign == "," else cell.replace(",", ".")) for cell in cells]
        if not rows and len(cells) * len(lines) > MAX_POINTS:
            raise InputError(Fault("", f"has {len(cells) * len(lines):.3g} points, at most {MAX_POINTS:.3g} are read", file))
        try:
            row = np.array(cells, np.float64)
        except ValueError:
            words = [(column, cell) for column, cell in enumerate(cells, 1) if not is_number(cell)]
            if rows or len(words) < len(cells):
                text = f"'{words[0][1][:40]}' is no number; a comment begins with {', '.join(_COMMENTS)}"
                faults.append(Fault(f"column {words[0][0]}", text, file, number))
        else:
            if rows and len(row) != len(rows[0]):
                faults.append(Fault("", f"has {len(row)} values, expected {len(rows[0])} as in the first row", file, number))
            else:
                rows.append(row)
        if len(faults) == _MAX_FAULTS:
            break
    if faults or not rows:
        raise InputError(faults or Fault("", "holds no row of numbers", file))
    heights = np.array(rows) * unit
    if np.isnan(heights[:, -1]).all():  # a delimiter at the end of each line
        heights = heights[:, :-1]
    return checked_map(heights, spacing, file)


def _npz_map(file: str, data: bytes) -> HeightMap:
    """Return the map of `heights` (n_y, n_x), `spacing` (one, or along x and y), `unit` (a text, such as "um").

    `height_unit` is that of the heights where it differs from `unit`.
    """
    arrays = npz_arrays(file, data, ("heights", "spacing", "unit"), ("height_unit",))
    faults = []
    for name, array in arrays.items():
        shape, text = array.shape, name.endswith("unit")
        if array.dtype.kind not in ("US" if text else "fiu"):
            faults.append(Fault(name, f"holds {array.dtype}, expected {'a text' if text else 'real numbers'}", file))
        elif text and array.size != 1:
            faults.append(Fault(name, f"has shape {shape}, expected one text", file))
        elif name == "heights" and len(shape) != 2:
            faults.append(Fault(name, f"has shape {shape}, expected (n_y, n_x)", file))
        elif name == "spacing" and shape not in ((), (1,), (2,)):
            faults.append(Fault(name, f"has shape {shape}, expected one number, or those along x and y", file))
    if (points := arrays["heights"].size) > MAX_POINTS:
        message = f"has {points:.3g} points, at most {MAX_POINTS:.3g} are read: crop or thin the map"
        faults.append(Fault("heights", message, file))
    if faults:
        raise InputError(faults)
    lengths = {}
    for name in ("unit", "height_unit"):
        value = arrays.get(name, arrays["unit"]).reshape(-1)[0]
        word = value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)
        try:
            lengths[name] = units.parse_unit(word)
        except ValueError as error:
            raise InputError(Fault(name, str(error), file)) from None
    step_x, step_y = np.broadcast_to(arrays["spacing"].astype(np.float64), 2) * lengths["unit"]
    return checked_map(arrays["heights"].astype(np.float64) * lengths["height_unit"], (float(step_x), float(step_y)), file)


def npz_bytes(scan: HeightMap) -> bytes:
    """Return a height map as the content of an NPZ file, lengths in metres."""
    stream = io.BytesIO()
    np.savez_compressed(stream, heights=scan.heights, spacing=np.array(scan.spacing), unit=np.array("m"))
    return stream.getvalue()


class _Grid(NamedTuple):
    """What `main.xml` says: points along x and y, spacing [m], letter of the type, increment and offset of whole numbers [m]."""

    counts: tuple[int, int]
    spacing: tuple[float, float]
    letter: str
    increment: float
    offset: float


def _x3p_map(file: str, data: bytes) -> HeightMap:
    """Return the map in an X3P file: a ZIP archive with `main.xml` and binary data, in metres."""
    with opened_archive(file, data) as archive:
        xml = member(file, archive, "main.xml")
        if b"<!DOCTYPE" in xml:  # entities could grow without bound
            raise InputError(Fault("main.xml", "declares a document type, which X3P files have none of: it is not read", file))
        try:
            main = ElementTree.fromstring(xml)
        except ElementTree.ParseError as error:
            raise InputError(Fault("main.xml", f"is not valid XML: {error}", file)) from None
        grid = _grid(file, main)
        (n_x, n_y), dtype = grid.counts, np.dtype(_TYPES[grid.letter])
        name, raw = _linked(file, archive, main, "PointDataLink", "MD5ChecksumPointData")
        if len(raw) != n_x * n_y * dtype.itemsize:
            message = f"has {len(raw)} bytes, expected {n_x * n_y * dtype.itemsize} for {n_x} x {n_y} points"
            raise InputError(Fault(name, message, file))
        numbers, valid = np.frombuffer(raw, dtype).reshape(n_y, n_x), np.ones((n_y, n_x), bool)
        if _element(main, f"{_LINK}ValidPointsLink"):
            name, bits = _linked(file, archive, main, "ValidPointsLink", "MD5ChecksumValidPoints")
            if len(bits) != (n_x * n_y + 7) // 8:
                message = f"has {len(bits)} bytes, expected {(n_x * n_y + 7) // 8}: a bit per point"
                raise InputError(Fault(name, message, file))
            valid = np.unpackbits(np.frombuffer(bits, np.uint8), count=n_x * n_y, bitorder="little").reshape(n_y, n_x) == 1
    notes: tuple[str, ...] = ()
    if grid.letter in _UNSIGNED and _wraps(numbers, valid) and not _wraps(numbers.view(_UNSIGNED[grid.letter]), valid):
        numbers = numbers.view(_UNSIGNED[grid.letter])
        notes = (f"{Path(file).name}: whole numbers read as unsigned: as signed ones, which the format asks for, neighbours "
                 "would differ by more than half the range",)  # fmt: skip
    heights = np.where(valid, numbers.astype(np.float64) * grid.increment + grid.offset, np.nan)
    return replace(checked_map(heights, grid.spacing, file), notes=notes)


_READERS = {".npz": _npz_map, ".x3p": _x3p_map}


def _wraps(numbers: np.ndarray, valid: np.ndarray) -> bool:
    half = 2 ** (8 * numbers.dtype.itemsize - 1)
    heights = np.where(valid, numbers, np.nan)
    return any(bool(np.any(np.abs(np.diff(heights, axis=axis)) > half)) for axis in (0, 1))


def _element(main: ElementTree.Element, path: str) -> str:
    """Return the text of an element in whichever namespace; empty if it is missing."""
    return (main.findtext("/".join(f"{{*}}{tag}" for tag in path.split("/"))) or "").strip()


def _grid(file: str, main: ElementTree.Element) -> _Grid:
    faults: list[Fault] = []

    def word(path: str, allowed: str, meaning: str) -> str:
        value = _element(main, path)
        if value not in allowed.split():
            said = f"'{value[:40]}'" if value else "missing"
            faults.append(Fault(path, f"{said}, expected {' or '.join(allowed.split())}: {meaning}", file))
        return value

    def number(path: str, default: float | None = None) -> float:
        text = _element(main, path)
        try:
            value = float(text) if text or default is None else default
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            faults.append(Fault(path, f"{repr(text[:40]) if text else 'missing'}, expected a number", file))
        return value

    def count(path: str) -> int:
        value = number(path)
        whole = 1.0 <= value <= _MAX_COUNT and value == int(value)
        if np.isfinite(value) and not whole:
            faults.append(Fault(path, f"{value:g} must be a whole number from 1 to {_MAX_COUNT:g}", file))
        return int(value) if whole else 0

    axes = "Record1/Axes/"
    word("Record1/FeatureType", "SUR", "a surface (profiles and point clouds are not read)")
    for axis in ("CX", "CY"):
        word(f"{axes}{axis}/AxisType", "I", "a regular grid, whose axes have an increment")
    letter = word(f"{axes}CZ/DataType", " ".join(_TYPES), "the type of the heights")
    spacing = number(f"{axes}CX/Increment"), number(f"{axes}CY/Increment")
    increment, offset = number(f"{axes}CZ/Increment", 1.0), number(f"{axes}CZ/Offset", 0.0)
    counts, layers = (count(f"{_MATRIX}SizeX"), count(f"{_MATRIX}SizeY")), count(f"{_MATRIX}SizeZ")
    if layers > 1:
        faults.append(Fault(f"{_MATRIX}SizeZ", f"{layers} layers, expected 1", file))
    if counts[0] * counts[1] > MAX_POINTS:
        message = f"{counts[0]} x {counts[1]} points, at most {MAX_POINTS:.3g} are read: crop or thin the map"
        faults.append(Fault(f"{_MATRIX}SizeX", message, file))
    if not _element(main, f"{_LINK}PointDataLink"):
        faults.append(Fault(f"{_LINK}PointDataLink", "missing: heights are read from a binary file of the archive", file))
    if faults:
        raise InputError(faults)
    return _Grid(counts, spacing, letter, increment, offset)


def _linked(file: str, archive: zipfile.ZipFile, main: ElementTree.Element, link: str, checksum: str) -> tuple[str, bytes]:
    name, wanted = _element(main, _LINK + link), _element(main, _LINK + checksum).lower()
    data = member(file, archive, name)
    if wanted and hashlib.md5(data, usedforsecurity=False).hexdigest() != wanted:
        raise InputError(Fault(name, "differs from its checksum in main.xml: the file is damaged", file))
    return name, data
