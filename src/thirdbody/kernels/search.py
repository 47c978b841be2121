"""Which pairs can touch before the next search: spheres near a plate, and spheres of different bodies near each other.

Candidates come out sorted (plates by sphere, then pairs by owner and partner; the sphere with the lower id owns a pair), so
history is carried over by one merge and nothing depends on threads.
"""

import numpy as np
from numba import njit

from .four import LANES, any_below, load, rounded, spread
from .layout import EVERYTHING, ONLY_LOWER, ONLY_UPPER, P_Z, S_R, S_SIDE, S_X, S_Y, S_Z
from .options import BARE, DIRECT, NO_COUNTS
from .periodic import image, inverse


@njit(**DIRECT, **NO_COUNTS)
def plate_candidates(S, P, body, patch, has_lower, has_upper, skin, own, partner):
    """Fill own and partner with the spheres within `skin` of a plate; returns how many (also beyond the capacity)."""
    n = 0
    for i in range(S.shape[0]):
        if has_lower and S[i, S_SIDE] != ONLY_UPPER and S[i, S_Z] - S[i, S_R] < skin:
            if n < own.shape[0]:
                own[n], partner[n] = i, -1
            n += 1
        if has_upper and S[i, S_SIDE] != ONLY_LOWER:
            p = patch[body[i]]
            if P[p, P_Z] - S[i, S_Z] - S[i, S_R] < skin:
                if n < own.shape[0]:
                    own[n], partner[n] = i, -2 - p
                n += 1
    return n


@njit(**BARE)
def cell_of(x, low, size, count, periodic):
    """Cell number along one axis: wrapped if periodic, else clipped to the range."""
    c = np.int64(np.floor((x - low) / size))
    if periodic:
        return c % count
    return min(max(c, 0), count - 1)


@njit(**BARE)
def fill_cells(S, body, low, size, count, periodic, edges, place, Q, who):
    """The spheres that meet others in the order of their cells, z fastest, then of their numbers: centre and radius into Q (4, n
    and some), number and body into `who`, and where each cell begins, one further on, into `edges`, which is zero at first."""
    for i in range(S.shape[0]):
        a = cell_of(S[i, S_X], low[0], size[0], count[0], periodic[0])
        b = cell_of(S[i, S_Y], low[1], size[1], count[1], periodic[1])
        c = cell_of(S[i, S_Z], low[2], size[2], count[2], np.bool_(False))
        place[i, 0], place[i, 1], place[i, 2] = a, b, c
        edges[(a * count[1] + b) * count[2] + c + 2] += S[i, S_SIDE] == EVERYTHING
    for h in range(2, edges.shape[0]):
        edges[h] += edges[h - 1]
    for i in range(S.shape[0]):
        if S[i, S_SIDE] == EVERYTHING:
            cell = (place[i, 0] * count[1] + place[i, 1]) * count[2] + place[i, 2]
            at = edges[cell + 1]
            edges[cell + 1] += 1
            Q[0, at], Q[1, at], Q[2, at], Q[3, at] = S[i, S_X], S[i, S_Y], S[i, S_Z], S[i, S_R]
            who[at, 0], who[at, 1] = i, body[i]


@njit(**BARE)
def neighbour(c, step, count, periodic):
    """Cell number one step along an axis, or -1 if there is none or it was visited already (fewer than three cells)."""
    if count == 1:
        return 0 if step == 0 else -1
    if count == 2 and step == -1 and periodic:
        return -1
    n = c + step
    if 0 <= n < count:
        return n
    return n - step * count if periodic else -1


@njit(**BARE)
def sort_in(j, m, found):
    """Put j into the sorted list of m numbers."""
    p = m
    while p > 0 and found[p - 1] > j:
        found[p] = found[p - 1]
        p -= 1
    found[p] = j


@njit(**BARE)
def any_near(k, x, y, z, r, l_x, l_y, c_x, c_y, Q):
    """Whether any of four spheres from place k on, or of what stands behind them, is nearer than r and its radius."""
    d_x, d_y, d_z = spread(x) - load(Q, 0, k), spread(y) - load(Q, 1, k), spread(z) - load(Q, 2, k)
    d_x, d_y = d_x - spread(l_x) * rounded(d_x * spread(c_x)), d_y - spread(l_y) * rounded(d_y * spread(c_y))
    reach = spread(r) + load(Q, 3, k)
    return any_below(d_x * d_x + d_y * d_y + d_z * d_z, reach * reach)


