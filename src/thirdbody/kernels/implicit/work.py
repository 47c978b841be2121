"""Error of the friction work of a body in an implicit step; and what of its contacts' work does not depend on acceptance.

A rolling body dissipates only while load passes from one contact to the next: over some nanometres, with work far below that of
a sliding body and too small to show in the position error. Step lengths are therefore also controlled by an energy error.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels import plates
from thirdbody.kernels.books import friction_work_of
from thirdbody.kernels.implicit.residual import depth_at
from thirdbody.kernels.implicit.tables import step_memory, step_start
from thirdbody.kernels.implicit.workspace import last_candidate
from thirdbody.kernels.plates import is_closed, surface_velocity
from thirdbody.kernels.tables import body, contact_state, domain, sphere
from thirdbody.kernels.tile import TILE, law_input, law_output, rolling_input


@njit(**BARE)
def mean_velocity_factor(q, dt, before, context, I):  # noqa: E741
    """Return the mean velocity of contact q in the step over that at its end, in [0, 2]."""
    n = I[law_input.NORMAL_VELOCITY * TILE + q]
    x = I[law_input.VELOCITY_X * TILE + q]
    y = I[law_input.VELOCITY_Y * TILE + q]
    square = n * n + x * x + y * y
    along = -n * (depth_at(q, context, I) - before) + x * I[law_input.SLIP_X * TILE + q] + y * I[law_input.SLIP_Y * TILE + q]
    return min(max(along / (dt * square), 0.0), 2.0) if square > 0.0 else 1.0


@njit(**BARE)
def loss_of_end(q, before, dt, context, tile):
    """Return the energy [J] that the dashpots of contact q dissipate by their forces at the end of the step."""
    return tile.outputs[law_output.DASHPOT_POWER * TILE + q] * mean_velocity_factor(q, dt, before, context, tile.inputs) * dt


FLOOR = 0.02
"""Floor of the scale of the friction-work error, as a fraction of friction limit times critical slip summed over the contacts: a
tenth of what is dissipated when the set of loaded contacts changes once."""

MIN_CUT = 1e5
"""Shortest step cut for this error, in units of the shortest step tried."""

GROWN = 0.75
"""Error of the tangential force of a contact whose radius changes within the step, over relative change of radius times friction
limit times slip over critical slip: laws use the stiffness 2 G* a = 1.5 limit/critical at the end of the step, while the mean
over the step would differ by half the change."""

CALM = 0.01
"""Largest dashpot work, as a fraction of the tangential work, for which forces count as continuous at a breakpoint."""


@njit(**BARE)
def weight_of_old(context, b, m, dt, space):
    """Return the weight of the force at the start of a step in its work: 0.5, or 0 where forces jump.

    The work is that of the plate, of friction and of dashpots. Forces jump with the velocity at a breakpoint of the motion if the
    dashpots of the m contacts dissipate more than CALM of the work of the tangential forces.
    """
    if context.memory[b, step_memory.LAST_DT] > 0.0:
        return 0.5
    I, O, work_done, damped = space.inputs, space.outputs, 0.0, 0.0  # noqa: E741
    for q in range(m):
        damped += loss_of_end(q, space.before[space.slots[q] - context.plate_edges[b]], dt, context, space)
        work_done += abs(O[law_output.TANGENTIAL_X * TILE + q] * I[law_input.SLIP_X * TILE + q]) + abs(
            O[law_output.TANGENTIAL_Y * TILE + q] * I[law_input.SLIP_Y * TILE + q]
        )
    return 0.5 if damped <= CALM * work_done else 0.0


@njit(**BARE)
def opening_work(k, before, contact, u, context, dt):
    """Return the slip work [J] of the tangential spring of candidate k, whose force falls to zero as it opens within the step.

    `before`: overlap plus reach [m] at the start of the step; `contact`: overlap [m] and normal at its end; u: mean velocity of
    the partner there [m/s].
    """
    S, H, i, (overlap, (n_x, n_y, n_z)) = context.S, context.H, context.own[k], contact
    r, columns = S[i, sphere.RADIUS], (np.int64(sphere.MID_VELOCITY), np.int64(sphere.MID_SPIN))
    v = surface_velocity(i, S, columns, (-r * n_x, -r * n_y, -r * n_z))
    f_1, f_2 = H[k, contact_state.LAW + context.force], H[k, contact_state.LAW + context.force + 1]
    e_x, e_y, e_z = H[k, contact_state.AXIS], H[k, contact_state.AXIS + 1], H[k, contact_state.AXIS + 2]
    f_x = f_1 * e_x + f_2 * (n_y * e_z - n_z * e_y)
    f_y = f_1 * e_y + f_2 * (n_z * e_x - n_x * e_z)
    f_z = f_1 * e_z + f_2 * (n_x * e_y - n_y * e_x)
    fraction = before / max(before - overlap - context.D[domain.REACH], 1e-300)
    return -0.5 * fraction * dt * (f_x * (v[0] - u[0]) + f_y * (v[1] - u[1]) + f_z * (v[2] - u[2]))


@njit(**BARE)
def plate_opening_work(k, before, context, motion):
    """Return the `opening_work` [J] of candidate k, with a plate; `before`: -inf where its minimum had ended by the start."""
    if before == -math.inf:
        return 0.0
    contact = plates.overlap(k, context), plates.normal(k, context)
    return opening_work(k, before, contact, plates.velocity(context.partner[k], context.P, motion), context, motion.dt)


@njit(**BARE)
def energy_of_contacts(m, tile):
    """Return the sum [J] of friction limit times critical slip, each at most N times overlap."""
    total = 0.0
    for q in range(m):
        total += contact_energy(q, tile)
    return total


@njit(**BARE)
def contact_energy(q, tile):
    """Return friction limit times critical slip of contact q [J], at most N times overlap."""
    O = tile.outputs  # noqa: E741
    pressed = abs(O[q + law_output.NORMAL_FORCE * TILE]) * abs(tile.inputs[q + law_input.OVERLAP * TILE])
    return min(O[q + law_output.FRICTION_LIMIT * TILE] * O[q + law_output.CRITICAL_SLIP * TILE], pressed)


@njit(**BARE)
def contact_difference(q, before, context, tile):
    """Return the estimated error [J] of the friction work of contact q; `before`: its overlap plus reach at the start [m].

    It is the difference between the work of the mean force and of the force at the end of the step, plus the effect of a
    changing contact radius (`GROWN`).
    """
    I, O = tile.inputs, tile.outputs  # noqa: E741
    old, new = (law_input.HISTORY + context.force) * TILE + q, (law_output.HISTORY + context.force) * TILE + q
    s_x, s_y = I[q + law_input.SLIP_X * TILE], I[q + law_input.SLIP_Y * TILE]
    work_done = (I[old] + O[new]) * s_x + (I[old + TILE] + O[new + TILE]) * s_y
    work_done += moment_work(q, context, tile)
    lost = I[(law_input.HISTORY + context.stored) * TILE + q] - 0.5 * work_done - O[q + law_output.STORED_TANGENTIAL * TILE]
    slip = min(math.sqrt(s_x * s_x + s_y * s_y), O[q + law_output.CRITICAL_SLIP * TILE])
    fraction = math.sqrt(max(before, 0.0) / depth_at(q, context, I))
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
    """Return the scale of energy [J] for errors of the friction work of a body.

    It is its friction work so far, plus its kinetic energy of translation, which impacts dissipate, plus FLOOR times that of
    rotation, which friction alone dissipates, and the energy that its contacts can store (largest so far: step_memory.MAX_ENERGY
    [J]).
    """
    B = context.B
    stored = max(context.memory[b, step_memory.MAX_ENERGY], energy_of_contacts(m, space))
    friction, square, turn = friction_work_of(b, B, context.E, context.loss_column), 0.0, 0.0
    for k in range(3):
        square += B[b, body.VELOCITY + k] ** 2
        turn += (space.start[step_start.ARM] * B[b, body.SPIN + k]) ** 2
    return friction + 0.5 * B[b, body.MASS] * square + FLOOR * (stored + 0.5 * B[b, body.MASS] * turn)


@njit(**BARE)
def work_error_of_plates(context, b, m, motion, space):
    """Return the error [J] of the friction work of the contacts of a body with plates."""
    first, error, q = context.plate_edges[b], 0.0, np.int64(0)
    for p in range(m):
        error += contact_difference(p, space.before[space.slots[p] - first], context, space)
    for e in range(first, last_candidate(b, context)):
        k = context.plate_incidence[e] >> 1
        if q < m and space.slots[q] == k:
            q += 1
        elif is_closed(k, context.H):
            error += abs(plate_opening_work(k, space.before[k - first], context, motion))
    return error
