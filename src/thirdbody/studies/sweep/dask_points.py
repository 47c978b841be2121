"""Points of a sweep on the workers of Dask, each in a process of its own.

A Dask worker that computed points itself could not answer its scheduler while compiled code runs, would end with a point that
crashes, and must not run compiled loops in several threads. So each thread of a worker has a process, which ends with the worker.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from thirdbody.studies.sweep.local_workers import LocalWorkers

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
