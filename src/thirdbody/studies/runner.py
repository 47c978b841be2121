"""Runs the points of a study on any executor, as far as there is no wish to stop; progress, and the execution of a sweep."""

from __future__ import annotations

import math
import os
import sys
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Future
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from thirdbody.errors import Interrupted, OutputError, ThirdbodyError
from thirdbody.runner.progress import LINES
from thirdbody.runner.run_folder import lock_folder, make_folder
from thirdbody.studies.folder import Table, is_sweep_folder, save_plan
from thirdbody.studies.plan import Plan
from thirdbody.studies.point import (
    DONE,
    FAILED,
    INTERRUPTED,
    RESULT_FILE,
    WAITING,
    Point,
    PointResult,
    read_result,
    run_point,
    write_result,
)
from thirdbody.studies.workers import DaskPoints, LocalWorkers, is_dask_client
from thirdbody.system.processes import cores
from thirdbody.system.terminal import print_line, progress_bar
from thirdbody.units import duration

POLL = 0.2  # interval [s] at which a wish to stop is noticed
# Approximate number of points whose laws are compiled before workers start; a worker compiles what none of them has.
EXAMINED = 200


@dataclass(frozen=True)
class SweepProgress:
    """Progress of a study, passed to a `progress` function."""

    done: int  # points with a result, failed ones included
    failed: int
    total: int
    earlier: int  # points with a result before this start
    elapsed: float  # s, since this start

    @property
    def rate(self) -> float:
        """Points per second since this start."""
        return (self.done - self.earlier) / self.elapsed if self.elapsed > 0.0 else 0.0

    @property
    def left(self) -> float:
        """Time left at this rate [s]; infinite before the first point."""
        return (self.total - self.done) / self.rate if self.rate > 0.0 else float("inf")

    def __str__(self) -> str:
        failed = f", {self.failed} failed" if self.failed else ""
        rate = f", {60.0 * self.rate:.3g} points a minute, {duration(self.left)} left" if self.rate > 0.0 else ""
        return f"{self.done} of {self.total} points{failed}{rate}"


SweepReporter = Callable[[SweepProgress], None]


@contextmanager
def reporting(progress: bool | SweepReporter, title: str) -> Iterator[SweepReporter]:
    """Yield the reporter that `progress` asks for: one on standard error (True), none (False), or itself.

    A bar with points, rate and time left on a terminal, plain lines elsewhere.
    """
    if callable(progress):
        yield progress
    elif not progress or sys.stderr is None:
        yield lambda _: None
    elif sys.stderr.isatty():
        from rich.progress import BarColumn, TextColumn

        line = TextColumn("{task.fields[line]}", markup=False)
        with progress_bar(title[:40], 1.0, BarColumn(), line) as update:
            yield lambda progress: update(total=progress.total, completed=progress.done, line=str(progress))
    else:
        printed = [-1]

        def report(progress: SweepProgress) -> None:
            tenth = LINES * progress.done // max(progress.total, 1)
            if tenth > printed[0] and progress.done > progress.earlier:
                printed[0] = tenth
                with suppress(OSError):  # standard error that was closed ends no study
                    print_line(progress, err=True)

        yield report


def run_points(
    points: Sequence[Point],
    executor: Any,
    record: Callable[[PointResult], None],
    stop: Callable[[], bool] = lambda: False,
    grace: float = math.inf,
) -> bool:
    """Run all points and call `record` with the result of each, in the calling thread; return False where `stop` ended it.

    `executor`: anything with the `submit` of `concurrent.futures.Executor`, whose futures have callbacks and can be cancelled.
    After `stop`, points that wait are cancelled, and those that run end by themselves, local ones with a checkpoint; local
    processes that have not after `grace` seconds are ended. Raises OutputError where the executor itself broke or a disk is
    full: points without a result then wait for a resume.
    """
    finished: SimpleQueue[tuple[Point, Any]] = SimpleQueue()
    futures, going, killed = list[Any](), True, math.inf
    broken: OutputError | None = None

    def interrupt() -> None:
        for future in reversed(futures):
            future.cancel()
        getattr(executor, "interrupt", lambda: None)()  # local workers write checkpoints

    try:
        for point in points:
            future = executor.submit(run_point, point)
            future.add_done_callback(lambda future, point=point: finished.put((point, future)))
            futures.append(future)
        remaining = len(futures)
        while remaining:
            if going and (broken or stop()):
                going, killed = False, time.perf_counter() + grace
                interrupt()
            if time.perf_counter() > killed:
                killed = math.inf
                getattr(executor, "kill", lambda: None)()
            try:
                point, future = finished.get(timeout=POLL)
            except Empty:
                continue
            remaining -= 1
            result = _result(point, future)
            if result.status == WAITING and result.reason:
                broken = OutputError(f"the executor broke ({result.reason}); what was computed is kept, and a resume goes on")
            elif result.status == INTERRUPTED and result.exit_code == OutputError.exit_code:  # a full disk
                broken = broken or OutputError(result.reason)
            record(result)
    except BaseException:
        interrupt()
        raise
    if broken:
        raise broken
    return going


