"""Small dense linear programmes in compiled code: min c x with A x = b, x >= 0, by the simplex method in two phases.

scipy's solver takes milliseconds a call and cannot be called from the labels' kernel; `tests/friction_cones.py` verifies this one
with it. Columns enter by the most negative reduced cost, after `QUICK` pivots by the lowest index (R. G. Bland 1977), which
cannot cycle. Entries are expected to be of order 1. Plain loops, since slices and array expressions take seconds to compile.
"""

import math

import numpy as np
from numpy.typing import NDArray

from thirdbody.plugin import helper

Array = NDArray[np.float64]

TOLERANCE = 1e-9  # reduced costs and pivots that count as zero
REDUNDANT = 1e-7  # largest entry of a redundant row after elimination
QUICK, MAX_PIVOTS = 200, 2000


@helper
def pivot(tableau: Array, basis: Array, row: int, column: int) -> None:
    """Bring `column` into the basis at `row`: Gauss-Jordan elimination over all rows of the tableau."""
    size = tableau.shape[1]
    factor = 1.0 / tableau[row, column]
    for j in range(size):
        tableau[row, j] *= factor
    for i in range(tableau.shape[0]):
        factor = tableau[i, column]
        if i != row and factor != 0.0:
            for j in range(size):
                tableau[i, j] -= factor * tableau[row, j]
    basis[row] = column


@helper
def entering_column(tableau: Array, first: bool) -> int:
    """Column with the lowest reduced cost, or the first negative one; -1 if none is negative."""
    last = tableau.shape[0] - 1
    best, minimum = -1, -TOLERANCE
    for j in range(tableau.shape[1] - 1):
        if tableau[last, j] < minimum:
            best, minimum = j, tableau[last, j]
            if first:
                break
    return best


@helper
def leaving_row(tableau: Array, basis: Array, column: int) -> int:
    """Row that limits the entering column, the lowest basis index among equals; -1 if there is none."""
    n = tableau.shape[1] - 1
    best, minimum = -1, math.inf
    for i in range(tableau.shape[0] - 1):
        if tableau[i, column] > TOLERANCE:
            ratio = max(tableau[i, n], 0.0) / tableau[i, column]
            if ratio < minimum or (ratio == minimum and basis[i] < basis[best]):
                best, minimum = i, ratio
    return best


@helper
def optimise(tableau: Array, basis: Array) -> bool:
    """Pivot until no reduced cost in the last row is negative; return False if the objective is unbounded."""
    for count in range(MAX_PIVOTS):
        column = entering_column(tableau, count >= QUICK)
        if column < 0:
            return True
        row = leaving_row(tableau, basis, column)
        if row < 0:
            return False
        pivot(tableau, basis, row, column)
    return True


@helper
def drop_artificial(tableau: Array, basis: Array) -> None:
    """Pivot artificial variables, all zero, out of the basis; a row without a sizeable entry is redundant and becomes empty."""
    n = tableau.shape[1] - 1
    for i in range(tableau.shape[0] - 1):
        if basis[i] < n:
            continue
        tableau[i, n] = 0.0
        column = i  # any column
        for j in range(n):
            if abs(tableau[i, j]) > abs(tableau[i, column]):
                column = j
        if abs(tableau[i, column]) > REDUNDANT:
            pivot(tableau, basis, i, column)
        else:
            for j in range(n):
                tableau[i, j] = 0.0


@helper
def find_feasible(tableau: Array, basis: Array, residual: float) -> bool:
    """Phase one: return whether A x = b has a solution x >= 0, up to a sum of |A x - b| of at most `residual`.

    `tableau` (m + 1, n + 1) holds A in its first rows and b in its last column; on return it is at a solution, its last row for
    reduced costs. `basis` (m,) is written: column of each row; n and above mean a redundant row.
    """
    m, n = tableau.shape[0] - 1, tableau.shape[1] - 1
    for j in range(n + 1):
        tableau[m, j] = 0.0
    for i in range(m):
        basis[i] = n + i
        sign = -1.0 if tableau[i, n] < 0.0 else 1.0
        for j in range(n + 1):
            tableau[i, j] *= sign
            tableau[m, j] -= tableau[i, j]
    optimise(tableau, basis)
    if -tableau[m, n] > residual:
        return False
    drop_artificial(tableau, basis)
    return True


@helper
def minimise(tableau: Array, basis: Array, sign: float) -> float:
    """Minimum of `sign` (x[0] - x[1]), a free variable, from a feasible tableau; -inf if unbounded.

    On return the tableau is at the optimum.
    """
    m, n = tableau.shape[0] - 1, tableau.shape[1] - 1
    for j in range(n + 1):
        tableau[m, j] = 0.0
    tableau[m, 0], tableau[m, 1] = sign, -sign
    for i in range(m):
        if basis[i] <= 1:
            factor = sign if basis[i] == 0 else -sign
            for j in range(n + 1):
                tableau[m, j] -= factor * tableau[i, j]
    if not optimise(tableau, basis):
        return -math.inf
    return -tableau[m, n]
