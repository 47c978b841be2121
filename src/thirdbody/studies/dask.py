"""Points on Dask: of a scheduler at an address, or of a cluster whose workers are jobs of a queue (SLURM, PBS and others).

Dask is imported only where it is used; `pip install "thirdbody[cluster]"` brings it. A Dask worker that computed points itself
could not answer its scheduler while compiled code runs, would end with a point that crashes, and must not run compiled loops in
several threads. So each thread of a worker has a process, which ends with the worker.
"""

from __future__ import annotations

import logging
import threading
import tomllib
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from inspect import signature
from pathlib import Path
from typing import Any

from thirdbody.errors import Fault, InputError, MissingLibrary, UsageError, nearest
from thirdbody.studies.workers import LocalWorkers

ANSWER = 4.0
"""Longest wait [s] for a scheduler to answer."""

QUEUES = {
    "slurm": "SLURMCluster", "pbs": "PBSCluster", "sge": "SGECluster", "lsf": "LSFCluster", "moab": "MoabCluster",
    "oar": "OARCluster", "htcondor": "HTCondorCluster",
}  # fmt: skip
"""Classes of dask-jobqueue by the name of their table in a cluster file."""

JOBS = "jobs"
"""Key of the number of jobs; all other keys are arguments of the class."""

OF_CLUSTER = ("host", "interface", "protocol", "scheduler_options", "silence_logs", "shared_temp_directory")
"""Arguments of the cluster itself, not of its jobs."""


_own = threading.local()
"""The process of each thread of this Dask worker."""


class DaskPoints:
    """Executor on a Dask client. A call whose worker dies is repeated elsewhere: points are idempotent."""

    def __init__(self, client: Any) -> None:
        self._executor = client.get_executor(pure=False)

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        """Return the future of `function(*arguments, stop)` in a process of a Dask worker."""
        future: Future[Any] = self._executor.submit(in_process, function, *arguments)
        return future


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
    if cluster is not None and settings is not None:
        with _started(cluster, *settings) as jobs, distributed.Client(jobs, timeout=ANSWER) as client:
            yield client
        return
    try:
        client = distributed.Client(address, timeout=ANSWER)
    except (OSError, ValueError, TimeoutError) as error:
        raise UsageError(f"--dask {address}: no scheduler answers there ({error})") from error
    with client:
        yield client


def _started(path: Path, queue: str, settings: dict[str, Any]) -> Any:
    """Return the cluster with its jobs submitted, as a context. Raises InputError and MissingLibrary."""
    try:
        import dask_jobqueue
    except ImportError as error:
        raise MissingLibrary('a cluster file needs dask-jobqueue: pip install "thirdbody[cluster]"') from error
    kind = getattr(dask_jobqueue, QUEUES[queue])
    known = set(OF_CLUSTER)  # and the arguments of its jobs
    for job in kind.job_cls.__mro__[:-1]:
        known |= set(signature(job.__init__).parameters)
    known -= {"self", "scheduler", "name", "base_class_kwargs", "config_name"}
    faults = [
        Fault(f"{queue}.{key}", f"is no argument of {kind.__name__}, {nearest(key, known)}", str(path))
        for key in settings
        if key != JOBS and key not in known
    ]
    if faults:
        raise InputError(faults)
    jobs = settings.pop(JOBS, 1)
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
