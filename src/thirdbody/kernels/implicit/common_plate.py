"""Bodies under one common plate: they share its height and therefore its time step.

The system matrix is an arrow matrix: one block per body, and one row and column for the plate. `solve_bodies` solves the bodies
for a given rise of the plate, with the derivative of their force on the plate at equilibrium of each body: the Schur complement
of the arrow matrix. One scalar equation for the plate remains (`engine.implicit_common_plate`).
"""

from numba import njit, types

from thirdbody.jit.options import BARE, BARE_CHUNK, OPTIONS
from thirdbody.kernels.bundles import Motion
from thirdbody.kernels.columns import body_solution, law_output, patch, step_memory, step_start
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.direct_contact import book_direct_contact
from thirdbody.kernels.first_body import is_rough
from thirdbody.kernels.implicit.accept_step import accept_step, reject_step
from thirdbody.kernels.implicit.bdf2 import PACKED, update_labeller
from thirdbody.kernels.implicit.bundles import FREEDOMS, active_body, context_of, make_workspace
from thirdbody.kernels.implicit.jacobian import assemble_jacobian
from thirdbody.kernels.implicit.newton import Outcome, factorise, newton, substitute
from thirdbody.kernels.implicit.residual import (
    active_contacts,
    contact_force,
    gradient_force,
    measure_arm,
    residual,
    save_start,
    set_configuration,
)
from thirdbody.kernels.implicit.step_control import (
    advance_clock,
    bdf2_weights,
    begin_step,
    count_step,
    error_of_change,
    guard_code,
    initial_overlaps,
    is_breakpoint,
    local_error,
    next_breakpoint,
    next_length,
    plate_velocity,
    predict,
    reduction_factor,
    rotation_of,
    set_next_dt,
    step_ratio,
)
from thirdbody.kernels.implicit.step_limits import lands
from thirdbody.kernels.predicates import is_upper


@njit(**BARE)
def plate_reaction(context, active, m, space):
    """Return the upward force [N] of the body on the plate, by a spring or directly by its contacts."""
    p, P = active.patch, context.P
    if P[p, patch.SPRING] != 0.0:
        return P[p, patch.SPRING] * (P[p, patch.HEIGHT] - active.start[step_start.PLATE_HEIGHT])
    push = 0.0
    for q in range(m):
        k = space.slots[q]
        if is_upper(context.partner[k]):
            push -= contact_force(q, space.tile)[2]
            if is_rough(context):
                push -= gradient_force(k, space.tile.outputs[law_output.STORED_NORMAL * TILE + q], context)[2]
    return push


@njit(**BARE)
def plate_stiffness(context, active, m, dt, space):
    """Return d(plate_reaction)/d(rise of the plate) [N/m] at equilibrium of the body."""
    x, row, J = space.correction, space.trial, space.jacobian
    assemble_jacobian(context, active, m, dt, True, space)
    spring = context.P[active.patch, patch.SPRING]
    if spring != 0.0:
        for k in range(7):
            x[k] = spring if k == 6 else 0.0
        if not factorise(J, space.pivots, 7):
            return 0.0
        substitute(J, space.pivots, x, 7)
        return spring * (x[6] - 1.0)
    own = J[6, 6]
    for k in range(6):
        x[k], row[k] = J[k, 6], J[6, k]
    if not factorise(J, space.pivots, 6):
        return 0.0
    substitute(J, space.pivots, x, 6)
    for k in range(6):
        own += row[k] * x[k]
    return own


@njit(**BARE)
def copy_start(context, b, first_iteration, space):
    """Copy the overlaps at the start of the step to or from the table of all bodies: save them in the first iteration."""
    low, high = context.edges[b], context.edges[b + 1]
    if first_iteration:
        initial_overlaps(b, context, space.before)
        for e in range(low, high):
            context.initial_overlaps[e] = space.before[e - low]
    else:
        for e in range(low, high):
            space.before[e - low] = context.initial_overlaps[e]
        for k in range(FREEDOMS):
            space.y[k] = context.ends[b, k]


