"""One step of one body between the first bodies: its formula, its length, its error, and what is kept of it."""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import INNER
from thirdbody.jit.simd import load
from thirdbody.kernels.clock import pass_time
from thirdbody.kernels.columns import (
    body,
    body_extra,
    contact_sums,
    domain,
    patch,
    record,
    run_totals,
    step_contacts,
    step_memory,
    step_settings,
    step_start,
)
from thirdbody.kernels.implicit.friction_work import energy_of_spots, weight_of_old
from thirdbody.kernels.implicit.residual import FREEDOMS, TURN, commit, momentum_of, recoil, set_configuration
from thirdbody.kernels.implicit.step_limits import ERROR, GROWTH, LARGEST, NEWTON, OUTPUT, REVERSAL
from thirdbody.kernels.labeller_input import update_body_memory
from thirdbody.kernels.narrow_phase import overlap_and_normal
from thirdbody.kernels.predicates import has_effect_columns, is_closed
from thirdbody.kernels.rigid_body import check_position, limits_of
from thirdbody.kernels.schedule import GAP, LOAD, X, Y, mean_rate, next_corner

GOING, UNSOLVED, TOO_DEEP, TOO_MANY, LEFT, NOT_A_NUMBER = range(6)
"""Codes of a body: what stopped it."""

PULL, LOOSER = 1e-8, 100.0
"""Without inertia: the pull that holds a body back as a share of its stiffness, and how much looser the tolerance is, since no
velocity is carried on."""

HARD = 4
"""A step that is cut more often than this is counted as hard."""

EASY = 8
"""Iterations up to which a step may grow."""

NEARLY = 1.0 - 1e-9


@njit(**INNER)
def next_breakpoint(t, schedule, first, until):
    """Where the stretch ends in which the motion has no corner, s."""
    end = until
    for axis in (X, Y, GAP, LOAD):
        end = min(end, next_corner(schedule, first, np.int64(axis), t))
    return end


@njit(**INNER)
def is_breakpoint(t, end, schedule, first):
    """Whether the stretch that began at t ends at a corner of the motion, and not only at a stop."""
    return next_breakpoint(t, schedule, first, np.inf) <= end


@njit(**INNER)
def plate_velocity(schedule, first, t, dt):
    """Mean sideways velocity of the upper plate over a step, m/s."""
    return mean_rate(schedule, first, np.int64(X), t, dt), mean_rate(schedule, first, np.int64(Y), t, dt)


@njit(**INNER)
def next_length(T, W, V, schedule, first, end):
    """Length of the next step, s, on a stretch that ends at `end`, and what limits it (`limits`)."""
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
    # no sliver is left for the last step
    return (0.5 * left, ends) if dt > 0.5 * left else (dt, limit)


@njit(**INNER)
def bdf2_weights(dt, distance, mass, T, Z, V):
    """Choose the formula of a step of length dt: BDF2 for unequal steps, backward Euler after a corner or without inertia.

    `distance` is that of the drag in the step, m. Source: Curtiss and Hirschfelder 1952; unequal steps: Hairer, Norsett and
    Wanner,
    Solving Ordinary Differential Equations I, III.5.
    """
    inertial = V[step_settings.INERTIAL]
    Z[step_start.PULL], Z[step_start.MASS_SHARE] = 0.0, 1.0
    if inertial == 0.0:
        Z[step_start.PULL] = PULL * T[step_memory.STIFFNESS]
        longest = min(V[step_settings.LONGEST], V[step_settings.RADII] * T[step_memory.CONTACT_RADIUS])
        # in a step of the longest way no more than the pull, whatever the speed; in shorter ones it grows
        Z[step_start.MASS_SHARE] = min(1.0, Z[step_start.PULL] * (longest * dt / distance) ** 2 / mass) if distance > 0.0 else 1.0
    if T[step_memory.LAST_DT] == 0.0 or inertial == 0.0:
        Z[step_start.NOW], Z[step_start.BEFORE] = 1.0, 0.0
        return
    ratio = dt / T[step_memory.LAST_DT]
    Z[step_start.NOW], Z[step_start.BEFORE] = (1.0 + 2.0 * ratio) / (1.0 + ratio), ratio * ratio / (1.0 + ratio)


