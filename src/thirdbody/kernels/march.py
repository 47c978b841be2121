"""Backward Euler, body by body: every body between the first bodies takes steps of its own to a common time.

A step is tried, cut when Newton's method or the error asks for it, and grows again. The error of a step is that of backward
Euler, half its length times the change of velocity, in parts of the radius of the largest contact; so steps are short where a
spot starts to slip or a body tips, and long where it slides or rolls on. No step passes a corner of the driven motion.
"""

import math

import numpy as np
from numba import njit, prange, types

from .bodies import outside
from .contacts import GEOMETRY, SUM_COLS, SUM_POWER, SUM_WORK, separation
from .layout import (
    A_DAMPING,
    A_DISTANCE,
    A_DX,
    A_DY,
    A_EFFECTS,
    A_ELAPSED,
    A_FRICTION,
    A_HEADING,
    A_IMPULSE,
    A_IMPULSE_LOW,
    A_LOWER,
    A_NUMERICAL,
    A_PLATE_ABS,
    A_PLATE_WORK,
    A_SPEED,
    A_STEPS,
    A_TIME,
    A_UPPER,
    B_EF,
    B_ET,
    B_F,
    B_L,
    B_LOW,
    B_MASS,
    B_T,
    B_UP,
    B_V,
    B_W,
    B_X,
    C_MEMORY,
    D_FLOOR,
    D_GUARD_OVERLAP,
    D_LX,
    D_LY,
    H_LAW,
    H_ON,
    I_HISTORY,
    J_COLS,
    K_ROLLING_COLS,
    O_COLS,
    O_HISTORY,
    P_DAMPING,
    P_FREE,
    P_LOAD,
    P_MASS,
    P_SPRING,
    P_V,
    P_Z,
    Q_COLS,
    R_STORED_N,
    R_STORED_T,
    T_CODE,
    T_CUTS,
    T_DL,
    T_DRISE,
    T_DT,
    T_DV,
    T_DW,
    T_HARD,
    T_ITERATIONS,
    T_LAST,
    T_LONGEST,
    T_RADIUS,
    T_SLOT,
    T_STORED,
    T_TRIES,
    T_Y,
    TILE,
)  # fmt: skip
from .motion import GAP, X, Y, mean_rate, next_corner, value
from .newton import CROWDED, FOUND, TURN, newton
from .observe import body_contacts, body_row
from .options import CHUNK, INNER, OPTIONS
from .signatures import EFFECTS, LAW, OBSERVE
from .trial import (
    E_COLS,
    E_POWER,
    E_RADIUS,
    E_RATIO,
    E_SLOT,
    FREEDOMS,
    Z_ARM,
    Z_BEFORE,
    Z_COLS,
    Z_L,
    Z_NOW,
    Z_PATCH,
    Z_PLATE,
    Z_RISE,
    Z_V,
    Z_W,
    accept,
    begin,
    place,
)

BODIES = 8
"""Bodies per chunk: one workspace each, small enough to share the work of a few bodies among cores."""

GOING, UNSOLVED, TOO_DEEP, TOO_MANY, LEFT, NOT_A_NUMBER = range(6)
"""Codes of a body: what stopped it."""

# V: settings of the integrator
(V_TOLERANCE, V_LONGEST, V_SHORTEST, V_INERTIAL, V_DEEP, V_GROWTH, V_RADII) = range(7)
V_COLS = 7

HARD = 4
"""A step that is cut more often than this is counted as hard."""

EASY = 8
"""Iterations up to which a step may grow."""

NEARLY = 1.0 - 1e-9


@njit(**INNER)
def next_length(T, W, V, schedule, first, until):
    """Length of the next step (s), and where the stretch ends that it lies in: at the target or a corner of the motion."""
    t = W[A_TIME]
    end = until
    for axis in (X, Y, GAP):
        end = min(end, next_corner(schedule, first, np.int64(axis), t))
    left = end - t
    dt = min(T[T_DT], left)
    for _ in range(3):
        v_x, v_y = mean_rate(schedule, first, np.int64(X), t, dt), mean_rate(schedule, first, np.int64(Y), t, dt)
        way = math.sqrt(v_x * v_x + v_y * v_y) * dt
        longest = min(V[V_LONGEST], V[V_RADII] * T[T_RADIUS])
        if way > longest:
            dt *= longest / way
    if dt >= NEARLY * left:
        return left, end
    # no sliver is left for the last step
    return (0.5 * left if dt > 0.5 * left else dt), end


