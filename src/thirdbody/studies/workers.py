"""An executor of local processes, one thread each, that outlives the death of any of them; and what runs in such a process.

Each process computes one call at a time, so its death is known to belong to the point that it computed, and the others compute on
(those of `ProcessPoolExecutor` all end with one of them). A process is started again at the next point. It is no child of
`multiprocessing`: it neither imports the caller's script nor looks into the current folder.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from queue import SimpleQueue
from types import FrameType
from typing import Any

from thirdbody.errors import ThirdbodyError
from thirdbody.system.processes import cores, python_command, python_environment

TRIES = 3
"""Number of processes that one point may take with it before it counts as failed."""

PATIENCE = 20.0
"""Time [s] for a process to end by itself once it has nothing to do."""


class WorkerDied(ThirdbodyError):
    """The process of a point ended without an answer, several times."""


class LocalWorkers(Executor):
    """Executor of `count` local processes (None: as many as cores), each with one thread, started at once.

    `submit(function, *arguments)` calls `function(*arguments, stop)` in one of them; `stop` returns True after `interrupt`.
    """

    def __init__(self, count: int | None = None) -> None:
        self.count = count or cores()
        self._threads = ThreadPoolExecutor(self.count)
        self._workers = [_Worker() for _ in range(self.count)]
        self._idle: SimpleQueue[_Worker] = SimpleQueue()
        self._interrupted = False
        for worker in self._workers:
            worker.start()
            self._idle.put(worker)

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **options: Any) -> Future[Any]:
        """Return the future of `function(*arguments, stop, **options)` in a worker process."""
        return self._threads.submit(self._call, function, arguments, options)

    def interrupt(self) -> None:
        """Let `stop` of all calls return True, in calls to come too."""
        self._interrupted = True
        for worker in self._workers:
            worker.interrupt()

    def kill(self) -> None:
        """End the processes at once, without checkpoints."""
        self._interrupted = True
        self._threads.shutdown(wait=False, cancel_futures=True)
        for worker in self._workers:
            if worker.process is not None:
                worker.process.kill()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes; those that compute are interrupted first if their calls are cancelled."""
        if cancel_futures:
            self.interrupt()
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        for worker in self._workers:
            worker.close()

    def __exit__(self, kind: Any, *_: Any) -> None:
        if kind is None:
            self.shutdown()
        else:
            self.kill()

    def _call(self, function: Callable[..., Any], arguments: tuple[Any, ...], options: dict[str, Any]) -> Any:
        """Return the answer of a process that is idle. Raises WorkerDied, or what the function raised."""
        worker, request = self._idle.get(), pickle.dumps((function, arguments, options))
        try:
            for _ in range(TRIES):
                if self._interrupted:
                    raise CancelledError
                try:
                    answer, failure = worker.call(request)
                except (EOFError, OSError, pickle.UnpicklingError):
                    reason, code = worker.ended()
                    continue
                if failure is not None:
                    raise failure
                return answer
        finally:
            self._idle.put(worker)
        error = WorkerDied(f"its process ended {TRIES} times ({reason})")
        error.exit_code = code
        raise error


class _Worker:
    """One process of this module, with pipes to it and a file for what it prints."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[bytes] | None = None
        self._interrupted = False

    def start(self) -> subprocess.Popen[bytes]:
        """Start the process, which imports what it needs before its first call."""
        self._errors = tempfile.TemporaryFile()
        variables = python_environment() | {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        self.process = subprocess.Popen(
            python_command("thirdbody.studies.workers", str(os.getpid())), env=variables, start_new_session=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors,
        )  # fmt: skip
        return self.process

    def call(self, request: bytes) -> tuple[Any, BaseException | None]:
        """Return the answer to a request, and the exception it raised. Raises EOFError or OSError if the process died."""
        process = self.process or self.start()
        assert process.stdin is not None and process.stdout is not None
        if self._interrupted:  # while it started
            self.interrupt()
        process.stdin.write(request)
        process.stdin.flush()
        answer: tuple[Any, BaseException | None] = pickle.load(process.stdout)
        return answer

    def interrupt(self) -> None:
        """Ask the process to end its call with a checkpoint."""
        self._interrupted = True
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)

    def ended(self) -> tuple[str, int]:
        """Return how the process ended, in words and as exit code; the next call starts another one."""
        assert self.process is not None
        self.process.kill()
        code = self.process.wait()
        self._errors.seek(0)
        last = (self._errors.read().decode(errors="replace").strip().splitlines() or [""])[-1]
        self.process = None
        how = f"killed by signal {-code}" if code < 0 else f"exit code {code}"
        return f"{how}: {last}" if last else how, 128 - code if code < 0 else code

    def close(self) -> None:
        """End the process."""
        if self.process is None:
            return
        assert self.process.stdin is not None
        try:
            self.process.stdin.close()
            self.process.wait(PATIENCE)
        except (OSError, subprocess.TimeoutExpired):
            self.process.kill()
            self.process.wait()
        self.process = None


def serve(parent: int) -> None:
    """Answer pickled calls on standard input with `(result, None)` or `(None, exception)` until it ends.

    All other output goes to standard error. SIGTERM, or the death of the process that started it, lets `stop` return True: the
    call then ends with a checkpoint. The pipe comes from that process and no other can write to it.
    """
    signals: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        signals.append(number)

    def stop() -> bool:
        return bool(signals) or os.getppid() != parent

    signal.signal(signal.SIGTERM, note)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's: the process that started this one decides
    import thirdbody.runner.simulate  # noqa: F401  (before the first call: the start is what takes long)

    replies = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    while True:
        try:
            function, arguments, options = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            reply: tuple[Any, BaseException | None] = function(*arguments, stop, **options), None
        except Exception as error:
            reply = None, error
        pickle.dump(reply, replies)
        replies.flush()


if __name__ == "__main__":
    serve(int(sys.argv[1]))
