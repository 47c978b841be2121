"""Residual of an implicit step of one body between two plates, at the end of a trial step.

Tables are passed in groups with the same names in all implicit kernels:

| group | tables |
|---|---|
| spots | own, partner, kind, edges, incidence: the candidates, here all pairs of a sphere and a plate |
| shape | body, start, patch, offsets |
| state | S, B, P, H, R, E |
| known | pairs, effect parameters, n_history, rolling, width of labeller rows, has_effects, labels, stored, force, moment |
| work | I, O, K, G: the law's tile; slots: its candidates; before: overlaps at the start of the step; the rest: `bdf2` |

In `known`, `stored` (`spring_energy`), `force` and `moment` are indices in the history. The coordinates y (7,) of a step are the
displacement of the centre of mass (3,) [m], the rotation vector of the step times the arm of the body (3,) [m] in world axes, and
the rise of the body's patch of the upper plate [m]. `set_configuration` moves body, spheres and patch to the end of the step;
`residual` evaluates the laws there and returns the residual (7,) [N]; its derivative is in `jacobian`. No history is written
before `commit`. Contact geometry, slip and history are those of the explicit integrator (`contact_geometry`, `contact_history`);
here a contact that closes within the step slips only during the rest of the step.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import CHUNK, INNER
from thirdbody.kernels.bundles import Motion, Tile
from thirdbody.kernels.columns import (
    body,
    body_extra,
    contact_sums,
    geometry,
    law_input,
    law_output,
    patch,
    record,
    rolling_input,
    rolling_output,
    sphere,
    step_contacts,
    step_memory,
    step_start,
)
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.contact_geometry import force_and_torques, gather_plate_contact, slip_increment, transport_frames
from thirdbody.kernels.contact_history import reset_history, spring_energy, store_history
from thirdbody.kernels.explicit.contact_dissipation import book
from thirdbody.kernels.explicit.contact_forces import write_record
from thirdbody.kernels.implicit.contact_context import contact_context
from thirdbody.kernels.implicit.friction_work import dragged_off
from thirdbody.kernels.narrow_phase import plate_overlap
from thirdbody.kernels.predicates import is_closed, is_lower, is_upper
from thirdbody.kernels.rigid_body import BodyMotion, place_body
from thirdbody.kernels.rolling_kinematics import MOMENTS, gather_rolling
from thirdbody.kernels.rotation import matrix, rotate

FREEDOMS = 7
"""Number of coordinates of a body and its patch."""


TURN = 0.05
"""Largest rotation in a step [rad]: slip is computed for rotation about one fixed axis."""


@njit(**CHUNK)
def save_start(b, p, shape, state, Z):
    """Save the state of body b and patch p at the start of a step in Z."""
    (S, B, P, _, _, E), (_, start, _, offsets) = state, shape
    for k in range(3):
        Z[step_start.POSITION + k], Z[step_start.VELOCITY + k] = B[b, body.POSITION + k], B[b, body.VELOCITY + k]
        Z[step_start.ANGULAR_MOMENTUM + k] = E[b, body_extra.ANGULAR_MOMENTUM + k]
        Z[step_start.SPIN + k] = B[b, body.SPIN + k]
    for k in range(4):
        Z[step_start.QUATERNION + k] = B[b, body.QUATERNION + k]
    Z[step_start.PATCH_HEIGHT] = P[p, patch.HEIGHT]
    Z[step_start.PATCH_VELOCITY] = P[p, patch.VELOCITY]
    Z[step_start.PATCH_LOAD] = P[p, patch.LOAD]
    far = 0.0
    for s in range(start[b], start[b + 1]):
        square = offsets[s, 0] ** 2 + offsets[s, 1] ** 2 + offsets[s, 2] ** 2
        far = max(far, math.sqrt(square) + S[s, sphere.RADIUS])
    Z[step_start.ARM] = far


@njit(**INNER)
def set_configuration(b, p, y, dt, Z, T, shape, state):
    """Move body b, its spheres and patch p to the end of the step, with mean and end velocities."""
    (S, B, P, _, _, _), (_, start, _, offsets) = state, shape
    inverse, arm = 1.0 / dt, 1.0 / Z[step_start.ARM]
    now, last = Z[step_start.NOW] * inverse, Z[step_start.BEFORE] * inverse
    for k in range(3):
        B[b, body.POSITION + k] = Z[step_start.POSITION + k] + y[k]
        B[b, body.VELOCITY + k] = y[k] * inverse
    q = rotate(
        (Z[step_start.QUATERNION], Z[step_start.QUATERNION + 1], Z[step_start.QUATERNION + 2], Z[step_start.QUATERNION + 3]),
        y[3] * arm,
        y[4] * arm,
        y[5] * arm,
    )
    for k in range(4):
        B[b, body.QUATERNION + k] = q[k]
    w = (y[3] * arm * inverse, y[4] * arm * inverse, y[5] * arm * inverse)
    w_end = (
        (now * y[3] - last * T[step_memory.LAST_COORDINATES + 3]) * arm,
        (now * y[4] - last * T[step_memory.LAST_COORDINATES + 4]) * arm,
        (now * y[5] - last * T[step_memory.LAST_COORDINATES + 5]) * arm,
    )
    v_end = (
        now * y[0] - last * T[step_memory.LAST_COORDINATES],
        now * y[1] - last * T[step_memory.LAST_COORDINATES + 1],
        now * y[2] - last * T[step_memory.LAST_COORDINATES + 2],
    )
    x = (B[b, body.POSITION], B[b, body.POSITION + 1], B[b, body.POSITION + 2])
    v = (B[b, body.VELOCITY], B[b, body.VELOCITY + 1], B[b, body.VELOCITY + 2])
    place_body(b, start, offsets, S, BodyMotion(x, q, v, w, v_end, w_end), dt)
    for k in range(3):
        B[b, body.VELOCITY + k], B[b, body.SPIN + k] = v_end[k], w_end[k]
    P[p, patch.HEIGHT] = Z[step_start.PATCH_HEIGHT] + y[6]
    P[p, patch.VELOCITY] = now * y[6] - last * T[step_memory.LAST_COORDINATES + 6]


@njit(**INNER)
def inertia_of(b, B, E):
    """Return the moments of inertia [kg m2] about world axes: xx, yy, zz, xy, xz, yz."""
    a, b_, c, d, e, f, g, h, i = matrix(
        B[b, body.QUATERNION], B[b, body.QUATERNION + 1], B[b, body.QUATERNION + 2], B[b, body.QUATERNION + 3]
    )
    i_x, i_y, i_z = E[b, body_extra.INERTIA], E[b, body_extra.INERTIA + 1], E[b, body_extra.INERTIA + 2]
    return (
        a * a * i_x + b_ * b_ * i_y + c * c * i_z, d * d * i_x + e * e * i_y + f * f * i_z,
        g * g * i_x + h * h * i_y + i * i * i_z, a * d * i_x + b_ * e * i_y + c * f * i_z,
        a * g * i_x + b_ * h * i_y + c * i * i_z, d * g * i_x + e * h * i_y + f * i * i_z,
    )  # fmt: skip


@njit(**INNER)
def momentum_of(b, B, E):
    """Return the angular momentum (3,) [kg m2/s] in world axes from spin and orientation."""
    xx, yy, zz, xy, xz, yz = inertia_of(b, B, E)
    x, y, z = B[b, body.SPIN], B[b, body.SPIN + 1], B[b, body.SPIN + 2]
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z


@njit(**INNER)
def active_contacts(b, dt, rate, v_x, v_y, spots, shape, state, known, work):
    """Gather the contacts of body b into the tile; return their number, or -1 if they do not fit.

    `rate`: derivative of the end velocity with respect to the displacement [1/s]; v_x, v_y: mean velocity of the upper plate
    [m/s].
    """
    edges, incidence, motion = spots[3], spots[4], Motion(dt, v_x, v_y)
    context = contact_context(spots, state, known)
    n_history, rolling, I, slots, before = known[2], known[3], work[0], work[4], work[5]  # noqa: E741
    tile = Tile(work[0], work[1], work[2], work[3])
    m = np.int64(0)
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if plate_overlap(k, context) <= 0.0:
            continue
        if m == TILE:
            return np.int64(-1)
        gather_plate_contact(m, k, context, motion, tile)
        slots[m] = k
        m += 1
    transport_frames(m, dt, tile)
    slip_increment(m, dt, tile)
    for q in range(m):
        at = (law_input.HISTORY + n_history) * TILE + q
        if rolling > 0:
            gather_rolling(q, slots[q], context, motion, tile)
        I[at + rolling_input.INVERSE_DT * TILE] = rate
        gap = before[slots[q] - edges[b]]
        if gap < 0.0:
            fraction = I[law_input.OVERLAP * TILE + q] / (I[law_input.OVERLAP * TILE + q] - gap)
            I[law_input.SLIP_X * TILE + q] *= fraction
            I[law_input.SLIP_Y * TILE + q] *= fraction
            if rolling > 0:
                I[at + rolling_input.TURN_X * TILE] *= fraction
                I[at + rolling_input.TURN_Y * TILE] *= fraction
                I[at + rolling_input.TRAVEL_X * TILE] *= fraction
                I[at + rolling_input.TRAVEL_Y * TILE] *= fraction
    return m


@njit(**INNER)
def force_and_point(q, i, S, O, G):  # noqa: E741
    """Return normal force [N], force (3,) [N] and point from the centre of mass (3,) [m] of contact q."""
    n = O[law_output.NORMAL_FORCE * TILE + q]
    t_1 = O[law_output.TANGENTIAL_X * TILE + q]
    t_2 = O[law_output.TANGENTIAL_Y * TILE + q]
    a = G[q + geometry.ARM * TILE]
    f_x = n * G[q + geometry.NORMAL * TILE] + t_1 * G[q + geometry.AXIS * TILE] + t_2 * G[q + geometry.CROSS_AXIS * TILE]
    f_y = (
        n * G[q + (geometry.NORMAL + 1) * TILE]
        + t_1 * G[q + (geometry.AXIS + 1) * TILE]
        + t_2 * G[q + (geometry.CROSS_AXIS + 1) * TILE]
    )
    f_z = (
        n * G[q + (geometry.NORMAL + 2) * TILE]
        + t_1 * G[q + (geometry.AXIS + 2) * TILE]
        + t_2 * G[q + (geometry.CROSS_AXIS + 2) * TILE]
    )
    r_x = S[i, sphere.ARM] - a * G[q + geometry.NORMAL * TILE]
    r_y = S[i, sphere.ARM + 1] - a * G[q + (geometry.NORMAL + 1) * TILE]
    r_z = S[i, sphere.ARM + 2] - a * G[q + (geometry.NORMAL + 2) * TILE]
    return n, (f_x, f_y, f_z), (r_x, r_y, r_z)


@njit(**INNER)
def residual(b, p, m, y, dt, time, inertial, spots, state, known, work, Z, T, law, effects, r, diagnostics):
    """Write the residual r (7,) [N] of body b and patch p with m contacts.

    Sums and maxima over the contacts are written to `diagnostics` (`columns.step_contacts`).
    """
    own, partner, edges = spots[0], spots[1], spots[3]
    S, B, P, _, _, E = state
    pairs, parameters, n_history, rolling, _, has_effects = known[:6]
    I, O, _, G, slots, before = work[0], work[1], work[2], work[3], work[4], work[5]  # noqa: E741
    law(I, O, m, pairs)
    for k in range(FREEDOMS):
        r[k] = 0.0
    normal, deepest, radius, ratio, slot, power = 0.0, 0.0, 0.0, 0.0, -1.0, 0.0
    for q in range(m):
        i, up = own[slots[q]], is_upper(partner[slots[q]])
        n, (f_x, f_y, f_z), (r_x, r_y, r_z) = force_and_point(q, i, S, O, G)
        r[0] += f_x
        r[1] += f_y
        r[2] += f_z
        r[3] += r_y * f_z - r_z * f_y
        r[4] += r_z * f_x - r_x * f_z
        r[5] += r_x * f_y - r_y * f_x
        if rolling == MOMENTS:
            at = (law_output.HISTORY + n_history) * TILE + q
            for d in range(3):
                r[3 + d] += (
                    O[at + rolling_output.MOMENT_X * TILE] * G[q + (geometry.AXIS + d) * TILE]
                    + O[at + rolling_output.MOMENT_Y * TILE] * G[q + (geometry.CROSS_AXIS + d) * TILE]
                )
        if up:
            r[6] -= f_z
        overlap = I[law_input.OVERLAP * TILE + q]
        normal += abs(n)
        deepest, radius = max(deepest, overlap), max(radius, O[law_output.CONTACT_RADIUS * TILE + q])
        power += O[law_output.DASHPOT_POWER * TILE + q] * mean_velocity_factor(q, dt, before[slots[q] - edges[b]], I)
        if overlap > ratio * S[i, sphere.RADIUS]:
            ratio, slot = overlap / S[i, sphere.RADIUS], slots[q]
    diagnostics[step_contacts.NORMAL_FORCE] = normal
    diagnostics[step_contacts.MAX_OVERLAP] = deepest
    diagnostics[step_contacts.MAX_RADIUS] = radius
    diagnostics[step_contacts.MAX_RATIO] = ratio
    diagnostics[step_contacts.SLOT] = slot
    diagnostics[step_contacts.DASHPOT_POWER] = power
    for k in range(3):
        B[b, body.FORCE + k], B[b, body.TORQUE + k] = r[k], r[3 + k]
    if has_effects:
        effects(B, E, b, b + 1, time, dt, parameters)
        for k in range(3):
            r[k] += E[b, body_extra.EFFECT_FORCE + k]
            r[3 + k] += E[b, body_extra.EFFECT_TORQUE + k]
    inertial_forces(b, p, y, dt, Z, T, B, E, P, inertial, r)
    for k in range(3):
        r[3 + k] /= Z[step_start.ARM]


@njit(**INNER)
def mean_velocity_factor(q, dt, before, I):  # noqa: E741
    """Return the mean velocity of contact q in the step over that at its end, in [0, 2].

    A dashpot's force is that at the end of the step, but it acts along the displacement of the step: its dissipation is force
    times displacement.
    """
    n = I[law_input.NORMAL_VELOCITY * TILE + q]
    x = I[law_input.VELOCITY_X * TILE + q]
    y = I[law_input.VELOCITY_Y * TILE + q]
    square = n * n + x * x + y * y
    along = (
        -n * (I[law_input.OVERLAP * TILE + q] - before) + x * I[law_input.SLIP_X * TILE + q] + y * I[law_input.SLIP_Y * TILE + q]
    )
    return min(max(along / (dt * square), 0.0), 2.0) if square > 0.0 else 1.0


@njit(**INNER)
def inertial_forces(b, p, y, dt, Z, T, B, E, P, inertial, r):
    """Subtract inertial forces from r; add load, dashpot, spring and inertia of the patch.

    Without inertia (`inertial` = 0) every step begins at rest. A weak spring to the start position (PULL) then makes the position
    of a body that slides on all its contacts unique, and a fraction of the mass (MASS_SHARE) limits jumps within a step.
    """
    now = Z[step_start.NOW] / dt
    last = inertial * Z[step_start.BEFORE] / dt
    pull = Z[step_start.PULL]
    fraction = Z[step_start.MASS_SHARE]
    l_1 = momentum_of(b, B, E)
    for k in range(3):
        r[k] -= (
            fraction
            * B[b, body.MASS]
            * (now * (B[b, body.VELOCITY + k] - inertial * Z[step_start.VELOCITY + k]) - last * T[step_memory.LAST_DV + k])
            + pull * y[k]
        )
        r[3 + k] -= (
            fraction * (now * (l_1[k] - inertial * Z[step_start.ANGULAR_MOMENTUM + k]) - last * T[step_memory.LAST_DL + k])
            + pull * y[3 + k] * Z[step_start.ARM]
        )
    if P[p, patch.FREE] == 0.0:
        r[6] = 0.0
        return
    rise = P[p, patch.VELOCITY]
    r[6] -= P[p, patch.LOAD] + P[p, patch.DAMPING] * rise
    r[6] -= (
        fraction * P[p, patch.MASS] * (now * (rise - inertial * Z[step_start.PATCH_VELOCITY]) - last * T[step_memory.LAST_DRISE])
        + pull * y[6]
    )
    r[6] -= P[p, patch.SPRING] * (P[p, patch.HEIGHT] - Z[step_start.PLATE_HEIGHT])


@njit(**INNER)
def unbooked_energy(q, k, context, O):  # noqa: E741
    """Return the stored energy [J] of candidate k (contact q) to be dissipated as friction ends.

    It is zero unless friction has ended without the energy being booked. Where the dashpot of a departing sphere cancels its
    normal force, friction ends in one step at a limit of zero. No force does work then: all stored energy is dissipated, as in a
    contact that opens (`contact_history.reset_history`).
    """
    if (
        O[law_output.TANGENTIAL_X * TILE + q] != 0.0
        or O[law_output.TANGENTIAL_Y * TILE + q] != 0.0
        or O[law_output.STORED_TANGENTIAL * TILE + q] != 0.0
    ):
        return 0.0
    return max(spring_energy(k, context) - O[law_output.DISSIPATED * TILE + q], 0.0)


@njit(**INNER)
def recoil(b, m, dt, spots, state, work):
    """Return the dashpot dissipation [J] of opening contacts that `residual` does not include.

    A contact without normal force at the start of the step is about to open: its dashpot cancels the elastic force and dissipates
    all energy still stored. As nothing accelerates the body, one step can lead from there to the open contact, and the force at
    its end does not include it.
    """
    edges, incidence = spots[3], spots[4]
    H, R, O, I, slots, before = state[3], state[4], work[1], work[0], work[4], work[5]  # noqa: E741
    total, q = 0.0, np.int64(0)
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        staged = q < m and slots[q] == k
        if is_closed(k, H) and R[k, record.NORMAL_FORCE] == 0.0:
            if not staged:
                total += R[k, record.STORED_NORMAL]
            elif O[law_output.NORMAL_FORCE * TILE + q] == 0.0:
                taken = O[law_output.DASHPOT_POWER * TILE + q] * mean_velocity_factor(q, dt, before[e - edges[b]], I) * dt
                total += R[k, record.STORED_NORMAL] - O[law_output.STORED_NORMAL * TILE + q] - taken
        if staged:
            q += 1
    return total


@njit(**INNER)
def commit(b, m, dt, v_x, v_y, spots, state, known, work, Z, sums):
    """Store history, friction work, slip and records of m contacts; add work and plate forces to `sums`.

    Bodies exchange the work of the mean force of a step, which friction dissipates (`explicit.contact_dissipation`). Where forces
    jump (`friction_work.weight_of_old`) the laws book the work of the force at the end of the step, consistent with the plate's
    work.
    """
    partner, edges, incidence, context, motion = (
        spots[1],
        spots[3],
        spots[4],
        contact_context(spots, state, known),
        Motion(dt, v_x, v_y),
    )
    B, H, tile = state[1], state[3], Tile(work[0], work[1], work[2], work[3])
    force = known[8] if Z[step_start.OLD_WEIGHT] > 0.0 else np.int64(-1)
    O, G, slots = work[1], work[3], work[4]  # noqa: E741
    force_and_torques(m, tile)
    if force >= 0:
        book(m, context, tile)
    for i in range(m if force < 0 else 0):
        O[law_output.DISSIPATED * TILE + i] += unbooked_energy(i, slots[i], context, O)
    store_history(m, slots, context, tile)
    q = np.int64(0)
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if q < m and slots[q] == k:
            write_record(q, k, context, motion, tile)
            sums[0, contact_sums.FRICTION_WORK] += O[law_output.DISSIPATED * TILE + q]
            B[b, body.FRICTION_WORK] += O[law_output.DISSIPATED * TILE + q]  # all of it: the partner is a plate
            B[b, body.SLIP_DISTANCE] += O[law_output.SLIP * TILE + q]
            side = contact_sums.LOWER_FORCE if is_lower(partner[k]) else contact_sums.UPPER_FORCE
            for d in range(3):
                sums[0, side + d] += G[q + (geometry.FORCE + d) * TILE]
            q += 1
        elif is_closed(k, H):
            dragged = dragged_off(k, work[5][e - edges[b]], motion, context) if force >= 0 else 0.0
            lost = max(reset_history(k, context) + dragged, 0.0)
            sums[0, contact_sums.FRICTION_WORK] += lost
            B[b, body.FRICTION_WORK] += lost
