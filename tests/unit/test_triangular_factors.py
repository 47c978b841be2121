"""Linear systems of Newton's method, against LAPACK."""

from __future__ import annotations

import numpy as np
import pytest

from thirdbody.kernels.implicit.newton import factorise, substitute


def solution(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The solution x of A x = b by the kernels of Newton's method, in Python."""
    n = len(b)
    J, pivots, r = A.copy(), np.zeros(n, np.int64), -b
    assert factorise.py_func(J, pivots, n)
    substitute.py_func(J, pivots, r, n)
    return r


@pytest.mark.parametrize("n", [6, 7])
@pytest.mark.parametrize("seed", range(20))
def test_solution_is_that_of_lapack(n, seed):
    """Random matrices need many exchanges of rows."""
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(n, n)), rng.normal(size=n)
    np.fill_diagonal(A, 0.0)
    x = np.linalg.solve(A, b)
    # rounding grows with the condition of the matrix
    bound = 50.0 * np.finfo(float).eps * np.linalg.cond(A) * np.abs(x).max()
    np.testing.assert_allclose(solution(A, b), x, rtol=0.0, atol=bound)


def test_singular_matrix_is_refused():
    A = np.ones((7, 7))
    assert not factorise.py_func(A, np.zeros(7, np.int64), 7)
