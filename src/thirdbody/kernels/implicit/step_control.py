"""One step of one body between the first bodies: its formula, its length, its error, and what is kept of it."""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import INNER
from thirdbody.jit.simd import load
from thirdbody.kernels.clock import pass_time
from thirdbody.kernels.explicit.contact_forces import SUM_COLS, SUM_LOW, SUM_UP, SUM_WORK
from thirdbody.kernels.implicit.friction_work import energy_of_spots, weight_of_old
from thirdbody.kernels.implicit.residual import (
    E_DEEPEST,
    E_NORMAL,
    E_POWER,
    E_RADIUS,
    E_RATIO,
    E_SLOT,
    FREEDOMS,
    TURN,
    Z_ARM,
    Z_BEFORE,
    Z_L,
    Z_LOAD,
    Z_MASS,
    Z_NOW,
    Z_OLD,
    Z_PATCH,
    Z_PLATE,
    Z_PLATE_RISE,
    Z_PULL,
    Z_RISE,
    Z_V,
    Z_W,
    commit,
    momentum_of,
    recoil,
    set_configuration,
)
from thirdbody.kernels.implicit.step_limits import ERROR, GROWTH, LARGEST, NEWTON, OUTPUT, REVERSAL
from thirdbody.kernels.labeller_input import update_body_memory
from thirdbody.kernels.layout import (
    A_DAMPING,
    A_DX,
    A_DY,
    A_EFFECTS,
    A_ELAPSED,
    A_FRICTION,
    A_IMPULSE,
    A_IMPULSE_LOW,
    A_LOWER,
    A_NUMERICAL,
    A_PLATE_ABS,
    A_PLATE_WORK,
    A_SPEED,
    A_TIME,
    A_UPPER,
    B_F,
    B_MASS,
    B_T,
    B_V,
    B_W,
    B_X,
    D_GUARD_OVERLAP,
    E_EF,
    E_ET,
    E_L,
    H_ON,
    P_DAMPING,
    P_FREE,
    P_LOAD,
    P_MASS,
    P_SPRING,
    P_V,
    P_Z,
    R_STORED_N,
    R_STORED_T,
    T_CUTS,
    T_DL,
    T_DRISE,
    T_DT,
    T_DV,
    T_DW,
    T_ENERGY,
    T_FIRM,
    T_HARD,
    T_LAST,
    T_LIMIT,
    T_LIMITED,
    T_LONGEST,
    T_RADIUS,
    T_STORED,
    T_WAY,
    T_Y,
)
from thirdbody.kernels.narrow_phase import overlap_and_normal
from thirdbody.kernels.rigid_body import check_position, limits_of
from thirdbody.kernels.schedule import GAP, LOAD, X, Y, mean_rate, next_corner

GOING, UNSOLVED, TOO_DEEP, TOO_MANY, LEFT, NOT_A_NUMBER = range(6)
"""Codes of a body: what stopped it."""

# V: settings of the integrator
(V_TOLERANCE, V_LONGEST, V_SHORTEST, V_INERTIAL, V_DEEP, V_GROWTH, V_RADII, V_WORK) = range(8)
V_COLS = 8

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
    t = W[A_TIME]
    left = end - t
    dt, limit = min(T[T_DT], left), np.int64(T[T_LIMIT])
    ends = np.int64(REVERSAL if is_breakpoint(t, end, schedule, first) else OUTPUT)
    longest = min(V[V_LONGEST], V[V_RADII] * T[T_RADIUS])
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
    inertial = V[V_INERTIAL]
    Z[Z_PULL], Z[Z_MASS] = 0.0, 1.0
    if inertial == 0.0:
        Z[Z_PULL] = PULL * T[T_FIRM]
        longest = min(V[V_LONGEST], V[V_RADII] * T[T_RADIUS])
        # in a step of the longest way no more than the pull, whatever the speed; in shorter ones it grows
        Z[Z_MASS] = min(1.0, Z[Z_PULL] * (longest * dt / distance) ** 2 / mass) if distance > 0.0 else 1.0
    if T[T_LAST] == 0.0 or inertial == 0.0:
        Z[Z_NOW], Z[Z_BEFORE] = 1.0, 0.0
        return
    ratio = dt / T[T_LAST]
    Z[Z_NOW], Z[Z_BEFORE] = (1.0 + 2.0 * ratio) / (1.0 + ratio), ratio * ratio / (1.0 + ratio)


