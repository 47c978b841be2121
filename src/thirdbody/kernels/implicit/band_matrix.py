"""Linear equations with a band matrix: Gaussian elimination with row pivots.

Row i of a matrix of half width w holds the columns from i - w to i + 2 w, side by side; exchanged rows need the last w of them.
LAPACK's `gbtrf` does the same with columns; calls of it from several threads of a kernel would each start threads of their own.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK


@njit(**BARE)
def row_length(half_width):
    """Return the number of columns that a row holds."""
    return 3 * half_width + 1


@njit(**BARE)
def entry(i, j, half_width):
    """Return where the entry in row i and column j is."""
    return i * row_length(half_width) + j - i + half_width


@njit(**BARE_CHUNK)
def factorise_band(A, pivots, n, half_width):
    """Overwrite A (n rows) with its triangular factors; False if A is singular."""
    w, row = half_width, row_length(half_width)
    for c in range(n):
        best, p = abs(A[entry(c, c, w)]), c
        for i in range(c + 1, min(n, c + w + 1)):
            if abs(A[entry(i, c, w)]) > best:
                best, p = abs(A[entry(i, c, w)]), i
        if not best > 0.0 or not best < 1e300:
            return False
        pivots[c] = p
        many, top = np.uint64(min(n, c + 2 * w + 1) - c), np.uint64(entry(c, c, w))
        if p != c:
            other = np.uint64(entry(p, c, w))
            for j in range(many):
                A[top + np.uint64(j)], A[other + np.uint64(j)] = A[other + np.uint64(j)], A[top + np.uint64(j)]
        inverse = 1.0 / A[top]
        for i in range(c + 1, min(n, c + w + 1)):
            below = np.uint64(i * row + c - i + w)
            factor = A[below] * inverse
            A[below] = factor
            if factor != 0.0:
                for j in range(np.uint64(1), many):
                    A[below + j] -= factor * A[top + j]
    return True


@njit(**BARE_CHUNK)
def substitute_band(A, pivots, r, n, half_width):
    """Overwrite r with the solution x of A x = -r, where A and `pivots` are from `factorise_band`."""
    w = half_width
    for c in range(n):
        p = pivots[c]
        r[c], r[p] = r[p], r[c]
        for i in range(c + 1, min(n, c + w + 1)):
            r[i] -= A[entry(i, c, w)] * r[c]
    for c in range(n - 1, -1, -1):
        x = r[c]
        for j in range(c + 1, min(n, c + 2 * w + 1)):
            x += A[entry(c, j, w)] * r[j]
        r[c] = -x / A[entry(c, c, w)]
