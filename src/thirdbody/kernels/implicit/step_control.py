"""Step control of the implicit integrator: BDF2 weights, length, error, acceptance, energy."""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import INNER
from thirdbody.jit.simd import load
from thirdbody.kernels import first_body
from thirdbody.kernels.clock import pass_time
from thirdbody.kernels.columns import (
    body,
    body_extra,
    contact_sums,
    domain,
    patch,
    record,
    run_totals,
    sphere,
    step_contacts,
    step_memory,
    step_settings,
    step_start,
)
from thirdbody.kernels.implicit.friction_work import energy_of_spots, weight_of_old
from thirdbody.kernels.implicit.residual import FREEDOMS, TURN, commit, momentum_of, recoil, set_configuration
from thirdbody.kernels.implicit.step_limits import ERROR, GROWTH, LARGEST, NEWTON, OUTPUT, REVERSAL
from thirdbody.kernels.labeller_input import Observed, update_body_memory
from thirdbody.kernels.predicates import has_effect_columns, is_closed
from thirdbody.kernels.rigid_body import check_position, limits_of
from thirdbody.kernels.schedule import GAP, LOAD, X, Y, mean_rate, next_corner

GOING, UNSOLVED, TOO_DEEP, TOO_MANY, LEFT, NOT_A_NUMBER = range(6)
"""Codes of a body: running, or the reason why it stopped."""

PULL, LOOSER = 1e-8, 100.0
"""Without inertia: stiffness of the spring to the start position over that of the body, and factor of the tolerance, which may be
looser because no velocity is carried over."""

HARD = 4
"""A step rejected more often than this counts as hard."""

EASY = 8
"""Largest number of iterations after which the step may grow."""

NEARLY = 1.0 - 1e-9
"""A step of this fraction of the remaining interval covers all of it."""


@njit(**INNER)
def next_breakpoint(t, schedule, first, until):
    """Return the time [s] of the next breakpoint of the motion after t, at most `until`."""
    end = until
    for axis in (X, Y, GAP, LOAD):
        end = min(end, next_corner(schedule, first, np.int64(axis), t))
    return end


@njit(**INNER)
def is_breakpoint(t, end, schedule, first):
    """Return whether the interval from t to `end` ends at a breakpoint, and not only at a stop."""
    return next_breakpoint(t, schedule, first, np.inf) <= end


@njit(**INNER)
def plate_velocity(schedule, first, t, dt):
    """Return the mean lateral velocity (v_x, v_y) [m/s] of the upper plate over a step."""
    return mean_rate(schedule, first, np.int64(X), t, dt), mean_rate(schedule, first, np.int64(Y), t, dt)


@njit(**INNER)
def next_length(T, W, V, schedule, first, end):
    """Return length [s] and limiting cause (`step_limits`) of the next step, at most to `end` [s]."""
    t = W[run_totals.TIME]
    left = end - t
    dt, limit = min(T[step_memory.NEXT_DT], left), np.int64(T[step_memory.LIMIT])
    ends = np.int64(REVERSAL if is_breakpoint(t, end, schedule, first) else OUTPUT)
    longest = min(V[step_settings.LONGEST], V[step_settings.RADII] * T[step_memory.CONTACT_RADIUS])
    for _ in range(3):
        v_x, v_y = plate_velocity(schedule, first, t, dt)
        distance = math.sqrt(v_x * v_x + v_y * v_y) * dt
        if distance > longest:
            dt *= longest / distance
            limit = np.int64(LARGEST)
    if dt >= NEARLY * left:
        return left, ends
    # two equal steps rather than a tiny last one
    return (0.5 * left, ends) if dt > 0.5 * left else (dt, limit)


