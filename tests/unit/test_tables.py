"""Tables: the place of each column, and access by name."""

import pickle

import numba
import numpy as np
import pytest

from thirdbody.kernels.table import Table, mark, number, skip, vector

EXAMPLE = Table(
    "B", "a body",
    force=vector(3, "N", "force"), _=skip(1), plain=mark(), mass=number("kg", "mass"), load=number("N", "load", at="force"),
)  # fmt: skip


@numba.njit
def read(B):
    return B[0, EXAMPLE.FORCE + 2] + EXAMPLE.WIDTH


def test_columns_follow_each_other_unless_placed():
    assert (EXAMPLE.FORCE, EXAMPLE.PLAIN, EXAMPLE.MASS, EXAMPLE.LOAD, EXAMPLE.WIDTH) == (0, 4, 4, 0, 5)
    assert EXAMPLE.FORCE3 == slice(0, 3) and EXAMPLE.names() == ("force", "mass", "load")
    assert EXAMPLE["mass"].unit == "kg" and "| 0-2 | force | N | force |" in EXAMPLE.markdown()


def test_a_copy_has_the_same_columns():
    copied = pickle.loads(pickle.dumps(EXAMPLE))
    assert copied.MASS == EXAMPLE.MASS and copied.FORCE3 == EXAMPLE.FORCE3 and copied.markdown() == EXAMPLE.markdown()


def test_kernels_and_python_read_the_same_columns():
    B = np.arange(10.0).reshape(2, 5)
    assert read(B) == 7.0 and np.shares_memory(EXAMPLE.view(B).force, B)
    assert EXAMPLE.view(B).force.tolist() == [[0.0, 1.0, 2.0], [5.0, 6.0, 7.0]] and EXAMPLE.view(B).mass.tolist() == [4.0, 9.0]
    with pytest.raises(AttributeError, match="no column is named speed: force, mass, load"):
        _ = EXAMPLE.view(B).speed
