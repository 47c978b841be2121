"""Acceptance of an implicit step: history, records, friction work and slip of its contacts, energy ledger; or its rejection."""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.books import normal_loss_of
from thirdbody.kernels.contact_geometry import add_gradient_force, force_and_torques
from thirdbody.kernels.contact_zone import book_zone, has_zone
from thirdbody.kernels.height_field import has_heights
from thirdbody.kernels.implicit import books
from thirdbody.kernels.implicit.contact import product
from thirdbody.kernels.implicit.control import step_ratio
from thirdbody.kernels.implicit.residual import inertia_of, set_configuration
from thirdbody.kernels.implicit.workspace import FREEDOMS, STAGE, last_candidate, update_rough
from thirdbody.kernels.plates import book_direct_contact, has_effect_columns, is_closed, is_lower, is_rough, three
from thirdbody.kernels.step_tables import contact_sums, sphere_path, step_contacts, step_memory, step_settings, step_start
from thirdbody.kernels.tables import body, body_extra, patch, run_totals, sphere
from thirdbody.kernels.tile import TILE, geometry, law_output

ROUNDED = 1.001  # upper bound of the path of a sphere over the sum of its chords: a step turns a body by 0.05 rad at most

STRAYED = 0.5 * math.sqrt(ROUNDED**2 - 1.0)
"""Largest distance of a path from its chord, over the chord: that of a path of this length, an ellipse at most."""


@njit(**BARE)
def commit(context, b, m, motion, space):
    """Store history, friction work, slip and records of m contacts; return the energy [J] that their dashpots dissipate."""
    O, sums, B, smooth = space.outputs, space.sums, context.B, space.start[step_start.OLD_WEIGHT] > 0.0  # noqa: E741
    q, friction, damped = np.int64(0), 0.0, 0.0
    force_and_torques(m, space)
    if is_rough(context):
        add_gradient_force(m, space.slots, context, space)
    books.book_at(context.book_contacts)(m, smooth, motion.dt, context, space)
    for p in range(m):
        damped += O[law_output.DASHPOT_POWER * TILE + p]
    books.write_at(context.write_contacts)(m, motion, context, space)
    for e in range(context.plate_edges[b], last_candidate(b, context)):
        k = context.plate_incidence[e] >> 1
        if q < m and space.slots[q] == k:
            friction = O[law_output.DISSIPATED * TILE + q]
            if context.loss_column >= 0:
                context.E[b, body_extra.NORMAL_LOSS] += normal_loss_of(q, context.loss_column, space)
            B[b, body.SLIP_DISTANCE] += O[law_output.SLIP * TILE + q]
            side = contact_sums.LOWER_FORCE if is_lower(context.partner[k]) else contact_sums.UPPER_FORCE
            for d in range(3):
                sums[0, side + d] += space.geometry[q + (geometry.FORCE + d) * TILE]
            q += 1
        elif is_closed(k, context.H):
            friction, lost = books.end_at(context.end_contact)(np.int64(k), smooth, motion, context)
            damped += lost
        else:
            continue
        sums[0, contact_sums.FRICTION_WORK] += friction
        B[b, body.FRICTION_WORK] += friction  # all of it: the partner is a plate
    return damped


