"""Geometry of the contacts of a tile: gather from the tables, then compute field by field.

Functions that gather read rows and only copy and add; functions that compute work on whole fields, which the compiler turns into
vector instructions (if its loop starts at zero and contains no loop). IEEE arithmetic contact by contact: the bits are those of a
loop over contacts.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit import simd
from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import LANES, broadcast, get, load, put, set4, transpose, with_last
from thirdbody.kernels import plates
from thirdbody.kernels.memory import load_field
from thirdbody.kernels.plates import BASINS, is_sphere, is_upper, kind_of
from thirdbody.kernels.tables import contact_state, sphere, surface_contact
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output
from thirdbody.kernels.vectors import image, images

AT_END = (geometry.END_VELOCITY - geometry.MID_VELOCITY) * TILE
"""Offset from a field of the middle of the step to that of its end."""

TO_END = sphere.END_VELOCITY - sphere.MID_VELOCITY  # the same offset for the columns of spheres
SPARE = simd.AHEAD + simd.LINE  # padding at the end of a list of contacts, which is read ahead by prefetches and vector loads

LIGHT = 16
"""Largest history of a light law. Its cost per vector is that of one contact, so its tiles are padded to whole vectors
(63 contacts cost half as much again as 64); the cost of other laws is per contact."""


@njit(**BARE)
def padded(n, n_history):
    return n + (-n % simd.VECTOR if n_history <= LIGHT else 0)


@njit(**BARE)
def load_history(q, k, context, tile):
    I, G, H = tile.inputs, tile.geometry, context.H  # noqa: E741
    G[q + geometry.PREVIOUS_SLIP * TILE] = H[k, contact_state.SLIP]
    for d in range(3):
        G[q + (geometry.AXIS + d) * TILE] = H[k, contact_state.AXIS + d]
    I[q + law_input.PAIR_TYPE * TILE] = kind_of(k, context)
    for h in range(context.field_begin):
        I[q + (law_input.HISTORY + h) * TILE] = H[k, contact_state.LAW + h]
    load_field(q, k, context, tile)
    for h in range(context.field_begin + context.field_size, context.n_history):
        I[q + (law_input.HISTORY + h) * TILE] = H[k, contact_state.LAW + h]


@njit(**BARE)
def read_vector(G, at):
    return G[at], G[at + TILE], G[at + 2 * TILE]


@njit(**BARE)
def write_vector(G, at, v):
    G[at], G[at + TILE], G[at + 2 * TILE] = v


@njit(**BARE)
def gather_plate_contact(q, k, context, motion, tile):
    i, S, I, G, half = context.own[k], context.S, tile.inputs, tile.geometry, 0.5 * motion.dt  # noqa: E741
    r, (v_x, v_y, v_z) = S[i, sphere.RADIUS], plates.velocity(context.partner[k], context.P, motion)
    u_x, u_y, u_z = S[i, sphere.MID_VELOCITY], S[i, sphere.MID_VELOCITY + 1], S[i, sphere.MID_VELOCITY + 2]
    move = half * (u_x - v_x), half * (u_y - v_y), half * (u_z - v_z)
    write_vector(G, q + geometry.NORMAL * TILE, plates.normal(k, context))
    write_vector(G, q + geometry.MID_NORMAL * TILE, plates.normal_before(k, move, context))
    overlap = plates.overlap(k, context)
    G[q + geometry.ARM * TILE], G[q + geometry.PARTNER_ARM * TILE] = r - 0.5 * overlap, 0.0
    G[q + geometry.RADIUS * TILE], G[q + geometry.PARTNER_RADIUS * TILE] = r, r
    I[q + law_input.OVERLAP * TILE], I[q + law_input.MASS * TILE] = overlap, S[i, sphere.MASS]
    I[q + law_input.RADIUS * TILE] = plates.effective_radius(k, context)
    for t in range(2):
        at, u = q + t * AT_END, sphere.MID_VELOCITY + t * TO_END
        v = S[i, u] - v_x, S[i, u + 1] - v_y, S[i, u + 2] - v_z
        write_vector(G, at + geometry.MID_VELOCITY * TILE, v)
        for d in range(3):
            w = S[i, sphere.MID_SPIN + d + t * TO_END]
            G[at + (geometry.MID_SPIN + d) * TILE], G[at + (geometry.MID_RIM + d) * TILE] = w, r * w
    load_history(q, k, context, tile)


@njit(**BARE)
def four_rows_of(i, c, S):
    return load(S, i[0], c), load(S, i[1], c), load(S, i[2], c), load(S, i[3], c)


@njit(**BARE)
def put_three(G, at, v):
    put(G, at, v[0])
    put(G, at + TILE, v[1])
    put(G, at + 2 * TILE, v[2])


@njit(**BARE)
def columns(rows):
    return transpose(rows[0], rows[1], rows[2], rows[3])


@njit(**BARE)
def row_differences(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]


@njit(**BARE)
def with_last_column(a, c):
    return transpose(with_last(a[0], c[0]), with_last(a[1], c[1]), with_last(a[2], c[2]), with_last(a[3], c[3]))


@njit(**BARE)
def gather_spins(q, a, b, r_i, r_j, G):
    put_three(G, q + geometry.MID_SPIN * TILE, (a[0] + b[0], a[1] + b[1], a[2] + b[2]))
    put_three(G, q + geometry.MID_RIM * TILE, (r_i * a[0] + r_j * b[0], r_i * a[1] + r_j * b[1], r_i * a[2] + r_j * b[2]))


@njit(**BARE)
def gather_history(q, k, context, tile):
    I, G, H, kind = tile.inputs, tile.geometry, context.H, context.kind  # noqa: E741
    axes = columns(four_rows_of(k, np.int64(contact_state.AXIS), H))  # and the slip, 0 if open
    put_three(G, q + geometry.AXIS * TILE, axes)
    put(G, q + geometry.PREVIOUS_SLIP * TILE, axes[3])
    kinds = broadcast(0.0)
    if kind.shape[0] > 0:
        kinds = set4(float(kind[k[0]]), float(kind[k[1]]), float(kind[k[2]]), float(kind[k[3]]))
    put(I, q + law_input.PAIR_TYPE * TILE, kinds)
    first = columns(four_rows_of(k, np.int64(contact_state.LAW), H))  # a shorter history is padded with zeros
    put_three(I, q + law_input.HISTORY * TILE, first)
    put(I, q + (law_input.HISTORY + 3) * TILE, first[3])
    for h in range(4, context.n_history):
        if not context.field_begin <= h < context.field_begin + context.field_size:
            c = contact_state.LAW + h
            put(I, q + (law_input.HISTORY + h) * TILE, set4(H[k[0], c], H[k[1], c], H[k[2], c], H[k[3], c]))


@njit(**BARE_CHUNK)
def gather_pair_contacts(n, slots, dt, box, context, tile):
    """Gather the contacts between spheres slots[:n] into the first elements, by fours. `SPARE` - 1 more candidates are read."""
    own, partner, S, I, G = context.own, context.partner, context.S, tile.inputs, tile.geometry  # noqa: E741
    for q in range(0, n, 4):
        for e in range(q + simd.AHEAD, q + simd.AHEAD + 4):  # rows of later contacts: partners may be anywhere
            ahead = np.uint64(slots[e])
            beside = np.uint64(partner[ahead])
            simd.prefetch(S, beside, np.int64(sphere.MID_SPIN))
            simd.prefetch(S, beside, np.int64(sphere.END_SPIN))
            simd.prefetch(context.H, ahead, np.int64(contact_state.AXIS))
        k = np.uint64(slots[q]), np.uint64(slots[q + 1]), np.uint64(slots[q + 2]), np.uint64(slots[q + 3])
        i = np.uint64(own[k[0]]), np.uint64(own[k[1]]), np.uint64(own[k[2]]), np.uint64(own[k[3]])
        j = np.uint64(partner[k[0]]), np.uint64(partner[k[1]]), np.uint64(partner[k[2]]), np.uint64(partner[k[3]])
        # fourth columns: radius, mass
        x_i, u_i = four_rows_of(i, np.int64(sphere.POSITION), S), four_rows_of(i, np.int64(sphere.MID_VELOCITY), S)
        x_j, u_j = four_rows_of(j, np.int64(sphere.POSITION), S), four_rows_of(j, np.int64(sphere.MID_VELOCITY), S)
        e_i, e_j = four_rows_of(i, np.int64(sphere.END_VELOCITY), S), four_rows_of(j, np.int64(sphere.END_VELOCITY), S)
        centres, step = with_last_column(row_differences(x_i, x_j), x_i), with_last_column(row_differences(u_i, u_j), x_j)
        end = with_last_column(row_differences(e_i, e_j), u_i)
        r_i, r_j, w_j = centres[3], step[3], with_last_column(four_rows_of(j, np.int64(sphere.MID_SPIN), S), u_j)
        put_three(G, q + geometry.NORMAL * TILE, centres)
        put_three(G, q + geometry.MID_VELOCITY * TILE, step)
        put_three(G, q + geometry.END_VELOCITY * TILE, end)
        put(G, q + geometry.RADIUS * TILE, r_i)
        put(G, q + geometry.PARTNER_RADIUS * TILE, r_j)
        put(I, q + law_input.MASS * TILE, end[3])
        put(G, q + geometry.PARTNER_MASS * TILE, w_j[3])
        gather_spins(q, columns(four_rows_of(i, np.int64(sphere.MID_SPIN), S)), w_j, r_i, r_j, G)
        w_i, w_j = columns(four_rows_of(i, np.int64(sphere.END_SPIN), S)), columns(four_rows_of(j, np.int64(sphere.END_SPIN), S))
        gather_spins(q + AT_END, w_i, w_j, r_i, r_j, G)
        gather_history(q, k, context, tile)
    # the columns of a short history reach into the place of the fields
    for q in range(n if context.field_size > 0 else 0):
        load_field(q, np.uint64(slots[q]), context, tile)
    pair_geometry(n, dt, box, tile)


@njit(**BARE)
def overlap_of_spheres(x, y, z, radii):
    """Return the overlap [m] of spheres of this sum of radii, negative: a gap; and the unit normal. x, y, z: between centres."""
    distance = math.sqrt(x * x + y * y + z * z)
    inverse = 1.0 / max(distance, 1e-300)
    return radii - distance, (x * inverse, y * inverse, z * inverse)


@njit(**BARE_CHUNK)
def pair_geometry(n, dt, box, tile):
    """Compute what depends on positions and masses of n pairs. Slip is a displacement of the step, so its arms are those of the
    middle of the step: hence the normal of half a step ago."""
    I, G, half = tile.inputs, tile.geometry, 0.5 * dt  # noqa: E741
    l_x, l_y, c_x, c_y, _ = box
    for q in range(n):
        x, y, z = read_vector(G, q + geometry.NORMAL * TILE)
        x, y = image(x, l_x, c_x), image(y, l_y, c_y)
        r_i, r_j = G[q + geometry.RADIUS * TILE], G[q + geometry.PARTNER_RADIUS * TILE]
        m_i, m_j = I[q + law_input.MASS * TILE], G[q + geometry.PARTNER_MASS * TILE]
        radii = r_i + r_j
        overlap, normal = overlap_of_spheres(x, y, z, radii)
        v_x, v_y, v_z = read_vector(G, q + geometry.MID_VELOCITY * TILE)
        p_x, p_y, p_z = x - half * v_x, y - half * v_y, z - half * v_z
        back = 1.0 / max(math.sqrt(p_x * p_x + p_y * p_y + p_z * p_z), 1e-300)
        write_vector(G, q + geometry.NORMAL * TILE, normal)
        write_vector(G, q + geometry.MID_NORMAL * TILE, (p_x * back, p_y * back, p_z * back))
        G[q + geometry.ARM * TILE], G[q + geometry.PARTNER_ARM * TILE] = r_i - 0.5 * overlap, r_j - 0.5 * overlap
        I[q + law_input.OVERLAP * TILE] = overlap
        I[q + law_input.RADIUS * TILE] = r_i * r_j / radii
        I[q + law_input.MASS * TILE] = m_i * m_j / (m_i + m_j)


@njit(**BARE_CHUNK)
def transport_frames(n, dt, tile):
    """Transport the frames of n contacts with their normals, rotated by half the sum of spins; initialise at first touch."""
    G, half = tile.geometry, 0.5 * dt
    for q in range(n):
        n_x, n_y, n_z = read_vector(G, q + geometry.NORMAL * TILE)
        p_x, p_y, p_z = read_vector(G, q + geometry.MID_NORMAL * TILE)
        e_x, e_y, e_z = read_vector(G, q + geometry.AXIS * TILE)
        w_x, w_y, w_z = read_vector(G, q + geometry.MID_SPIN * TILE)
        twist = half * (w_x * p_x + w_y * p_y + w_z * p_z)
        c_x, c_y, c_z = p_y * e_z - p_z * e_y, p_z * e_x - p_x * e_z, p_x * e_y - p_y * e_x
        e_x, e_y, e_z = e_x + twist * c_x, e_y + twist * c_y, e_z + twist * c_z
        # at first touch any direction that is not parallel to the normal; laws are isotropic
        new = G[q + geometry.PREVIOUS_SLIP * TILE] == 0.0
        steep = abs(n_z) > 0.5
        e_x = (1.0 if steep else 0.0) if new else e_x
        e_y = 0.0 if new else e_y
        e_z = (0.0 if steep else 1.0) if new else e_z
        # along the bisector of old and new normal: a projection along the new one alone would turn the frame by O(step)
        along = (e_x * n_x + e_y * n_y + e_z * n_z) / (p_x * n_x + p_y * n_y + p_z * n_z)
        e_x, e_y, e_z = e_x - along * p_x, e_y - along * p_y, e_z - along * p_z
        scale = 1.0 / math.sqrt(e_x * e_x + e_y * e_y + e_z * e_z)
        e_x, e_y, e_z = e_x * scale, e_y * scale, e_z * scale
        write_vector(G, q + geometry.AXIS * TILE, (e_x, e_y, e_z))
        c_x, c_y, c_z = n_y * e_z - n_z * e_y, n_z * e_x - n_x * e_z, n_x * e_y - n_y * e_x
        write_vector(G, q + geometry.CROSS_AXIS * TILE, (c_x, c_y, c_z))


@njit(**BARE)
def relative_velocity(q, at, normal, I, G):  # noqa: E741
    half = 0.5 * I[q + law_input.OVERLAP * TILE]
    x, y, z = read_vector(G, q + normal * TILE)
    v_x, v_y, v_z = read_vector(G, q + at + geometry.MID_VELOCITY * TILE)
    w_x, w_y, w_z = read_vector(G, q + at + geometry.MID_SPIN * TILE)
    r_x, r_y, r_z = read_vector(G, q + at + geometry.MID_RIM * TILE)
    o_x, o_y, o_z = r_x - half * w_x, r_y - half * w_y, r_z - half * w_z
    return v_x - (o_y * z - o_z * y), v_y - (o_z * x - o_x * z), v_z - (o_x * y - o_y * x)


@njit(**BARE_CHUNK)
def slip_increment(n, dt, tile):
    I, G = tile.inputs, tile.geometry  # noqa: E741
    for q in range(n):
        e_x, e_y, e_z = read_vector(G, q + geometry.AXIS * TILE)
        d_x, d_y, d_z = read_vector(G, q + geometry.CROSS_AXIS * TILE)
        x, y, z = relative_velocity(q, np.int64(0), np.int64(geometry.MID_NORMAL), I, G)
        I[q + law_input.SLIP_X * TILE] = (x * e_x + y * e_y + z * e_z) * dt
        I[q + law_input.SLIP_Y * TILE] = (x * d_x + y * d_y + z * d_z) * dt
        x, y, z = relative_velocity(q, np.int64(AT_END), np.int64(geometry.NORMAL), I, G)
        n_x, n_y, n_z = read_vector(G, q + geometry.NORMAL * TILE)
        I[q + law_input.NORMAL_VELOCITY * TILE] = x * n_x + y * n_y + z * n_z
        I[q + law_input.VELOCITY_X * TILE] = x * e_x + y * e_y + z * e_z
        I[q + law_input.VELOCITY_Y * TILE] = x * d_x + y * d_y + z * d_z


@njit(**BARE_CHUNK)
def force_and_torques(n, tile):
    O, G = tile.outputs, tile.geometry  # noqa: E741
    for q in range(n):
        f_n, t_1, t_2 = read_vector(O, q + law_output.NORMAL_FORCE * TILE)  # and the tangential force
        n_x, n_y, n_z = read_vector(G, q + geometry.NORMAL * TILE)
        e_x, e_y, e_z = read_vector(G, q + geometry.AXIS * TILE)
        d_x, d_y, d_z = read_vector(G, q + geometry.CROSS_AXIS * TILE)
        a_i, a_j = -G[q + geometry.ARM * TILE], -G[q + geometry.PARTNER_ARM * TILE]
        x, y, z = t_1 * d_x - t_2 * e_x, t_1 * d_y - t_2 * e_y, t_1 * d_z - t_2 * e_z  # normal times tangential force
        force = f_n * n_x + t_1 * e_x + t_2 * d_x, f_n * n_y + t_1 * e_y + t_2 * d_y, f_n * n_z + t_1 * e_z + t_2 * d_z
        write_vector(G, q + geometry.FORCE * TILE, force)
        write_vector(G, q + geometry.TORQUE * TILE, (a_i * x, a_i * y, a_i * z))
        write_vector(G, q + geometry.PARTNER_TORQUE * TILE, (a_j * x, a_j * y, a_j * z))


@njit(**BARE)
def gradient_force(k, energy, context):
    """Return -(U/2) grad ln R_eff [N], on the centre of a sphere on a rough plate: Hertz' energy U = (8/15) E* R_eff^(1/2)
    overlap^(5/2) changes along the plate as R_eff does, and not with rotation."""
    x, y, z = plates.three(context.Q, k, surface_contact.GRADIENT)
    return -0.5 * energy * x, -0.5 * energy * y, -0.5 * energy * z


@njit(**BARE_CHUNK)
def add_gradient_force(n, slots, context, tile):
    for q in range(n):
        force = gradient_force(slots[q], tile.outputs[q + law_output.STORED_NORMAL * TILE], context)
        for d in range(3):
            tile.geometry[q + (geometry.FORCE + d) * TILE] += force[d]


# -- overlaps of candidates, and the lists of active contacts and of those that opened; no branch on whether one touches --


@njit(**BARE)
def pair_overlap(k, context, box):
    """Return the overlap of candidate k, a pair of spheres [m], and the unit normal from partner to owner."""
    S, i, j = context.S, context.own[k], context.partner[k]
    x = image(S[i, sphere.X] - S[j, sphere.X], box.length_x, box.inverse_x)
    y = image(S[i, sphere.Y] - S[j, sphere.Y], box.length_y, box.inverse_y)
    return overlap_of_spheres(x, y, S[i, sphere.Z] - S[j, sphere.Z], S[i, sphere.RADIUS] + S[j, sphere.RADIUS])


@njit(**BARE)
def overlap_and_normal(k, context, box):
    """Return overlap [m] and unit normal of a candidate of either kind, with a plate or between spheres."""
    if is_sphere(context.partner[k]):
        return pair_overlap(k, context, box)
    return plates.overlap(k, context), plates.normal(k, context)


@njit(**BARE)
def square_within_reach(i, j, S, box):
    """Return limit^2 - distance^2 of two spheres [m2]: > 0 if they are within reach."""
    d_x, d_y, d_z = S[i, sphere.X] - S[j, sphere.X], S[i, sphere.Y] - S[j, sphere.Y], S[i, sphere.Z] - S[j, sphere.Z]
    d_x, d_y = image(d_x, box.length_x, box.inverse_x), image(d_y, box.length_y, box.inverse_y)
    limit = S[i, sphere.RADIUS] + S[j, sphere.RADIUS] + box.reach
    return limit * limit - (d_x * d_x + d_y * d_y + d_z * d_z)


@njit(**BARE_CHUNK)
def squares_within_reach(first, last, context, box, g):
    """Write `square_within_reach` of candidates first to last into g, by fours without their overlaps: no root is needed."""
    own, partner, S = context.own, context.partner, context.S
    fours = first + (last - first) // LANES * LANES
    for k in range(first, fours, LANES):
        i4 = np.uint64(own[k]), np.uint64(own[k + 1]), np.uint64(own[k + 2]), np.uint64(own[k + 3])
        j4 = np.uint64(partner[k]), np.uint64(partner[k + 1]), np.uint64(partner[k + 2]), np.uint64(partner[k + 3])
        x_i, y_i, z_i, r_i = columns(four_rows_of(i4, np.int64(sphere.POSITION), S))
        x_j, y_j, z_j, r_j = columns(four_rows_of(j4, np.int64(sphere.POSITION), S))
        x, y = images(x_i - x_j, box.length_x, box.inverse_x), images(y_i - y_j, box.length_y, box.inverse_y)
        z, reach = z_i - z_j, r_i + r_j + broadcast(box.reach)
        put(g, k - first, reach * reach - (x * x + y * y + z * z))
    for k in range(fours, last):
        g[k - first] = square_within_reach(own[k], partner[k], S, box)


@njit(**BARE_CHUNK)
def compact_active(first, last, g, closed, touching, opened):
    """List the candidates within reach (`closed`: 1), and those that were until the last step; return both numbers. The first
    list is padded with its last one as far as it is read ahead; all else after the ends is undefined."""
    m, o, fours = np.int64(0), np.int64(0), first + (last - first) // LANES * LANES
    for k in range(first, fours, LANES):
        on = simd.active_bits(closed, k, get(g, k - first))
        m += simd.compress_store(touching, m, k, on & 15)
        if on > 15:  # few open in a step
            o += simd.compress_store(opened, o, k, on >> LANES)
    for k in range(fours, last):
        on, was = np.int64(g[k - first] > 0.0), np.int64(closed[k])
        touching[m], opened[o] = k, k
        closed[k] = on
        m += on
        o += was * (1 - on)
    for e in range(m, m + SPARE - 1):
        touching[e] = touching[max(m - 1, 0)]
    return m, o


@njit(**BARE_CHUNK)
def compact_rough(first, last, context, reach, touching, opened):
    """Do the same for contacts with rough plates, but for rows without a minimum in the last two steps, by far the most."""
    Q, closed, m, o, k = context.Q, context.closed, np.int64(0), np.int64(0), first
    while k < last:
        flat = len(context.upper if is_upper(context.partner[k]) else context.lower) == 0
        minima = np.int64(1) if flat else np.int64(Q[k, surface_contact.MINIMA])
        ended, e = np.int64(0) if flat else np.int64(Q[k, surface_contact.ENDED]), k
        rows = (minima | ended | ended >> BASINS) & ((1 << BASINS) - 1)
        while rows != 0:
            if rows & 1 != 0:
                on = np.int64(minima & 1 != 0 and plates.overlap(e, context) + reach > 0.0)
                was = np.int64(closed[e])
                touching[m], opened[o] = e, e
                closed[e] = on
                m += on
                o += was * (1 - on)
            rows, minima, e = rows >> 1, minima >> 1, e + 1
        k += 1 if flat else BASINS
    for e in range(m, m + SPARE - 1):
        touching[e] = touching[max(m - 1, 0)]
    return m, o
