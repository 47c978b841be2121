"""Progress of a run: a bar with remaining time on a terminal, plain lines elsewhere."""

import math
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from thirdbody.errors import printable
from thirdbody.system.terminal import print_line, progress_bar

LINES = 10
"""Lines of progress of a whole run, or study, where there is no terminal for a bar."""

OFFSET = 0.38
"""Part of such an interval by which they come later than tenths of a run, where a stroke is often at a reversal."""

FIRST_LINE, NEXT_LINES = 20.0, 60.0
"""Longest wall times to the first line and between two lines there [s]."""


@dataclass(frozen=True)
class Progress:
    """Progress of a run, passed to a `progress` function."""

    fraction: float  # of the simulated time, 0 to 1
    simulated: float  # time, s
    elapsed: float  # wall time, s, including that before a resume
    frame: int  # frames written so far
    series: dict[str, Any]  # the values of the last frame by name, such as friction_coefficient
    limit: str = ""  # what has limited the steps of an implicit run, such as "62 % of steps limited by ..."

    @property
    def remaining(self) -> float:
        """Expected wall time to the end [s]; NaN at the start."""
        return self.elapsed / self.fraction * (1.0 - self.fraction) if self.fraction > 0.0 else math.nan


Reporter = Callable[[Progress], None]


@contextmanager
def reporting(progress: bool | Reporter, title: str, first: Iterable[str] = ()) -> Iterator[Reporter | None]:
    """Yield the reporter that `progress` asks for: one on standard error (True), none (False), or itself.

    The first one draws while standard error can be written to, after the lines `first`.
    """
    if progress is not True or sys.stderr is None:  # the program was started without one; print would take standard output
        yield None if isinstance(progress, bool) else progress
        return
    with suppress(OSError):  # a closed or full stream ends no run
        for line in first:
            print_line(line, err=True)
    if sys.stderr.isatty():
        with _bar(title) as report:
            yield until_closed(report)
    else:
        yield until_closed(line_reporter(lambda line: print(line, file=sys.stderr, flush=True)))


def until_closed(report: Reporter) -> Reporter:
    """Return a reporter that stops silently when its stream is closed, full or lost: that ends no run."""
    open_stream = True

    def silent(progress: Progress) -> None:
        nonlocal open_stream
        if open_stream:
            try:
                report(progress)
            except OSError:
                open_stream = False

    return silent


def headline(progress: Progress) -> str:
    """Describe friction coefficient, state fractions and the limit of the steps in one line."""
    series = progress.series
    mu = series.get("friction_coefficient", math.nan)
    parts = [] if math.isnan(mu) else [f"mu {mu:z.3f}"]
    for name, value in series.items():
        if name.startswith("fraction_") and value > 0.0:
            parts.append(f"{name.removeprefix('fraction_')} {100.0 * value:.0f} %")
    return ", ".join([*parts, progress.limit] if progress.limit else parts)


@contextmanager
def _bar(title: str) -> Iterator[Reporter]:
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn

    left, line = TextColumn("{task.fields[left]}"), TextColumn("{task.fields[line]}", markup=False)
    with progress_bar(title[:40], 1.0, BarColumn(), TaskProgressColumn(), left, line) as update:

        def report(progress: Progress) -> None:
            seconds = progress.remaining
            clock = "-:--:--" if math.isnan(seconds) else str(timedelta(seconds=round(seconds)))
            update(completed=progress.fraction, left=clock, line=printable(headline(progress)))

        yield report


def line_reporter(write: Callable[[str], None]) -> Reporter:
    """Return a reporter that writes a line at every tenth of a run, and one a minute between them."""
    message, due = [-1], [FIRST_LINE]

    def report(progress: Progress) -> None:
        tenth = LINES if progress.fraction >= 1.0 else int(LINES * progress.fraction - OFFSET)
        if tenth <= message[0] and progress.elapsed < due[0]:
            return
        message[0], due[0] = tenth, progress.elapsed + NEXT_LINES
        remaining = "" if math.isnan(progress.remaining) else f", {progress.remaining:.0f} s left"
        write(
            f"{100.0 * progress.fraction:3.0f} %  t = {progress.simulated:.4g} s, {progress.elapsed:.1f} s{remaining}  "
            f"{headline(progress)}"
        )

    return report
