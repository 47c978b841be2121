"""Folder of a study: its plan, its table, its runs; the replacement of an older one.

A sweep has `points.csv`, `scene.toml`, `sweep.json` with all points, and a folder per point; a study of cost its picture and
`cost.json` besides. Nothing else is ever replaced or deleted. A study of cost that is to replace an older one is created in a new
folder inside that folder, and replaces it when it is complete.
"""

from __future__ import annotations

import csv
import io
import json
import os
import re
import stat
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from thirdbody.atomic_files import write_whole
from thirdbody.errors import Fault, InputError, Interrupted, OutputError, ThirdbodyError
from thirdbody.export.tables import as_text
from thirdbody.runner.run_folder import FILES, NAMED, PARTS, REPLACEMENT, lock_folder
from thirdbody.studies.plan import Plan
from thirdbody.studies.point import RESULT_FILE, WAITING, PointResult
from thirdbody.studies.results import result

SWEEP_FILE, SCENE_FILE, TABLE = "sweep.json", "scene.toml", "points.csv"
FORMAT = 1

RUNS, REPLACED = "variants", "replaced"
"""In the folder of a study of cost: the runs of its variants; the old ones while they are replaced."""

RESULTS = ("cost.json", "cost.png", "cost.pdf", "effects.json", "effects.png", "effects.pdf")
"""Files that a study of cost leaves and a sweep does not."""

_WHOLE = (SCENE_FILE, SWEEP_FILE, TABLE, *RESULTS)
_RUN_FILE = rf"({'|'.join(map(re.escape, (*FILES, RESULT_FILE)))}|{PARTS.pattern})"
_OURS = re.compile(rf"(({re.escape(REPLACEMENT)}/)?({'|'.join(map(re.escape, _WHOLE))}|({RUNS}|{REPLACED})/(.*/)?{_RUN_FILE}))")
_OUR_FOLDERS = re.compile(rf"({re.escape(REPLACEMENT)}|({re.escape(REPLACEMENT)}/)?({RUNS}|{REPLACED})(/.*)?)")

FRACTION_OF_TIME = 0.05
"""Largest fraction of the time of a study that writing its table takes: a large one is not replaced after each point."""


