"""The folder of a run: the files written there, its log, and the replacement of an older run by a new one.

Only these files are ever replaced or deleted. A new run that replaces an older one writes into a folder inside that of the run
(`REPLACEMENT`); its files replace the old ones once its first frame is on the disk. So they stay on one file system, and the
folder itself stays the same: it may be the current folder, or a mount point.
"""

import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

from thirdbody.atomic_files import write_whole
from thirdbody.errors import Fault, InputError, OutputError, printable
from thirdbody.export.paraview import SCRIPT_NAME
from thirdbody.runner.checkpoint import FILE as CHECKPOINT
from thirdbody.trajectory.names import BLOCKS
from thirdbody.trajectory.open_file import FILE_NAME

SCENE_FILE, LOG = "scene.toml", "run.log"

REPLACEMENT = ".replacement"

SIDECARS = tuple(f"{Path(FILE_NAME).stem}.{block}.vtkhdf" for block in BLOCKS)

FILES = (CHECKPOINT, FILE_NAME, SCENE_FILE, SCRIPT_NAME, *SIDECARS, LOG)
"""Files that a run leaves in its folder, in the order in which those of a replacement are renamed."""

PARTS = re.compile("|".join([rf"({re.escape(CHECKPOINT)}|{re.escape(FILE_NAME)})\.part",
                             rf"\.({'|'.join(map(re.escape, FILES))})\.\d+\.part"]))  # fmt: skip
"""Further files that a killed run may leave: those that were being written."""

