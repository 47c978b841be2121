"""Residual of an implicit step of one body between two plates, at the end of a trial step.

`set_configuration` moves body, spheres and patch to the end of the step with the coordinates y (`workspace.FREEDOMS`); `residual`
evaluates the laws there and writes the residual (7,) [N]; its derivative is in `jacobian`. No history is written before the
step is accepted (`accept_step`).
Contact geometry, slip and history are those of the explicit integrator (`contact_geometry`, `memory`); here a contact
that closes within the step slips only during the rest of the step.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels import plates
from thirdbody.kernels.arguments import EFFECTS, LAW
from thirdbody.kernels.bodies import BodyMotion, place_body, quaternion
from thirdbody.kernels.contact_geometry import gather_plate_contact, padded, slip_increment, transport_frames
from thirdbody.kernels.implicit.tables import step_contacts, step_memory, step_settings, step_start
from thirdbody.kernels.implicit.workspace import (
    FREEDOMS,
    GATHER,
    PULL,
    RELIEVE,
    RESTORE,
    body_at,
    call_part,
    last_candidate,
    sort_candidates,
    space_at,
)
from thirdbody.kernels.minima import update_surfaces
from thirdbody.kernels.plates import is_upper
from thirdbody.kernels.rolling_kinematics import gather_rolling, has_moments, has_twist
from thirdbody.kernels.tables import body, body_extra, domain, orientation, patch, run_totals, sphere, surface_contact
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output, rolling_input, rolling_output
from thirdbody.kernels.vectors import matrix, rotate

law_at, effects_at = function_at(LAW), function_at(EFFECTS)

MAX_ROTATION = 0.05
"""Largest rotation in a step [rad]: slip is computed for rotation about one fixed axis."""


@njit(**BARE)
def measure_arm(context, b, space):
    """Store the distance of the farthest point of the body from its centre of mass: it holds for all its steps."""
    radius, offsets = 0.0, context.offsets
    for s in range(context.start[b], context.start[b + 1]):
        square = offsets[s, 0] ** 2 + offsets[s, 1] ** 2 + offsets[s, 2] ** 2
        radius = max(radius, math.sqrt(square) + context.S[s, sphere.RADIUS])
    space.start[step_start.ARM] = radius


@njit(**BARE_CHUNK)
def save_start(context, b, space):
    """Save the state of the body and its patch at the start of a step."""
    p, Z, B, P, E = context.patch[b], space.start, context.B, context.P, context.E
    if plates.is_rough(context):
        sort_candidates(b, context)
    for k in range(3):
        Z[step_start.POSITION + k], Z[step_start.VELOCITY + k] = B[b, body.POSITION + k], B[b, body.VELOCITY + k]
        Z[step_start.ANGULAR_MOMENTUM + k] = E[b, body_extra.ANGULAR_MOMENTUM + k]
        Z[step_start.SPIN + k] = B[b, body.SPIN + k]
    for k in range(4):
        Z[step_start.QUATERNION + k] = context.orientations[b, orientation.QUATERNION + k]
    Z[step_start.PATCH_HEIGHT] = P[p, patch.HEIGHT]
    Z[step_start.PATCH_VELOCITY] = P[p, patch.VELOCITY]
    Z[step_start.PATCH_LOAD] = P[p, patch.LOAD]
    for k in range(2):
        Z[step_start.PATCH_DISPLACEMENT + k] = P[p, patch.DISPLACEMENT + k]


@njit(**BARE)
def set_configuration(context, b, y, dt, space):
    """Move the body, its spheres and its patch to the end of the step, with mean and end velocities."""
    p, Z, T, B, P = context.patch[b], space.start, context.memory[b], context.B, context.P
    inverse, per_arm = 1.0 / dt, 1.0 / Z[step_start.ARM]
    now, last = Z[step_start.NOW] * inverse, Z[step_start.BEFORE] * inverse
    for k in range(3):
        B[b, body.POSITION + k] = Z[step_start.POSITION + k] + y[k]
        B[b, body.VELOCITY + k] = y[k] * inverse
    q = rotate(
        (Z[step_start.QUATERNION], Z[step_start.QUATERNION + 1], Z[step_start.QUATERNION + 2], Z[step_start.QUATERNION + 3]),
        y[3] * per_arm,
        y[4] * per_arm,
        y[5] * per_arm,
    )
    for k in range(4):
        context.orientations[b, orientation.QUATERNION + k] = q[k]
    w = (y[3] * per_arm * inverse, y[4] * per_arm * inverse, y[5] * per_arm * inverse)
    w_end = (
        (now * y[3] - last * T[step_memory.LAST_COORDINATES + 3]) * per_arm,
        (now * y[4] - last * T[step_memory.LAST_COORDINATES + 4]) * per_arm,
        (now * y[5] - last * T[step_memory.LAST_COORDINATES + 5]) * per_arm,
    )
    v_end = (
        now * y[0] - last * T[step_memory.LAST_COORDINATES],
        now * y[1] - last * T[step_memory.LAST_COORDINATES + 1],
        now * y[2] - last * T[step_memory.LAST_COORDINATES + 2],
    )
    x = (B[b, body.POSITION], B[b, body.POSITION + 1], B[b, body.POSITION + 2])
    v = (B[b, body.VELOCITY], B[b, body.VELOCITY + 1], B[b, body.VELOCITY + 2])
    place_body(b, context.start, context.offsets, context.S, BodyMotion(x, q, v, w, v_end, w_end), dt)
    for k in range(3):
        B[b, body.VELOCITY + k], B[b, body.SPIN + k] = v_end[k], w_end[k]
    P[p, patch.HEIGHT] = Z[step_start.PATCH_HEIGHT] + y[6]
    P[p, patch.VELOCITY] = now * y[6] - last * T[step_memory.LAST_COORDINATES + 6]


@njit(**BARE)
def inertia_of(b, E, orientations):
    """Return the moments of inertia [kg m2] about world axes: xx, yy, zz, xy, xz, yz."""
    q = quaternion(b, orientations)
    a, b_, c, d, e, f, g, h, i = matrix(q[0], q[1], q[2], q[3])
    i_x, i_y, i_z = E[b, body_extra.INERTIA], E[b, body_extra.INERTIA + 1], E[b, body_extra.INERTIA + 2]
    return (
        a * a * i_x + b_ * b_ * i_y + c * c * i_z, d * d * i_x + e * e * i_y + f * f * i_z,
        g * g * i_x + h * h * i_y + i * i * i_z, a * d * i_x + b_ * e * i_y + c * f * i_z,
        a * g * i_x + b_ * h * i_y + c * i * i_z, d * g * i_x + e * h * i_y + f * i * i_z,
    )  # fmt: skip


@njit(**BARE)
def momentum_of(b, context):
    """Return the angular momentum (3,) [kg m2/s] in world axes from spin and orientation."""
    B = context.B
    xx, yy, zz, xy, xz, yz = inertia_of(b, context.E, context.orientations)
    x, y, z = B[b, body.SPIN], B[b, body.SPIN + 1], B[b, body.SPIN + 2]
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z


@njit(**BARE)
def active_contacts(a, motion, context, island, scratch):
    """Gather the contacts with plates of the body at position a, in the trial; return their number, -1: too many."""
    b, space = body_at(a, island), space_at(a, scratch)
    tile, slots = space, space.slots
    # the mean velocity of the step, where `gather_plate_contact` takes that of the patch at its end
    patch_velocity = context.P[context.patch[b], patch.VELOCITY] - space.trial[6] / motion.dt
    m = np.int64(0)
    if plates.is_rough(context):
        update_surfaces(context.plate_edges[b], context.plate_edges[b + 1], context)
    for e in range(context.plate_edges[b], last_candidate(b, context)):
        k = context.plate_incidence[e] >> 1
        if plates.overlap(k, context) + context.D[domain.REACH] <= 0.0:
            continue
        if m == TILE:
            return np.int64(-1)
        gather_plate_contact(m, k, context, motion, tile)
        if is_upper(context.partner[k]):
            tile.geometry[m + (geometry.MID_VELOCITY + 2) * TILE] += patch_velocity
        slots[m] = k
        m += 1
    computed = padded(m, context.n_history)
    transport_frames(computed, motion.dt, tile)
    slip_increment(computed, motion.dt, tile)
    for q in range(m):
        if context.rolling > 0:
            gather_rolling(q, slots[q], context, motion, tile)
        at, before = (law_input.HISTORY + context.n_history) * TILE + q, space.before[slots[q] - context.plate_edges[b]]
        tile.inputs[at + rolling_input.INVERSE_DT * TILE] = space.start[step_start.NOW] / motion.dt
        tile.inputs[at + rolling_input.MOVED * TILE] = depth_at(q, context, tile.inputs) - before
        scale_slip(q, before, context, tile.inputs)
    if context.spots_part != 0:
        call_part(context.spots_part, GATHER, a, m, motion, context, island, scratch)
    return m


@njit(**BARE)
def depth_at(q, context, I):  # noqa: E741
    """Return overlap plus reach of contact q [m]: laws act where it is positive."""
    return I[law_input.OVERLAP * TILE + q] + context.D[domain.REACH]


@njit(**BARE)
def closed_fraction(q, before, context, I):  # noqa: E741
    """Return the fraction of the step in which contact q was within reach; `before`: `depth_at` its start [m], < 0: not yet."""
    depth = depth_at(q, context, I)
    return depth / (depth - before) if before < 0.0 else 1.0


@njit(**BARE)
def scale_slip(q, before, context, I):  # noqa: E741
    """Scale slip, rotation and travel of contact q where it closes within the step."""
    if before < 0.0:
        fraction, at = closed_fraction(q, before, context, I), (law_input.HISTORY + context.n_history) * TILE + q
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
def vector_at(q, field, G):
    """Return a vector field of the tile at contact q; `field`: its first column."""
    at = q + field * TILE
    return G[at], G[at + TILE], G[at + 2 * TILE]


@njit(**BARE)
def frame_of(q, G):
    """Return normal and both axes of contact q."""
    return vector_at(q, geometry.NORMAL, G), vector_at(q, geometry.AXIS, G), vector_at(q, geometry.CROSS_AXIS, G)


@njit(**BARE)
def contact_force(q, tile):
    """Return the force (3,) [N] of contact q on the body."""
    n = tile.outputs[law_output.NORMAL_FORCE * TILE + q]
    t_1, t_2 = tile.outputs[law_output.TANGENTIAL_X * TILE + q], tile.outputs[law_output.TANGENTIAL_Y * TILE + q]
    normal, e, g = frame_of(q, tile.geometry)
    return (
        n * normal[0] + t_1 * e[0] + t_2 * g[0],
        n * normal[1] + t_1 * e[1] + t_2 * g[1],
        n * normal[2] + t_1 * e[2] + t_2 * g[2],
    )


@njit(**BARE)
def contact_point(q, i, S, G):
    """Return the point of contact q, of sphere i, from the centre of mass (3,) [m]."""
    n, a = vector_at(q, geometry.NORMAL, G), G[q + geometry.ARM * TILE]
    return S[i, sphere.ARM] - a * n[0], S[i, sphere.ARM + 1] - a * n[1], S[i, sphere.ARM + 2] - a * n[2]


@njit(**BARE)
def contact_moment(q, context, tile):
    """Return the moment (3,) [N m] of contact q on the body, of rolling and of twisting."""
    at = (law_output.HISTORY + context.n_history) * TILE + q
    m_1, m_2 = tile.outputs[at + rolling_output.MOMENT_X * TILE], tile.outputs[at + rolling_output.MOMENT_Y * TILE]
    n, e, g = frame_of(q, tile.geometry)
    x, y, z = m_1 * e[0] + m_2 * g[0], m_1 * e[1] + m_2 * g[1], m_1 * e[2] + m_2 * g[2]
    if has_twist(context):
        twist = tile.outputs[at + rolling_output.TWIST_MOMENT * TILE]
        x, y, z = x + twist * n[0], y + twist * n[1], z + twist * n[2]
    return x, y, z


@njit(**BARE)
def residual(a, m, motion, context, island, scratch):
    """Write the residual (7,) [N] of the body at position a and its patch with m contacts with plates, in the trial.

    Sums and maxima over the contacts are written to its `diagnostics`.
    """
    b, space = body_at(a, island), space_at(a, scratch)
    tile, r, diagnostics = space, space.residual, space.diagnostics
    if context.spots_part != 0:
        call_part(context.spots_part, RELIEVE, a, m, motion, context, island, scratch)
    law_at(context.law)(tile.inputs, tile.outputs, padded(m, context.n_history), context.pairs)
    if context.spots_part != 0:
        call_part(context.spots_part, RESTORE, a, m, motion, context, island, scratch)
    for k in range(FREEDOMS):
        r[k] = 0.0
    for k in range(step_contacts.WIDTH):
        diagnostics[k] = 0.0
    diagnostics[step_contacts.SLOT] = -1.0
    for q in range(m):
        k = space.slots[q]
        f_x, f_y, f_z = contact_force(q, tile)
        r_x, r_y, r_z = contact_point(q, context.own[k], context.S, tile.geometry)
        r[0] += f_x
        r[1] += f_y
        r[2] += f_z
        r[3] += r_y * f_z - r_z * f_y
        r[4] += r_z * f_x - r_x * f_z
        r[5] += r_x * f_y - r_y * f_x
        if has_moments(context):
            moment = contact_moment(q, context, tile)
            for d in range(3):
                r[3 + d] += moment[d]
        if is_upper(context.partner[k]):
            r[6] -= f_z
        if plates.is_rough(context):
            add_gradient_force(k, tile.outputs[law_output.STORED_NORMAL * TILE + q], context, r)
        overlap, radius = space.inputs[law_input.OVERLAP * TILE + q], context.S[context.own[k], sphere.RADIUS]
        diagnostics[step_contacts.NORMAL_FORCE] += abs(tile.outputs[law_output.NORMAL_FORCE * TILE + q])
        diagnostics[step_contacts.MAX_OVERLAP] = max(diagnostics[step_contacts.MAX_OVERLAP], overlap)
        contact_radius = tile.outputs[law_output.CONTACT_RADIUS * TILE + q]
        diagnostics[step_contacts.MAX_RADIUS] = max(diagnostics[step_contacts.MAX_RADIUS], contact_radius)
        if overlap > diagnostics[step_contacts.MAX_RATIO] * radius:
            diagnostics[step_contacts.MAX_RATIO], diagnostics[step_contacts.SLOT] = overlap / radius, k
    if context.spots_part != 0:
        call_part(context.spots_part, PULL, a, m, motion, context, island, scratch)
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
def gradient_force(k, energy, context):
    """Return the force (3,) [N] of candidate k, a contact with a rough plate, as its effective radius changes along the surface.

    `energy`: of its normal spring [J]. See `contact_geometry.add_gradient_force`.
    """
    x, y, z = plates.three(context.Q, k, surface_contact.GRADIENT)
    return -0.5 * energy * x, -0.5 * energy * y, -0.5 * energy * z


@njit(**BARE)
def add_gradient_force(k, energy, context, r):
    """Add the gradient force of candidate k (`gradient_force`), which acts on the centre of the sphere, to the residual."""
    i, S = context.own[k], context.S
    x, y, z = S[i, sphere.ARM], S[i, sphere.ARM + 1], S[i, sphere.ARM + 2]
    f_x, f_y, f_z = gradient_force(k, energy, context)
    r[0] += f_x
    r[1] += f_y
    r[2] += f_z
    r[3] += y * f_z - z * f_y
    r[4] += z * f_x - x * f_z
    r[5] += x * f_y - y * f_x
    if is_upper(context.partner[k]):
        r[6] -= f_z


@njit(**BARE)
def add_inertial_forces(context, b, dt, space):
    """Subtract inertial forces from the residual; add load, dashpot, spring and inertia of the patch.

    Without inertia (`step_settings.INERTIAL` = 0) every step begins at rest. A weak spring to the start position (TETHER) then
    makes the position of a body that slides on all its contacts unique, and a fraction of the mass (MASS_FRACTION) limits jumps
    within a step.
    """
    p, Z, T, B, P = context.patch[b], space.start, context.memory[b], context.B, context.P
    y, r = space.trial, space.residual
    inertial = context.settings[step_settings.INERTIAL]
    now = Z[step_start.NOW] / dt
    last = inertial * Z[step_start.BEFORE] / dt
    tether = Z[step_start.TETHER_STIFFNESS]
    fraction = Z[step_start.MASS_FRACTION]
    l_1 = momentum_of(b, context)
    for k in range(3):
        r[k] -= (
            fraction
            * B[b, body.MASS]
            * (now * (B[b, body.VELOCITY + k] - inertial * Z[step_start.VELOCITY + k]) - last * T[step_memory.LAST_DV + k])
            + tether * y[k]
        )
        r[3 + k] -= (
            fraction * (now * (l_1[k] - inertial * Z[step_start.ANGULAR_MOMENTUM + k]) - last * T[step_memory.LAST_DL + k])
            + tether * y[3 + k] * Z[step_start.ARM]
        )
    if P[p, patch.FREE] == 0.0:
        r[6] = 0.0
        return
    patch_velocity = P[p, patch.VELOCITY]
    r[6] -= P[p, patch.LOAD] + P[p, patch.DAMPING] * patch_velocity
    r[6] -= (
        fraction
        * P[p, patch.MASS]
        * (now * (patch_velocity - inertial * Z[step_start.PATCH_VELOCITY]) - last * T[step_memory.LAST_DRISE])
        + tether * y[6]
    )
    r[6] -= P[p, patch.SPRING] * (P[p, patch.HEIGHT] - Z[step_start.PLATE_HEIGHT])
