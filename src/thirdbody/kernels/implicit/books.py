"""Work of the contacts of a step, with plates and between bodies: its error, what they dissipated, their histories and records.

A step uses the forces at its end. What bodies exchange is, to second order, the work of the mean of the forces at both ends
(`kernels.books`); where forces jump (`smooth` is false, `weight_of_old`) and without inertia, that of the force at the end.
Called through pointers, so that plates and pairs are compiled without.

A rolling body dissipates only while load passes from one contact to the next: too little to show in the position error. Step
lengths are therefore also controlled by an error of the friction work.
"""

import math

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, NO_COUNTS, POINTED, entry
from thirdbody.kernels import plates
from thirdbody.kernels.books import book, has_dashpot_moments, store_dashpot_forces, unpack_triple
from thirdbody.kernels.contact_geometry import overlap_and_normal
from thirdbody.kernels.explicit.contact_forces import write_record
from thirdbody.kernels.implicit.contact import cross, depth_at, difference, dot
from thirdbody.kernels.implicit.workspace import CONTEXT, MOTION, SPACE_TYPE, last_candidate
from thirdbody.kernels.measures import measure_contact, measure_opened
from thirdbody.kernels.memory import reset_history, spring_energy, store_history
from thirdbody.kernels.plates import is_closed, is_sphere, surface_velocity
from thirdbody.kernels.rolling_kinematics import has_twist
from thirdbody.kernels.step_tables import step_memory, step_settings, step_start
from thirdbody.kernels.tables import body, body_extra, contact_state, domain, record, sphere
from thirdbody.kernels.tile import TILE, law_input, law_output, rolling_input, rolling_output
from thirdbody.kernels.vectors import box_of

_D, _B, _I = types.float64, types.boolean, types.int64

BOOK = types.void(_I, _B, _D, CONTEXT, SPACE_TYPE)
WRITE = types.void(_I, MOTION, CONTEXT, SPACE_TYPE)
END = types.UniTuple(_D, 2)(_I, _B, MOTION, CONTEXT)

book_at, write_at, end_at = function_at(BOOK), function_at(WRITE), function_at(END)

STEP_COLUMNS = np.int64(sphere.MID_VELOCITY), np.int64(sphere.MID_SPIN)  # of `plates.surface_velocity`: of the step

FLOOR = 0.02
"""Floor of the scale of the friction-work error, as a fraction of friction limit times critical slip summed over the contacts: a
tenth of what is dissipated when the set of loaded contacts changes once."""

MIN_CUT = 1e5  # shortest step cut for this error, in units of the shortest step tried

GROWN = 0.75
"""Error of the tangential force of a contact whose radius changes within the step, over relative change of radius times friction
limit times slip over critical slip: laws use the stiffness 2 G* a = 1.5 limit/critical at the end of the step, not the mean."""

CALM = 0.01
"""Largest dashpot work, as a fraction of the tangential work, for which forces count as continuous at a breakpoint."""


@njit(**BARE)
def loss_of_end(q, dt, context, tile):
    """Return the energy [J] that the dashpots of contact q dissipate by their forces at the end of the step: their power there
    times the mean velocity of the contact over that at the end, in [0, 2]."""
    I, n = tile.inputs, tile.inputs[law_input.NORMAL_VELOCITY * TILE + q]  # noqa: E741
    x, y = I[law_input.VELOCITY_X * TILE + q], I[law_input.VELOCITY_Y * TILE + q]
    square, sunk = n * n + x * x + y * y, depth_at(q, context, I) - context.start_depths[tile.slots[q]]
    along = -n * sunk + x * I[law_input.SLIP_X * TILE + q] + y * I[law_input.SLIP_Y * TILE + q]
    factor = min(max(along / (dt * square), 0.0), 2.0) if square > 0.0 else 1.0
    return tile.outputs[law_output.DASHPOT_POWER * TILE + q] * factor * dt