@njit(**INNER)
def formula(dt, T, Z, inertial):
    """Choose the formula of a step of length dt: BDF2 for unequal steps, backward Euler after a corner or without inertia."""
    if T[T_LAST] == 0.0 or inertial == 0.0:
        Z[Z_NOW], Z[Z_BEFORE] = 1.0, 0.0
        return
    ratio = dt / T[T_LAST]
    Z[Z_NOW], Z[Z_BEFORE] = (1.0 + 2.0 * ratio) / (1.0 + ratio), ratio * ratio / (1.0 + ratio)


@njit(**INNER)
def error_of(b, p, dt, Z, T, B, P, told, V):
    """Error of the step over what is allowed, a part of the radius of the largest contact.

    That of backward Euler is half the length of the step times the change of velocity; of BDF2, 2/9 of the length times what
    this change differs from the last one, taken in proportion.
    """
    first = T[T_LAST] == 0.0 or V[V_INERTIAL] == 0.0
    ratio = 0.0 if first else dt / T[T_LAST]
    move, turn = 0.0, 0.0
    for k in range(3):
        move += (B[b, B_V + k] - Z[Z_V + k] - ratio * T[T_DV + k]) ** 2
        turn += (B[b, B_W + k] - Z[Z_W + k] - ratio * T[T_DW + k]) ** 2
    change = max(math.sqrt(move), math.sqrt(turn) * Z[Z_ARM], abs(P[p, P_V] - Z[Z_RISE] - ratio * T[T_DRISE]))
    share = 0.5 if first else 2.0 / 9.0
    return share * dt * change / (V[V_TOLERANCE] * max(told[E_RADIUS], T[T_RADIUS]))


@njit(**INNER)
def rotation_of(y, Z):
    """Rotation of the step, rad."""
    return math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5]) / Z[Z_ARM]


@njit(**INNER)
def prescribed(p, P, t, dt, schedule, first, Z, last):
    """Rise of the patch over the step if its height is prescribed; notes the height of the plate that it is sprung to."""
    if P[p, P_SPRING] != 0.0:
        Z[Z_PLATE] = P[last, P_Z]
        return 0.0
    if P[p, P_FREE] != 0.0 or first[GAP + 1] == first[GAP]:
        return 0.0
    return mean_rate(schedule, first, np.int64(GAP), t, dt) * dt


@njit(**INNER)
def stored_in(b, edges, incidence, H, R):
    """Elastic energy of the loaded spots of body b, J."""
    total = 0.0
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if H[k, H_ON] != 0.0:
            total += R[k, R_STORED_N] + R[k, R_STORED_T]
    return total


