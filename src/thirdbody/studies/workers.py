"""Executors: local processes of one thread each, of which any may die; Dask, of a scheduler or a queue (SLURM, PBS and others).

Each process computes one call at a time, so its death is known to belong to the point that it computed, and the others compute on
(those of `ProcessPoolExecutor` all end with one of them). A process is started again at the next point. It is no child of
`multiprocessing`: it neither imports the caller's script nor looks into the current folder.

Dask is imported only where it is used; `pip install "thirdbody[cluster]"` brings it. A Dask worker that computed points itself
could not answer its scheduler while compiled code runs, would end with a point that crashes, and must not run compiled loops in
several threads. So each thread of a worker has a process, which ends with the worker.
"""

from __future__ import annotations

import logging
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import tomllib
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from inspect import signature
from pathlib import Path
from queue import SimpleQueue
from types import FrameType
from typing import Any

from thirdbody.errors import Fault, InputError, MissingLibrary, ThirdbodyError, UsageError, nearest
from thirdbody.system.processes import python_command, python_environment

TRIES = 3  # number of processes that one point may take with it before it counts as failed
PATIENCE = 20.0  # time [s] for a process to end by itself once it has nothing to do
ANSWER = 4.0  # longest wait [s] for a scheduler to answer

QUEUES = {
    "slurm": "SLURMCluster", "pbs": "PBSCluster", "sge": "SGECluster", "lsf": "LSFCluster", "moab": "MoabCluster",
    "oar": "OARCluster", "htcondor": "HTCondorCluster",
}  # fmt: skip
"""Classes of dask-jobqueue by the name of their table in a cluster file."""

JOBS = "jobs"  # key of the number of jobs; all other keys are arguments of the class
# Arguments of the cluster itself, not of its jobs.
OF_CLUSTER = ("host", "interface", "protocol", "scheduler_options", "silence_logs", "shared_temp_directory")


_own = threading.local()  # the process of each thread of this Dask worker


class WorkerDied(ThirdbodyError):
    """The process of a point ended without an answer, several times."""


class LocalWorkers(Executor):
    """Executor of `count` local processes, each with one thread, started at once.

    `submit(function, *arguments)` calls `function(*arguments, stop)` in one of them; `stop` returns True after `interrupt`.
    """

    def __init__(self, count: int) -> None:
        self.count = count
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


class DaskPoints:
    """Executor on a Dask client: calls `function(*arguments, stop)`. One whose worker dies is repeated: points are idempotent."""

    def __init__(self, client: Any) -> None:
        self.submit = partial(client.get_executor(pure=False).submit, in_process)


def in_process(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return the answer of the process of this thread."""
    if not hasattr(_own, "workers"):
        _own.workers = LocalWorkers(1)
    return _own.workers.submit(function, *arguments).result()


def is_dask_client(executor: object) -> bool:
    """Return whether it is a client of Dask, without importing Dask."""
    return any(kind.__module__ == "distributed.client" and kind.__name__ == "Client" for kind in type(executor).__mro__)


@contextmanager
def dask_client(address: str | None, cluster: Path | None) -> Iterator[Any]:
    """Yield the client of a scheduler's address, or of a cluster that is started by its file; None without both.

    Raises UsageError, InputError and MissingLibrary. Jobs of a cluster end with the block.
    """
    if address is not None and cluster is not None:
        raise UsageError("give --dask or --cluster, not both")
    if address is None and cluster is None:
        yield None
        return
    settings = None if cluster is None else read_cluster(cluster)
    try:
        import distributed
    except ImportError as error:
        raise MissingLibrary('this needs Dask: pip install "thirdbody[cluster]"') from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # connections that are lost are our own messages
    with nullcontext(address) if cluster is None or settings is None else _started(cluster, *settings) as jobs:
        try:
            client = distributed.Client(jobs, timeout=ANSWER)
        except (OSError, ValueError, TimeoutError) as error:
            raise UsageError(f"--dask {address or cluster}: no scheduler answers there ({error})") from error
        with client:
            yield client


def _started(path: Path, queue: str, settings: dict[str, Any]) -> Any:
    """Return the cluster with its jobs submitted, as a context. Raises InputError and MissingLibrary."""
    try:
        import dask_jobqueue
    except ImportError as error:
        raise MissingLibrary('a cluster file needs dask-jobqueue: pip install "thirdbody[cluster]"') from error
    kind, jobs = getattr(dask_jobqueue, QUEUES[queue]), settings.pop(JOBS, 1)
    known = {name for job in kind.job_cls.__mro__[:-1] for name in signature(job.__init__).parameters} | set(OF_CLUSTER)
    known -= {"self", "scheduler", "name", "base_class_kwargs", "config_name"}
    if wrong := [key for key in settings if key not in known]:
        words = f"is no argument of {kind.__name__}"
        raise InputError([Fault(f"{queue}.{key}", f"{words}, {nearest(key, known)}", str(path)) for key in wrong])
    settings.setdefault("scheduler_options", {"dashboard_address": ":0"})
    try:
        cluster = kind(**settings)
    except (ValueError, TypeError, OSError, RuntimeError) as error:
        raise InputError(Fault(queue, f"the cluster cannot be started: {error}", str(path))) from error
    try:
        for _ in range(jobs):  # as `scale` does, which would not raise
            cluster.worker_spec.update(cluster.new_worker_spec())
        cluster.sync(cluster._correct_state)
    except (OSError, RuntimeError) as error:
        with suppress(AssertionError):  # of Dask, that every job was submitted
            cluster.close()
        reason = [line for line in str(error).splitlines() if line][-1]
        raise InputError(Fault(queue, f"no job can be submitted: {reason}", str(path))) from error
    return cluster


def read_cluster(path: Path) -> tuple[str, dict[str, Any]]:
    """Return the queue that a cluster file names, and its settings. Raises InputError with every fault."""
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(Fault("", f"cannot be read ({reason})", str(path))) from error
    faults = [Fault(name, f"is no queue, {nearest(name, QUEUES)}", str(path)) for name in tables if name not in QUEUES]
    faults += [Fault(name, "must be a table", str(path)) for name, table in tables.items() if not isinstance(table, Mapping)]
    if len(tables) != 1 and not faults:
        faults = [Fault("", f"needs one table, such as [slurm]; it has {len(tables)}", str(path))]
    for name, table in () if faults else tables.items():
        jobs = table.get(JOBS, 1)
        if not isinstance(jobs, int) or isinstance(jobs, bool) or jobs < 1:
            faults.append(Fault(f"{name}.{JOBS}", f"{jobs!r} must be a whole number of at least 1", str(path)))
    if faults:
        raise InputError(faults)
    ((queue, settings),) = tables.items()
    return queue, dict(settings)


if __name__ == "__main__":
    serve(int(sys.argv[1]))
