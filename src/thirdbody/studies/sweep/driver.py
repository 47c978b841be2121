"""Hands the points of a sweep to an executor and collects their results, as far as there is no wish to stop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Future
from queue import Empty, SimpleQueue
from typing import Any, Protocol

from thirdbody.errors import OutputError, ThirdbodyError
from thirdbody.studies.sweep.point import FAILED, INTERRUPTED, WAITING, Point, PointResult, write_result
from thirdbody.studies.sweep.run_point import run_point

POLL = 0.2
"""Interval [s] between two looks at `stop`."""


class PointExecutor(Protocol):
    """Anything with the `submit` of `concurrent.futures.Executor`, whose futures have callbacks and can be cancelled."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """Return the future of `function(*arguments)`."""


def run_points(
    points: Sequence[Point],
    executor: PointExecutor,
    record: Callable[[PointResult], None],
    stop: Callable[[], bool] = lambda: False,
) -> bool:
    """Run all points and call `record` with the result of each, in the calling thread; return False where `stop` ended it.

    After `stop`, points that wait are cancelled, and those that run end by themselves, local ones with a checkpoint. Raises
    OutputError where the executor itself broke or a disk is full: points without a result then wait for a resume.
    """
    finished: SimpleQueue[tuple[Point, Any]] = SimpleQueue()
    futures: list[Any] = []
    broken: OutputError | None = None
    going = True
    try:
        for point in points:
            future = executor.submit(run_point, point)
            future.add_done_callback(lambda future, point=point: finished.put((point, future)))
            futures.append(future)
        remaining = len(futures)
        while remaining:
            if going and (broken or stop()):
                going = False
                _interrupt(executor, futures)
            try:
                point, future = finished.get(timeout=POLL)
            except Empty:
                continue
            remaining -= 1
            result = _result(point, future)
            broken = broken or _broken(result)
            record(result)
    except BaseException:
        _interrupt(executor, futures)
        raise
    if broken:
        raise broken
    return going


def _broken(result: PointResult) -> OutputError | None:
    """Return the error of a result that ends the whole sweep: an executor that broke, a disk that is full."""
    if result.status == WAITING and result.reason:
        return OutputError(f"the executor broke ({result.reason}); what was computed is kept, and a resume goes on")
    if result.status == INTERRUPTED and result.exit_code == OutputError.exit_code:
        return OutputError(result.reason)
    return None


def _interrupt(executor: PointExecutor, futures: Sequence[Any]) -> None:
    """Cancel what waits, and ask local workers to write checkpoints."""
    for future in reversed(futures):
        future.cancel()
    getattr(executor, "interrupt", lambda: None)()


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
