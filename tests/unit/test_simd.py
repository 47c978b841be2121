"""Four numbers at once: every function has the bits of numpy's arithmetic number by number."""

import itertools

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from thirdbody.jit.simd import (
    active_bits,
    all_below,
    axis_times_quaternion,
    broadcast,
    broadcast_lane,
    clamp_below,
    compress_store,
    extract,
    flush_below,
    get,
    less_mask,
    load,
    put,
    round_to_nearest,
    select_greater,
    set4,
    store,
    with_last,
)
from thirdbody.jit.simd import cross as crossed
from thirdbody.jit.simd import transpose as transposed

LANES = range(4)
SMALLEST, LARGEST_DENORMAL = 5e-324, 2.2250738585072009e-308
ODD = [0.0, -0.0, np.inf, -np.inf, np.nan, SMALLEST, -SMALLEST, LARGEST_DENORMAL, -LARGEST_DENORMAL, 1e-60, -1e-60,
       np.nextafter(1e-60, 1.0), np.nextafter(-1e-60, -1.0), 1.0, -1e308, -np.nan]  # fmt: skip


def numbers(rows: int, seed: int, reach: float = 150.0) -> np.ndarray:
    """Random numbers of all sizes between 10^-reach and 10^reach, (rows, 4)."""
    rng = np.random.default_rng(seed)
    return rng.choice([-1.0, 1.0], (rows, 4)) * rng.uniform(1.0, 10.0, (rows, 4)) * 10.0 ** rng.uniform(-reach, reach, (rows, 4))