@njit(**BARE)
def body_works(context, b, dt, space):
    """Return works on the body in the step [J]: of contacts, of effects, of inertial forces; kinetic energies at both ends."""
    Z, T, B, E, y = space.start, context.memory[b], context.B, context.E, space.y
    inertial, per_arm = context.settings[step_settings.INERTIAL], 1.0 / Z[step_start.ARM]
    contacts, effects, pushed, started, ended, mass = 0.0, 0.0, 0.0, 0.0, 0.0, B[b, body.MASS]
    now, last = Z[step_start.NOW] / dt, inertial * Z[step_start.LAST] / dt
    fraction, tether = Z[step_start.MASS_FRACTION], Z[step_start.TETHER_STIFFNESS]
    for k in range(3):
        theta, w = y[3 + k] * per_arm, B[b, body.SPIN + k]
        force, torque = 0.0, 0.0
        if has_effect_columns(E):
            force, torque = E[b, body_extra.EFFECT_FORCE + k], E[b, body_extra.EFFECT_TORQUE + k]
        contacts += (B[b, body.FORCE + k] - force) * y[k] + (B[b, body.TORQUE + k] - torque) * theta
        effects += force * y[k] + torque * theta
        v_0, l_0 = Z[step_start.VELOCITY + k], Z[step_start.ANGULAR_MOMENTUM + k]
        v_1, l_1 = B[b, body.VELOCITY + k], E[b, body_extra.ANGULAR_MOMENTUM + k]
        pushed += fraction * mass * (now * (v_1 - inertial * v_0) - last * T[step_memory.LAST_DV + k]) * y[k]
        pushed += fraction * (now * (l_1 - inertial * l_0) - last * T[step_memory.LAST_DL + k]) * theta
        pushed += tether * (y[k] * y[k] + y[3 + k] * y[3 + k])
        started += 0.5 * (mass * v_0 * v_0 + l_0 * Z[step_start.SPIN + k])
        ended += 0.5 * (mass * v_1 * v_1 + l_1 * w)
    return contacts, effects, pushed, started, ended


@njit(**BARE)
def curved_drag(context, b, motion, sums):
    """Return the work [J] that the curve of the plate's force over the drag adds to that of its mean in a step; keep its change.
    On rough plates the force of a rolling body turns within few steps, and the work of the mean is off by tenths of a per cent.
    The parabola through the last three forces has the integral (Adams and Moulton, third order) of the mean minus
    ratio/(6 (1 + ratio)) times the change of the force beyond `ratio` times the last one (`step_ratio`)."""
    A, T, work, ratio = context.totals[b], context.memory[b], 0.0, step_ratio(context.memory[b], context.settings, motion.dt)
    for k in range(2):
        change = -sums[0, contact_sums.UPPER_FORCE + k] - A[run_totals.UPPER_FORCE + k]
        beyond = change - ratio * T[step_memory.LAST_FORCE + k]
        work += ratio / (6.0 * (1.0 + ratio)) * beyond * motion.dt * (motion.v_x if k == 0 else motion.v_y)
        T[step_memory.LAST_FORCE + k] = change
    return work


