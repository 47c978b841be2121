"""Contacts of spheres with rough plates: the local minima of the distance, each in a row of its own as long as it exists.

In every step each minimum follows its sphere. When a sphere has moved by a small part of its radius relative to the plate, all
minima within reach are searched for: new ones get the free rows in the order of their distance, rows that are none end. Where it
touches and hollows may be sharper than itself, a minimum can begin with an overlap: such a sphere is searched for much more
often. All of this depends on the path of the sphere alone. Called through a pointer, so that scenes with flat plates do not
compile it.
"""

import math
from collections import namedtuple

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, BARE_CHUNK, NO_COUNTS, OPTIONS, entry
from thirdbody.kernels import closest_point, plates
from thirdbody.kernels.closest_point import bent_jet, closest, effective_radius, log_radius_gradient, normal_derivative
from thirdbody.kernels.plates import BASINS, NEAR_WALL, is_upper
from thirdbody.kernels.tables import domain, height_field, sphere, surface_contact

RoughPlates = namedtuple("RoughPlates", "own partner S P Q D lower upper")
"""Candidates and tables that an update needs; names as in `arguments.Context`."""

_TABLE, _ROW, _S1 = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C"), types.Array(types.int32, 1, "C")
UPDATE = types.void(types.int64, types.int64, types.NamedTuple((_S1, _S1, _TABLE, _TABLE, _TABLE, _ROW, _ROW, _ROW), RoughPlates))
"""update(first candidate, last + 1, tables)"""

update_at = function_at(UPDATE)


@njit(**BARE)
def update_surfaces(first, last, context):
    tables = RoughPlates(context.own, context.partner, context.S, context.P, context.Q, context.D, context.lower, context.upper)
    update_at(context.update_surfaces)(np.int64(first), np.int64(last), tables)


MOVED = 0.02  # displacement of a sphere relative to a plate, in radii, after which all minima are searched for again

MOVED_TOUCHING = 5e-4
"""The same of a sphere that touches where hollows may be sharper than itself, of the order of its overlap: a ball that rolls into
hollows of 1.01 to 1.2 times its curvature makes at most 0.28 of load times overlap, with `MOVED` up to 17.5 times that."""

FARTHEST = 1e100  # bound of the coordinates [m] of a sphere that is somewhere

HOLLOW = -0.5
"""Sum of the turning of the normal along both principal directions, times the radius, below which a minimum may split: in a
hollow of 0.33 times the curvature of the sphere, or of 0.6 times that with a sharp crest across."""

APART = 1.0 + 1e-9  # least distance over the radius plus reach in a row whose minimum has ended


@njit(**BARE)
def is_same(one, other, field):
    tolerance = 2.0 * closest_point.MERGE / max(field[height_field.RATE_X], field[height_field.RATE_Y])
    return abs(one[0] - other[0]) <= tolerance and abs(one[1] - other[1]) <= tolerance


@njit(**BARE)
def offset_of(k, Q):
    return Q[k, surface_contact.OFFSET], Q[k, surface_contact.OFFSET + 1]


@njit(**BARE)
def has_minimum(k, row, Q):
    return np.int64(Q[k, surface_contact.MINIMA]) >> row & 1 != 0


@njit(**BARE)
def set_minimum(k, row, Q):
    Q[k, surface_contact.MINIMA] = np.int64(Q[k, surface_contact.MINIMA]) | np.int64(1) << row


@njit(**BARE)
def end_minimum(k, row, shortest, Q):
    """End the minimum of a row: it is apart, by `shortest` [m] or more. What else the row holds serves the end of its contact."""
    bit = np.int64(1) << row
    Q[k, surface_contact.MINIMA] = np.int64(Q[k, surface_contact.MINIMA]) & ~bit
    Q[k, surface_contact.ENDED] = np.int64(Q[k, surface_contact.ENDED]) | bit
    Q[k + row, surface_contact.DISTANCE] = max(Q[k + row, surface_contact.DISTANCE], shortest)


@njit(**BARE)
def reset_ended(k, Q):
    noted = np.int64(Q[k, surface_contact.ENDED])
    if noted != 0:
        ended = noted & ((1 << BASINS) - 1)
        for row in range(BASINS):
            if ended >> row & 1 != 0:
                Q[k + row, surface_contact.DISTANCE] = math.inf
        Q[k, surface_contact.ENDED] = ended << BASINS


@njit(**BARE)
def write_normal(k, normal, upper, Q):
    n_x, n_y, n_z = normal
    Q[k, surface_contact.NORMAL], Q[k, surface_contact.NORMAL + 1] = n_x, n_y
    Q[k, surface_contact.NORMAL + 2] = -n_z if upper else n_z


