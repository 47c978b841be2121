"""The contact pass: candidates -> overlaps -> tiles of the laws -> forces on bodies, group by group.

A group is a fixed range of bodies with the candidates that its spheres own. It writes only to its own candidates, forces on its
bodies and row of `sums`; forces on bodies of other groups go to F, and those groups add them in a fixed order: the same bits for
any number of threads. Mispredicted branches cost more than all arithmetic, so active candidates are listed without one.

The row of a body gets the forces of `body_force`, rows that stay in the cache, at the end, when its velocities predicted for the
end of the step are no longer needed. `Context.force_rows`: the row of a body there, less its number, by group.
"""

import numpy as np
from numba import njit

from thirdbody.jit import simd
from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import LANES, broadcast, cross, extract, get, load, put, store, transpose, with_last
from thirdbody.kernels import close_spots, contact_geometry, plates, rolling_kinematics
from thirdbody.kernels.arguments import Tile
from thirdbody.kernels.bodies import WITH_PLATE, arm_to_sphere, is_aliased
from thirdbody.kernels.books import add_normal_losses, book, book_dashpots, book_opened, book_opened_dashpots, separation_rate
from thirdbody.kernels.contact_geometry import SPARE, compact_active, compact_rough, squares_within_reach
from thirdbody.kernels.measures import measure_contact, measure_opened
from thirdbody.kernels.memory import reset_history, store_history
from thirdbody.kernels.minima import update_surfaces
from thirdbody.kernels.plates import is_lower, is_plate, is_sphere, partner_velocity, surface_velocity
from thirdbody.kernels.step_tables import body_force, contact_sums
from thirdbody.kernels.tables import body_extra, record, remote_force, sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output, rolling_input, rolling_output
from thirdbody.kernels.vectors import box_of

GROUP = 8
"""Chunks of bodies per group. The data of a group stay in the near cache until it is done: 16 take as long, 4 take 5 to 8 %
longer, since more contacts are between groups."""

LARGEST = 1e300  # bound of the square of a force [N2]; no force reaches it
BODY_FRACTION = 0.5  # fraction of the friction work between two bodies that each of them gets


def scratch_sizes(n_history, longest, interaction=False):
    """Return the floats and integers of scratch for `longest` candidates. A vector that straddles two cache lines costs twice."""
    fields = law_input.HISTORY + law_output.HISTORY + 2 * n_history + rolling_input.WIDTH + rolling_output.WIDTH + geometry.WIDTH
    whole = longest + -longest % simd.LINE
    return fields * TILE + (close_spots.scratch_of(whole) if interaction else whole), 2 * (longest + SPARE)


@njit(**BARE)
def add_force(row, forces, force, torque):
    """Add a force (4th lane: friction work) and a torque (4th lane: slip) to those in a row."""
    store(forces, row, body_force.FORCE, load(forces, row, body_force.FORCE) + force)
    store(forces, row, body_force.TORQUE, load(forces, row, body_force.TORQUE) + torque)


@njit(**BARE)
def scatter_plate_force(k, c, context, force, torque):
    i, sums, shift = np.uint64(context.own[k]), context.sums, np.int64(context.force_rows[c >> 1])
    b = np.uint64(context.body[i])
    add_force(b + np.uint64(shift), context.forces, force, torque + cross(arm_to_sphere(i, context.S), force))
    low, alone = is_lower(context.partner[k]), with_last(force, broadcast(0.0))
    total = np.int64(contact_sums.LOWER_FORCE) if low else np.int64(contact_sums.UPPER_FORCE)
    context.E[b, body_extra.UPPER_PUSH] += 0.0 if low else extract(force, 2)
    store(sums, c, total, load(sums, c, total) + alone)


@njit(**BARE)
def scatter_pair_force(k, shift, context, force, torque, back):
    """Apply a contact between spheres to both bodies, in another group by F. `torque`, `back`: about the two centres [N m]."""
    i, j, S, B, F = np.uint64(context.own[k]), np.uint64(context.partner[k]), context.S, context.B, context.F
    against = with_last(broadcast(0.0) - force, force)
    b, p = i, j
    if S.shape[0] != B.shape[0]:
        b, p = np.uint64(context.body[i]), np.uint64(context.body[j])
        torque = torque + cross(arm_to_sphere(i, S), force)
        back = back + cross(arm_to_sphere(j, S), against)
    add_force(b + shift, context.forces, force, torque)
    if context.outer[k] < 0:
        add_force(p + shift, context.forces, against, back)
    else:
        store(F, context.outer[k], remote_force.FORCE, against)
        store(F, context.outer[k], remote_force.TORQUE, back)