@njit(**BARE)
def update_ledger(context, b, motion, works, common, space):
    """Add the accepted step to the energy totals of the body. `works`: energy that its contacts store more than before, and that
    their dashpots dissipate [J]. Each line is computed independently; their imbalance is the residual. The work of the forces at
    the end of the step in excess of the energy stored and dissipated by the laws, and of the kinetic energy, is the numerical
    loss. Work and impulse of the plate, friction and dashpots are those of the mean of the forces at both ends or, where forces
    jump (`weight_of_old`), of those at its end; the difference is added to the numerical loss. With a `common` plate the
    body-plate forces are internal and do no external work. Without inertia bodies and patches have no kinetic energy."""
    p, Z, T, A, P, y, dt = context.patch[b], space.start, context.memory[b], context.totals[b], context.P, space.y, motion.dt
    sums, inertial, (gained, of_dashpots) = space.sums, context.settings[step_settings.INERTIAL], works
    now, last = Z[step_start.NOW] / dt, inertial * Z[step_start.LAST] / dt
    fraction, tether = Z[step_start.MASS_FRACTION], Z[step_start.TETHER_STIFFNESS]
    contacts, effects, pushed, started, ended = body_works(context, b, dt, space)
    drag = (sums[0, contact_sums.UPPER_FORCE] * motion.v_x + sums[0, contact_sums.UPPER_FORCE + 1] * motion.v_y) * dt
    old = Z[step_start.OLD_WEIGHT]
    plate = (1.0 - old) * drag - old * (A[run_totals.UPPER_FORCE] * motion.v_x + A[run_totals.UPPER_FORCE + 1] * motion.v_y) * dt
    if has_heights(context.lower) or has_heights(context.upper):
        plate += curved_drag(context, b, motion, sums)
    A[run_totals.DRAG_WORK] += plate
    lift, patch_velocity = sums[0, contact_sums.UPPER_FORCE + 2] * y[6], P[p, patch.VELOCITY]
    damped, lost = of_dashpots, plate - drag
    if P[p, patch.FREE] != 0.0:
        spring = P[p, patch.SPRING] * (P[p, patch.HEIGHT] - Z[step_start.PLATE_HEIGHT])
        stretched = y[6] - Z[step_start.PLATE_DISPLACEMENT]
        carried = (1.0 - old) * P[p, patch.LOAD] + old * Z[step_start.PATCH_LOAD]
        plate -= carried * y[6] + (0.0 if common else spring * Z[step_start.PLATE_DISPLACEMENT])
        lost -= (carried - P[p, patch.LOAD]) * y[6]
        # by the displacement of the step: BDF2 extrapolates the velocity at its end
        dashpot_work = P[p, patch.DAMPING] * y[6] * y[6] / dt
        damped, lost = damped + dashpot_work, lost + P[p, patch.DAMPING] * patch_velocity * y[6] - dashpot_work
        change = now * (patch_velocity - inertial * Z[step_start.PATCH_VELOCITY]) - last * T[step_memory.LAST_DRISE]
        force = fraction * P[p, patch.MASS] * change
        pushed += (force + tether * y[6]) * y[6]
        started += 0.5 * P[p, patch.MASS] * Z[step_start.PATCH_VELOCITY] * Z[step_start.PATCH_VELOCITY]
        ended += 0.5 * P[p, patch.MASS] * patch_velocity * patch_velocity
        lost += 0.5 * P[p, patch.SPRING] * stretched * stretched
    elif not common:
        stored = (1.0 - old) * lift - old * A[run_totals.UPPER_FORCE + 2] * y[6]
        plate += stored
        lost += stored - lift
    friction = sums[0, contact_sums.FRICTION_WORK]
    laws = drag + lift - contacts - gained - friction - of_dashpots
    A[run_totals.NUMERICAL_LOSS] += pushed - inertial * (ended - started) + laws + lost
    A[run_totals.FRICTION_WORK] += friction
    A[run_totals.DAMPING_WORK] += damped
    A[run_totals.EFFECT_WORK] += effects
    A[run_totals.PLATE_WORK] += plate
    A[run_totals.PLATE_WORK_SIZE] += abs(plate)
    for k in range(3):
        upper, lower = -sums[0, contact_sums.UPPER_FORCE + k], -sums[0, contact_sums.LOWER_FORCE + k]
        A[run_totals.UPPER_IMPULSE + k] += dt * (old * A[run_totals.UPPER_FORCE + k] + (1.0 - old) * upper)
        A[run_totals.LOWER_IMPULSE + k] += dt * (old * A[run_totals.LOWER_FORCE + k] + (1.0 - old) * lower)
        A[run_totals.UPPER_FORCE + k], A[run_totals.LOWER_FORCE + k] = upper, lower


@njit(**BARE)
def remember_step(context, b, dt, space):
    """Store what the next step needs of this one. Where forces jump (`weight_of_old`) the next one starts anew, too, or BDF2
    would create a fifth of the energy of a ball that a plate sets rolling (`meets_again` with `coulomb`)."""
    Z, T, B, velocity = space.start, context.memory[b], context.B, context.P[context.patch[b], patch.VELOCITY]
    for k in range(FREEDOMS):
        T[step_memory.LAST_COORDINATES + k] = space.y[k]
    for k in range(3):
        momentum = context.E[b, body_extra.ANGULAR_MOMENTUM + k]
        T[step_memory.LAST_DV + k] = B[b, body.VELOCITY + k] - Z[step_start.VELOCITY + k]
        T[step_memory.LAST_DL + k] = momentum - Z[step_start.ANGULAR_MOMENTUM + k]
        T[step_memory.LAST_DW + k] = B[b, body.SPIN + k] - Z[step_start.SPIN + k]
    T[step_memory.LAST_DRISE] = velocity - Z[step_start.PATCH_VELOCITY]
    jumped = Z[step_start.OLD_WEIGHT] == 0.0 and T[step_memory.JUMPED] == 0.0
    T[step_memory.JUMPED], T[step_memory.LAST_DT] = (1.0, 0.0) if jumped else (0.0, dt)
    for s in range(context.start[b], context.start[b + 1] if context.paths.shape[0] > 0 else 0):
        S, row = context.S, context.paths[s]
        u_x, u_y, u_z = three(S, s, sphere.MID_VELOCITY)
        chord = dt * math.sqrt(u_x * u_x + u_y * u_y + u_z * u_z)
        row[sphere_path.LENGTH] += chord
        for k in range(3):
            now, moved, strayed = S[s, sphere.POSITION + k], dt * S[s, sphere.MID_VELOCITY + k], STRAYED * chord
            row[sphere_path.LOW + k] = min(row[sphere_path.LOW + k], min(now, now - moved) - strayed)
            row[sphere_path.HIGH + k] = max(row[sphere_path.HIGH + k], max(now, now - moved) + strayed)


