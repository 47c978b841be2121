"""Residual of an implicit step of one body between two plates, at the end of a trial step; `pairs` adds contacts with others.

`set_configuration` moves body, spheres and patch to the end of the step with the coordinates y (`workspace.FREEDOMS`); `residual`
evaluates the laws there and writes the residual (7,) [N], torques over the arm of the body; its derivative is in `jacobian`. No
history is written before the step is accepted (`accept_step`).
Contact geometry, slip and history are those of the explicit integrator (`contact_geometry`, `memory`); here a contact
that closes within the step slips only during the rest of the step.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels import plates
from thirdbody.kernels.arguments import EFFECTS, LAW, Motion
from thirdbody.kernels.bodies import BodyMotion, place_body, quaternion
from thirdbody.kernels.contact_geometry import gather_plate_contact, gradient_force, padded, slip_increment, transport_frames
from thirdbody.kernels.implicit.contact import closed_fraction, contact_force, contact_moment, contact_point, depth_at, product
from thirdbody.kernels.implicit.workspace import FREEDOMS, STAGE, body_at, call_part, last_candidate, space_at, update_rough
from thirdbody.kernels.plates import is_upper
from thirdbody.kernels.rolling_kinematics import gather_rolling, has_moments, has_twist
from thirdbody.kernels.step_tables import step_contacts, step_memory, step_settings, step_start
from thirdbody.kernels.tables import body, body_extra, domain, orientation, patch, run_totals, sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output, rolling_input
from thirdbody.kernels.vectors import matrix, rotate

law_at, effects_at = function_at(LAW), function_at(EFFECTS)

MAX_ROTATION = 0.05  # largest rotation in a step [rad]: slip is computed for rotation about one fixed axis


@njit(**BARE)
def measure_arm(context, b, space):
    radius, offsets = 0.0, context.offsets
    for s in range(context.start[b], context.start[b + 1]):
        square = offsets[s, 0] ** 2 + offsets[s, 1] ** 2 + offsets[s, 2] ** 2
        radius = max(radius, math.sqrt(square) + context.S[s, sphere.RADIUS])
    space.start[step_start.ARM] = radius


@njit(**BARE_CHUNK)
def save_start(a, context, island, scratch):
    b, Z, B, P, E = body_at(a, island), space_at(a, scratch).start, context.B, context.P, context.E
    p = context.patch[b]
    call_part(context.rough_part, STAGE.START, a, 0, Motion(0.0, 0.0, 0.0), context, island, scratch)
    for k in range(3):
        Z[step_start.POSITION + k], Z[step_start.VELOCITY + k] = B[b, body.POSITION + k], B[b, body.VELOCITY + k]
        Z[step_start.ANGULAR_MOMENTUM + k] = E[b, body_extra.ANGULAR_MOMENTUM + k]
        Z[step_start.SPIN + k] = B[b, body.SPIN + k]
    for k in range(4):
        Z[step_start.QUATERNION + k] = context.orientations[b, orientation.QUATERNION + k]
    Z[step_start.PATCH_HEIGHT], Z[step_start.PATCH_VELOCITY] = P[p, patch.HEIGHT], P[p, patch.VELOCITY]
    Z[step_start.PATCH_LOAD] = P[p, patch.LOAD]
    for k in range(2):
        Z[step_start.PATCH_DISPLACEMENT + k] = P[p, patch.DISPLACEMENT + k]
    for e in range(context.plate_edges[b], last_candidate(b, context)):
        k = context.plate_incidence[e] >> 1
        context.start_depths[k] = plates.overlap(k, context) + context.D[domain.REACH]


@njit(**BARE)
def set_configuration(context, b, y, dt, space):
    p, Z, T, B, P = context.patch[b], space.start, context.memory[b], context.B, context.P
    inverse, per_arm, y_last = 1.0 / dt, 1.0 / Z[step_start.ARM], step_memory.LAST_COORDINATES
    now, last = Z[step_start.NOW] * inverse, Z[step_start.LAST] * inverse
    for k in range(3):
        B[b, body.POSITION + k] = Z[step_start.POSITION + k] + y[k]
        B[b, body.VELOCITY + k] = y[k] * inverse
    start = Z[step_start.QUATERNION], Z[step_start.QUATERNION + 1], Z[step_start.QUATERNION + 2], Z[step_start.QUATERNION + 3]
    q = rotate(start, y[3] * per_arm, y[4] * per_arm, y[5] * per_arm)
    for k in range(4):
        context.orientations[b, orientation.QUATERNION + k] = q[k]
    w = (y[3] * per_arm * inverse, y[4] * per_arm * inverse, y[5] * per_arm * inverse)
    w_end = now * y[3] - last * T[y_last + 3], now * y[4] - last * T[y_last + 4], now * y[5] - last * T[y_last + 5]
    w_end = w_end[0] * per_arm, w_end[1] * per_arm, w_end[2] * per_arm
    v_end = (now * y[0] - last * T[y_last], now * y[1] - last * T[y_last + 1], now * y[2] - last * T[y_last + 2])
    x, v = plates.three(B, b, body.POSITION), plates.three(B, b, body.VELOCITY)
    place_body(b, context.start, context.offsets, context.S, BodyMotion(x, q, v, w, v_end, w_end), dt)
    for k in range(3):
        B[b, body.VELOCITY + k], B[b, body.SPIN + k] = v_end[k], w_end[k]
    P[p, patch.HEIGHT] = Z[step_start.PATCH_HEIGHT] + y[6]
    P[p, patch.VELOCITY] = now * y[6] - last * T[y_last + 6]


@njit(**BARE)
def inertia_of(b, E, orientations):
    """Return the moments of inertia [kg m2] about world axes: xx, yy, zz, xy, xz, yz."""
    q = quaternion(b, orientations)
    a, b_, c, d, e, f, g, h, i = matrix(q[0], q[1], q[2], q[3])
    i_x, i_y, i_z = plates.three(E, b, body_extra.INERTIA)
    return (
        a * a * i_x + b_ * b_ * i_y + c * c * i_z, d * d * i_x + e * e * i_y + f * f * i_z,
        g * g * i_x + h * h * i_y + i * i * i_z, a * d * i_x + b_ * e * i_y + c * f * i_z,
        a * g * i_x + b_ * h * i_y + c * i * i_z, d * g * i_x + e * h * i_y + f * i * i_z,
    )  # fmt: skip


@njit(**BARE)
def active_contacts(a, motion, context, island, scratch):
    b, space = body_at(a, island), space_at(a, scratch)
    slots = space.slots
    # the mean velocity of the step, where `gather_plate_contact` takes that of the patch at its end
    patch_velocity = context.P[context.patch[b], patch.VELOCITY] - space.trial[6] / motion.dt
    m = np.int64(0)
    update_rough(STAGE.TRIAL, b, context)
    for e in range(context.plate_edges[b], last_candidate(b, context)):
        k = context.plate_incidence[e] >> 1
        if plates.overlap(k, context) + context.D[domain.REACH] <= 0.0:
            continue
        if m == TILE:
            return np.int64(-1)
        gather_plate_contact(m, k, context, motion, space)
        if is_upper(context.partner[k]):
            space.geometry[m + (geometry.MID_VELOCITY + 2) * TILE] += patch_velocity
        slots[m] = k
        m += 1
    computed = padded(m, context.n_history)
    transport_frames(computed, motion.dt, space)
    slip_increment(computed, motion.dt, space)
    for q in range(m):
        complete_contact(q, slots[q], space.start[step_start.NOW], motion, context, space)
    call_part(context.spots_part, STAGE.TRIAL, a, m, motion, context, island, scratch)
    return m


@njit(**BARE)
def complete_contact(q, k, weight, motion, context, tile):
    """Gather the rotation of contact q, candidate k; scale slip, rotation and travel where it closes within the step. `weight`:
    `step_start.NOW`."""
    I, at, start = tile.inputs, (law_input.HISTORY + context.n_history) * TILE + q, context.start_depths[k]  # noqa: E741
    if context.rolling > 0:
        gather_rolling(q, k, context, motion, tile)
    I[at + rolling_input.INVERSE_DT * TILE] = weight / motion.dt
    I[at + rolling_input.MOVED * TILE] = depth_at(q, context, I) - start
    if start < 0.0:
        fraction = closed_fraction(q, start, context, I)
        I[law_input.SLIP_X * TILE + q] *= fraction
        I[law_input.SLIP_Y * TILE + q] *= fraction
        if context.rolling > 0:
            I[at + rolling_input.ROTATION_X * TILE] *= fraction
            I[at + rolling_input.ROTATION_Y * TILE] *= fraction
            I[at + rolling_input.TRAVEL_X * TILE] *= fraction
            I[at + rolling_input.TRAVEL_Y * TILE] *= fraction
        if has_twist(context):
            I[at + rolling_input.TWIST * TILE] *= fraction


@njit(**BARE)
def observe_contact(q, k, radius, tile, diagnostics):
    O, overlap = tile.outputs, tile.inputs[law_input.OVERLAP * TILE + q]  # noqa: E741
    diagnostics[step_contacts.NORMAL_FORCE] += abs(O[law_output.NORMAL_FORCE * TILE + q])
    diagnostics[step_contacts.MAX_OVERLAP] = max(diagnostics[step_contacts.MAX_OVERLAP], overlap)
    diagnostics[step_contacts.MAX_RADIUS] = max(diagnostics[step_contacts.MAX_RADIUS], O[law_output.CONTACT_RADIUS * TILE + q])
    if overlap > diagnostics[step_contacts.MAX_RATIO] * radius:
        diagnostics[step_contacts.MAX_RATIO], diagnostics[step_contacts.SLOT] = overlap / radius, k


@njit(**BARE)
def residual(a, m, motion, context, island, scratch):
    """Write the residual (7,) [N] of the body at position a and its patch, in the trial, without contacts with other bodies
    (`pairs.evaluate_pairs`); sums and maxima to its `diagnostics`."""
    b, space = body_at(a, island), space_at(a, scratch)
    r, diagnostics, S = space.residual, space.diagnostics, context.S
    call_part(context.spots_part, STAGE.RELIEVE, a, m, motion, context, island, scratch)
    law_at(context.law)(space.inputs, space.outputs, padded(m, context.n_history), context.pairs)
    call_part(context.spots_part, STAGE.RESTORE, a, m, motion, context, island, scratch)
    for k in range(FREEDOMS):
        r[k] = 0.0
    for k in range(step_contacts.WIDTH):
        diagnostics[k] = 0.0
    diagnostics[step_contacts.SLOT] = -1.0
    for q in range(m):
        k = space.slots[q]
        i, upper, force = context.own[k], is_upper(context.partner[k]), contact_force(q, space)
        add_force(force, contact_point(q, i, S, space.geometry), upper, r)
        if has_moments(context):
            moment = contact_moment(q, context, space)
            for d in range(3):
                r[3 + d] += moment[d]
        if plates.is_rough(context):
            force = gradient_force(k, space.outputs[law_output.STORED_NORMAL * TILE + q], context)
            add_force(force, plates.three(S, i, sphere.ARM), upper, r)
        observe_contact(q, k, S[i, sphere.RADIUS], space, diagnostics)
    call_part(context.spots_part, STAGE.PULL, a, m, motion, context, island, scratch)
    for k in range(3):
        context.B[b, body.FORCE + k], context.B[b, body.TORQUE + k] = r[k], r[3 + k]
    if context.has_effects != 0:
        E, time = context.E, context.totals[b, run_totals.TIME] + motion.dt
        effects_at(context.effects)(context.B, E, b, b + 1, time, motion.dt, context.effect_parameters)
        for k in range(3):
            r[k] += E[b, body_extra.EFFECT_FORCE + k]
            r[3 + k] += E[b, body_extra.EFFECT_TORQUE + k]
    add_inertial_forces(context, b, motion.dt, space)
    for k in range(3):
        r[3 + k] /= space.start[step_start.ARM]


@njit(**BARE)
def add_force(f, point, upper, r):
    """Add a force [N] of a plate on a point (3,) of the body [m], and the opposite one on an `upper` plate, to the residual."""
    x, y, z = point
    r[0] += f[0]
    r[1] += f[1]
    r[2] += f[2]
    r[3] += y * f[2] - z * f[1]
    r[4] += z * f[0] - x * f[2]
    r[5] += x * f[1] - y * f[0]
    if upper:
        r[6] -= f[2]


@njit(**BARE)
def add_inertial_forces(context, b, dt, space):
    """Subtract inertial forces; add load, dashpot, spring and inertia of the patch. Without inertia every step begins at rest: a
    weak spring to the start position (TETHER) makes the position of a body that slides on all its contacts unique, and a
    fraction of the mass (MASS_FRACTION) limits jumps within a step."""
    p, Z, T, B, P, y, r = context.patch[b], space.start, context.memory[b], context.B, context.P, space.trial, space.residual
    inertial = context.settings[step_settings.INERTIAL]
    l_1 = product(inertia_of(b, context.E, context.orientations), plates.three(B, b, body.SPIN))
    now, last = Z[step_start.NOW] / dt, inertial * Z[step_start.LAST] / dt
    tether, fraction = Z[step_start.TETHER_STIFFNESS], Z[step_start.MASS_FRACTION]
    for k in range(3):
        dv = B[b, body.VELOCITY + k] - inertial * Z[step_start.VELOCITY + k]
        dl = l_1[k] - inertial * Z[step_start.ANGULAR_MOMENTUM + k]
        r[k] -= fraction * B[b, body.MASS] * (now * dv - last * T[step_memory.LAST_DV + k]) + tether * y[k]
        r[3 + k] -= fraction * (now * dl - last * T[step_memory.LAST_DL + k]) + tether * y[3 + k] * Z[step_start.ARM]
    if P[p, patch.FREE] == 0.0:
        r[6] = 0.0
        return
    patch_velocity = P[p, patch.VELOCITY]
    change = now * (patch_velocity - inertial * Z[step_start.PATCH_VELOCITY]) - last * T[step_memory.LAST_DRISE]
    r[6] -= P[p, patch.LOAD] + P[p, patch.DAMPING] * patch_velocity
    r[6] -= fraction * P[p, patch.MASS] * change + tether * y[6]
    r[6] -= P[p, patch.SPRING] * (P[p, patch.HEIGHT] - Z[step_start.PLATE_HEIGHT])
