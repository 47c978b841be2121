"""Progress of a sweep: a bar with points, rate and time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from thirdbody.system.terminal import print_line, progress_bar
from thirdbody.units import duration

LINES = 10
"""Number of lines of a whole sweep where there is no terminal for a bar."""


@dataclass(frozen=True)
class SweepProgress:
    """Progress of a sweep, passed to a `progress` function."""

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
    """Yield the reporter that `progress` asks for: one on standard error (True), none (False), or itself."""
    if callable(progress):
        yield progress
    elif not progress or sys.stderr is None:
        yield lambda _: None
    elif sys.stderr.isatty():
        with _bar(title) as report:
            yield report
    else:
        yield _plain()


@contextmanager
def _bar(title: str) -> Iterator[SweepReporter]:
    from rich.progress import BarColumn, TextColumn

    line = TextColumn("{task.fields[line]}", markup=False)
    with progress_bar(title[:40], 1.0, BarColumn(), line) as update:
        yield lambda progress: update(total=progress.total, completed=progress.done, line=str(progress))


def _plain() -> SweepReporter:
    printed = [-1]

    def report(progress: SweepProgress) -> None:
        tenth = LINES * progress.done // max(progress.total, 1)
        if tenth > printed[0] and progress.done > progress.earlier:
            printed[0] = tenth
            with suppress(OSError):  # standard error that was closed ends no sweep
                print_line(progress, err=True)

    return report
