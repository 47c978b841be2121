"""Step control of the implicit integrator: length and what limits it, BDF2 weights, prediction, error, guards."""

import math
from enum import IntEnum

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import load
from thirdbody.kernels import plates
from thirdbody.kernels.bodies import check_position, limits_of
from thirdbody.kernels.height_field import has_heights
from thirdbody.kernels.implicit.residual import MAX_ROTATION
from thirdbody.kernels.schedule import GAP, LOAD, X, Y, mean_rate, next_corner, pass_time
from thirdbody.kernels.step_tables import step_contacts, step_memory, step_settings, step_start
from thirdbody.kernels.tables import body, domain, patch, run_totals, sphere


class StepLimit(IntEnum):
    """Causes that limit a step, in the order of their counters (`step_memory.LIMITED`): those due to a body come first."""

    ERROR = 0  # a longer step would exceed the error allowed by `solver.tolerance`
    LANDING = 1  # a longer step failed while a contact closed
    NEWTON = 2  # Newton's method did not converge for a longer step, or needed many iterations
    ROTATION = 3  # largest rotation of the body in one step
    LARGEST_STEP = 4  # largest drag in one step (`solver.largest_step`)
    REVERSAL = 5  # the step ends where the prescribed motion or load changes
    OUTPUT = 6  # the step ends at an output
    GROWTH = 7  # nothing: the step grows by the largest allowed ratio


TRAVEL = 0.12
"""Largest displacement of a sphere relative to a rough plate in a step, in radii: minima are searched for after each step."""

OF_A_BODY = 4  # number of causes due to a body; the others are due to the scene
CAUSES = tuple(limit.name.lower() for limit in StepLimit)  # names of the causes by code, as in `summary()`

WORDS = (
    "the error of a step (solver.tolerance)", "spots that touch for the first time", "failures of Newton's method",
    "the rotation of a body", "the largest step of the drag (solver.largest_step)", "reversals of the motion",
    "the output interval (output.every)", "growth from a short step",
)  # fmt: skip
"""Descriptions of the causes by code, which complete `steps limited by`."""


@njit(**BARE_CHUNK)
def why_cut(landing, converged, error, rotation):
    if landing:
        return np.int64(StepLimit.LANDING)
    if not converged:
        return np.int64(StepLimit.NEWTON)
    by_error = error > 1.0 and 1.0 / math.sqrt(error) < MAX_ROTATION / max(rotation, 1e-30)
    return np.int64(StepLimit.ERROR if by_error else StepLimit.ROTATION)


class BodyStop(IntEnum):
    """Reasons why a body stopped (`step_memory.CODE`)."""

    NONE = 0  # it goes on
    UNSOLVED = 1  # no step down to the shortest one could be solved
    OVERLAP = 2  # guard: a contact is too deep
    CROWDED = 3  # it has more contacts than a tile holds
    LEFT = 4  # guard: it left the domain
    BAD_BODY = 5  # guard: its position is not finite


TETHER, TOLERANCE_FACTOR = 1e-8, 100.0
"""Without inertia: stiffness of the spring to the start position over that of the body, and factor of the tolerance, which may be
looser because no velocity is carried over."""

HARD = 4  # a step rejected more often than this counts as hard
EASY = 8  # largest number of iterations after which the step may grow
NEARLY = 1.0 - 1e-9  # a step of this fraction of the remaining interval covers all of it


@njit(**BARE)
def next_breakpoint(t, context, until):
    """Return the time [s] of the next breakpoint of the motion after t, at most `until`."""
    end = until
    for axis in (X, Y, GAP, LOAD):
        end = min(end, next_corner(context.schedule, context.first, np.int64(axis), t))
    return end


@njit(**BARE)
def plate_velocity(t, context, dt):
    schedule, first = context.schedule, context.first
    return mean_rate(schedule, first, np.int64(X), t, dt), mean_rate(schedule, first, np.int64(Y), t, dt)


MINUTE = 0.1
"""Smallest radius that scales errors, over that which limits the drag: contacts that carry nothing but a weight are smaller than
an atom."""


@njit(**BARE)
def longest_drag(V, T):
    return min(V[step_settings.LONGEST], V[step_settings.RADII] * T[step_memory.DRAG_RADIUS])