@njit(**INNER)
def account(b, p, y, dt, v_x, v_y, told, sums, gained, Z, T, B, P, W, inertial):
    """Add the accepted step to the totals of body b. Every line is computed by itself; their balance is the residual.

    The method works with the forces at the end of the step: what they do beyond the energy that laws store and lose, and beyond
    the kinetic energy, is the integrator's own loss. The plate's work is taken with the mean of the forces at both ends of the
    step, and its difference from the work that the method does goes to the same line.
    """
    arm = 1.0 / Z[Z_ARM]
    contacts, effects, moved, turned, before, after, pushed = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    mass, now, last = B[b, B_MASS], Z[Z_NOW] / dt, inertial * Z[Z_BEFORE] / dt
    for k in range(3):
        theta, w = y[3 + k] * arm, B[b, B_W + k]
        contacts += B[b, B_F + k] * y[k] + B[b, B_T + k] * theta
        effects += B[b, B_EF + k] * y[k] + B[b, B_ET + k] * theta
        pushed += mass * (now * (B[b, B_V + k] - inertial * Z[Z_V + k]) - last * T[T_DV + k]) * y[k]
        pushed += (now * (B[b, B_L + k] - inertial * Z[Z_L + k]) - last * T[T_DL + k]) * theta
        before += 0.5 * (mass * Z[Z_V + k] * Z[Z_V + k] + Z[Z_L + k] * Z[Z_W + k])
        after += 0.5 * (mass * B[b, B_V + k] * B[b, B_V + k] + B[b, B_L + k] * w)
    drag = (B[b, B_UP] * v_x + B[b, B_UP + 1] * v_y) * dt
    rise = P[p, P_V]
    lift = B[b, B_UP + 2] * y[6]
    steady = 0.5 * (drag - (W[A_UPPER] * v_x + W[A_UPPER + 1] * v_y) * dt)
    plate, damped, sprung = steady, told[E_POWER] * dt, 0.0
    if P[p, P_FREE] != 0.0:
        plate -= P[p, P_LOAD] * y[6]
        damped += P[p, P_DAMPING] * rise * y[6]
        pushed += P[p, P_MASS] * (now * (rise - inertial * Z[Z_RISE]) - last * T[T_DRISE]) * y[6]
        before += 0.5 * P[p, P_MASS] * Z[Z_RISE] * Z[Z_RISE]
        after += 0.5 * P[p, P_MASS] * rise * rise
        # the spring to a plate that stands still
        sprung = 0.5 * P[p, P_SPRING] * y[6] * y[6]
    else:
        # a plate at a prescribed height: likewise
        held = 0.5 * (lift - W[A_UPPER + 2] * y[6])
        plate += held
        sprung = held - lift
    kinetic = pushed - (after - before)
    laws = drag + lift - contacts - gained - sums[0, SUM_WORK] - told[E_POWER] * dt
    W[A_NUMERICAL] += kinetic + laws + sprung + steady - drag
    W[A_FRICTION] += sums[0, SUM_WORK]
    W[A_DAMPING] += damped
    W[A_EFFECTS] += effects
    W[A_PLATE_WORK] += plate
    W[A_PLATE_ABS] += abs(plate)
    half = 0.5 * dt
    for k in range(3):
        upper, lower = -B[b, B_UP + k], -B[b, B_LOW + k]
        W[A_IMPULSE + k] += half * (W[A_UPPER + k] + upper)
        W[A_IMPULSE_LOW + k] += half * (W[A_LOWER + k] + lower)
        W[A_UPPER + k], W[A_LOWER + k] = upper, lower


@njit(**INNER)
def advance_clock(W, dt, end, whole, v_x, v_y):
    """Time, distance and heading after a step of length dt; `whole`: it ends the stretch."""
    W[A_TIME] = end if whole else W[A_TIME] + dt
    W[A_ELAPSED] += dt
    W[A_DX] += v_x * dt
    W[A_DY] += v_y * dt
    speed = math.sqrt(v_x * v_x + v_y * v_y)
    W[A_DISTANCE] += speed * dt
    W[A_STEPS] += 1.0
    W[A_SPEED] = speed
    if speed > 0.0:
        W[A_HEADING], W[A_HEADING + 1] = v_x / speed, v_y / speed


@njit(**INNER)
def gaps(b, edges, incidence, own, partner, S, P, before):
    """Overlaps of the slots of body b as the step begins; zero for one that is loaded, for it slips all the step."""
    for e in range(edges[b], edges[b + 1]):
        before[e - edges[b]] = separation(incidence[e] >> 1, own, partner, S, P, 0.0, 0.0)[0]


@njit(**INNER)
def look(b, edges, incidence, own, partner, H, R, B, W, M, drag, n_history, width, observe, seen):
    """Let the labeller observe body b after its step."""
    C = body_contacts(b, edges, incidence, own, partner, H, R, width, H_LAW + n_history)
    body_row(b, B, W, drag, W[A_SPEED], seen)
    observe(C, C.shape[0], seen, M[b])
    n = 0
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if H[k, H_ON] != 0.0:
            for m in range(width - C_MEMORY):
                H[k, H_LAW + n_history + m] = C[n, C_MEMORY + m]
            n += 1
    W[A_ELAPSED], W[A_DX], W[A_DY] = 0.0, 0.0, 0.0


@njit(**INNER)
def guess(p, y, dt, Z, P):
    """A first guess of the coordinates of a step: going on as before."""
    for k in range(3):
        y[k], y[3 + k] = Z[Z_V + k] * dt, Z[Z_W + k] * Z[Z_ARM] * dt
    y[6] = Z[Z_RISE] * dt


