"""What goes to the terminal: text of users and of files made by others may not steer it, and a letter it lacks stops nothing.

Every character that is printed by the command line passes `PrintableStream`. Only rich, which draws tables and bars with escape
sequences of its own, writes past it (`terminal_of`), and gets its texts from `printable`.
"""

from __future__ import annotations

import codecs
import io
import os
import re
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, TextIO

from thirdbody.errors import printable

MINUS = "\u2212"
ESCAPED = "thirdbody_escaped"
"""Name of the error handler `_escape` among those of the codecs."""


class PrintableStream:
    """A text stream that writes out control characters as escapes such as `\\x1b`.

    It has no `buffer`, so nothing can write round it.
    """

    def __init__(self, terminal: TextIO) -> None:
        self.terminal = terminal

    def write(self, text: str) -> int:
        """Write text of one or more lines; only line breaks and tabs pass as they are. Returns its length."""
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
    """The stream below a `PrintableStream`, for rich; any other stream itself."""
    return stream.terminal if isinstance(stream, PrintableStream) else stream


@contextmanager
def printable_output() -> Iterator[None]:
    """Let everything that is printed pass a `PrintableStream`; what the locale has no letter for becomes an escape, too.

    A stream that is closed swallows what is printed. Warnings of Python are printed as lines of ours.
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
    """Print a warning of Python as all others, without the line of code that gave it."""
    say(f"warning: {message}", err=True)


@contextmanager
def _escaped_letters(stream: Any) -> Iterator[None]:
    """Let a stream write letters that its encoding lacks as escapes, instead of raising."""
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
    """What stands for letters that an encoding lacks: an escape, but for a minus a hyphen, as digits follow it."""
    if not isinstance(problem, UnicodeEncodeError) or problem.object[problem.start] != MINUS:
        return codecs.backslashreplace_errors(problem)
    return "-", problem.start + 1


def _nowhere() -> TextIO:
    """A stream that swallows what is written; it takes the place of the closed one, so that no file of ours gets its number."""
    return open(os.devnull, "w", encoding="utf-8")


def say(text: object, *, err: bool = False) -> None:
    """Print one line, on standard error if `err`: line breaks within `text`, such as in a name, are written out too."""
    print(printable(str(text)), file=sys.stderr if err else sys.stdout, flush=err)
