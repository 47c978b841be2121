"""A point of a sweep and its result: plain values that any executor can send to another process or machine."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from thirdbody.atomic_files import write_whole
from thirdbody.errors import OutputError

RESULT_FILE = "point.json"
"""In the folder of a point, beside the files of its run: the result, written last."""

WAITING, DONE, FAILED, INTERRUPTED = "waiting", "done", "failed", "interrupted"
"""Status of a point: not yet run; finished; stopped by a guard, a fault or a lost worker; stopped with a checkpoint."""

KEEP = ("all", "summary")
"""What stays of a finished point: the whole run, or its result only."""


@dataclass(frozen=True)
class Point:
    """One point: everything that `run_point` needs.

    `number` is its row in the table, `folder` that of its run, `scene` the resolved scene as TOML, `scene_folder` the folder of
    the files that the scene names, `results` the names of the columns to compute.
    """

    number: int
    folder: Path
    scene: str
    scene_folder: Path
    results: tuple[str, ...]
    plugins: tuple[Path, ...] = ()
    keep: str = "all"


@dataclass(frozen=True)
class PointResult:
    """Row of a point: `status`, for a failed one `reason`, the exit code of such a run, seconds spent, and results by name."""

    number: int
    status: str
    reason: str = ""
    exit_code: int | None = None
    seconds: float = 0.0
    results: Mapping[str, float] = field(default_factory=dict)


def write_result(point: Point, result: PointResult) -> None:
    """Write the result into the folder of its point, whole or not at all. Raises OutputError."""
    path = point.folder / RESULT_FILE
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps(asdict(result)).encode())
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error


def read_result(point: Point) -> PointResult | None:
    """Return the result in the folder of a point; None where there is none, or one without all columns that are wanted."""
    try:
        saved = json.loads((point.folder / RESULT_FILE).read_bytes())
        result = PointResult(**saved | {"number": point.number})
    except (OSError, ValueError, TypeError):
        return None
    complete = result.status != DONE or set(point.results) <= set(result.results)
    return result if complete else None
