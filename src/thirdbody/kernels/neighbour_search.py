"""Search for candidates: pairs of sphere and plate, or of spheres, that may touch before the next search.

Candidates come out sorted (plates by sphere, side and basin, then pairs by owner and partner; the sphere with the lower number
owns a pair), so history is carried over by one merge and nothing depends on threads.
"""

from collections import namedtuple

import numpy as np
from numba import njit, types

from thirdbody.jit.options import BARE, DIRECT, NO_COUNTS, entry
from thirdbody.jit.simd import LANES, broadcast, less_mask, load
from thirdbody.jit.threads import distribute, pieces_of
from thirdbody.kernels import plates
from thirdbody.kernels.arguments import Box
from thirdbody.kernels.plates import is_sphere, order_on_sphere, partner_code
from thirdbody.kernels.tables import EVERYTHING, ONLY_LOWER, ONLY_UPPER, sphere
from thirdbody.kernels.vectors import images, inverse

Grid = namedtuple("Grid", "low size cells periodic length_x length_y")
"""Cells of the search, each at least as large as the interaction range: lowest corner (3,) and size of a cell (3,) [m], number of
cells along each axis (3,), whether x and y are periodic (2,), and their periodic lengths [m] or 0."""

CellLists = namedtuple("CellLists", "edges cells Q")
"""Scratch of a search: where each cell begins in Q (zero at first), the cell of each sphere, spheres in order of cells."""

Spheres = namedtuple("Spheres", "body side")
"""What a search needs of the spheres besides their places: body of each, and what it can touch (`State.side`)."""

CandidateRows = namedtuple("CandidateRows", "first last own partner table")
"""Rows first to last of a table with a row per candidate."""

_I, _I1, _S1 = types.int64, types.Array(types.int64, 1, "C"), types.Array(types.int32, 1, "C")
_S2 = types.Array(types.int32, 2, "C")
_F, _F1, _F2 = types.float64, types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
_GRID = types.NamedTuple((_F1, _F1, _I1, types.Array(types.boolean, 1, "C"), _F, _F), Grid)
_LISTS, _ROWS = types.NamedTuple((_S1, _S1, _F2), CellLists), types.NamedTuple((_I, _I, _S1, _S1, _F2), CandidateRows)
_SPHERES = types.NamedTuple((_I1, types.Array(types.int8, 1, "C")), Spheres)
_LIMITS = types.Tuple((types.Tuple((_I, _F)), types.Tuple((_I, _F)), _F))


@entry(_I(_F2, _F2, _SPHERES, _I1, _LIMITS, _S1, _S1), **DIRECT, **NO_COUNTS)
def plate_candidates(S, P, spheres, patch_of, limits, own, partner):
    """List the spheres near a plate; return their number, also beyond the capacity. `limits` of both plates: number of basins, 0
    without the plate, and the largest height of the lowest point of a sphere above its plane [m]; then the distance between side
    walls [m], 0 without."""
    n = np.int64(0)
    for i in range(S.shape[0]):
        for plate in range(2):
            basins, height = limits[0] if plate == 0 else limits[1]
            p = patch_of[spheres.body[i]] if plate == 1 else -1
            within = plates.height_above(partner_code(p, 0), i, S, P) - S[i, sphere.RADIUS] < height
            for basin in range(basins if within and spheres.side[i] != (ONLY_LOWER if plate == 1 else ONLY_UPPER) else 0):
                if n < own.shape[0]:
                    own[n], partner[n] = i, partner_code(p, basin)
                n += 1
            for basin in range(plates.NEAR_WALL, plates.FAR_WALL + 1 if plate == 0 and limits[2] > 0.0 else 0):
                gap = plates.distance_to_wall(basin, i, S, limits[2]) - S[i, sphere.RADIUS]
                if gap < height and spheres.side[i] != ONLY_UPPER:
                    if n < own.shape[0]:
                        own[n], partner[n] = i, partner_code(p, basin)
                    n += 1
    return n


@njit(**BARE)
def cell_of(x, low, size, count, periodic):
    c = np.int64(np.floor((x - low) / size))
    return c % count if periodic else min(max(c, 0), count - 1)


