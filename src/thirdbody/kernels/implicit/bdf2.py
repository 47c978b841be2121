"""BDF2 steps: a body between two plates, advanced to a time by steps of its own.

A step that Newton's method or the error estimate rejects is shortened; step lengths grow again afterwards. The error is relative
to the radius of the largest contact: steps are short where a contact starts to slip or a body tips, and long where it slides or
rolls on. No step crosses a breakpoint of the prescribed motion. BDF2 damps modes faster than the step, as backward Euler does,
and is of second order: at 1 m/s, where inertia governs sliding, the same error takes a tenth of the steps.
"""

import numpy as np
from numba import njit

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.bundles import Motion
from thirdbody.kernels.implicit.accept_step import accept_step, reject_step
from thirdbody.kernels.implicit.bundles import ActiveBody
from thirdbody.kernels.implicit.friction_work import MIN_CUT, work_error
from thirdbody.kernels.implicit.newton import Outcome, newton
from thirdbody.kernels.implicit.residual import MAX_ROTATION, measure_arm, save_start
from thirdbody.kernels.implicit.step_control import (
    EASY,
    NEARLY,
    Stop,
    begin_step,
    finish_step,
    initial_overlaps,
    is_breakpoint,
    local_error,
    next_breakpoint,
    next_length,
    plate_velocity,
    predict,
    reduction_factor,
    rotation_of,
)
from thirdbody.kernels.implicit.step_limits import lands, why_cut
from thirdbody.kernels.implicit.tables import step_memory, step_settings, step_start
from thirdbody.kernels.labeller_input import update_body_memory
from thirdbody.kernels.schedule import GAP, LOAD, mean_rate, segment, value, value_of
from thirdbody.kernels.signatures import OBSERVE
from thirdbody.kernels.tables import patch, run_totals

observe_at = function_at(OBSERVE)


@njit(**BARE)
def prescribed_displacement(context, active, dt):
    """Return the prescribed rise [m] of the body's patch, 0 if it is free; store the plate's height."""
    p, Z, P, t, schedule, first = (
        active.patch,
        active.start,
        context.P,
        active.totals[run_totals.TIME],
        context.schedule,
        context.first,
    )
    driven = first[GAP + 1] > first[GAP]
    displacement = mean_rate(schedule, first, np.int64(GAP), t, dt) * dt if driven else 0.0
    if P[p, patch.SPRING] != 0.0:
        Z[step_start.PLATE_HEIGHT] = value(schedule, first, np.int64(GAP), t + dt) if driven else P[P.shape[0] - 1, patch.HEIGHT]
        Z[step_start.PLATE_DISPLACEMENT] = displacement
    return 0.0 if P[p, patch.FREE] != 0.0 else displacement


@njit(**BARE)
def set_load(context, active, dt):
    """Set the scheduled load [N] of the body's patch at the end of a step that crosses no breakpoint."""
    p, P, t, schedule, first = active.patch, context.P, active.totals[run_totals.TIME], context.schedule, context.first
    if first[LOAD + 1] > first[LOAD] and P[p, patch.NOMINAL_LOAD] != 0.0:
        P[p, patch.LOAD] = P[p, patch.NOMINAL_LOAD] * value_of(schedule, segment(schedule, first, np.int64(LOAD), t), t + dt)


@njit(**BARE)
def update_labeller(active, observed, context, space):
    """Update the labeller's memory of the body after its step; `observed`: with all its contacts (`labeller_input.Observed`)."""
    A = active.totals
    update_body_memory(active.number, observed, A, observe_at(context.observe), space.observed, space.rows)
    A[run_totals.ELAPSED], A[run_totals.SHIFT_X], A[run_totals.SHIFT_Y] = 0.0, 0.0, 0.0


@njit(**BARE)
def error_of(context, active, m, converged, motion, space):
    """Return the error of the step over the tolerance: of the motion and, with inertia, of the friction work."""
    error, V = local_error(context, active, motion.dt, space.diagnostics), context.settings
    if converged and V[step_settings.INERTIAL] != 0.0 and motion.dt > MIN_CUT * V[step_settings.SHORTEST]:
        error = max(error, work_error(context, active, m, motion, space))
    return error


@njit(**BARE_CHUNK)
def step(context, active, until, space):
    """Make one step of the body, shortened until it is accepted; set its code if it has to stop."""
    b, T, A, V = active.number, active.memory, active.totals, context.settings
    save_start(context, active)
    initial_overlaps(b, context, space.before)
    time = A[run_totals.TIME]
    end = next_breakpoint(time, context, until)
    if end - time < V[step_settings.SHORTEST]:
        # the interval is shorter than any step: a stop that misses a breakpoint by rounding
        A[run_totals.TIME], T[step_memory.LAST_DT] = end, 0.0
        return
    (dt, limit), cuts = next_length(T, time, context, end), 0
    while True:
        whole = dt >= NEARLY * (end - time)
        dt = end - time if whole else dt
        v_x, v_y = plate_velocity(time, context, dt)
        motion = Motion(dt, v_x, v_y)
        begin_step(context, active, motion)
        set_load(context, active, dt)
        predict(context, active, dt, prescribed_displacement(context, active, dt), space.y)
        outcome, m, iterations = newton(context, active, motion, space)
        T[step_memory.TRIES] += 1.0
        T[step_memory.ITERATIONS] += iterations
        converged = outcome == Outcome.SOLVED
        error, rotation = error_of(context, active, m, converged, motion, space), rotation_of(space.y, active.start)
        if converged and error <= 1.0 and rotation <= MAX_ROTATION:
            break
        cuts += 1
        limit = why_cut(lands(context, b, m, space), converged, error, rotation)
        dt *= reduction_factor(converged, error, rotation)
        if outcome == Outcome.CROWDED or dt < V[step_settings.SHORTEST]:
            T[step_memory.CODE] = np.int64(Stop.CROWDED if outcome == Outcome.CROWDED else Stop.UNSOLVED)
            reject_step(context, active, space.y)
            return
    accept_step(context, active, m, motion, False, space)
    ended = end, whole, whole and is_breakpoint(time, context, end)
    finish_step(context, active, (motion, error, iterations <= EASY, cuts, limit), ended, space.diagnostics)
    if context.labels != 0:
        update_labeller(active, context, context, space)


@njit(**BARE_CHUNK)
def advance_body(b, until, tries, context, start, space):
    """Advance body b, unless a guard has stopped it, to a time [s], by at most `tries` trial steps. `start`, `space`: scratch."""
    active = ActiveBody(b, context.patch[b], start, context.memory[b], context.totals[b])
    last = active.memory[step_memory.TRIES] + tries
    measure_arm(context, active)
    while (
        active.memory[step_memory.CODE] == Stop.NONE.value
        and active.totals[run_totals.TIME] < until
        and active.memory[step_memory.TRIES] < last
    ):
        step(context, active, until, space)