@njit(**BARE)
def four_rows(at, G, last):
    return transpose(get(G, at), get(G, at + TILE), get(G, at + 2 * TILE), last)


@njit(**BARE_CHUNK)
def scatter_plate_tile(n, c, slots, context, tile):
    O, G = tile.outputs, tile.geometry  # noqa: E741
    for q in range(0, n, 4):
        work, slip = get(O, q + law_output.DISSIPATED * TILE), get(O, q + law_output.SLIP * TILE)
        f, t = four_rows(q + geometry.FORCE * TILE, G, work), four_rows(q + geometry.TORQUE * TILE, G, slip)
        scatter_plate_force(np.uint64(slots[q]), c, context, f[0], t[0])
        if q + 1 < n:
            scatter_plate_force(np.uint64(slots[q + 1]), c, context, f[1], t[1])
        if q + 2 < n:
            scatter_plate_force(np.uint64(slots[q + 2]), c, context, f[2], t[2])
        if q + 3 < n:
            scatter_plate_force(np.uint64(slots[q + 3]), c, context, f[3], t[3])


@njit(**BARE_CHUNK)
def scatter_pair_tile(n, c, slots, context, tile):
    O, G, shift = tile.outputs, tile.geometry, np.uint64(np.int64(context.force_rows[c >> 1]))  # noqa: E741
    for q in range(0, n, 4):
        work, slip = broadcast(BODY_FRACTION) * get(O, q + law_output.DISSIPATED * TILE), get(O, q + law_output.SLIP * TILE)
        f = four_rows(q + geometry.FORCE * TILE, G, work)
        t, w = four_rows(q + geometry.TORQUE * TILE, G, slip), four_rows(q + geometry.PARTNER_TORQUE * TILE, G, slip)
        scatter_pair_force(np.uint64(slots[q]), shift, context, f[0], t[0], w[0])
        if q + 1 < n:
            scatter_pair_force(np.uint64(slots[q + 1]), shift, context, f[1], t[1], w[1])
        if q + 2 < n:
            scatter_pair_force(np.uint64(slots[q + 2]), shift, context, f[2], t[2], w[2])
        if q + 3 < n:
            scatter_pair_force(np.uint64(slots[q + 3]), shift, context, f[3], t[3], w[3])


@njit(**BARE)
def reduce_tile(m, slots, tile, sums_of_tile):
    """Add m contacts to the sums of a group: dissipation of friction and of dashpots, in four lanes; largest overlap over the
    smaller radius, with its candidate; last candidate whose force is not finite (+ 1; 0: none)."""
    I, O, G = tile.inputs, tile.outputs, tile.geometry  # noqa: E741
    work, damped, max_overlap, slot, bad = sums_of_tile
    for q in range(m, m + -m % LANES):  # the padding must not affect the reductions
        O[q + law_output.DISSIPATED * TILE] = O[q + law_output.DASHPOT_POWER * TILE] = I[q + law_input.OVERLAP * TILE] = 0.0
        G[q + geometry.FORCE * TILE] = G[q + (geometry.FORCE + 1) * TILE] = G[q + (geometry.FORCE + 2) * TILE] = 0.0
    for q in range(0, m, LANES):
        end = min(q + LANES, m)
        work, damped = work + get(O, q + law_output.DISSIPATED * TILE), damped + get(O, q + law_output.DASHPOT_POWER * TILE)
        r_i, r_j = get(G, q + geometry.RADIUS * TILE), get(G, q + geometry.PARTNER_RADIUS * TILE)
        limit = broadcast(max_overlap) * simd.select_greater(r_i, r_j, r_j, r_i)
        if simd.less_mask(limit, get(I, q + law_input.OVERLAP * TILE)) != 0:  # few are the deepest
            for e in range(q, end):
                radius = min(G[e + geometry.RADIUS * TILE], G[e + geometry.PARTNER_RADIUS * TILE])
                ratio = I[e + law_input.OVERLAP * TILE] / radius
                max_overlap, slot = (ratio, np.int64(slots[e])) if ratio > max_overlap else (max_overlap, slot)
        x = get(G, q + geometry.FORCE * TILE)
        y = get(G, q + (geometry.FORCE + 1) * TILE)
        z = get(G, q + (geometry.FORCE + 2) * TILE)
        if not simd.all_below(x * x + y * y + z * z, LARGEST):
            for e in range(q, end):
                f_x, f_y = G[e + geometry.FORCE * TILE], G[e + (geometry.FORCE + 1) * TILE]
                f_z = G[e + (geometry.FORCE + 2) * TILE]
                bad = bad if f_x * f_x + f_y * f_y + f_z * f_z < LARGEST else np.int64(slots[e]) + 1
    return work, damped, max_overlap, slot, bad


