"""The passes of a step over groups of bodies: drift, contact forces, closing kick.

The step loop calls them through a pointer, so that both can be compiled at the same time. The closing half kick comes after the
forces that contacts of other groups exert on a body, and before body effects.
"""

import numpy as np
from numba import njit

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, BARE_CHUNK, NO_COUNTS, POINTED, entry
from thirdbody.jit.simd import broadcast, broadcast_lane, extract, flush_below, load, set4, store, with_last
from thirdbody.kernels import arguments, bodies
from thirdbody.kernels.arguments import EARLY, LATE, OBSERVATION, SWEEP, WORK, as_observed, context_of
from thirdbody.kernels.bodies import BODIES, REMOTE, WITH_PLATE, WITH_SPHERE, reset_plate_forces, spin_body
from thirdbody.kernels.explicit.contact_forces import GROUP, add_force, contact_forces
from thirdbody.kernels.explicit.drift import drift_bodies
from thirdbody.kernels.explicit.tables import body_force, chunk_motion
from thirdbody.kernels.plates import is_rough
from thirdbody.kernels.tables import body, body_extra, remote_force

law_at, effects_at = function_at(arguments.LAW), function_at(arguments.EFFECTS)
observe_bodies_at = function_at(arguments.OBSERVE_BODIES)


@njit(**BARE)
def kick_body(b, context, force, torque, dt):
    """Apply a half kick by a force and a torque to body b, and update its spin: vectors of four whose last element is ignored."""
    B, E, none = context.B, context.E, broadcast(0.0)
    v, w, half = load(B, b, body.VELOCITY), load(B, b, body.SPIN), 0.5 * dt
    inertia = extract(w, 3)  # moment of inertia of a single-sphere body, else 0
    fraction = broadcast(half) / set4(extract(v, 3), inertia, 1.0, 1.0)
    push, rotation = with_last(force, none), with_last(torque, none)
    store(B, b, body.VELOCITY, flush_below(v + broadcast_lane(fraction, 0) * push, bodies.NEGLIGIBLE_SPEED))
    if inertia != 0.0:
        store(B, b, body.SPIN, flush_below(w + broadcast_lane(fraction, 1) * rotation, bodies.NEGLIGIBLE_SPIN))
    else:
        momentum = load(E, b, body_extra.ANGULAR_MOMENTUM) + broadcast(half) * rotation
        store(E, b, body_extra.ANGULAR_MOMENTUM, flush_below(momentum, bodies.NEGLIGIBLE_MOMENTUM))
    spin_body(b, B, E, context.orientations)


@njit(**BARE_CHUNK)
def closing_kick(first, last, context, dt):
    """Apply the closing half kick to bodies first to last, and update their spins."""
    B = context.B
    for b in range(first, last):
        kick_body(b, context, load(B, b, body.FORCE), load(B, b, body.TORQUE), dt)


@njit(**BARE_CHUNK)
def body_effect_forces(c, first, last, context, step, effects):
    """Apply body effects to bodies first to last of chunk c; effects see velocities at the end of the step."""
    B, E, moves = context.B, context.E, context.moves
    effects(B, E, first, last, step.time, step.dt, context.effect_parameters)
    for b in range(first, last):
        kick_body(b, context, load(E, b, body_extra.EFFECT_FORCE), load(E, b, body_extra.EFFECT_TORQUE), step.dt)
        for k in range(3):
            B[b, body.FORCE + k] += E[b, body_extra.EFFECT_FORCE + k]
            B[b, body.TORQUE + k] += E[b, body_extra.EFFECT_TORQUE + k]
            moves[c, chunk_motion.EFFECT_POWER] += (
                E[b, body_extra.EFFECT_FORCE + k] * B[b, body.VELOCITY + k]
                + E[b, body_extra.EFFECT_TORQUE + k] * B[b, body.SPIN + k]
            )