@njit(**INNER)
def remember(b, p, y, dt, Z, T, B, P):
    """Keep of an accepted step what the next one needs."""
    for k in range(FREEDOMS):
        T[T_Y + k] = y[k]
    for k in range(3):
        T[T_DV + k], T[T_DL + k] = B[b, B_V + k] - Z[Z_V + k], B[b, B_L + k] - Z[Z_L + k]
        T[T_DW + k] = B[b, B_W + k] - Z[Z_W + k]
    T[T_DRISE], T[T_LAST] = P[p, P_V] - Z[Z_RISE], dt


@njit(**INNER)
def stay(b, p, Z, T, start, offsets, S, X0, B, P):
    """Put body b back to where its step began."""
    still = np.zeros(FREEDOMS)
    place(b, p, still, 1.0, Z, T, start, offsets, S, X0, B, P)
    for k in range(3):
        B[b, B_V + k], B[b, B_W + k] = Z[Z_V + k], Z[Z_W + k]
        B[b, B_L + k] = Z[Z_L + k]
    P[p, P_Z], P[p, P_V] = Z[Z_PATCH], Z[Z_RISE]


@njit(**INNER)
def stopped(b, told, B, D):
    """(code, slot) of the guard that body b trips after a step."""
    x, y, z = B[b, B_X], B[b, B_X + 1], B[b, B_X + 2]
    if not abs(x) + abs(y) + abs(z) < 1e300:
        return NOT_A_NUMBER, -1.0
    if told[E_RATIO] > D[D_GUARD_OVERLAP]:
        return TOO_DEEP, told[E_SLOT]
    if z < D[D_FLOOR] or outside(x, D[D_LX]) or outside(y, D[D_LY]):
        return LEFT, -1.0
    return GOING, -1.0


@njit(**CHUNK)
def march_chunk(low, high, until, own, partner, kind, edges, incidence, most, body, start, patch, offsets, X0, S, B, P, H, F, R,
                M, pairs, parameters, D, V, schedule, first, totals, memory, n_history, rolling, width, has_effects, labels, drag,
                law, tangents, effects, observe):  # fmt: skip
    """The bodies from low to high, one after the other, in one workspace."""
    I = np.empty((I_HISTORY + n_history + J_COLS) * TILE)  # noqa: E741
    O = np.empty((O_HISTORY + n_history + Q_COLS) * TILE)  # noqa: E741
    K, G, J = np.empty(K_ROLLING_COLS * TILE), np.empty((TILE, GEOMETRY)), np.empty((FREEDOMS, FREEDOMS))
    y, r, x, tried = np.zeros(FREEDOMS), np.zeros(FREEDOMS), np.zeros(FREEDOMS), np.zeros(FREEDOMS)
    Z, told, before, sums, seen = np.zeros(Z_COLS), np.zeros(E_COLS), np.zeros(most), np.zeros((1, SUM_COLS)), np.zeros(O_COLS)
    slots = np.zeros(TILE, np.int64)
    for b in range(low, high):
        p, T, W = patch[b], memory[b], totals[b]
        while T[T_CODE] == GOING and W[A_TIME] < until:
            begin(b, p, B, P, Z, start, offsets, S)
            gaps(b, edges, incidence, own, partner, S, P, before)
            dt, end = next_length(T, W, V, schedule, first, until)
            asked, cuts = T[T_DT], 0
            while True:
                time = W[A_TIME]
                whole = dt >= NEARLY * (end - time)
                dt = end - time if whole else dt
                v_x, v_y = mean_rate(schedule, first, np.int64(X), time, dt), mean_rate(schedule, first, np.int64(Y), time, dt)
                formula(dt, T, Z, V[V_INERTIAL])
                guess(p, y, dt, Z, P)
                rise = prescribed(p, P, time, dt, schedule, first, Z, P.shape[0] - 1)
                if P[p, P_FREE] == 0.0:
                    y[6] = rise
                how, m, iterations = newton(
                    b, p, y, dt, V[V_DEEP] , before, edges, incidence, own, partner, kind, start, offsets, S, X0, B, P, body, H,
                    v_x, v_y, I, O, K, G, slots, Z, T, law, tangents, pairs, n_history, rolling, effects, parameters, has_effects,
                    time + dt, V[V_INERTIAL], r, x, tried, J, told)  # fmt: skip
                T[T_TRIES] += 1.0
                T[T_ITERATIONS] += iterations
                if how == CROWDED:
                    T[T_CODE] = TOO_MANY
                    break
                error, turn = error_of(b, p, dt, Z, T, B, P, told, V), rotation_of(y, Z)
                if how == FOUND and error <= 1.0 and turn <= TURN:
                    break
                cuts += 1
                share = 0.5
                if how == FOUND:
                    share = max(0.1, min(0.7, 0.9 / math.sqrt(max(error, 1e-30)), 0.9 * TURN / max(turn, 1e-30)))
                dt *= share
                if dt < V[V_SHORTEST]:
                    T[T_CODE] = UNSOLVED
                    break
            if T[T_CODE] != GOING:
                stay(b, p, Z, T, start, offsets, S, X0, B, P)
                break
            for k in range(SUM_COLS):
                sums[0, k] = 0.0
            accept(b, m, edges, incidence, own, partner, S, B, P, H, F, R, I, O, G, slots, sums, v_x, v_y, n_history, rolling)
            stored = stored_in(b, edges, incidence, H, R)
            account(b, p, y, dt, v_x, v_y, told, sums, stored - T[T_STORED], Z, T, B, P, W, V[V_INERTIAL])
            remember(b, p, y, dt, Z, T, B, P)
            T[T_STORED] = stored
            if told[E_RADIUS] > 0.0:
                T[T_RADIUS] = told[E_RADIUS]
            for k in range(3):
                B[b, B_F + k] += B[b, B_EF + k]
                B[b, B_T + k] += B[b, B_ET + k]
            advance_clock(W, dt, end, whole, v_x, v_y)
            if whole and end < until:
                T[T_LAST] = 0.0  # a corner: what was learnt before it says nothing
            T[T_CUTS] += cuts
            T[T_HARD] += 1.0 if cuts > HARD else 0.0
            T[T_LONGEST] = max(T[T_LONGEST], W[A_SPEED] * dt)
            grown = min(V[V_GROWTH], 0.9 / math.sqrt(max(error, 1e-30)))
            if iterations > EASY or cuts > 0:
                grown = min(grown, 1.0)
            # a step that was short only because a stretch ended tells nothing
            T[T_DT] = max(dt * grown, asked) if cuts == 0 and grown >= 1.0 else dt * grown
            if labels:
                look(b, edges, incidence, own, partner, H, R, B, W, M, drag, n_history, width, observe, seen)
            T[T_CODE], T[T_SLOT] = stopped(b, told, B, D)


