"""BDF2 steps of islands: advanced to a time by individual steps, from one body to many; and of ensembles.

A step that Newton's method or the error estimate rejects is shortened; step lengths grow again afterwards. No step crosses a
breakpoint of the prescribed motion. BDF2 damps modes faster than the step, as backward Euler does, and is of second order. Each
body of an island keeps its own BDF2 weights; the step is that of the body that needs the shortest one.

In an ensemble a body has rows for all its candidates, and for its spheres, only while it is advanced; else rows of closed
contacts, of a batch of bodies one after the other. The rows of one body stay in the first cache until its closed ones are written
back.
"""

import math
from collections import namedtuple

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import PACKED, Unpacked, first_words, function_at, make_unpacker
from thirdbody.jit.options import BARE, BARE_CHUNK, DIRECT, NO_COUNTS, OPTIONS, entry
from thirdbody.kernels import schedule
from thirdbody.kernels.arguments import OBSERVE_BODIES, Motion, as_observed
from thirdbody.kernels.bodies import place_as_it_is
from thirdbody.kernels.contact_zone import book_zone, gap, has_zone, load_of, locate, pressure
from thirdbody.kernels.implicit import books, control, workspace
from thirdbody.kernels.implicit.accept_step import accept_step, reject_step
from thirdbody.kernels.implicit.control import BodyStop
from thirdbody.kernels.implicit.newton import NewtonOutcome, solve_island
from thirdbody.kernels.implicit.residual import MAX_ROTATION, measure_arm, save_start
from thirdbody.kernels.implicit.workspace import ADVANCE, KINDS, STAGE, ImplicitContext, body_at, call_part, context_of, space_at
from thirdbody.kernels.memory import CLOSED, compact, expand, keep
from thirdbody.kernels.plates import book_direct_contact, has_effect_columns, is_rough
from thirdbody.kernels.step_tables import step_memory, step_settings, step_start
from thirdbody.kernels.tables import body, body_extra, patch, run_totals, sphere

observe_bodies_at = function_at(OBSERVE_BODIES)

PASSED = -1.0  # last step [s] of a body that was not solved: the next one starts anew

STILL = 1e-3
"""Way in a step, over the radius that limits the drag, below which a body lies still: at that speed it would slide on by less
than an atom."""


@njit(**BARE)
def common_length(context, island, time, end):
    """Return the shortest length [s] of the next step that a body needs, and its cause; all bodies then request the same."""
    shortest, cause, requested, limit = np.inf, np.int64(0), np.inf, 0.0
    for a in range(island.n):
        T = context.memory[body_at(a, island)]
        dt, why = control.next_length(T, time, context, end)
        if dt < shortest:
            shortest, cause = dt, why
        if T[step_memory.NEXT_DT] < requested:
            requested, limit = T[step_memory.NEXT_DT], T[step_memory.LIMIT]
    for a in range(island.n):
        T = context.memory[body_at(a, island)]
        T[step_memory.NEXT_DT], T[step_memory.LIMIT] = requested, limit
    return shortest, cause


@njit(**BARE)
def begin_steps(motion, context, island, scratch):
    P, rows, first, dt = context.P, context.schedule, context.first, motion.dt
    driven, loaded = first[schedule.GAP + 1] > first[schedule.GAP], first[schedule.LOAD + 1] > first[schedule.LOAD]
    for a in range(island.n):
        b, space = body_at(a, island), space_at(a, scratch)
        p, t, Z, displacement = context.patch[b], context.totals[b, run_totals.TIME], space.start, 0.0
        if loaded and P[p, patch.NOMINAL_LOAD] != 0.0:
            now = schedule.segment(rows, first, np.int64(schedule.LOAD), t)  # no step crosses a breakpoint
            P[p, patch.LOAD] = P[p, patch.NOMINAL_LOAD] * schedule.value_of(rows, now, t + dt)
        if driven:
            displacement = schedule.mean_rate(rows, first, np.int64(schedule.GAP), t, dt) * dt
        if P[p, patch.SPRING] != 0.0:
            height = schedule.value(rows, first, np.int64(schedule.GAP), t + dt) if driven else P[P.shape[0] - 1, patch.HEIGHT]
            Z[step_start.PLATE_HEIGHT], Z[step_start.PLATE_DISPLACEMENT] = height, displacement
        control.begin_step(context, b, displacement, motion, space)
        if has_zone(context):
            predict_load(b, motion, context, space)