@njit(**BARE)
def next_length(T, t, context, end):
    """Return length [s] and limiting cause (`StepLimit`) of the next step from t, at most to `end` [s]."""
    left = end - t
    dt, limit = min(T[step_memory.NEXT_DT], left), np.int64(T[step_memory.LIMIT])
    ends = np.int64(StepLimit.REVERSAL if next_breakpoint(t, context, np.inf) <= end else StepLimit.OUTPUT)
    longest = longest_drag(context.settings, T)
    for _ in range(3):
        v_x, v_y = plate_velocity(t, context, dt)
        distance = math.sqrt(v_x * v_x + v_y * v_y) * dt
        if distance > longest:
            dt *= longest / distance
            limit = np.int64(StepLimit.LARGEST_STEP)
    if dt >= NEARLY * left:
        return left, ends
    # two equal steps rather than a tiny last one
    return (0.5 * left, ends) if dt > 0.5 * left else (dt, limit)


@njit(**BARE)
def step_ratio(T, V, dt):
    """Return the length of a step over that of the last one; 0 after a breakpoint, or without inertia: backward Euler."""
    return 0.0 if T[step_memory.LAST_DT] <= 0.0 or V[step_settings.INERTIAL] == 0.0 else dt / T[step_memory.LAST_DT]


@njit(**BARE)
def bdf2_weights(ratio):
    """Return the weights of the changes of this step and the last one, shorter by `ratio`: BDF2 (Curtiss and Hirschfelder 1952)
    for unequal steps (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, III.5)."""
    return (1.0 + 2.0 * ratio) / (1.0 + ratio), ratio * ratio / (1.0 + ratio)


@njit(**BARE)
def begin_step(context, b, displacement, motion, space):
    """Set the weights of a step, what holds a body without inertia, and its patch along x and y; predict the end of the step with
    the acceleration of the last one. `displacement`: of a patch that is prescribed [m]."""
    p, Z, T, V, P, dt = context.patch[b], space.start, context.memory[b], context.settings, context.P, motion.dt
    P[p, patch.DISPLACEMENT] = Z[step_start.PATCH_DISPLACEMENT] + dt * motion.v_x
    P[p, patch.DISPLACEMENT + 1] = Z[step_start.PATCH_DISPLACEMENT + 1] + dt * motion.v_y
    Z[step_start.TETHER_STIFFNESS], Z[step_start.MASS_FRACTION] = 0.0, 1.0
    if V[step_settings.INERTIAL] == 0.0:
        Z[step_start.TETHER_STIFFNESS] = TETHER * T[step_memory.STIFFNESS]
        distance, mass = math.sqrt(motion.v_x * motion.v_x + motion.v_y * motion.v_y) * dt, context.B[b, body.MASS]
        # at any speed of drag inertia resists no more than the spring (TETHER) in the longest step, and more in shorter ones
        if distance > 0.0:
            limit = Z[step_start.TETHER_STIFFNESS] * (longest_drag(V, T) * dt / distance) ** 2 / mass
            Z[step_start.MASS_FRACTION] = min(1.0, limit)
    ratio, y = step_ratio(T, V, dt), space.y
    now, last = bdf2_weights(ratio)
    Z[step_start.NOW], Z[step_start.LAST] = now, last
    scale, part = dt / now, last / now
    for k in range(3):
        v = Z[step_start.VELOCITY + k] + ratio * T[step_memory.LAST_DV + k]
        w = Z[step_start.SPIN + k] + ratio * T[step_memory.LAST_DW + k]
        y[k] = scale * v + part * T[step_memory.LAST_COORDINATES + k]
        y[3 + k] = scale * w * Z[step_start.ARM] + part * T[step_memory.LAST_COORDINATES + 3 + k]
    patch_velocity = Z[step_start.PATCH_VELOCITY] + ratio * T[step_memory.LAST_DRISE]
    predicted = scale * patch_velocity + part * T[step_memory.LAST_COORDINATES + 6]
    y[6] = predicted if P[p, patch.FREE] != 0.0 else displacement


@njit(**BARE)
def error_of_change(change, radius, ratio, V, dt):
    """Return the local error of a step over the tolerance, a fraction of `radius`, that of the largest contact. `change`: of a
    velocity [m/s], beyond that of the last step, scaled. Backward Euler: half the step length times the change. BDF2: 2/9 of
    that, which at equal steps is 2/9 of the third derivative times dt^3 (Hairer, Norsett and Wanner, III.2)."""
    fraction, allowed = 0.5 if ratio == 0.0 else 2.0 / 9.0, V[step_settings.TOLERANCE]
    if V[step_settings.INERTIAL] == 0.0:
        allowed = min(1.0, TOLERANCE_FACTOR * allowed)
    return fraction * dt * change / (allowed * radius)


