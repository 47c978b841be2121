"""The step loop: velocity Verlet of bodies and plate patches, many steps in one compiled call.

It returns to Python only for events: a target reached, a search due, a new time step, a guard.
"""

import numpy as np
from numba import njit, prange, types

from thirdbody.jit.function_pointers import function_at
from thirdbody.jit.options import BARE, BARE_CHUNK, CHUNK_OF_THREADS, DIRECT, NO_COUNTS
from thirdbody.jit.packed_arguments import make_unpacker
from thirdbody.jit.simd import broadcast, extract, load
from thirdbody.kernels.bundles import Step
from thirdbody.kernels.clock import pass_time
from thirdbody.kernels.columns import chunk_motion, contact_sums, domain, run_totals
from thirdbody.kernels.explicit.gather_forces import closing_kick
from thirdbody.kernels.explicit.plate_dynamics import drift_patches, drive_patches, kick_patches, load_patches, patch_power
from thirdbody.kernels.rigid_body import largest_displacement
from thirdbody.kernels.schedule import X, Y, mean_rate
from thirdbody.kernels.signatures import EARLY, KINDS, LATE, LOOK, WORK, Context

DONE, SEARCH, BUDGET, OVERLAP, TRAVEL, BAD_CONTACT, BAD_BODY, LEFT, RECORD = range(9)
"""Reasons why `advance` returned."""

NEARLY = 1.000001
"""A target that is missed only by rounding counts as reached, so that the run does not add a step for it."""

SHARES = 2
"""Parts of a pass per thread: if a thread is delayed, its last part goes to another thread."""

FEW = 2
"""Groups below which one thread does all: some 100 us of work. Waking others costs 5 us, or ms if their cores are busy."""


@njit(**BARE)
def update_ledger(A, sums, moves, v_x, v_y, dt, lifted, patch_damping, record):
    """Add the step to the energy ledger, to impulses and distances, in a fixed order.

    Contacts supply energies; other powers are integrated by the trapezoidal rule. In an observed step (`record`) also sum the
    elastic energy of the contacts.
    """
    work, damped = 0.0, 0.0
    for c in range(sums.shape[0]):
        work += sums[c, contact_sums.FRICTION_WORK]
        damped += sums[c, contact_sums.DAMPING_WORK]
    upper, lower, effects = broadcast(0.0), broadcast(0.0), 0.0
    for c in range(sums.shape[0]):
        upper, lower = upper - load(sums, c, contact_sums.UPPER_FORCE), lower - load(sums, c, contact_sums.LOWER_FORCE)
    for c in range(moves.shape[0]):
        effects += moves[c, chunk_motion.EFFECT_POWER]
    half = 0.5 * dt
    A[run_totals.FRICTION_WORK] += work
    A[run_totals.DAMPING_WORK] += damped + half * (A[run_totals.PATCH_POWER] + patch_damping)
    A[run_totals.EFFECT_WORK] += half * (A[run_totals.EFFECT_POWER] + effects)
    drag = -half * (
        (A[run_totals.UPPER_FORCE] + extract(upper, 0)) * v_x + (A[run_totals.UPPER_FORCE + 1] + extract(upper, 1)) * v_y
    )
    plate = drag + half * (A[run_totals.LOAD_POWER] + lifted)
    A[run_totals.PLATE_WORK] += plate
    A[run_totals.PLATE_WORK_SIZE] += abs(plate)
    up, low = (extract(upper, 0), extract(upper, 1), extract(upper, 2)), (extract(lower, 0), extract(lower, 1), extract(lower, 2))
    for k in range(3):
        A[run_totals.UPPER_IMPULSE + k] += half * (A[run_totals.UPPER_FORCE + k] + up[k])
        A[run_totals.LOWER_IMPULSE + k] += half * (A[run_totals.LOWER_FORCE + k] + low[k])
        A[run_totals.UPPER_FORCE + k], A[run_totals.LOWER_FORCE + k] = up[k], low[k]
    A[run_totals.PATCH_POWER], A[run_totals.EFFECT_POWER], A[run_totals.LOAD_POWER] = patch_damping, effects, lifted
    pass_time(A, dt, v_x, v_y)
    if record:
        A[run_totals.STORED_NORMAL] = A[run_totals.STORED_TANGENTIAL] = 0.0
        for c in range(sums.shape[0]):
            A[run_totals.STORED_NORMAL] += sums[c, contact_sums.STORED_NORMAL]
            A[run_totals.STORED_TANGENTIAL] += sums[c, contact_sums.STORED_TANGENTIAL]


@njit(**BARE)
def guard(D, sums, moves):
    """Return (code, number) of the first guard that trips, or (DONE, -1)."""
    for g in range(moves.shape[0]):
        if moves[g, chunk_motion.BAD_BODY] > 0.0:
            return BAD_BODY, np.int64(moves[g, chunk_motion.BAD_BODY]) - 1
    for c in range(sums.shape[0]):
        if sums[c, contact_sums.BAD_SLOT] > 0.0:
            return BAD_CONTACT, np.int64(sums[c, contact_sums.BAD_SLOT]) - 1
    for c in range(sums.shape[0]):
        if sums[c, contact_sums.MAX_OVERLAP] > D[domain.OVERLAP_GUARD]:
            return OVERLAP, np.int64(sums[c, contact_sums.SLOT])
    for g in range(moves.shape[0]):
        if moves[g, chunk_motion.LEFT_BODY] > 0.0:
            return LEFT, np.int64(moves[g, chunk_motion.LEFT_BODY]) - 1
        if moves[g, chunk_motion.MAX_TRAVEL] > D[domain.TRAVEL_GUARD]:
            return TRAVEL, np.int64(moves[g, chunk_motion.BODY])
    return DONE, -1


