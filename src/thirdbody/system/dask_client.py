"""Clients of Dask: of a scheduler at an address, or of a cluster whose workers are jobs of a queue (SLURM, PBS and others).

Dask is imported only where it is used; `pip install "thirdbody[cluster]"` brings it.
"""

from __future__ import annotations

import logging
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from thirdbody.errors import Fault, InputError, MissingLibrary, UsageError, nearest

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


@contextmanager
def dask_client(address: str | None, cluster: Path | None) -> Iterator[Any]:
    """Yield the client of a scheduler's address, or of a cluster that is started by its file; None without both.

    Raises UsageError, InputError and MissingLibrary. Jobs of a cluster end with the block.
    """
    if address is not None and cluster is not None:
        raise UsageError("give --dask or --cluster, not both")
    if address is not None:
        with _connected(address) as client:
            yield client
    elif cluster is not None:
        with _started(cluster) as client:
            yield client
    else:
        yield None


def is_dask_client(executor: object) -> bool:
    """Return whether it is a client of Dask, without importing Dask."""
    return any(kind.__module__ == "distributed.client" and kind.__name__ == "Client" for kind in type(executor).__mro__)


def _distributed() -> Any:
    """Return the module. Raises MissingLibrary."""
    try:
        import distributed
    except ImportError as error:
        raise MissingLibrary('this needs Dask: pip install "thirdbody[cluster]"') from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # connections that are lost are our own messages
    return distributed


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=ANSWER)
    except (OSError, ValueError, TimeoutError) as error:
        raise UsageError(f"--dask {address}: no scheduler answers there ({error})") from error
    with client:
        yield client


@contextmanager
def _started(path: Path) -> Iterator[Any]:
    queue, settings = read_cluster(path)
    distributed = _distributed()
    kind = _cluster_class(queue)
    faults = [
        Fault(f"{queue}.{key}", f"is no argument of {kind.__name__}, {nearest(key, _arguments(kind))}", str(path))
        for key in settings
        if key != JOBS and key not in _arguments(kind)
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
    with cluster, distributed.Client(cluster, timeout=ANSWER) as client:
        yield client


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


def _cluster_class(queue: str) -> Any:
    try:
        import dask_jobqueue
    except ImportError as error:
        raise MissingLibrary('a cluster file needs dask-jobqueue: pip install "thirdbody[cluster]"') from error
    return getattr(dask_jobqueue, QUEUES[queue])


def _arguments(kind: Any) -> set[str]:
    """Return the names of the arguments of a class of clusters, those of its jobs included."""
    from inspect import signature

    names = set(OF_CLUSTER)
    for job in kind.job_cls.__mro__[:-1]:
        names |= set(signature(job.__init__).parameters)
    return names - {"self", "scheduler", "name", "base_class_kwargs", "config_name"}
