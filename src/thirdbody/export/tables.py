"""Export of a run, and its tables as CSV: comma, UTF-8, units in the header (`time [s]`), every digit of every number.

Names come from users and from runs of other people: one that begins like a formula gets an apostrophe in front.
"""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from thirdbody.atomic_files import new_folder, refuse_existing_folder
from thirdbody.errors import UsageError, printable
from thirdbody.export.vtk import PVD_PATTERNS, export_pvd
from thirdbody.trajectory.columns import TABLES, Column, table_parts, tables_of
from thirdbody.trajectory.run_file import RunFile

CSV_FILES = tuple(f"{name}.csv" for name in TABLES)
FORMULA = ("=", "+", "-", "@")
"""First characters of a cell that spreadsheets evaluate instead of showing it."""


def export_csv(run: RunFile, folder: Path, frame: int | None = None, overwrite: bool = False) -> list[Path]:
    """Write series, profiles, bodies, contacts, cycles, transitions and statistics of maps into a new folder; return the files.

    Profiles, bodies and contacts of one frame, or of all. Without states in the run there is no file of transitions, without a
    stroke none of cycles, without profiles, contacts or maps none of them. Raises IndexError for a frame outside the run,
    OutputError; then nothing is written.
    """
    run.frame_number(-1 if frame is None else frame)
    written = []
    with new_folder(folder, overwrite, CSV_FILES) as part:
        for name in tables_of(run):
            with open(part / f"{name}.csv", "w", encoding="utf-8", newline="") as text:
                writer = csv.writer(text, lineterminator="\n")
                for number, columns in enumerate(table_parts(run, name, frame)):
                    if not number:
                        writer.writerow([heading(column) for column in columns])
                    writer.writerows(zip(*map(_cells, columns), strict=True))
            written.append(folder / f"{name}.csv")
    return written


def _cells(column: Column) -> list[Any]:
    """Return Python numbers, whose `repr` restores the same bits, and texts that no spreadsheet evaluates."""
    values = column.values.tolist()
    return [as_text(value) if isinstance(value, str) else value for value in values] if column.values.dtype == object else values


def as_text(text: str) -> str:
    """Return a text that spreadsheets show in one cell: an apostrophe precedes texts that look like a formula.

    Line breaks and other control characters are written out: a carriage return would begin a row.
    """
    return f"'{printable(text)}" if text.startswith(FORMULA) else printable(text)


def heading(column: Column) -> str:
    """Return the header `time [s]`; products of units with a blank, as spreadsheets may not read a raised dot."""
    name = as_text(column.name)
    return f"{name} [{column.unit.replace('·', ' ')}]" if column.unit else name


def export_run(
    path: Path, csv: Path | None, pvd: Path | None, frame: int | None = None, overwrite: bool = False
) -> Iterator[Path]:
    """Write tables and PVD files as requested, after a check of every target; yield each file when it is complete.

    Raises UsageError when no target is given, InputError (run, frame), OutputError.
    """
    if csv is pvd is None:
        raise UsageError("export: say what to write", python=": csv=... or pvd=...", command=": --csv DIR, --pvd DIR")
    with RunFile(path) as run:
        run.frame_number(-1 if frame is None else frame)
        for folder, ours in ((csv, CSV_FILES), (pvd, PVD_PATTERNS)):
            if folder is not None:
                refuse_existing_folder(folder, overwrite, ours)
        if csv is not None:
            yield from export_csv(run, csv, frame, overwrite)
        if pvd is not None:
            yield from export_pvd(run, pvd, frame, overwrite)
