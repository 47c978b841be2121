"""Linear equations of an island: Gaussian elimination with row pivots.

The entry in row i and column j is A[i step + j + offset]. Seven equations of one body are dense: step 7, offset 0. Those of
several bodies are a band: row i holds the columns from i - w to i + 2 w, side by side, of which exchanged rows need the last w;
step 3 w, offset w: 3 w + 1 columns. Not LAPACK, which would start threads of its own from each thread of a kernel.
"""

from numba import njit

from thirdbody.jit.options import BARE


@njit(**BARE)
def factorise(A, pivots, n, w, step, offset):
    """Overwrite A (n rows, half width w) with its triangular factors, the diagonal inverted; False if A is singular."""
    for c in range(n):
        top, end = c * step + c + offset, min(n, c + w + 1)
        best, p = abs(A[top]), c
        for i in range(c + 1, end):
            if abs(A[i * step + c + offset]) > best:
                best, p = abs(A[i * step + c + offset]), i
        if not best > 0.0 or not best < 1e300:
            return False
        pivots[c] = p
        many = min(n, c + 2 * w + 1) - c
        if p != c:
            other = p * step + c + offset
            for j in range(many):
                A[top + j], A[other + j] = A[other + j], A[top + j]
        inverse = 1.0 / A[top]
        A[top] = inverse
        for i in range(c + 1, end):
            below = i * step + c + offset
            factor = A[below] * inverse
            A[below] = factor
            if factor != 0.0:
                for j in range(1, many):
                    A[below + j] -= factor * A[top + j]
    return True


@njit(**BARE)
def substitute(A, pivots, r, n, w, step, offset):
    """Overwrite r with the solution x of A x = -r, where A and `pivots` are from `factorise`.

    Column by column, so that the sums of all rows advance side by side.
    """
    for c in range(n):
        p = pivots[c]
        r[c], r[p] = r[p], r[c]
        x = r[c]
        for i in range(c + 1, min(n, c + w + 1)):
            r[i] -= A[i * step + c + offset] * x
    for c in range(n - 1, -1, -1):
        x = -r[c] * A[c * step + c + offset]
        r[c] = x
        for i in range(max(0, c - 2 * w), c):
            r[i] += A[i * step + c + offset] * x