class Table:
    """The table of a study, `points.csv`: a row per point from the start on, always replaced as a whole."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        self.plan, self.path = plan, folder / TABLE
        self.rows = [PointResult(point.number, WAITING) for point in plan.points]
        self.counts = {WAITING: len(self.rows)}
        self._written, self._cost = 0.0, 0.0

    def record(self, row: PointResult) -> None:
        """Enter the result of a point, and replace the file unless that was done a moment ago. Raises OutputError."""
        self.enter(row)
        if time.perf_counter() - self._written > self._cost / FRACTION_OF_TIME:
            self.write()

    def enter(self, row: PointResult) -> None:
        """Put the result of a point into its row; `counts` are the numbers of points by status."""
        self.counts[self.rows[row.number].status] -= 1
        self.counts[row.status] = self.counts.get(row.status, 0) + 1
        self.rows[row.number] = row

    def write(self) -> None:
        """Replace the file. Raises OutputError and leaves the one before."""
        began = time.perf_counter()
        try:
            write_whole(self.path, self.text().encode())
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written ({error.strerror or error})") from error
        self._written = time.perf_counter()
        self._cost = self._written - began

    def text(self) -> str:
        """Return the table as CSV; numbers with all their digits, empty cells for what there is not."""
        plan, text = self.plan, io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        axes = [_heading(column.key, column.unit) for column in plan.columns]
        results = [_heading(name, result(name).unit) for name in plan.results]
        writer.writerow(["point", "folder", *axes, "status", "reason", "exit_code", "seconds [s]", *results])
        for point, row in zip(plan.points, self.rows, strict=True):
            values = [column.values[point.number] for column in plan.columns]
            cells = [as_text(value) if isinstance(value, str) else value for value in values]
            code = "" if row.exit_code is None else row.exit_code
            outcome = [row.status, as_text(row.reason), code, row.seconds or ""]
            writer.writerow([point.number, point.folder.name, *cells, *outcome, *(row.results.get(n, "") for n in plan.results)])
        return text.getvalue()


def _heading(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} [{unit}]"


def is_sweep_folder(path: Path) -> bool:
    """Return whether a path is the folder of a sweep, or its table."""
    return os.path.isfile(sweep_folder(path) / SWEEP_FILE)


def sweep_folder(path: Path) -> Path:
    """Return the folder of a sweep, which its table names as well."""
    return path.parent if path.name == TABLE else path


def refuse_existing_sweep(folder: Path) -> None:
    """Raise OutputError for a folder that exists and is not empty."""
    if not os.path.lexists(folder) or (folder.is_dir() and not os.listdir(folder)):
        return
    known = is_sweep_folder(folder)
    raise OutputError(
        f"{folder}: exists already",
        python="; resume=True goes on, out=... names another folder" if known else "; out=... names another folder",
        command="; --resume goes on, -o names another folder" if known else "; -o names another folder",
    )


def save_plan(plan: Plan, folder: Path, more: Mapping[str, Any] | None = None) -> None:
    """Write the plan, and `more` of a study, into the folder of a sweep, which is made. Raises OutputError."""
    point = plan.points[0]
    document = {
        "format": FORMAT,
        "title": plan.title,
        "design": plan.design,
        "lengths": plan.lengths,
        "columns": [{"key": column.key, "unit": column.unit, "axis": column.axis} for column in plan.columns],
        "results": plan.results,
        "keep": point.keep,
        "plugins": [str(file) for file in point.plugins],
        "scene_folder": str(point.scene_folder),
        "points": [
            {"folder": one.folder.name, "settings": settings, "values": [column.values[one.number] for column in plan.columns]}
            for one, settings in zip(plan.points, plan.settings, strict=True)
        ],
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / SCENE_FILE, plan.scene.encode())
        write_whole(folder / SWEEP_FILE, json.dumps(document | dict(more or {})).encode())
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror or error})") from error


def read_document(path: Path) -> dict[str, Any]:
    """Return what `save_plan` wrote. Raises InputError."""
    file = sweep_folder(path) / SWEEP_FILE
    if not os.path.isfile(file):
        raise InputError(f"{path}: no sweep is there (it has no {SWEEP_FILE})")
    try:
        document = json.loads(file.read_bytes())
        if document["format"] != FORMAT:
            raise InputError(Fault("", f"format {document['format']}, this version reads {FORMAT}", str(file)))
    except OSError as error:
        raise InputError(Fault("", f"cannot be read ({error.strerror or error})", str(file))) from error
    except (ValueError, KeyError, TypeError):
        raise InputError(Fault("", "is damaged", str(file))) from None
    return dict(document)


@contextmanager
def new_study_folder(folder: Path, overwrite: bool) -> Iterator[Path]:
    """Yield the folder in which to create the study of cost that becomes `folder`.

    An existing one stays until the new one is complete; of a new one that is refused nothing stays. Raises OutputError if the
    folder exists, unless it is that of a study, with nothing else in it, and may be overwritten.
    """
    _refuse_existing_study(folder, overwrite)
    if not os.path.lexists(folder) or not os.listdir(folder):
        missing = [path for path in (folder, *folder.absolute().parents) if not os.path.lexists(path)]
        try:
            yield folder
        except Interrupted:
            raise
        except ThirdbodyError:
            _remove(folder, folder)
            for path in missing:  # from the innermost outwards; one that is not empty stays
                with suppress(OSError):
                    path.rmdir()
            raise
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


def _refuse_existing_study(folder: Path, overwrite: bool) -> None:
    if not os.path.lexists(folder):  # False also for a name that the system refuses: creating the folder gives the reason
        return
    if not overwrite:
        raise OutputError(f"{folder}: exists already; --overwrite replaces it, --resume goes on, -o names another folder")
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
            mode = os.lstat(path).st_mode
            if not known.fullmatch(relative) or not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                others.append(relative)
                if name in folders:
                    folders.remove(name)  # named as a whole
    return others


def _replace_study(work_folder: Path, folder: Path) -> None:
    for name in _WHOLE:
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
