"""Files that the user names: their bytes, or one clear fault; and the range in which bodies can be computed."""

from __future__ import annotations

from pathlib import Path

from thirdbody.errors import Fault, InputError

SMALLEST, LARGEST = 1e-30, 1e30
"""Lengths (m) whose fifth powers, and the squares of these, are normal numbers: others come from wrong units only."""


def read_bytes(path: Path, key: str = "") -> bytes:
    """What the file holds. InputError: one fault with the path, if it is missing, no file, or may not be read."""
    try:
        if path.is_file():
            return path.read_bytes()
        folder, there = path.is_dir(), path.exists()
    except OSError as error:
        file = str(path) if len(str(path)) < 200 else f"{str(path)[:200]}..."
        raise InputError(Fault(key, f"cannot be read: {error.strerror}", file)) from None
    if folder or there:
        raise InputError(Fault(key, f"is {'a folder' if folder else 'a device'}, expected a file", str(path)))
    message = "there is no such file; give the path from the folder of the scene, or an absolute one"
    raise InputError(Fault(key, message, str(path)))
