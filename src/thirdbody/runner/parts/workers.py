"""Where parts are computed: in processes of this machine, or on the workers of an executor, in a process each."""

from __future__ import annotations

import subprocess
import tempfile
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, Protocol

from thirdbody.system.child_process import python_command, python_environment
from thirdbody.system.cpu_count import cores
from thirdbody.system.dask_client import is_dask_client, thread_count

MODULE = "thirdbody.runner.parts.part"


class Workers(Protocol):
    """Starts parts, and tells how they ended."""

    at_once: int
    """Number of parts that are computed at the same time."""

    local: bool
    """Whether they are computed on this machine."""

    def start(self, folder: Path, number: int) -> None:
        """Start a part."""

    def ended(self, number: int) -> str | None:
        """Return None while a part runs, an empty text after it ended in order, else how it died."""

    def close(self, seconds: float) -> None:
        """Wait for all parts to end, and end those that take longer."""


class LocalProcesses:
    """Parts in processes of this machine, `at_once` at the same time."""

    local = True

    def __init__(self, at_once: int) -> None:
        self.at_once = at_once
        self._running: dict[int, tuple[subprocess.Popen[bytes], tempfile._TemporaryFileWrapper]] = {}

    def start(self, folder: Path, number: int) -> None:
        """Start a part; Ctrl-C in a terminal reaches only the run that joins the parts."""
        self._running[number] = _process(folder, number)

    def ended(self, number: int) -> str | None:
        """As `Workers.ended`."""
        process, errors = self._running[number]
        return None if process.poll() is None else _how(process, errors)

    def close(self, seconds: float) -> None:
        """As `Workers.close`."""
        for process, _ in self._running.values():
            try:
                process.wait(seconds)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def executor_of(given: Any) -> tuple[Executor, int | None]:
    """Return an executor, for a Dask client that of its workers, and how many calls it computes at the same time, if known."""
    if is_dask_client(given):
        return given.get_executor(pure=False), thread_count(given)
    return given, getattr(given, "_max_workers", None)


class OnExecutor:
    """Parts on the workers of an executor (`concurrent.futures`, Dask), which see the folder of the run."""

    local = False

    def __init__(self, executor: Any, parts: int) -> None:
        self.executor, number = executor_of(executor)
        self.at_once = parts if number is None else min(number, parts)
        self._futures: dict[int, Future[str]] = {}

    def start(self, folder: Path, number: int) -> None:
        """As `Workers.start`."""
        self._futures[number] = self.executor.submit(part_in_process, str(folder.absolute()), number)

    def ended(self, number: int) -> str | None:
        """As `Workers.ended`."""
        future = self._futures[number]
        if not future.done():
            return None
        if future.cancelled():
            return "was cancelled"
        error = future.exception()
        return future.result() if error is None else f"{type(error).__name__}: {error}"

    def close(self, seconds: float) -> None:
        """Cancel the parts that have not started; the others stop by themselves."""
        for future in self._futures.values():
            future.cancel()


def workers_of(parts: int | tuple[int, Executor | None], at_once: int | None) -> tuple[int, Workers]:
    """Return the number of parts and where they are computed: on an executor, if one is given, or in processes of this machine.

    `at_once`: largest number of local processes at the same time; None: as many as cores.
    """
    number, executor = parts if isinstance(parts, tuple) else (parts, None)
    return number, LocalProcesses(at_once or cores()) if executor is None else OnExecutor(executor, number)


def part_in_process(folder: str, number: int) -> str:
    """Compute a part in a process of its own, and return how it died; empty if it did not.

    The worker itself stays free to answer: compiled code would keep it for up to a second at a time.
    """
    process, errors = _process(Path(folder), number)
    process.wait()
    return _how(process, errors)


def _process(folder: Path, number: int) -> tuple[subprocess.Popen[bytes], tempfile._TemporaryFileWrapper]:
    errors = tempfile.TemporaryFile()
    command = python_command(MODULE, str(folder.absolute()), str(number))
    environment = python_environment() | {"NUMBA_NUM_THREADS": "1"}
    process = subprocess.Popen(
        command, env=environment, stdin=subprocess.DEVNULL, stdout=errors, stderr=errors, start_new_session=True
    )
    return process, errors  # type: ignore[return-value]


def _how(process: subprocess.Popen[bytes], errors: tempfile._TemporaryFileWrapper) -> str:
    if process.returncode == 0:
        return ""
    errors.seek(0)
    lines = errors.read().decode(errors="replace").strip().splitlines()
    end = f"signal {-process.returncode}" if process.returncode < 0 else f"code {process.returncode}"
    return f"its process ended with {end}" + (f": {lines[-1]}" if lines else "")