@njit(**BARE)
def weight_of_old(context, b, m, dt, space):
    """Return the weight of the force at the start of a step in its work: 0.5, or 0 where forces jump with the velocity at a
    breakpoint of the motion: there dashpots dissipate more than CALM of the work of the tangential forces."""
    if context.memory[b, step_memory.LAST_DT] > 0.0:
        return 0.5
    I, O, work_done, damped = space.inputs, space.outputs, 0.0, 0.0  # noqa: E741
    for q in range(m):
        damped += loss_of_end(q, dt, context, space)
        across = abs(O[law_output.TANGENTIAL_Y * TILE + q] * I[law_input.SLIP_Y * TILE + q])
        work_done += abs(O[law_output.TANGENTIAL_X * TILE + q] * I[law_input.SLIP_X * TILE + q]) + across
    return 0.5 if damped <= CALM * work_done else 0.0


@njit(**BARE)
def opening_work(k, context, motion):
    """Return the slip work [J] of the tangential spring of candidate k, which opens within the step; 0 where a minimum of the
    distance from a rough plate had ended by its start, at an infinite distance."""
    S, H, i, j, start = context.S, context.H, context.own[k], context.partner[k], context.start_depths[k]
    if start == -math.inf:
        return 0.0
    overlap, n = overlap_and_normal(k, context, box_of(context.D))
    r, s = S[i, sphere.RADIUS], S[j, sphere.RADIUS] if is_sphere(j) else 0.0
    v = surface_velocity(i, S, STEP_COLUMNS, (-r * n[0], -r * n[1], -r * n[2]))
    u = plates.partner_velocity(j, context, STEP_COLUMNS, (s * n[0], s * n[1], s * n[2]), motion)
    f_1, f_2 = H[k, contact_state.LAW + context.force], H[k, contact_state.LAW + context.force + 1]
    e = plates.three(H, k, contact_state.AXIS)
    g = cross(n, e)
    f = f_1 * e[0] + f_2 * g[0], f_1 * e[1] + f_2 * g[1], f_1 * e[2] + f_2 * g[2]
    fraction = start / max(start - overlap - context.D[domain.REACH], 1e-300)
    return -0.5 * fraction * motion.dt * dot(f, difference(v, u))


@njit(**BARE)
def stored_energy(k, context):
    return context.R[k, record.STORED_NORMAL] + context.R[k, record.STORED_TANGENTIAL] if is_closed(k, context.H) else 0.0


@njit(**BARE)
def total_storable_energy(m, tile):
    total = 0.0
    for q in range(m):
        total += storable_energy(q, tile)
    return total


@njit(**BARE)
def storable_energy(q, tile):
    """Return what the tangential spring of contact q can store, about: friction limit times critical slip, at most N times
    overlap [J]."""
    O = tile.outputs  # noqa: E741
    pressed = abs(O[q + law_output.NORMAL_FORCE * TILE]) * abs(tile.inputs[q + law_input.OVERLAP * TILE])
    return min(O[q + law_output.FRICTION_LIMIT * TILE] * O[q + law_output.CRITICAL_SLIP * TILE], pressed)


@njit(**BARE)
def contact_difference(q, context, tile):
    """Return the estimated error [J] of the friction work of contact q: the difference between the works of the mean force and of
    that at the end, plus the effect of a changing contact radius (`GROWN`)."""
    I, O = tile.inputs, tile.outputs  # noqa: E741
    old, new = (law_input.HISTORY + context.force) * TILE + q, (law_output.HISTORY + context.force) * TILE + q
    s_x, s_y = I[q + law_input.SLIP_X * TILE], I[q + law_input.SLIP_Y * TILE]
    work_done = (I[old] + O[new]) * s_x + (I[old + TILE] + O[new + TILE]) * s_y
    work_done += moment_work(q, context, tile)
    lost = I[(law_input.HISTORY + context.stored) * TILE + q] - 0.5 * work_done - O[q + law_output.STORED_TANGENTIAL * TILE]
    slip = min(math.sqrt(s_x * s_x + s_y * s_y), O[q + law_output.CRITICAL_SLIP * TILE])
    fraction = math.sqrt(max(context.start_depths[tile.slots[q]], 0.0) / depth_at(q, context, I))
    changed = GROWN * min(abs(1.0 - fraction), 1.0) * O[q + law_output.FRICTION_LIMIT * TILE] * slip
    return abs(lost - O[q + law_output.FRICTION_LOSS * TILE]) + changed


