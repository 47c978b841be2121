"""Prescribed motion and loads: piecewise schedules, one list of segments per axis.

Rows of a schedule are sorted by axis and start; `first[axis]` to `first[axis + 1]` are the rows of an axis. From its start on,
until the next one begins, a row gives with tau = t - start:

| kind | value |
|---|---|
| POLYNOMIAL | a + b tau + c tau^2/2 |
| SINE | a + (b/2) (1 - cos(c tau)): strokes of length b from rest at one end, c = 2 pi frequency |
| TRIANGLE | a + b tri(c tau): strokes of length b at constant speed, c = frequency |

Before its first row an axis rests at zero.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.tables import run_totals

X, Y, GAP, LOAD = range(4)
"""Axes of a schedule: horizontal motion of the upper plate, its height, and its load over the nominal one."""

START, KIND, A, B, C = range(5)
COLUMNS = 5

POLYNOMIAL, SINE, TRIANGLE = range(3)


@njit(**BARE)
def segment(schedule, first, axis, t):
    low, high = first[axis] - 1, first[axis + 1] - 1
    while low < high:
        middle = (low + high + 1) // 2
        if schedule[middle, START] <= t:
            low = middle
        else:
            high = middle - 1
    return low if low >= first[axis] else -1


@njit(**BARE)
def value(schedule, first, axis, t):
    return value_of(schedule, segment(schedule, first, axis, t), t)


@njit(**BARE)
def value_of(schedule, row, t):
    """Return the value of a row at time t, whether it is valid then or not; 0 for row -1."""
    if row < 0:
        return 0.0
    tau, a, b, c = t - schedule[row, START], schedule[row, A], schedule[row, B], schedule[row, C]
    if schedule[row, KIND] == SINE:
        return a + 0.5 * b * (1.0 - math.cos(c * tau))
    if schedule[row, KIND] == TRIANGLE:
        phase = c * tau - math.floor(c * tau)
        return a + b * (2.0 * phase if phase < 0.5 else 2.0 - 2.0 * phase)
    return a + tau * (b + 0.5 * c * tau)


@njit(**BARE)
def mean_rate(schedule, first, axis, t, dt):
    row = segment(schedule, first, axis, t)
    if row == segment(schedule, first, axis, t + dt):
        if row < 0:
            return 0.0
        if schedule[row, KIND] == POLYNOMIAL:
            # the difference of two positions would lose the digits of a slow motion
            return schedule[row, B] + schedule[row, C] * (t - schedule[row, START] + 0.5 * dt)
    return (value(schedule, first, axis, t + dt) - value(schedule, first, axis, t)) / dt if dt > 0.0 else 0.0


@njit(**BARE)
def next_corner(schedule, first, axis, t):
    """Return the next time after t at which an axis reverses or changes its motion [s]; infinite if it never does."""
    row = segment(schedule, first, axis, t)
    following = row + 1 if row >= 0 else first[axis]
    corner = schedule[following, START] if following < first[axis + 1] else np.inf
    if row >= 0 and schedule[row, KIND] != POLYNOMIAL:
        half = math.pi / schedule[row, C] if schedule[row, KIND] == SINE else 0.5 / schedule[row, C]
        # a corner that was missed only by rounding counts as passed
        count = math.floor((t - schedule[row, START]) / half + 1e-6) + 1.0
        corner = min(corner, schedule[row, START] + count * half)
    return corner


@njit(**BARE)
def pass_time(A, dt, v_x, v_y):
    """Advance time, distance and heading by a step dt [s]. (v_x, v_y): mean velocity of the upper plate [m/s]."""
    speed = math.sqrt(v_x * v_x + v_y * v_y)
    A[run_totals.TIME] += dt
    A[run_totals.ELAPSED] += dt
    A[run_totals.SHIFT_X] += v_x * dt
    A[run_totals.SHIFT_Y] += v_y * dt
    A[run_totals.DISTANCE] += speed * dt
    A[run_totals.STEPS] += 1.0
    A[run_totals.PLATE_SPEED] = speed
    if speed > 0.0:
        A[run_totals.HEADING], A[run_totals.HEADING + 1] = v_x / speed, v_y / speed
