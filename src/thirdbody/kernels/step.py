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
    drift_chunk,
    gather_chunk,
)  # fmt: skip
from .clock import pass_time
from .contacts import CHUNK, SUM_BAD, SUM_OVERLAP, SUM_POWER, SUM_SLOT, SUM_WORK, contact_chunk
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
    D_FLOOR,
    D_GUARD_OVERLAP,
    D_GUARD_TRAVEL,
    D_LX,
    D_LY,
    D_SKIN,
)  # fmt: skip
from .motion import X, Y, mean_rate
from .observe import observe_chunk
from .options import INNER, OPTIONS
from .patches import drift_patches, drive_patches, kick_patches, load_patches, patch_power
from .signatures import EFFECTS, LAW, OBSERVE

DONE, SEARCH, BUDGET, OVERLAP, TRAVEL, BAD_CONTACT, BAD_BODY, LEFT = range(8)
"""Why `advance` returned."""

NEARLY = 1.000001
"""A target that is missed by rounding only is reached: the run must not add a step for it."""

DRIFT, CONTACTS, GATHER, CLOSE = range(4)
"""Passes of one step, in their order; the last one closes the step and, in sampled steps, lets the labeller look."""


@njit(**INNER)
def account(A, sums, n_chunks, moves, n_groups, v_x, v_y, dt, load, patch_damping):
    """Add the step to the energy ledger, to impulses and distances: powers by the trapezoid, in a fixed order."""
    work, power = 0.0, 0.0
    for c in range(n_chunks):
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


@njit(**INNER)
def guard(D, sums, n_chunks, moves, n_groups):
    """(code, number) of the first guard that trips, or (DONE, -1)."""
    for g in range(n_groups):
        if moves[g, MOVE_BAD] > 0.0:
            return BAD_BODY, int(moves[g, MOVE_BAD]) - 1
    for c in range(n_chunks):
        if sums[c, SUM_BAD] > 0.0:
            return BAD_CONTACT, int(sums[c, SUM_BAD]) - 1
    for c in range(n_chunks):
        if sums[c, SUM_OVERLAP] > D[D_GUARD_OVERLAP]:
            return OVERLAP, int(sums[c, SUM_SLOT])
    for g in range(n_groups):
        if moves[g, MOVE_OUT] > 0.0:
            return LEFT, int(moves[g, MOVE_OUT]) - 1
        if moves[g, MOVE_STEP] > D[D_GUARD_TRAVEL]:
            return TRAVEL, int(moves[g, MOVE_BODY])
    return DONE, -1


@njit(**INNER)
def search_due(moves, n_groups, far_patch, skin):
    """Whether two things could have covered the skin between them by the end of the next step (10 % for acceleration)."""
    far, way = 0.0, 0.0
    for g in range(n_groups):
        far, way = max(far, moves[g, MOVE_FAR]), max(way, moves[g, MOVE_WAY])
    far = far**0.5 + way
    return 1.1 * (far + max(far, far_patch)) > 0.9 * skin


_F2, _F1 = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C")
_I1 = types.Array(types.int64, 1, "C")
WORK = types.void(
    types.int64, types.int64, types.boolean, types.float64, types.float64, types.float64, types.float64,
    # ... task, chunk, record, time, v_x, v_y, dt
    types.int64, _I1, _I1, _I1, _I1, _I1,  # number of slots; own, partner, kind; edges, incidence
    _I1, _I1, _F2, _F2, _F2,  # body, start; offsets, X0, S
    _F2, _F2, _F2, _F2, _F2, _F2,  # B, P, H, F, R, M
    _F1, _F1, _F1, _F1, _F2, _F2,  # pairs, effect parameters, D, A; sums, moves
    types.int64, types.int64, types.int64, types.boolean,  # n_history, rolling, width, has_effects
    types.UniTuple(types.float64, 2),  # drag direction
    types.FunctionType(LAW), types.FunctionType(EFFECTS), types.FunctionType(OBSERVE),
)  # fmt: skip
ADVANCE = types.Tuple((types.int64, types.int64))(
    types.int64, types.float64, types.float64, types.float64,  # budget, target time, target distance, dt
    types.int64, _I1, _I1, _I1, _I1, _I1,  # number of slots; own, partner, kind; edges, incidence
    _I1, _I1, _I1, _F2, _F2, _F2,  # body, start, patch; offsets, X0, S
    _F2, _F2, _F2, _F2, _F2, _F2,  # B, P, H, F, R, M
    _F1, _F1, _F1, _F1, _F2, _I1, _F2, _F2,  # pairs, effect parameters, D, A; schedule, first; sums, moves
    types.int64, types.int64, types.int64, types.int64, types.boolean, types.boolean,
    # ... n_history, rolling, stride, width, has_effects, labels
    types.UniTuple(types.float64, 2),  # drag direction
    types.FunctionType(LAW), types.FunctionType(EFFECTS), types.FunctionType(OBSERVE), types.FunctionType(WORK),
)  # fmt: skip


