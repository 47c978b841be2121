"""The step loop: velocity Verlet of bodies and plate patches, many steps in one compiled call.

It returns to Python only for events: a target reached, a new search, a new time step, a guard.
"""

import numpy as np
from numba import njit, prange, types

from .bodies import (
    BODIES,
    MOVE_BAD,
    MOVE_BODY,
    MOVE_FAR,
    MOVE_LOW,
    MOVE_OUT,
    MOVE_POWER,
    MOVE_STEP,
    MOVE_UP,
    MOVE_WAY,
)  # fmt: skip
from .clock import pass_time
from .contacts import GROUP, SUM_BAD, SUM_OVERLAP, SUM_POWER, SUM_SLOT, SUM_WORK
from .layout import (
    A_DAMPING,
    A_DISTANCE,
    A_DX,
    A_DY,
    A_EFFECTS,
    A_ELAPSED,
    A_FRICTION,
    A_IMPULSE,
    A_IMPULSE_LOW,
    A_LOWER,
    A_PLATE_ABS,
    A_PLATE_WORK,
    A_POWER_DAMPING,
    A_POWER_EFFECTS,
    A_POWER_LOAD,
    A_POWER_PATCH,
    A_STEPS,
    A_TIME,
    A_UPPER,
    D_GUARD_OVERLAP,
    D_GUARD_TRAVEL,
    D_SKIN,
)  # fmt: skip
from .motion import X, Y, mean_rate
from .options import BARE, CHUNK_OF_THREADS, DIRECT, NO_COUNTS
from .patches import drift_patches, drive_patches, kick_patches, load_patches, patch_power
from .signatures import CONTACTS, DRIFT, KNOWN, LOOK, POINTERS, SCRATCH, SHAPES, SLOTS, TABLES, WHOLE, WORK

DONE, SEARCH, BUDGET, OVERLAP, TRAVEL, BAD_CONTACT, BAD_BODY, LEFT = range(8)
"""Why `advance` returned."""

NEARLY = 1.000001
"""A target that is missed by rounding only is reached: the run must not add a step for it."""

SHARES = 4
"""Parts of a pass per thread: one that is held up leaves its last parts to others."""

FEW = (16, 4, 16, 8, 4)
"""Chunks of each pass below which one thread does it alone: some 30 us of work. To wake the others takes 5 us, and milliseconds
where something else holds their cores."""


@njit(**BARE)
def account(A, sums, moves, n_groups, v_x, v_y, dt, load, patch_damping):
    """Add the step to the energy ledger, to impulses and distances: powers by the trapezoid, in a fixed order."""
    work, power = 0.0, 0.0
    for c in range(sums.shape[0]):
        work += sums[c, SUM_WORK]
        power += sums[c, SUM_POWER]
    up_x, up_y, up_z, low_x, low_y, low_z, effects = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for g in range(n_groups):
        up_x -= moves[g, MOVE_UP]
        up_y -= moves[g, MOVE_UP + 1]
        up_z -= moves[g, MOVE_UP + 2]
        low_x -= moves[g, MOVE_LOW]
        low_y -= moves[g, MOVE_LOW + 1]
        low_z -= moves[g, MOVE_LOW + 2]
        effects += moves[g, MOVE_POWER]
    half = 0.5 * dt
    A[A_FRICTION] += work
    A[A_DAMPING] += half * (A[A_POWER_DAMPING] + power + A[A_POWER_PATCH] + patch_damping)
    A[A_EFFECTS] += half * (A[A_POWER_EFFECTS] + effects)
    drag = -half * ((A[A_UPPER] + up_x) * v_x + (A[A_UPPER + 1] + up_y) * v_y)
    plate = drag + half * (A[A_POWER_LOAD] + load)
    A[A_PLATE_WORK] += plate
    A[A_PLATE_ABS] += abs(plate)
    upper, lower = (up_x, up_y, up_z), (low_x, low_y, low_z)
    for k in range(3):
        A[A_IMPULSE + k] += half * (A[A_UPPER + k] + upper[k])
        A[A_IMPULSE_LOW + k] += half * (A[A_LOWER + k] + lower[k])
        A[A_UPPER + k], A[A_LOWER + k] = upper[k], lower[k]
    A[A_POWER_DAMPING], A[A_POWER_PATCH], A[A_POWER_EFFECTS], A[A_POWER_LOAD] = power, patch_damping, effects, load
    pass_time(A, dt, v_x, v_y)


@njit(**BARE)
def guard(D, sums, moves, n_groups):
    """(code, number) of the first guard that trips, or (DONE, -1)."""
    for g in range(n_groups):
        if moves[g, MOVE_BAD] > 0.0:
            return BAD_BODY, np.int64(moves[g, MOVE_BAD]) - 1
    for c in range(sums.shape[0]):
        if sums[c, SUM_BAD] > 0.0:
            return BAD_CONTACT, np.int64(sums[c, SUM_BAD]) - 1
    for c in range(sums.shape[0]):
        if sums[c, SUM_OVERLAP] > D[D_GUARD_OVERLAP]:
            return OVERLAP, np.int64(sums[c, SUM_SLOT])
    for g in range(n_groups):
        if moves[g, MOVE_OUT] > 0.0:
            return LEFT, np.int64(moves[g, MOVE_OUT]) - 1
        if moves[g, MOVE_STEP] > D[D_GUARD_TRAVEL]:
            return TRAVEL, np.int64(moves[g, MOVE_BODY])
    return DONE, -1


