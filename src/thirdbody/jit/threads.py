"""Threads: pieces of work that Python deals out, and teams that divide the passes of a step within compiled code.

Not numba's `prange`: it deals equal parts in advance, wakes its threads for every pass, needs OpenMP or TBB where runs are made
in several threads, and compiles everything twice.

Pieces: compiled code releases the interpreter, and each thread of Python takes the next piece when it is ready.

A team divides each pass over some tables, thousands a second. The thread of the caller opens passes; helpers take part in them as
soon as they run, so that nobody waits for a thread to start. Each member first takes the parts that are its own, which it had in
the last pass, too: they may still be in its cache. Then it takes those of others. What a thread wrote before it stores or adds to
a word is seen by the thread that reads the new number.
"""

import itertools
import math
import os
import platform
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils

from thirdbody.jit.options import BARE
from thirdbody.jit.simd import code, memory_code

Piece = TypeVar("Piece")

PIECES, MIN_BODIES, WORTH = 8, 8, 64.0
"""Pieces per thread, so that none waits long for the last one; fewest bodies of a piece, which begins and ends in some 10 us, and
fewest trial steps, of 5 us each: threads start in 0.1 ms."""

WAITING = 1024  # most threads that wait for work; as many are started as work at the same time
LINE = 8  # words of a cache line: members must not write to the same one
DONE, DISMISSED = 0, LINE  # words of a team: how many parts of the pass are done; 1: no pass will follow
FIRST = 2 * LINE  # word of the first member: how many of its own parts are taken. Those of the next ones follow, a line each
CLOSED = 1 << 40  # such a number before the first pass is opened: more than there are parts
SPINS = 2000  # attempts before a waiting thread sleeps: some 50 us. Where every core has a thread, hardly one waits longer

_allowed = threading.local()


def max_threads() -> int:
    """Return the largest number of threads: one per core that this process may use, or NUMBA_NUM_THREADS."""
    return int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]


def allow_threads(number: int) -> None:
    _allowed.number = number


def allowed_threads() -> int:
    return getattr(_allowed, "number", None) or max_threads()


def parts_of(first: int, last: int, tries: float) -> list[tuple[int, int]]:
    return pieces_of(first, last, max(MIN_BODIES, math.ceil(WORTH / tries)))


