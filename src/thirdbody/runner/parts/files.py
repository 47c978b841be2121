"""Files of a run in parts: its job, and per part its state at each output, its checkpoint, its time, and why it failed.

They lie in the folder `parts` of the run, which all processes must see, and are removed once the run is done. Every file is
replaced as a whole.
"""

from __future__ import annotations

import json
import os
import shutil
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from thirdbody.atomic_files import write_whole
from thirdbody.engine.snapshot import Snapshot
from thirdbody.errors import OutputError

FOLDER = "parts"
JOB, HALT, BEAT = "job.json", "halt", "beat"
"""In that folder: what is computed; tells the parts to stop; changes every few seconds while the run that joins them is alive."""

FAILED, TIME = "failed.json", "time"
"""In the folder of a part: why it cannot go on; the time [s] it has reached."""

SPARSE = ("slots_H", "slots_R")
"""Arrays of which only the rows that are not zero are stored: most candidates are open."""

NOTES = "notes"


@dataclass(frozen=True)
class Job:
    """Scene (text, and folder of the files it names), plug-ins, and number of parts; `prints`: fingerprints of its inputs."""

    scene: str
    folder: str
    plugins: list[str]
    force: bool
    parts: int
    prints: dict[str, str]


def parts_folder(run: Path) -> Path:
    """Return the folder of the parts of a run."""
    return run / FOLDER


def part_folder(folder: Path, number: int) -> Path:
    """Return the folder of one part, in the folder of all."""
    return folder / f"part_{number:04d}"


def write_job(folder: Path, job: Job) -> None:
    """Write the job into a new folder of parts; an older one is removed. Raises OutputError."""
    remove_parts(folder)
    try:
        folder.mkdir()
        write_whole(folder / JOB, json.dumps(asdict(job)).encode())
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror or error})") from error


def read_job(folder: Path) -> Job | None:
    """Return the job in a folder of parts; None without one."""
    try:
        return Job(**json.loads((folder / JOB).read_bytes()))
    except (OSError, ValueError, TypeError):
        return None


def remove_parts(folder: Path) -> None:
    """Remove a folder of parts."""
    if folder.is_dir() and not folder.is_symlink():
        shutil.rmtree(folder, ignore_errors=True)


def state_file(folder: Path, stop: int) -> Path:
    """Return the file of a part's state at a stop of the run (`runner.output_schedule`)."""
    return folder / f"state_{stop:07d}.npz"


def write_state(folder: Path, stop: int, captured: Snapshot) -> None:
    """Write the state of a part at a stop. Raises OutputError."""
    arrays = dict(captured.arrays)
    for name in SPARSE:
        rows = arrays.pop(name)
        used = np.flatnonzero(rows.any(axis=1))
        arrays |= {f"{name}_shape": np.array(rows.shape), f"{name}_rows": used, f"{name}_used": rows[used]}
    arrays[NOTES] = np.frombuffer(json.dumps(captured.notes).encode(), np.uint8)
    path = state_file(folder, stop)
    beside = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with open(beside, "wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        os.replace(beside, path)
    except OSError as error:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error


def read_state(folder: Path, stop: int) -> Snapshot:
    """Return the state of a part at a stop."""
    with np.load(state_file(folder, stop)) as archive:
        arrays = dict(archive)
    notes = json.loads(arrays.pop(NOTES).tobytes())
    for name in SPARSE:
        rows = np.zeros(tuple(arrays.pop(f"{name}_shape")))
        rows[arrays.pop(f"{name}_rows")] = arrays.pop(f"{name}_used")
        arrays[name] = rows
    return Snapshot(arrays, notes)


def remove_states(folder: Path, until: int) -> None:
    """Remove the states of a part up to a stop."""
    last = state_file(folder, until).name
    for path in folder.glob("state_*.npz"):
        if path.name <= last:
            with suppress(OSError):
                path.unlink()
