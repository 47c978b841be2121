"""Our way through numba gives what numba's own gives: every function here is compiled by both."""

import itertools
import math
from collections import namedtuple

import numpy as np
import pytest
from numba import njit, prange, types
from numba.core.runtime import _nrt_python, rtsys

from thirdbody.jit.options import CHUNK, NO_COUNTS, OPTIONS
from thirdbody.jit.packed_arguments import argument_specs, make_unpacker, pack

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


def stepped(table):
    # loops of any step and bound, of numbers of any width, left and gone on with
    total, n = 0.0, table.shape[0]
    a, b = table[0, 0], table[0, 1]
    for i in range(n):  # `kept` has one definition, in a branch that is not always taken
        if table[i, 0] > 0.0:
            kept = table[i, 1]
            total += kept
        elif i > 3:
            total -= kept
    for start in range(-2, 3):
        for k in range(start, n, 2):
            total = 2.0 * total + k
            a, b = b, a + table[k, 0]
        for k in range(n, start, -3):
            total = 2.0 * total - k
            if k == 4:
                continue
        for _ in range(n - start, n):
            total *= 1.25
        for k in range(start, start + 7, n):
            total += k
            if total > 1e6:
                break
        for k in range(np.int32(start), np.int32(5)):
            total += k
    return total, k, a, b


@pytest.mark.parametrize("function", [written, stepped])
def test_tables_are_read_and_written_as_numba_does(function):
    table = np.random.default_rng(3).normal(size=(7, 4))
    mine, other = table.copy(), table.copy()
    assert ours(function)(mine) == njit(error_model="numpy")(function)(other)
    assert np.array_equal(mine, other)


def test_extremes_order_nan_and_signs_of_zero_as_python_does():
    def extremes(a, b):
        return max(a, b), min(a, b), max(a, b, 1.0), min(2, int(a) if math.isfinite(a) else 0)

    compiled = ours(extremes)
    for a, b in itertools.product(NUMBERS, NUMBERS):
        for mine, true in zip(compiled(a, b), extremes(a, b), strict=True):
            same = mine == true and math.copysign(1.0, mine) == math.copysign(1.0, true)
            assert same or (math.isnan(mine) and math.isnan(true)), (a, b)


def test_references_are_counted():
    # arrays that a kernel makes, hands on and drops: none is lost, none is freed twice
    def kept(count):
        room, part = np.zeros(3), np.zeros(1)
        for k in range(count):
            fresh = np.full(3, float(k))
            if k == 5:
                part = fresh[:2]
                continue
            for j in range(k):
                both = (fresh, room)
                if j == 3:
                    room = both[0]
                    break
            fresh[0] = room[1]
        if count > 5:
            return fresh, part
        return room, part

    compiled = ours(kept)
    for _ in range(50):
        whole, part = compiled(8)
        assert list(whole) == [7.0, 7.0, 7.0] and list(part) == [5.0, 5.0]
        assert list(compiled(0)[0]) == [0.0, 0.0, 0.0]
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    for _ in range(10):
        compiled(8)
    after = rtsys.get_allocation_stats()
    assert after.alloc - before.alloc == after.free - before.free > 0
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free > 0


def test_parallel_loops_are_shared_out():
    def shared(found):
        for k in prange(found.shape[0]):
            found[k] = k

    found = np.zeros(64)
    compiled = njit(parallel=True, **uncached(OPTIONS))(shared)
    compiled(found)
    assert list(found) == list(range(64))
    (made,) = compiled.overloads.values()
    assert len(made.metadata["parfor_diagnostics"].initial_parfors) == 1  # a missing pass is told by nothing but the clock


def test_a_context_describes_tables_and_numbers():
    kinds = {"table": types.Array(types.float64, 2, "C"), "places": types.Array(types.int32, 1, "C"), "number": types.int64}
    names = namedtuple("names", tuple(kinds))
    context_of = make_unpacker(kinds, names)

    @njit(types.float64(types.Array(types.int64, 1, "C")), error_model="numpy", **NO_COUNTS)
    def total(context):
        found = context_of(context)
        found.table[1, 0] = 5.0
        return found.table[1, 2] + found.places[1] + found.number + found.table.shape[0] * 100.0 + found.table.size * 1000.0

    table, places = np.arange(6.0).reshape(2, 3), np.array([7, 8], np.int32)
    given = names(table, places, 9)
    assert total(pack(argument_specs(kinds), given)) == 5.0 + 8.0 + 9.0 + 200.0 + 6000.0
    assert table[1, 0] == 5.0
    for wrong in (given._replace(places=places.astype(np.int64)), given._replace(table=table.T), given._replace(table=places)):
        with pytest.raises(TypeError, match="the step takes"):
            pack(argument_specs(kinds), wrong)