@njit(**BARE)
def predict_load(b, motion, context, space):
    """Set the load of the patch of body b at the predicted end of the step, whose position is off by far less than a contact."""
    y, Z, B = space.y, space.start, context.B
    # the patch is at the end of the step already, the body where the last trial left it
    dx, dy = Z[step_start.POSITION] - B[b, body.POSITION], Z[step_start.POSITION + 1] - B[b, body.POSITION + 1]
    before = locate(b, context, dx + motion.dt * motion.v_x, dy + motion.dt * motion.v_y)
    after = locate(b, context, dx + y[0], dy + y[1])
    context.P[context.patch[b], patch.LOAD] = load_of(b, context, Z[step_start.PATCH_HEIGHT], after, before, after, motion.dt)


@njit(**BARE_CHUNK)
def assess_island(m, converged, motion, context, island, scratch):
    """Return the largest error of a body over the tolerance, of the motion and, with inertia, of the friction work; the largest
    rotation of a body or turn of a normal; and whether a contact of the island closed within the step."""
    error, rotation, landing, V, m = 0.0, 0.0, False, context.settings, max(m, 0)
    pairs = island.n_pairs > 0
    if pairs:
        call_part(context.pairs_part, STAGE.ERRORS, 0, m, motion, context, island, scratch)
        rotation, landing = scratch.answer[0], scratch.answer[1] != 0.0
    of_work = converged and V[step_settings.INERTIAL] != 0.0 and motion.dt > books.MIN_CUT * V[step_settings.SHORTEST]
    for a in range(island.n):
        b, space, n = body_at(a, island), space_at(a, scratch), max(scratch.counts[a], 0)
        for q in range(n):
            landing = landing or context.start_depths[space.slots[q]] < 0.0
        y = space.y
        error = max(error, control.local_error(context, b, motion.dt, space))
        rotation = max(rotation, math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5]) / space.start[step_start.ARM])
        if of_work and context.force >= 0:
            lost, scale = books.work_error_of_plates(context, b, n, motion, space), books.energy_scale(context, b, n, space)
            if pairs:
                lost, scale = lost + scratch.errors[a, 0], scale + books.FLOOR * scratch.errors[a, 1]
            error = max(error, lost / max(V[step_settings.WORK] * scale, 1e-300))
    return error, rotation, landing


@njit(**BARE_CHUNK)
def accept_island(m, motion, common, ended, context, island, scratch):
    """Accept the step of all bodies and of the m contacts between them. `ended`: see `control.close_step`."""
    observe = observe_bodies_at(context.observe_bodies)
    for a in range(island.n):
        accept_step(context, body_at(a, island), scratch.counts[a], motion, common, space_at(a, scratch))
    if island.n_pairs > 0:
        call_part(context.pairs_part, STAGE.ACCEPT, 0, m, motion, context, island, scratch)
    for a in range(island.n):
        b, A = body_at(a, island), context.totals[body_at(a, island)]
        control.close_step(context, b, motion, ended, space_at(a, scratch))
        if context.labels != 0:
            observe(b, b + 1, as_observed(context), A, context.observe, scratch.observed, scratch.rows)
            A[run_totals.ELAPSED], A[run_totals.SHIFT_X], A[run_totals.SHIFT_Y] = 0.0, 0.0, 0.0


@njit(**BARE)
def lies_still(b, dt, context, space):
    """Return whether body b lies on the lower plate, touches nothing else, and moves by less than STILL in a time dt [s]."""
    A, T, B, E = context.totals[b], context.memory[b], context.B, context.E
    supported = A[run_totals.LOWER_FORCE + 2] != 0.0 or not has_effect_columns(E) or E[b, body_extra.EFFECT_FORCE + 2] == 0.0
    if not supported or A[run_totals.UPPER_FORCE + 2] != 0.0 or T[step_memory.LAST_DT] == 0.0:
        return False
    now, before, arm = 0.0, 0.0, space.start[step_start.ARM]
    for k in range(3):
        v, w = B[b, body.VELOCITY + k], arm * B[b, body.SPIN + k]
        now += v * v + w * w
        before += (v - T[step_memory.LAST_DV + k]) ** 2 + (w - arm * T[step_memory.LAST_DW + k]) ** 2
    return dt * math.sqrt(max(now, before)) < STILL * T[step_memory.DRAG_RADIUS]


