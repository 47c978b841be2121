"""The step loop: velocity Verlet of bodies and plate patches, many steps in one compiled call.

It returns to Python only for events: a target reached, a search due, a new time step, a guard.
"""

from enum import IntEnum

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import PACKED, function_at
from thirdbody.jit.options import BARE, BARE_CHUNK, DIRECT, NO_COUNTS, entry
from thirdbody.jit.simd import broadcast, extract, load
from thirdbody.jit.threads import DISMISSED, DONE, close_pass, count_up, load_word, next_part, open_pass, wait_again
from thirdbody.kernels.arguments import EARLY, LATE, OBSERVATION, RUN_GROUPS, Step, context_of
from thirdbody.kernels.bodies import BODIES, STEPS, largest_displacement, weight_of
from thirdbody.kernels.contact_zone import book_zone, has_zone, load_of, locate
from thirdbody.kernels.drive import begin_step, end_step, is_sprung
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.explicit.passes import closing_kick
from thirdbody.kernels.plates import book_direct_contact, direct_force
from thirdbody.kernels.schedule import GAP, LOAD, X, Y, mean_rate, pass_time, value
from thirdbody.kernels.step_tables import chunk_motion, contact_sums
from thirdbody.kernels.tables import body, body_extra, domain, patch, run_totals


class Stop(IntEnum):
    """Reasons why `advance` returned. Guards come with the candidate or body that tripped them."""

    DONE = 0  # the target is reached
    SEARCH = 1  # A search is due
    BUDGET = 2  # all steps were made
    OVERLAP = 3  # guard: a contact is too deep
    TRAVEL = 4  # guard: a body moved too far in a step
    BAD_CONTACT = 5  # guard: a force is not finite
    BAD_BODY = 6  # guard: a position is not finite
    LEFT = 7  # guard: a body left the domain
    RECORD = 8  # the target is one step ahead, and there is no table for the records of contacts


NEARLY = 1.000001  # a target that is missed only by rounding counts as reached, so that the run does not add a step for it
PARTS_PER_THREAD = 4  # parts of a pass per thread: if a thread is delayed, its last part goes to another thread
ANNOUNCED = 1 + len(Step._fields)  # numbers of a pass as the helpers get it: its number, then the fields of `Step`

FEW = 2
"""Groups below which one thread does all: some 100 us of work. Waking others costs 5 us, or ms if their cores are busy."""


@njit(**BARE)
def drift_patches(P, schedule, first, t, step):
    """Apply half kick and drift to the patches. Those of prescribed height, neither free nor sprung, get their velocity from `t`,
    the start of the step, to its end. Returns the largest change of a height since the last search, one step ahead [m]."""
    dt, path = step.dt, 0.0
    for p in range(P.shape[0]):
        if first[GAP + 1] != first[GAP] and P[p, patch.SPRING] == 0.0 and P[p, patch.FREE] == 0.0:
            P[p, patch.VELOCITY] = mean_rate(schedule, first, np.int64(GAP), t, dt)
        if P[p, patch.FREE] != 0.0:
            force = P[p, patch.FORCE] - P[p, patch.LOAD] - P[p, patch.DAMPING] * P[p, patch.VELOCITY]
            P[p, patch.VELOCITY] += 0.5 * dt / P[p, patch.MASS] * force
        P[p, patch.HEIGHT] += dt * P[p, patch.VELOCITY]
        P[p, patch.DISPLACEMENT] += dt * step.v_x
        P[p, patch.DISPLACEMENT + 1] += dt * step.v_y
        path = max(path, abs(P[p, patch.HEIGHT] - P[p, patch.SEARCH_HEIGHT]) + dt * abs(P[p, patch.VELOCITY]))
    return path