@njit(**BARE)
def local_error(context, b, dt, space):
    Z, T, V, B = space.start, context.memory[b], context.settings, context.B
    ratio = step_ratio(T, V, dt)
    move, rotation = 0.0, 0.0
    for k in range(3):
        move += (B[b, body.VELOCITY + k] - Z[step_start.VELOCITY + k] - ratio * T[step_memory.LAST_DV + k]) ** 2
        rotation += (B[b, body.SPIN + k] - Z[step_start.SPIN + k] - ratio * T[step_memory.LAST_DW + k]) ** 2
    patch_velocity = context.P[context.patch[b], patch.VELOCITY]
    velocity_change = patch_velocity - Z[step_start.PATCH_VELOCITY] - ratio * T[step_memory.LAST_DRISE]
    change = max(math.sqrt(move), math.sqrt(rotation) * Z[step_start.ARM], abs(velocity_change))
    radius = max(space.diagnostics[step_contacts.MAX_RADIUS], T[step_memory.CONTACT_RADIUS], MINUTE * T[step_memory.DRAG_RADIUS])
    error = error_of_change(change, radius, ratio, V, dt)
    if not (plates.is_rough(context) and (has_heights(context.lower) or has_heights(context.upper))):
        return error
    # also of the largest displacement of a sphere relative to a plate over what is allowed, squared
    p, S, P, largest = context.patch[b], context.S, context.P, 0.0
    up_x = P[p, patch.DISPLACEMENT] - Z[step_start.PATCH_DISPLACEMENT]
    up_y = P[p, patch.DISPLACEMENT + 1] - Z[step_start.PATCH_DISPLACEMENT + 1]
    up_z = P[p, patch.HEIGHT] - Z[step_start.PATCH_HEIGHT]
    for i in range(context.start[b], context.start[b + 1]):
        x, y, z = dt * S[i, sphere.MID_VELOCITY], dt * S[i, sphere.MID_VELOCITY + 1], dt * S[i, sphere.MID_VELOCITY + 2]
        square = max(x * x + y * y + z * z, (x - up_x) ** 2 + (y - up_y) ** 2 + (z - up_z) ** 2)
        largest = max(largest, square / (S[i, sphere.RADIUS] * S[i, sphere.RADIUS]))
    return max(error, largest / (TRAVEL * TRAVEL))


@njit(**BARE)
def reduction_factor(converged, error, rotation):
    if not converged:
        return 0.5
    from_rotation = 0.9 * MAX_ROTATION / max(rotation, 1e-30)
    return max(0.1, min(0.7, 0.9 / math.sqrt(max(error, 1e-30)), from_rotation))


@njit(**BARE)
def set_next_dt(T, growth, dt, error, easy, cut, limit):
    """Set the length of the next step and what limits it. `growth`: largest ratio of two steps; `easy`: few iterations."""
    requested_dt = T[step_memory.NEXT_DT]
    grown = min(growth, 0.9 / math.sqrt(max(error, 1e-30)))
    if cut or not easy:
        grown = min(grown, 1.0)
    if cut:
        T[step_memory.LIMIT] = limit
    elif grown < 1.0:
        T[step_memory.LIMIT] = StepLimit.ERROR.value
    elif dt * grown >= requested_dt:
        reason = StepLimit.GROWTH if grown == growth else StepLimit.ERROR
        T[step_memory.LIMIT] = np.int64(reason if easy else StepLimit.NEWTON)
    # a step shortened only by the end of the interval does not reduce the next one
    T[step_memory.NEXT_DT] = max(dt * grown, requested_dt) if not cut and grown >= 1.0 else dt * grown


@njit(**BARE)
def close_step(context, b, motion, ended, space):
    """Advance clock and counters of body b, and note a guard that it violates. `ended`: time [s] at the end of the interval,
    whether the step ends exactly then, and how often it was cut."""
    T, A, D, diagnostics, (end, whole, cuts) = context.memory[b], context.totals[b], context.D, space.diagnostics, ended
    pass_time(A, motion.dt, motion.v_x, motion.v_y)
    if whole:
        A[run_totals.TIME] = end
    T[step_memory.CUTS] += cuts
    T[step_memory.HARD_STEPS] += 1.0 if cuts > HARD else 0.0
    T[step_memory.LONGEST_DRAG] = max(T[step_memory.LONGEST_DRAG], A[run_totals.PLATE_SPEED] * motion.dt)
    bad, out = check_position(b, load(context.B, b, body.POSITION), 0.0, limits_of(D), np.int64(0), np.int64(0))
    T[step_memory.CODE], T[step_memory.SLOT] = BodyStop.NONE.value, -1.0
    if bad > 0:
        T[step_memory.CODE] = BodyStop.BAD_BODY.value
    elif diagnostics[step_contacts.MAX_RATIO] > D[domain.OVERLAP_GUARD]:
        T[step_memory.CODE], T[step_memory.SLOT] = BodyStop.OVERLAP.value, diagnostics[step_contacts.SLOT]
    elif out > 0:
        T[step_memory.CODE] = BodyStop.LEFT.value