@njit(**BARE_CHUNK)
def write_record(q, k, context, motion, tile):
    I, O, G, R, S = tile.inputs, tile.outputs, tile.geometry, context.R, context.S  # noqa: E741
    i, j, alone = context.own[k], context.partner[k], is_aliased(context.S)
    a_i, a_j = G[q + geometry.ARM * TILE], G[q + geometry.PARTNER_ARM * TILE]
    n = (G[q + geometry.NORMAL * TILE], G[q + (geometry.NORMAL + 1) * TILE], G[q + (geometry.NORMAL + 2) * TILE])
    t_1, t_2 = O[q + law_output.TANGENTIAL_X * TILE], O[q + law_output.TANGENTIAL_Y * TILE]
    for d in range(3):
        R[k, record.POINT + d] = (0.0 if alone else S[i, sphere.ARM + d]) - a_i * n[d]
        R[k, record.PARTNER_POINT + d] = 0.0
        if is_sphere(j):
            R[k, record.PARTNER_POINT + d] = (0.0 if alone else S[j, sphere.ARM + d]) + a_j * n[d]
        R[k, record.NORMAL + d] = n[d]
        along = t_1 * G[q + (geometry.AXIS + d) * TILE] + t_2 * G[q + (geometry.CROSS_AXIS + d) * TILE]
        R[k, record.TANGENTIAL_FORCE + d] = along
    R[k, record.SPHERE_RADIUS] = S[i, sphere.RADIUS]  # the partner's: 0 if flat
    R[k, record.PARTNER_RADIUS] = S[j, sphere.RADIUS] if is_sphere(j) else plates.radius_of_curvature(k, context)
    columns = np.int64(sphere.END_VELOCITY), np.int64(sphere.END_SPIN)
    a = surface_velocity(i, S, columns, (-a_i * n[0], -a_i * n[1], -a_i * n[2]))
    b = partner_velocity(j, context, columns, (a_j * n[0], a_j * n[1], a_j * n[2]), motion)
    R[k, record.SURFACE_VELOCITY], R[k, record.SURFACE_VELOCITY + 1], R[k, record.SURFACE_VELOCITY + 2] = a
    R[k, record.PARTNER_VELOCITY], R[k, record.PARTNER_VELOCITY + 1], R[k, record.PARTNER_VELOCITY + 2] = b
    R[k, record.CONTACT_RADIUS] = O[q + law_output.CONTACT_RADIUS * TILE]
    R[k, record.PEAK_PRESSURE] = O[q + law_output.PEAK_PRESSURE * TILE]
    R[k, record.OVERLAP] = I[q + law_input.OVERLAP * TILE]
    R[k, record.NORMAL_FORCE], R[k, record.LOAD] = O[q + law_output.NORMAL_FORCE * TILE], O[q + law_output.LOAD * TILE]
    R[k, record.FRICTION_LIMIT] = O[q + law_output.FRICTION_LIMIT * TILE]
    R[k, record.CRITICAL_SLIP] = O[q + law_output.CRITICAL_SLIP * TILE]
    R[k, record.STORED_NORMAL] = O[q + law_output.STORED_NORMAL * TILE]
    R[k, record.STORED_TANGENTIAL] = O[q + law_output.STORED_TANGENTIAL * TILE]
    R[k, record.EFFECTIVE_RADIUS] = I[q + law_input.RADIUS * TILE]
    if rolling_kinematics.has_moments(context):
        rolling_kinematics.record_rolling(q, k, context, tile)