@njit(**BARE)
def kick_patches(context, step):
    """Set the loads of the patches, sum the upward forces on them and the plate: of debris, direct contact, springs. Then apply
    their closing half kick, implicit in the dashpots: no overshoot."""
    P, E, schedule, first, plate = context.P, context.E, context.schedule, context.first, context.P.shape[0] - 1
    if first[LOAD + 1] != first[LOAD]:
        factor = value(schedule, first, np.int64(LOAD), step.time)
        for p in range(P.shape[0]):
            if P[p, patch.NOMINAL_LOAD] != 0.0:
                P[p, patch.LOAD] = factor * P[p, patch.NOMINAL_LOAD]
    if has_zone(context):
        load_by_position(context, step)
    if plate == 0:
        P[0, patch.FORCE] = force_of_debris(context.sums) + direct_force(P, np.int64(0))
    else:
        for p in range(plate):
            P[p, patch.FORCE] = 0.0
        P[plate, patch.FORCE] = direct_force(P, plate)
        for b in range(E.shape[0]):
            P[context.patch[b], patch.FORCE] -= E[b, body_extra.UPPER_PUSH]
        for p in range(plate):
            spring = P[p, patch.SPRING] * (P[p, patch.HEIGHT] - P[plate, patch.HEIGHT])
            P[p, patch.FORCE] -= spring
            P[plate, patch.FORCE] += spring
    for p in range(P.shape[0]):
        if P[p, patch.FREE] != 0.0:
            half = 0.5 * step.dt / P[p, patch.MASS]
            P[p, patch.VELOCITY] = (P[p, patch.VELOCITY] + half * (P[p, patch.FORCE] - P[p, patch.LOAD])) / (
                1.0 + half * P[p, patch.DAMPING]
            )


@njit(**BARE)
def load_by_position(context, step):
    """Set the loads of the patches at the end of a step; outside the contact by the gap that is one step ahead."""
    P, B = context.P, context.B
    for b in range(B.shape[0]):
        v_x, v_y, now = B[b, body.VELOCITY] - step.v_x, B[b, body.VELOCITY + 1] - step.v_y, locate(b, context, 0.0, 0.0)
        after = locate(b, context, step.dt * v_x, step.dt * v_y)
        load = load_of(b, context, P[context.patch[b], patch.HEIGHT], now, now, after, step.dt)
        P[context.patch[b], patch.LOAD] = load if P[context.patch[b], patch.INSIDE] >= 0.0 else 0.0


@njit(**BARE)
def book_zones(A, context, step):
    """Book what direct contact carries instead of debris that left the contact of the first bodies."""
    force = 0.0
    for b in range(context.B.shape[0]):
        force += book_zone(b, context, step)
    book_direct_contact(A, (force, context.P[0, patch.DIRECT_FRICTION]), step, 0.5)


@njit(**BARE)
def force_of_debris(sums):
    push = 0.0
    for c in range(sums.shape[0]):
        push -= sums[c, contact_sums.UPPER_FORCE + 2]
    return push


@njit(**BARE)
def patch_powers(P, first, last):
    """Return the power of the loads of free patches, less force times velocity of the others, and that of their dashpots [W]."""
    load, damping, power = 0.0, 0.0, 0.0
    for p in range(first, last):
        if P[p, patch.FREE] != 0.0:
            load -= P[p, patch.LOAD] * P[p, patch.VELOCITY]
            damping += P[p, patch.DAMPING] * P[p, patch.VELOCITY] * P[p, patch.VELOCITY]
        else:
            power -= P[p, patch.FORCE] * P[p, patch.VELOCITY]
    return load + power, damping


