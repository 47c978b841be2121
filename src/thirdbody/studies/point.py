"""A point of a study and its run: plain values that any executor can send to another process or machine."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from thirdbody.atomic_files import write_output
from thirdbody.errors import InputError, Interrupted, OutputError, ThirdbodyError
from thirdbody.runner.checkpoint import FILE as CHECKPOINT
from thirdbody.runner.run_folder import lock_folder, make_folder
from thirdbody.scene.model import Scene

RESULT_FILE = "point.json"  # in the folder of a point, beside the files of its run: the result, written last
# Status of a point: not yet run; finished; stopped by a guard, a fault or a lost worker; stopped with a checkpoint.
WAITING, DONE, FAILED, INTERRUPTED = "waiting", "done", "failed", "interrupted"
# Time [s] to wait for another process that still writes this point (one whose study was killed ends soon), and interval.
LOCKED, POLL = 60.0, 0.2
# Packages whose source decides on results.
PACKAGES = ("assembly", "bodies", "engine", "jit", "kernels", "laws", "runner", "scene", "statics", "trajectory")


@dataclass(frozen=True)
class Point:
    """One point: everything that `run_point` needs.

    `number` is its row in the table, `folder` that of its run, `scene` the resolved scene as TOML, `scene_folder` the folder of
    the files that the scene names, `results` the names of the columns to compute, `keep` "all" or "summary": what stays of a
    finished run; `nudge`: number of the displacement of the start (`timing.nudge`), 0 for none; `deadline`: time at which its
    run ends with a checkpoint [s of `time.time`].
    """

    number: int
    folder: Path
    scene: str
    scene_folder: Path
    results: tuple[str, ...]
    plugins: tuple[Path, ...] = ()
    keep: str = "all"
    nudge: int = 0
    deadline: float = math.inf

    def parsed(self) -> Scene:
        """Return the scene."""
        return Scene.parse(self.scene, "scene.toml", self.scene_folder, self.plugins)


@dataclass(frozen=True)
class PointResult:
    """Row of a point: `status`, for a failed one `reason`, the exit code of such a run, seconds spent, and results by name.

    `processor`: seconds of the processor, of those spent.
    """

    number: int
    status: str
    reason: str = ""
    exit_code: int | None = None
    seconds: float = 0.0
    results: Mapping[str, float] = field(default_factory=dict)
    processor: float = 0.0


def write_result(point: Point, result: PointResult) -> None:
    """Write the result into the folder of its point, whole or not at all. Raises OutputError."""
    make_folder(point.folder, exist_ok=True)
    write_output(point.folder / RESULT_FILE, json.dumps(asdict(result)).encode())


def read_result(point: Point) -> PointResult | None:
    """Return the result in the folder of a point; None where there is none, or one without all columns that are wanted."""
    try:
        saved = json.loads((point.folder / RESULT_FILE).read_bytes())
        result = PointResult(**saved | {"number": point.number})
    except (OSError, ValueError, TypeError):
        return None
    complete = result.status != DONE or set(point.results) <= set(result.results)
    return result if complete else None


def run_point(point: Point, stop: Callable[[], bool] = lambda: False) -> PointResult:
    """Return the result of a point: the one in its folder, or that of its run, continued from its checkpoint if there is one.

    Never raises for a point that fails. The status is `interrupted`, and nothing is final, where `stop` returned True or the
    deadline passed (the run then ends with a checkpoint) and where the disk is full (exit code 5).
    """
    began, used, status, results = time.perf_counter(), time.process_time(), FAILED, dict[str, float]()
    if (saved := read_result(point)) is not None:
        return saved
    if not _unlocked(point.folder):
        return PointResult(point.number, FAILED, f"{point.folder}: another process is writing this run", 5)
    try:
        try:
            results, status, reason, code = _results(point, stop), DONE, "", 0
        except (Interrupted, OutputError):
            raise
        except ThirdbodyError as error:
            reason, code = error.message, error.exit_code
        except MemoryError as error:
            reason, code = f"not enough memory{f' ({error})' if str(error) else ''}", 5
        except Exception as error:  # a bug at one point ends no study
            where = traceback.extract_tb(error.__traceback__)[-1]
            reason = f"a bug of thirdbody: {type(error).__name__}: {error} ({Path(where.filename).name}, line {where.lineno})"
            code = 1
        seconds, processor = time.perf_counter() - began, time.process_time() - used
        result = PointResult(point.number, status, reason, code, seconds, results, processor)
        write_result(point, result)
    except (Interrupted, OutputError) as error:  # a full disk: no property of the point
        return PointResult(point.number, INTERRUPTED, error.message, error.exit_code, time.perf_counter() - began)
    if status == DONE and point.keep == "summary":
        for path in point.folder.iterdir():
            if path.name != RESULT_FILE:
                shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    return result


def _results(point: Point, stop: Callable[[], bool]) -> dict[str, float]:
    from thirdbody.runner.resume import prepare_resume
    from thirdbody.runner.simulate import execute, prepare
    from thirdbody.studies.results import results_of
    from thirdbody.studies.timing import attach, nudge
    from thirdbody.trajectory.run_file import RunFile

    built, checkpoint = None, None
    if (point.folder / CHECKPOINT).is_file():
        with suppress(InputError):  # damaged, or of another build of the scene: the point is computed from its start
            built, checkpoint = prepare_resume(point.folder, plugins=point.plugins)
    simulation = built or prepare(point.parsed(), point.plugins)
    if point.nudge and checkpoint is None:
        nudge(simulation.state, point.nudge)
    seconds = attach(simulation.integrator)

    def ended() -> bool:
        return stop() or time.time() > point.deadline

    summary = execute(simulation, point.folder, 1, overwrite=checkpoint is None, stop=ended, checkpoint=checkpoint)
    with RunFile(point.folder) as run:
        return results_of(run, summary | {"integration_time": seconds()}, point.results)


def _unlocked(folder: Path) -> bool:
    """Wait until no other process writes the run of this point; return False after `LOCKED` seconds."""
    until = time.perf_counter() + LOCKED
    while time.perf_counter() < until:
        with suppress(OutputError), lock_folder(folder):
            return True
        time.sleep(POLL)
    return False


@cache
def code_version(plugins: tuple[Path, ...] = ()) -> str:
    """Return the hash of the source that decides on results: ours, that of installed plug-ins, and plug-in files."""
    root = Path(__file__).parents[1]
    files = [file for name in PACKAGES for file in sorted((root / name).rglob("*.py"))]
    for point in sorted(entry_points(group="thirdbody.plugins"), key=lambda point: point.name):
        spec = find_spec(point.module.partition(".")[0])
        if spec is not None and spec.origin:
            origin = Path(spec.origin)
            files += sorted(origin.parent.rglob("*.py")) if origin.name == "__init__.py" else [origin]
    digest = hashlib.sha256()
    for file in [*files, *plugins]:
        digest.update(file.read_bytes())
    return digest.hexdigest()


def point_name(text: str, document: Mapping[str, Any], scene: Scene, version: str) -> str:
    """Return the name of the folder of a point, whose scene is `document`, as TOML `text`: 16 hexadecimal digits.

    It hashes the resolved scene, the files that the scene names, and this version of the program.
    """
    digest = hashlib.sha256(f"{version}\n{text}".encode())
    for _, name in named_files(document):
        path = scene.beside(name)
        if path.is_file():
            digest.update(_digest(path.absolute(), path.stat().st_mtime_ns))
    return digest.hexdigest()[:16]


@cache
def _digest(path: Path, _time: int) -> bytes:
    return hashlib.sha256(path.read_bytes()).digest()


def named_files(value: Any, key: str = "", location: str = "") -> Iterator[tuple[str, str]]:
    """Yield location, such as "debris.0.file", and name of the files that a document names."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from named_files(inner, name, f"{location}.{name}".lstrip("."))
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from named_files(inner, key, f"{location}.{k}")
    elif isinstance(value, str) and key in ("file", "table"):
        yield location, value
