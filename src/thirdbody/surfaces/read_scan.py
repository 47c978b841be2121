"""Reading a measured height map by the suffix of its file."""

from __future__ import annotations

from pathlib import Path

from thirdbody.bodies.bounded_read import read_bytes
from thirdbody.errors import Fault, InputError
from thirdbody.surfaces.height_map import HeightMap
from thirdbody.surfaces.npz_scan import npz_map
from thirdbody.surfaces.x3p import x3p_map

READERS = {".npz": npz_map, ".x3p": x3p_map}
"""Readers by suffix."""


def read_scan(path: Path, key: str = "") -> HeightMap:
    """Return the height map of a file. Raises InputError; `key` is that of the scene which names the file."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        known = " or ".join(READERS)
        hint = "`thirdbody surface FILE -o scan.npz` converts other formats"
        raise InputError(Fault(key, f"has the suffix '{path.suffix}', expected {known}; {hint}", str(path)))
    return reader(str(path), read_bytes(path, key))