@njit(**BARE)
def update_ledger(context, step):
    """Add the step to the ledger, where bodies do not influence each other to one for each group, to impulses and distances."""
    A, ledgers, P, n = context.A, context.ledgers, context.P, context.B.shape[0]
    if ledgers.shape[0] == 0:
        powers = patch_powers(P, np.int64(0), np.int64(P.shape[0]))
        book_step(A, np.int64(0), np.int64(context.lowest.shape[0]), powers, context, step)
    for g in range(ledgers.shape[0]):
        first, last = g * GROUP * BODIES, min((g + 1) * GROUP * BODIES, n)
        if P.shape[0] == n:
            powers = patch_powers(P, first, last)
        else:  # a plate of prescribed height, or none
            powers = -force_of_debris(context.sums[2 * g : 2 * g + 2]) * P[0, patch.VELOCITY], 0.0
        book_step(ledgers[g], g, g + 1, powers, context, step)
    plate, before = P.shape[0] - 1, A[run_totals.DIRECT_WORK]
    whole = ledgers[0] if ledgers.shape[0] > 0 else A
    if P[plate, patch.DIRECT_PREFACTOR] != 0.0:
        book_direct_contact(whole, (direct_force(P, plate), P[plate, patch.DIRECT_FRICTION]), step, 0.5)
    if has_zone(context):
        book_zones(whole, context, step)
    if is_sprung(context):
        end_step(context, A[run_totals.DIRECT_WORK] - before, step)
    pass_time(A, step.dt, step.v_x, step.v_y)
    steps, weights = np.int64(A[run_totals.STEPS]) % STEPS, 0.0
    for k in range(steps):
        weights += weight_of(k)
    A[run_totals.BEHIND] = step.dt * (steps - weights)  # of the orientations of single spheres; negative: ahead


@njit(**BARE_CHUNK)
def book_step(A, begin, end, powers, context, step):
    """Add the step of groups begin to end to their ledger A. Contacts supply energies; other powers are integrated by the
    trapezoidal rule. `powers`: of what moves the patches, and of their dashpots [W]."""
    sums, moves, (lifted, patch_damping) = context.sums, context.moves, powers
    work, damped, effects, upper, lower = 0.0, 0.0, 0.0, broadcast(0.0), broadcast(0.0)
    for c in range(2 * begin, 2 * end):
        work += sums[c, contact_sums.FRICTION_WORK]
        damped += sums[c, contact_sums.DAMPING_WORK]
        upper, lower = upper - load(sums, c, contact_sums.UPPER_FORCE), lower - load(sums, c, contact_sums.LOWER_FORCE)
    for c in range(GROUP * begin, min(GROUP * end, moves.shape[0])):
        effects += moves[c, chunk_motion.EFFECT_POWER]
    half = 0.5 * step.dt
    A[run_totals.FRICTION_WORK] += work
    A[run_totals.DAMPING_WORK] += damped + half * (A[run_totals.PATCH_POWER] + patch_damping)
    A[run_totals.EFFECT_WORK] += half * (A[run_totals.EFFECT_POWER] + effects)
    drag = -half * (
        (A[run_totals.UPPER_FORCE] + extract(upper, 0)) * step.v_x
        + (A[run_totals.UPPER_FORCE + 1] + extract(upper, 1)) * step.v_y
    )
    plate = drag + half * (A[run_totals.LOAD_POWER] + lifted)
    A[run_totals.DRAG_WORK] += drag
    A[run_totals.PLATE_WORK] += plate
    A[run_totals.PLATE_WORK_SIZE] += abs(plate)
    up, low = (extract(upper, 0), extract(upper, 1), extract(upper, 2)), (extract(lower, 0), extract(lower, 1), extract(lower, 2))
    for k in range(3):
        A[run_totals.UPPER_IMPULSE + k] += half * (A[run_totals.UPPER_FORCE + k] + up[k])
        A[run_totals.LOWER_IMPULSE + k] += half * (A[run_totals.LOWER_FORCE + k] + low[k])
        A[run_totals.UPPER_FORCE + k], A[run_totals.LOWER_FORCE + k] = up[k], low[k]
    A[run_totals.PATCH_POWER], A[run_totals.EFFECT_POWER], A[run_totals.LOAD_POWER] = patch_damping, effects, lifted
    if step.record:
        A[run_totals.STORED_NORMAL] = A[run_totals.STORED_TANGENTIAL] = 0.0
        for c in range(2 * begin, 2 * end):
            A[run_totals.STORED_NORMAL] += sums[c, contact_sums.STORED_NORMAL]
            A[run_totals.STORED_TANGENTIAL] += sums[c, contact_sums.STORED_TANGENTIAL]