@entry(types.void(_F2, _SPHERES, _GRID, _LISTS), **DIRECT, **NO_COUNTS)
def fill_cells(S, spheres, grid, lists):
    """Sort the spheres that can touch others by cell (z fastest), then by number, into Q (6, n + padding): centre, radius,
    number, body. `edges`: where each cell begins, shifted by one."""
    (low, size, count, periodic, _, _), (edges, cells, Q) = grid, lists
    for i in range(S.shape[0]):
        a = cell_of(S[i, sphere.X], low[0], size[0], count[0], periodic[0])
        b = cell_of(S[i, sphere.Y], low[1], size[1], count[1], periodic[1])
        c = cell_of(S[i, sphere.Z], low[2], size[2], count[2], np.bool_(False))
        cells[i] = (a * count[1] + b) * count[2] + c
        edges[cells[i] + 2] += spheres.side[i] == EVERYTHING
    for h in range(2, edges.shape[0]):
        edges[h] += edges[h - 1]
    for i in range(S.shape[0]):
        if spheres.side[i] == EVERYTHING:
            at = edges[cells[i] + 1]
            edges[cells[i] + 1] += 1
            Q[0, at], Q[1, at], Q[2, at], Q[3, at] = S[i, sphere.X], S[i, sphere.Y], S[i, sphere.Z], S[i, sphere.RADIUS]
            Q[4, at], Q[5, at] = i, spheres.body[i]


@njit(**BARE)
def neighbour(c, step, count, periodic):
    """Return the cell one step along an axis; -1: none, or visited already (fewer than three cells)."""
    if count == 1:
        return 0 if step == 0 else -1
    if count == 2 and step == -1 and periodic:
        return -1
    n = c + step
    if 0 <= n < count:
        return n
    return n - step * count if periodic else -1


@njit(**BARE)
def near(p, k, skin, box, Q):
    """Return as bits which of the spheres k to k + 3 are within `skin` of sphere p and of another body."""
    d_x, d_y, d_z = broadcast(Q[0, p]) - load(Q, 0, k), broadcast(Q[1, p]) - load(Q, 1, k), broadcast(Q[2, p]) - load(Q, 2, k)
    d_x, d_y = images(d_x, box.length_x, box.inverse_x), images(d_y, box.length_y, box.inverse_y)
    reach, other = broadcast(Q[3, p] + skin) + load(Q, 3, k), broadcast(Q[5, p]) - load(Q, 5, k)
    return less_mask(d_x * d_x + d_y * d_y + d_z * d_z, reach * reach) & less_mask(broadcast(0.0), other * other)


@njit(**BARE)
def scan(p, first, end, skin, box, Q, pairs, m):
    """Append the near pairs of sphere p with elements first to end; return their number, also beyond the capacity."""
    for k in range(first, end, LANES):
        bits = near(p, np.int64(k), skin, box, Q)
        if bits != 0:
            for t in range(min(LANES, end - k)):
                one, other, at = Q[4, p], Q[4, k + t], min(m, pairs.shape[1] - 1)
                pairs[0, at], pairs[1, at] = min(one, other), max(one, other)
                m += bits >> t & 1
    return m


