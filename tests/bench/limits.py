"""What one core of this machine can do: the limits against which a pass of the engine is judged.

    python tests/bench/limits.py

Bandwidth of a triad by the size of its working set, and what two cores get through of it that each have a set of that size;
vector products and sums, square roots and divisions, and random reads of rows of 32 bytes, which is what a contact does that
looks up its partner. Best of several timings: a limit is what is reached undisturbed.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numba import njit
from rich.console import Console
from rich.table import Table
from screen import screen

SIZES = (24, 256, 1024, 4096, 16384, 262144)
"""Working sets of the triad, KiB: the last is far beyond any cache."""

ROWS = (1_000, 16_000, 64_000, 256_000, 2_000_000)
"""Rows of the tables that are read at random."""

TRIES, READS, LANES = 7, 1_000_000, 2048

CHAINS, LINKS = 4, 8
"""Products and sums that wait for each other, and such chains side by side, so that none waits: of one element."""

kernel = njit(error_model="numpy", nogil=True)  # as the engine's: IEEE, no exception for a division by zero


@kernel
def triad(a, b, c, factor, repeats):
    """a = b + factor c, again and again."""
    for _ in range(repeats):
        for i in range(a.shape[0]):
            a[i] = b[i] + factor * c[i]
        factor *= 1.0000001  # else the compiler does it once


@kernel
def chains(a, b, repeats):
    """a = a sum of four polynomials of b, a product and a sum a power."""
    for _ in range(repeats):
        for i in range(a.shape[0]):
            x = b[i]
            p, q, r, s = x, x + 1.0, x + 2.0, x + 3.0
            for _ in range(LINKS):
                p, q, r, s = p * x + 0.1, q * x + 0.2, r * x + 0.3, s * x + 0.4
            a[i] = (p + q) + (r + s)


@kernel
def roots(a, b, repeats):
    """a = sqrt(b)."""
    for _ in range(repeats):
        for i in range(a.shape[0]):
            a[i] = np.sqrt(b[i])


@kernel
def divisions(a, b, repeats):
    """a = 1.7/b."""
    for _ in range(repeats):
        for i in range(a.shape[0]):
            a[i] = 1.7 / b[i]


@kernel
def reads(table, rows):
    """Something of each of these rows."""
    total = 0.0
    for row in rows:
        total += table[row, 0] * table[row, 1] + table[row, 2] * table[row, 3]
    return total


def measure_limits() -> dict[str, Any]:
    """Triad by KiB of its working set (24 bytes per element), two cores over one in that, products and sums, sqrt and division
    per element, random reads by rows of a table."""
    rng = np.random.default_rng(1)
    out, values = np.empty(LANES), rng.uniform(0.5, 1.5, LANES)
    repeats = 1000
    per_lane = 1e9 / (repeats * LANES)
    return {
        "bandwidth_GB_s": {size: _bandwidth(size) for size in SIZES},
        "two_cores_over_one": {size: _two_over_one(size) for size in SIZES},
        "arithmetic_GF_s": (2 * CHAINS * LINKS + 6) / (per_lane * best(chains, out, values, repeats)),
        "sqrt_ns": per_lane * best(roots, out, values, repeats),
        "division_ns": per_lane * best(divisions, out, values, repeats),
        "read_ns": {rows: _read(rng, rows) for rows in ROWS},
    }


def _bandwidth(kibibytes: int) -> float:
    """GB/s of a triad over three arrays of this size together."""
    arrays, repeats = _arrays(kibibytes)
    return 24e-9 * arrays[0].size * repeats / best(triad, *arrays, 2.0, repeats)


def _arrays(kibibytes: int) -> tuple[list[np.ndarray], int]:
    """Three arrays that take so much together, and how often to go through them to have something to time."""
    n = kibibytes * 1024 // 24
    return [np.ones(n) for _ in range(3)], max(1, int(4e9 / (24 * n)))


def _two_over_one(kibibytes: int) -> float:
    """What two triads at a time get through, each over arrays of its own, in terms of what one gets through alone."""
    (one, repeats), (other, _) = _arrays(kibibytes), _arrays(kibibytes)
    alone = best(triad, *one, 2.0, repeats)
    with ThreadPoolExecutor(2) as pool:

        def both() -> None:
            for half in [pool.submit(triad, *arrays, 2.0, repeats) for arrays in (one, other)]:
                half.result()

        return 2.0 * alone / best(both)


def _read(rng: np.random.Generator, rows: int) -> float:
    """ns per random read from a table of so many rows of 32 bytes."""
    table = rng.uniform(0.0, 1.0, (rows, 4))
    return 1e9 / READS * best(reads, table, rng.integers(0, rows, READS))


def best(function: Callable, *arguments: Any) -> float:
    """Seconds of the fastest call."""
    function(*arguments)  # compiles
    seconds = []
    for _ in range(TRIES):
        started = time.perf_counter()
        function(*arguments)
        seconds.append(time.perf_counter() - started)
    return min(seconds)


def print_limits(report: dict[str, Any], console: Console) -> None:
    """The limits as two tables."""
    wide = Table("working set", "triad", "two cores over one", title="bandwidth of one core")
    for size, rate in report["bandwidth_GB_s"].items():
        wide.add_row(f"{size} KiB", f"{rate:.1f} GB/s", f"{report['two_cores_over_one'][size]:.2f}")
    single = Table("operation", "ns", title="one core, per element")
    single.add_row("vector product or sum", f"{1.0 / report['arithmetic_GF_s']:.4f}")
    single.add_row("vector sqrt", f"{report['sqrt_ns']:.3f}")
    single.add_row("vector division", f"{report['division_ns']:.3f}")
    for rows, cost in report["read_ns"].items():
        single.add_row(f"random read of 32 bytes among {rows} rows", f"{cost:.2f}")
    console.print(wide)
    console.print(single)


if __name__ == "__main__":
    print_limits(measure_limits(), screen())