@njit(**BARE)
def guard(D, sums, moves):
    for g in range(moves.shape[0]):
        if moves[g, chunk_motion.BAD_BODY] > 0.0:
            return Stop.BAD_BODY, np.int64(moves[g, chunk_motion.BAD_BODY]) - 1
    for c in range(sums.shape[0]):
        if sums[c, contact_sums.BAD_SLOT] > 0.0:
            return Stop.BAD_CONTACT, np.int64(sums[c, contact_sums.BAD_SLOT]) - 1
    for c in range(sums.shape[0]):
        if sums[c, contact_sums.MAX_OVERLAP] > D[domain.OVERLAP_GUARD]:
            return Stop.OVERLAP, np.int64(sums[c, contact_sums.SLOT])
    for g in range(moves.shape[0]):
        if moves[g, chunk_motion.LEFT_BODY] > 0.0:
            return Stop.LEFT, np.int64(moves[g, chunk_motion.LEFT_BODY]) - 1
        if moves[g, chunk_motion.MAX_TRAVEL] > D[domain.TRAVEL_GUARD]:
            return Stop.TRAVEL, np.int64(moves[g, chunk_motion.BODY])
    return Stop.DONE, -1


@njit(**BARE)
def skin_exhausted(path, distance, patch_path, skin):
    """Return whether two objects could cover the skin between them by the end of the next step. 10 % allow for acceleration."""
    return 1.1 * (path + distance + max(path + distance, patch_path)) > 0.9 * skin


@njit(**BARE)
def rebuild_needed(context, patch_path):
    """Return whether a search must precede the next step. Displacements are measured only if the paths could exhaust the skin."""
    A, moves, skin, distance = context.A, context.moves, context.D[domain.SKIN], 0.0
    for c in range(moves.shape[0]):
        distance = max(distance, moves[c, chunk_motion.MAX_PATH])
    A[run_totals.MAX_DISPLACEMENT] += distance
    if skin_exhausted(A[run_totals.MAX_DISPLACEMENT], distance, patch_path, skin):
        A[run_totals.MAX_DISPLACEMENT] = largest_displacement(context.X0, context.B, context.E, context.orientations)
    return skin_exhausted(A[run_totals.MAX_DISPLACEMENT], distance, patch_path, skin)


run_groups_at = function_at(RUN_GROUPS)

_I, _F = types.int64, types.float64
ADVANCE = types.Tuple((_I, _I))(_I, _F, _F, _F, _I, PACKED)


@njit(**BARE)
def parts_of(groups, threads):
    return min(groups, PARTS_PER_THREAD * threads) if threads > 1 and groups >= FEW else 1