@njit(**INNER)
def local_error(b, p, dt, Z, T, B, P, diagnostics, V):
    """Error of the step over what is allowed, a part of the radius of the largest contact.

    That of backward Euler is half the length of the step times the change of velocity; of BDF2, 2/9 of the length times what
    this change differs from the last one, taken in proportion (2/9 of the third derivative times dt^3 at equal steps: the same
    book, III.2).
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
    """Rotation of the step, rad."""
    return math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5]) / Z[step_start.ARM]


@njit(**INNER)
def gaps(b, spots, state, before):
    """Overlaps of the slots of body b as the step begins: one that is negative then closes within the step, if at all."""
    (own, partner, _, edges, incidence), S, P = spots, state[0], state[2]
    for e in range(edges[b], edges[b + 1]):
        before[e - edges[b]] = overlap_and_normal(incidence[e] >> 1, own, partner, S, P, 0.0, 0.0)[0]


@njit(**INNER)
def predict(p, y, dt, Z, P, rise):
    """A first guess of the coordinates of a step: going on as before, and by `rise` where the height is prescribed."""
    for k in range(3):
        y[k], y[3 + k] = Z[step_start.VELOCITY + k] * dt, Z[step_start.SPIN + k] * Z[step_start.ARM] * dt
    y[6] = Z[step_start.PATCH_VELOCITY] * dt if P[p, patch.FREE] != 0.0 else rise


@njit(**INNER)
def elastic_energy(b, spots, H, R):
    """Elastic energy of the loaded spots of body b, J."""
    edges, incidence = spots[3], spots[4]
    total = 0.0
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if is_closed(k, H):
            total += R[k, record.STORED_NORMAL] + R[k, record.STORED_TANGENTIAL]
    return total


@njit(**INNER)
def add_impulses(W, sums, old, dt):
    """Add the impulses of a step on both plates to the totals, with the share `old` of the last forces; keep the new ones."""
    for k in range(3):
        upper, lower = -sums[0, contact_sums.UPPER_FORCE + k], -sums[0, contact_sums.LOWER_FORCE + k]
        W[run_totals.UPPER_IMPULSE + k] += dt * (old * W[run_totals.UPPER_FORCE + k] + (1.0 - old) * upper)
        W[run_totals.LOWER_IMPULSE + k] += dt * (old * W[run_totals.LOWER_FORCE + k] + (1.0 - old) * lower)
        W[run_totals.UPPER_FORCE + k], W[run_totals.LOWER_FORCE + k] = upper, lower


@njit(**INNER)
def update_ledger(b, p, y, dt, v_x, v_y, diagnostics, sums, gained, Z, T, B, E, P, W, inertial, hub):
    """Add the accepted step to the totals of body b. Every line is computed by itself; their balance is the residual.

    The method works with the forces at the end of the step: what they do beyond the energy that laws store and lose, and beyond
    the kinetic energy, is the integrator's own loss. The plate's work and its impulse are taken with the mean of the forces at
    both ends of the step, or, where forces jump (`weight_of_old`), with those at its end, as that of friction is (`commit`);
    how much this work differs from that of the method goes to the same line. What bodies and a common plate of their
    own (`hub`) do to each other is nobody's work. Without inertia bodies and patches have no kinetic energy.
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
    """The clock of a body after a step of length dt; `whole`: it ends the stretch, at the time `end` to the last bit."""
    pass_time(W, dt, v_x, v_y)
    if whole:
        W[run_totals.TIME] = end


@njit(**INNER)
def update_labeller(b, spots, state, M, W, known, drag, observe, seen, table):
    """Let the labeller observe body b after its step."""
    (own, partner, _, edges, incidence), (_, B, _, H, R, E) = spots, state
    update_body_memory(
        b, edges, incidence, own, partner, H, R, B, E, W, M, drag, W[run_totals.PLATE_SPEED], known[2], known[4], observe, seen,
        table,
    )  # fmt: skip
    W[run_totals.ELAPSED], W[run_totals.SHIFT_X], W[run_totals.SHIFT_Y] = 0.0, 0.0, 0.0


@njit(**INNER)
def store_step(b, p, y, dt, Z, T, B, E, P):
    """Keep of an accepted step what the next one needs."""
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
    """Put body b back to where its step began."""
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
    """Make the step of body b, as it is staged, part of its past."""
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
    """By what factor a step that was no good is cut."""
    if not result:
        return 0.5
    from_turn = 0.9 * TURN / max(turn, 1e-30)
    return max(0.1, min(0.7, 0.9 / math.sqrt(max(error, 1e-30)), from_turn))


@njit(**INNER)
def next_dt(T, W, V, dt, requested_dt, error, iterations, cuts, limit):
    """Choose the length to try next, and count; `limit`: what limited this step."""
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
    # a step that was short only because a stretch ended tells nothing
    T[step_memory.NEXT_DT] = max(dt * grown, requested_dt) if cuts == 0 and grown >= 1.0 else dt * grown


@njit(**INNER)
def guard_code(b, diagnostics, B, D):
    """(code, slot) of the guard that body b trips after a step."""
    bad, out = check_position(b, load(B, b, body.POSITION), 0.0, limits_of(D), np.int64(0), np.int64(0))
    if bad > 0:
        return NOT_A_NUMBER, -1.0
    if diagnostics[step_contacts.MAX_RATIO] > D[domain.OVERLAP_GUARD]:
        return TOO_DEEP, diagnostics[step_contacts.SLOT]
    if out > 0:
        return LEFT, -1.0
    return GOING, -1.0
