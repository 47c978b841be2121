"""Forecast of a body with body forces (weight, applied force or torque), compiled: linear programmes over friction cones.

Without body forces `forecast` has closed forms. A body force changes the loads of the spots and, in three dimensions, leaves a
moment about the vertical that friction has to carry, so the upper and the lower resultant need not share a line. The side with
the smaller limit of friction slides, with all its spots at the limit against their slip; the other side sticks with any friction
inside its cones. Cones are inscribed pyramids of `EDGES` edges, one of them along the drag: required frictions are at most
1/cos(pi/EDGES) - 1 = 0.12 % too large.

Sides are (n, 2) arrays: x, y of the loaded spots from the centre of mass [m]. `heights`: of the upper and the lower spots above
the centre of mass [m]. `wrench` (6,): body force [N] and its moment about the centre of mass [N m]. `load`: normal force of the
upper side [N]. `frictions`: upper, lower. A "scale" s multiplies both frictions. Verified against `tests/friction_cones.py`.

The programmes, min c x with A x = b, x >= 0, are small and dense, solved by the simplex method in two phases: scipy's solver
takes milliseconds a call and cannot be called from the labels' kernel; `tests/friction_cones.py` verifies this one with it.
Columns enter by the most negative reduced cost, after `QUICK` pivots by the lowest index (R. G. Bland 1977), which cannot cycle.
Entries are expected to be of order 1. Plain loops, since slices and array expressions take seconds to compile."""

import math

import numpy as np
from numpy.typing import NDArray

from thirdbody.plugin import helper

Array = NDArray[np.float64]
Pair = tuple[float, float]

EDGES = 64
RESIDUAL = 1e-8  # unbalanced force over the load, unbalanced moment over load times size
LARGEST = 1e3  # friction scale beyond which a wrench counts as out of reach
ACCURACY = 1e-4  # of the required scale, relative

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
def optimise(tableau: Array, basis: Array) -> bool:
    """Pivot until no reduced cost in the last row is negative; return False if the objective is unbounded."""
    last, n = tableau.shape[0] - 1, tableau.shape[1] - 1
    for count in range(MAX_PIVOTS):
        column, lowest = -1, -TOLERANCE
        for j in range(n):
            if tableau[last, j] < lowest:
                column, lowest = j, tableau[last, j]
                if count >= QUICK:
                    break
        if column < 0:
            return True
        row, minimum = -1, math.inf  # that limits the column, the lowest basis index among equals
        for i in range(last):
            if tableau[i, column] > TOLERANCE:
                ratio = max(tableau[i, n], 0.0) / tableau[i, column]
                if ratio < minimum or (ratio == minimum and basis[i] < basis[row]):
                    row, minimum = i, ratio
        if row < 0:
            return False
        pivot(tableau, basis, row, column)
    return True


@helper
def find_feasible(tableau: Array, basis: Array, residual: float) -> bool:
    """Phase one: return whether A x = b has a solution x >= 0, up to a sum of |A x - b| of at most `residual`. `tableau` (m + 1,
    n + 1) holds A in its first rows and b in its last column; on return it is at a solution, its last row for reduced costs.
    `basis` (m,) is written: column of each row; n and above mean a redundant row."""
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
    for i in range(m):  # artificial variables, all zero, leave; a row without a sizeable entry is redundant and becomes empty
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
    return True


@helper
def minimise(tableau: Array, basis: Array, sign: float) -> float:
    """Minimum of `sign` (x[0] - x[1]), a free variable, from a feasible tableau; -inf if unbounded. On return the tableau is at
    the optimum."""
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


# -- forecasts


@helper
def body_size(upper: Array, lower: Array, heights: Pair) -> float:
    """Largest distance of a spot from the centre of mass along a coordinate [m]."""
    size = max(abs(heights[0]), abs(heights[1]))
    for i in range(upper.shape[0]):
        size = max(size, abs(upper[i, 0]), abs(upper[i, 1]))
    for i in range(lower.shape[0]):
        size = max(size, abs(lower[i, 0]), abs(lower[i, 1]))
    return size


@helper
def can_balance(upper: Array, lower: Array, heights: Pair, wrench: Array, frictions: Pair) -> bool:
    """Return whether forces inside the friction cones balance the wrench. Lengths over a size, wrench over the upper side's load.
    A column per edge of a spot's pyramid: force x, y, z and moment x, y, z per normal force; the last row is the load."""
    n, m = upper.shape[0], lower.shape[0]
    A = np.zeros((8, EDGES * (n + m) + 1))
    for i in range(n + m):
        x, y = (upper[i, 0], upper[i, 1]) if i < n else (lower[i - n, 0], lower[i - n, 1])
        z, push, friction = (heights[0], -1.0, frictions[0]) if i < n else (heights[1], 1.0, frictions[1])
        for k in range(EDGES):
            angle, j = 2.0 * math.pi * k / EDGES, EDGES * i + k
            t_x, t_y = friction * math.cos(angle), friction * math.sin(angle)
            A[0, j], A[1, j], A[2, j] = t_x, t_y, push
            A[3, j], A[4, j], A[5, j] = y * push - z * t_y, z * t_x - x * push, x * t_y - y * t_x
            A[6, j] = 1.0 if i < n else 0.0
    last = EDGES * (n + m)
    for k in range(6):
        A[k, last] = -wrench[k]
    A[6, last] = 1.0
    return find_feasible(A, np.empty(7, np.int64), RESIDUAL)