@njit(**BARE)
def search_due(moves, n_groups, far_patch, skin):
    """Whether two things could have covered the skin between them by the end of the next step (10 % for acceleration)."""
    far, way = 0.0, 0.0
    for g in range(n_groups):
        far, way = max(far, moves[g, MOVE_FAR]), max(way, moves[g, MOVE_WAY])
    far += way
    return 1.1 * (far + max(far, far_patch)) > 0.9 * skin


@njit(**BARE)
def pushed(moves, n_groups):
    """Upward force of all debris on the upper plate, N."""
    push = 0.0
    for g in range(n_groups):
        push -= moves[g, MOVE_UP + 2]
    return push


_F2, _I1, _I = types.Array(types.float64, 2, "C"), types.Array(types.int64, 1, "C"), types.int64
ADVANCE = types.Tuple((_I, _I))(
    _I, types.float64, types.float64, types.float64, _I, types.boolean,  # budget, targets (2), dt, threads, whole
    *SLOTS, *SHAPES, *TABLES, *KNOWN, *POINTERS, *SCRATCH, types.FunctionType(WORK),
    _I1, _F2, _I1, _I, types.boolean,  # patch; schedule, first; stride, labels
)  # fmt: skip


@njit(**CHUNK_OF_THREADS)
def share_out(parts, task, count, record, time, v_x, v_y, dt, own, partner, kind, closed, outer, edges, incidence, near,
              beginning, guests, cuts, body, start, offsets, X0, S, B, P, H, F, R, M, pairs, effect_parameters, D, A, sums,
              moves, n_history, rolling, width, has_effects, drag, law, effects, observe, room, marks, rows, work):  # fmt: skip
    """The chunks of one pass in as many parts, on all threads."""
    for p in prange(parts):
        work(task, np.int64(p), p * count // parts, (p + 1) * count // parts, record, time, v_x, v_y, dt, own, partner, kind,
             closed, outer, edges, incidence, near, beginning, guests, cuts, body, start, offsets, X0, S, B, P, H, F, R, M,
             pairs, effect_parameters, D, A, sums, moves, n_history, rolling, width, has_effects, drag, law, effects, observe,
             room, marks, rows)  # fmt: skip


@njit(ADVANCE, **DIRECT, **NO_COUNTS)
def advance(budget, until, distance, dt, threads, whole, own, partner, kind, closed, outer, edges, incidence, near, beginning,
            guests, cuts, body, start, offsets, X0, S, B, P, H, F, R, M, pairs, effect_parameters, D, A, sums, moves, n_history,
            rolling, width, has_effects, drag, law, effects, observe, room, marks, rows, work, patch, schedule, first, stride,
            labels):  # fmt: skip
    """Advance until `until` or `distance` is reached, a search is due, `budget` steps are done, or a guard trips.

    Returns the code and the slot or body that a guard names, or whether a search is due. State is synchronised on return.
    """
    n_groups = (B.shape[0] + BODIES - 1) // BODIES
    n_chunks = n_groups if whole else (n_groups + GROUP - 1) // GROUP
    for step in range(budget):
        v_x = mean_rate(schedule, first, np.int64(X), A[A_TIME], dt)
        v_y = mean_rate(schedule, first, np.int64(Y), A[A_TIME], dt)
        speed = (v_x * v_x + v_y * v_y) ** 0.5
        last = A[A_TIME] + NEARLY * dt >= until or A[A_DISTANCE] + NEARLY * speed * dt >= distance
        sampled = labels and (np.int64(A[A_STEPS]) + 1) % stride == 0
        record = sampled or last or step == budget - 1
        time = A[A_TIME] + dt
        drive_patches(P, schedule, first, A[A_TIME], dt)
        far_patch = drift_patches(P, dt)
        for task in range(WHOLE if whole else DRIFT, LOOK + 1):
            if task == LOOK:
                load_patches(P, schedule, first, time)
                load, damping = kick_patches(P, B, patch, pushed(moves, n_groups), dt)
                account(A, sums, moves, n_groups, v_x, v_y, dt, load + patch_power(P), damping)
            if task == LOOK and not sampled or task == WHOLE and not whole:
                continue
            count = n_chunks if task == CONTACTS else n_groups
            parts = min(count, SHARES * threads)
            if threads == 1 or count < FEW[task]:
                work(np.int64(task), np.int64(0), np.int64(0), np.int64(count), record, time, v_x, v_y, dt, own, partner, kind,
                     closed, outer, edges, incidence, near, beginning, guests, cuts, body, start, offsets, X0, S, B, P, H, F, R,
                     M, pairs, effect_parameters, D, A, sums, moves, n_history, rolling, width, has_effects, drag, law, effects,
                     observe, room, marks, rows)  # fmt: skip
            else:
                share_out(np.int64(parts), np.int64(task), np.int64(count), record, time, v_x, v_y, dt, own, partner, kind,
                          closed, outer, edges, incidence, near, beginning, guests, cuts, body, start, offsets, X0, S, B, P, H,
                          F, R, M, pairs, effect_parameters, D, A, sums, moves, n_history, rolling, width, has_effects, drag,
                          law, effects, observe, room, marks, rows, work)  # fmt: skip
        if sampled:
            A[A_ELAPSED], A[A_DX], A[A_DY] = 0.0, 0.0, 0.0
        code, number = guard(D, sums, moves, n_groups)
        if code != DONE:
            return code, number
        due = search_due(moves, n_groups, far_patch, D[D_SKIN])
        if last:
            return DONE, np.int64(due)
        if due:
            return SEARCH, 1
    return BUDGET, -1