@njit(**INNER)
def local_error(b, p, dt, Z, T, B, P, diagnostics, V):
    """Error of the step over what is allowed, a part of the radius of the largest contact.

    That of backward Euler is half the length of the step times the change of velocity; of BDF2, 2/9 of the length times what
    this change differs from the last one, taken in proportion (2/9 of the third derivative times dt^3 at equal steps: the same
    book, III.2).
    """
    first = T[T_LAST] == 0.0 or V[V_INERTIAL] == 0.0
    ratio = 0.0 if first else dt / T[T_LAST]
    move, rotation = 0.0, 0.0
    for k in range(3):
        move += (B[b, B_V + k] - Z[Z_V + k] - ratio * T[T_DV + k]) ** 2
        rotation += (B[b, B_W + k] - Z[Z_W + k] - ratio * T[T_DW + k]) ** 2
    change = max(math.sqrt(move), math.sqrt(rotation) * Z[Z_ARM], abs(P[p, P_V] - Z[Z_RISE] - ratio * T[T_DRISE]))
    fraction = 0.5 if first else 2.0 / 9.0
    allowed = V[V_TOLERANCE] if V[V_INERTIAL] != 0.0 else min(1.0, LOOSER * V[V_TOLERANCE])
    return fraction * dt * change / (allowed * max(diagnostics[E_RADIUS], T[T_RADIUS]))


@njit(**INNER)
def rotation_of(y, Z):
    """Rotation of the step, rad."""
    return math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5]) / Z[Z_ARM]


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
        y[k], y[3 + k] = Z[Z_V + k] * dt, Z[Z_W + k] * Z[Z_ARM] * dt
    y[6] = Z[Z_RISE] * dt if P[p, P_FREE] != 0.0 else rise


@njit(**INNER)
def elastic_energy(b, spots, H, R):
    """Elastic energy of the loaded spots of body b, J."""
    edges, incidence = spots[3], spots[4]
    total = 0.0
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if H[k, H_ON] != 0.0:
            total += R[k, R_STORED_N] + R[k, R_STORED_T]
    return total