@entry(_I(_I, _I, _F, _GRID, _LISTS, _I1, _S2), nogil=True, **DIRECT, **NO_COUNTS)
def collect(first, last, skin, grid, lists, columns, pairs):
    """List the pairs within `skin` [m] whose first sphere is in cell columns first to last - 1, lower number first, unsorted;
    return their number, also beyond the capacity. `columns`: scratch for cells around one."""
    count, edges, Q, m = grid.cells, lists.edges, lists.Q, np.int64(0)
    box = Box(grid.length_x, grid.length_y, inverse(grid.length_x), inverse(grid.length_y), 0.0)
    for column in range(first, last):
        base, a, b = column * count[2], column // count[1], column % count[1]
        beside = np.int64(0)  # bottom cells of the columns around that follow it in order: every pair is visited once
        for step in range(9):
            cell_x = neighbour(np.int64(a), step // 3 - 1, count[0], grid.periodic[0])
            cell_y = neighbour(np.int64(b), step % 3 - 1, count[1], grid.periodic[1])
            columns[beside] = (cell_x * count[1] + cell_y) * count[2]
            beside += np.int64((cell_x >= 0) & (cell_y >= 0) & (cell_x * count[1] + cell_y > column))
        for c in range(count[2]):
            low, high = max(c - 1, 0), min(c + 1, count[2] - 1) + 1
            for p in range(edges[base + c], edges[base + c + 1]):
                m = scan(p, np.int64(p + 1), np.int64(edges[base + high]), skin, box, Q, pairs, m)
                for e in range(beside):
                    begin, end = np.int64(edges[columns[e] + low]), np.int64(edges[columns[e] + high])
                    m = scan(p, begin, end, skin, box, Q, pairs, m)
    return m


@entry(types.void(_S2, _S1, _S1, _S1), **DIRECT, **NO_COUNTS)
def order_by_owner(pairs, at, own, partner):
    """Write the pairs in the order of their owners. `at` (spheres + 1,): zero at first, then where the next owner begins."""
    for e in range(pairs.shape[1]):
        at[pairs[0, e] + 1] += 1
    for i in range(1, at.shape[0]):
        at[i] += at[i - 1]
    for e in range(pairs.shape[1]):
        i = pairs[0, e]
        own[at[i]], partner[at[i]] = i, pairs[1, e]
        at[i] += 1


@entry(types.void(_I, _I, _S1, _S1), nogil=True, **DIRECT, **NO_COUNTS)
def order_partners(first, last, at, partner):
    begin = np.int64(at[first - 1] if first > 0 else 0)
    for i in range(first, last):
        end = np.int64(at[i])
        for e in range(begin + 1, end):
            j, p = partner[e], e
            while p > begin and partner[p - 1] > j:
                partner[p] = partner[p - 1]
                p -= 1
            partner[p] = j
        begin = end


MIN_SPHERES = 4096  # spheres that one thread alone searches as fast as two: some 0.5 ms


def pair_candidates(S, spheres, skin, grid, n, own, partner):
    """Append the sphere pairs within `skin` from candidate n on; return the new number, also beyond the capacity."""
    # allocated here, since a kernel would compile each of these calls
    many, columns, edges = len(S), int(grid.cells[0] * grid.cells[1]), np.zeros(int(np.prod(grid.cells)) + 2, np.int32)
    lists = CellLists(edges, np.empty(many, np.int32), np.full((6, many + LANES), np.inf))
    fill_cells(S, spheres, grid, lists)
    pairs_of: dict[int, np.ndarray] = {}

    def worker():
        around = np.empty(10, np.int64)

        def collect_piece(piece):
            pairs = np.empty((2, int(1.5 * len(own) * (piece[1] - piece[0]) / columns) + 64), np.int32)
            m = collect(*piece, skin, grid, lists, around, pairs)
            if m > pairs.shape[1]:
                pairs = np.empty((2, m), np.int32)
                collect(*piece, skin, grid, lists, around, pairs)
            pairs_of[piece[0]] = pairs[:, :m]

        return collect_piece

    distribute(pieces_of(0, columns, max(1, MIN_SPHERES * columns // max(many, 1))), worker)
    pairs = np.concatenate([pairs_of[first] for first in sorted(pairs_of)], axis=1)
    m = n + pairs.shape[1]
    if m <= len(own):
        at = np.zeros(many + 1, np.int32)
        order_by_owner(pairs, at, own[n:m], partner[n:m])
        distribute(pieces_of(0, many, MIN_SPHERES), lambda: lambda piece: order_partners(*piece, at, partner[n:m]))
    return m


@njit(**BARE)
def rank(own, j):
    return own, j if is_sphere(j) else order_on_sphere(j)


@entry(types.void(_ROWS, _ROWS), nogil=True, **DIRECT, **NO_COUNTS)
def carry_history(new, old):
    """Copy the rows of candidates that were candidates before, within one sorted part of the list. Both are `CandidateRows`."""
    o = old.first
    for k in range(new.first, new.last):
        it = rank(new.own[k], new.partner[k])
        while o < old.last and rank(old.own[o], old.partner[o]) < it:
            o += 1
        if o < old.last and rank(old.own[o], old.partner[o]) == it:
            for h in range(new.table.shape[1]):
                new.table[k, h] = old.table[o, h]


def incidences(n, own, partner, n_spheres):
    """Return the candidates of each sphere as compressed rows: (edges, 2 candidate + 1 if it is the partner)."""
    edges = np.zeros(n_spheres + 1, np.int32)
    incidence = np.empty(n + np.count_nonzero(partner[:n] >= 0), np.int32)
    list_slots(n, own, partner, edges, np.empty(n_spheres, np.int32), incidence)
    return edges, incidence


@entry(types.void(_I, _S1, _S1, _S1, _S1, _S1), **DIRECT, **NO_COUNTS)
def list_slots(n, own, partner, edges, at, incidence):
    for k in range(n):
        edges[own[k] + 1] += 1
        if is_sphere(partner[k]):
            edges[partner[k] + 1] += 1
    for s in range(at.shape[0]):
        at[s] = edges[s]
        edges[s + 1] += edges[s]
    for k in range(n):
        i, j = own[k], partner[k]
        incidence[at[i]] = 2 * k
        at[i] += 1
        if is_sphere(j):
            incidence[at[j]] = 2 * k + 1
            at[j] += 1
