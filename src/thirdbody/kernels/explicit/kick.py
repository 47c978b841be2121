"""Forces that contacts of other groups exert on a body, body effects, and the closing half kick.

Dynamics of the patches of the upper plate by velocity Verlet: driven, loaded, sprung to a plate.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import broadcast, broadcast_lane, extract, flush_below, load, set4, store, with_last
from thirdbody.kernels.bodies import BODIES, NEGLIGIBLE_MOMENTUM, NEGLIGIBLE_SPEED, NEGLIGIBLE_SPIN, REMOTE, spin_body
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.explicit.tables import chunk_motion
from thirdbody.kernels.explicit.tiles import add_force, shift_of, store_forces
from thirdbody.kernels.plates import direct_force
from thirdbody.kernels.schedule import GAP, LOAD, mean_rate, value
from thirdbody.kernels.tables import body, body_extra, patch, remote_force


@njit(**BARE)
def drive_patches(P, schedule, first, t, dt):
    """Set the velocity from t to t + dt of patches or a plate of prescribed height (neither free nor sprung)."""
    if first[GAP + 1] == first[GAP]:
        return
    for p in range(P.shape[0]):
        if P[p, patch.SPRING] == 0.0 and P[p, patch.FREE] == 0.0:
            P[p, patch.VELOCITY] = mean_rate(schedule, first, np.int64(GAP), t, dt)


@njit(**BARE)
def load_patches(P, schedule, first, t):
    """Set the loads at time t where a schedule changes them."""
    if first[LOAD + 1] == first[LOAD]:
        return
    factor = value(schedule, first, np.int64(LOAD), t)
    for p in range(P.shape[0]):
        if P[p, patch.NOMINAL_LOAD] != 0.0:
            P[p, patch.LOAD] = factor * P[p, patch.NOMINAL_LOAD]


@njit(**BARE)
def drift_patches(P, dt, v_x, v_y):
    """Apply half kick and drift to the patches, which move along x and y with (v_x, v_y) [m/s].

    Returns the largest change of a height since the last search, one step ahead [m].
    """
    path = 0.0
    for p in range(P.shape[0]):
        if P[p, patch.FREE] != 0.0:
            force = P[p, patch.FORCE] - P[p, patch.LOAD] - P[p, patch.DAMPING] * P[p, patch.VELOCITY]
            P[p, patch.VELOCITY] += 0.5 * dt / P[p, patch.MASS] * force
        P[p, patch.HEIGHT] += dt * P[p, patch.VELOCITY]
        P[p, patch.DISPLACEMENT] += dt * v_x
        P[p, patch.DISPLACEMENT + 1] += dt * v_y
        path = max(path, abs(P[p, patch.HEIGHT] - P[p, patch.SEARCH_HEIGHT]) + dt * abs(P[p, patch.VELOCITY]))
    return path


@njit(**BARE)
def press_patches(P, E, patch_of, push):
    """Sum the upward forces on patches and plate, in the order of bodies and patches: of debris, direct contact, springs.

    `push`: force of all debris, sufficient for a single patch [N].
    """
    plate = P.shape[0] - 1
    if plate == 0:
        P[0, patch.FORCE] = push + direct_force(P, np.int64(0))
        return
    for p in range(plate):
        P[p, patch.FORCE] = 0.0
    P[plate, patch.FORCE] = direct_force(P, plate)
    for b in range(E.shape[0]):
        P[patch_of[b], patch.FORCE] -= E[b, body_extra.UPPER_PUSH]
    for p in range(plate):
        spring = P[p, patch.SPRING] * (P[p, patch.HEIGHT] - P[plate, patch.HEIGHT])
        P[p, patch.FORCE] -= spring
        P[plate, patch.FORCE] += spring


@njit(**BARE)
def kick_patches(P, E, patch_of, push, dt):
    """Apply the closing half kick, implicit in the dashpots: no overshoot."""
    press_patches(P, E, patch_of, push)
    for p in range(P.shape[0]):
        if P[p, patch.FREE] != 0.0:
            half = 0.5 * dt / P[p, patch.MASS]
            P[p, patch.VELOCITY] = (P[p, patch.VELOCITY] + half * (P[p, patch.FORCE] - P[p, patch.LOAD])) / (
                1.0 + half * P[p, patch.DAMPING]
            )


@njit(**BARE)
def patch_powers(P, first, last):
    """Return the power that moves patches first to last - 1 and that of their dashpots [W].

    The former is that of the loads of free patches, and minus force times velocity of those of prescribed height.
    """
    load, damping, power = 0.0, 0.0, 0.0
    for p in range(first, last):
        if P[p, patch.FREE] != 0.0:
            load -= P[p, patch.LOAD] * P[p, patch.VELOCITY]
            damping += P[p, patch.DAMPING] * P[p, patch.VELOCITY] * P[p, patch.VELOCITY]
        else:
            power -= P[p, patch.FORCE] * P[p, patch.VELOCITY]
    return load + power, damping


@njit(**BARE)
def kick_body(b, B, E, force, torque, dt):
    """Apply a half kick by a force and a torque to body b: vectors of four whose last element is ignored."""
    v, w, half, none = load(B, b, body.VELOCITY), load(B, b, body.SPIN), 0.5 * dt, broadcast(0.0)
    inertia = extract(w, 3)  # moment of inertia of a single-sphere body, else 0
    fraction = broadcast(half) / set4(extract(v, 3), inertia, 1.0, 1.0)
    push, rotation = with_last(force, none), with_last(torque, none)
    store(B, b, body.VELOCITY, flush_below(v + broadcast_lane(fraction, 0) * push, NEGLIGIBLE_SPEED))
    if inertia != 0.0:
        store(B, b, body.SPIN, flush_below(w + broadcast_lane(fraction, 1) * rotation, NEGLIGIBLE_SPIN))
    else:
        store(
            E,
            b,
            body_extra.ANGULAR_MOMENTUM,
            flush_below(load(E, b, body_extra.ANGULAR_MOMENTUM) + broadcast(half) * rotation, NEGLIGIBLE_MOMENTUM),
        )


@njit(**BARE_CHUNK)
def body_effect_forces(c, first, last, context, step, effects):
    """Apply body effects to bodies first to last of chunk c; effects see velocities at the end of the step."""
    B, E, moves, orientations = context.B, context.E, context.moves, context.orientations
    effects(B, E, first, last, step.time, step.dt, context.effect_parameters)
    for b in range(first, last):
        kick_body(b, B, E, load(E, b, body_extra.EFFECT_FORCE), load(E, b, body_extra.EFFECT_TORQUE), step.dt)
        spin_body(b, B, E, orientations)
        for k in range(3):
            B[b, body.FORCE + k] += E[b, body_extra.EFFECT_FORCE + k]
            B[b, body.TORQUE + k] += E[b, body_extra.EFFECT_TORQUE + k]
            moves[c, chunk_motion.EFFECT_POWER] += (
                E[b, body_extra.EFFECT_FORCE + k] * B[b, body.VELOCITY + k]
                + E[b, body_extra.EFFECT_TORQUE + k] * B[b, body.SPIN + k]
            )


@njit(**BARE)
def add_remote_forces(first, last, shift, context):
    """Add the remote forces first to last to their partners, in that order, and clear their rows of F for the next contacts."""
    E, F, remote_body, none = context.E, context.F, context.remote_body, broadcast(0.0)
    for f in range(first, last):
        row = np.uint64(context.remote_row[f])
        add_force(remote_body[f] + shift, context.forces, load(F, row, remote_force.FORCE), load(F, row, remote_force.TORQUE))
        store(F, row, remote_force.FORCE, none)
        store(F, row, remote_force.TORQUE, none)
    if F.shape[1] > remote_force.WIDTH_WITHOUT_NORMAL_LOSS:
        for f in range(first, last):
            row = np.uint64(context.remote_row[f])
            E[remote_body[f], body_extra.NORMAL_LOSS] += F[row, remote_force.NORMAL_LOSS]
            F[row, remote_force.NORMAL_LOSS] = 0.0


@njit(**BARE_CHUNK)
def gather_forces(c, context, step, effects):
    """Sum the forces on the bodies of chunk c, and make their closing half kick if velocities are needed now.

    Kick and spins are computed only in recorded steps or with body effects: otherwise the drift of the next step includes the
    kick, with the forces at hand.
    """
    B, cuts, has_effects = context.B, context.cuts, context.has_effects != 0
    first, last, shift = c * BODIES, min((c + 1) * BODIES, B.shape[0]), shift_of(c // GROUP, context)
    add_remote_forces(cuts[REMOTE, c], cuts[REMOTE, c + 1], shift, context)
    store_forces(first, last, shift, context)
    context.moves[c, chunk_motion.EFFECT_POWER] = 0.0
    if has_effects or step.record:
        closing_kick(first, last, context, step.dt)
    if has_effects:
        body_effect_forces(c, first, last, context, step, effects)


@njit(**BARE_CHUNK)
def closing_kick(first, last, context, dt):
    """Apply the closing half kick to bodies first to last, and update their spins."""
    B, E = context.B, context.E
    for b in range(first, last):
        kick_body(b, B, E, load(B, b, body.FORCE), load(B, b, body.TORQUE), dt)
        spin_body(b, B, E, context.orientations)
