"""Drive of the upper plate through springs: a base follows the schedule, and springs along x and y pull the plate after it.

Along an axis with a spring of stiffness k, with the mass M of the plate, displacements X of the base and x of the plate, force Q
of the debris against the motion, and friction D of direct contact, M x'' = k (X - x) - Q - D. At rest D balances the other forces
up to its limit mu P. Along an axis without spring x = X. The work of the drive is that of the base.

Steps of the explicit integrator: velocity Verlet as for the bodies, friction of direct contact by radial return of the velocity.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.schedule import value
from thirdbody.kernels.tables import drive, patch, run_totals


@njit(**BARE)
def is_sprung(context):
    return context.spring.shape[0] > 0


@njit(**BARE)
def half_kick(context, dt):
    """Change the velocity of the plate by half a step of springs and debris, then of direct friction, which stops it at most."""
    A, Y, P = context.A, context.spring, context.P
    for k in range(2):
        if Y[drive.STIFFNESS + k] > 0.0:
            Y[drive.VELOCITY + k] += 0.5 * dt / Y[drive.MASS] * (Y[drive.FORCE + k] + Y[drive.PUSH + k])
    limit = P[P.shape[0] - 1, patch.DIRECT_FRICTION] * A[run_totals.DIRECT_FORCE + 2]
    speed = math.hypot(Y[drive.VELOCITY], Y[drive.VELOCITY + 1])
    if limit > 0.0 and speed > 0.0:
        left = max(1.0 - 0.5 * dt * limit / (Y[drive.MASS] * speed), 0.0)
        for k in range(2):
            Y[drive.VELOCITY + k] *= left if Y[drive.STIFFNESS + k] > 0.0 else 1.0


@njit(**BARE)
def begin_step(context, v_x, v_y, dt):
    """Move the plate; return its mean velocity in the step [m/s]. (v_x, v_y): that of the base."""
    Y = context.spring
    Y[drive.BASE_VELOCITY], Y[drive.BASE_VELOCITY + 1] = v_x, v_y
    for k in range(2):
        if Y[drive.STIFFNESS + k] == 0.0:
            Y[drive.VELOCITY + k] = Y[drive.BASE_VELOCITY + k]
    half_kick(context, dt)
    for k in range(2):
        Y[drive.DISPLACEMENT + k] += dt * Y[drive.VELOCITY + k]
    return Y[drive.VELOCITY], Y[drive.VELOCITY + 1]


@njit(**BARE)
def end_step(context, direct_work, step):
    """Evaluate the springs at the end of the step, end it, and book the work of the base in place of that of the plate, and its
    path. `direct_work`: dissipated by direct friction in the step [J]."""
    A, Y, gained, square = context.A, context.spring, 0.0, step.v_x * step.v_x + step.v_y * step.v_y
    rubs = context.P[context.P.shape[0] - 1, patch.DIRECT_FRICTION] * A[run_totals.DIRECT_FORCE + 2] > 0.0
    for k in range(2):
        base, push, v = value(context.schedule, context.first, np.int64(k), step.time), A[run_totals.UPPER_FORCE + k], step.v_x
        v = v if k == 0 else step.v_y
        if Y[drive.STIFFNESS + k] > 0.0:
            force = Y[drive.STIFFNESS + k] * (base - Y[drive.DISPLACEMENT + k])
            gained += 0.5 * (Y[drive.FORCE + k] + force) * (base - Y[drive.BASE + k])
            gained += 0.5 * step.dt * (Y[drive.PUSH + k] + push) * v
            gained -= direct_work * v * v / square if square > 0.0 else 0.0
            Y[drive.FORCE + k] = force
            if rubs and square == 0.0:  # direct friction holds the plate
                A[run_totals.DIRECT_FORCE + k] = -force - push
                A[run_totals.DIRECT_IMPULSE + k] -= 0.5 * step.dt * (force + push)
        else:
            Y[drive.DISPLACEMENT + k] = base
        Y[drive.BASE + k], Y[drive.PUSH + k] = base, push
    half_kick(context, step.dt)
    for column in (run_totals.DRAG_WORK, run_totals.PLATE_WORK):
        A[column] += gained
    A[run_totals.PLATE_WORK_SIZE] += abs(gained)
    A[run_totals.DISTANCE] += step.dt * (math.hypot(Y[drive.BASE_VELOCITY], Y[drive.BASE_VELOCITY + 1]) - math.sqrt(square))