@njit(WORK, **OPTIONS)
def work(task, c, record, time, v_x, v_y, dt, n, own, partner, kind, edges, incidence, body, start, offsets, X0, S, B, P, H,
         F, R, M, pairs, effect_parameters, D, A, sums, moves, n_history, rolling, width, has_effects, drag, law, effects,
         observe):  # fmt: skip
    """Chunk c of one pass of the step; one parallel region serves all passes, which keeps the compilation short."""
    if task == DRIFT:
        drift_chunk(c, start, offsets, S, X0, B, D, dt, D[D_FLOOR], moves)
    elif task == CONTACTS:
        contact_chunk(c, n, own, partner, kind, S, B, P, body, H, F, R, sums, law, pairs, dt, v_x, v_y,
                      max(D[D_LX], 0.0), max(D[D_LY], 0.0), n_history, rolling, record)  # fmt: skip
    elif task == GATHER:
        gather_chunk(c, incidence, edges, partner, F, B, dt, time, effects, effect_parameters, has_effects, moves)
    else:
        speed = (v_x * v_x + v_y * v_y) ** 0.5
        observe_chunk(c, edges, incidence, own, partner, H, R, B, A, M, drag, speed, n_history, width, observe)


@njit(ADVANCE, parallel=True, **OPTIONS)
def advance(budget, until, distance, dt, n, own, partner, kind, edges, incidence, body, start, patch, offsets, X0, S,
            B, P, H, F, R, M, pairs, effect_parameters, D, A, schedule, first, sums, moves, n_history, rolling, stride,
            width, has_effects, labels, drag, law, effects, observe, work):  # fmt: skip
    """Advance until `until` or `distance` is reached, a search is due, `budget` steps are done, or a guard trips.

    Returns the code and the slot or body that a guard names, or whether a search is due. State is synchronised on return.
    """
    n_chunks, n_groups = (n + CHUNK - 1) // CHUNK, (B.shape[0] + BODIES - 1) // BODIES
    far_patch = 0.0
    for step in range(budget):
        v_x = mean_rate(schedule, first, np.int64(X), A[A_TIME], dt)
        v_y = mean_rate(schedule, first, np.int64(Y), A[A_TIME], dt)
        speed = (v_x * v_x + v_y * v_y) ** 0.5
        last = A[A_TIME] + NEARLY * dt >= until or A[A_DISTANCE] + NEARLY * speed * dt >= distance
        sampled = labels and (int(A[A_STEPS]) + 1) % stride == 0
        record = sampled or last or step == budget - 1
        time = A[A_TIME] + dt
        for task in range(CLOSE + 1):
            if task == DRIFT:
                drive_patches(P, schedule, first, A[A_TIME], dt)
                far_patch = drift_patches(P, dt)
            elif task == CLOSE:
                load_patches(P, schedule, first, time)
                load, damping = kick_patches(P, B, patch, dt)
                account(A, sums, n_chunks, moves, n_groups, v_x, v_y, dt, load + patch_power(P), damping)
                if not sampled:
                    break
            count = n_chunks if task == CONTACTS else n_groups
            if count == 1:
                work(np.int64(task), np.int64(0), record, time, v_x, v_y, dt, n, own, partner, kind, edges, incidence, body,
                     start, offsets, X0, S, B, P, H, F, R, M, pairs, effect_parameters, D, A, sums, moves, n_history, rolling,
                     width, has_effects, drag, law, effects, observe)  # fmt: skip
            else:
                for c in prange(count):
                    work(np.int64(task), np.int64(c), record, time, v_x, v_y, dt, n, own, partner, kind, edges, incidence, body,
                         start, offsets, X0, S, B, P, H, F, R, M, pairs, effect_parameters, D, A, sums, moves, n_history, rolling,
                         width, has_effects, drag, law, effects, observe)  # fmt: skip
        if sampled:
            A[A_ELAPSED], A[A_DX], A[A_DY] = 0.0, 0.0, 0.0
        code, number = guard(D, sums, n_chunks, moves, n_groups)
        if code != DONE:
            return code, number
        due = search_due(moves, n_groups, far_patch, D[D_SKIN])
        if last:
            return DONE, int(due)
        if due:
            return SEARCH, 1
    return BUDGET, -1