@njit(**BARE_CHUNK)
def gather_forces(c, context, step, effects):
    """Sum the forces on the bodies of chunk c, and make their closing half kick if velocities are needed now.

    Remote forces are added in their order, and their rows of F are cleared for the next contacts. Kick and spins are computed
    only in recorded steps or with body effects: otherwise the drift of the next step includes the kick, with the forces at hand.
    """
    B, E, F, forces, cuts, remote_body = context.B, context.E, context.F, context.forces, context.cuts, context.remote_body
    first, last, shift = c * BODIES, min((c + 1) * BODIES, B.shape[0]), np.int64(context.force_rows[c // GROUP])
    begin, end, has_effects, none = cuts[REMOTE, c], cuts[REMOTE, c + 1], context.has_effects != 0, broadcast(0.0)
    for f in range(begin, end):
        row = np.uint64(context.remote_row[f])
        add_force(remote_body[f] + shift, forces, load(F, row, remote_force.FORCE), load(F, row, remote_force.TORQUE))
        store(F, row, remote_force.FORCE, none)
        store(F, row, remote_force.TORQUE, none)
    if F.shape[1] > remote_force.WIDTH_WITHOUT_NORMAL_LOSS:
        for f in range(begin, end):
            row = np.uint64(context.remote_row[f])
            E[remote_body[f], body_extra.NORMAL_LOSS] += F[row, remote_force.NORMAL_LOSS]
            F[row, remote_force.NORMAL_LOSS] = 0.0
    for b in range(first, last):
        store(B, b, body.FORCE, load(forces, b + shift, body_force.FORCE))
        store(B, b, body.TORQUE, load(forces, b + shift, body_force.TORQUE))
    context.moves[c, chunk_motion.EFFECT_POWER] = 0.0
    if has_effects or step.record:
        closing_kick(first, last, context, step.dt)
    if has_effects:
        body_effect_forces(c, first, last, context, step, effects)


@njit(**BARE)
def drift_groups(task, group, alone, part, context, step):
    """Drift the bodies that this pass of a group needs, unless they have been drifted in this step.

    `alone`: whether only contacts of this part act on bodies of this group. `needs`: other groups whose bodies must be drifted
    before this group's contacts.
    """
    needs, moved, cuts, E = context.needs, context.moved, context.cuts, context.E
    requested = needs[group + 1] if task == SWEEP else needs[group] if task == EARLY and not alone else needs[group] - 1
    for e in range(needs[group] - 1, requested):
        h = np.int64(needs[e]) if e >= needs[group] else group
        if moved[h] != step.number:
            moved[h] = step.number
            for c in range(h * GROUP, min((h + 1) * GROUP, context.moves.shape[0])):
                drift_bodies(c, context, step, context.scratch[part], context.marks[part])
                if is_rough(context):  # candidates are many, most of them without a minimum
                    for b in range(c * BODIES, min((c + 1) * BODIES, E.shape[0])):
                        E[b, body_extra.UPPER_PUSH] = 0.0
                else:
                    reset_plate_forces(cuts[WITH_PLATE, c], cuts[WITH_PLATE, c + 1], context.own, context.body, E)


@entry(WORK, **POINTED, **NO_COUNTS)
def work(task, part, begin, end, step, packed):
    """Run one pass of a step over groups begin to end; one call for all, since calling through a pointer costs 1.4 us."""
    context = context_of(packed)
    B, forces, none, scratch = context.B, context.forces, broadcast(0.0), context.scratch[part]
    law, effects = law_at(context.law), effects_at(context.effects)
    for group in range(begin, end):
        alone, shift = context.lowest[group] >= begin, np.int64(context.force_rows[group])
        first, last = group * GROUP * BODIES, min((group + 1) * GROUP * BODIES, B.shape[0])
        drift_groups(task, group, alone, part, context, step)
        if task == SWEEP:
            for b in range(first, last):  # forces are those of this step; friction work and slip, the last elements, go on
                store(forces, b + shift, body_force.FORCE, with_last(none, load(B, b, body.FORCE)))
                store(forces, b + shift, body_force.TORQUE, with_last(none, load(B, b, body.TORQUE)))
            for side in range(WITH_PLATE, WITH_SPHERE + 1):
                contact_forces(group, side, part, context, step, law)
        if (task == SWEEP and alone) or (task == LATE and not alone):
            for c in range(group * GROUP, min((group + 1) * GROUP, context.moves.shape[0])):
                gather_forces(c, context, step, effects)
        if task == OBSERVATION:
            observe = observe_bodies_at(context.observe_bodies)
            observe(first, last, as_observed(context), context.A, context.observe, scratch, context.rows[part])