@helper
def required_scale(upper: Array, lower: Array, heights: Pair, wrench: Array, frictions: Pair) -> float:
    """Smallest scale of the frictions with which the body can stick; inf beyond `LARGEST`. At most 1 exactly if `can_balance` at
    1."""
    if can_balance(upper, lower, heights, wrench, (0.0, 0.0)):
        return 0.0
    low, high = 0.0, 1.0
    while not can_balance(upper, lower, heights, wrench, (high * frictions[0], high * frictions[1])):
        low, high = high, 4.0 * high
        if high > LARGEST:
            return math.inf
    while high - low > ACCURACY * high and high > ACCURACY:
        middle = 0.5 * (low + high)
        if can_balance(upper, lower, heights, wrench, (middle * frictions[0], middle * frictions[1])):
            high = middle
        else:
            low = middle
    return high


@helper
def sliding_range(slider: Array, holder: Array, heights: Pair, wrench: Array, frictions: Pair, drag: Pair) -> Pair:
    """(low, high): friction of the slider with which it can slide while the holder sticks; (inf, -inf) if none. For a slider
    above; `drag` is the unit direction in which its plate moves relative to the holder's plate. Divided by the friction t of the
    slider, the tangential balance is linear in t, the normal forces and the holder's tangential forces over t: two programmes
    give the ends. The friction of the holder scales with t, and so do horizontal force and vertical moment of the body: the
    result at the given frictions is exact, the ends are exact for a wrench without these. Columns: t, -t, the slider's spots, the
    edges of the holder's pyramids (one of them along the drag)."""
    n, m, e_x, e_y = slider.shape[0], holder.shape[0], drag[0], drag[1]
    over = 1.0 / frictions[0] if frictions[0] > 0.0 else 0.0
    grip = frictions[1] * over if frictions[0] > 0.0 else 1.0
    last, height = 2 + n + EDGES * m, heights[0] - heights[1]
    A = np.zeros((8, last + 1))
    A[3, 0] = -height * e_y + heights[1] * over * wrench[1]
    A[4, 0] = height * e_x - heights[1] * over * wrench[0]
    A[3, 1], A[4, 1] = -A[3, 0], -A[4, 0]
    for i in range(n):
        x, y, j = slider[i, 0], slider[i, 1], 2 + i
        A[3, j], A[4, j], A[5, j], A[6, j] = -y, x, x * e_y - y * e_x, 1.0
    for i in range(m):
        x, y = holder[i, 0], holder[i, 1]
        for k in range(EDGES):
            angle, j = 2.0 * math.pi * k / EDGES, 2 + n + EDGES * i + k
            along, across = grip * math.cos(angle), grip * math.sin(angle)
            t_x, t_y = along * e_x - across * e_y, along * e_y + across * e_x
            A[0, j], A[1, j], A[2, j], A[3, j], A[4, j], A[5, j] = t_x, t_y, 1.0, y, -x, x * t_y - y * t_x
    A[0, last], A[1, last], A[2, last] = -e_x - over * wrench[0], -e_y - over * wrench[1], 1.0 - wrench[2]
    A[3, last], A[4, last], A[5, last], A[6, last] = -wrench[3], -wrench[4], -over * wrench[5], 1.0
    basis = np.empty(7, np.int64)
    if not find_feasible(A, basis, RESIDUAL):
        return math.inf, -math.inf
    low = minimise(A, basis, 1.0)
    return low, -minimise(A, basis, -1.0)


@helper
def weighted_forecast(
    upper: Array, lower: Array, heights: Pair, wrench: Array, load: float, frictions: Pair, drag: Pair
) -> tuple[float, float, float]:
    """(mu_required, t_min, t_max) as of `forecast`, in terms of the smaller friction (the other one scales with it). Sticking is
    possible iff that friction is at least mu_required, sliding along the drag iff it lies between t_min and t_max. `upper`,
    `lower` and `wrench` are overwritten."""
    size = body_size(upper, lower, heights)
    for side in (upper, lower):
        for i in range(side.shape[0]):
            side[i, 0] /= size
            side[i, 1] /= size
    for k in range(6):
        wrench[k] /= load if k < 3 else load * size
    top, bottom = heights[0] / size, heights[1] / size
    minimum = min(frictions[0], frictions[1])
    start, one, two = (minimum, frictions[0] / minimum, frictions[1] / minimum) if minimum > 0.0 else (1.0, 1.0, 1.0)
    required = start * required_scale(upper, lower, (top, bottom), wrench, (start * one, start * two))
    speed = math.hypot(drag[0], drag[1])
    press = 1.0 - wrench[2]  # load of the lower side over that of the upper
    if not speed > 0.0 or not press > 0.0:
        return required, math.inf, -math.inf
    e_x, e_y = drag[0] / speed, drag[1] / speed
    if frictions[0] + wrench[0] * e_x + wrench[1] * e_y <= frictions[1] * press:
        low, high = sliding_range(upper, lower, (top, bottom), wrench, frictions, (e_x, e_y))
        return required, low / one, high / one
    # the lower side slides: the mirror image at the horizontal plane, and its plate moves against the drag
    for k in range(6):
        wrench[k] *= (-1.0 if 2 <= k < 5 else 1.0) / press
    low, high = sliding_range(lower, upper, (-bottom, -top), wrench, (frictions[1], frictions[0]), (-e_x, -e_y))
    return required, low / two, high / two