NAMED = 5
"""Largest number of other files that a message names."""


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Lock a folder while it is written to; the system releases it however the process ends, `kill -9` included.

    Raises OutputError if another process holds the lock. Where the system cannot lock a folder nothing is locked.
    """
    try:
        import fcntl

        handle = os.open(folder, os.O_RDONLY)
    except (ImportError, OSError):
        yield
        return
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(f"{folder}: another process is writing this run") from None
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        os.close(handle)


class RunFolder:
    """Folder of a run: `path`, and `work_folder` for files being written: the same folder or one inside it."""

    def __init__(self, path: Path, work_folder: Path | None = None, usable: bool = True) -> None:
        self.path, self.work_folder, self.usable = path, work_folder or path, usable
        self._identity = _identity(path)

    def is_there(self) -> bool:
        """Return whether the folder still exists under its name."""
        return _identity(self.path) == self._identity

    def check(self) -> None:
        """Raise OutputError if the folder was replaced or removed: nothing may be written there then."""
        if not self.is_there():
            raise OutputError(
                f"{self.path}: the folder was moved or removed while the run wrote into it, so the run cannot go on; "
                "where it was moved to it can be resumed"
            )

    def log(self, text: str) -> None:
        """Append a line with the local time to the log, unless the folder was moved or removed. Raises OSError."""
        path = self.work_folder / LOG
        if not self.is_there():
            return
        if path.exists() and os.stat(path).st_nlink > 1:
            write_whole(path, path.read_bytes())  # another file from here on: what it was linked to stays
        with open(path, "a", encoding="utf-8") as file:
            file.write(f"{datetime.now().isoformat(' ', 'seconds')}  {printable(text)}\n")

    def publish(self) -> None:
        """Replace the files of an older run, once the new ones can be used. Raises OutputError.

        A kill between any two renames leaves either run usable: the older scene goes first, which its checkpoint does not need;
        the new checkpoint, from before the first frame, needs no trajectory.
        """
        self.check()
        work_folder, self.work_folder, self.usable = self.work_folder, self.path, True
        if work_folder == self.path:
            return
        try:
            (self.path / SCENE_FILE).unlink(missing_ok=True)
            for name in FILES:
                os.replace(work_folder / name, self.path / name)
            _remove_leftovers(self.path)
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be replaced ({error.strerror or error})") from error


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        result = os.stat(path)
    except OSError:
        return None
    return result.st_dev, result.st_ino


@contextmanager
def new_run_folder(path: Path, overwrite: bool) -> Iterator[RunFolder]:
    """Yield the folder for a new run, created and locked; removed again if the run is not usable.

    Raises OutputError if it exists (unless it holds a run and nothing else, and may be overwritten), cannot be created or is
    being written.
    """
    refuse_existing(path, overwrite)
    new = [folder for folder in (path, *path.absolute().parents) if not os.path.exists(folder)]
    try:
        if new:
            make_folder(path)
        with lock_folder(path):
            _remove_leftovers(path)
            replaced = any((path / name).exists() for name in FILES)
            files = RunFolder(path, path / REPLACEMENT if replaced else path, usable=False)
            if replaced:
                make_folder(files.work_folder)
            try:
                yield files
            except OutputError as error:
                if replaced and not files.usable:
                    raise OutputError(f"{error.message}; the run that is there stays as it is") from error
                raise
            finally:
                if not files.usable and files.is_there():
                    _remove(files.work_folder, (*FILES, *_parts(files.work_folder)))
                    _remove_leftovers(path)
    finally:
        for folder in new:  # from the innermost outwards; one that is not empty stays
            with suppress(OSError):
                folder.rmdir()


def make_folder(folder: Path, exist_ok: bool = False) -> None:
    """Make a folder and those above it; `exist_ok`: it may be there. Raises OutputError."""
    try:
        folder.mkdir(parents=True, exist_ok=exist_ok)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror or error})") from error


@contextmanager
def old_run_folder(path: Path) -> Iterator[RunFolder]:
    """Yield the folder of a run to continue, locked. Raises OutputError if it is being written."""
    with lock_folder(path):
        _remove_leftovers(path)
        yield RunFolder(path)


def _remove_leftovers(path: Path) -> None:
    _remove(path, _parts(path))
    inner = path / REPLACEMENT
    if inner.is_dir() and not inner.is_symlink():
        _remove(inner, (*FILES, *_parts(inner)))
        with suppress(OSError):
            inner.rmdir()


def _remove(folder: Path, names: tuple[str, ...]) -> None:
    for name in names:
        with suppress(OSError):  # a disk that failed, or a folder that was moved
            (folder / name).unlink(missing_ok=True)


def _parts(folder: Path) -> tuple[str, ...]:
    with suppress(OSError):
        return tuple(name for name in os.listdir(folder) if PARTS.fullmatch(name))
    return ()


def refuse_existing(folder: Path, overwrite: bool) -> None:
    """Raise OutputError if the folder exists, unless empty or that of a run that may be overwritten, or cannot be created."""
    try:
        os.lstat(folder)  # even a link to nothing exists
    except (FileNotFoundError, NotADirectoryError):
        above = next((path for path in folder.absolute().parents if os.path.exists(path)), None)
        _refuse_read_only(folder, above, "made")
        return
    except (OSError, ValueError) as error:  # a name that the system refuses
        raise OutputError(f"{folder}: cannot be made ({getattr(error, 'strerror', None) or error})") from error
    if not overwrite and not (folder.is_dir() and not folder.is_symlink() and not _names(folder)):
        raise OutputError(
            f"{folder}: exists already",
            python="; overwrite=True replaces it, out=... names another folder",
            command="; --overwrite replaces it, -o names another folder",
        )
    if not folder.is_dir():
        raise OutputError(f"{folder}: is not the folder of a run and will not be overwritten")
    names = _names(folder)
    others = [name for name in names if not (_is_ours(folder / name) or (name == REPLACEMENT and _is_run_only(folder / name)))]
    run = FILE_NAME in names or CHECKPOINT in names
    if others:
        what = "holds other files" if run else "is not the folder of a run: it holds other files"
        more = f" and {len(others) - NAMED} more" if len(others) > NAMED else ""
        raise OutputError(f"{folder}: {what} ({', '.join(others[:NAMED])}{more}) and will not be overwritten")
    if not run and set(names) & set(FILES):
        raise OutputError(f"{folder}: is not the folder of a run: it has no {FILE_NAME}; it will not be overwritten")
    _refuse_read_only(folder, folder, "replaced")


def _names(folder: Path) -> list[str]:
    try:
        return sorted(os.listdir(folder))
    except OSError as error:
        raise OutputError(f"{folder}: cannot be read ({error.strerror or error})") from error


def _is_ours(path: Path) -> bool:
    return bool(path.name in FILES or PARTS.fullmatch(path.name)) and _is_plain(path)


def _is_run_only(folder: Path) -> bool:
    try:
        return not folder.is_symlink() and all(_is_ours(folder / name) for name in os.listdir(folder))
    except FileNotFoundError:  # another process has removed it since it was listed
        return True
    except OSError:
        return False


def _is_plain(path: Path) -> bool:
    """Return whether it is a file and no link, or no longer exists, as files of an active run may."""
    try:
        return stat.S_ISREG(os.lstat(path).st_mode)
    except FileNotFoundError:
        return True


def _refuse_read_only(folder: Path, where: Path | None, verb: str) -> None:
    if where is None or not where.is_dir():
        raise OutputError(f"{folder}: cannot be {verb}: {where} is not a folder")
    if not os.access(where, os.W_OK | os.X_OK):
        raise OutputError(f"{folder}: cannot be {verb}: {where} is read-only for you")


def refuse_links(folder: Path) -> None:
    """Raise InputError where a file of a run is a link, folder or device: writing would go elsewhere."""
    faults = []
    for name in _names(folder):
        path = folder / name
        if (name in FILES or PARTS.fullmatch(name)) and not _is_plain(path):
            kind = "a symbolic link" if path.is_symlink() else "a folder" if path.is_dir() else "no regular file"
            faults.append(Fault("", f"is {kind}; a run goes on only in regular files of its own", str(path)))
    if faults:
        raise InputError(faults)
