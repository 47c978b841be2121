"""BDF2 driver: bodies between two plates, advanced to a common time by individual steps.

A step that Newton's method or the error estimate rejects is shortened; step lengths grow again afterwards. The error is relative
to the radius of the largest contact: steps are short where a contact starts to slip or a body tips, and long where it slides or
rolls on. No step crosses a breakpoint of the prescribed motion. BDF2 damps modes faster than the step, as backward Euler does,
and is of second order: at 1 m/s, where inertia governs sliding, the same error takes a tenth of the steps.

`work` is the workspace for one body: I, O, K, G, slots, before (`residual`); y, r, x, tried, J (`newton`); diagnostics
(`columns.step_contacts`), sums over the contacts (`columns.contact_sums`), and the labeller's rows of body and contacts.
"""

import math

import numpy as np
from numba import njit, prange, types

from thirdbody.jit.options import CHUNK, INNER, OPTIONS
from thirdbody.kernels.columns import (
    body,
    contact_sums,
    contact_tangent,
    geometry,
    law_input,
    law_output,
    observed_body,
    patch,
    rolling_input,
    rolling_output,
    run_totals,
    step_contacts,
    step_memory,
    step_settings,
    step_start,
)
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.implicit.friction_work import LEAST, work_error
from thirdbody.kernels.implicit.newton import CROWDED, FOUND, newton
from thirdbody.kernels.implicit.residual import FREEDOMS, TURN, save_start
from thirdbody.kernels.implicit.step_control import (
    GOING,
    NEARLY,
    TOO_MANY,
    UNSOLVED,
    accept_step,
    advance_clock,
    bdf2_weights,
    gaps,
    guard_code,
    is_breakpoint,
    local_error,
    next_breakpoint,
    next_dt,
    next_length,
    plate_velocity,
    predict,
    reduction_factor,
    reject_step,
    rotation_of,
    update_labeller,
)
from thirdbody.kernels.implicit.step_limits import lands, why_cut
from thirdbody.kernels.schedule import GAP, LOAD, mean_rate, segment, value, value_of
from thirdbody.kernels.signatures import EFFECTS, LAW, OBSERVE

BODIES = 8
"""Bodies per chunk, which share a workspace; small enough to spread a few bodies over all cores."""


@njit(**CHUNK)
def workspace(n_history, width, maximum):
    """Return the workspace `work` for one body (see the module docstring)."""
    tile = np.empty((law_input.HISTORY + n_history + rolling_input.WIDTH) * TILE)
    answer = np.empty((law_output.HISTORY + n_history + rolling_output.WIDTH) * TILE)
    return (
        tile, answer, np.empty(contact_tangent.ROLLING_WIDTH * TILE), np.empty(geometry.WIDTH * TILE), np.zeros(TILE, np.int64),
        np.zeros(maximum), np.zeros(FREEDOMS), np.zeros(FREEDOMS), np.zeros(FREEDOMS), np.zeros(FREEDOMS),
        np.empty((FREEDOMS, FREEDOMS)), np.zeros(step_contacts.WIDTH), np.zeros((1, contact_sums.WIDTH)),
        np.zeros(observed_body.WIDTH), np.empty((maximum, width)),
    )  # fmt: skip


@njit(**INNER)
def prescribed_rise(p, P, t, dt, schedule, first, Z):
    """Return the prescribed rise [m] of patch p, 0 if it is free; store the plate's height in Z."""
    driven = first[GAP + 1] > first[GAP]
    rise = mean_rate(schedule, first, np.int64(GAP), t, dt) * dt if driven else 0.0
    if P[p, patch.SPRING] != 0.0:
        Z[step_start.PLATE_HEIGHT] = value(schedule, first, np.int64(GAP), t + dt) if driven else P[P.shape[0] - 1, patch.HEIGHT]
        Z[step_start.PLATE_RISE] = rise
    return 0.0 if P[p, patch.FREE] != 0.0 else rise


@njit(**INNER)
def scheduled_load(p, P, t, dt, schedule, first):
    """Set the scheduled load [N] of patch p at the end of a step that crosses no breakpoint."""
    if first[LOAD + 1] > first[LOAD] and P[p, patch.NOMINAL_LOAD] != 0.0:
        P[p, patch.LOAD] = P[p, patch.NOMINAL_LOAD] * value_of(schedule, segment(schedule, first, np.int64(LOAD), t), t + dt)


