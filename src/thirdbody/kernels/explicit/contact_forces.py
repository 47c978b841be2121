"""The contact pass: candidates -> overlaps -> tiles of the laws -> forces on bodies, group by group.

A group is a fixed range of bodies, whatever the number of threads, with the candidates that its spheres own. It writes only to
its own candidates, forces on its bodies (`body_force`) and row of `sums`; its contacts' forces on bodies of other groups
go to F, and those groups add them in a fixed order. So the result has the same bits for any number of threads. Mispredicted
branches cost more than all arithmetic, so overlaps are computed for all candidates first, and active ones are listed without one.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import (
    LANES,
    LINE,
    all_below,
    broadcast,
    cross,
    extract,
    get,
    less_mask,
    load,
    select_greater,
    store,
    transpose,
    with_last,
)
from thirdbody.kernels import close_spots, plates
from thirdbody.kernels.arguments import Tile
from thirdbody.kernels.bodies import WITH_PLATE, arm_to_sphere
from thirdbody.kernels.books import add_normal_losses, book, book_dashpots, book_opened, book_opened_dashpots
from thirdbody.kernels.contact_geometry import SPARE, add_gradient_force, force_and_torques, padded
from thirdbody.kernels.explicit.tables import contact_sums
from thirdbody.kernels.explicit.tiles import (
    BODY_FRACTION,
    add_force,
    end_contacts,
    gather_moved,
    gather_tile,
    shift_of,
    store_remote_force,
)
from thirdbody.kernels.measures import measure_tile
from thirdbody.kernels.memory import store_history
from thirdbody.kernels.minima import update_surfaces
from thirdbody.kernels.narrow_phase import compact_active, compact_rough, pair_overlaps, plate_overlaps
from thirdbody.kernels.plates import is_lower, is_sphere, partner_velocity, surface_velocity
from thirdbody.kernels.rolling_kinematics import add_moments, add_twist_moments, has_moments, has_twist, record_rolling
from thirdbody.kernels.spot_loads import solve_bodies
from thirdbody.kernels.tables import body_extra, record, sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output, rolling_input, rolling_output
from thirdbody.kernels.vectors import box_of

GROUP = 8
"""Chunks of bodies per group. The data of a group stay in the near cache until it is done: 16 take as long, 4 take 5 to 8 %
longer, since more contacts are between groups."""

LARGEST = 1e300
"""Bound of the square of a force [N2]; no force reaches it."""


def scratch_sizes(n_history, longest, interaction=False):
    """Return the scratch of a thread for at most `longest` candidates: numbers of floats and integers.

    Whole cache lines: loading a vector of eight that straddles two lines costs twice the time.
    """
    fields = law_input.HISTORY + law_output.HISTORY + 2 * n_history + rolling_input.WIDTH + rolling_output.WIDTH + geometry.WIDTH
    whole = longest + -longest % LINE
    return fields * TILE + (close_spots.scratch_of(whole) if interaction else whole), 2 * (longest + SPARE)


@njit(**BARE)
def scatter_plate_force(k, c, context, force, torque):
    """Apply a contact with a plate to its body; `torque`: about the centre of the sphere [N m]."""
    i, sums, shift = np.uint64(context.own[k]), context.sums, shift_of(c >> 1, context)
    b = np.uint64(context.body[i])
    add_force(b + np.uint64(shift), context.forces, force, torque + cross(arm_to_sphere(i, context.S), force))
    low, alone = is_lower(context.partner[k]), with_last(force, broadcast(0.0))
    total = np.int64(contact_sums.LOWER_FORCE) if low else np.int64(contact_sums.UPPER_FORCE)
    context.E[b, body_extra.UPPER_PUSH] += 0.0 if low else extract(force, 2)
    store(sums, c, total, load(sums, c, total) + alone)


@njit(**BARE)
def scatter_pair_force(k, shift, context, force, torque, back):
    """Apply a contact between spheres to both bodies. `torque`, `back`: about the centres of owner and partner [N m]."""
    i, j, S, B = np.uint64(context.own[k]), np.uint64(context.partner[k]), context.S, context.B
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
        store_remote_force(context.outer[k], against, back, context.F)


@njit(**BARE)
def four_rows(at, G, last):
    """Return three fields of four contacts as four rows, each followed by its element of `last`."""
    return transpose(get(G, at), get(G, at + TILE), get(G, at + 2 * TILE), last)


@njit(**BARE_CHUNK)
def scatter_plate_tile(n, c, slots, context, tile):
    """Apply the contacts with plates slots[:n] to their bodies; add their forces to row c of the sums."""
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
    """Apply the contacts between spheres slots[:n], of the row c of the sums, to their bodies."""
    O, G, shift = tile.outputs, tile.geometry, np.uint64(shift_of(c >> 1, context))  # noqa: E741
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
def clear_sums(c, sums):
    """Reset the sums in row c to which tiles add."""
    sums[c, contact_sums.STORED_NORMAL] = sums[c, contact_sums.STORED_TANGENTIAL] = 0.0
    store(sums, c, contact_sums.UPPER_FORCE, broadcast(0.0))
    store(sums, c, contact_sums.LOWER_FORCE, broadcast(0.0))


@njit(**BARE)
def empty_sums():
    """Return the reductions (`reduce_tile`) of no contacts."""
    return broadcast(0.0), broadcast(0.0), 0.0, np.int64(0), np.int64(0)


@njit(**BARE)
def reduce_tile(m, slots, tile, sums_of_tile):
    """Add a tile of m contacts, slots[:m], to the reductions of a group.

    These are the dissipation of friction and of dashpots, in four lanes; the largest overlap over the smaller radius, with its
    candidate; the last candidate whose force is not finite (+ 1; 0: none).
    """
    I, O, G = tile.inputs, tile.outputs, tile.geometry  # noqa: E741
    work, damped, max_overlap, slot, bad = sums_of_tile
    zero_padding(m, tile)
    for q in range(0, m, LANES):
        work, damped = work + get(O, q + law_output.DISSIPATED * TILE), damped + get(O, q + law_output.DASHPOT_POWER * TILE)
        r_i, r_j = get(G, q + geometry.RADIUS * TILE), get(G, q + geometry.PARTNER_RADIUS * TILE)
        if (
            less_mask(broadcast(max_overlap) * select_greater(r_i, r_j, r_j, r_i), get(I, q + law_input.OVERLAP * TILE)) != 0
        ):  # few are the deepest
            max_overlap, slot = larger_overlap(q, min(q + LANES, m), slots, tile, max_overlap, slot)
        x = get(G, q + geometry.FORCE * TILE)
        y = get(G, q + (geometry.FORCE + 1) * TILE)
        z = get(G, q + (geometry.FORCE + 2) * TILE)
        if not all_below(x * x + y * y + z * z, LARGEST):
            bad = last_nonfinite(q, min(q + LANES, m), slots, G, bad)
    return work, damped, max_overlap, slot, bad


@njit(**BARE)
def zero_padding(m, tile):
    """Zero the padding lanes after contact m so that they do not affect the reductions."""
    I, O, G = tile.inputs, tile.outputs, tile.geometry  # noqa: E741
    for q in range(m, m + -m % LANES):
        O[q + law_output.DISSIPATED * TILE] = O[q + law_output.DASHPOT_POWER * TILE] = I[q + law_input.OVERLAP * TILE] = 0.0
        G[q + geometry.FORCE * TILE] = G[q + (geometry.FORCE + 1) * TILE] = G[q + (geometry.FORCE + 2) * TILE] = 0.0


@njit(**BARE_CHUNK)
def larger_overlap(q, end, slots, tile, max_overlap, slot):
    """Return the larger of `max_overlap` and the overlaps over radius of elements q to `end`, with its candidate."""
    I, G = tile.inputs, tile.geometry  # noqa: E741
    for e in range(q, end):
        ratio = I[e + law_input.OVERLAP * TILE] / min(G[e + geometry.RADIUS * TILE], G[e + geometry.PARTNER_RADIUS * TILE])
        max_overlap, slot = (ratio, np.int64(slots[e])) if ratio > max_overlap else (max_overlap, slot)
    return max_overlap, slot


@njit(**BARE_CHUNK)
def last_nonfinite(q, end, slots, G, bad):
    """Return the last candidate in elements q to `end` whose force is not finite (+ 1), or `bad`."""
    for e in range(q, end):
        x, y, z = G[e + geometry.FORCE * TILE], G[e + (geometry.FORCE + 1) * TILE], G[e + (geometry.FORCE + 2) * TILE]
        bad = bad if x * x + y * y + z * z < LARGEST else np.int64(slots[e]) + 1
    return bad


@njit(**BARE)
def sum_of_lanes(v):
    """Return the sum of the four lanes of v."""
    return (extract(v, 0) + extract(v, 1)) + (extract(v, 2) + extract(v, 3))


@njit(**BARE)
def store_sums(c, lost, damped, sums_of_tile, sums):
    """Write the reductions of a group into row c. `lost`, `damped`: losses of contacts that opened [J]."""
    work, dissipated, sums[c, contact_sums.MAX_OVERLAP], sums[c, contact_sums.SLOT], sums[c, contact_sums.BAD_SLOT] = sums_of_tile
    sums[c, contact_sums.FRICTION_WORK] = lost + sum_of_lanes(work)
    sums[c, contact_sums.DAMPING_WORK] = damped + sum_of_lanes(dissipated)


@njit(**BARE_CHUNK)
def add_elastic_energy(n, c, O, sums):  # noqa: E741
    """Add the elastic energy of n contacts, normal and tangential, to row c."""
    for q in range(n):
        sums[c, contact_sums.STORED_NORMAL] += O[q + law_output.STORED_NORMAL * TILE]
        sums[c, contact_sums.STORED_TANGENTIAL] += O[q + law_output.STORED_TANGENTIAL * TILE]


@njit(**BARE)
def first_three(v):
    """Return the first three numbers of v."""
    return extract(v, 0), extract(v, 1), extract(v, 2)


@njit(**BARE)
def write_points(q, k, context, motion, G):
    """Write contact point, normal, curvatures and velocities of both surfaces at a contact into its record."""
    i, j, S, R = context.own[k], context.partner[k], context.S, context.R
    a_i, a_j = G[q + geometry.ARM * TILE], G[q + geometry.PARTNER_ARM * TILE]
    n = (G[q + geometry.NORMAL * TILE], G[q + (geometry.NORMAL + 1) * TILE], G[q + (geometry.NORMAL + 2) * TILE])
    # of a plate the owner's row, which exists: of all spheres an ensemble has those of one batch
    arm, arm_j = first_three(arm_to_sphere(i, S)), first_three(arm_to_sphere(j if is_sphere(j) else i, S))
    for d in range(3):
        R[k, record.POINT + d] = arm[d] - a_i * n[d]
        R[k, record.PARTNER_POINT + d] = arm_j[d] + a_j * n[d] if is_sphere(j) else 0.0
        R[k, record.NORMAL + d] = n[d]
    R[k, record.SPHERE_RADIUS], R[k, record.PARTNER_RADIUS] = S[i, sphere.RADIUS], partner_radius(k, context)
    columns = np.int64(sphere.END_VELOCITY), np.int64(sphere.END_SPIN)
    a = surface_velocity(i, S, columns, (-a_i * n[0], -a_i * n[1], -a_i * n[2]))
    b = partner_velocity(j, context, columns, (a_j * n[0], a_j * n[1], a_j * n[2]), motion)
    R[k, record.SURFACE_VELOCITY], R[k, record.SURFACE_VELOCITY + 1], R[k, record.SURFACE_VELOCITY + 2] = a
    R[k, record.PARTNER_VELOCITY], R[k, record.PARTNER_VELOCITY + 1], R[k, record.PARTNER_VELOCITY + 2] = b


@njit(**BARE)
def partner_radius(k, context):
    """Return the radius of curvature of the partner at contact k [m]; 0: flat."""
    j = context.partner[k]
    return context.S[j, sphere.RADIUS] if is_sphere(j) else plates.radius_of_curvature(k, context)


@njit(**BARE_CHUNK)
def write_record(q, k, context, motion, tile):
    """Write all quantities of a contact that output and labels need, as the step computed them."""
    I, O, G, R = tile.inputs, tile.outputs, tile.geometry, context.R  # noqa: E741
    write_points(q, k, context, motion, G)
    t_1, t_2 = O[q + law_output.TANGENTIAL_X * TILE], O[q + law_output.TANGENTIAL_Y * TILE]
    for d in range(3):
        along = t_1 * G[q + (geometry.AXIS + d) * TILE] + t_2 * G[q + (geometry.CROSS_AXIS + d) * TILE]
        R[k, record.TANGENTIAL_FORCE + d] = along
    R[k, record.CONTACT_RADIUS] = O[q + law_output.CONTACT_RADIUS * TILE]
    R[k, record.PEAK_PRESSURE] = O[q + law_output.PEAK_PRESSURE * TILE]
    R[k, record.OVERLAP] = I[q + law_input.OVERLAP * TILE]
    R[k, record.NORMAL_FORCE], R[k, record.LOAD] = O[q + law_output.NORMAL_FORCE * TILE], O[q + law_output.LOAD * TILE]
    R[k, record.FRICTION_LIMIT] = O[q + law_output.FRICTION_LIMIT * TILE]
    R[k, record.CRITICAL_SLIP] = O[q + law_output.CRITICAL_SLIP * TILE]
    R[k, record.STORED_NORMAL] = O[q + law_output.STORED_NORMAL * TILE]
    R[k, record.STORED_TANGENTIAL] = O[q + law_output.STORED_TANGENTIAL * TILE]
    R[k, record.EFFECTIVE_RADIUS] = I[q + law_input.RADIUS * TILE]
    if has_moments(context):
        record_rolling(q, k, context, tile)


@njit(**BARE)
def split_scratch(scratch, n_history):
    """Return a tile for laws with so many numbers of history, and what is left of the scratch `scratch`, for overlaps."""
    begin = (law_input.HISTORY + n_history + rolling_input.WIDTH) * TILE
    end = (law_input.HISTORY + law_output.HISTORY + 2 * n_history + rolling_input.WIDTH + rolling_output.WIDTH) * TILE
    gaps = end + geometry.WIDTH * TILE
    return Tile(scratch[:begin], scratch[begin:end], scratch[:0], scratch[end:gaps]), scratch[gaps:]


@njit(**BARE)
def book_losses(n, c, opened, flat, context, step, box, tile):
    """End the contacts opened[:n] of row c of the sums; return what friction and dashpots dissipated in them [J]."""
    damped = 0.0
    if context.force >= 0 or context.dashpots >= 0:
        gather_tile(n + -n % 4, opened, flat, context, step, box, tile)
    if context.force >= 0:
        book_opened(n, context, tile)
    if context.dashpots >= 0:
        damped = book_opened_dashpots(n, step.dt, context, tile)
    return end_contacts(n, shift_of(c >> 1, context), opened, context, tile), damped


@njit(**BARE)
def evaluate_laws(n, slots, flat, context, step, law, box, tile):
    """Gather contacts slots[:n] into a tile, evaluate the laws, and compute energies, forces and torques."""
    gather_tile(n, slots, flat, context, step, box, tile)
    if context.jumps != 0:
        gather_moved(n, step.dt, context, tile)
    if flat and close_spots.interact(context):
        close_spots.relieve(n, tile)
    law(tile.inputs, tile.outputs, n, context.pairs)
    if flat and close_spots.interact(context):
        close_spots.restore(n, tile)
        close_spots.add_interaction_energy(n, tile)
    if context.force >= 0:
        book(n, context, tile)
    if context.dashpots >= 0:
        book_dashpots(n, step.dt, context, tile)
    force_and_torques(n, tile)
    if flat and close_spots.interact(context):
        close_spots.add_pull(n, tile)
    if flat and plates.is_rough(context):
        add_gradient_force(n, slots, context, tile)
    if has_moments(context):
        add_moments(n, context.n_history, tile)
    if has_twist(context):
        add_twist_moments(n, context.n_history, tile)


@njit(**BARE)
def apply_tile(n, c, slots, flat, context, step, tile):
    """Apply the contacts slots[:n] to their bodies, store their history, and record them where output needs it."""
    if flat:
        scatter_plate_tile(n, c, slots, context, tile)
    else:
        scatter_pair_tile(n, c, slots, context, tile)
    if context.loss_column >= 0:
        add_normal_losses(n, slots, context, tile)
    store_history(n, slots, context, tile)
    if context.measured > 0:
        measure_tile(n, slots, step.dt, context, tile)
    if step.record:
        add_elastic_energy(n, c, tile.outputs, context.sums)
        for q in range(n if context.R.shape[0] > 0 else 0):
            write_record(q, slots[q], context, step, tile)


@njit(**BARE_CHUNK)
def contact_forces(group, side, part, context, step, law):
    """Apply the candidates of a group, with plates (`side` WITH_PLATE) or between spheres, to their bodies, in tiles.

    Sums go to row 2 `group` + `side`. `part`: row of the scratch tables.
    """
    c, flat, box, cuts = 2 * group + side, side == WITH_PLATE, box_of(context.D), context.cuts
    first, last = cuts[side, group * GROUP], cuts[side, min((group + 1) * GROUP, cuts.shape[1] - 1)]
    (tile, gaps), marks = split_scratch(context.scratch[part], context.n_history), context.marks[part]
    slots, opened = marks[: last - first + SPARE], marks[last - first + SPARE :]
    if flat and plates.is_rough(context):
        update_surfaces(first, last, context)
        m, o = compact_rough(first, last, context, box.reach, slots, opened)
    else:
        if flat:
            plate_overlaps(first, last, context, box, gaps)
        else:
            pair_overlaps(first, last, context, box, gaps)
        m, o = compact_active(first, last, gaps, context.closed, slots, opened)
    clear_sums(c, context.sums)
    lost, damped, sums_of_tile = 0.0, 0.0, empty_sums()
    for e in range(o, o + SPARE - 1 if o > 0 else o):
        opened[e] = opened[o - 1]  # padding for prefetching
    for t in range(0, o, TILE):
        losses = book_losses(min(TILE, o - t), c, opened[t:], flat, context, step, box, tile)
        lost, damped = lost + losses[0], damped + losses[1]
    spots = close_spots.spots_in(gaps)
    if flat and close_spots.interact(context):
        solve_bodies(m, slots, context, spots)
    for t in range(0, m, TILE):
        count, here = min(TILE, m - t), slots[t:]
        filled = padded(count, context.n_history)  # with the last contact
        if flat and close_spots.interact(context):
            close_spots.place_spots(t, count, filled, spots, tile.geometry)
        evaluate_laws(filled, here, flat, context, step, law, box, tile)
        sums_of_tile = reduce_tile(count, here, tile, sums_of_tile)
        apply_tile(count, c, here, flat, context, step, tile)
    store_sums(c, lost, damped, sums_of_tile, context.sums)
