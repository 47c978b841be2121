"""Scratch arrays on the stack of a compiled function."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from thirdbody.jit.stack_array import stack_array

SIZE = 1000


@njit
def sums(n):
    """Sums of two arrays that are written in turn, once per round."""
    total = np.zeros(n)
    for i in range(n):
        a, b = stack_array(SIZE), stack_array(SIZE)
        for k in range(SIZE):
            a[k], b[k] = i, 2 * i
        total[i] = a.sum() + b.sum()
    return total


def test_arrays_are_apart_and_of_one_place():
    """A million rounds of 16 kB would overflow any stack if every round took its own."""
    assert np.array_equal(sums(5), 3.0 * SIZE * np.arange(5))
    assert sums(1_000_000)[-1] == 3.0 * SIZE * 999_999


def test_a_size_that_is_not_known_when_compiling_is_refused():
    @njit
    def scratch(n):
        return stack_array(n)[0]

    with pytest.raises(TypingError):
        scratch(3)