def alike(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two arrays have the same bits, so that -0 is not 0 and what is not a number is the same."""
    return one.shape == other.shape and np.array_equal(one.view(np.uint64), other.view(np.uint64))


@njit(error_model="numpy")
def arithmetic(A, B, out):
    for i in range(A.shape[0]):
        a, b = load(A, i, 0), load(B, i, 0)
        store(out[0], i, 0, a + b)
        store(out[1], i, 0, a - b)
        store(out[2], i, 0, a * b)
        store(out[3], i, 0, crossed(a, b))


@njit(error_model="numpy")
def fused(A, B, C, out):
    for i in range(A.shape[0]):
        store(out[0], i, 0, load(A, i, 0) + load(B, i, 0) * load(C, i, 0))
        store(out[1], i, 0, load(A, i, 0) * load(B, i, 0) - load(C, i, 0))


@njit(error_model="numpy")
def lanes(A, B, out):
    for i in range(A.shape[0]):
        a, b = load(A, i, 0), load(B, i, 0)
        store(out[0], i, 0, broadcast_lane(a, 0))
        store(out[1], i, 0, broadcast_lane(a, 1))
        store(out[2], i, 0, broadcast_lane(a, 2))
        store(out[3], i, 0, broadcast_lane(a, 3))
        store(out[4], i, 0, set4(extract(b, 3), extract(a, 2), extract(b, 1), extract(a, 0)))
        store(out[5], i, 0, with_last(a, b))
        store(out[6], i, 0, broadcast(B[i, 2]))
        store(out[7], i, 0, axis_times_quaternion(a, 0))
        store(out[8], i, 0, axis_times_quaternion(a, 1))
        store(out[9], i, 0, axis_times_quaternion(a, 2))


@njit(error_model="numpy")
def turned_over(A, out):
    for i in range(0, A.shape[0], 4):
        columns = transposed(load(A, i, 0), load(A, i + 1, 0), load(A, i + 2, 0), load(A, i + 3, 0))
        store(out, i, 0, columns[0])
        store(out, i + 1, 0, columns[1])
        store(out, i + 2, 0, columns[2])
        store(out, i + 3, 0, columns[3])


@njit(error_model="numpy")
def cut_off(A, least, out):
    for i in range(A.shape[0]):
        store(out, i, 0, flush_below(load(A, i, 0), least))


@njit(error_model="numpy")
def compared(A, B, least, out, bits, whole):
    for i in range(A.shape[0]):
        a, b = load(A, i, 0), load(B, i, 0)
        store(out[0], i, 0, clamp_below(a, least))
        store(out[1], i, 0, round_to_nearest(a))
        store(out[2], i, 0, select_greater(a, b, a, b))
        store(out[3], i, 0, a / b)
        bits[i], whole[i] = less_mask(a, b), all_below(a, least)


@njit(error_model="numpy")
def sorted_out(A, closed, some, opened):
    m, o = 0, 0
    for k in range(0, A.shape[0], 4):
        bits = active_bits(get(A, k), closed, k)
        m += compress_store(some, m, k, bits & 15)
        o += compress_store(opened, o, k, bits >> 4)
    return m, o


@njit(error_model="numpy")
def moved(A, rows, first, to, out):
    for k in range(rows.shape[0]):
        store(out, k, to, load(A, np.uint64(rows[k]), first))


@njit(error_model="numpy")
def moved_along(row, first, to, out):
    put(out, to, get(row, first))


def test_arithmetic_has_the_bits_of_numpy():
    a, b = numbers(400, 1), numbers(400, 2)
    a[:300] *= np.abs(b[:300] / a[:300])  # of like size, so that both have a say in a sum
    a[:100, 1], b[50:150, 2], a[0] = 0.0, -0.0, -b[0]
    out = np.full((4, *a.shape), np.nan)
    arithmetic(a, b, out)
    x, y = a[:, :3], b[:, :3]
    cross = x[:, [1, 2, 0]] * y[:, [2, 0, 1]] - x[:, [2, 0, 1]] * y[:, [1, 2, 0]]
    assert all(alike(found, expected) for found, expected in zip(out[:3], (a + b, a - b, a * b), strict=True))
    assert alike(np.ascontiguousarray(out[3, :, :3]), cross)
    assert np.all(out[3, :, 3] == 0.0)  # what stands behind a vector stays nothing


def test_a_product_and_a_sum_are_rounded_one_by_one():
    """A processor can do both with one rounding: other bits, and not on every machine."""
    a, b, c = numbers(400, 3, 2.0), numbers(400, 4, 2.0), numbers(400, 5, 2.0)
    out = np.empty((2, *a.shape))
    fused(a, b, c, out)
    assert alike(out[0], a + b * c) and alike(out[1], a * b - c)


def test_numbers_go_where_they_are_sent():
    a, b = numbers(40, 6), numbers(40, 7)
    a[3], b[4] = ODD[:4], ODD[3:7]
    out = np.full((10, *a.shape), 7.0)
    lanes(a, b, out)
    for k in LANES:
        assert alike(out[k], np.repeat(a[:, k : k + 1], 4, axis=1))
    assert alike(out[4], np.column_stack((b[:, 3], a[:, 2], b[:, 1], a[:, 0])))
    assert alike(out[5], np.column_stack((a[:, :3], b[:, 3])))
    assert alike(out[6], np.repeat(b[:, 2:3], 4, axis=1))
    w, x, y, z = a.T  # i, j and k times the quaternion w + x i + y j + z k
    assert alike(out[7], np.column_stack((-x, w, -z, y)))
    assert alike(out[8], np.column_stack((-y, z, w, -x)))
    assert alike(out[9], np.column_stack((-z, -y, x, w)))


def test_rows_become_columns():
    a = numbers(40, 8)
    a[:4] = np.reshape(ODD, (4, 4))
    out = np.empty_like(a)
    turned_over(a, out)
    assert alike(out, np.ascontiguousarray(a.reshape(10, 4, 4).transpose(0, 2, 1)).reshape(40, 4))


@pytest.mark.parametrize("least", [0.0, SMALLEST, 1e-60, 1e-300, 1.0, np.inf])
def test_what_is_too_small_is_zero_and_no_number_is_hidden(least):
    a = np.vstack((np.reshape(ODD, (4, 4)), numbers(40, 9, 90.0)))
    out = np.empty_like(a)
    cut_off(a, least, out)
    assert alike(out, np.where(np.abs(a) <= least, 0.0, a))
    assert np.array_equal(np.isnan(out), np.isnan(a)) and np.isnan(out).sum() == 2
    assert not np.any(np.signbit(out[out == 0.0]))


def test_numbers_are_compared_and_rounded_as_numpy_does():
    halves = np.arange(-20.0, 20.0).reshape(10, 4) / 2.0
    a = np.vstack((np.reshape(ODD, (4, 4)), numbers(40, 10, 3.0), halves))
    b = a[::-1].copy()
    b[20:30] = a[20:30]  # none below
    out, bits, whole = np.empty((4, *a.shape)), np.empty(len(a), np.int64), np.empty(len(a), np.bool_)
    compared(a, b, 1e-300, out, bits, whole)
    assert alike(out[0], np.where(a < 1e-300, 1e-300, a)) and alike(out[1], np.rint(a))
    assert np.array_equal(bits, (a < b) @ [1, 2, 4, 8]) and bits.any() and len(set(bits)) > 8
    assert np.array_equal(whole, (a < 1e-300).all(axis=1)) and whole.any() and not whole.all()
    assert alike(out[2], np.where(a > b, a, b))
    with np.errstate(all="ignore"):
        assert alike(out[3], a / b)


def test_positive_numbers_are_listed_with_those_that_were_before():
    """All 16 patterns of what is positive now, by all of what was: open or closed."""
    now = np.array(list(itertools.product((1.0, -1.0), repeat=4)))
    was = np.array(list(itertools.product((0, 1), repeat=4)))
    a, closed = np.repeat(now, len(was), axis=0).ravel(), np.tile(was, (len(now), 1)).ravel().astype(np.int8)
    a[::7] = np.where(a[::7] > 0.0, a[::7], np.nan)
    before, some, opened = closed.copy(), np.empty(a.size + 4, np.int32), np.empty(a.size + 4, np.int32)
    m, o = sorted_out(a, closed, some, opened)
    on = a > 0.0
    assert np.array_equal(some[:m], np.flatnonzero(on)) and np.array_equal(opened[:o], np.flatnonzero(~on & (before != 0)))
    assert np.array_equal(closed, on)


@pytest.mark.parametrize("first", [0, 1, 5])
@pytest.mark.parametrize("to", [0, 3])
def test_a_table_is_read_and_written_at_any_column(first, to):
    table = numbers(27, 10).reshape(12, 9)
    rows = np.array([11, 0, 4, 4, 7])
    out = np.full((5, 8), 7.0)
    moved(table, rows, first, to, out)
    expected = np.full((5, 8), 7.0)
    expected[:, to : to + 4] = table[rows, first : first + 4]
    assert alike(out, expected)
    row = np.full(8, 7.0)
    moved_along(table[3], first, to, row)
    expected = np.full(8, 7.0)
    expected[to : to + 4] = table[3, first : first + 4]
    assert alike(row, expected)


def test_a_lane_is_a_literal_from_zero_to_three():
    @njit
    def behind(A):
        return extract(load(A, 0, 0), 4)

    @njit
    def unknown(A, k):
        return extract(load(A, 0, 0), k)

    with pytest.raises(TypingError, match="from 0 to 3"):
        behind(np.zeros((1, 4)))
    with pytest.raises(TypingError, match="from 0 to 3"):
        unknown(np.zeros((1, 4)), 1)
