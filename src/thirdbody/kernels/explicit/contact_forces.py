"""The contact pass: candidates -> overlaps -> tiles of the laws -> forces on bodies, group by group.

A group is a fixed range of bodies, whatever the number of threads, with the candidates that its spheres own. It writes only to
its own candidates, bodies and row of `sums`; its contacts' forces on bodies of other groups go to F, and those groups add them in
a fixed order. So the result has the same bits for any number of threads. Mispredicted branches cost more than all arithmetic, so
overlaps are computed for all candidates first, and the active ones are listed without a branch.
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
from thirdbody.kernels.columns import (
    body,
    body_extra,
    contact_sums,
    geometry,
    law_input,
    law_output,
    record,
    rolling_input,
    rolling_output,
    sphere,
)
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.contact_geometry import SPARE, force_and_torques
from thirdbody.kernels.contact_history import store_history
from thirdbody.kernels.explicit.contact_dissipation import book, book_dashpots, book_opened, book_opened_dashpots
from thirdbody.kernels.explicit.contact_tiles import SHARE, end_contacts, gather_tile, store_remote_force
from thirdbody.kernels.narrow_phase import compact_active, pair_overlaps, plate_overlaps
from thirdbody.kernels.periodic import inverse
from thirdbody.kernels.predicates import is_lower, is_sphere
from thirdbody.kernels.rigid_body import arm_to_sphere
from thirdbody.kernels.rolling_kinematics import MOMENTS, add_moments, record_rolling
from thirdbody.kernels.surface_velocity import partner_velocity, surface_velocity

GROUP = 8
"""Chunks of bodies per group. The data of a group stay in the near cache until it is done: 16 take as long, 4 take 5 to 8 %
longer, since more contacts are between groups."""

LIGHT = 16
"""Largest history of a light law. Its cost per vector of eight is that of one contact, so its tiles are padded to whole vectors
(63 contacts cost half as much again as 64); the cost of other laws is per contact."""

LARGEST = 1e300
"""Bound of the square of a force [N2]; no force reaches it."""


def scratch_sizes(n_history, longest):
    """Return the scratch of a thread for at most `longest` candidates: numbers of floats and integers.

    Whole cache lines: loading a vector of eight that straddles two lines costs twice the time.
    """
    fields = law_input.HISTORY + law_output.HISTORY + 2 * n_history + rolling_input.WIDTH + rolling_output.WIDTH + geometry.WIDTH
    return fields * TILE + longest + -longest % LINE, 2 * (longest + SPARE)


@njit(**BARE)
def add_force(b, B, force, torque):
    """Add a force (4th lane: friction work) and a torque (4th lane: slip) to those on body b."""
    store(B, b, body.FORCE, load(B, b, body.FORCE) + force)
    store(B, b, body.TORQUE, load(B, b, body.TORQUE) + torque)


@njit(**BARE)
def scatter_plate_force(k, c, own, partner, body, S, B, E, sums, force, torque):
    """Apply a contact with a plate to its body; `torque`: about the centre of the sphere [N m]."""
    i = np.uint64(own[k])
    b = np.uint64(body[i])
    add_force(b, B, force, torque + cross(arm_to_sphere(i, S), force))
    low, alone = is_lower(partner[k]), with_last(force, broadcast(0.0))
    total = np.int64(contact_sums.LOWER_FORCE) if low else np.int64(contact_sums.UPPER_FORCE)
    E[b, body_extra.UPPER_PUSH] += 0.0 if low else extract(force, 2)
    store(sums, c, total, load(sums, c, total) + alone)


@njit(**BARE)
def scatter_pair_force(k, own, partner, body, outer, clumps, S, B, F, force, torque, back):
    """Apply a contact between spheres to both bodies. `torque`, `back`: about the centres of owner and partner [N m]."""
    i, j = np.uint64(own[k]), np.uint64(partner[k])
    against = with_last(broadcast(0.0) - force, force)
    b, p = i, j
    if clumps:
        b, p = np.uint64(body[i]), np.uint64(body[j])
        torque = torque + cross(arm_to_sphere(i, S), force)
        back = back + cross(arm_to_sphere(j, S), against)
    add_force(b, B, force, torque)
    if outer[k] < 0:
        add_force(p, B, against, back)
    else:
        store_remote_force(outer[k], against, back, F)


@njit(**BARE)
def four_rows(at, G, last):
    """Return three fields of four contacts as four rows, each followed by its element of `last`."""
    return transpose(get(G, at), get(G, at + TILE), get(G, at + 2 * TILE), last)


@njit(**BARE_CHUNK)
def scatter_plate_tile(n, c, slots, first, own, partner, body, S, O, G, B, E, sums):  # noqa: E741
    """Apply n contacts with plates, slots[first:first + n], to their bodies; add their forces to row c of `sums`."""
    for q in range(0, n, 4):
        work, slip = get(O, q + law_output.DISSIPATED * TILE), get(O, q + law_output.SLIP * TILE)
        p, f, t = first + q, four_rows(q + geometry.FORCE * TILE, G, work), four_rows(q + geometry.TORQUE * TILE, G, slip)
        scatter_plate_force(np.uint64(slots[p]), c, own, partner, body, S, B, E, sums, f[0], t[0])
        if q + 1 < n:
            scatter_plate_force(np.uint64(slots[p + 1]), c, own, partner, body, S, B, E, sums, f[1], t[1])
        if q + 2 < n:
            scatter_plate_force(np.uint64(slots[p + 2]), c, own, partner, body, S, B, E, sums, f[2], t[2])
        if q + 3 < n:
            scatter_plate_force(np.uint64(slots[p + 3]), c, own, partner, body, S, B, E, sums, f[3], t[3])


@njit(**BARE_CHUNK)
def scatter_pair_tile(n, slots, first, own, partner, body, outer, S, O, G, B, F):  # noqa: E741
    """Apply n contacts between spheres, slots[first:first + n], to their bodies."""
    clumps = S.shape[0] != B.shape[0]
    for q in range(0, n, 4):
        work, slip = broadcast(SHARE) * get(O, q + law_output.DISSIPATED * TILE), get(O, q + law_output.SLIP * TILE)
        p, f = first + q, four_rows(q + geometry.FORCE * TILE, G, work)
        t, w = four_rows(q + geometry.TORQUE * TILE, G, slip), four_rows(q + geometry.PARTNER_TORQUE * TILE, G, slip)
        scatter_pair_force(np.uint64(slots[p]), own, partner, body, outer, clumps, S, B, F, f[0], t[0], w[0])
        if q + 1 < n:
            scatter_pair_force(np.uint64(slots[p + 1]), own, partner, body, outer, clumps, S, B, F, f[1], t[1], w[1])
        if q + 2 < n:
            scatter_pair_force(np.uint64(slots[p + 2]), own, partner, body, outer, clumps, S, B, F, f[2], t[2], w[2])
        if q + 3 < n:
            scatter_pair_force(np.uint64(slots[p + 3]), own, partner, body, outer, clumps, S, B, F, f[3], t[3], w[3])


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
def reduce_tile(m, slots, first, O, I, G, sums_of_tile):  # noqa: E741
    """Add a tile of m contacts, slots[first:first + m], to the reductions of a group.

    These are the dissipation of friction and of dashpots, in four lanes; the largest overlap over the smaller radius, with its
    candidate; the last candidate whose force is not finite (+ 1; 0: none).
    """
    work, damped, deepest, slot, bad = sums_of_tile
    zero_padding(m, O, I, G)
    for q in range(0, m, LANES):
        work, damped = work + get(O, q + law_output.DISSIPATED * TILE), damped + get(O, q + law_output.DASHPOT_POWER * TILE)
        r_i, r_j = get(G, q + geometry.RADIUS * TILE), get(G, q + geometry.PARTNER_RADIUS * TILE)
        if (
            less_mask(broadcast(deepest) * select_greater(r_i, r_j, r_j, r_i), get(I, q + law_input.OVERLAP * TILE)) != 0
        ):  # few are the deepest
            deepest, slot = larger_overlap(q, min(q + LANES, m), slots, first, I, G, deepest, slot)
        x = get(G, q + geometry.FORCE * TILE)
        y = get(G, q + (geometry.FORCE + 1) * TILE)
        z = get(G, q + (geometry.FORCE + 2) * TILE)
        if not all_below(x * x + y * y + z * z, LARGEST):
            bad = last_nonfinite(q, min(q + LANES, m), slots, first, G, bad)
    return work, damped, deepest, slot, bad


@njit(**BARE)
def zero_padding(m, O, I, G):  # noqa: E741
    """Zero the padding lanes after contact m so that they do not affect the reductions."""
    for q in range(m, m + -m % LANES):
        O[q + law_output.DISSIPATED * TILE] = O[q + law_output.DASHPOT_POWER * TILE] = I[q + law_input.OVERLAP * TILE] = 0.0
        G[q + geometry.FORCE * TILE] = G[q + (geometry.FORCE + 1) * TILE] = G[q + (geometry.FORCE + 2) * TILE] = 0.0


@njit(**BARE_CHUNK)
def larger_overlap(q, end, slots, first, I, G, deepest, slot):  # noqa: E741
    """Return the larger of `deepest` and the overlaps over radius of elements q to `end`, with its candidate."""
    for e in range(q, end):
        ratio = I[e + law_input.OVERLAP * TILE] / min(G[e + geometry.RADIUS * TILE], G[e + geometry.PARTNER_RADIUS * TILE])
        deepest, slot = (ratio, np.int64(slots[first + e])) if ratio > deepest else (deepest, slot)
    return deepest, slot


@njit(**BARE_CHUNK)
def last_nonfinite(q, end, slots, first, G, bad):
    """Return the last candidate in elements q to `end` whose force is not finite (+ 1), or `bad`."""
    for e in range(q, end):
        x, y, z = G[e + geometry.FORCE * TILE], G[e + (geometry.FORCE + 1) * TILE], G[e + (geometry.FORCE + 2) * TILE]
        bad = bad if x * x + y * y + z * z < LARGEST else np.int64(slots[first + e]) + 1
    return bad


@njit(**BARE)
def sum_of_lanes(v):
    """Return the sum of the four lanes of v."""
    return (extract(v, 0) + extract(v, 1)) + (extract(v, 2) + extract(v, 3))


@njit(**BARE)
def store_sums(c, lost, damped, sums_of_tile, sums):
    """Write the reductions of a group into row c. `lost`, `damped`: losses of contacts that opened [J]."""
    work, taken, sums[c, contact_sums.MAX_OVERLAP], sums[c, contact_sums.SLOT], sums[c, contact_sums.BAD_SLOT] = sums_of_tile
    sums[c, contact_sums.FRICTION_WORK] = lost + sum_of_lanes(work)
    sums[c, contact_sums.DAMPING_WORK] = damped + sum_of_lanes(taken)


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


@njit(**BARE_CHUNK)
def write_record(q, k, I, O, G, own, partner, S, P, R, v_x, v_y):  # noqa: E741
    """Write all quantities of a contact that output and labels need, as the step computed them."""
    i, j = own[k], partner[k]
    a_i, a_j = G[q + geometry.ARM * TILE], G[q + geometry.PARTNER_ARM * TILE]
    t_1, t_2 = O[q + law_output.TANGENTIAL_X * TILE], O[q + law_output.TANGENTIAL_Y * TILE]
    n = (G[q + geometry.NORMAL * TILE], G[q + (geometry.NORMAL + 1) * TILE], G[q + (geometry.NORMAL + 2) * TILE])
    arm, arm_j = first_three(arm_to_sphere(i, S)), first_three(arm_to_sphere(max(j, 0), S))
    for d in range(3):
        R[k, record.POINT + d] = arm[d] - a_i * n[d]
        R[k, record.PARTNER_POINT + d] = arm_j[d] + a_j * n[d] if is_sphere(j) else 0.0
        R[k, record.NORMAL + d] = n[d]
        R[k, record.TANGENTIAL_FORCE + d] = (
            t_1 * G[q + (geometry.AXIS + d) * TILE] + t_2 * G[q + (geometry.CROSS_AXIS + d) * TILE]
        )
    R[k, record.CURVATURE], R[k, record.PARTNER_CURVATURE] = S[i, sphere.RADIUS], S[j, sphere.RADIUS] if is_sphere(j) else 0.0
    R[k, record.CONTACT_RADIUS] = O[q + law_output.CONTACT_RADIUS * TILE]
    R[k, record.OVERLAP] = I[q + law_input.OVERLAP * TILE]
    R[k, record.NORMAL_FORCE], R[k, record.LOAD] = O[q + law_output.NORMAL_FORCE * TILE], O[q + law_output.LOAD * TILE]
    R[k, record.FRICTION_LIMIT] = O[q + law_output.FRICTION_LIMIT * TILE]
    R[k, record.CRITICAL_SLIP] = O[q + law_output.CRITICAL_SLIP * TILE]
    R[k, record.STORED_NORMAL] = O[q + law_output.STORED_NORMAL * TILE]
    R[k, record.STORED_TANGENTIAL] = O[q + law_output.STORED_TANGENTIAL * TILE]
    R[k, record.EFFECTIVE_RADIUS] = I[q + law_input.RADIUS * TILE]
    a = surface_velocity(S, i, np.int64(sphere.END_VELOCITY), np.int64(sphere.END_SPIN), -a_i * n[0], -a_i * n[1], -a_i * n[2])
    b = partner_velocity(
        S, P, j, np.int64(sphere.END_VELOCITY), np.int64(sphere.END_SPIN), a_j * n[0], a_j * n[1], a_j * n[2], v_x, v_y
    )
    R[k, record.SURFACE_VELOCITY], R[k, record.SURFACE_VELOCITY + 1], R[k, record.SURFACE_VELOCITY + 2] = a
    R[k, record.PARTNER_VELOCITY], R[k, record.PARTNER_VELOCITY + 1], R[k, record.PARTNER_VELOCITY + 2] = b


@njit(**BARE_CHUNK)
def contact_forces(c, first, last, flat, own, partner, kind, closed, outer, body, S, B, E, P, H, F, R, sums, law, pairs, dt,
                  v_x, v_y, l_x, l_y, n_history, rolling, force, moment, stored, dashpots, observed, scratch, marks):  # fmt: skip
    """Apply candidates `first` to `last` to their bodies: overlaps, then the laws in tiles; sums into row c.

    `flat`: all are candidates with plates; else all are between spheres. `scratch`, `marks`: scratch (`scratch_sizes`).
    """
    begin = (law_input.HISTORY + n_history + rolling_input.WIDTH) * TILE
    end = (law_input.HISTORY + law_output.HISTORY + 2 * n_history + rolling_input.WIDTH + rolling_output.WIDTH) * TILE
    gaps = end + geometry.WIDTH * TILE
    I, O, G, g = scratch[:begin], scratch[begin:end], scratch[end:gaps], scratch[gaps:]  # noqa: E741
    slots, opened = marks[: last - first + SPARE], marks[last - first + SPARE :]
    if flat:
        plate_overlaps(first, last, own, partner, S, P, g)
    else:
        pair_overlaps(first, last, own, partner, S, l_x, l_y, inverse(l_x), inverse(l_y), g)
    m, o = compact_active(first, last, g, closed, slots, opened)
    clear_sums(c, sums)
    lost, damped, sums_of_tile = 0.0, 0.0, empty_sums()
    for e in range(o, o + SPARE - 1 if o > 0 else o):
        opened[e] = opened[o - 1]  # padding for prefetching
    for t in range(0, o, TILE):
        count = min(TILE, o - t)
        if force >= 0 or dashpots >= 0:
            gather_tile(
                count + -count % 4, opened, t, flat, g, first, own, partner, body, kind, S, B, P, H, dt, v_x, v_y, l_x, l_y,
                n_history, rolling, I, G,
            )  # fmt: skip
        if force >= 0:
            book_opened(count, force, moment, stored, n_history, I, O)
        if dashpots >= 0:
            damped += book_opened_dashpots(count, dashpots, n_history, dt, I, O, G)
        lost += end_contacts(count, opened, t, force >= 0, stored, own, partner, body, outer, H, B, F, O)
    for t in range(0, m, TILE):
        count = min(TILE, m - t)
        filled = count + (-count % LINE if n_history <= LIGHT else 0)  # padded with the last contact
        gather_tile(
            filled, slots, t, flat, g, first, own, partner, body, kind, S, B, P, H, dt, v_x, v_y, l_x, l_y, n_history, rolling,
            I, G,
        )  # fmt: skip
        law(I, O, filled, pairs)
        if force >= 0:
            book(filled, force, moment, stored, n_history, I, O)
        if dashpots >= 0:
            book_dashpots(filled, dashpots, n_history, dt, I, O, G)
        force_and_torques(filled, I, O, G)
        if rolling == MOMENTS:
            add_moments(filled, O, G, n_history)
        sums_of_tile = reduce_tile(count, slots, t, O, I, G, sums_of_tile)
        if flat:
            scatter_plate_tile(count, c, slots, t, own, partner, body, S, O, G, B, E, sums)
        else:
            scatter_pair_tile(count, slots, t, own, partner, body, outer, S, O, G, B, F)
        store_history(count, slots, t, O, G, H, n_history)
        if observed:
            add_elastic_energy(count, c, O, sums)
            for q in range(count if R.shape[0] > 0 else 0):
                write_record(q, slots[t + q], I, O, G, own, partner, S, P, R, v_x, v_y)
                if rolling == MOMENTS:
                    record_rolling(q, slots[t + q], O, G, R, n_history)
    store_sums(c, lost, damped, sums_of_tile, sums)
