"""Work that is shared between threads, by compiled code that releases the interpreter.

Not numba's `prange`: it deals equal parts in advance, and only of what is inside compiled code. Here each thread takes the next
piece when it is ready, so that pieces of different cost, and what Python does between them, keep all cores at work.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numba

Piece = TypeVar("Piece")

PIECES, FEWEST, WORTH = 8, 8, 64.0
"""Pieces per thread, so that none waits long for the last one; fewest bodies of a piece, which begins and ends in some 10 us, and
fewest trial steps, of 5 us each: threads start in 0.1 ms."""


def parts_of(first: int, last: int, tries: float) -> list[tuple[int, int]]:
    """Return the ranges of bodies into which `first` to `last` - 1 are divided for the threads of this run.

    `tries`: trial steps of each of them, at most.
    """
    size = max(FEWEST, math.ceil(WORTH / tries), (last - first) // (PIECES * numba.get_num_threads()))
    return [(low, min(low + size, last)) for low in range(first, last, size)]


def distribute(pieces: Sequence[Piece], make_worker: Callable[[], Callable[[Piece], None]]) -> None:
    """Pass each piece, in their order, to one of as many workers as there are threads for this run.

    `make_worker`: makes the worker of a thread, with its scratch. Raises what a worker raises, after all have ended.
    """
    threads, left = min(numba.get_num_threads(), len(pieces)), iter(pieces)

    def work() -> None:
        do = make_worker()
        for piece in left:  # the next one of a list is given to one thread only
            do(piece)

    if threads <= 1:
        work()
        return
    with ThreadPoolExecutor(threads) as pool:
        tasks = [pool.submit(work) for _ in range(threads)]
    for task in tasks:
        task.result()
