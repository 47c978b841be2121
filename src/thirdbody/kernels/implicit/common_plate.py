"""Bodies under one common plate: they share its height and therefore its time step.

The system matrix is an arrow matrix: one block per body, and one row and column for the plate. `solve_bodies` solves the bodies
for a given rise of the plate, with the derivative of their force on the plate at equilibrium of each body: the Schur complement
of the arrow matrix. One scalar equation for the plate remains (`engine.implicit_common_plate`).
"""

import math

from numba import njit, prange, types

from thirdbody.jit.options import CHUNK, INNER, OPTIONS
from thirdbody.kernels.columns import (
    body,
    body_solution,
    geometry,
    law_output,
    patch,
    run_totals,
    step_memory,
    step_settings,
    step_start,
)
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.implicit.bdf2 import KNOWN, SHAPE, SPOTS, STATE, workspace
from thirdbody.kernels.implicit.jacobian import assemble_jacobian
from thirdbody.kernels.implicit.newton import CROWDED, FOUND, newton, solve_linear
from thirdbody.kernels.implicit.residual import active_contacts, residual, save_start, set_configuration
from thirdbody.kernels.implicit.step_control import (
    accept_step,
    advance_clock,
    bdf2_weights,
    gaps,
    guard_code,
    is_breakpoint,
    local_error,
    next_breakpoint,
    plate_velocity,
    predict,
    reject_step,
    rotation_of,
    update_labeller,
)
from thirdbody.kernels.implicit.step_limits import lands
from thirdbody.kernels.predicates import is_upper
from thirdbody.kernels.signatures import EFFECTS, LAW, OBSERVE

BODIES = 8
"""Bodies per chunk."""


@njit(**INNER)
def plate_reaction(p, m, spots, P, work, Z):
    """Return the upward force [N] of the body on the plate, by a spring or directly by its contacts."""
    if P[p, patch.SPRING] != 0.0:
        return P[p, patch.SPRING] * (P[p, patch.HEIGHT] - Z[step_start.PLATE_HEIGHT])
    partner, O, G, slots = spots[1], work[1], work[3], work[4]  # noqa: E741
    push = 0.0
    for q in range(m):
        if is_upper(partner[slots[q]]):
            push -= O[law_output.NORMAL_FORCE * TILE + q] * G[q + (geometry.NORMAL + 2) * TILE]
    return push


@njit(**INNER)
def plate_stiffness(b, p, m, dt, spots, state, known, work, Z, tangents):
    """Return d(plate_reaction)/d(rise of the plate) [N/m] at equilibrium of the body."""
    P, x, J = state[2], work[8], work[10]
    assemble_jacobian(b, p, m, dt, spots, state, known, work, Z, tangents, True, J)
    spring = P[p, patch.SPRING]
    if spring != 0.0:
        for k in range(7):
            x[k] = spring if k == 6 else 0.0
        return spring * (x[6] - 1.0) if solve_linear(J, x, 7) else 0.0
    own = J[6, 6]
    row = J[6, :6].copy()
    for k in range(6):
        x[k] = J[k, 6]
    if not solve_linear(J, x, 6):
        return 0.0
    for k in range(6):
        own += row[k] * x[k]
    return own