@njit(**BARE)
def collect(i, S, b, l_x, l_y, c_x, c_y, skin, place, edges, Q, who, count, periodic, found):
    """Partners j > i of sphere i of body b within reach plus skin, into `found`, sorted; returns how many. c = 1/l, 0 if not
    periodic. Few of those in the cells around are near: four are asked at once."""
    m = np.int64(0)
    x, y, z, r = S[i, S_X], S[i, S_Y], S[i, S_Z], S[i, S_R] + skin
    below, above = max(place[i, 2] - 1, 0), min(place[i, 2] + 1, count[2] - 1)
    for step in range(9):
        cell_x = neighbour(place[i, 0], step // 3 - 1, count[0], periodic[0])
        cell_y = neighbour(place[i, 1], step % 3 - 1, count[1], periodic[1])
        there = (cell_x >= 0) & (cell_y >= 0)
        base = (cell_x * count[1] + cell_y) * count[2] if there else 0
        end = edges[base + above + 1] if there else 0
        for first in range(edges[base + below] if there else 0, end, LANES):
            if any_near(np.int64(first), x, y, z, r, l_x, l_y, c_x, c_y, Q):
                for p in range(first, min(first + LANES, end)):
                    k = np.uint64(p)
                    d_x, d_y, d_z = image(x - Q[0, k], l_x, c_x), image(y - Q[1, k], l_y, c_y), z - Q[2, k]
                    reach = r + Q[3, k]
                    found[m] = who[k, 0]
                    m += np.int64((d_x * d_x + d_y * d_y + d_z * d_z < reach * reach) & (who[k, 0] > i) & (who[k, 1] != b))
    for e in range(1, m):
        sort_in(found[e], e, found)
    return m


@njit(**DIRECT, **NO_COUNTS)
def search_pairs(S, body, l_x, l_y, skin, low, size, count, periodic, edges, place, Q, who, found, n, own, partner):
    """`pair_candidates` with room for the cells and for the partners of a sphere."""
    fill_cells(S, body, low, size, count, periodic, edges, place, Q, who)
    c_x, c_y = inverse(l_x), inverse(l_y)
    for i in range(S.shape[0]):
        if S[i, S_SIDE] == EVERYTHING:
            m = collect(i, S, body[i], l_x, l_y, c_x, c_y, skin, place, edges, Q, who, count, periodic, found)
            for p in range(min(m, own.shape[0] - n)):
                own[n + p], partner[n + p] = i, found[p]
            n += m
    return n


def pair_candidates(S, body, l_x, l_y, skin, low, size, count, periodic, n, own, partner):
    """Append the sphere pairs within `skin` from slot n on; returns the number of slots (also beyond the capacity)."""
    # made here, since a kernel would compile each of these calls
    many = len(S)
    edges, place = np.zeros(int(np.prod(count)) + 2, np.int32), np.empty((many, 3), np.int32)
    Q, who, found = np.full((4, many + LANES), np.inf), np.empty((many, 2), np.int32), np.empty(many + 1, np.int32)
    return search_pairs(S, body, l_x, l_y, skin, low, size, count, periodic, edges, place, Q, who, found, n, own, partner)


@njit(**BARE)
def rank(j):
    """Order of partners of one owner within the plates' or the pairs' part."""
    return j if j >= 0 else (0 if j == -1 else 1)


@njit(**DIRECT, **NO_COUNTS)
def carry_history(first, last, own, partner, H, old_first, old_last, old_own, old_partner, old_H):
    """Copy the memory of candidates that were candidates before, within one sorted part of the list."""
    o = old_first
    for k in range(first, last):
        while o < old_last and (
            old_own[o] < own[k] or (old_own[o] == own[k] and rank(old_partner[o]) < rank(partner[k]))
        ):
            o += 1
        if o < old_last and old_own[o] == own[k] and rank(old_partner[o]) == rank(partner[k]):
            for h in range(H.shape[1]):
                H[k, h] = old_H[o, h]


def incidences(n, own, partner, n_spheres):
    """For each sphere the slots it takes part in, in their order: (edges, 2 slot + 1 if it is the partner)."""
    edges = np.zeros(n_spheres + 1, np.int32)
    incidence = np.empty(n + np.count_nonzero(partner[:n] >= 0), np.int32)
    list_slots(n, own, partner, edges, np.empty(n_spheres, np.int32), incidence)
    return edges, incidence


@njit(**DIRECT, **NO_COUNTS)
def list_slots(n, own, partner, edges, at, incidence):
    """Fill the tables of `incidences`; edges: zero at first, `at`: room."""
    for k in range(n):
        edges[own[k] + 1] += 1
        if partner[k] >= 0:
            edges[partner[k] + 1] += 1
    for s in range(at.shape[0]):
        at[s] = edges[s]
        edges[s + 1] += edges[s]
    for k in range(n):
        s = own[k]
        incidence[at[s]] = 2 * k
        at[s] += 1
        if partner[k] >= 0:
            s = partner[k]
            incidence[at[s]] = 2 * k + 1
            at[s] += 1
