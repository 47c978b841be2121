"""Export for `thirdbody export`: every target is checked before the first one is written."""

from collections.abc import Iterator
from pathlib import Path

from thirdbody.atomic_files import refuse_existing_folder
from thirdbody.errors import InputError, UsageError
from thirdbody.export.csv_tables import CSV_FILES, export_csv
from thirdbody.export.pvd import PVD_PATTERNS, export_pvd
from thirdbody.trajectory.reader import open_run


def export_run(
    path: Path, csv: Path | None, pvd: Path | None, frame: int | None = None, overwrite: bool = False
) -> Iterator[Path]:
    """Write tables and PVD files as requested; yield each file when it is complete.

    Raises UsageError when no target is given, InputError (run, frame), OutputError.
    """
    if csv is pvd is None:
        raise UsageError("export: say what to write", python=": csv=... or pvd=...", command=": --csv DIR, --pvd DIR")
    with open_run(path) as run:
        try:
            run.frame_number(-1 if frame is None else frame)
        except IndexError as error:
            raise InputError(str(error)) from None
        for folder, ours in ((csv, CSV_FILES), (pvd, PVD_PATTERNS)):
            if folder is not None:
                refuse_existing_folder(folder, overwrite, ours)
        if csv is not None:
            yield from export_csv(run, csv, frame, overwrite)
        if pvd is not None:
            yield from export_pvd(run, pvd, frame, overwrite)