@njit(**BARE_CHUNK)
def gather_tile(n, slots, with_plate, context, motion, box, tile):
    if with_plate:
        for q in range(n):
            contact_geometry.gather_plate_contact(q, slots[q], context, motion, tile)
    else:
        contact_geometry.gather_pair_contacts(n, slots, motion.dt, box, context, tile)
    contact_geometry.transport_frames(n, motion.dt, tile)
    contact_geometry.slip_increment(n, motion.dt, tile)
    if context.rolling > 0:
        for q in range(n):
            rolling_kinematics.gather_rolling(q, slots[q], context, motion, tile)


@njit(**BARE)
def end_contacts(o, c, opened, with_plate, context, step, box, tile):
    """End the contacts opened[:o], of row c of the sums; return what friction and dashpots dissipated in them [J]."""
    partner, body_of, outer, forces = context.partner, context.body, context.outer, context.forces
    shift, friction, damped = np.int64(context.force_rows[c >> 1]), 0.0, 0.0
    for e in range(o, o + SPARE - 1 if o > 0 else o):
        opened[e] = opened[o - 1]  # padding for prefetching
    for t in range(0, o, TILE):
        n, total = min(TILE, o - t), 0.0
        if context.force >= 0 or context.dashpots >= 0:
            gather_tile(n + -n % 4, opened[t:], with_plate, context, step, box, tile)
        if context.force >= 0:
            book_opened(n, context, tile)
        if context.dashpots >= 0:
            damped += book_opened_dashpots(n, step.dt, context, tile)
        for e in range(n):
            k = np.int64(opened[t + e])
            saved = reset_history(k, context)
            lost = tile.outputs[e + law_output.DISSIPATED * TILE] if context.force >= 0 else saved
            total += lost
            if context.measured > 0:
                measure_opened(k, lost, context)
            fraction = lost if is_plate(partner[k]) else BODY_FRACTION * lost
            forces[body_of[context.own[k]] + shift, body_force.FRICTION_WORK] += fraction
            if outer[k] >= 0:
                context.F[outer[k], remote_force.FRICTION_WORK] = fraction
            elif is_sphere(partner[k]):
                forces[body_of[partner[k]] + shift, body_force.FRICTION_WORK] += fraction
        friction += total
    return friction, damped


@njit(**BARE)
def evaluate_laws(n, slots, with_plate, context, step, law, box, tile):
    I, behind, interacting = tile.inputs, law_input.HISTORY + context.n_history, with_plate and close_spots.interact(context)  # noqa: E741
    gather_tile(n, slots, with_plate, context, step, box, tile)
    if context.jumps != 0:  # the overlap that the contacts gained in the step, and one over its length
        for q in range(0, n, LANES):
            put(I, q + (behind + rolling_input.MOVED) * TILE, broadcast(-step.dt) * separation_rate(q, tile.geometry))
            put(I, q + (behind + rolling_input.INVERSE_DT) * TILE, broadcast(1.0 / step.dt if step.dt > 0.0 else 0.0))
    if interacting:
        close_spots.relieve(n, tile)
    law(tile.inputs, tile.outputs, n, context.pairs)
    if interacting:
        close_spots.restore(n, slots, context, tile)
        close_spots.add_interaction_energy(n, tile)
    if context.force >= 0:
        book(n, context, tile)
    if context.dashpots >= 0:
        book_dashpots(n, step.dt, context, tile)
    contact_geometry.force_and_torques(n, tile)
    if interacting:
        for q in range(n):
            tile.geometry[q + geometry.FORCE * TILE] += tile.geometry[q + geometry.PULL * TILE]
            tile.geometry[q + (geometry.FORCE + 1) * TILE] += tile.geometry[q + (geometry.PULL + 1) * TILE]
    if with_plate and plates.is_rough(context):
        contact_geometry.add_gradient_force(n, slots, context, tile)
    if rolling_kinematics.has_moments(context):
        rolling_kinematics.add_moments(n, context, tile)