@njit(**INNER)
def bdf2_weights(dt, distance, mass, T, Z, V):
    """Set the weights: BDF2 for unequal steps; backward Euler after a breakpoint or without inertia.

    `distance`: drag in the step [m]. Sources: Curtiss and Hirschfelder 1952; unequal steps: Hairer, Norsett and Wanner, Solving
    Ordinary Differential Equations I, III.5.
    """
    inertial = V[step_settings.INERTIAL]
    Z[step_start.PULL], Z[step_start.MASS_SHARE] = 0.0, 1.0
    if inertial == 0.0:
        Z[step_start.PULL] = PULL * T[step_memory.STIFFNESS]
        longest = min(V[step_settings.LONGEST], V[step_settings.RADII] * T[step_memory.CONTACT_RADIUS])
        # at any speed of drag inertia resists no more than the spring (PULL) in the longest step, and more in shorter ones
        Z[step_start.MASS_SHARE] = min(1.0, Z[step_start.PULL] * (longest * dt / distance) ** 2 / mass) if distance > 0.0 else 1.0
    if T[step_memory.LAST_DT] == 0.0 or inertial == 0.0:
        Z[step_start.NOW], Z[step_start.BEFORE] = 1.0, 0.0
        return
    ratio = dt / T[step_memory.LAST_DT]
    Z[step_start.NOW], Z[step_start.BEFORE] = (1.0 + 2.0 * ratio) / (1.0 + ratio), ratio * ratio / (1.0 + ratio)


@njit(**INNER)
def local_error(b, p, dt, Z, T, B, P, diagnostics, V):
    """Return the local error of the step over the tolerance.

    The tolerance is a fraction of the radius of the largest contact. Backward Euler: half the step length times the change of
    velocity. BDF2: 2/9 of the step length times the difference between this change and the last one scaled by the ratio of steps
    (at equal steps 2/9 of the third derivative times dt^3: Hairer, Norsett and Wanner, III.2).
    """
    first = T[step_memory.LAST_DT] == 0.0 or V[step_settings.INERTIAL] == 0.0
    ratio = 0.0 if first else dt / T[step_memory.LAST_DT]
    move, rotation = 0.0, 0.0
    for k in range(3):
        move += (B[b, body.VELOCITY + k] - Z[step_start.VELOCITY + k] - ratio * T[step_memory.LAST_DV + k]) ** 2
        rotation += (B[b, body.SPIN + k] - Z[step_start.SPIN + k] - ratio * T[step_memory.LAST_DW + k]) ** 2
    change = max(
        math.sqrt(move),
        math.sqrt(rotation) * Z[step_start.ARM],
        abs(P[p, patch.VELOCITY] - Z[step_start.PATCH_VELOCITY] - ratio * T[step_memory.LAST_DRISE]),
    )
    fraction = 0.5 if first else 2.0 / 9.0
    allowed = V[step_settings.TOLERANCE] if V[step_settings.INERTIAL] != 0.0 else min(1.0, LOOSER * V[step_settings.TOLERANCE])
    return fraction * dt * change / (allowed * max(diagnostics[step_contacts.MAX_RADIUS], T[step_memory.CONTACT_RADIUS]))


@njit(**INNER)
def rotation_of(y, Z):
    """Return the rotation in the step [rad]."""
    return math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5]) / Z[step_start.ARM]


@njit(**INNER)
def gaps(b, spots, state, before):
    """Write the overlaps [m] of body b's candidates at the start of the step; negative: a gap."""
    (own, partner, _, edges, incidence), S, P = spots, state[0], state[2]
    for e in range(edges[b], edges[b + 1]):
        i, j = own[incidence[e] >> 1], partner[incidence[e] >> 1]
        before[e - edges[b]] = first_body.overlap(j, first_body.centre(i, S), S[i, sphere.RADIUS], P)


@njit(**INNER)
def predict(p, y, dt, Z, P, rise):
    """Predict the coordinates y at constant velocity, and a prescribed patch by `rise` [m]."""
    for k in range(3):
        y[k], y[3 + k] = Z[step_start.VELOCITY + k] * dt, Z[step_start.SPIN + k] * Z[step_start.ARM] * dt
    y[6] = Z[step_start.PATCH_VELOCITY] * dt if P[p, patch.FREE] != 0.0 else rise


@njit(**INNER)
def elastic_energy(b, spots, H, R):
    """Return the elastic energy [J] of the contacts of body b."""
    edges, incidence = spots[3], spots[4]
    total = 0.0
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if is_closed(k, H):
            total += R[k, record.STORED_NORMAL] + R[k, record.STORED_TANGENTIAL]
    return total


