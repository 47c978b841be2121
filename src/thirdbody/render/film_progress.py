"""Progress of a film: a bar on a terminal, or a callable that gets two numbers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

from thirdbody.errors import printable
from thirdbody.system.terminal import terminal_of

FilmReporter = Callable[[int, int], None]
"""Takes the number of pictures that are drawn and that of all."""

DRAWN = "thirdbody drew picture "
"""What the process that draws prints for each picture, before its number."""


def film_reporter(progress: bool | FilmReporter, title: str) -> AbstractContextManager[FilmReporter | None]:
    """What `progress` of a film asks for: True a bar on a terminal, a callable itself, False nothing."""
    if progress is True:
        return film_bar(title)
    return nullcontext(None if progress is False else progress)


@contextmanager
def film_bar(title: str) -> Iterator[FilmReporter | None]:
    """A reporter that draws a bar on standard error; None, to draw nothing, where that is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    name = TextColumn("{task.description}", markup=False)  # a file's name is text, not markup
    columns = (name, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(file=terminal_of(sys.stderr))
    with Progress(*columns, console=console, redirect_stdout=False, redirect_stderr=False) as bar:
        task = bar.add_task(printable(title), total=None)

        def report(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        yield report
