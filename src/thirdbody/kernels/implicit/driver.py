"""BDF2 steps of islands: advanced to a time by individual steps, from one body to many.

A step that Newton's method or the error estimate rejects is shortened; step lengths grow again afterwards. The error is relative
to the radius of the largest contact: steps are short where a contact starts to slip or a body tips, and long where it slides or
rolls on. No step crosses a breakpoint of the prescribed motion. BDF2 damps modes faster than the step, as backward Euler does,
and is of second order: at 1 m/s, where inertia governs sliding, the same error takes a tenth of the steps.

Each body of an island keeps its own BDF2 weights, so an island can form from bodies whose last steps differ. The step is that of
the body that needs the shortest one.
"""

import numpy as np
from numba import njit

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, BARE_CHUNK, NO_COUNTS, OPTIONS, entry
from thirdbody.kernels.arguments import OBSERVE, Motion
from thirdbody.kernels.implicit.accept_step import accept_step, reject_step
from thirdbody.kernels.implicit.control import (
    EASY,
    NEARLY,
    Stop,
    begin_step,
    finish_step,
    initial_overlaps,
    is_breakpoint,
    lands,
    local_error,
    next_breakpoint,
    next_length,
    plate_velocity,
    predict,
    reduction_factor,
    rotation_of,
    why_cut,
)
from thirdbody.kernels.implicit.newton import Outcome, solve_island
from thirdbody.kernels.implicit.residual import MAX_ROTATION, measure_arm, save_start
from thirdbody.kernels.implicit.tables import step_memory, step_settings, step_start
from thirdbody.kernels.implicit.work import FLOOR, MIN_CUT, energy_scale, work_error_of_plates
from thirdbody.kernels.implicit.workspace import (
    ACCEPT,
    ADVANCE,
    ERRORS,
    START,
    active_at,
    call_part,
    context_of,
    island_at,
    islands_of,
    scratch_of,
    space_at,
)
from thirdbody.kernels.labels import Observed, update_body_memory
from thirdbody.kernels.schedule import GAP, LOAD, mean_rate, segment, value, value_of
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
def save_starts(motion, context, island, scratch):
    """Save the state of all bodies and the overlaps of their candidates at the start of a step."""
    for a in range(island.bodies.shape[0]):
        save_start(context, active_at(a, context, island))
        initial_overlaps(island.bodies[a], context, scratch.before[a])
    if island.pairs.shape[0] > 0:
        call_part(context.pairs_part, START, 0, 0, motion, island)


@njit(**BARE)
def common_length(context, island, time, end):
    """Return the shortest length [s] of the next step that a body needs, and its cause; all bodies then request the same."""
    shortest, cause, requested, limit = np.inf, np.int64(0), np.inf, 0.0
    for a in range(island.bodies.shape[0]):
        T = context.memory[island.bodies[a]]
        dt, why = next_length(T, time, context, end)
        if dt < shortest:
            shortest, cause = dt, why
        if T[step_memory.NEXT_DT] < requested:
            requested, limit = T[step_memory.NEXT_DT], T[step_memory.LIMIT]
    for a in range(island.bodies.shape[0]):
        T = context.memory[island.bodies[a]]
        T[step_memory.NEXT_DT], T[step_memory.LIMIT] = requested, limit
    return shortest, cause


@njit(**BARE)
def begin_steps(motion, context, island, scratch):
    """Set the weights of a step of all bodies, and predict its end."""
    for a in range(island.bodies.shape[0]):
        active = active_at(a, context, island)
        begin_step(context, active, motion)
        set_load(context, active, motion.dt)
        predict(context, active, motion.dt, prescribed_displacement(context, active, motion.dt), space_at(a, scratch).y)


@njit(**BARE_CHUNK)
def assess_island(h, m, converged, motion, packed, tables, packed_scratch):
    """Return the largest error of a body over the tolerance, the largest rotation of a body or turn of a normal, and whether a
    contact of the island closed within the step.

    The error is that of the motion and, with inertia, that of the friction work.
    """
    context, island, scratch = context_of(packed), island_at(h, packed, tables, packed_scratch), scratch_of(packed_scratch)
    error, rotation, landing, V, m = 0.0, 0.0, False, context.settings, max(m, 0)
    pairs = island.pairs.shape[0] > 0
    if pairs:
        call_part(context.pairs_part, ERRORS, 0, m, motion, island)
        rotation, landing = scratch.answer[0], scratch.answer[1] != 0.0
    of_work = converged and V[step_settings.INERTIAL] != 0.0 and motion.dt > MIN_CUT * V[step_settings.SHORTEST]
    for a in range(island.bodies.shape[0]):
        active, space, n = active_at(a, context, island), space_at(a, scratch), max(scratch.counts[a], 0)
        landing = landing or lands(context, active.number, n, space)
        error, rotation = (
            max(error, local_error(context, active, motion.dt, space.diagnostics)),
            max(rotation, rotation_of(space.y, active.start)),
        )
        if of_work and context.force >= 0:
            lost, scale = work_error_of_plates(context, active, n, motion, space), energy_scale(context, active, n, space)
            if pairs:
                lost, scale = lost + scratch.errors[a, 0], scale + FLOOR * scratch.errors[a, 1]
            error = max(error, lost / max(V[step_settings.WORK] * scale, 1e-300))
    return error, rotation, landing


