"""Which pairs can touch before the next search: spheres near a plate, and spheres of different bodies near each other.

Candidates come out sorted (plates by sphere, then pairs by owner and partner; the sphere with the lower id owns a pair), so
history is carried over by one merge and nothing depends on threads.
"""

import numpy as np
from numba import njit

from .contacts import nearest_image
from .layout import EVERYTHING, ONLY_LOWER, ONLY_UPPER, P_Z, S_R, S_SIDE, S_X, S_Y, S_Z
from .options import INNER, OPTIONS


@njit(**OPTIONS)
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


@njit(**INNER)
def cell_of(x, low, size, count, periodic):
    """Cell number along one axis: wrapped if periodic, else clipped to the range."""
    c = int(np.floor((x - low) / size))
    if periodic:
        return c % count
    return min(max(c, 0), count - 1)


@njit(**INNER)
def fill_cells(S, low, size, count, periodic, head, follow, place):
    """Linked lists of spheres by cell, ascending ids."""
    for h in range(head.shape[0]):
        head[h] = -1
    for i in range(S.shape[0] - 1, -1, -1):
        a = cell_of(S[i, S_X], low[0], size[0], count[0], periodic[0])
        b = cell_of(S[i, S_Y], low[1], size[1], count[1], periodic[1])
        c = cell_of(S[i, S_Z], low[2], size[2], count[2], np.bool_(False))
        place[i, 0], place[i, 1], place[i, 2] = a, b, c
        cell = (a * count[1] + b) * count[2] + c
        follow[i] = head[cell]
        head[cell] = i


@njit(**INNER)
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


@njit(**INNER)
def collect(i, S, body, l_x, l_y, skin, head, follow, place, count, periodic, found):
    """Partners j > i of sphere i within reach plus skin, into `found`, sorted; returns how many."""
    m = 0
    for a in range(-1, 2):
        c_x = neighbour(place[i, 0], a, count[0], periodic[0])
        for b in range(-1, 2):
            c_y = neighbour(place[i, 1], b, count[1], periodic[1])
            for c in range(-1, 2):
                c_z = neighbour(place[i, 2], c, count[2], np.bool_(False))
                if c_x < 0 or c_y < 0 or c_z < 0:
                    continue
                j = head[(c_x * count[1] + c_y) * count[2] + c_z]
                while j >= 0:
                    if j > i and body[j] != body[i] and S[j, S_SIDE] == EVERYTHING:
                        d_x = nearest_image(S[i, S_X] - S[j, S_X], l_x)
                        d_y = nearest_image(S[i, S_Y] - S[j, S_Y], l_y)
                        d_z = S[i, S_Z] - S[j, S_Z]
                        reach = S[i, S_R] + S[j, S_R] + skin
                        if d_x * d_x + d_y * d_y + d_z * d_z < reach * reach:
                            p = m
                            while p > 0 and found[p - 1] > j:
                                found[p] = found[p - 1]
                                p -= 1
                            found[p] = j
                            m += 1
                    j = follow[j]
    return m


@njit(**OPTIONS)
def pair_candidates(S, body, l_x, l_y, skin, low, size, count, periodic, n, own, partner):
    """Append the sphere pairs within `skin` from slot n on; returns the number of slots (also beyond the capacity)."""
    n_spheres = S.shape[0]
    head = np.empty(count[0] * count[1] * count[2], np.int64)
    follow, place = np.empty(n_spheres, np.int64), np.empty((n_spheres, 3), np.int64)
    found = np.empty(n_spheres, np.int64)
    fill_cells(S, low, size, count, periodic, head, follow, place)
    for i in range(n_spheres):
        if S[i, S_SIDE] != EVERYTHING:
            continue
        m = collect(i, S, body, l_x, l_y, skin, head, follow, place, count, periodic, found)
        for p in range(m):
            if n < own.shape[0]:
                own[n], partner[n] = i, found[p]
            n += 1
    return n


@njit(**INNER)
def rank(j):
    """Order of partners of one owner within the plates' or the pairs' part."""
    return j if j >= 0 else (0 if j == -1 else 1)


@njit(**OPTIONS)
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


@njit(**OPTIONS)
def incidences(n, own, partner, body, n_bodies):
    """For each body the slots it takes part in, in their order: (edges, 2 slot + 1 if it is the partner)."""
    edges = np.zeros(n_bodies + 1, np.int64)
    for k in range(n):
        edges[body[own[k]] + 1] += 1
        if partner[k] >= 0:
            edges[body[partner[k]] + 1] += 1
    for b in range(n_bodies):
        edges[b + 1] += edges[b]
    at = np.empty(n_bodies, np.int64)
    for b in range(n_bodies):
        at[b] = edges[b]
    incidence = np.empty(edges[n_bodies], np.int64)
    for k in range(n):
        b = body[own[k]]
        incidence[at[b]] = 2 * k
        at[b] += 1
        if partner[k] >= 0:
            b = body[partner[k]]
            incidence[at[b]] = 2 * k + 1
            at[b] += 1
    return edges, incidence
