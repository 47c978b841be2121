"""Files of the user, read with bounds: whole files, lines of CSV tables, members of ZIP archives, arrays of NPZ files.

Damage is one clear fault.
"""

import csv
import io
import os
import stat
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from math import prod

import numpy as np

from thirdbody.errors import Fault, InputError, nearest

# Range of lengths [m] whose 5th and 10th powers are normal numbers: others come from wrong units only.
SMALLEST, LARGEST = 1e-30, 1e30
# Bytes of the largest file: ten million triangles. A larger one is refused before it is read.
MAX_BYTES = 500_000_000
# Most spheres in one table of bodies: a minute and 3 GB for as many bodies, three times the memory for text.
MAX_ROWS = 1_000_000
# Faults that are listed individually; the others are counted, since a wrong unit or a shifted column spoils every row.
SHOWN = 10
# What damage of an archive makes zipfile and numpy raise.
_DAMAGE = (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, SyntaxError, OverflowError,
           zipfile.BadZipFile, zlib.error)  # fmt: skip


def refuse(faults: Iterable[Fault], total: int | None = None) -> None:
    """Raise InputError with the first faults and the number of the others, if there are any.

    `total` is the number of all faults, when `faults` are not all.
    """
    faults = list(faults)
    if not faults:
        return
    more = (len(faults) if total is None else total) - SHOWN
    summary = [Fault("", f"and {more} more fault{'s' if more > 1 else ''}", faults[0].file)] if more > 0 else []
    raise InputError(faults[:SHOWN] + summary)


def read_bytes(path: str | os.PathLike[str], key: str = "", what: str = "file", largest: int = MAX_BYTES) -> bytes:
    """Return the bytes of a file. InputError: one fault with the path, if it is missing, no file, too large, or not readable."""
    try:
        info = os.stat(path)
        if stat.S_ISDIR(info.st_mode):
            reason = f"is a folder, expected a {what}"
        elif not stat.S_ISREG(info.st_mode):  # a pipe without a writer would block forever
            reason = f"is a device, expected a {what}"
        elif info.st_size > largest:
            reason = f"has {info.st_size / 1e6:.1f} MB, at most {largest / 1e6:.0f} MB are read"
        else:
            with open(path, "rb") as file:
                return file.read()
    except (FileNotFoundError, NotADirectoryError):
        hints = {"file": "; give the path from the folder of the scene, or an absolute one",
                 "scene file": "; `thirdbody new --list` shows the scenes to copy"}  # fmt: skip
        reason = f"no such file{hints.get(what, '')}"
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        reason = f"cannot be read: {getattr(error, 'strerror', error)}"
    name = os.fspath(path)
    raise InputError(Fault(key, reason, name if len(name) < 200 else f"{name[:200]}..."))


def csv_lines(file: str, data: bytes) -> list[tuple[int, list[str]]]:
    """Return number and cells of each line of a CSV table that is not blank. InputError: one fault of the `file`."""
    if b"\0" in data[:4096]:
        wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
        what = "is UTF-16 text; save it as UTF-8" if wide else "holds binary data, not the text of a CSV table"
        raise InputError(Fault("", what, file))
    try:
        text = data.decode("utf-8-sig")  # spreadsheets begin their UTF-8 with a byte order mark
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        message = f"byte 0x{data[error.start]:02x} is not UTF-8 text; save the table as CSV in UTF-8"
        raise InputError(Fault("", message, file, line)) from None
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        return [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise InputError(Fault("", f"is no CSV table from here on ({error})", file, reader.line_num)) from None


@contextmanager
def opened_archive(file: str, data: bytes) -> Iterator[zipfile.ZipFile]:
    """Open the ZIP archive in the bytes of a file; any error of reading it becomes one fault of the file."""
    if not data:
        raise InputError(Fault("", "is empty", file))
    if not data.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        raise InputError(Fault("", "is no ZIP archive, which NPZ and X3P files are", file))
    try:
        yield zipfile.ZipFile(io.BytesIO(data))
    except InputError:
        raise
    except MemoryError:
        raise InputError(Fault("", "does not fit into memory", file)) from None
    except _DAMAGE as error:
        reason = f"{type(error).__name__}: {error}".strip().splitlines()[0][:120]
        raise InputError(Fault("", f"is damaged or cut short ({reason}); write it again", file)) from None


def member(file: str, archive: zipfile.ZipFile, name: str) -> bytes:
    """Return the bytes of one member. Raises InputError when it is missing or too large."""
    try:
        entry = archive.getinfo(name)
    except KeyError:
        raise InputError(Fault(name, "is missing in the archive", file)) from None
    if entry.file_size > MAX_BYTES:
        size = f"has {entry.file_size / 1e6:.3g} MB unpacked, at most {MAX_BYTES / 1e6:.3g} MB are read"
        raise InputError(Fault(name, size, file))
    return archive.read(entry)


def npz_arrays(file: str, data: bytes, needed: Sequence[str], optional: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the arrays in the bytes of an NPZ file; `file` is its name in messages. Pickles are never loaded.

    InputError with all faults of the names, else for the first array that is damaged.
    """
    with opened_archive(file, data) as archive:
        names = [name.removesuffix(".npy") for name in archive.namelist()]
        known = (*needed, *optional)
        faults = [Fault(name, f"unknown array, {nearest(name, known)}", file) for name in names if name not in known]
        lacking = [name for name in needed if name not in names]
        if lacking and not faults:  # an unknown name may be the one that is missing
            faults = [Fault(", ".join(lacking), f"is missing, expected {', '.join(needed)}", file)]
        refuse(faults)
        return {name: _array(file, name, member(file, archive, f"{name}.npy")) for name in names}


def _array(file: str, name: str, data: bytes) -> np.ndarray:
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
    except ValueError:
        raise InputError(Fault(name, "is no array of numbers", file)) from None
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    if dtype.hasobject:
        raise InputError(Fault(name, "holds Python objects (a pickle), which are never loaded", file))
    if len(data) - stream.tell() != prod(shape) * dtype.itemsize:  # before it is allocated
        message = f"is damaged or cut short: {prod(shape)} values were announced; write the file again"
        raise InputError(Fault(name, message, file))
    stream.seek(0)
    return np.lib.format.read_array(stream, allow_pickle=False)


def is_number(text: str) -> bool:
    """Return whether Python reads the text as a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True