@njit(**INNER)
def add_impulses(W, sums, old, dt):
    """Add the impulses on both plates, with weight `old` of the last forces; store the new forces."""
    for k in range(3):
        upper, lower = -sums[0, contact_sums.UPPER_FORCE + k], -sums[0, contact_sums.LOWER_FORCE + k]
        W[run_totals.UPPER_IMPULSE + k] += dt * (old * W[run_totals.UPPER_FORCE + k] + (1.0 - old) * upper)
        W[run_totals.LOWER_IMPULSE + k] += dt * (old * W[run_totals.LOWER_FORCE + k] + (1.0 - old) * lower)
        W[run_totals.UPPER_FORCE + k], W[run_totals.LOWER_FORCE + k] = upper, lower


@njit(**INNER)
def update_ledger(b, p, y, dt, v_x, v_y, diagnostics, sums, gained, Z, T, B, E, P, W, inertial, hub):
    """Add the accepted step to the energy totals of body b.

    Each line is computed independently; their imbalance is the residual. The method uses the forces at the end of the step: their
    work in excess of the energy stored and dissipated by the laws, and of the kinetic energy, is the numerical loss. The plate's
    work and impulse use the mean of the forces at both ends of the step or, where forces jump (`weight_of_old`), those at its
    end, as does friction (`commit`); the difference from the work of the method is added to the numerical loss. With a common
    plate (`hub`) the body-plate forces are internal and do no external work. Without inertia bodies and patches have no kinetic
    energy.
    """
    arm = 1.0 / Z[step_start.ARM]
    contacts, effects, before, after, pushed = 0.0, 0.0, 0.0, 0.0, 0.0
    mass, now, last = B[b, body.MASS], Z[step_start.NOW] / dt, inertial * Z[step_start.BEFORE] / dt
    share, pull = Z[step_start.MASS_SHARE], Z[step_start.PULL]
    for k in range(3):
        theta, w = y[3 + k] * arm, B[b, body.SPIN + k]
        force, torque = (
            (E[b, body_extra.EFFECT_FORCE + k], E[b, body_extra.EFFECT_TORQUE + k]) if has_effect_columns(E) else (0.0, 0.0)
        )
        contacts += (B[b, body.FORCE + k] - force) * y[k] + (B[b, body.TORQUE + k] - torque) * theta
        effects += force * y[k] + torque * theta
        v_0, l_0 = Z[step_start.VELOCITY + k], Z[step_start.ANGULAR_MOMENTUM + k]
        v_1, l_1 = B[b, body.VELOCITY + k], E[b, body_extra.ANGULAR_MOMENTUM + k]
        pushed += share * mass * (now * (v_1 - inertial * v_0) - last * T[step_memory.LAST_DV + k]) * y[k]
        pushed += share * (now * (l_1 - inertial * l_0) - last * T[step_memory.LAST_DL + k]) * theta
        pushed += pull * (y[k] * y[k] + y[3 + k] * y[3 + k])
        before += 0.5 * (mass * v_0 * v_0 + l_0 * Z[step_start.SPIN + k])
        after += 0.5 * (mass * v_1 * v_1 + l_1 * w)
    drag = (sums[0, contact_sums.UPPER_FORCE] * v_x + sums[0, contact_sums.UPPER_FORCE + 1] * v_y) * dt
    old = Z[step_start.OLD_WEIGHT]
    plate = (1.0 - old) * drag - old * (W[run_totals.UPPER_FORCE] * v_x + W[run_totals.UPPER_FORCE + 1] * v_y) * dt
    lift, rise = sums[0, contact_sums.UPPER_FORCE + 2] * y[6], P[p, patch.VELOCITY]
    damped, lost = diagnostics[step_contacts.DASHPOT_POWER] * dt, plate - drag
    if P[p, patch.FREE] != 0.0:
        spring = P[p, patch.SPRING] * (P[p, patch.HEIGHT] - Z[step_start.PLATE_HEIGHT])
        stretched = y[6] - Z[step_start.PLATE_RISE]
        carried = (1.0 - old) * P[p, patch.LOAD] + old * Z[step_start.PATCH_LOAD]
        plate -= carried * y[6] + (0.0 if hub else spring * Z[step_start.PLATE_RISE])
        lost -= (carried - P[p, patch.LOAD]) * y[6]
        felt = P[p, patch.DAMPING] * rise * y[6]
        damped, lost = damped + max(felt, 0.0), lost + min(felt, 0.0)
        force = (
            share * P[p, patch.MASS] * (now * (rise - inertial * Z[step_start.PATCH_VELOCITY]) - last * T[step_memory.LAST_DRISE])
        )
        pushed += (force + pull * y[6]) * y[6]
        before += 0.5 * P[p, patch.MASS] * Z[step_start.PATCH_VELOCITY] * Z[step_start.PATCH_VELOCITY]
        after += 0.5 * P[p, patch.MASS] * rise * rise
        lost += 0.5 * P[p, patch.SPRING] * stretched * stretched
    elif not hub:
        held = (1.0 - old) * lift - old * W[run_totals.UPPER_FORCE + 2] * y[6]
        plate += held
        lost += held - lift
    laws = drag + lift - contacts - gained - sums[0, contact_sums.FRICTION_WORK] - diagnostics[step_contacts.DASHPOT_POWER] * dt
    W[run_totals.NUMERICAL_LOSS] += pushed - inertial * (after - before) + laws + lost
    W[run_totals.FRICTION_WORK] += sums[0, contact_sums.FRICTION_WORK]
    W[run_totals.DAMPING_WORK] += damped
    W[run_totals.EFFECT_WORK] += effects
    W[run_totals.PLATE_WORK] += plate
    W[run_totals.PLATE_WORK_SIZE] += abs(plate)
    add_impulses(W, sums, old, dt)


