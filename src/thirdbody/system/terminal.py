"""Safe standard streams: they never raise, untrusted text cannot control the terminal, and missing letters raise no error.

A closed reader or a full disk must not end a run: output that cannot be written is dropped, and the first fault of each stream
is stored. A reader of standard output that stops early (`| head`) is no fault. Any other fault of standard output means that
requested output was not delivered: exit code 5, as for files.

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

from thirdbody.errors import OutputError, printable

MINUS = "\u2212"
ESCAPED = "thirdbody_escaped"  # name under which `_escape` is registered as a codec error handler


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
        # a closed stream is replaced on its own number, so that no other file gets that number
        streams = (stream or open(os.devnull, "w", encoding="utf-8") for stream in before)
        sys.stdout, sys.stderr = map(PrintableStream, streams)  # type: ignore[assignment]
        stack.enter_context(warnings.catch_warnings())
        # like all others, without the line of code that issued it
        warnings.showwarning = lambda message, *_where, **_also: print_line(f"warning: {message}", err=True)
        try:
            yield
        finally:
            sys.stdout, sys.stderr = before


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


def print_line(text: object, *, err: bool = False) -> None:
    """Print one line, on standard error if `err`: line breaks within `text`, such as in a name, are escaped too."""
    print(printable(str(text)), file=sys.stderr if err else sys.stdout, flush=err)


class _Stream(io.FileIO):
    """A standard stream that stores its first fault, and drops all later output."""

    def __init__(self, number: int) -> None:
        super().__init__(number, "w", closefd=False)
        self.fault: OSError | None = None

    def write(self, data: Any) -> int | None:  # type: ignore[override]  # None: not now, as in FileIO
        if self.fault is None:
            try:
                return super().write(data)
            except OSError as error:
                self.fault = error
        return len(data)


@contextmanager
def guarded_streams() -> Iterator[None]:
    """Make standard output and error never raise. Raises SystemExit (5) at the end if standard output could not be written.

    A stream closed by the caller (`>&-`) is redirected to the null device. Streams that other code has replaced stay unchanged. A
    failed command keeps its exit code.
    """
    _open_missing()
    before, code = (sys.stdout, sys.stderr), None
    output, error = _guard(sys.stdout, sys.__stdout__, 1), _guard(sys.stderr, sys.__stderr__, 2)
    sys.stdout, sys.stderr = output or before[0], error or before[1]
    try:
        try:
            yield
        except SystemExit as end:
            code = end.code
        sys.stdout.flush()
        sys.stderr.flush()
        fault = None if output is None else output.buffer.raw.fault  # type: ignore[attr-defined]
        if fault is not None and not isinstance(fault, BrokenPipeError):
            print(f"thirdbody: standard output: cannot be written ({fault.strerror or fault})", file=sys.stderr, flush=True)
            code = code or OutputError.exit_code
        if code is not None:
            sys.exit(code)
    finally:
        sys.stdout, sys.stderr = before


def _guard(stream: TextIO | None, original: TextIO | None, number: int) -> io.TextIOWrapper | None:
    """Return the stream on a file that never raises; None if other code has replaced the stream."""
    if not isinstance(stream, io.TextIOWrapper) or stream is not original or stream.fileno() != number:
        return None
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(_Stream(number)), stream.encoding, stream.errors, line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )  # fmt: skip


def _open_missing() -> None:
    """Open the null device for closed standard streams; else the next file would get their number and be written to."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number, which is this one
            os.set_inheritable(number, True)
    for name, number in (("stdout", 1), ("stderr", 2)):
        if getattr(sys, name) is None:
            stream = open(number, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)
