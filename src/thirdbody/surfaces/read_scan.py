"""Reading a measured height map by the suffix of its file."""

from __future__ import annotations

from pathlib import Path

from thirdbody.bodies.bounded_read import read_bytes
from thirdbody.errors import Fault, InputError
from thirdbody.surfaces.height_map import TEXTS, HeightMap
from thirdbody.surfaces.npz_scan import npz_map
from thirdbody.surfaces.text_map import text_map
from thirdbody.surfaces.x3p import x3p_map

READERS = {".npz": npz_map, ".x3p": x3p_map}
"""Readers by suffix."""


def read_scan(path: Path, key: str = "", unit: float | None = None, spacing: tuple[float, float] | None = None) -> HeightMap:
    """Return the height map of a file. Raises InputError; `key` is that of the scene which names the file.

    unit, spacing: of the heights of a text file, and of its points along x and y [m].
    """
    suffix = path.suffix.lower()
    if suffix in TEXTS and unit is not None and spacing is not None:
        return text_map(str(path), read_bytes(path, key), unit, spacing)
    reader = READERS.get(suffix)
    if reader is None:
        known = " or ".join((*READERS, *TEXTS))
        hint = "`thirdbody surface FILE -o scan.npz` converts other formats"
        raise InputError(Fault(key, f"has the suffix '{path.suffix}', expected {known}; {hint}", str(path)))
    return reader(str(path), read_bytes(path, key))