@njit(**BARE)
def skin_exhausted(far, distance, far_patch, skin):
    """Return whether two objects could cover the skin between them by the end of the next step. 10 % allow for acceleration."""
    return 1.1 * (far + distance + max(far + distance, far_patch)) > 0.9 * skin


@njit(**BARE)
def rebuild_needed(A, X0, B, E, moves, far_patch, skin):
    """Return whether a search must precede the next step. Displacements are measured only if the paths could exhaust the skin."""
    distance = 0.0
    for c in range(moves.shape[0]):
        distance = max(distance, moves[c, chunk_motion.MAX_PATH])
    A[run_totals.MAX_DISPLACEMENT] += distance
    if skin_exhausted(A[run_totals.MAX_DISPLACEMENT], distance, far_patch, skin):
        A[run_totals.MAX_DISPLACEMENT] = largest_displacement(X0, B, E)
        return skin_exhausted(A[run_totals.MAX_DISPLACEMENT], distance, far_patch, skin)
    return False


@njit(**BARE)
def patch_forces(sums):
    """Return the upward force of all debris on the upper plate [N]."""
    push = 0.0
    for c in range(sums.shape[0]):
        push -= sums[c, contact_sums.UPPER_FORCE + 2]
    return push


context_of, work_at = make_unpacker(KINDS, Context), function_at(WORK)

_F2, _I1, _I = types.Array(types.float64, 2, "C"), types.Array(types.int64, 1, "C"), types.int64
ADVANCE = types.Tuple((_I, _I))(
    _I, types.float64, types.float64, types.float64, _I, _I1,  # budget, targets of time and distance, dt, threads; context
    _F2, _I1, _F2, _I1, _I, types.boolean,  # X0, patch; schedule, first; stride, labels
)  # fmt: skip


@njit(**CHUNK_OF_THREADS)
def run_parallel(parts, task, count, step, packed, work):
    """Run the groups of one pass in `parts` parts, on all threads."""
    for p in prange(parts):
        work(task, np.int64(p), p * count // parts, (p + 1) * count // parts, step, packed)


@njit(**BARE_CHUNK)
def run(budget, until, distance, dt, threads, context, X0, patch, schedule, first, stride, labels):
    """Make the steps of `advance`; also return 1 if the closing kick of the last one is pending, else 0."""
    k = context_of(context)
    P, D, A, sums, moves = k.P, k.D, k.A, k.sums, k.moves
    work = work_at(k.work)
    groups = k.lowest.shape[0]
    parts = min(groups, SHARES * threads) if threads > 1 and groups >= FEW else 1
    whole = parts == 1 or k.guests.shape[0] == 0
    k.moved[:] = 0
    left = 0.0
    for step in range(budget):
        v_x = mean_rate(schedule, first, np.int64(X), A[run_totals.TIME], dt)
        v_y = mean_rate(schedule, first, np.int64(Y), A[run_totals.TIME], dt)
        speed = (v_x * v_x + v_y * v_y) ** 0.5
        last = A[run_totals.TIME] + NEARLY * dt >= until or A[run_totals.DISTANCE] + NEARLY * speed * dt >= distance
        if last and k.R.shape[0] < k.own.shape[0]:
            return RECORD, -1, left
        sampled = labels and (np.int64(A[run_totals.STEPS]) + 1) % stride == 0
        record = sampled or last or step == budget - 1
        time = A[run_totals.TIME] + dt
        drive_patches(P, schedule, first, A[run_totals.TIME], dt)
        far_patch = drift_patches(P, dt)
        for task in range(EARLY, LOOK + 1):
            if task == LOOK:
                load_patches(P, schedule, first, time)
                lifted, damping = kick_patches(P, k.E, patch, patch_forces(sums), dt)
                update_ledger(A, sums, moves, v_x, v_y, dt, lifted + patch_power(P), damping, record)
            if (task == LOOK and not sampled) or (whole and (task == EARLY or task == LATE)):
                continue
            now = Step(step + 1, record, time, dt, v_x, v_y, left)
            if parts == 1:
                work(np.int64(task), np.int64(0), np.int64(0), np.int64(groups), now, context)
            else:
                run_parallel(np.int64(parts), np.int64(task), np.int64(groups), now, context, work)
        left = 0.0 if record or k.has_effects != 0 else 1.0
        if sampled:
            A[run_totals.ELAPSED], A[run_totals.SHIFT_X], A[run_totals.SHIFT_Y] = 0.0, 0.0, 0.0
        code, who = guard(D, sums, moves)
        if code != DONE:
            return code, who, left
        due = rebuild_needed(A, X0, k.B, k.E, moves, far_patch, D[domain.SKIN])
        if last:
            return DONE, np.int64(due), left
        if due:
            return SEARCH, 1, left
    return BUDGET, -1, left


@njit(ADVANCE, **DIRECT, **NO_COUNTS)
def advance(budget, until, distance, dt, threads, context, X0, patch, schedule, first, stride, labels):
    """Advance until `until` or `distance` is reached, a search is due, `budget` steps are done, or a guard trips.

    `context`: the packed `Context` of the step. Returns the code, and the candidate or body that a guard names, or whether a
    search is due; RECORD before a step that reaches its target, if there is no table for its records. State is synchronised on
    return.
    """
    k = context_of(context)
    code, who, left = run(budget, until, distance, dt, threads, context, X0, patch, schedule, first, stride, labels)
    if left != 0.0:
        closing_kick(np.int64(0), np.int64(k.B.shape[0]), k.B, k.E, dt)
    return code, who