@njit(**BARE)
def moment_work(q, context, tile):
    """Return twice the work [J] of the mean of the moments of contact q at both ends of the step."""
    I, O, n_history, total = tile.inputs, tile.outputs, context.n_history, 0.0  # noqa: E741
    if context.moment >= 0:
        old, new = (law_input.HISTORY + context.moment) * TILE + q, (law_output.HISTORY + context.moment) * TILE + q
        turn = (law_input.HISTORY + n_history + rolling_input.ROTATION_X) * TILE + q
        total += (I[old] + O[new]) * I[turn] + (I[old + TILE] + O[new + TILE]) * I[turn + TILE]
    if context.twist >= 0:
        old, new = (law_input.HISTORY + context.twist) * TILE + q, (law_output.HISTORY + context.twist) * TILE + q
        total += (I[old] + O[new]) * I[(law_input.HISTORY + n_history + rolling_input.TWIST) * TILE + q]
    return total


@njit(**BARE)
def energy_scale(context, b, m, space):
    """Return the scale [J] for errors of the friction work of a body: its friction work so far, its energy of translation, which
    impacts dissipate, and FLOOR times that of rotation, which friction alone dissipates, and of what its contacts can store."""
    B = context.B
    stored = max(context.memory[b, step_memory.MAX_ENERGY], total_storable_energy(m, space))
    loss = context.E[b, body_extra.NORMAL_LOSS] if context.loss_column >= 0 else 0.0
    friction, square, turn = B[b, body.FRICTION_WORK] - loss, 0.0, 0.0
    for k in range(3):
        square += B[b, body.VELOCITY + k] ** 2
        turn += (space.start[step_start.ARM] * B[b, body.SPIN + k]) ** 2
    return friction + 0.5 * B[b, body.MASS] * square + FLOOR * (stored + 0.5 * B[b, body.MASS] * turn)


@njit(**BARE)
def work_error_of_plates(context, b, m, motion, space):
    error, q = 0.0, np.int64(0)
    for p in range(m):
        error += contact_difference(p, context, space)
    for e in range(context.plate_edges[b], last_candidate(b, context)):
        k = context.plate_incidence[e] >> 1
        if q < m and space.slots[q] == k:
            q += 1
        elif is_closed(k, context.H):
            error += abs(opening_work(k, context, motion))
    return error


@njit(**BARE)
def dashpots_act(smooth, context):
    return smooth and context.dashpots >= 0 and context.settings[step_settings.INERTIAL] != 0.0


@njit(**BARE)
def loss_of_mean(q, context, tile):
    """Return the energy [J] that the dashpots of contact q dissipate by the mean of their forces; one that closes moves with them
    by its overlap."""
    I, O = tile.inputs, tile.outputs  # noqa: E741
    n, x, y = unpack_triple(I[(law_input.HISTORY + context.dashpots) * TILE + q])
    new, turn = (law_output.HISTORY + context.n_history) * TILE + q, (law_input.HISTORY + context.n_history) * TILE + q
    start = max(context.start_depths[tile.slots[q]], 0.0)
    work = (n + O[new + rolling_output.VISCOUS_NORMAL * TILE]) * (start - depth_at(q, context, I))
    work += (x + O[new + rolling_output.VISCOUS_X * TILE]) * I[law_input.SLIP_X * TILE + q]
    work += (y + O[new + rolling_output.VISCOUS_Y * TILE]) * I[law_input.SLIP_Y * TILE + q]
    if has_dashpot_moments(context):
        u, v, w = unpack_triple(I[(law_input.HISTORY + context.dashpots + 1) * TILE + q])
        work += (u + O[new + rolling_output.VISCOUS_MOMENT_X * TILE]) * I[turn + rolling_input.ROTATION_X * TILE]
        work += (v + O[new + rolling_output.VISCOUS_MOMENT_Y * TILE]) * I[turn + rolling_input.ROTATION_Y * TILE]
        if has_twist(context):
            work += (w + O[new + rolling_output.VISCOUS_TWIST * TILE]) * I[turn + rolling_input.TWIST * TILE]
    return max(-0.5 * work, 0.0)


