"""The passes of a step of velocity Verlet over groups of bodies: half kick and drift, contact forces, closing half kick.

The step loop calls them through a pointer, so that both can be compiled at the same time. Single-sphere bodies are drifted one by
one, with extrema per chunk (a body is named only when a guard trips), all others field by field, which the compiler turns into
vector instructions: IEEE arithmetic body by body, so the bits are those of a loop over bodies. The closing half kick comes after
the forces that contacts of other groups exert on a body, and before body effects; it is fused into the next drift unless output
or a labeller needs synchronised velocities.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit import simd
from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, BARE_CHUNK, NO_COUNTS, POINTED, entry
from thirdbody.jit.simd import broadcast, broadcast_lane, extract, load, set4, store, with_last
from thirdbody.kernels import arguments, bodies
from thirdbody.kernels.arguments import EARLY, LATE, OBSERVATION, RUN_GROUPS, SWEEP, as_observed, context_of
from thirdbody.kernels.bodies import BODIES, REMOTE, WITH_PLATE, WITH_SPHERE, is_aliased, spin_body, vector
from thirdbody.kernels.explicit.contact_forces import GROUP, add_force, contact_forces
from thirdbody.kernels.plates import is_rough
from thirdbody.kernels.step_tables import body_force, chunk_motion, drift_scratch
from thirdbody.kernels.tables import body, body_extra, domain, orientation, remote_force, sphere
from thirdbody.kernels.vectors import free_rotation, matrix, spin, total


@njit(**BARE)
def drift_ball(b, s, context, step, extrema):
    """Apply half kick and full drift to body b, the single sphere s, after the last step's closing kick if that is pending;
    return the updated extrema of a chunk: squares of the largest speed and of half the largest ratio of path to radius; sums that
    are not 0 if a coordinate is not finite; lower and upper bounds of the positions. The column after each vector is
    preserved."""
    S, B, dt = context.S, context.B, step.dt
    x = load(B, b, body.POSITION)
    v = load(B, b, body.VELOCITY)
    w = load(B, b, body.SPIN)
    force = load(B, b, body.FORCE)
    torque = load(B, b, body.TORQUE)
    none, again = broadcast(0.0), broadcast(step.pending)
    # dt/2 over mass, inertia and radius in one division
    fraction = broadcast(0.5 * dt) / set4(extract(v, 3), extract(w, 3), S[s, sphere.RADIUS], 1.0)
    change, rotation = broadcast_lane(fraction, 0) * with_last(force, none), broadcast_lane(fraction, 1) * with_last(torque, none)
    v = simd.flush_below(v + again * change, bodies.NEGLIGIBLE_SPEED) + change
    w = simd.flush_below(w + again * rotation, bodies.NEGLIGIBLE_SPIN) + rotation
    x = with_last(x + broadcast(dt) * v, x)
    store(B, b, body.POSITION, x)
    store(B, b, body.VELOCITY, v)
    store(B, b, body.SPIN, w)
    if step.turn != 0.0:
        q = load(context.orientations, b, orientation.QUATERNION)
        store(context.orientations, b, orientation.QUATERNION, bodies.rotate_sphere(q, w, step.turn))
    if not is_aliased(S):
        bodies.store_three(S, s, np.int64(sphere.POSITION), x)
        store(S, s, sphere.MID_VELOCITY, v)
        store(S, s, sphere.MID_SPIN, w)
        force, torque = none, w  # what follows them in the row of a sphere has no meaning
    store(S, s, sphere.END_VELOCITY, with_last(v + change, force))
    store(S, s, sphere.END_SPIN, with_last(w + rotation, torque))
    square, (fastest, farthest, strange, low, high) = total(v * v), extrema
    return (
        max(fastest, square), max(farthest, square * extract(fraction, 2) * extract(fraction, 2)), strange + none * x,
        simd.select_greater(low, x, x, low), simd.select_greater(x, high, x, high),
    )  # fmt: skip


@njit(**BARE_CHUNK)
def check_sphere_limits(c, start, S, B, D, limits, dt, extrema):
    """Return longest path and largest ratio of path to radius of chunk c's single spheres; if a guard trips, also the body of the
    latter, the last body that is not finite, and the last that left the domain (+ 1; 0: none)."""
    fastest, farthest, strange, low, high = extrema
    distance, step = math.sqrt(fastest) * dt, 2.0 * math.sqrt(farthest)
    outside = simd.less_mask(low, limits[0]) | simd.less_mask(limits[1], high)
    there = simd.all_below(high, bodies.MAX_DISTANCE) & simd.all_below(broadcast(0.0) - low, bodies.MAX_DISTANCE)
    there = there & simd.all_below(strange, 1.0)
    maximum, number, bad, out = -1.0, np.int64(0), np.int64(0), np.int64(0)
    if not ((outside == 0) & there & (step <= D[domain.TRAVEL_GUARD])):
        for b in range(c * BODIES, min((c + 1) * BODIES, B.shape[0])):
            if B[b, body.SPHERE_INERTIA] != 0.0:
                v = load(B, b, body.VELOCITY)
                ratio = math.sqrt(total(v * v)) * dt / S[start[b], sphere.RADIUS]
                bad, out = bodies.check_position(b, load(B, b, body.POSITION), ratio, limits, bad, out)
                maximum, number = (ratio, np.int64(b)) if ratio > maximum else (maximum, number)
    return distance, step, number, bad, out


@njit(**BARE)
def three(scratch, at):
    return scratch[at], scratch[at + BODIES], scratch[at + 2 * BODIES]


@njit(**BARE)
def put_three(scratch, at, x, y, z):
    scratch[at], scratch[at + BODIES], scratch[at + 2 * BODIES] = x, y, z


@njit(**BARE)
def half_kick(v, left, change, minimum):
    """Apply the pending closing kick (`left` 1, else 0) and the next one; in between, what is at most `minimum` becomes 0."""
    x, y, z = v[0] + left * change[0], v[1] + left * change[1], v[2] + left * change[2]
    x, y, z = 0.0 if abs(x) <= minimum else x, 0.0 if abs(y) <= minimum else y, 0.0 if abs(z) <= minimum else z
    return x + change[0], y + change[1], z + change[2]


@njit(**BARE_CHUNK)
def drift_tile(n, dt, left, scratch):
    """Apply half kick and full drift to n bodies, and write their longest paths. Loops with an inner one are not vectorised."""
    half = 0.5 * dt
    for p in range(n):
        kick = half / scratch[p + body.MASS * BODIES]
        f_x, f_y, f_z = three(scratch, p + body.FORCE * BODIES)
        change = kick * f_x, kick * f_y, kick * f_z
        v_x, v_y, v_z = half_kick(three(scratch, p + body.VELOCITY * BODIES), left, change, bodies.NEGLIGIBLE_SPEED)
        x, y, z = three(scratch, p + body.POSITION * BODIES)
        x, y, z = x + dt * v_x, y + dt * v_y, z + dt * v_z
        t_x, t_y, t_z = three(scratch, p + body.TORQUE * BODIES)
        rotation = half * t_x, half * t_y, half * t_z
        momentum = three(scratch, p + drift_scratch.ANGULAR_MOMENTUM * BODIES)
        momentum = half_kick(momentum, left, rotation, bodies.NEGLIGIBLE_MOMENTUM)
        inertia = three(scratch, p + drift_scratch.INERTIA * BODIES)
        at = p + drift_scratch.QUATERNION * BODIES
        old = (scratch[at], scratch[at + BODIES], scratch[at + 2 * BODIES], scratch[at + 3 * BODIES])
        new = free_rotation(old, momentum, inertia, dt)
        w_0, w_1 = spin(old, momentum, inertia), spin(new, momentum, inertia)
        w = (0.5 * (w_0[0] + w_1[0]), 0.5 * (w_0[1] + w_1[1]), 0.5 * (w_0[2] + w_1[2]))
        end = momentum[0] + rotation[0], momentum[1] + rotation[1], momentum[2] + rotation[2]
        arm = scratch[p + drift_scratch.LONGEST_ARM * BODIES]
        put_three(scratch, p + body.POSITION * BODIES, x, y, z)
        put_three(scratch, p + body.VELOCITY * BODIES, v_x, v_y, v_z)
        put_three(scratch, p + drift_scratch.ANGULAR_MOMENTUM * BODIES, momentum[0], momentum[1], momentum[2])
        scratch[at], scratch[at + BODIES], scratch[at + 2 * BODIES], scratch[at + 3 * BODIES] = new
        put_three(scratch, p + drift_scratch.MID_SPIN * BODIES, w[0], w[1], w[2])
        w_end = spin(new, end, inertia)
        put_three(scratch, p + drift_scratch.END_SPIN * BODIES, w_end[0], w_end[1], w_end[2])
        put_three(scratch, p + drift_scratch.END_VELOCITY * BODIES, v_x + change[0], v_y + change[1], v_z + change[2])
        rotation = matrix(new[0], new[1], new[2], new[3])
        put_three(scratch, p + drift_scratch.MATRIX * BODIES, rotation[0], rotation[1], rotation[2])
        put_three(scratch, p + (drift_scratch.MATRIX + 3) * BODIES, rotation[3], rotation[4], rotation[5])
        put_three(scratch, p + (drift_scratch.MATRIX + 6) * BODIES, rotation[6], rotation[7], rotation[8])
        fast = math.sqrt(v_x * v_x + v_y * v_y + v_z * v_z) + math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) * arm
        scratch[p + drift_scratch.PATH * BODIES] = fast * dt


@njit(**BARE)
def gather_columns(at, k, b, B, scratch):
    fields = simd.transpose(load(B, b[0], k), load(B, b[1], k), load(B, b[2], k), load(B, b[3], k))
    simd.put(scratch, at, fields[0])
    simd.put(scratch, at + BODIES, fields[1])
    simd.put(scratch, at + 2 * BODIES, fields[2])
    simd.put(scratch, at + 3 * BODIES, fields[3])


@njit(**BARE)
def scatter_body(p, b, context, step, scratch):
    """Copy the motion of body b back from element p, and place its spheres: those that are `near`, in recorded steps all."""
    B, E, everything, rotation = context.B, context.E, step.record, p + drift_scratch.MATRIX * BODIES
    position, velocity = p + body.POSITION * BODIES, p + body.VELOCITY * BODIES
    for k in range(3):
        B[b, body.POSITION + k] = scratch[position + k * BODIES]
        B[b, body.VELOCITY + k] = scratch[velocity + k * BODIES]
        E[b, body_extra.ANGULAR_MOMENTUM + k] = scratch[p + (drift_scratch.ANGULAR_MOMENTUM + k) * BODIES]
    for k in range(4):
        context.orientations[b, orientation.QUATERNION + k] = scratch[p + (drift_scratch.QUATERNION + k) * BODIES]
    one, two, last = three(scratch, rotation), three(scratch, rotation + 3 * BODIES), three(scratch, rotation + 6 * BODIES)
    motion = bodies.BodyMotion(
        vector(three(scratch, position)), bodies.columns((*one, *two, *last)), vector(three(scratch, velocity)),
        vector(three(scratch, p + drift_scratch.MID_SPIN * BODIES)),
        vector(three(scratch, p + drift_scratch.END_VELOCITY * BODIES)),
        vector(three(scratch, p + drift_scratch.END_SPIN * BODIES)),
    )  # fmt: skip
    begin = context.start[b] if everything else np.int64(context.beginning[b])
    end = context.start[b + 1] if everything else np.int64(context.beginning[b + 1])
    for e in range(begin, end):
        bodies.place_sphere(e if everything else np.int64(context.near[e]), context.offsets, motion, 0.5 * step.dt, context.S)


@njit(**BARE_CHUNK)
def drift_bodies(c, context, step, scratch, listed):
    start, S, B, D, moves = context.start, context.S, context.B, context.D, context.moves
    longest, ratio, number, bad, out = 0.0, 0.0, np.int64(0), np.int64(0), np.int64(0)
    balls = 0.0, 0.0, broadcast(0.0), broadcast(np.inf), broadcast(-np.inf)
    limits, n = bodies.limits_of(D), np.int64(0)  # not a literal, for which callees would be compiled once more
    for b in range(c * BODIES, min((c + 1) * BODIES, B.shape[0])):
        ahead = np.uint64(min(b + simd.AHEAD, B.shape[0] - 1))  # hardware prefetchers stop at page boundaries, every dozen bodies
        for line in range(0, body.WIDTH, simd.LINE):
            simd.prefetch(B, ahead, np.int64(line))
        for line in range(0, 0 if is_aliased(S) else sphere.WIDTH, simd.LINE):
            simd.prefetch(S, np.uint64(start[ahead]), np.int64(line))
        if B[b, body.SPHERE_INERTIA] != 0.0:
            balls = drift_ball(b, start[b], context, step, balls)
        else:
            listed[n] = b
            n += 1
    for p in range(n, n + -n % 4):
        listed[p] = listed[n - 1]  # up to a multiple of four
    for p in range(0, n, 4):
        four = np.uint64(listed[p]), np.uint64(listed[p + 1]), np.uint64(listed[p + 2]), np.uint64(listed[p + 3])
        for k in range(body.POSITION, body.SPIN, 4):
            gather_columns(p + k * BODIES, k, four, B, scratch)
        for k in range(body.FORCE, body.WIDTH, 4):
            gather_columns(p + k * BODIES, k, four, B, scratch)
        for k in range(0, body_extra.WIDTH_WITHOUT_EFFECTS, 4):
            gather_columns(p + (body.WIDTH + k) * BODIES, k, four, context.E, scratch)
        at = p + drift_scratch.QUATERNION * BODIES
        gather_columns(at, np.int64(orientation.QUATERNION), four, context.orientations, scratch)
    drift_tile(n, step.dt, step.pending, scratch)
    for p in range(n):
        i = np.int64(listed[p])
        scatter_body(p, i, context, step, scratch)
        path = scratch[p + drift_scratch.PATH * BODIES]
        bad, out = bodies.check_position(i, load(B, i, body.POSITION), path / S[start[i], sphere.RADIUS], limits, bad, out)
        number = i if path / S[start[i], sphere.RADIUS] > ratio else number
        longest, ratio = max(longest, path), max(ratio, path / S[start[i], sphere.RADIUS])
    path, largest, ball, bad_ball, out_ball = check_sphere_limits(c, start, S, B, D, limits, step.dt, balls)
    moves[c, chunk_motion.MAX_PATH] = max(path, longest)
    moves[c, chunk_motion.BAD_BODY] = max(bad, bad_ball)
    moves[c, chunk_motion.LEFT_BODY] = max(out, out_ball)
    moves[c, chunk_motion.MAX_TRAVEL], moves[c, chunk_motion.BODY] = (largest, ball) if largest > ratio else (ratio, number)


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
    store(B, b, body.VELOCITY, simd.flush_below(v + broadcast_lane(fraction, 0) * push, bodies.NEGLIGIBLE_SPEED))
    if inertia != 0.0:
        store(B, b, body.SPIN, simd.flush_below(w + broadcast_lane(fraction, 1) * rotation, bodies.NEGLIGIBLE_SPIN))
    else:
        momentum = load(E, b, body_extra.ANGULAR_MOMENTUM) + broadcast(half) * rotation
        store(E, b, body_extra.ANGULAR_MOMENTUM, simd.flush_below(momentum, bodies.NEGLIGIBLE_MOMENTUM))
    spin_body(b, B, E, context.orientations)


@njit(**BARE_CHUNK)
def closing_kick(first, last, context, dt):
    B = context.B
    for b in range(first, last):
        kick_body(b, context, load(B, b, body.FORCE), load(B, b, body.TORQUE), dt)


@njit(**BARE_CHUNK)
def body_effect_forces(c, first, last, context, step, effects):
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
    """Sum the forces on the bodies of chunk c, remote ones in their order, and clear the rows of these for the next contacts.
    Kick and spins are computed only in recorded steps or with body effects: else the drift of the next step includes the kick."""
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
    """Drift the bodies that this pass of a group needs, if not done in this step: with the sweep also those that its contacts
    need (`needs`). `alone`: only contacts of this part act on bodies of this group."""
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
                    for k in range(cuts[WITH_PLATE, c], cuts[WITH_PLATE, c + 1]):
                        E[np.uint64(context.body[context.own[k]]), body_extra.UPPER_PUSH] = 0.0


@entry(RUN_GROUPS, **POINTED, **NO_COUNTS)
def run_groups(task, part, begin, end, step, packed):
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
