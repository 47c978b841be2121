"""Overlaps of candidates, and the lists of active contacts and of those that opened.

Vectorised: a branch on whether a candidate touches would be mispredicted, so there is none.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import LANES, active_bits, broadcast, compress_store, get, put
from thirdbody.kernels import plates
from thirdbody.kernels.contact_geometry import SPARE, columns, four_rows_of
from thirdbody.kernels.plates import BASINS, is_plate, is_upper
from thirdbody.kernels.tables import sphere, surface_contact
from thirdbody.kernels.vectors import image, images, nearest_image


@njit(**BARE)
def overlap_and_normal(k, context, box):
    """Return the overlap of candidate k [m] and the unit normal from partner to owner. Out of reach: overlap <= 0, no normal."""
    S, i, j = context.S, context.own[k], context.partner[k]
    if is_plate(j):
        x, y, z = plates.normal(k, context)
        return plates.overlap(k, context), x, y, z
    d_x = nearest_image(S[i, sphere.X] - S[j, sphere.X], box.length_x)
    d_y = nearest_image(S[i, sphere.Y] - S[j, sphere.Y], box.length_y)
    d_z = S[i, sphere.Z] - S[j, sphere.Z]
    square = d_x * d_x + d_y * d_y + d_z * d_z
    radii = S[i, sphere.RADIUS] + S[j, sphere.RADIUS]
    if square >= (radii + box.reach) * (radii + box.reach):
        return -1.0, 0.0, 0.0, 0.0
    d = math.sqrt(square)
    inverse = 1.0 / max(d, 1e-300)
    return radii - d, d_x * inverse, d_y * inverse, d_z * inverse


@njit(**BARE_CHUNK)
def plate_overlaps(first, last, context, box, g):
    """Compute overlap plus reach of candidates first to last with their plates [m] into g: > 0 if they are within reach."""
    for k in range(first, last):
        g[k - first] = plates.plane_overlap(k, context) + box.reach


@njit(**BARE_CHUNK)
def pair_overlaps(first, last, context, box, g):
    """Compute limit^2 - distance^2 of candidates first to last [m2] into g: > 0 if they are within reach."""
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
        i, j = np.uint64(own[k]), np.uint64(partner[k])  # unsigned: no check for negative indices
        d_x, d_y, d_z = S[i, sphere.X] - S[j, sphere.X], S[i, sphere.Y] - S[j, sphere.Y], S[i, sphere.Z] - S[j, sphere.Z]
        d_x, d_y = image(d_x, box.length_x, box.inverse_x), image(d_y, box.length_y, box.inverse_y)
        limit = S[i, sphere.RADIUS] + S[j, sphere.RADIUS] + box.reach
        g[k - first] = limit * limit - (d_x * d_x + d_y * d_y + d_z * d_z)


@njit(**BARE_CHUNK)
def compact_active(first, last, g, closed, touching, opened):
    """List the candidates within reach, and those that were until the last step; return both numbers.

    `closed`: 1 for those within reach, else 0. The list of the active ones is padded with the last of them as far as it is read
    ahead; all else after the ends of the lists is undefined.
    """
    m, o, fours = np.int64(0), np.int64(0), first + (last - first) // LANES * LANES
    for k in range(first, fours, LANES):
        on = active_bits(closed, k, get(g, k - first))
        m += compress_store(touching, m, k, on & 15)
        if on > 15:  # few open in a step
            o += compress_store(opened, o, k, on >> LANES)
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
    """Do for contacts with rough plates what overlaps and `compact_active` do for others.

    Rows that have and had no minimum in the last two steps, by far the most, are passed over.
    """
    Q, closed, m, o, k = context.Q, context.closed, np.int64(0), np.int64(0), first
    while k < last:
        flat = len(context.upper if is_upper(context.partner[k]) else context.lower) == 0
        minima = np.int64(1) if flat else np.int64(Q[k, surface_contact.MINIMA])
        ended, e = np.int64(0) if flat else np.int64(Q[k, surface_contact.ENDED]), k
        rows = (minima | ended | ended >> BASINS) & ((1 << BASINS) - 1)
        while rows != 0:
            if rows & 1 != 0:
                on = np.int64(minima & 1 != 0 and plates.surface_overlap(e, context) + reach > 0.0)
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