@njit(**BARE)
def begin_body(context, active, first_iteration, displacement, motion, space):
    """Set the start of the step of a body, or the end of the last iteration, and the plate's rise in its coordinates."""
    y, P, Z = space.y, context.P, active.start
    if first_iteration:
        measure_arm(context, active)
        save_start(context, active)
    copy_start(context, active.number, first_iteration, space)
    if first_iteration:
        begin_step(context, active, motion)
        predict(context, active, motion.dt, displacement, y)
    if P[active.patch, patch.SPRING] == 0.0:
        y[6] = displacement
    Z[step_start.PLATE_HEIGHT], Z[step_start.PLATE_DISPLACEMENT] = P[P.shape[0] - 1, patch.HEIGHT] + displacement, displacement


@njit(**BARE)
def write_outcome(context, active, outcome, iterations, landing, y):
    """Write what Newton's method has found for a body: its coordinates, outcome and iterations, and whether it lands."""
    T, solution = active.memory, context.solutions[active.number]
    T[step_memory.TRIES] += 1.0
    T[step_memory.ITERATIONS] += iterations
    solution[body_solution.SOLVED] = 1.0 if outcome == Outcome.SOLVED else 0.0
    solution[body_solution.CROWDED] = 1.0 if outcome == Outcome.CROWDED else 0.0
    solution[body_solution.LANDS] = 1.0 if landing else 0.0
    solution[body_solution.ITERATIONS] = iterations
    for k in range(FREEDOMS):
        context.ends[active.number, k] = y[k]


@njit(**BARE_CHUNK)
def solve_body(context, b, first_iteration, displacement, motion, space):
    """Solve the step of body b for a given rise of the plate."""
    active, y, dt = active_body(b, context), space.y, motion.dt
    begin_body(context, active, first_iteration, displacement, motion, space)
    outcome, m, iterations = newton(context, active, motion, space)
    write_outcome(context, active, outcome, iterations, lands(context, b, m, space), y)
    if outcome == Outcome.SOLVED:
        solution = context.solutions[b]
        solution[body_solution.PUSH] = plate_reaction(context, active, m, space)
        solution[body_solution.SLOPE] = plate_stiffness(context, active, m, dt, space)
        solution[body_solution.ERROR] = local_error(context, active, dt, space.diagnostics)
        solution[body_solution.ROTATION] = rotation_of(y, active.start)


@njit(**BARE_CHUNK)
def accept_body(context, b, end, whole, cuts, motion, space):
    """Accept the step of body b.

    Forces are evaluated again: recomputing the tiles is cheaper than storing them for all bodies.
    """
    active = active_body(b, context)
    copy_start(context, b, False, space)
    set_configuration(context, active, space.y, motion.dt)
    m = active_contacts(context, active, space.y, motion, space)
    residual(context, active, m, space.y, motion, space)
    accept_step(context, active, m, motion, True, space)
    end_step(context, active, motion, (end, whole, cuts), space)
    if context.labels != 0:
        update_labeller(active, context, context, space)


@njit(**BARE)
def end_step(context, active, motion, ended, space):
    """Advance clock and counters of a body after an accepted step; `ended`: its end [s], whether exactly then, how often cut."""
    end, whole, cuts = ended
    advance_clock(active.totals, motion, end, whole)
    count_step(active.memory, active.totals, motion.dt, cuts)
    active.memory[step_memory.CODE], active.memory[step_memory.SLOT] = guard_code(active.number, context, space.diagnostics)


_D, _B, _I, _ROW = types.float64, types.boolean, types.int64, types.Array(types.float64, 1, "C")


@njit(types.void(_I, _I, _B, _D, _D, _D, _D, PACKED), nogil=True, **OPTIONS)
def solve_bodies(first, last, first_iteration, displacement, dt, v_x, v_y, packed):
    """Solve the step of bodies first to last - 1 for a given rise of the plate [m].

    `first_iteration`: the step begins; otherwise the iteration continues from `ends` of the previous call. Results are written to
    `solutions` (n, body_solution.WIDTH). `packed`: a packed `ImplicitContext`.
    """
    context, motion = context_of(packed), Motion(dt, v_x, v_y)
    space = make_workspace(context)
    for b in range(first, last):
        if context.solutions[b, body_solution.IN_ISLAND] == 0.0:
            solve_body(context, b, first_iteration, displacement, motion, space)


