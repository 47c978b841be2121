"""Bodies under one common plate: what the integrator calls."""

from numba import types

from thirdbody.jit.arguments import PACKED
from thirdbody.jit.options import OPTIONS, entry
from thirdbody.kernels.bundles import Motion
from thirdbody.kernels.direct_contact import book_direct_contact
from thirdbody.kernels.implicit.accept_step import reject_step
from thirdbody.kernels.implicit.bundles import MOTION, active_body, context_of, make_workspace
from thirdbody.kernels.implicit.common_plate import accept_body, solve_body
from thirdbody.kernels.implicit.step_control import (
    bdf2_weights,
    error_of_change,
    is_breakpoint,
    next_breakpoint,
    next_length,
    plate_velocity,
    reduction_factor,
    set_next_dt,
    step_ratio,
)
from thirdbody.kernels.implicit.tables import body_solution, step_memory

_D, _B, _I, _ROW = types.float64, types.boolean, types.int64, types.Array(types.float64, 1, "C")


@entry(types.void(_I, _I, _B, _D, MOTION, PACKED), nogil=True, **OPTIONS)
def solve_bodies(first, last, first_iteration, displacement, motion, packed):
    """Solve the step of bodies first to last - 1 for a given rise of the plate [m].

    `first_iteration`: the step begins; otherwise the iteration continues from `ends` of the previous call. Results are written to
    `solutions` (n, body_solution.WIDTH). `packed`: a packed `ImplicitContext`.
    """
    context = context_of(packed)
    space = make_workspace(context)
    for b in range(first, last):
        if context.solutions[b, body_solution.IN_ISLAND] == 0.0:
            solve_body(context, b, first_iteration, displacement, motion, space)


@entry(types.void(_I, _I, _D, _B, _I, MOTION, PACKED), nogil=True, **OPTIONS)
def accept_bodies(first, last, end, whole, cuts, motion, packed):
    """Accept the step solved by `solve_bodies`, cut `cuts` times; `whole`: it ends exactly at the time `end` [s]."""
    context = context_of(packed)
    space = make_workspace(context)
    for b in range(first, last):
        if context.solutions[b, body_solution.IN_ISLAND] == 0.0:
            accept_body(context, b, end, whole, cuts, motion, space)


@entry(types.void(PACKED), **OPTIONS)
def restore_bodies(packed):
    """Restore all bodies to the start of the step."""
    context = context_of(packed)
    space = make_workspace(context)
    for b in range(context.totals.shape[0]):
        reject_step(context, active_body(b, context), space.y)


# -- control of the common step; T: memory of the plate, a row of `columns.step_memory` like that of a body --


@entry(types.Tuple((_D, _I))(_ROW, _D, PACKED, _D), **OPTIONS)
def common_step_length(T, t, packed, end):
    """Return length [s] and limiting cause of the next step (`step_control.next_length`)."""
    return next_length(T, t, context_of(packed), end)


@entry(types.UniTuple(_D, 4)(_ROW, _ROW, _D, _D, _D), **OPTIONS)
def plate_motion(T, V, displacement, velocity, dt):
    """Return velocity [m/s] and acceleration [m/s2] of the plate after a step, the change of the former with the rise [1/s], and
    its change beyond that of the last step, scaled [m/s].

    `velocity`: before the step; V: settings.
    """
    now, before = bdf2_weights(T, V, dt)
    after = (now * displacement - before * T[step_memory.LAST_COORDINATES + 6]) / dt
    change = now * (after - velocity) - before * T[step_memory.LAST_DRISE]
    return after, change / dt, now / dt, after - velocity - step_ratio(T, V, dt) * T[step_memory.LAST_DRISE]


@entry(_D(_D, _D, _ROW, _ROW, _D), **OPTIONS)
def plate_error(change, radius, T, V, dt):
    """Return the error of the plate's step over the tolerance (`step_control.error_of_change`)."""
    return error_of_change(abs(change), radius, T, V, dt)


@entry(_D(_B, _D, _D), **OPTIONS)
def reduction(converged, error, rotation):
    """Return the factor that shortens a rejected step."""
    return reduction_factor(converged, error, rotation)


@entry(types.void(_ROW, _D, _D, _D, _B, _B, _I), **OPTIONS)
def set_common_length(T, growth, dt, error, easy, cut, limit):
    """Set the length of the next step and what limits it (`step_control.set_next_dt`)."""
    set_next_dt(T, growth, dt, error, easy, cut, limit)


@entry(types.UniTuple(_D, 2)(_D, PACKED, _D), **OPTIONS)
def plate_velocity_of(t, packed, dt):
    """Return the mean lateral velocity (v_x, v_y) [m/s] of the upper plate over a step."""
    return plate_velocity(t, context_of(packed), dt)


@entry(_B(_D, PACKED, _D), **OPTIONS)
def is_breakpoint_at(t, packed, end):
    """Return whether the smooth interval that began at t [s] ends at a breakpoint of the motion."""
    return is_breakpoint(t, context_of(packed), end)


@entry(_D(_D, PACKED, _D), **OPTIONS)
def next_breakpoint_after(t, packed, until):
    """Return the time [s] of the next breakpoint of the motion after t, at most `until`."""
    return next_breakpoint(t, context_of(packed), until)


@entry(types.void(_ROW, types.Array(types.float64, 2, "C"), _D, _D, _D, _D), **OPTIONS)
def book_direct(totals, P, dt, v_x, v_y, old):
    """Add a step of direct contact to the totals of the plate, the last row of P (`direct_contact.book_direct_contact`)."""
    book_direct_contact(totals, P, P.shape[0] - 1, Motion(dt, v_x, v_y), old)
