"""Height maps in X3P files (ISO 25178-72, formerly ISO 5436-2): a ZIP archive with `main.xml` and binary data, in metres."""

from __future__ import annotations

import hashlib
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from thirdbody.errors import Fault, InputError
from thirdbody.surfaces.grid import MAX_POINTS
from thirdbody.surfaces.height_map import HeightMap, checked_map
from thirdbody.surfaces.zip_members import damage_reported, member, opened_archive

MAX_COUNT = 1e9
"""Largest number of points along an axis that is taken for one."""

TYPES = {"I": "<i2", "L": "<i4", "F": "<f4", "D": "<f8"}
"""Types of the heights by their letter."""

UNSIGNED = {"I": "<u2", "L": "<u4"}
"""Types that some writers use for whole numbers instead."""

_MATRIX, _LINK = "Record3/MatrixDimension/", "Record3/DataLink/"


class _Header(NamedTuple):
    """Points along x and y, spacing [m], type of the heights, increment and offset of whole numbers [m]."""

    counts: tuple[int, int]
    spacing: tuple[float, float]
    letter: str
    increment: float
    offset: float


def x3p_map(file: str, data: bytes) -> HeightMap:
    """Return the height map in the bytes of an X3P file; `file` is its name in messages. Raises InputError with all faults."""
    with damage_reported(file), opened_archive(file, data) as archive:
        texts = _texts(file, member(file, archive, "main.xml"))
        header = _header(file, texts)
        n_x, n_y = header.counts
        dtype = np.dtype(TYPES[header.letter])
        raw = _data(file, archive, texts, f"{_LINK}PointDataLink", f"{_LINK}MD5ChecksumPointData")
        if len(raw) != n_x * n_y * dtype.itemsize:
            message = f"has {len(raw)} bytes, expected {n_x * n_y * dtype.itemsize} for {n_x} x {n_y} points"
            raise InputError(Fault(texts[f"{_LINK}PointDataLink"], message, file))
        numbers, valid = np.frombuffer(raw, dtype).reshape(n_y, n_x), np.ones((n_y, n_x), bool)
        if texts.get(f"{_LINK}ValidPointsLink"):
            bits = _data(file, archive, texts, f"{_LINK}ValidPointsLink", f"{_LINK}MD5ChecksumValidPoints")
            if len(bits) != (n_x * n_y + 7) // 8:
                message = f"has {len(bits)} bytes, expected {(n_x * n_y + 7) // 8}: a bit per point"
                raise InputError(Fault(texts[f"{_LINK}ValidPointsLink"], message, file))
            valid = np.unpackbits(np.frombuffer(bits, np.uint8), count=n_x * n_y, bitorder="little").reshape(n_y, n_x) == 1
    notes: tuple[str, ...] = ()
    if header.letter in UNSIGNED and _wraps(numbers, valid) and not _wraps(numbers.view(UNSIGNED[header.letter]), valid):
        numbers = numbers.view(UNSIGNED[header.letter])
        notes = (f"{Path(file).name}: whole numbers read as unsigned: as signed ones, which the format asks for, neighbours "
                 "would differ by more than half the range",)  # fmt: skip
    heights = np.where(valid, numbers.astype(np.float64) * header.increment + header.offset, np.nan)
    return replace(checked_map(heights, header.spacing, file), notes=notes)


def _wraps(numbers: np.ndarray, valid: np.ndarray) -> bool:
    """Return whether neighbours differ by more than half the range of their type."""
    half = 2 ** (8 * numbers.dtype.itemsize - 1)
    heights = np.where(valid, numbers, np.nan)
    return any(bool(np.any(np.abs(np.diff(heights, axis=axis)) > half)) for axis in (0, 1))