@njit(**BARE)
def pass_outside(b, time, end, context, space):
    """Advance body b, alone outside the contact of the first bodies, without solving it: it has left the domain, or lies still
    and the contact does not reach it. Its patch goes on, and the plates carry its load of the start. Returns whether it did."""
    A, T, P, p = context.totals[b], context.memory[b], context.P, context.patch[b]
    if P[p, patch.INSIDE] > 0.0:
        return False
    dt, left = end - time, P[p, patch.INSIDE] < 0.0
    v_x, v_y = control.plate_velocity(time, context, dt)
    distance, longest = dt * math.sqrt(v_x * v_x + v_y * v_y), control.longest_drag(context.settings, T)
    if distance > longest and not left:
        dt *= longest / distance
        v_x, v_y = control.plate_velocity(time, context, dt)
    x, y = locate(b, context, -dt * v_x, -dt * v_y)
    height, top = P[p, patch.OUTSIDE_HEIGHT] + gap(x, y, context.zone), 0.0
    for i in range(context.start[b], context.start[b + 1]):
        top = max(top, context.S[i, sphere.Z] + context.S[i, sphere.RADIUS])
    if not left and (height <= top or is_rough(context) or pressure(x, y, context.zone) > 0.0):
        return False
    if not left and not lies_still(b, dt, context, space):
        return False
    motion = Motion(dt, v_x, v_y)
    P[p, patch.DISPLACEMENT] += dt * v_x
    P[p, patch.DISPLACEMENT + 1] += dt * v_y
    P[p, patch.HEIGHT], P[p, patch.VELOCITY] = height, (height - P[p, patch.HEIGHT]) / dt
    book_direct_contact(A, (book_zone(b, context, motion), P[p, patch.DIRECT_FRICTION]), motion, 0.5)
    for k in range(3):
        A[run_totals.LOWER_IMPULSE + k] += dt * A[run_totals.LOWER_FORCE + k]
    schedule.pass_time(A, dt, v_x, v_y)
    A[run_totals.TIME], T[step_memory.LAST_DT] = end if dt == end - time else time + dt, PASSED
    return True


@njit(**BARE_CHUNK)
def step(until, context, island, scratch):
    V, time = context.settings, context.totals[body_at(0, island), run_totals.TIME]
    end = control.next_breakpoint(time, context, until)
    if end - time < V[step_settings.SHORTEST]:
        # the interval is shorter than any step: a stop that misses a breakpoint by rounding
        for a in range(island.n):
            b = body_at(a, island)
            context.totals[b, run_totals.TIME], context.memory[b, step_memory.LAST_DT] = end, 0.0
        return
    if has_zone(context) and island.n == 1 and pass_outside(body_at(0, island), time, end, context, space_at(0, scratch)):
        return
    for a in range(island.n):
        save_start(a, context, island, scratch)
    if island.n_pairs > 0:
        call_part(context.pairs_part, STAGE.START, 0, 0, Motion(0.0, 0.0, 0.0), context, island, scratch)
    (dt, limit), cuts = common_length(context, island, time, end), 0
    while True:
        whole = dt >= control.NEARLY * (end - time)
        dt = end - time if whole else dt
        v_x, v_y = control.plate_velocity(time, context, dt)
        motion = Motion(dt, v_x, v_y)
        begin_steps(motion, context, island, scratch)
        outcome, m, iterations = solve_island(motion, context, island, scratch)
        for a in range(island.n):
            b = body_at(a, island)
            context.memory[b, step_memory.TRIES] += 1.0
            context.memory[b, step_memory.ITERATIONS] += iterations
        converged = outcome == NewtonOutcome.SOLVED
        error, rotation, landing = assess_island(m, converged, motion, context, island, scratch)
        if converged and error <= 1.0 and rotation <= MAX_ROTATION:
            break
        cuts += 1
        limit = control.why_cut(landing, converged, error, rotation)
        dt *= control.reduction_factor(converged, error, rotation)
        if outcome == NewtonOutcome.CROWDED or dt < V[step_settings.SHORTEST]:
            for a in range(island.n):
                code = control.BodyStop.CROWDED if outcome == NewtonOutcome.CROWDED else control.BodyStop.UNSOLVED
                context.memory[body_at(a, island), step_memory.CODE] = np.int64(code)
                reject_step(context, body_at(a, island), space_at(a, scratch))
            return
    accept_island(m, motion, False, (end, whole, cuts), context, island, scratch)
    for a in range(island.n):
        T = context.memory[body_at(a, island)]
        if whole and control.next_breakpoint(time, context, np.inf) <= end:
            T[step_memory.LAST_DT], T[step_memory.JUMPED] = 0.0, 0.0  # differences across a breakpoint are invalid
        T[step_memory.LIMITED + limit] += 1.0
        control.set_next_dt(T, V[step_settings.GROWTH], dt, error, iterations <= control.EASY, cuts > 0, limit)


