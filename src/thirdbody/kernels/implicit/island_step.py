"""Steps of islands: bodies that could meet are advanced by common steps, other bodies alone (`bdf2.step`).

Each body keeps its own BDF2 weights, so an island can form from bodies whose last steps differ. The step is that of the body
that needs the shortest one.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK, CHUNK
from thirdbody.kernels.bundles import Motion
from thirdbody.kernels.implicit.accept_pairs import accept_pairs, work_error_of_island
from thirdbody.kernels.implicit.accept_step import accept_step, reject_step
from thirdbody.kernels.implicit.band_matrix import row_length
from thirdbody.kernels.implicit.bdf2 import prescribed_displacement, set_load, update_labeller
from thirdbody.kernels.implicit.bundles import FREEDOMS
from thirdbody.kernels.implicit.friction_work import MIN_CUT
from thirdbody.kernels.implicit.island_bundles import Island, active_at, make_pool, space_at
from thirdbody.kernels.implicit.island_newton import newton_of_island
from thirdbody.kernels.implicit.newton import Outcome
from thirdbody.kernels.implicit.pair_contacts import pair_lands, save_pair_overlaps, turn_of_normals
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
from thirdbody.kernels.implicit.tables import step_memory, step_settings
from thirdbody.kernels.labeller_input import Observed
from thirdbody.kernels.periodic import box_of
from thirdbody.kernels.tables import run_totals


@njit(**BARE_CHUNK)
def save_starts(context, island, pool):
    """Save the state of all bodies and the overlaps of their candidates at the start of a step."""
    for a in range(island.bodies.shape[0]):
        measure_arm(context, active_at(a, context, island))
        save_start(context, active_at(a, context, island))
        initial_overlaps(island.bodies[a], context, pool.before[a])
    save_pair_overlaps(context, island)


@njit(**BARE_CHUNK)
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


@njit(**BARE_CHUNK)
def begin_steps(context, island, motion, pool):
    """Set the weights of a step of all bodies, and predict its end."""
    for a in range(island.bodies.shape[0]):
        active = active_at(a, context, island)
        begin_step(context, active, motion)
        set_load(context, active, motion.dt)
        predict(context, active, motion.dt, prescribed_displacement(context, active, motion.dt), space_at(a, pool).y)


@njit(**BARE_CHUNK)
def errors_of(context, island, m, converged, motion, pool):
    """Return the largest error of a body over the tolerance, and the largest rotation of a body or turn of a normal."""
    error, rotation, V = 0.0, turn_of_normals(max(m, 0), pool), context.settings
    for a in range(island.bodies.shape[0]):
        active, space = active_at(a, context, island), space_at(a, pool)
        error = max(error, local_error(context, active, motion.dt, space.diagnostics))
        rotation = max(rotation, rotation_of(space.y, active.start))
    if converged and V[step_settings.INERTIAL] != 0.0 and motion.dt > MIN_CUT * V[step_settings.SHORTEST]:
        error = max(error, work_error_of_island(context, island, m, motion, pool))
    return error, rotation


@njit(**BARE_CHUNK)
def island_lands(context, island, m, pool):
    """Return whether a contact of the island closed within the step."""
    for a in range(island.bodies.shape[0]):
        if lands(context, island.bodies[a], max(pool.counts[a], 0), space_at(a, pool)):
            return True
    return pair_lands(context, max(m, 0), pool)


@njit(**BARE_CHUNK)
def give_up(context, island, outcome, pool):
    """Return all bodies to the start of the step, and stop them."""
    code = np.int64(Stop.CROWDED if outcome == Outcome.CROWDED else Stop.UNSOLVED)
    for a in range(island.bodies.shape[0]):
        context.memory[island.bodies[a], step_memory.CODE] = code
        reject_step(context, active_at(a, context, island), space_at(a, pool).y)


@njit(**BARE_CHUNK)
def accept_bodies(context, island, m, motion, pool):
    """Accept the step of all bodies and of the contacts between them."""
    for a in range(island.bodies.shape[0]):
        accept_step(context, active_at(a, context, island), pool.counts[a], motion, False, space_at(a, pool))
    accept_pairs(context, island, m, motion, pool)


@njit(**BARE_CHUNK)
def label_bodies(context, tables, island, pool):
    """Update the labeller's memory of all bodies after their step."""
    observed = Observed(
        context.own, context.partner, tables.all_edges, tables.all_incidence, context.B, context.E,
        context.orientations, context.H, context.R, context.M, context.drag, context.n_history, context.width,
    )  # fmt: skip
    for a in range(island.bodies.shape[0]):
        update_labeller(active_at(a, context, island), observed, context, space_at(a, pool))