_F2, _F1 = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C")
_I1 = types.Array(types.int64, 1, "C")
MARCH = types.void(
    types.int64, types.int64, types.float64,  # first and last body, time to reach
    _I1, _I1, _I1, _I1, _I1, types.int64,  # own, partner, kind; edges, incidence, most slots of a body
    _I1, _I1, _I1, _F2, _F2, _F2,  # body, start, patch; offsets, X0, S
    _F2, _F2, _F2, _F2, _F2, _F2,  # B, P, H, F, R, M
    _F1, _F1, _F1, _F1, _F2, _I1, _F2, _F2,  # pairs, effect parameters, D, V; schedule, first; totals, memory
    types.int64, types.int64, types.int64, types.boolean, types.boolean,  # n_history, rolling, width, has_effects, labels
    types.UniTuple(types.float64, 2),  # drag direction
    types.FunctionType(LAW), types.FunctionType(LAW), types.FunctionType(EFFECTS), types.FunctionType(OBSERVE),
)  # fmt: skip


@njit(MARCH, parallel=True, **OPTIONS)
def march(first_body, last_body, until, own, partner, kind, edges, incidence, most, body, start, patch, offsets, X0, S, B, P, H,
          F, R, M, pairs, parameters, D, V, schedule, first, totals, memory, n_history, rolling, width, has_effects, labels, drag,
          law, tangents, effects, observe):  # fmt: skip
    """Bring the bodies from `first_body` to `last_body` (excluded) to the time `until`, each by steps of its own.

    A body that was stopped carries its code in `memory` (T_CODE) and stays at the end of its last step.
    """
    chunks = (last_body - first_body + BODIES - 1) // BODIES
    for c in prange(chunks):
        low = first_body + c * BODIES
        march_chunk(low, min(low + BODIES, last_body), until, own, partner, kind, edges, incidence, most, body, start, patch,
                    offsets, X0, S, B, P, H, F, R, M, pairs, parameters, D, V, schedule, first, totals, memory, n_history, rolling,
                    width, has_effects, labels, drag, law, tangents, effects, observe)  # fmt: skip
