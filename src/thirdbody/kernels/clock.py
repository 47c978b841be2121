"""The clock of a run, or of one body of it."""

import math

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.layout import A_DISTANCE, A_DX, A_DY, A_ELAPSED, A_HEADING, A_SPEED, A_STEPS, A_TIME


@njit(**BARE)
def pass_time(A, dt, v_x, v_y):
    """Time, distance and heading after a step of length dt (s), the upper plate at the mean velocity (v_x, v_y), m/s."""
    speed = math.sqrt(v_x * v_x + v_y * v_y)
    A[A_TIME] += dt
    A[A_ELAPSED] += dt
    A[A_DX] += v_x * dt
    A[A_DY] += v_y * dt
    A[A_DISTANCE] += speed * dt
    A[A_STEPS] += 1.0
    A[A_SPEED] = speed
    if speed > 0.0:
        A[A_HEADING], A[A_HEADING + 1] = v_x / speed, v_y / speed
