"""Export for `thirdbody export`: every target is checked before the first one is written."""

from collections.abc import Iterator
from pathlib import Path

from thirdbody.atomic_files import refuse_existing_folder
from thirdbody.errors import InputError, UsageError
from thirdbody.export.compress import pack_run, refuse_target
from thirdbody.export.csv_tables import CSV_FILES, export_csv
from thirdbody.export.pvd import PVD_PATTERNS, export_pvd
from thirdbody.trajectory.reader import Run, open_run


def export_run(
    path: Path, csv: Path | None, pvd: Path | None, pack: Path | None, frame: int | None = None, overwrite: bool = False
) -> Iterator[Path]:
    """Write tables, PVD files and a compressed copy as requested; yield each file when it is complete.

    Raises UsageError when no target is given, InputError (run, frame), OutputError.
    """
    if csv is pvd is pack is None:
        command = ": --csv DIR, --pvd DIR, --pack FILE"
        raise UsageError("export: say what to write", python=": csv=..., pvd=... or pack=...", command=command)
    if frame is not None and csv is pvd is None:
        raise UsageError("export: one frame goes with CSV or PVD; a packed run has all frames")
    with open_run(path) as run:
        _check(run, csv, pvd, pack, frame, overwrite)
        if csv is not None:
            yield from export_csv(run, csv, frame, overwrite)
        if pvd is not None:
            yield from export_pvd(run, pvd, frame, overwrite)
        if pack is not None:
            pack_run(run, pack, overwrite)
            yield pack


def _check(run: Run, csv: Path | None, pvd: Path | None, pack: Path | None, frame: int | None, overwrite: bool) -> None:
    if csv is not None or pvd is not None:
        try:
            run.frame_number(-1 if frame is None else frame)
        except IndexError as error:
            raise InputError(str(error)) from None
    for folder, ours in ((csv, CSV_FILES), (pvd, PVD_PATTERNS)):
        if folder is not None:
            refuse_existing_folder(folder, overwrite, ours)
    if pack is not None:
        refuse_target(run, pack, overwrite)
