"""Runs the points of a plan that have no result yet, and keeps the table."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from thirdbody.errors import Interrupted, OutputError
from thirdbody.runner.run_folder import lock_folder
from thirdbody.studies.sweep.dask_points import DaskPoints
from thirdbody.studies.sweep.driver import run_points
from thirdbody.studies.sweep.local_workers import LocalWorkers
from thirdbody.studies.sweep.plan import Plan
from thirdbody.studies.sweep.point import DONE, FAILED, RESULT_FILE, Point, PointResult, read_result
from thirdbody.studies.sweep.progress import SweepProgress, SweepReporter
from thirdbody.studies.sweep.sweep_folder import refuse_existing_sweep, save_plan
from thirdbody.studies.sweep.table import Table
from thirdbody.studies.sweep.warm_up import warm_up
from thirdbody.system.cpu_count import cores
from thirdbody.system.dask_client import is_dask_client


@dataclass(frozen=True)
class Execution:
    """How a sweep is carried out: an executor, or as many local processes; what is told, and when to stop.

    `resume`: the folder may hold a part of this sweep. `retry`: failed points run again.
    """

    executor: Any = None
    workers: int | None = None
    resume: bool = False
    retry: bool = False
    report: SweepReporter = lambda _: None
    log: Callable[[str], None] = lambda _: None
    stop: Callable[[], bool] = lambda: False


def execute_sweep(plan: Plan, folder: Path, execution: Execution) -> Table:
    """Run what is missing of a sweep in its folder; return the table.

    Raises OutputError if the folder cannot be used, and Interrupted where `execution.stop` ended the sweep.
    """
    if not execution.resume:
        refuse_existing_sweep(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror or error})") from error
    with lock_folder(folder):
        save_plan(plan, folder)
        table = Table(plan, folder)
        missing = _missing(plan, table, execution.retry)
        table.write()
        if missing and not _run(missing, table, execution):
            table.write()
            raise _interrupted(table, folder)
        table.write()
    return table


def _missing(plan: Plan, table: Table, retry: bool) -> list[Point]:
    """Enter the results that are there into the table; return the points without one."""
    missing = []
    for point in plan.points:
        saved = read_result(point)
        if saved is not None and retry and saved.status == FAILED:
            (point.folder / RESULT_FILE).unlink(missing_ok=True)
            saved = None
        if saved is None:
            missing.append(point)
        else:
            table.enter(saved)
    return missing


def _run(missing: list[Point], table: Table, execution: Execution) -> bool:
    """Run points and enter their results; return False if stopped."""
    began, earlier = 0.0, len(table.rows) - len(missing)
    same: dict[Path, list[Point]] = {}
    for point in missing:
        same.setdefault(point.folder, []).append(point)

    def record(result: PointResult) -> None:
        for point in same[table.plan.points[result.number].folder]:  # points with the same scene have one run
            table.record(replace(result, number=point.number))
        done, failed = table.counts.get(DONE, 0), table.counts.get(FAILED, 0)
        progress = SweepProgress(done + failed, failed, len(table.rows), earlier, time.perf_counter() - began)
        execution.report(progress)

    unique = [points[0] for points in same.values()]
    with _executor(len(unique), execution) as executor:
        execution.log(_words(unique, table, execution))
        began = time.perf_counter()
        return run_points(unique, executor, record, execution.stop)


def _words(points: list[Point], table: Table, execution: Execution) -> str:
    """Compile what all points need; return how many run, and on what."""
    memory = warm_up(points).memory
    ready = len(table.rows) - len(points)
    what = f"{len(points)} points" + (f", {ready} more are there already" if ready else "")
    if execution.executor is not None:
        return f"{what}: on {type(execution.executor).__name__}"
    count = _count(len(points), execution)
    each = f", about {memory / 1e9:.1f} GB each" if memory else ""
    return f"{what}: {count} {'process' if count == 1 else 'processes'} of one thread{each}"


def _count(points: int, execution: Execution) -> int:
    return max(1, min(execution.workers or cores(), points))


@contextmanager
def _executor(points: int, execution: Execution) -> Iterator[Any]:
    """Yield the executor given, or local workers, which end with the sweep."""
    if is_dask_client(execution.executor):
        yield DaskPoints(execution.executor)
        return
    if execution.executor is not None:
        yield execution.executor
        return
    workers = LocalWorkers(_count(points, execution))
    try:
        yield workers
    except BaseException:
        workers.kill()
        raise
    workers.shutdown()


def _interrupted(table: Table, folder: Path) -> Interrupted:
    """Return the error whose message explains how to continue."""
    from shlex import quote

    done = table.counts.get(DONE, 0)
    text = os.fspath(folder)
    words = f"interrupted; {done} of {len(table.rows)} points are done"
    return Interrupted(
        words,
        python=f"; to go on: thirdbody.sweep({text!r}, resume=True)",
        command=f"; to go on: thirdbody sweep {quote(text)} --resume",
    )