@njit(**INNER)
def advance_clock(W, dt, end, whole, v_x, v_y):
    """Advance the clock of a body by a step of length dt [s]; `whole`: to exactly `end` [s]."""
    pass_time(W, dt, v_x, v_y)
    if whole:
        W[run_totals.TIME] = end


@njit(**INNER)
def update_labeller(b, spots, state, M, W, known, drag, observe, seen, table):
    """Update the labeller's memory of body b after its step."""
    (own, partner, _, edges, incidence), (_, B, _, H, R, E) = spots, state
    context = Observed(own, partner, edges, incidence, B, E, H, R, M, drag, known[2], known[4])
    update_body_memory(b, context, W, observe, seen, table)
    W[run_totals.ELAPSED], W[run_totals.SHIFT_X], W[run_totals.SHIFT_Y] = 0.0, 0.0, 0.0


@njit(**INNER)
def store_step(b, p, y, dt, Z, T, B, E, P):
    """Store the data of an accepted step that the next one needs."""
    for k in range(FREEDOMS):
        T[step_memory.LAST_COORDINATES + k] = y[k]
    for k in range(3):
        T[step_memory.LAST_DV + k] = B[b, body.VELOCITY + k] - Z[step_start.VELOCITY + k]
        T[step_memory.LAST_DL + k] = E[b, body_extra.ANGULAR_MOMENTUM + k] - Z[step_start.ANGULAR_MOMENTUM + k]
        T[step_memory.LAST_DW + k] = B[b, body.SPIN + k] - Z[step_start.SPIN + k]
    T[step_memory.LAST_DRISE], T[step_memory.LAST_DT] = P[p, patch.VELOCITY] - Z[step_start.PATCH_VELOCITY], dt
    T[step_memory.PATH] += math.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]) + math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5])


@njit(**INNER)
def reject_step(b, p, Z, T, shape, state):
    """Restore body b and patch p to the start of the step."""
    B, P, E = state[1], state[2], state[5]
    still = np.zeros(FREEDOMS)
    set_configuration(b, p, still, 1.0, Z, T, shape, state)
    for k in range(3):
        B[b, body.VELOCITY + k] = Z[step_start.VELOCITY + k]
        B[b, body.SPIN + k] = Z[step_start.SPIN + k]
        E[b, body_extra.ANGULAR_MOMENTUM + k] = Z[step_start.ANGULAR_MOMENTUM + k]
    P[p, patch.HEIGHT] = Z[step_start.PATCH_HEIGHT]
    P[p, patch.VELOCITY] = Z[step_start.PATCH_VELOCITY]
    P[p, patch.LOAD] = Z[step_start.PATCH_LOAD]