@njit(**BARE_CHUNK)
def accept_island(h, m, motion, common, packed, tables, packed_scratch):
    """Accept the step of all bodies and of the m contacts between them; `common`: see `accept_step.update_ledger`."""
    context, island, scratch = context_of(packed), island_at(h, packed, tables, packed_scratch), scratch_of(packed_scratch)
    for a in range(island.bodies.shape[0]):
        accept_step(context, active_at(a, context, island), scratch.counts[a], motion, common, space_at(a, scratch))
    if island.pairs.shape[0] > 0:
        call_part(context.pairs_part, ACCEPT, 0, m, motion, island)


@njit(**BARE_CHUNK)
def label_island(h, packed, tables, packed_scratch):
    """Update the labeller's memory of all bodies after their step."""
    context, island, scratch = context_of(packed), island_at(h, packed, tables, packed_scratch), scratch_of(packed_scratch)
    islands = islands_of(tables)
    observed = Observed(
        context.own, context.partner, islands.all_edges, islands.all_incidence, context.B, context.E,
        context.orientations, context.H, context.R, context.M, context.drag, context.n_history, context.width,
    )  # fmt: skip
    for a in range(island.bodies.shape[0]):
        b, A = island.bodies[a], context.totals[island.bodies[a]]
        update_body_memory(b, observed, A, observe_at(context.observe), scratch.observed, scratch.rows)
        A[run_totals.ELAPSED], A[run_totals.SHIFT_X], A[run_totals.SHIFT_Y] = 0.0, 0.0, 0.0


@njit(**BARE_CHUNK)
def step(h, until, packed, tables, packed_scratch):
    """Make one step of island h, shortened until it is accepted; set the codes of its bodies if they have to stop."""
    context, island, scratch = context_of(packed), island_at(h, packed, tables, packed_scratch), scratch_of(packed_scratch)
    V, bodies, time = context.settings, island.bodies, context.totals[island.bodies[0], run_totals.TIME]
    end = next_breakpoint(time, context, until)
    if end - time < V[step_settings.SHORTEST]:
        # the interval is shorter than any step: a stop that misses a breakpoint by rounding
        for a in range(bodies.shape[0]):
            context.totals[bodies[a], run_totals.TIME], context.memory[bodies[a], step_memory.LAST_DT] = end, 0.0
        return
    save_starts(Motion(0.0, 0.0, 0.0), context, island, scratch)
    (dt, limit), cuts = common_length(context, island, time, end), 0
    while True:
        whole = dt >= NEARLY * (end - time)
        dt = end - time if whole else dt
        v_x, v_y = plate_velocity(time, context, dt)
        motion = Motion(dt, v_x, v_y)
        begin_steps(motion, context, island, scratch)
        outcome, m, iterations = solve_island(h, motion, packed, tables, packed_scratch)
        for a in range(bodies.shape[0]):
            context.memory[bodies[a], step_memory.TRIES] += 1.0
            context.memory[bodies[a], step_memory.ITERATIONS] += iterations
        converged = outcome == Outcome.SOLVED
        error, rotation, landing = assess_island(h, m, converged, motion, packed, tables, packed_scratch)
        if converged and error <= 1.0 and rotation <= MAX_ROTATION:
            break
        cuts += 1
        limit = why_cut(landing, converged, error, rotation)
        dt *= reduction_factor(converged, error, rotation)
        if outcome == Outcome.CROWDED or dt < V[step_settings.SHORTEST]:
            for a in range(bodies.shape[0]):
                code = Stop.CROWDED if outcome == Outcome.CROWDED else Stop.UNSOLVED
                context.memory[bodies[a], step_memory.CODE] = np.int64(code)
                reject_step(context, active_at(a, context, island), space_at(a, scratch).y)
            return
    accept_island(h, m, motion, False, packed, tables, packed_scratch)
    ended = end, whole, whole and is_breakpoint(time, context, end)
    for a in range(bodies.shape[0]):
        accepted = motion, error, iterations <= EASY, cuts, limit
        finish_step(context, active_at(a, context, island), accepted, ended, scratch.diagnostics[a])
    if context.labels != 0:
        label_island(h, packed, tables, packed_scratch)


@njit(**BARE)
def is_going(context, island, until):
    """Return whether the island has not reached the time `until` [s], and no body of it has stopped."""
    for a in range(island.bodies.shape[0]):
        if context.memory[island.bodies[a], step_memory.CODE] != Stop.NONE.value:
            return False
    return context.totals[island.bodies[0], run_totals.TIME] < until


@njit(**BARE_CHUNK)
def advance_island(h, until, tries, packed, tables, packed_scratch):
    """Advance island h, unless a guard has stopped a body of it, to a time [s], by at most `tries` trial steps."""
    context, island = context_of(packed), island_at(h, packed, tables, packed_scratch)
    T = context.memory[island.bodies[0]]
    last = T[step_memory.TRIES] + tries
    for a in range(island.bodies.shape[0]):
        measure_arm(context, active_at(a, context, island))
    while is_going(context, island, until) and T[step_memory.TRIES] < last:
        step(h, until, packed, tables, packed_scratch)


@entry(ADVANCE, nogil=True, **OPTIONS, **NO_COUNTS)
def advance_islands(first, last, until, tries, packed, tables, packed_scratch):
    """Advance the islands `order[first:last]` in sequence to the time `until` [s], with individual time steps.

    An island stops after `tries` trial steps; the next call continues it bit for bit. A body stopped by a guard has its code in
    `memory` (step_memory.CODE) and stays at the end of its last step. Threads may advance different islands at once.
    """
    islands = islands_of(tables)
    for p in range(first, last):
        advance_island(islands.order[p], until, tries, packed, tables, packed_scratch)