@njit(**INNER)
def update_ledger(b, p, y, dt, v_x, v_y, diagnostics, sums, gained, Z, T, B, E, P, W, inertial, hub):
    """Add the accepted step to the totals of body b. Every line is computed by itself; their balance is the residual.

    The method works with the forces at the end of the step: what they do beyond the energy that laws store and lose, and beyond
    the kinetic energy, is the integrator's own loss. The plate's work and its impulse are taken with the mean of the forces at
    both ends of the step, or, where forces jump (`weight_of_old`), with those at its end, as that of friction is (`commit`);
    how much this work differs from that of the method goes to the same line. What bodies and a common plate of their
    own (`hub`) do to each other is nobody's work. Without inertia bodies and patches have no kinetic energy.
    """
    arm = 1.0 / Z[Z_ARM]
    contacts, effects, before, after, pushed = 0.0, 0.0, 0.0, 0.0, 0.0
    mass, now, last = B[b, B_MASS], Z[Z_NOW] / dt, inertial * Z[Z_BEFORE] / dt
    for k in range(3):
        theta, w = y[3 + k] * arm, B[b, B_W + k]
        force, torque = (E[b, E_EF + k], E[b, E_ET + k]) if E.shape[1] > E_EF else (0.0, 0.0)
        contacts += (B[b, B_F + k] - force) * y[k] + (B[b, B_T + k] - torque) * theta
        effects += force * y[k] + torque * theta
        pushed += Z[Z_MASS] * mass * (now * (B[b, B_V + k] - inertial * Z[Z_V + k]) - last * T[T_DV + k]) * y[k]
        pushed += Z[Z_MASS] * (now * (E[b, E_L + k] - inertial * Z[Z_L + k]) - last * T[T_DL + k]) * theta
        pushed += Z[Z_PULL] * (y[k] * y[k] + y[3 + k] * y[3 + k])
        before += 0.5 * (mass * Z[Z_V + k] * Z[Z_V + k] + Z[Z_L + k] * Z[Z_W + k])
        after += 0.5 * (mass * B[b, B_V + k] * B[b, B_V + k] + E[b, E_L + k] * w)
    drag = (sums[0, SUM_UP] * v_x + sums[0, SUM_UP + 1] * v_y) * dt
    old = Z[Z_OLD]
    plate = (1.0 - old) * drag - old * (W[A_UPPER] * v_x + W[A_UPPER + 1] * v_y) * dt
    lift, rise, damped, lost = sums[0, SUM_UP + 2] * y[6], P[p, P_V], diagnostics[E_POWER] * dt, plate - drag
    if P[p, P_FREE] != 0.0:
        spring = P[p, P_SPRING] * (P[p, P_Z] - Z[Z_PLATE])
        stretched = y[6] - Z[Z_PLATE_RISE]
        carried = (1.0 - old) * P[p, P_LOAD] + old * Z[Z_LOAD]
        plate -= carried * y[6] + (0.0 if hub else spring * Z[Z_PLATE_RISE])
        lost -= (carried - P[p, P_LOAD]) * y[6]
        felt = P[p, P_DAMPING] * rise * y[6]
        damped += max(felt, 0.0)
        lost += min(felt, 0.0)
        force = Z[Z_MASS] * P[p, P_MASS] * (now * (rise - inertial * Z[Z_RISE]) - last * T[T_DRISE])
        pushed += (force + Z[Z_PULL] * y[6]) * y[6]
        before += 0.5 * P[p, P_MASS] * Z[Z_RISE] * Z[Z_RISE]
        after += 0.5 * P[p, P_MASS] * rise * rise
        lost += 0.5 * P[p, P_SPRING] * stretched * stretched
    elif not hub:
        held = (1.0 - old) * lift - old * W[A_UPPER + 2] * y[6]
        plate += held
        lost += held - lift
    laws = drag + lift - contacts - gained - sums[0, SUM_WORK] - diagnostics[E_POWER] * dt
    W[A_NUMERICAL] += pushed - inertial * (after - before) + laws + lost
    W[A_FRICTION] += sums[0, SUM_WORK]
    W[A_DAMPING] += damped
    W[A_EFFECTS] += effects
    W[A_PLATE_WORK] += plate
    W[A_PLATE_ABS] += abs(plate)
    for k in range(3):
        upper, lower = -sums[0, SUM_UP + k], -sums[0, SUM_LOW + k]
        W[A_IMPULSE + k] += dt * (old * W[A_UPPER + k] + (1.0 - old) * upper)
        W[A_IMPULSE_LOW + k] += dt * (old * W[A_LOWER + k] + (1.0 - old) * lower)
        W[A_UPPER + k], W[A_LOWER + k] = upper, lower


@njit(**INNER)
def advance_clock(W, dt, end, whole, v_x, v_y):
    """The clock of a body after a step of length dt; `whole`: it ends the stretch, at the time `end` to the last bit."""
    pass_time(W, dt, v_x, v_y)
    if whole:
        W[A_TIME] = end


@njit(**INNER)
def update_labeller(b, spots, state, M, W, known, drag, observe, seen, table):
    """Let the labeller observe body b after its step."""
    (own, partner, _, edges, incidence), (_, B, _, H, R, E) = spots, state
    update_body_memory(
        b, edges, incidence, own, partner, H, R, B, E, W, M, drag, W[A_SPEED], known[2], known[4], observe, seen, table
    )
    W[A_ELAPSED], W[A_DX], W[A_DY] = 0.0, 0.0, 0.0


