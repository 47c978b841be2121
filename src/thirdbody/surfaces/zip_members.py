"""Members of a ZIP archive in memory: damage is one clear fault."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager

from thirdbody.bodies.bounded_read import MAX_BYTES
from thirdbody.errors import Fault, InputError

DAMAGE = (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, SyntaxError, OverflowError,
          zipfile.BadZipFile, zlib.error)  # fmt: skip
"""What damage of an archive makes zipfile and numpy raise."""


@contextmanager
def damage_reported(file: str) -> Iterator[None]:
    """Turn any error of reading a damaged archive into one fault of the file."""
    try:
        yield
    except InputError:
        raise
    except MemoryError:
        raise InputError(Fault("", "does not fit into memory", file)) from None
    except DAMAGE as error:
        reason = f"{type(error).__name__}: {error}".strip().splitlines()[0][:120]
        raise InputError(Fault("", f"is damaged or cut short ({reason}); write it again", file)) from None


def opened_archive(file: str, data: bytes) -> zipfile.ZipFile:
    """Return the archive in the bytes of a file. Raises InputError."""
    if not data:
        raise InputError(Fault("", "is empty", file))
    if not data.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        raise InputError(Fault("", "is no ZIP archive, which NPZ and X3P files are", file))
    return zipfile.ZipFile(io.BytesIO(data))


def member(file: str, archive: zipfile.ZipFile, name: str) -> bytes:
    """Return the bytes of one member. Raises InputError when it is missing, too large or damaged."""
    try:
        entry = archive.getinfo(name)
    except KeyError:
        raise InputError(Fault(name, "is missing in the archive", file)) from None
    if entry.file_size > MAX_BYTES:
        size = f"has {entry.file_size / 1e6:.3g} MB unpacked, at most {MAX_BYTES / 1e6:.3g} MB are read"
        raise InputError(Fault(name, size, file))
    with damage_reported(file):
        return archive.read(entry)
