"""Our way through numba gives what numba's own gives: every function here is compiled by both."""

import itertools
import math

import numpy as np
from numba import njit

from thirdbody.jit.options import CHUNK, OPTIONS

NUMBERS = np.array([3.5, -1.0, 0.0, -0.0, math.nan, math.inf, 7.25, -2.5])


def uncached(options):
    return {key: value for key, value in options.items() if key != "cache"}


def ours(function):
    """Compiled as our kernels are: inside another, since inner kernels have no machine code of their own."""
    inner = njit(**CHUNK)(function)

    @njit(**uncached(OPTIONS))
    def outer(*arguments):
        return inner(*arguments)

    return outer


def written(table):
    total = table[0, -1] + 5.0 * table[-2, -3]
    for i in range(table.shape[0]):
        row = table[i]
        row[-1] += 1.0
        table[i, 0] = table[i, 1] - i
        total = 2.0 * total + table[-i, 1]
    short = table.reshape(table.size, 1)  # rows of length one, an index without a sign, numbers of four bytes
    for place in np.array([1, -1, 0], np.int32):
        total += short[place, 0] * (1 + place) + short[np.uint8(2), 0]
    return total, table.sum()


def test_tables_are_read_and_written_as_numba_does():
    table = np.random.default_rng(3).normal(size=(7, 4))
    mine, other = table.copy(), table.copy()
    assert ours(written)(mine) == njit(error_model="numpy")(written)(other)
    assert np.array_equal(mine, other)


def test_extremes_order_nan_and_signs_of_zero_as_python_does():
    def extremes(a, b):
        return max(a, b), min(a, b), max(a, b, 1.0), min(2, int(a) if math.isfinite(a) else 0)

    compiled = ours(extremes)
    for a, b in itertools.product(NUMBERS, NUMBERS):
        for mine, true in zip(compiled(a, b), extremes(a, b), strict=True):
            same = mine == true and math.copysign(1.0, mine) == math.copysign(1.0, true)
            assert same or (math.isnan(mine) and math.isnan(true)), (a, b)
