"""Forces that contacts of other groups exert on a body, body effects, and the closing half kick."""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import broadcast, broadcast_lane, extract, flush_below, load, set4, store, with_last
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.explicit.group_forces import add_force, shift_of, store_forces
from thirdbody.kernels.explicit.tables import chunk_motion
from thirdbody.kernels.rigid_body import BODIES, NEGLIGIBLE_MOMENTUM, NEGLIGIBLE_SPEED, NEGLIGIBLE_SPIN, REMOTE, spin_body
from thirdbody.kernels.tables import body, body_extra, remote_force


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