def _header(file: str, texts: dict[str, str]) -> _Header:
    """Return what `main.xml` says of the grid. Raises InputError with all its faults."""
    faults: list[Fault] = []

    def word(path: str, allowed: str, meaning: str) -> str:
        value = texts.get(path, "")
        if value not in allowed.split():
            said = f"'{value[:40]}'" if value else "missing"
            faults.append(Fault(path, f"{said}, expected {' or '.join(allowed.split())}: {meaning}", file))
        return value

    def number(path: str, default: float | None = None) -> float:
        text = texts.get(path, "")
        try:
            value = float(text) if text or default is None else default
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            faults.append(Fault(path, f"{repr(text[:40]) if text else 'missing'}, expected a number", file))
        return value

    def count(path: str) -> int:
        value = number(path)
        whole = 1.0 <= value <= MAX_COUNT and value == int(value)
        if np.isfinite(value) and not whole:
            faults.append(Fault(path, f"{value:g} must be a whole number from 1 to {MAX_COUNT:g}", file))
        return int(value) if whole else 0

    axes = "Record1/Axes/"
    word("Record1/FeatureType", "SUR", "a surface (profiles and point clouds are not read)")
    for axis in ("CX", "CY"):
        word(f"{axes}{axis}/AxisType", "I", "a regular grid, whose axes have an increment")
    letter = word(f"{axes}CZ/DataType", " ".join(TYPES), "the type of the heights")
    spacing = number(f"{axes}CX/Increment"), number(f"{axes}CY/Increment")
    increment, offset = number(f"{axes}CZ/Increment", 1.0), number(f"{axes}CZ/Offset", 0.0)
    counts, layers = (count(f"{_MATRIX}SizeX"), count(f"{_MATRIX}SizeY")), count(f"{_MATRIX}SizeZ")
    if layers > 1:
        faults.append(Fault(f"{_MATRIX}SizeZ", f"{layers} layers, expected 1", file))
    if counts[0] * counts[1] > MAX_POINTS:
        message = f"{counts[0]} x {counts[1]} points, at most {MAX_POINTS:.3g} are read: crop or thin the map"
        faults.append(Fault(f"{_MATRIX}SizeX", message, file))
    if not texts.get(f"{_LINK}PointDataLink"):
        faults.append(Fault(f"{_LINK}PointDataLink", "missing: heights are read from a binary file of the archive", file))
    if faults:
        raise InputError(faults)
    return _Header(counts, spacing, letter, increment, offset)


def _data(file: str, archive: zipfile.ZipFile, texts: dict[str, str], link: str, checksum: str) -> bytes:
    """Return the bytes of a member named in `main.xml`, with their checksum verified. Raises InputError."""
    name = texts[link]
    data = member(file, archive, name)
    wanted = texts.get(checksum, "").lower()
    if wanted and hashlib.md5(data, usedforsecurity=False).hexdigest() != wanted:
        raise InputError(Fault(name, "differs from its checksum in main.xml: the file is damaged", file))
    return data


def _texts(file: str, xml: bytes) -> dict[str, str]:
    """Return the texts of the elements of `main.xml` by path below the root, the first of each.

    A document type, and so any entity, is refused: entities can grow without bound and read files. Raises InputError.
    """
    parser = expat.ParserCreate(namespace_separator=" ")
    path, texts = list[str](), dict[str, str]()

    def refuse(*_: object) -> None:
        raise InputError(Fault("main.xml", "declares a document type, which X3P files have none of: it is not read", file))

    def start(name: str, _: object) -> None:
        pieces.clear()
        path.append(name.rpartition(" ")[2])

    def text(words: str) -> None:
        pieces.append(words)

    def end(_: str) -> None:
        texts.setdefault("/".join(path[1:]), "".join(pieces).strip())
        pieces.clear()
        path.pop()

    pieces: list[str] = []
    parser.StartDoctypeDeclHandler, parser.EntityDeclHandler = refuse, refuse
    parser.StartElementHandler, parser.CharacterDataHandler, parser.EndElementHandler = start, text, end
    try:
        parser.Parse(xml, True)
    except expat.ExpatError as error:
        raise InputError(Fault("main.xml", f"is not valid XML: {error}", file)) from None
    return texts
