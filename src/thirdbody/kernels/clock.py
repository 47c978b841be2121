"""The clock of a run, or of one body of it."""

import math

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.tables import run_totals


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