@njit(**BARE_CHUNK)
def skip_rest(context, island, end):
    """End an interval that is shorter than any step: a stop that misses a breakpoint by rounding."""
    for a in range(island.bodies.shape[0]):
        context.totals[island.bodies[a], run_totals.TIME] = end
        context.memory[island.bodies[a], step_memory.LAST_DT] = 0.0


@njit(**BARE_CHUNK)
def count_try(context, island, iterations):
    """Count a trial step of all bodies."""
    for a in range(island.bodies.shape[0]):
        context.memory[island.bodies[a], step_memory.TRIES] += 1.0
        context.memory[island.bodies[a], step_memory.ITERATIONS] += iterations


@njit(**BARE_CHUNK)
def island_step(context, tables, island, until, pool):
    """Make one step of the island, shortened until it is accepted; set the codes of its bodies if they have to stop."""
    V, time = context.settings, context.totals[island.bodies[0], run_totals.TIME]
    end = next_breakpoint(time, context, until)
    if end - time < V[step_settings.SHORTEST]:
        skip_rest(context, island, end)
        return
    save_starts(context, island, pool)
    (dt, limit), cuts = common_length(context, island, time, end), 0
    while True:
        whole = dt >= NEARLY * (end - time)
        dt = end - time if whole else dt
        v_x, v_y = plate_velocity(time, context, dt)
        motion = Motion(dt, v_x, v_y)
        begin_steps(context, island, motion, pool)
        outcome, m, iterations = newton_of_island(context, island, motion, pool)
        count_try(context, island, iterations)
        converged = outcome == Outcome.SOLVED
        error, rotation = errors_of(context, island, m, converged, motion, pool)
        if converged and error <= 1.0 and rotation <= MAX_ROTATION:
            break
        cuts += 1
        limit = why_cut(island_lands(context, island, m, pool), converged, error, rotation)
        dt *= reduction_factor(converged, error, rotation)
        if outcome == Outcome.CROWDED or dt < V[step_settings.SHORTEST]:
            give_up(context, island, outcome, pool)
            return
    accept_bodies(context, island, m, motion, pool)
    ended = end, whole, whole and is_breakpoint(time, context, end)
    for a in range(island.bodies.shape[0]):
        step = motion, error, iterations <= EASY, cuts, limit
        finish_step(context, active_at(a, context, island), step, ended, pool.diagnostics[a])
    if context.labels != 0:
        label_bodies(context, tables, island, pool)


@njit(**BARE)
def island_of(h, context, tables):
    """Return island h."""
    return Island(
        tables.bodies[tables.body_edges[h] : tables.body_edges[h + 1]],
        tables.pairs[tables.pair_edges[h] : tables.pair_edges[h + 1]], tables.position,
        FREEDOMS * (tables.widths[h] + 1) - 1, box_of(context.D),
    )  # fmt: skip


@njit(**CHUNK)
def pool_of_part(part, context, tables):
    """Return the scratch for the islands of a part."""
    bodies, pairs, band = np.int64(1), np.int64(1), np.int64(1)
    for p in range(tables.part_edges[part], tables.part_edges[part + 1]):
        island = island_of(tables.order[p], context, tables)
        bodies, pairs = max(bodies, island.bodies.shape[0]), max(pairs, island.pairs.shape[0])
        band = max(band, FREEDOMS * island.bodies.shape[0] * row_length(island.half_width))
    return make_pool(context, bodies, pairs, band)
