"""Bodies under one common plate: they share its height and therefore its time step.

The system matrix is an arrow matrix: one block per body, and one row and column for the plate. `solve_bodies` solves the bodies
for a given rise of the plate, with the derivative of their force on the plate at equilibrium of each body: the Schur complement
of the arrow matrix. One scalar equation for the plate remains (`engine.implicit_common_plate`).
"""

from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.first_body import is_rough
from thirdbody.kernels.implicit.accept_step import accept_step
from thirdbody.kernels.implicit.bdf2 import update_labeller
from thirdbody.kernels.implicit.bundles import FREEDOMS, active_body
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
    begin_step,
    count_step,
    guard_code,
    initial_overlaps,
    local_error,
    predict,
    rotation_of,
)
from thirdbody.kernels.implicit.step_limits import lands
from thirdbody.kernels.implicit.tables import body_solution, step_memory, step_start
from thirdbody.kernels.predicates import is_upper
from thirdbody.kernels.tables import patch
from thirdbody.kernels.tile import TILE, law_output


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
