"""Folder of a study: its files, and the replacement of an older study.

Nothing else is ever replaced or deleted. A study that is to replace an older one is created in a new folder inside that folder,
and replaces it when it is complete.
"""

import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from thirdbody.errors import OutputError
from thirdbody.runner.run_folder import FILES, NAMED, PARTS, REPLACEMENT, lock_folder
from thirdbody.studies.worker_process import RUNS, SCENE_FILE

RESULTS = ("cost.json", "cost.png", "cost.pdf", "effects.json", "effects.png", "effects.pdf")
REPLACED = "replaced"
"""Temporary folder of the old runs, next to the new ones."""

_RUN_FILE = rf"({'|'.join(map(re.escape, FILES))}|{PARTS.pattern})"
_OURS = re.compile(
    rf"(({re.escape(REPLACEMENT)}/)?({'|'.join(map(re.escape, (SCENE_FILE, *RESULTS)))}|({RUNS}|{REPLACED})/(.*/)?{_RUN_FILE}))"
)
_OUR_FOLDERS = re.compile(rf"({re.escape(REPLACEMENT)}|({re.escape(REPLACEMENT)}/)?({RUNS}|{REPLACED})(/.*)?)")


@contextmanager
def new_study_folder(folder: Path, overwrite: bool) -> Iterator[Path]:
    """Yield the folder in which to create the study that becomes `folder`; an existing one stays until the new one is complete.

    Raises OutputError if the folder exists, unless it is that of a study, with nothing else in it, and may be overwritten.
    """
    refuse_existing_study(folder, overwrite)
    if not os.path.lexists(folder) or not os.listdir(folder):
        yield folder
        return
    with lock_folder(folder):
        work_folder = folder / REPLACEMENT
        _remove(folder, work_folder)
        try:
            with _disk_faults(folder):
                work_folder.mkdir()
            yield work_folder
            with _disk_faults(folder):
                _replace_study(work_folder, folder)
        finally:
            _remove(folder, work_folder)


@contextmanager
def _disk_faults(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"{folder}: cannot be replaced ({error.strerror or error})") from error


def refuse_existing_study(folder: Path, overwrite: bool) -> None:
    """Raise OutputError for a folder that exists, unless it is that of a study, holds nothing else, and may be overwritten."""
    if not os.path.lexists(folder):  # False also for a name that the system refuses: creating the folder gives the reason
        return
    if not overwrite:
        raise OutputError(f"{folder}: exists already; --overwrite replaces it, -o names another folder")
    if not folder.is_dir():
        raise OutputError(f"{folder}: is not the folder of a study and will not be overwritten")
    with _disk_faults(folder):
        names, others = os.listdir(folder), _other_files(folder)
    if others:
        more = f" and {len(others) - NAMED} more" if len(others) > NAMED else ""
        named = ", ".join(others[:NAMED]) + more
        raise OutputError(f"{folder}: holds other files than those of a study ({named}) and will not be overwritten")
    if names and not {RUNS, REPLACEMENT, *RESULTS} & set(names):
        raise OutputError(f"{folder}: is not the folder of a study (it has no {RUNS}) and will not be overwritten")


def _other_files(folder: Path) -> list[str]:
    """Return paths, relative to `folder`, of everything that no study writes: other names, and links."""
    others = []
    for above, folders, files in os.walk(folder):
        for name in sorted([*folders, *files]):
            path = Path(above, name)
            known, relative = _OUR_FOLDERS if name in folders else _OURS, path.relative_to(folder).as_posix()
            if not known.fullmatch(relative) or not _is_plain(path):
                others.append(relative)
                if name in folders:
                    folders.remove(name)  # named as a whole
    return others


def _is_plain(path: Path) -> bool:
    """Return whether a path is a file or a folder, not a link."""
    mode = os.lstat(path).st_mode
    return stat.S_ISREG(mode) or stat.S_ISDIR(mode)


def _replace_study(work_folder: Path, folder: Path) -> None:
    """Replace the older study by a complete one. Raises OSError."""
    for name in (SCENE_FILE, *RESULTS):
        if os.path.lexists(work_folder / name):
            os.replace(work_folder / name, folder / name)
        else:
            (folder / name).unlink(missing_ok=True)
    if os.path.lexists(folder / RUNS):
        os.rename(folder / RUNS, work_folder / REPLACED)
    if os.path.lexists(work_folder / RUNS):
        os.rename(work_folder / RUNS, folder / RUNS)


def _remove(folder: Path, work_folder: Path) -> None:
    """Remove the files that a study writes from `work_folder` within its folder, and folders that are then empty."""
    for above, _, files in os.walk(work_folder, topdown=False):
        for name in files:
            path = Path(above, name)
            if _OURS.fullmatch(path.relative_to(folder).as_posix()):
                with suppress(OSError):
                    path.unlink()
        with suppress(OSError):
            os.rmdir(above)
