"""Three numbers in one: how exactly they come back, without bias, over the whole range of numbers."""

import math

import numpy as np
import pytest
from numba import njit

from thirdbody.kernels.packed_triple import pack_triple, unpack_triple


@njit(error_model="numpy")
def stored(numbers):
    """The numbers that rows of three become."""
    found = np.empty(numbers.shape[0])
    for k in range(len(found)):
        found[k] = pack_triple(numbers[k, 0], numbers[k, 1], numbers[k, 2])
    return found


@njit(error_model="numpy")
def recalled(ones):
    """Rows of three."""
    found = np.empty((ones.shape[0], 3))
    for k in range(ones.shape[0]):
        found[k] = unpack_triple(ones[k])
    return found


def rows(count: int) -> np.ndarray:
    """Rows of numbers from 1e-150 to 1e150, most of them of unlike size."""
    rng = np.random.default_rng(5)
    scale = 10.0 ** rng.uniform(-150.0, 150.0, (count, 1))
    return scale * rng.uniform(-1.0, 1.0, (count, 3)) * 10.0 ** rng.uniform(-6.0, 0.0, (count, 3))


def test_each_comes_back_to_a_part_in_65536_of_the_largest():
    numbers = rows(20_000)
    error = np.abs(recalled(stored(numbers)) - numbers).max(axis=1) / np.abs(numbers).max(axis=1)
    assert 2.0**-18 < error.max() <= 2.0**-16 * (1.0 + 2.0**-16)  # the largest may be next to the next power


def test_rounding_has_no_bias():
    numbers = np.random.default_rng(6).uniform(-1.0, 1.0, (200_000, 3))
    error = (recalled(stored(numbers)) - numbers) / np.abs(numbers).max(axis=1, keepdims=True)
    # the mean of 2e5 errors whose standard deviation is 2^-16/sqrt(12) or less: five times its own deviation
    assert np.abs((np.sign(numbers) * error).mean(axis=0)).max() < 5.0 * 2.0**-16 / math.sqrt(12.0 * len(numbers))


def test_what_comes_back_is_stored_as_itself():
    once = stored(rows(20_000))
    assert np.array_equal(stored(recalled(once)), once)


@pytest.mark.parametrize("largest", [1.0, 1.0 - 2.0**-53, 1.0 - 2.0**-17, 1.0 + 2.0**-52, 2.0**-900, 2.0**1022])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_largest_next_to_a_power_of_two(largest, sign):
    numbers = np.array([[sign * largest, -sign * largest, 0.25 * largest]])
    assert recalled(stored(numbers)) == pytest.approx(numbers, rel=2.0**-14)  # the smallest has two bits less


def test_nothing_is_nothing():
    assert np.array_equal(recalled(stored(np.zeros((1, 3)))), np.zeros((1, 3)))
    assert np.array_equal(recalled(np.zeros(1)), np.zeros((1, 3)))  # as in a contact that never touched
    assert np.array_equal(recalled(stored(np.full((1, 3), 1e-310))), np.zeros((1, 3)))


@pytest.mark.parametrize("bad", [math.inf, -math.inf])
@pytest.mark.parametrize("place", range(3))
def test_an_infinite_force_stays_visible(bad, place):
    numbers = np.array([[1.0, -2.0, 3.0]])
    numbers[0, place] = bad
    assert not np.isfinite(recalled(stored(numbers))).all()