@entry(workspace.ADVANCE, nogil=True, **OPTIONS, **NO_COUNTS)
def advance_islands(first, last, until, tries, packed, tables, packed_scratch):
    """Advance the islands `order[first:last]` in sequence to the time `until` [s], each with at most `tries` trial steps; the
    next call continues it bit for bit. A body stopped by a guard stays at the end of its last step."""
    context, islands, scratch = workspace.unpack(packed, tables, packed_scratch)
    for p in range(first, last):
        island, going = workspace.island_at(islands.order[p], islands), True
        one = body_at(0, island)
        last_try = context.memory[one, step_memory.TRIES] + tries
        for a in range(island.n):
            measure_arm(context, body_at(a, island), space_at(a, scratch))
        while True:
            for a in range(island.n):
                going = going and context.memory[body_at(a, island), step_memory.CODE] == control.BodyStop.NONE.value
            going = going and context.totals[one, run_totals.TIME] < until and context.memory[one, step_memory.TRIES] < last_try
            if not going:
                break
            step(until, context, island, scratch)


# -- ensembles --

_WORDS = first_words(KINDS)
H_ADDRESS, R_ADDRESS, S_ADDRESS, DEPTHS_ADDRESS = (_WORDS[name] for name in ("H", "R", "S", "start_depths"))
"""Words of the packed arguments that hold the addresses of the tables that exist for one body at a time."""

changing_context_of = make_unpacker(Unpacked(KINDS, ImplicitContext, changing=True))

advance_at = function_at(ADVANCE)

Span = namedtuple("Span", "first last low high advance")
"""Bodies `first` to `last` - 1 of a batch, of which `low` to `high` - 1 are advanced; address of `driver.advance_islands`."""

OneBody = namedtuple("OneBody", "H R S depths radii")
"""Tables with room for the candidates and the spheres of any body; radii of all spheres, or none where spheres are kept."""


@njit(**BARE)
def point_to(table, row, word, packed):
    """Set the address of a table in the packed arguments so that its first row is the one of that number."""
    packed[word] = table.ctypes.data - row * table.strides[0]


_TABLE, _ROW, _LONG = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C"), types.int64
SPAN, ONE_BODY = types.NamedUniTuple(_LONG, 5, Span), types.NamedTuple((_TABLE, _TABLE, _TABLE, _ROW, _ROW), OneBody)


@entry(
    _LONG(SPAN, types.float64, types.float64, PACKED, PACKED, PACKED, types.UniTuple(CLOSED, 2), ONE_BODY), nogil=True, **DIRECT
)
def advance_batch(span, until, tries, packed, tables, packed_scratch, contacts, one):
    """Advance bodies of a batch; write its closed contacts, and return their number. `packed`: an `ImplicitContext`, in which the
    addresses of the tables of `one` body are changed; `contacts`: closed ones before, and room for all candidates."""
    closed, new = contacts
    context, n_closed = context_of(packed), np.int64(closed.on.shape[0])
    begin, p, written = context.plate_edges[span.first], np.int64(0), np.int64(0)
    for b in range(span.first, span.last):
        k = context.plate_edges[b]
        first, n, after = k - begin, context.plate_edges[b + 1] - k, p
        while after < n_closed and closed.on[after] < first + n:
            after += 1
        waits = context.memory[b, step_memory.CODE] == BodyStop.NONE.value and context.totals[b, run_totals.TIME] < until
        if span.low <= b < span.high and waits:
            expand(n, p, first, closed, one.H, one.R)
            point_to(one.H, k, H_ADDRESS, packed)
            point_to(one.R, k, R_ADDRESS, packed)
            point_to(one.depths, k, DEPTHS_ADDRESS, packed)
            if one.radii.shape[0] > 0:
                point_to(one.S, context.start[b], S_ADDRESS, packed)
                own = changing_context_of(packed)
                for s in range(own.start[b], own.start[b + 1]):
                    own.S[s, sphere.RADIUS], own.S[s, sphere.MASS] = one.radii[s], own.B[b, body.MASS]
                place_as_it_is(b, own.start, own.offsets, own.S, own.B, own.orientations)
            advance_at(span.advance)(np.int64(b), np.int64(b + 1), until, tries, packed, tables, packed_scratch)
            written = compact(n, written, first, one.H, one.R, new)
        else:
            written = keep(p, after, written, closed, new)
        p = after
    return written