def _result(point: Point, future: Future[PointResult]) -> PointResult:
    """Return the result of a future; for one without an answer a row that says why."""
    try:
        return future.result()
    except CancelledError:
        return PointResult(point.number, WAITING)
    except KeyboardInterrupt:
        return PointResult(point.number, INTERRUPTED, "interrupted", 130)
    except BrokenExecutor as error:
        return PointResult(point.number, WAITING, str(error) or type(error).__name__)
    except Exception as error:  # the worker was lost: Dask gives up after several, so do local workers
        result = PointResult(point.number, FAILED, f"no answer: {error or type(error).__name__}", getattr(error, "exit_code", 1))
        try:
            write_result(point, result)
        except ThirdbodyError as fault:
            return PointResult(point.number, FAILED, fault.message, fault.exit_code)
        return result


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
    if not execution.resume and os.path.lexists(folder) and not (folder.is_dir() and not os.listdir(folder)):
        known = is_sweep_folder(folder)
        raise OutputError(
            f"{folder}: exists already",
            python=f"; {'resume=True goes on, ' if known else ''}out=... names another folder",
            command=f"; {'--resume goes on, ' if known else ''}-o names another folder",
        )
    make_folder(folder, exist_ok=True)
    with lock_folder(folder):
        save_plan(plan, folder)
        table, missing = Table(plan, folder), list[Point]()
        for point in plan.points:
            saved = read_result(point)
            if saved is None or (execution.retry and saved.status == FAILED):
                (point.folder / RESULT_FILE).unlink(missing_ok=True)
                missing.append(point)
            else:
                table.enter(saved)
        table.write()
        finished = not missing or _run(missing, table, execution)
        table.write()
    if not finished:
        from shlex import quote

        text = os.fspath(folder)
        raise Interrupted(
            f"interrupted; {table.counts.get(DONE, 0)} of {len(table.rows)} points are done",
            python=f"; to go on: thirdbody.sweep({text!r}, resume=True)",
            command=f"; to go on: thirdbody sweep {quote(text)} --resume",
        )
    return table


def _run(missing: list[Point], table: Table, execution: Execution) -> bool:
    began, earlier, given = 0.0, len(table.rows) - len(missing), execution.executor
    same: dict[Path, list[Point]] = {}
    for point in missing:
        same.setdefault(point.folder, []).append(point)

    def record(result: PointResult) -> None:
        for point in same[table.plan.points[result.number].folder]:  # points with the same scene have one run
            table.record(replace(result, number=point.number))
        done, failed = table.counts.get(DONE, 0), table.counts.get(FAILED, 0)
        execution.report(SweepProgress(done + failed, failed, len(table.rows), earlier, time.perf_counter() - began))

    unique = [points[0] for points in same.values()]
    count = max(1, min(execution.workers or cores(), len(unique)))
    opened: Any = LocalWorkers(count) if given is None else nullcontext(DaskPoints(given) if is_dask_client(given) else given)
    with opened as executor:
        memory, ready = warm_up(unique), len(table.rows) - len(unique)
        what = f"{len(unique)} points" + (f", {ready} more are there already" if ready else "")
        each = f", about {memory / 1e9:.1f} GB each" if memory else ""
        where = f"{count} {'process' if count == 1 else 'processes'} of one thread{each}"
        execution.log(f"{what}: {where if given is None else f'on {type(given).__name__}'}")
        began = time.perf_counter()
        return run_points(unique, executor, record, execution.stop)


def warm_up(points: Sequence[Point]) -> int:
    """Build one point for each composition of laws, so that all compiled code is in the cache before workers start.

    A point that cannot be built is left to its own run, which gives the reason. Return the memory of this process then [bytes],
    about what a worker needs; 0 where it is unknown.
    """
    from thirdbody.runner.simulate import prepare

    compiled: set[str] = set()
    for point in points[:: 1 + len(points) // EXAMINED]:
        tables = tomllib.loads(point.scene)
        contact = {key: value for key, value in tables.get("contact", {}).items() if not isinstance(value, float)}
        rolling = any("rolling_friction" in pair for pair in tables.get("pairs", ()))
        choice = sorted(tables.get("effects", {})), tables["solver"].get("integrator"), len(tables.get("pairs", ()))
        code = repr((contact, *choice, rolling))  # laws, levels, whole-number options: what decides on compiled code
        if code not in compiled:
            compiled.add(code)
            with suppress(ThirdbodyError):
                prepare(point.parsed(), point.plugins)
    try:
        import resource
    except ImportError:  # not on Windows
        return 0
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