@njit(**INNER)
def accept_step(b, p, m, y, dt, v_x, v_y, spots, state, known, work, Z, T, W, V, hub):
    """Accept the step of body b: store history, records, energy totals and step data."""
    (_, B, P, H, R, E), diagnostics, sums = state, work[11], work[12]
    for k in range(contact_sums.WIDTH):
        sums[0, k] = 0.0
    diagnostics[step_contacts.DASHPOT_POWER] += recoil(b, m, dt, spots, state, work) / dt
    Z[step_start.OLD_WEIGHT] = weight_of_old(m, dt, T[step_memory.LAST_DT], diagnostics[step_contacts.DASHPOT_POWER], work)
    commit(b, m, dt, v_x, v_y, spots, state, known, work, Z, sums)
    E[b, body_extra.ANGULAR_MOMENTUM], E[b, body_extra.ANGULAR_MOMENTUM + 1], E[b, body_extra.ANGULAR_MOMENTUM + 2] = momentum_of(
        b, B, E
    )
    for k in range(3 if has_effect_columns(E) else 0):
        B[b, body.FORCE + k] += E[b, body_extra.EFFECT_FORCE + k]
        B[b, body.TORQUE + k] += E[b, body_extra.EFFECT_TORQUE + k]
    stored = elastic_energy(b, spots, H, R)
    update_ledger(
        b, p, y, dt, v_x, v_y, diagnostics, sums, stored - T[step_memory.STORED], Z, T, B, E, P, W, V[step_settings.INERTIAL], hub
    )
    store_step(b, p, y, dt, Z, T, B, E, P)
    T[step_memory.STORED] = stored
    T[step_memory.MAX_ENERGY] = max(T[step_memory.MAX_ENERGY], energy_of_spots(m, work[0], work[1]))
    if diagnostics[step_contacts.MAX_RADIUS] > 0.0:
        T[step_memory.CONTACT_RADIUS] = diagnostics[step_contacts.MAX_RADIUS]
        T[step_memory.STIFFNESS] = diagnostics[step_contacts.NORMAL_FORCE] / diagnostics[step_contacts.MAX_OVERLAP]


@njit(**INNER)
def reduction_factor(result, error, turn):
    """Return the factor that shortens a rejected step; `result`: Newton's method converged."""
    if not result:
        return 0.5
    from_turn = 0.9 * TURN / max(turn, 1e-30)
    return max(0.1, min(0.7, 0.9 / math.sqrt(max(error, 1e-30)), from_turn))


@njit(**INNER)
def next_dt(T, W, V, dt, requested_dt, error, iterations, cuts, limit):
    """Set the length of the next step; update the counters; `limit`: cause that limited this one."""
    T[step_memory.LIMITED + limit] += 1.0
    T[step_memory.CUTS] += cuts
    T[step_memory.HARD_STEPS] += 1.0 if cuts > HARD else 0.0
    T[step_memory.LONGEST_DRAG] = max(T[step_memory.LONGEST_DRAG], W[run_totals.PLATE_SPEED] * dt)
    grown = min(V[step_settings.GROWTH], 0.9 / math.sqrt(max(error, 1e-30)))
    if iterations > EASY or cuts > 0:
        grown = min(grown, 1.0)
    if cuts > 0:
        T[step_memory.LIMIT] = limit
    elif grown < 1.0:
        T[step_memory.LIMIT] = ERROR
    elif dt * grown >= requested_dt:
        T[step_memory.LIMIT] = NEWTON if iterations > EASY else (GROWTH if grown == V[step_settings.GROWTH] else ERROR)
    # a step shortened only by the end of the interval does not reduce the next one
    T[step_memory.NEXT_DT] = max(dt * grown, requested_dt) if cuts == 0 and grown >= 1.0 else dt * grown


@njit(**INNER)
def guard_code(b, diagnostics, B, D):
    """Return (code, candidate) of the guard that body b violates after a step; GOING if none."""
    bad, out = check_position(b, load(B, b, body.POSITION), 0.0, limits_of(D), np.int64(0), np.int64(0))
    if bad > 0:
        return NOT_A_NUMBER, -1.0
    if diagnostics[step_contacts.MAX_RATIO] > D[domain.OVERLAP_GUARD]:
        return TOO_DEEP, diagnostics[step_contacts.SLOT]
    if out > 0:
        return LEFT, -1.0
    return GOING, -1.0
