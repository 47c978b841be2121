"""Work that is divided among threads of Python, by compiled code that releases the interpreter.

Not numba's `prange`: it deals equal parts in advance, and only of what is inside compiled code; it needs OpenMP or TBB where runs
are made in several threads; and it compiles everything twice. Here each thread takes the next piece when it is ready, so that
pieces of different cost, and what Python does between them, keep all cores at work. Passes of a step, thousands a second, are
divided by a team (`jit.team`).
"""

import itertools
import math
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

import numba
import numpy as np

from thirdbody.jit.team import CLOSED, DISMISSED, FIRST, LINE

Piece = TypeVar("Piece")

PIECES, FEWEST, WORTH = 8, 8, 64.0
"""Pieces per thread, so that none waits long for the last one; fewest bodies of a piece, which begins and ends in some 10 us, and
fewest trial steps, of 5 us each: threads start in 0.1 ms."""

WAITING = 1024
"""Most threads that wait for work; as many are started as work at the same time."""

_allowed = threading.local()


def max_threads() -> int:
    """Return the largest number of threads: one per core that this process may use, or NUMBA_NUM_THREADS."""
    return int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]


def allow_threads(number: int) -> None:
    """Set the number of threads of runs that this thread makes."""
    _allowed.number = number


def allowed_threads() -> int:
    """Return the number of threads of runs that this thread makes: at first the largest one."""
    return getattr(_allowed, "number", None) or max_threads()


def parts_of(first: int, last: int, tries: float) -> list[tuple[int, int]]:
    """Return the ranges of bodies into which `first` to `last` - 1 are divided for the threads of this run.

    `tries`: trial steps of each of them, at most.
    """
    return pieces_of(first, last, max(FEWEST, math.ceil(WORTH / tries)))


def pieces_of(first: int, last: int, fewest: int) -> list[tuple[int, int]]:
    """Return the ranges into which `first` to `last` - 1 are divided for the threads of this run, of at least `fewest` each."""
    maximum = PIECES * allowed_threads() if allowed_threads() > 1 else 1
    number = max(1, min(maximum, (last - first) // fewest))
    edges = [first + k * (last - first) // number for k in range(number + 1)]
    return list(itertools.pairwise(edges))


def distribute(pieces: Sequence[Piece], make_worker: Callable[[], Callable[[Piece], None]]) -> None:
    """Pass each piece, in their order, to one of as many workers as there are threads for this run.

    `make_worker`: makes the worker of a thread, with its scratch. Raises what a worker raises, after all have ended.
    """
    threads, left = min(allowed_threads(), len(pieces)), iter(pieces)

    def work() -> None:
        do = make_worker()
        for piece in left:  # the next one of a list is given to one thread only
            do(piece)

    tasks = [_pool().submit(work) for _ in range(1, threads)]
    try:
        work()
    finally:
        wait(tasks)
    for task in tasks:
        task.result()


@contextmanager
def helpers(members: int, team: np.ndarray, help_out: Callable[[int], None]) -> Iterator[None]:
    """Let the other members of a team (`jit.team`) help with the passes that this thread opens within the block.

    `help_out(member)` returns once the team is dismissed.
    """
    team[FIRST::LINE], team[DISMISSED] = CLOSED, 0
    tasks = [_pool().submit(help_out, member) for member in range(1, members)]
    try:
        yield
    finally:
        team[DISMISSED] = 1
        wait(tasks)
    for task in tasks:
        task.result()


def _pool() -> ThreadPoolExecutor:
    """Return the waiting threads of this process, which are started as they are needed."""
    return _pool_of(os.getpid())


@cache
def _pool_of(process: int) -> ThreadPoolExecutor:
    """Return the threads of a process: a fork has none of those of its parent."""
    return ThreadPoolExecutor(WAITING, "thirdbody")