@njit(**BARE)
def reject_step(context, b, space):
    p, Z, B, P, y = context.patch[b], space.start, context.B, context.P, space.y
    for k in range(FREEDOMS):
        y[k] = 0.0
    set_configuration(context, b, y, 1.0, space)
    for k in range(3):
        B[b, body.VELOCITY + k], B[b, body.SPIN + k] = Z[step_start.VELOCITY + k], Z[step_start.SPIN + k]
        context.E[b, body_extra.ANGULAR_MOMENTUM + k] = Z[step_start.ANGULAR_MOMENTUM + k]
    P[p, patch.HEIGHT], P[p, patch.VELOCITY] = Z[step_start.PATCH_HEIGHT], Z[step_start.PATCH_VELOCITY]
    P[p, patch.LOAD] = Z[step_start.PATCH_LOAD]
    for k in range(2):
        P[p, patch.DISPLACEMENT + k] = Z[step_start.PATCH_DISPLACEMENT + k]
    update_rough(STAGE.TRIAL, b, context)


@njit(**BARE)
def accept_step(context, b, m, motion, common, space):
    Z, T, B, E, dt = space.start, context.memory[b], context.B, context.E, motion.dt
    for k in range(contact_sums.WIDTH):
        space.sums[0, k] = 0.0
    Z[step_start.OLD_WEIGHT] = books.weight_of_old(context, b, m, dt, space)
    damped = commit(context, b, m, motion, space)
    momentum = product(inertia_of(b, E, context.orientations), three(B, b, body.SPIN))
    for k in range(3):
        E[b, body_extra.ANGULAR_MOMENTUM + k] = momentum[k]
        if has_effect_columns(E):
            B[b, body.FORCE + k] += E[b, body_extra.EFFECT_FORCE + k]
            B[b, body.TORQUE + k] += E[b, body_extra.EFFECT_TORQUE + k]
    stored = 0.0
    for e in range(context.plate_edges[b], last_candidate(b, context)):
        stored += books.stored_energy(context.plate_incidence[e] >> 1, context)
    update_ledger(context, b, motion, (stored - T[step_memory.STORED], damped), common, space)
    remember_step(context, b, dt, space)
    if has_zone(context):
        force = book_zone(b, context, motion), context.P[context.patch[b], patch.DIRECT_FRICTION]
        book_direct_contact(context.totals[b], force, motion, 0.5)
    update_rough(STAGE.ACCEPT, b, context)
    T[step_memory.STORED] = stored
    T[step_memory.MAX_ENERGY] = max(T[step_memory.MAX_ENERGY], books.total_storable_energy(m, space))
    diagnostics = space.diagnostics
    if diagnostics[step_contacts.MAX_RADIUS] > 0.0:
        T[step_memory.CONTACT_RADIUS] = T[step_memory.DRAG_RADIUS] = diagnostics[step_contacts.MAX_RADIUS]
        T[step_memory.STIFFNESS] = diagnostics[step_contacts.NORMAL_FORCE] / diagnostics[step_contacts.MAX_OVERLAP]
    if has_zone(context) and context.P[context.patch[b], patch.INSIDE] <= 0.0:
        # outside the contact of the first bodies contacts are minute, and the drag does not slide over them
        T[step_memory.DRAG_RADIUS] = math.sqrt(context.settings[step_settings.EXPECTED_OVERLAP] * Z[step_start.ARM])
