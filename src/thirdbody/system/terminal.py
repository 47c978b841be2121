"""Safe output to the terminal: untrusted text cannot control it, and missing letters raise no error.

All characters printed by the command line pass through `PrintableStream`. Only rich, which draws tables and bars with its own
escape sequences, writes past it (`terminal_of`), with texts from `printable`.
"""

import codecs
import io
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any, TextIO

from thirdbody.errors import printable

MINUS = "\u2212"
ESCAPED = "thirdbody_escaped"
"""Name under which `_escape` is registered as a codec error handler."""


class PrintableStream:
    """A text stream that writes control characters as escapes such as `\x1b`.

    It has no `buffer`, so nothing can bypass it.
    """

    def __init__(self, terminal: TextIO) -> None:
        self.terminal = terminal

    def write(self, text: str) -> int:
        """Write text of one or more lines; only line breaks and tabs pass unchanged. Return its length."""
        self.terminal.write("".join(part if part in ("\n", "\t") else printable(part) for part in re.split("([\n\t])", text)))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write one text after the other."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        if name in ("buffer", "terminal"):
            raise AttributeError(name)
        return getattr(self.terminal, name)


def terminal_of(stream: Any) -> Any:
    """Return the stream below a `PrintableStream`, for rich; any other stream itself."""
    return stream.terminal if isinstance(stream, PrintableStream) else stream


@contextmanager
def progress_bar(title: str, total: float | None, *columns: Any) -> Iterator[Callable[..., None]]:
    """Yield the function that updates a bar on standard error, as `rich.progress.Progress.update`; columns follow the title."""
    from rich.console import Console
    from rich.progress import Progress, TextColumn

    name = TextColumn("{task.description}", markup=False)  # a title is text, not markup
    console = Console(file=terminal_of(sys.stderr))
    with Progress(name, *columns, console=console, redirect_stdout=False, redirect_stderr=False) as bar:
        yield partial(bar.update, bar.add_task(printable(title), total=total, line="", left=""))


@contextmanager
def printable_output() -> Iterator[None]:
    """Pass everything that is printed through a `PrintableStream`; letters missing in the locale are escaped too.

    A closed stream discards output. Python's warnings are printed as lines in the program's style.
    """
    before = sys.stdout, sys.stderr
    with ExitStack() as stack:
        for stream in before:
            stack.enter_context(_escaped_letters(stream))
        sys.stdout, sys.stderr = (PrintableStream(stream or _nowhere()) for stream in before)  # type: ignore[assignment]
        stack.enter_context(warnings.catch_warnings())
        warnings.showwarning = _warn
        try:
            yield
        finally:
            sys.stdout, sys.stderr = before


def _warn(message: Warning | str, *_where: object, **_also: object) -> None:
    """Print a Python warning like all others, without the line of code that issued it."""
    print_line(f"warning: {message}", err=True)


@contextmanager
def _escaped_letters(stream: Any) -> Iterator[None]:
    """Make a stream escape letters that its encoding lacks, instead of raising."""
    if not isinstance(stream, io.TextIOWrapper):
        yield
        return
    before = stream.errors
    codecs.register_error(ESCAPED, _escape)
    stream.reconfigure(errors=ESCAPED)
    try:
        yield
    finally:
        if not stream.closed:
            stream.reconfigure(errors=before)


def _escape(problem: UnicodeError) -> tuple[str | bytes, int]:
    """Return the replacement of letters that an encoding lacks: an escape, or a hyphen for a minus, as digits follow it."""
    if not isinstance(problem, UnicodeEncodeError) or problem.object[problem.start] != MINUS:
        return codecs.backslashreplace_errors(problem)
    return "-", problem.start + 1


def _nowhere() -> TextIO:
    """Return a stream that discards output, on the number of the closed one, so that no other file gets that number."""
    return open(os.devnull, "w", encoding="utf-8")


def print_line(text: object, *, err: bool = False) -> None:
    """Print one line, on standard error if `err`: line breaks within `text`, such as in a name, are escaped too."""
    print(printable(str(text)), file=sys.stderr if err else sys.stdout, flush=err)
