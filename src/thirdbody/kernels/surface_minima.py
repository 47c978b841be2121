"""Contacts of spheres with rough plates: the local minima of the distance, each in a row of its own as long as it exists.

In every step each minimum follows its sphere (`closest_point.closest`). When a sphere has moved by a small part of its radius
relative to the plate, all minima within reach are searched for: rows that are minima keep their place, new minima get the free
rows in the order of their distance, rows that are none end. All of this depends on the path of the sphere alone, not on other
bodies, on threads or on outputs.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK, OPTIONS
from thirdbody.kernels import first_body
from thirdbody.kernels.closest_point import closest, effective_radius, log_radius_gradient, normal_derivative
from thirdbody.kernels.columns import domain, height_field, sphere, surface_contact
from thirdbody.kernels.nearby_minima import MERGE, find_minima
from thirdbody.kernels.predicates import BASINS, is_upper
from thirdbody.kernels.rough_plates import UPDATE

MOVED = 0.02
"""Displacement of a sphere relative to a plate, in radii, after which all minima are searched for again."""

FARTHEST = 1e100
"""Bound of the coordinates [m] of a sphere that is somewhere."""

APART = 1.0 + 1e-9
"""Least distance over the radius plus reach in a row whose minimum has ended."""


@njit(**BARE)
def is_same(one, other, field):
    """Return whether two offsets (2,) [m] are those of the same minimum."""
    tolerance = 2.0 * MERGE / max(field[height_field.RATE_X], field[height_field.RATE_Y])
    return abs(one[0] - other[0]) <= tolerance and abs(one[1] - other[1]) <= tolerance


@njit(**BARE)
def offset_of(k, Q):
    """Return the offset (2,) of the closest point of row k [m]."""
    return Q[k, surface_contact.OFFSET], Q[k, surface_contact.OFFSET + 1]


@njit(**BARE)
def exists(k, Q):
    """Return whether row k has a minimum."""
    return Q[k, surface_contact.EXISTS] != 0.0


@njit(**BARE)
def end_minimum(k, radius, reach, Q):
    """End the minimum of row k: apart from now on. What else the row holds serves the last step of its contact."""
    Q[k, surface_contact.EXISTS] = 0.0
    Q[k, surface_contact.DISTANCE] = max(Q[k, surface_contact.DISTANCE], APART * (radius + reach))


@njit(**BARE)
def write_geometry(k, foot, radius, upper, curved, Q):
    """Write normal, effective radius and their derivatives at a minimum into row k, in world axes."""
    up = -1.0 if upper else 1.0
    n_x, n_y, n_z = foot.normal
    Q[k, surface_contact.NORMAL], Q[k, surface_contact.NORMAL + 1] = n_x, n_y
    Q[k, surface_contact.NORMAL + 2] = up * n_z
    xx, xy, xz, yy, yz, zz = normal_derivative(foot)
    t = surface_contact.TURNING
    Q[k, t], Q[k, t + 1], Q[k, t + 2], Q[k, t + 3], Q[k, t + 4], Q[k, t + 5] = xx, yy, zz, xy, up * xz, up * yz
    g_x, g_y, g_z = log_radius_gradient(foot, radius) if curved else (0.0, 0.0, 0.0)
    Q[k, surface_contact.GRADIENT], Q[k, surface_contact.GRADIENT + 1] = g_x, g_y
    Q[k, surface_contact.GRADIENT + 2] = up * g_z


@njit(**BARE_CHUNK)
def follow(k, field, x, start, tables):
    """Move the minimum of row k downhill from an offset `start` (2,) to where it is for a centre x (3,) in the plate's coordinates.

    The derivatives are computed only where they are needed, within the reach of the contact.
    """
    Q, D, radius = tables.Q, tables.D, tables.S[tables.own[k], sphere.RADIUS]
    curved = D[domain.CURVED] != 0.0
    foot = closest(field, x, start[0], start[1])
    Q[k, surface_contact.OFFSET], Q[k, surface_contact.OFFSET + 1] = foot.x, foot.y
    Q[k, surface_contact.DISTANCE], Q[k, surface_contact.EXISTS] = foot.distance, 1.0
    Q[k, surface_contact.RADIUS] = effective_radius(foot.jet, radius) if curved else radius
    upper = is_upper(tables.partner[k])
    if foot.distance < radius + D[domain.REACH]:
        write_geometry(k, foot, radius, upper, curved, Q)
    else:
        n_x, n_y, n_z = foot.normal
        Q[k, surface_contact.NORMAL], Q[k, surface_contact.NORMAL + 1] = n_x, n_y
        Q[k, surface_contact.NORMAL + 2] = -n_z if upper else n_z


@njit(**BARE_CHUNK)
def follow_all(k, field, x, tables):
    """Move all minima of the sphere whose first row is k; of two that meet, the one that moved farther ends."""
    Q, S, i, reach = tables.Q, tables.S, tables.own[k], tables.D[domain.REACH]
    for a in range(k, k + BASINS):
        if not exists(a, Q):
            continue
        before = offset_of(a, Q)
        follow(a, field, x, before, tables)
        for b in range(k, a):
            if exists(b, Q) and is_same(offset_of(a, Q), offset_of(b, Q), field):
                jumped = not is_same(before, offset_of(a, Q), field)
                end_minimum(a if jumped else b, S[i, sphere.RADIUS], reach, Q)
                break


@njit(**BARE_CHUNK)
def search_all(k, field, x, tables, found):
    """Search for all minima of the sphere whose first row is k; `found`: scratch."""
    Q, S, D, i = tables.Q, tables.S, tables.D, tables.own[k]
    radius, reach = S[i, sphere.RADIUS], D[domain.REACH]
    n = min(find_minima(field, x, radius * (1.0 + 1.1 * MOVED) + reach, found), BASINS)
    for a in range(k, k + BASINS):
        known = False
        for m in range(n):
            if exists(a, Q) and is_same(offset_of(a, Q), (found[m, 0], found[m, 1]), field):
                known, found[m, 2] = True, math.inf
        if exists(a, Q) and not known:
            end_minimum(a, radius, reach, Q)
    a = k
    for m in range(n):
        if found[m, 2] < math.inf:
            while exists(a, Q):
                a += 1
            follow(a, field, x, (found[m, 0], found[m, 1]), tables)
    for d in range(3):
        Q[k, surface_contact.SEARCHED + d] = x[d]


@njit(**BARE)
def has_moved(k, x, radius, Q):
    """Return whether the sphere whose first row is k has moved so far since the last search that another is due."""
    d_x, d_y = x[0] - Q[k, surface_contact.SEARCHED], x[1] - Q[k, surface_contact.SEARCHED + 1]
    d_z = x[2] - Q[k, surface_contact.SEARCHED + 2]
    return not d_x * d_x + d_y * d_y + d_z * d_z <= MOVED * MOVED * radius * radius


@njit(**BARE_CHUNK)
def update_sphere(k, field, tables, found):
    """Update the rows k to k + BASINS - 1 of a sphere and a rough plate."""
    Q, S, D, i = tables.Q, tables.S, tables.D, tables.own[k]
    x, radius = first_body.to_surface(tables.partner[k], first_body.centre(i, S), tables.P), S[i, sphere.RADIUS]
    lost = not abs(x[0]) + abs(x[1]) + abs(x[2]) < FARTHEST  # also NaN: a guard will find it
    if lost or x[2] - radius - field[height_field.MAX_HEIGHT] > D[domain.REACH]:
        for a in range(k, k + BASINS):
            if exists(a, Q):
                end_minimum(a, radius, D[domain.REACH], Q)
        Q[k, surface_contact.SEARCHED] = math.inf
        return
    follow_all(k, field, x, tables)
    if has_moved(k, x, radius, Q):
        search_all(k, field, x, tables, found)


@njit(**BARE)
def update_plane(k, tables):
    """Update row k of a sphere and a flat plate."""
    Q, S, i = tables.Q, tables.S, tables.own[k]
    x = first_body.to_surface(tables.partner[k], first_body.centre(i, S), tables.P)
    Q[k, surface_contact.DISTANCE], Q[k, surface_contact.EXISTS] = x[2], 1.0
    Q[k, surface_contact.NORMAL + 2] = -1.0 if is_upper(tables.partner[k]) else 1.0
    Q[k, surface_contact.RADIUS] = S[i, sphere.RADIUS]


@njit(UPDATE, **OPTIONS)
def update(first, last, tables):
    """Update the rows of candidates first to last; those of a sphere and a plate are together, from basin 0 on."""
    found, k = np.empty((BASINS, 3)), first
    while k < last:
        field = tables.upper if is_upper(tables.partner[k]) else tables.lower
        if field.shape[0] == 0:
            update_plane(k, tables)
            k += 1
        else:
            update_sphere(k, field, tables, found)
            k += BASINS