@njit(**CHUNK)
def solve_chunk(
    low, high, first_iteration, dt, rise, plate, v_x, v_y, spots, shape, state, known, maximum, V, totals, memory, starts, ends,
    initial_gap, diagnostics, law, tangents, effects,
):  # fmt: skip
    """Solve bodies low to high - 1 for a given rise of the plate; see `solve_bodies`."""
    work, patch_of, P, edges = workspace(known[2], known[4], maximum), shape[2], state[2], spots[3]
    y, before = work[6], work[5]
    for b in range(low, high):
        p, Z, T, W = patch_of[b], starts[b], memory[b], totals[b]
        if first_iteration:
            save_start(b, p, shape, state, Z)
            gaps(b, spots, state, before)
            bdf2_weights(dt, math.sqrt(v_x * v_x + v_y * v_y) * dt, state[1][b, body.MASS], T, Z, V)
            predict(p, y, dt, Z, P, rise)
            for e in range(edges[b], edges[b + 1]):
                initial_gap[e] = before[e - edges[b]]
        else:
            for e in range(edges[b], edges[b + 1]):
                before[e - edges[b]] = initial_gap[e]
            for k in range(7):
                y[k] = ends[b, k]
        if P[p, patch.SPRING] == 0.0:
            y[6] = rise
        Z[step_start.PLATE_HEIGHT], Z[step_start.PLATE_RISE] = plate + rise, rise
        deep, inertial, at_end = V[step_settings.DEEP], V[step_settings.INERTIAL], W[run_totals.TIME] + dt
        how, m, iterations = newton(
            b, p, dt, deep, at_end, inertial, v_x, v_y, spots, shape, state, known, work, Z, T, law, tangents, effects
        )
        T[step_memory.TRIES] += 1.0
        T[step_memory.ITERATIONS] += iterations
        diagnostics[b, body_solution.FOUND] = 1.0 if how == FOUND else 0.0
        diagnostics[b, body_solution.CROWDED] = 1.0 if how == CROWDED else 0.0
        diagnostics[b, body_solution.LANDS] = 1.0 if lands(b, m, spots, work) else 0.0
        for k in range(7):
            ends[b, k] = y[k]
        if how != FOUND:
            continue
        diagnostics[b, body_solution.PUSH] = plate_reaction(p, m, spots, P, work, Z)
        diagnostics[b, body_solution.SLOPE] = plate_stiffness(b, p, m, dt, spots, state, known, work, Z, tangents)
        diagnostics[b, body_solution.ERROR] = local_error(b, p, dt, Z, T, state[1], P, work[11], V)
        diagnostics[b, body_solution.TURN], diagnostics[b, body_solution.ITERATIONS] = rotation_of(y, Z), iterations


@njit(**CHUNK)
def accept_chunk(
    low, high, dt, end, whole, v_x, v_y, spots, shape, state, known, maximum, M, D, V, totals, memory, starts, ends, initial_gap,
    drag, law, effects, observe,
):  # fmt: skip
    """Accept the step of bodies low to high - 1; see `accept_bodies`.

    Forces are evaluated again: recomputing the tiles is cheaper than storing them for all bodies.
    """
    work, patch, edges, saved = workspace(known[2], known[4], maximum), shape[2], spots[3], known[6]
    y, before, r, diagnostics = work[6], work[5], work[7], work[11]
    for b in range(low, high):
        p, Z, T, W = patch[b], starts[b], memory[b], totals[b]
        for k in range(7):
            y[k] = ends[b, k]
        for e in range(edges[b], edges[b + 1]):
            before[e - edges[b]] = initial_gap[e]
        set_configuration(b, p, y, dt, Z, T, shape, state)
        m = active_contacts(b, dt, Z[step_start.NOW] / dt, v_x, v_y, spots, shape, state, known, work)
        residual(
            b, p, m, y, dt, W[run_totals.TIME] + dt, V[step_settings.INERTIAL], spots, state, known, work, Z, T, law, effects, r,
            diagnostics,
        )  # fmt: skip
        accept_step(b, p, m, y, dt, v_x, v_y, spots, state, known, work, Z, T, W, V, True)
        advance_clock(W, dt, end, whole, v_x, v_y)
        if saved:
            update_labeller(b, spots, state, M, W, known, drag, observe, work[13], work[14])
        T[step_memory.CODE], T[step_memory.SLOT] = guard_code(b, diagnostics, state[1], D)