@njit(**INNER)
def store_step(b, p, y, dt, Z, T, B, E, P):
    """Keep of an accepted step what the next one needs."""
    for k in range(FREEDOMS):
        T[T_Y + k] = y[k]
    for k in range(3):
        T[T_DV + k], T[T_DL + k] = B[b, B_V + k] - Z[Z_V + k], E[b, E_L + k] - Z[Z_L + k]
        T[T_DW + k] = B[b, B_W + k] - Z[Z_W + k]
    T[T_DRISE], T[T_LAST] = P[p, P_V] - Z[Z_RISE], dt
    T[T_WAY] += math.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]) + math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5])


@njit(**INNER)
def reject_step(b, p, Z, T, shape, state):
    """Put body b back to where its step began."""
    B, P, E = state[1], state[2], state[5]
    still = np.zeros(FREEDOMS)
    set_configuration(b, p, still, 1.0, Z, T, shape, state)
    for k in range(3):
        B[b, B_V + k], B[b, B_W + k], E[b, E_L + k] = Z[Z_V + k], Z[Z_W + k], Z[Z_L + k]
    P[p, P_Z], P[p, P_V], P[p, P_LOAD] = Z[Z_PATCH], Z[Z_RISE], Z[Z_LOAD]


@njit(**INNER)
def accept_step(b, p, m, y, dt, v_x, v_y, spots, state, known, work, Z, T, W, V, hub):
    """Make the step of body b, as it is staged, part of its past."""
    (_, B, P, H, R, E), diagnostics, sums = state, work[11], work[12]
    for k in range(SUM_COLS):
        sums[0, k] = 0.0
    diagnostics[E_POWER] += recoil(b, m, dt, spots, state, work) / dt
    Z[Z_OLD] = weight_of_old(m, dt, T[T_LAST], diagnostics[E_POWER], work)
    commit(b, m, dt, v_x, v_y, spots, state, known, work, Z, sums)
    E[b, E_L], E[b, E_L + 1], E[b, E_L + 2] = momentum_of(b, B, E)
    for k in range(3 if E.shape[1] > E_EF else 0):
        B[b, B_F + k] += E[b, E_EF + k]
        B[b, B_T + k] += E[b, E_ET + k]
    stored = elastic_energy(b, spots, H, R)
    update_ledger(b, p, y, dt, v_x, v_y, diagnostics, sums, stored - T[T_STORED], Z, T, B, E, P, W, V[V_INERTIAL], hub)
    store_step(b, p, y, dt, Z, T, B, E, P)
    T[T_STORED] = stored
    T[T_ENERGY] = max(T[T_ENERGY], energy_of_spots(m, work[0], work[1]))
    if diagnostics[E_RADIUS] > 0.0:
        T[T_RADIUS], T[T_FIRM] = diagnostics[E_RADIUS], diagnostics[E_NORMAL] / diagnostics[E_DEEPEST]


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
    T[T_LIMITED + limit] += 1.0
    T[T_CUTS] += cuts
    T[T_HARD] += 1.0 if cuts > HARD else 0.0
    T[T_LONGEST] = max(T[T_LONGEST], W[A_SPEED] * dt)
    grown = min(V[V_GROWTH], 0.9 / math.sqrt(max(error, 1e-30)))
    if iterations > EASY or cuts > 0:
        grown = min(grown, 1.0)
    if cuts > 0:
        T[T_LIMIT] = limit
    elif grown < 1.0:
        T[T_LIMIT] = ERROR
    elif dt * grown >= requested_dt:
        T[T_LIMIT] = NEWTON if iterations > EASY else (GROWTH if grown == V[V_GROWTH] else ERROR)
    # a step that was short only because a stretch ended tells nothing
    T[T_DT] = max(dt * grown, requested_dt) if cuts == 0 and grown >= 1.0 else dt * grown


@njit(**INNER)
def guard_code(b, diagnostics, B, D):
    """(code, slot) of the guard that body b trips after a step."""
    bad, out = check_position(b, load(B, b, B_X), 0.0, limits_of(D), np.int64(0), np.int64(0))
    if bad > 0:
        return NOT_A_NUMBER, -1.0
    if diagnostics[E_RATIO] > D[D_GUARD_OVERLAP]:
        return TOO_DEEP, diagnostics[E_SLOT]
    if out > 0:
        return LEFT, -1.0
    return GOING, -1.0
