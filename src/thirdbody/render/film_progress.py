"""Progress of a film: a bar on a terminal, or a callable of two numbers."""

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

from thirdbody.system.terminal import progress_bar

FilmReporter = Callable[[int, int], None]
"""Called with the number of pictures drawn and their total."""

DRAWN = "thirdbody drew picture "
"""Prefix of the line that the drawing process prints for each picture, before its number."""


def film_reporter(progress: bool | FilmReporter, title: str) -> AbstractContextManager[FilmReporter | None]:
    """Return the reporter for `progress` of a film: True a bar on a terminal, a callable itself, False none."""
    if progress is True:
        return film_bar(title)
    return nullcontext(None if progress is False else progress)


@contextmanager
def film_bar(title: str) -> Iterator[FilmReporter | None]:
    """Yield a reporter that draws a bar on standard error; None, for no output, where that is not a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TimeRemainingColumn

    with progress_bar(title, None, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()) as update:
        yield lambda done, total: update(completed=done, total=total)