_F2, _F1 = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C")
_D, _B = types.float64, types.boolean
SOLVE = types.void(
    _B, _D, _D, _D, _D, _D, SPOTS, SHAPE, STATE, KNOWN, types.int64,  # first_iteration; dt, rise, plate, v_x, v_y; ... maximum
    _F1, _F2, _F2, _F2, _F2, _F1, _F2,  # V, totals, memory, starts, ends, initial_gap, diagnostics
    types.FunctionType(LAW), types.FunctionType(LAW), types.FunctionType(EFFECTS),
)  # fmt: skip
TAKE = types.void(
    _D, _D, _B, _D, _D, SPOTS, SHAPE, STATE, KNOWN, types.int64,  # dt, end, whole, v_x, v_y; ... maximum
    _F2, _F1, _F1, _F2, _F2, _F2, _F2, _F1,  # M, D, V, totals, memory, starts, ends, initial_gap
    types.UniTuple(types.float64, 2), types.FunctionType(LAW), types.FunctionType(EFFECTS), types.FunctionType(OBSERVE),
)  # fmt: skip


@njit(SOLVE, parallel=True, **OPTIONS)
def solve_bodies(
    first_iteration, dt, rise, plate, v_x, v_y, spots, shape, state, known, maximum, V, totals, memory, starts, ends,
    initial_gap, diagnostics, law, tangents, effects,
):  # fmt: skip
    """Solve the step of all bodies for a given rise of the plate.

    `plate`: height [m] at the start; `rise` [m]. `first_iteration`: the step begins; otherwise the iteration continues from
    `ends` (n, 7) of the previous call. Results are written to `diagnostics` (n, body_solution.WIDTH).
    """
    n = totals.shape[0]
    for c in prange((n + BODIES - 1) // BODIES):
        solve_chunk(
            c * BODIES, min(c * BODIES + BODIES, n), first_iteration, dt, rise, plate, v_x, v_y, spots, shape, state, known,
            maximum, V, totals, memory, starts, ends, initial_gap, diagnostics, law, tangents, effects,
        )  # fmt: skip


@njit(TAKE, parallel=True, **OPTIONS)
def accept_bodies(
    dt, end, whole, v_x, v_y, spots, shape, state, known, maximum, M, D, V, totals, memory, starts, ends, initial_gap, drag, law,
    effects, observe,
):  # fmt: skip
    """Accept the step solved by `solve_bodies`; `whole`: it ends exactly at the time `end` [s]."""
    n = totals.shape[0]
    for c in prange((n + BODIES - 1) // BODIES):
        accept_chunk(
            c * BODIES, min(c * BODIES + BODIES, n), dt, end, whole, v_x, v_y, spots, shape, state, known, maximum, M, D, V,
            totals, memory, starts, ends, initial_gap, drag, law, effects, observe,
        )  # fmt: skip


@njit(types.void(SHAPE, STATE, _F2, _F2), **OPTIONS)
def restore_bodies(shape, state, memory, starts):
    """Restore all bodies to the start of the step."""
    for b in range(starts.shape[0]):
        reject_step(b, shape[2][b], starts[b], memory[b], shape, state)


_I1 = types.Array(types.int64, 1, "C")


@njit(types.UniTuple(types.float64, 2)(_F2, _I1, _D, _D), **OPTIONS)
def plate_velocity_of(schedule, first, t, dt):
    """Return the mean lateral velocity (v_x, v_y) [m/s] of the upper plate over a step."""
    return plate_velocity(schedule, first, t, dt)


@njit(_B(_F2, _I1, _D, _D), **OPTIONS)
def is_breakpoint_at(schedule, first, t, end):
    """Return whether the smooth interval that began at t [s] ends at a breakpoint of the motion."""
    return is_breakpoint(t, end, schedule, first)


@njit(_D(_F2, _I1, _D, _D), **OPTIONS)
def next_breakpoint_after(schedule, first, t, until):
    """Return the time [s] of the next breakpoint of the motion after t, at most `until`."""
    return next_breakpoint(t, schedule, first, until)
