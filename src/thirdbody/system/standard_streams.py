"""Standard streams of the command line that never raise: a closed reader or a full disk must not end a run.

Output that cannot be written is dropped; the first fault of each stream is stored. A reader of standard output that stops early
(`| head`) is no fault. Any other fault of standard output means that requested output was not delivered: exit code 5.
"""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

OUTPUT_FAULT = 5
"""Exit code when standard output could not be written, as for files."""


class Stream(io.FileIO):
    """A standard stream that stores its first fault, and drops all later output."""

    def __init__(self, number: int) -> None:
        super().__init__(number, "w", closefd=False)
        self.fault: OSError | None = None

    def write(self, data: Any) -> int | None:  # type: ignore[override]  # None: not now, as in FileIO
        """Write as much as the system accepts; after a fault, accept everything and drop it."""
        if self.fault is None:
            try:
                return super().write(data)
            except OSError as error:
                self.fault = error
        return len(data)


@contextmanager
def guarded_streams() -> Iterator[None]:
    """Make standard output and error never raise. Raises SystemExit (5) at the end if standard output could not be written.

    A stream closed by the caller (`>&-`) is redirected to the null device. Streams that other code has replaced stay unchanged.
    """
    _open_missing()
    before = sys.stdout, sys.stderr
    output, error = _guard(sys.stdout, sys.__stdout__, 1), _guard(sys.stderr, sys.__stderr__, 2)
    try:
        with _report_failure(output):
            sys.stdout = output or before[0]
            sys.stderr = error or before[1]
            yield
    finally:
        sys.stdout, sys.stderr = before


@contextmanager
def _report_failure(output: io.TextIOWrapper | None) -> Iterator[None]:
    """Report on standard error, at the end, that standard output could not be written; a failed command keeps its exit code."""
    code: Any = None
    try:
        yield
    except SystemExit as end:
        code = end.code
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    fault = None if output is None else output.buffer.raw.fault  # type: ignore[attr-defined]
    if fault is not None and not isinstance(fault, BrokenPipeError):
        print(f"thirdbody: standard output: cannot be written ({fault.strerror or fault})", file=sys.stderr, flush=True)
        code = code or OUTPUT_FAULT
    if code is not None:
        sys.exit(code)


def _guard(stream: TextIO | None, original: TextIO | None, number: int) -> io.TextIOWrapper | None:
    """Return the stream on a file that never raises; None if other code has replaced the stream."""
    if not isinstance(stream, io.TextIOWrapper) or stream is not original or stream.fileno() != number:
        return None
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(Stream(number)), stream.encoding, stream.errors, line_buffering=stream.line_buffering,
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