@njit(**INNER)
def step(b, p, until, spots, shape, state, known, work, M, D, V, Z, T, W, schedule, first, drag, law, tangents, effects,
         observe):  # fmt: skip
    """Make one step of body b, shortened until it is accepted; set its code if it has to stop."""
    (_, B, P, _, _, _), y, diagnostics = state, work[6], work[11]
    save_start(b, p, shape, state, Z)
    gaps(b, spots, state, work[5])
    time = W[run_totals.TIME]
    end = next_breakpoint(time, schedule, first, until)
    if end - time < V[step_settings.SHORTEST]:
        # the interval is shorter than any step: a stop that misses a breakpoint by rounding
        W[run_totals.TIME], T[step_memory.LAST_DT] = end, 0.0
        return
    (dt, limit), requested_dt, cuts = next_length(T, W, V, schedule, first, end), T[step_memory.NEXT_DT], 0
    while True:
        whole = dt >= NEARLY * (end - time)
        dt = end - time if whole else dt
        v_x, v_y = plate_velocity(schedule, first, time, dt)
        bdf2_weights(dt, math.sqrt(v_x * v_x + v_y * v_y) * dt, B[b, body.MASS], T, Z, V)
        scheduled_load(p, P, time, dt, schedule, first)
        predict(p, y, dt, Z, P, prescribed_rise(p, P, time, dt, schedule, first, Z))
        deep, inertial, at_end = V[step_settings.DEEP], V[step_settings.INERTIAL], time + dt
        how, m, iterations = newton(
            b, p, dt, deep, at_end, inertial, v_x, v_y, spots, shape, state, known, work, Z, T, law, tangents, effects
        )
        T[step_memory.TRIES] += 1.0
        T[step_memory.ITERATIONS] += iterations
        error, rotation = local_error(b, p, dt, Z, T, B, P, diagnostics, V), rotation_of(y, Z)
        if how == FOUND and V[step_settings.INERTIAL] != 0.0 and dt > LEAST * V[step_settings.SHORTEST]:
            error = max(
                error, work_error(b, m, dt, v_x, v_y, V[step_settings.WORK], Z[step_start.ARM], spots, state, known, work, T)
            )
        if how == FOUND and error <= 1.0 and rotation <= TURN:
            break
        cuts += 1
        limit = why_cut(lands(b, m, spots, work), how == FOUND, error, rotation)
        dt *= reduction_factor(how == FOUND, error, rotation)
        if how == CROWDED or dt < V[step_settings.SHORTEST]:
            T[step_memory.CODE] = TOO_MANY if how == CROWDED else UNSOLVED
            reject_step(b, p, Z, T, shape, state)
            return
    accept_step(b, p, m, y, dt, v_x, v_y, spots, state, known, work, Z, T, W, V, False)
    advance_clock(W, dt, end, whole, v_x, v_y)
    if whole and is_breakpoint(time, end, schedule, first):
        T[step_memory.LAST_DT] = 0.0  # differences across a breakpoint are invalid
    next_dt(T, W, V, dt, requested_dt, error, iterations, cuts, limit)
    if known[6]:
        update_labeller(b, spots, state, M, W, known, drag, observe, work[13], work[14])
    T[step_memory.CODE], T[step_memory.SLOT] = guard_code(b, diagnostics, B, D)


@njit(**CHUNK)
def advance_chunk(
    low, high, until, tries, spots, shape, state, known, maximum, M, D, V, totals, memory, schedule, first, drag, law, tangents,
    effects, observe,
):  # fmt: skip
    """Advance bodies low to high - 1 in sequence, with one workspace."""
    work, Z, patch = workspace(known[2], known[4], maximum), np.zeros(step_start.WIDTH), shape[2]
    for b in range(low, high):
        T, W = memory[b], totals[b]
        last = T[step_memory.TRIES] + tries
        while T[step_memory.CODE] == GOING and W[run_totals.TIME] < until and T[step_memory.TRIES] < last:
            step(b, patch[b], until, spots, shape, state, known, work, M, D, V, Z, T, W, schedule, first, drag, law, tangents,
                 effects, observe)  # fmt: skip


_F2, _F1 = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C")
_I1, _S1 = types.Array(types.int64, 1, "C"), types.Array(types.int32, 1, "C")
SPOTS = types.UniTuple(_S1, 5)
SHAPE = types.Tuple((_I1, _I1, _I1, _F2))
STATE = types.UniTuple(_F2, 6)
KNOWN = types.Tuple((_F1, _F1, *(types.int64,) * 3, types.boolean, types.boolean, *(types.int64,) * 3))
MARCH = types.void(
    types.int64, types.int64, types.float64, types.float64,  # low, high, until [s], tries per body
    SPOTS, SHAPE, STATE, KNOWN, types.int64,  # ... maximum candidates of a body
    _F2, _F1, _F1, _F2, _F2,  # M, D, V, totals, memory
    _F2, _I1, types.UniTuple(types.float64, 2),  # schedule, first; drag direction
    types.FunctionType(LAW), types.FunctionType(LAW), types.FunctionType(EFFECTS), types.FunctionType(OBSERVE),
)  # fmt: skip


@njit(MARCH, parallel=True, **OPTIONS)
def advance_bodies(
    low, high, until, tries, spots, shape, state, known, maximum, M, D, V, totals, memory, schedule, first, drag, law, tangents,
    effects, observe,
):  # fmt: skip
    """Advance bodies `low` to `high` - 1 to the time `until` [s], with individual time steps.

    A body stops after `tries` trial steps; the next call continues it bit for bit. A body stopped by a guard has its code in
    `memory` (step_memory.CODE) and stays at the end of its last step.
    """
    for c in prange((high - low + BODIES - 1) // BODIES):
        begin_at = low + c * BODIES
        advance_chunk(begin_at, min(begin_at + BODIES, high), until, tries, spots, shape, state, known, maximum, M, D, V, totals,
                    memory, schedule, first, drag, law, tangents, effects, observe)  # fmt: skip