@entry(BOOK, **POINTED, **NO_COUNTS)
def book_contacts(n, smooth, dt, context, tile):
    """Write what friction and dashpots of the n contacts of a tile dissipate to DISSIPATED and DASHPOT_POWER [J]. Where friction
    has ended unbooked, as the dashpot of a departing sphere cancelled its normal force, all that was stored is dissipated, as in
    a contact that opens. So is what a contact without normal force releases that is about to open."""
    O, R, slots = tile.outputs, context.R, tile.slots  # noqa: E741
    of_mean, of_dashpots = smooth and context.force >= 0, dashpots_act(smooth, context)
    if of_mean:
        book(n, context, tile)
    for q in range(0 if of_mean else n):
        ended = O[law_output.TANGENTIAL_X * TILE + q] == 0.0 and O[law_output.TANGENTIAL_Y * TILE + q] == 0.0
        if ended and O[law_output.STORED_TANGENTIAL * TILE + q] == 0.0:
            unbooked = spring_energy(slots[q], context) - O[law_output.DISSIPATED * TILE + q]
            O[law_output.DISSIPATED * TILE + q] += max(unbooked, 0.0)
    if context.dashpots >= 0:
        store_dashpot_forces(n, context, O)
    for q in range(n):
        k = slots[q]
        if is_closed(k, context.H) and R[k, record.NORMAL_FORCE] == 0.0 and O[law_output.NORMAL_FORCE * TILE + q] == 0.0:
            damped = R[k, record.STORED_NORMAL] - O[law_output.STORED_NORMAL * TILE + q]
        elif of_dashpots:
            damped = loss_of_mean(q, context, tile)
        else:
            damped = loss_of_end(q, dt, context, tile)
        O[law_output.DASHPOT_POWER * TILE + q] = damped


@entry(WRITE, **POINTED, **NO_COUNTS)
def write_contacts(n, motion, context, tile):
    store_history(n, tile.slots, context, tile)
    for q in range(n):
        write_record(q, tile.slots[q], context, motion, tile)
        if context.measured > 0:
            measure_contact(q, tile.slots[q], motion.dt, context, tile)


@entry(END, **POINTED, **NO_COUNTS)
def end_contact(k, smooth, motion, context):
    """End candidate k, which opens within the step; return what friction and dashpots dissipate in it [J]. Had it no normal force
    at the start, the dashpots dissipate all that its normal spring stored: one step can lead to the end. Else what they leave of
    that is numerical loss (`accept_step.update_ledger`): the step counts its force as zero, that at the end."""
    damped, dragged = 0.0, opening_work(k, context, motion) if smooth and context.force >= 0 else 0.0
    if context.R[k, record.NORMAL_FORCE] == 0.0:
        damped = context.R[k, record.STORED_NORMAL]
    elif dashpots_act(smooth, context):
        n, _, _ = unpack_triple(context.H[k, contact_state.LAW + context.dashpots])
        damped = max(-0.5 * n * max(context.start_depths[k], 0.0), 0.0)
    friction = max(reset_history(k, context) + dragged, 0.0)
    if context.measured > 0:
        measure_opened(k, friction, context)
    return friction, damped
