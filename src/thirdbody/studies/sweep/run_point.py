"""One point of a sweep, from its scene to its result, in whatever process it is called."""

from __future__ import annotations

import shutil
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from thirdbody.errors import InputError, Interrupted, OutputError, ThirdbodyError
from thirdbody.runner.checkpoint import FILE as CHECKPOINT
from thirdbody.runner.run_folder import lock_folder
from thirdbody.scene.model import Scene
from thirdbody.studies.sweep.point import DONE, FAILED, INTERRUPTED, RESULT_FILE, Point, PointResult, read_result, write_result

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation
    from thirdbody.runner.checkpoint import Checkpoint

LOCKED = 60.0
"""Time [s] to wait for another process that still writes this point: one whose sweep was killed ends soon."""

POLL = 0.2
"""Interval [s] between two looks at the lock."""


def run_point(point: Point, stop: Callable[[], bool] = lambda: False) -> PointResult:
    """Return the result of a point: the one in its folder, or that of its run, continued from its checkpoint if there is one.

    Never raises for a point that fails. The status is `interrupted`, and nothing is final, where `stop` returned True (the run
    then ends with a checkpoint) and where the disk is full (exit code 5).
    """
    began = time.perf_counter()
    if (saved := read_result(point)) is not None:
        return saved
    if not _unlocked(point.folder):
        return PointResult(point.number, FAILED, f"{point.folder}: another process is writing this run", 5)
    try:
        results = _results(point, stop)
        result = PointResult(point.number, DONE, "", 0, 0.0, results)
    except (Interrupted, OutputError) as error:  # a full disk: no property of the point
        return PointResult(point.number, INTERRUPTED, error.message, error.exit_code, time.perf_counter() - began)
    except ThirdbodyError as error:
        result = PointResult(point.number, FAILED, error.message, error.exit_code)
    except MemoryError as error:
        result = PointResult(point.number, FAILED, f"not enough memory{f' ({error})' if str(error) else ''}", 5)
    except Exception as error:  # a bug at one point ends no sweep
        where = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"a bug of thirdbody: {type(error).__name__}: {error} ({Path(where.filename).name}, line {where.lineno})"
        result = PointResult(point.number, FAILED, reason, 1)
    result = replace(result, seconds=time.perf_counter() - began)
    try:
        write_result(point, result)
        if result.status == DONE and point.keep == "summary":
            _remove_run(point.folder)
    except OutputError as error:
        return PointResult(point.number, INTERRUPTED, error.message, error.exit_code, result.seconds)
    return result


def _results(point: Point, stop: Callable[[], bool]) -> dict[str, float]:
    """Run a point to its end and return its results. Raises ThirdbodyError."""
    from thirdbody.runner.simulate import execute
    from thirdbody.studies.sweep.results import results_of
    from thirdbody.trajectory.reader import open_run

    simulation, checkpoint = _simulation(point)
    summary = execute(simulation, point.folder, 1, overwrite=checkpoint is None, stop=stop, checkpoint=checkpoint)
    with open_run(point.folder) as run:
        return results_of(run, summary, point.results)


def _simulation(point: Point) -> tuple[Simulation, Checkpoint | None]:
    """Return the simulation of a point, and the checkpoint of its folder if there is one to go on from."""
    from thirdbody.runner.resume import prepare_resume
    from thirdbody.runner.simulate import prepare

    if (point.folder / CHECKPOINT).is_file():
        try:
            return prepare_resume(point.folder, plugins=point.plugins)
        except InputError:  # damaged, or of another build of the scene: the point is computed from its start
            pass
    scene = Scene.parse(point.scene, "scene.toml", point.scene_folder, point.plugins)
    return prepare(scene, point.plugins), None


def _unlocked(folder: Path) -> bool:
    """Wait until no other process writes the run of this point; return False after `LOCKED` seconds."""
    until = time.perf_counter() + LOCKED
    while True:
        try:
            with lock_folder(folder):
                return True
        except OutputError:
            if time.perf_counter() > until:
                return False
        time.sleep(POLL)


def _remove_run(folder: Path) -> None:
    """Remove everything but the result from the folder of a point, which holds a run of ours."""
    for path in folder.iterdir():
        if path.name != RESULT_FILE:
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