@njit(**BARE_CHUNK)
def follow(k, field, x, start, tables):
    """Move the minimum of row k from an offset `start` (2,) to where it is for a centre x (3,), in the plate's coordinates."""
    Q, D, radius, upper = tables.Q, tables.D, tables.S[tables.own[k], sphere.RADIUS], is_upper(tables.partner[k])
    curved = D[domain.CURVED + upper] != 0.0
    foot = closest(field, x, start[0], start[1])
    near = foot.distance < radius + D[domain.REACH]
    Q[k, surface_contact.OFFSET], Q[k, surface_contact.OFFSET + 1] = foot.x, foot.y
    Q[k, surface_contact.DISTANCE] = foot.distance
    bent = bent_jet(field, x, foot) if curved and near else foot.jet
    Q[k, surface_contact.RADIUS] = effective_radius(bent, radius) if curved else radius
    write_normal(k, foot.normal, upper, Q)
    if near:
        up, t, d = -1.0 if upper else 1.0, surface_contact.NORMAL_GRADIENT, surface_contact.GRADIENT
        xx, xy, xz, yy, yz, zz = normal_derivative(foot)
        Q[k, t], Q[k, t + 1], Q[k, t + 2], Q[k, t + 3], Q[k, t + 4], Q[k, t + 5] = xx, yy, zz, xy, up * xz, up * yz
        d_x, d_y, d_z = log_radius_gradient(foot, bent, radius) if curved else (0.0, 0.0, 0.0)
        Q[k, d], Q[k, d + 1], Q[k, d + 2] = d_x, d_y, up * d_z


@njit(**BARE_CHUNK)
def follow_all(k, field, x, shortest, tables):
    """Move all minima of the sphere whose first row is k; of two that meet, the one that jumped to the other ends."""
    Q, a, t = tables.Q, 0, surface_contact.START
    while np.int64(Q[k, surface_contact.MINIMA]) >> a != 0:
        if has_minimum(k, a, Q):
            o_x, o_y = offset_of(k + a, Q)
            d_x, d_y = o_x - Q[k + a, t], o_y - Q[k + a, t + 1]
            # it starts where it is if it goes on as in the last step
            steady = max(abs(d_x) * field[height_field.RATE_X], abs(d_y) * field[height_field.RATE_Y]) <= closest_point.LOCAL
            follow(k + a, field, x, (o_x + d_x, o_y + d_y) if steady else (o_x, o_y), tables)
            Q[k + a, t], Q[k + a, t + 1] = o_x, o_y
            for b in range(a):
                if has_minimum(k, b, Q) and is_same(offset_of(k + a, Q), offset_of(k + b, Q), field):
                    jumped = not is_same((o_x, o_y), offset_of(k + a, Q), field)
                    end_minimum(k, a if jumped else b, shortest, Q)
                    break
        a += 1


@njit(**BARE_CHUNK)
def search_all(k, field, x, limits, tables):
    """Search for the minima of the sphere whose first row is k. `limits` [m]: largest distance of one that gets a row, and the
    shortest one without contact."""
    Q, (farthest, shortest) = tables.Q, limits
    minima = Q[k : k + BASINS, surface_contact.NEARBY : surface_contact.NEARBY + 3]
    n = min(closest_point.find_minima(field, x, farthest, minima), BASINS)
    for a in range(BASINS):
        known = False  # a minimum that an earlier row has is no longer there to be claimed: else there are more minima than rows
        for m in range(n if has_minimum(k, a, Q) else 0):
            if minima[m, 2] < math.inf and is_same(offset_of(k + a, Q), (minima[m, 0], minima[m, 1]), field):
                known, minima[m, 2] = True, math.inf
        if has_minimum(k, a, Q) and not known:
            end_minimum(k, a, shortest, Q)
    a = 0
    for m in range(n):
        if minima[m, 2] < math.inf:
            while has_minimum(k, a, Q):
                a += 1
            follow(k + a, field, x, (minima[m, 0], minima[m, 1]), tables)
            Q[k + a, surface_contact.START], Q[k + a, surface_contact.START + 1] = offset_of(k + a, Q)
            set_minimum(k, a, Q)
    for d in range(3):
        Q[k, surface_contact.SEARCHED + d] = x[d]