def pieces_of(first: int, last: int, fewest: int) -> list[tuple[int, int]]:
    maximum = PIECES * allowed_threads() if allowed_threads() > 1 else 1
    number = max(1, min(maximum, (last - first) // fewest))
    edges = [first + k * (last - first) // number for k in range(number + 1)]
    return list(itertools.pairwise(edges))


def distribute(pieces: Sequence[Piece], make_worker: Callable[[], Callable[[Piece], None]]) -> None:
    """Pass each piece, in their order, to one of as many workers as there are threads for this run, made by `make_worker` with
    their scratch. Raises what a worker raises, after all have ended."""
    threads, left = min(allowed_threads(), len(pieces)), iter(pieces)

    def run() -> None:
        do = make_worker()
        for piece in left:  # the next one of a list is given to one thread only
            do(piece)

    with _at_work([_pool(os.getpid()).submit(run) for _ in range(1, threads)]):
        run()


@contextmanager
def helpers(members: int, team: np.ndarray, help_out: Callable[[int], None]) -> Iterator[None]:
    """Let the other members of a team help with the passes of this thread; `help_out(member)` returns once the team is
    dismissed."""
    team[FIRST::LINE], team[DISMISSED] = CLOSED, 0
    with _at_work([_pool(os.getpid()).submit(help_out, member) for member in range(1, members)]):
        try:
            yield
        finally:
            team[DISMISSED] = 1


@contextmanager
def _at_work(tasks: list[Any]) -> Iterator[None]:
    """Wait for the tasks at the end of the block, and raise what they raised."""
    try:
        yield
    finally:
        wait(tasks)
    for task in tasks:
        task.result()


@cache
def _pool(process: int) -> ThreadPoolExecutor:
    """Return the waiting threads of a process, started as they are needed: a fork has none of those of its parent."""
    return ThreadPoolExecutor(WAITING, "thirdbody")


# -- how many threads pay --

STARVED = 0.6
"""CPU time of all threads over wall time below which they mostly wait for a core; two threads on two cores reach 1.5 or more."""

MIN_MEASUREMENT = 0.02  # shortest wall time [s] of a measurement
SHORT = 1e-3  # wall time of a step [s] above which more threads are always faster: a single thread is not tried

PAUSE, LONGEST = 0.5, 8.0
"""Time [s] on one thread before all are tried again, doubled after each failed trial up to the longest; a single thread is tried
again after the longest, too."""


class ThreadTuner:
    """Chooses the number of threads of the step loop from the timings of its calls."""

    def __init__(self) -> None:
        self.until, self.pause = 0.0, PAUSE
        self.alone, self.tried = math.inf, -math.inf  # last trial of one thread: time per step [s], instant [s]
        self.used, self.steps, self.wall, self.busy = 0, 0, 0.0, 0.0  # present measurement: threads, steps, times

    def threads(self, allowed: int, now: float) -> int:
        """Return the number of threads to use at the instant `now` [s], at most `allowed`."""
        return 1 if now < self.until else allowed

    def note(self, threads: int, steps: int, wall: float, busy: float, now: float) -> None:
        """Record a call that ended at `now` [s]: number of threads and steps, wall time and CPU time [s]."""
        if threads != self.used:
            self.used, self.steps, self.wall, self.busy = threads, 0, 0.0, 0.0
        self.steps, self.wall, self.busy = self.steps + steps, self.wall + wall, self.busy + busy
        if self.wall < MIN_MEASUREMENT:
            return
        step, starved = self.wall / max(self.steps, 1), self.busy < STARVED * self.wall
        self.steps, self.wall, self.busy = 0, 0.0, 0.0
        if threads == 1:
            self.alone, self.tried = step, now
        elif starved or step > self.alone:
            self.until, self.pause = now + self.pause, min(2.0 * self.pause, LONGEST)
        else:
            self.pause = PAUSE
            if step < SHORT and now - self.tried > LONGEST:
                self.until = now + MIN_MEASUREMENT


# -- a team --


def words_of(members: int) -> int:
    return FIRST + LINE * members


_INT = ir.IntType(32)


@memory_code(1, types.int64)
def load_word(builder: Any, pointer: Any) -> Any:
    return builder.load_atomic(pointer, "acquire", 8)


@memory_code(1, types.void, types.int64)
def store_word(builder: Any, pointer: Any, value: Any) -> None:
    builder.store_atomic(value, pointer, "release", 8)


@memory_code(1, types.int64)
def count_up(builder: Any, pointer: Any) -> Any:
    """Add 1 to a word and return its value before."""
    return builder.atomic_rmw("add", pointer, ir.IntType(64)(1), "acq_rel")


def _call(builder: Any, result: Any, name: str, *given: int) -> None:
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(result, [_INT] * len(given)), name)
    builder.call(function, [_INT(one) for one in given])


@code(types.void())
def pause(builder: Any) -> None:
    """Let the core do something else for some 40 cycles, by LLVM's name for the instruction; other processors go on at once."""
    machine = platform.machine().lower()
    if machine in ("aarch64", "arm64"):
        _call(builder, ir.VoidType(), "llvm.aarch64.hint", 1)
    elif machine in ("x86_64", "amd64"):
        _call(builder, ir.VoidType(), "llvm.x86.sse2.pause")


@code(types.void())
def sleep(builder: Any) -> None:
    if os.name == "nt":
        _call(builder, _INT, "Sleep", 1)
    else:
        _call(builder, _INT, "usleep", 20)


@njit(**BARE)
def open_pass(words, members):
    """Offer the parts of the next pass to all members, after all of the last one are done."""
    store_word(words, DONE, 0)
    for member in range(members):
        store_word(words, FIRST + LINE * member, 0)


@njit(**BARE)
def next_part(words, member, members, parts):
    """Return the next of the parts of this pass for a member, now its own to do; -1: all are taken."""
    for k in range(members):
        owner = (member + k) % members
        first, last = owner * parts // members, (owner + 1) * parts // members
        # counted only where some are left: counting takes the line from the other cores
        if load_word(words, FIRST + LINE * owner) < last - first:
            part = first + count_up(words, FIRST + LINE * owner)
            if part < last:
                return part
    return -1


@njit(**BARE)
def wait_again(attempts):
    if attempts < SPINS:
        pause()
    else:
        sleep()
    return attempts + 1


@njit(**BARE)
def close_pass(words, parts):
    attempts = 0
    while load_word(words, DONE) < parts:
        attempts = wait_again(attempts)