@njit(**BARE)
def run_part(part, parts, task, step, context, packed, run_groups):
    groups = np.int64(context.lowest.shape[0])
    run_groups(task, part, part * groups // parts, (part + 1) * groups // parts, step, packed)
    count_up(context.team, DONE)


@njit(**BARE_CHUNK)
def run_pass(parts, task, threads, step, context, packed, run_groups):
    announced = context.announced
    announced[0], announced[1], announced[2] = task, step.number, step.record
    announced[3], announced[4], announced[5], announced[6] = step.time, step.dt, step.v_x, step.v_y
    announced[7], announced[8] = step.pending, step.turn
    open_pass(context.team, threads)
    part = next_part(context.team, np.int64(0), threads, parts)
    while part >= 0:
        run_part(part, parts, task, step, context, packed, run_groups)
        part = next_part(context.team, np.int64(0), threads, parts)
    close_pass(context.team, parts)


@entry(types.void(_I, _I, PACKED), nogil=True, **DIRECT, **NO_COUNTS)
def help_out(member, threads, packed):
    """Take part in the passes of `advance` as one of its threads, until it is dismissed."""
    context = context_of(packed)
    run_groups, attempts = run_groups_at(context.run_groups), np.int64(0)
    parts = parts_of(np.int64(context.lowest.shape[0]), threads)
    a = context.announced
    while load_word(context.team, DISMISSED) == 0:
        part = next_part(context.team, member, threads, parts)
        if part < 0:
            attempts = wait_again(attempts)
        else:
            step = Step(np.int64(a[1]), a[2] != 0.0, a[3], a[4], a[5], a[6], a[7], a[8])
            run_part(part, parts, np.int64(a[0]), step, context, packed, run_groups)
            attempts = np.int64(0)


@entry(ADVANCE, nogil=True, **DIRECT, **NO_COUNTS)
def advance(budget, until, distance, dt, threads, packed):
    """Advance until time `until` or `distance` is reached, a search is due, `budget` steps are done, or a guard trips. Returns
    the code, and the candidate or body that a guard names, or whether a search is due; RECORD before a step that reaches its
    target, if there is no table for its records. State is synchronised on return."""
    context = context_of(packed)
    A, schedule, first, run_groups = context.A, context.schedule, context.first, run_groups_at(context.run_groups)
    groups = context.lowest.shape[0]
    parts = parts_of(groups, threads)
    whole = parts == 1 or context.remote_body.shape[0] == 0
    context.moved[:] = 0
    code, who, pending = Stop.BUDGET, np.int64(-1), 0.0
    for n in range(budget):
        v_x = mean_rate(schedule, first, np.int64(X), A[run_totals.TIME], dt)
        v_y = mean_rate(schedule, first, np.int64(Y), A[run_totals.TIME], dt)
        speed = (v_x * v_x + v_y * v_y) ** 0.5
        last = A[run_totals.TIME] + NEARLY * dt >= until or A[run_totals.DISTANCE] + NEARLY * speed * dt >= distance
        if last and context.R.shape[0] < context.own.shape[0]:
            code = Stop.RECORD
            break
        if is_sprung(context):
            v_x, v_y = begin_step(context, v_x, v_y, dt)
        sampled = context.labels != 0 and (np.int64(A[run_totals.STEPS]) + 1) % context.stride == 0
        turn = dt * weight_of(np.int64(A[run_totals.STEPS]))
        step = Step(np.int64(n + 1), sampled or last or n == budget - 1, A[run_totals.TIME] + dt, dt, v_x, v_y, pending, turn)
        patch_path = drift_patches(context.P, schedule, first, A[run_totals.TIME], step)
        for task in range(EARLY, OBSERVATION + 1):
            if task == OBSERVATION:
                kick_patches(context, step)
                update_ledger(context, step)
            if (task == OBSERVATION and not sampled) or (whole and (task == EARLY or task == LATE)):
                continue
            if parts == 1:
                run_groups(np.int64(task), np.int64(0), np.int64(0), np.int64(groups), step, packed)
            else:
                run_pass(np.int64(parts), np.int64(task), threads, step, context, packed, run_groups)
        pending = 0.0 if step.record or context.has_effects != 0 else 1.0
        if sampled:
            A[run_totals.ELAPSED], A[run_totals.SHIFT_X], A[run_totals.SHIFT_Y] = 0.0, 0.0, 0.0
        code, who = guard(context.D, context.sums, context.moves)
        if code != Stop.DONE:
            break
        due = rebuild_needed(context, patch_path)
        if last:
            who = np.int64(due)
            break
        code, who = (Stop.SEARCH, np.int64(1)) if due else (Stop.BUDGET, np.int64(-1))
        if due:
            break
    if pending != 0.0:
        closing_kick(np.int64(0), np.int64(context.B.shape[0]), context, dt)
    return code, who