@njit(**BARE)
def may_split(k, field, radius, reach, Q):
    """Return whether a second minimum may begin beside one that touches. The normal turns by the sum of k_i/(1 + k_i D),
    principal curvatures k_i, distance D: large and negative in a narrow hollow."""
    a, t = 0, surface_contact.NORMAL_GRADIENT
    while (radius + reach) * field[height_field.MAX_CURVATURE] >= 1.0 and np.int64(Q[k, surface_contact.MINIMA]) >> a != 0:
        if has_minimum(k, a, Q) and Q[k + a, surface_contact.DISTANCE] < radius + reach:
            if (Q[k + a, t] + Q[k + a, t + 1] + Q[k + a, t + 2]) * radius < HOLLOW:
                return True
        a += 1
    return False


@njit(**BARE)
def search_is_due(k, field, x, sphere_reach, Q):
    """Return whether the sphere whose first row is k has moved far since the last search. `sphere_reach`: radius, reach."""
    t, (radius, reach) = surface_contact.SEARCHED, sphere_reach
    d_x, d_y, d_z = x[0] - Q[k, t], x[1] - Q[k, t + 1], x[2] - Q[k, t + 2]
    moved = (MOVED_TOUCHING if may_split(k, field, radius, reach, Q) else MOVED) * radius
    return not d_x * d_x + d_y * d_y + d_z * d_z <= moved * moved


@njit(**BARE_CHUNK)
def update_sphere(k, field, tables):
    Q, S, i, upper = tables.Q, tables.S, tables.own[k], is_upper(tables.partner[k])
    x = plates.to_surface(tables.partner[k], plates.three(S, i, sphere.POSITION), tables.P)
    radius, reach, height = S[i, sphere.RADIUS], tables.D[domain.REACH], x[2] - field[height_field.MAX_HEIGHT]
    farthest, shortest = radius * (1.0 + 1.1 * MOVED) + reach, APART * (radius + reach)
    tracked = abs(x[0]) + abs(x[1]) + abs(x[2]) < FARTHEST  # a guard stops a run with others, or with NaN
    none = Q[k, surface_contact.MINIMA] + Q[k, surface_contact.ENDED] == 0.0
    was_far = none and Q[k, surface_contact.SEARCHED] == math.inf and Q[k, surface_contact.RADIUS] != 0.0
    if height > farthest and was_far:
        Q[k, surface_contact.DISTANCE] = max(height, shortest)
        return
    reset_ended(k, Q)
    if tracked and height <= farthest:
        follow_all(k, field, x, shortest, tables)
        if search_is_due(k, field, x, (radius, reach), Q):
            search_all(k, field, x, (farthest, shortest), tables)
    else:
        for row in range(BASINS):
            if has_minimum(k, row, Q):
                end_minimum(k, row, shortest, Q)
        Q[k, surface_contact.SEARCHED] = math.inf
    if Q[k, surface_contact.MINIMA] == 0.0 and np.int64(Q[k, surface_contact.ENDED]) & ((1 << BASINS) - 1) == 0:
        # without minima: a bound of the distance, for the bound of the time step
        Q[k, surface_contact.DISTANCE] = max(height if tracked else math.inf, shortest)
        Q[k, surface_contact.RADIUS] = radius
        write_normal(k, (0.0, 0.0, 1.0), upper, Q)


@njit(**BARE)
def next_rough(k, last, tables):
    """Update the rows of flat plates and side walls from k on; return the first row of a sphere and a rough plate, or `last`."""
    Q, S = tables.Q, tables.S
    while k < last and (tables.upper if is_upper(tables.partner[k]) else tables.lower).shape[0] == 0:
        i, upper, basin = tables.own[k], is_upper(tables.partner[k]), (-1 - tables.partner[k]) % BASINS
        if basin == 0:
            Q[k, surface_contact.DISTANCE] = plates.height_above(tables.partner[k], i, S, tables.P)
            Q[k, surface_contact.NORMAL + 2] = -1.0 if upper else 1.0
        else:
            Q[k, surface_contact.DISTANCE] = plates.distance_to_wall(basin, i, S, -tables.D[domain.LENGTH_Y])
            Q[k, surface_contact.NORMAL + 1] = 1.0 if basin == NEAR_WALL else -1.0
        Q[k, surface_contact.RADIUS] = S[i, sphere.RADIUS]
        k += 1
    return k


@entry(UPDATE, **OPTIONS, **NO_COUNTS)
def update(first, last, tables):
    """Update the rows of candidates first to last; those of a sphere and a plate are together, from basin 0 on."""
    k = next_rough(first, last, tables)
    while k < last:
        update_sphere(k, tables.upper if is_upper(tables.partner[k]) else tables.lower, tables)
        k = next_rough(k + BASINS, last, tables)