@njit(types.void(_I, _I, _D, _B, _I, _D, _D, _D, PACKED), nogil=True, **OPTIONS)
def accept_bodies(first, last, end, whole, cuts, dt, v_x, v_y, packed):
    """Accept the step solved by `solve_bodies`, cut `cuts` times; `whole`: it ends exactly at the time `end` [s]."""
    context, motion = context_of(packed), Motion(dt, v_x, v_y)
    space = make_workspace(context)
    for b in range(first, last):
        if context.solutions[b, body_solution.IN_ISLAND] == 0.0:
            accept_body(context, b, end, whole, cuts, motion, space)


@njit(types.void(PACKED), **OPTIONS)
def restore_bodies(packed):
    """Restore all bodies to the start of the step."""
    context = context_of(packed)
    space = make_workspace(context)
    for b in range(context.totals.shape[0]):
        reject_step(context, active_body(b, context), space.y)


# -- control of the common step; T: memory of the plate, a row of `columns.step_memory` like that of a body --


@njit(types.Tuple((_D, _I))(_ROW, _D, PACKED, _D), **OPTIONS)
def common_step_length(T, t, packed, end):
    """Return length [s] and limiting cause of the next step (`step_control.next_length`)."""
    return next_length(T, t, context_of(packed), end)


@njit(types.UniTuple(_D, 4)(_ROW, _ROW, _D, _D, _D), **OPTIONS)
def plate_motion(T, V, displacement, velocity, dt):
    """Return velocity [m/s] and acceleration [m/s2] of the plate after a step, the change of the former with the rise [1/s], and
    its change beyond that of the last step, scaled [m/s].

    `velocity`: before the step; V: settings.
    """
    now, before = bdf2_weights(T, V, dt)
    after = (now * displacement - before * T[step_memory.LAST_COORDINATES + 6]) / dt
    change = now * (after - velocity) - before * T[step_memory.LAST_DRISE]
    return after, change / dt, now / dt, after - velocity - step_ratio(T, V, dt) * T[step_memory.LAST_DRISE]


@njit(_D(_D, _D, _ROW, _ROW, _D), **OPTIONS)
def plate_error(change, radius, T, V, dt):
    """Return the error of the plate's step over the tolerance (`step_control.error_of_change`)."""
    return error_of_change(abs(change), radius, T, V, dt)


@njit(_D(_B, _D, _D), **OPTIONS)
def reduction(converged, error, rotation):
    """Return the factor that shortens a rejected step."""
    return reduction_factor(converged, error, rotation)


@njit(types.void(_ROW, _D, _D, _D, _B, _B, _I), **OPTIONS)
def set_common_length(T, growth, dt, error, easy, cut, limit):
    """Set the length of the next step and what limits it (`step_control.set_next_dt`)."""
    set_next_dt(T, growth, dt, error, easy, cut, limit)


@njit(types.UniTuple(_D, 2)(_D, PACKED, _D), **OPTIONS)
def plate_velocity_of(t, packed, dt):
    """Return the mean lateral velocity (v_x, v_y) [m/s] of the upper plate over a step."""
    return plate_velocity(t, context_of(packed), dt)


@njit(_B(_D, PACKED, _D), **OPTIONS)
def is_breakpoint_at(t, packed, end):
    """Return whether the smooth interval that began at t [s] ends at a breakpoint of the motion."""
    return is_breakpoint(t, context_of(packed), end)


@njit(_D(_D, PACKED, _D), **OPTIONS)
def next_breakpoint_after(t, packed, until):
    """Return the time [s] of the next breakpoint of the motion after t, at most `until`."""
    return next_breakpoint(t, context_of(packed), until)


@njit(types.void(_ROW, types.Array(types.float64, 2, "C"), _D, _D, _D, _D), **OPTIONS)
def book_direct(totals, P, dt, v_x, v_y, old):
    """Add a step of direct contact to the totals of the plate, the last row of P (`direct_contact.book_direct_contact`)."""
    book_direct_contact(totals, P, P.shape[0] - 1, Motion(dt, v_x, v_y), old)
