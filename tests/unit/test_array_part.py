"""Parts of arrays of constant size."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from thirdbody.jit.array_part import array_part
from thirdbody.jit.options import OPTIONS

SIZE = 3


@njit
def doubled(array, first):
    """Double a part of an array in place; return its size."""
    part = array_part(SIZE, array, first)
    for i in range(len(part)):
        part[i] *= 2.0
    return len(part)


def test_a_part_is_a_view():
    array = np.arange(10.0)
    assert doubled(array, 4) == SIZE
    assert array.tolist() == [0.0, 1.0, 2.0, 3.0, 8.0, 10.0, 12.0, 7.0, 8.0, 9.0]
    assert array_part(SIZE, array, 4).tolist() == [8.0, 10.0, 12.0]


@pytest.mark.parametrize(
    "options", [{}, {name: value for name, value in OPTIONS.items() if name != "cache"}], ids=["numba", "ours"]
)
def test_sizes_of_two_parts_differ(options):
    """Our pipeline types all calls with integers behind an array alike: sizes must not be among them."""

    @njit(**options)
    def sizes(array):
        return len(array_part(2, array, 0)), len(array_part(5, array, 0))

    assert sizes(np.zeros(5)) == (2, 5)


def test_a_size_that_is_not_known_when_compiling_is_refused():
    @njit
    def part(array, size):
        return array_part(size, array, 0)[0]

    with pytest.raises(TypingError):
        part(np.zeros(3), 3)


def test_an_array_with_gaps_is_refused():
    with pytest.raises(TypingError):
        doubled(np.zeros((4, 4))[:, 1], 0)