@njit(**BARE)
def apply_tile(n, c, slots, with_plate, context, step, tile):
    O, sums = tile.outputs, context.sums  # noqa: E741
    if with_plate:
        scatter_plate_tile(n, c, slots, context, tile)
    else:
        scatter_pair_tile(n, c, slots, context, tile)
    if context.loss_column >= 0:
        add_normal_losses(n, slots, context, tile)
    store_history(n, slots, context, tile)
    for q in range(n if context.measured > 0 else 0):
        measure_contact(q, slots[q], step.dt, context, tile)
    if step.record:
        for q in range(n):
            sums[c, contact_sums.STORED_NORMAL] += O[q + law_output.STORED_NORMAL * TILE]
            sums[c, contact_sums.STORED_TANGENTIAL] += O[q + law_output.STORED_TANGENTIAL * TILE]
        for q in range(n if context.R.shape[0] > 0 else 0):
            write_record(q, slots[q], context, step, tile)


@njit(**BARE_CHUNK)
def contact_forces(group, side, part, context, step, law):
    """Apply the candidates of a group, with plates (`side` WITH_PLATE) or between spheres; `part`: row of scratch."""
    c, with_plate, box, cuts, sums = 2 * group + side, side == WITH_PLATE, box_of(context.D), context.cuts, context.sums
    first, last = cuts[side, group * GROUP], cuts[side, min((group + 1) * GROUP, cuts.shape[1] - 1)]
    numbers, marks = context.scratch[part], context.marks[part]
    begin = (law_input.HISTORY + context.n_history + rolling_input.WIDTH) * TILE
    end = begin + (law_output.HISTORY + context.n_history + rolling_output.WIDTH) * TILE
    after = end + geometry.WIDTH * TILE
    tile, gaps = Tile(numbers[:begin], numbers[begin:end], numbers[:0], numbers[end:after]), numbers[after:]
    slots, opened = marks[: last - first + SPARE], marks[last - first + SPARE :]
    if with_plate and plates.is_rough(context):
        update_surfaces(first, last, context)
        m, o = compact_rough(first, last, context, box.reach, slots, opened)
    else:
        if with_plate:
            for k in range(first, last):
                gaps[k - first] = plates.overlap(k, context) + box.reach
        else:
            squares_within_reach(first, last, context, box, gaps)
        m, o = compact_active(first, last, gaps, context.closed, slots, opened)
    sums[c, contact_sums.STORED_NORMAL] = sums[c, contact_sums.STORED_TANGENTIAL] = 0.0
    store(sums, c, contact_sums.UPPER_FORCE, broadcast(0.0))
    store(sums, c, contact_sums.LOWER_FORCE, broadcast(0.0))
    lost, damped = end_contacts(o, c, opened, with_plate, context, step, box, tile)
    sums_of_tile = broadcast(0.0), broadcast(0.0), 0.0, np.int64(0), np.int64(0)
    # the overlaps no longer need their scratch
    n = (gaps.shape[0] - close_spots.lane.WIDTH * close_spots.LANES) // (close_spots.FIELDS + close_spots.spot.WIDTH)
    spots = close_spots.Spots(gaps[:n], gaps[n : 2 * n], gaps[2 * n : 3 * n], gaps[3 * n : 4 * n], gaps[4 * n :])
    if with_plate and close_spots.interact(context):
        close_spots.solve_bodies(m, slots, context, spots)
    for t in range(0, m, TILE):
        count, here = min(TILE, m - t), slots[t:]
        filled = contact_geometry.padded(count, context.n_history)  # with the last contact
        for q in range(filled if with_plate and close_spots.interact(context) else 0):
            e, G = t + min(q, count - 1), tile.geometry
            G[q + geometry.RELIEF * TILE], G[q + geometry.SPOT_FORCE * TILE] = spots.relief[e], spots.force[e]
            G[q + geometry.PULL * TILE], G[q + (geometry.PULL + 1) * TILE] = spots.pull_x[e], spots.pull_y[e]
        evaluate_laws(filled, here, with_plate, context, step, law, box, tile)
        sums_of_tile = reduce_tile(count, here, tile, sums_of_tile)
        apply_tile(count, c, here, with_plate, context, step, tile)
    work, dissipated, sums[c, contact_sums.MAX_OVERLAP], sums[c, contact_sums.SLOT], sums[c, contact_sums.BAD_SLOT] = sums_of_tile
    sums[c, contact_sums.FRICTION_WORK] = lost + ((extract(work, 0) + extract(work, 1)) + (extract(work, 2) + extract(work, 3)))
    work = dissipated
    sums[c, contact_sums.DAMPING_WORK] = damped + ((extract(work, 0) + extract(work, 1)) + (extract(work, 2) + extract(work, 3)))
