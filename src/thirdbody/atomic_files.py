"""Atomic writing of files and folders: written under a temporary name in the same folder, then renamed."""

import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from thirdbody.errors import OutputError


def refuse_existing_folder(path: Path, overwrite: bool, ours: Collection[str]) -> None:
    """Raise OutputError if `path` exists, unless it is a folder that contains only `ours` and may be replaced.

    `ours` are patterns of paths relative to the folder, such as "spheres/*.vtp".
    """
    if not os.path.lexists(path):
        return
    if not overwrite:
        raise OutputError(f"{path}: exists already", python="; overwrite=True replaces it", command="; --overwrite replaces it")
    if os.path.islink(path) or not os.path.isdir(path):
        raise OutputError(f"{path}: is not a folder and will not be overwritten")
    _refuse_other_files(path, ours, path)


def _refuse_other_files(folder: Path, ours: Collection[str], named: Path) -> None:
    """Raise OutputError, with the name `named`, for a folder that contains other files or folders, or links."""
    ours_folders, others = {parent.as_posix() for pattern in ours for parent in PurePosixPath(pattern).parents}, []
    for above, folders, files in os.walk(folder):
        inside = Path(above).relative_to(folder)
        for name in [*folders, *files]:
            path = (inside / name).as_posix()
            known = any(fnmatchcase(path, pattern) for pattern in (ours_folders if name in folders else ours))
            if not known or os.path.islink(folder / path):
                others.append(path)
        folders[:] = [name for name in folders if (inside / name).as_posix() not in others]
    if others:
        raise OutputError(f"{named}: holds other files ({', '.join(sorted(others)[:3])}) and will not be overwritten")


@contextmanager
def new_folder(path: Path, overwrite: bool, ours: Collection[str]) -> Iterator[Path]:
    """Yield a folder to write into, renamed to `path` on success. Raises OutputError and then leaves `path` unchanged.

    `ours` are patterns of everything that may be written; a folder with other content is never replaced.
    """
    refuse_existing_folder(path, overwrite, ours)
    part = _beside(path, "part")
    try:
        part.mkdir()
        yield part
        if not os.path.lexists(path):
            part.rename(path)
            return
        old = _beside(path, "old")
        path.rename(old)
        try:
            _refuse_other_files(old, ours, path)  # they may have appeared since the first check
            part.rename(path)
        except (OSError, OutputError):
            old.rename(path)
            raise
        shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)
        raise OutputError(f"{path}: cannot be written ({reason}); nothing was changed there") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _beside(path: Path, suffix: str) -> Path:
    """Return a name for this process in the folder of `path`; the suffix comes last, so that no reader opens it as a result."""
    full = Path(os.path.abspath(path))  # `.` has no name
    return full.with_name(f".{full.name}.{os.getpid()}.{suffix}")


def write_output(path: Path, content: bytes) -> None:
    """Write a file atomically. Raises OutputError when it cannot be written."""
    try:
        write_whole(path, content)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """Yield a file to write and read, renamed to `path` on success; it replaces a link too. Raises OSError; then `path` stays."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        beside.unlink(missing_ok=True)
        with open(beside, "x+b") as file:  # a new file: never the target of a link
            yield file
        os.replace(beside, path)
    finally:
        with suppress(OSError):  # a read-only folder refuses that too
            beside.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file atomically. Raises OSError when it cannot be written."""
    with new_file(path) as file:
        file.write(content)
