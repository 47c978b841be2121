"""Which pairs can touch before the next search: spheres near a plate, and spheres of different bodies near each other.

Candidates come out sorted (plates by sphere, then pairs by owner and partner; the sphere with the lower id owns a pair), so
history is carried over by one merge and nothing depends on threads.
"""

import numpy as np
from numba import njit

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
def fill_cells(S, low, size, count, periodic, head, follow, place):
    """Linked lists of spheres by cell, descending ids."""
    for h in range(head.shape[0]):
        head[h] = -1
    for i in range(S.shape[0]):
        a = cell_of(S[i, S_X], low[0], size[0], count[0], periodic[0])
        b = cell_of(S[i, S_Y], low[1], size[1], count[1], periodic[1])
        c = cell_of(S[i, S_Z], low[2], size[2], count[2], np.bool_(False))
        place[i, 0], place[i, 1], place[i, 2] = a, b, c
        cell = (a * count[1] + b) * count[2] + c
        follow[i] = head[cell]
        head[cell] = i


@njit(**BARE)
def neighbour(c, step, count, periodic):
    """Cell number one step along an axis, or -1 if there is none or it was visited already (fewer than three cells)."""
    if count == 1:
        return 0 if step == 0 else -1
    if count == 2 and step == -1 and periodic:
        return -1
    n = c + step
    if periodic:
        return n % count
    return n if 0 <= n < count else -1


@njit(**BARE)
def sort_in(j, m, found):
    """Put j into the sorted list of m numbers."""
    p = m
    while p > 0 and found[p - 1] > j:
        found[p] = found[p - 1]
        p -= 1
    found[p] = j


@njit(**BARE)
def collect(i, S, body, l_x, l_y, c_x, c_y, skin, head, follow, place, count, periodic, found):
    """Partners j > i of sphere i within reach plus skin, into `found`, sorted; returns how many. c = 1/l, 0 if not periodic."""
    m = np.int64(0)
    x, y, z, r, b = S[i, S_X], S[i, S_Y], S[i, S_Z], S[i, S_R] + skin, body[i]
    for step in range(27):
        a, e, c = step // 9 - 1, step // 3 % 3 - 1, step % 3 - 1
        cell_x = neighbour(place[i, 0], a, count[0], periodic[0])
        cell_y = neighbour(place[i, 1], e, count[1], periodic[1])
        cell_z = neighbour(place[i, 2], c, count[2], np.bool_(False))
        j = np.int64(-1)
        if (cell_x >= 0) & (cell_y >= 0) & (cell_z >= 0):
            j = head[(cell_x * count[1] + cell_y) * count[2] + cell_z]
        while j > i:  # lists run down
            d_x, d_y, d_z = x - S[j, S_X], y - S[j, S_Y], z - S[j, S_Z]
            d_x, d_y = image(d_x, l_x, c_x), image(d_y, l_y, c_y)
            reach = r + S[j, S_R]
            if d_x * d_x + d_y * d_y + d_z * d_z < reach * reach:
                if body[j] != b and S[j, S_SIDE] == EVERYTHING:
                    sort_in(j, m, found)
                    m += 1
            j = follow[j]
    return m


@njit(**DIRECT, **NO_COUNTS)
def search_pairs(S, body, l_x, l_y, skin, low, size, count, periodic, head, follow, place, found, n, own, partner):
    """`pair_candidates` with room for the cells and for the partners of a sphere."""
    fill_cells(S, low, size, count, periodic, head, follow, place)
    c_x, c_y = inverse(l_x), inverse(l_y)
    for i in range(S.shape[0]):
        if S[i, S_SIDE] == EVERYTHING:
            m = collect(i, S, body, l_x, l_y, c_x, c_y, skin, head, follow, place, count, periodic, found)
            for p in range(min(m, own.shape[0] - n)):
                own[n + p], partner[n + p] = i, found[p]
            n += m
    return n


def pair_candidates(S, body, l_x, l_y, skin, low, size, count, periodic, n, own, partner):
    """Append the sphere pairs within `skin` from slot n on; returns the number of slots (also beyond the capacity)."""
    # made here, since a kernel would compile each of these calls
    head, follow = np.empty(int(np.prod(count)), np.int64), np.empty(len(S), np.int64)
    place, found = np.empty((len(S), 3), np.int64), np.empty(len(S), np.int64)
    return search_pairs(S, body, l_x, l_y, skin, low, size, count, periodic, head, follow, place, found, n, own, partner)


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
