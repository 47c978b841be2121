"""All local minima of the distance between a point and a height field within some reach: where a sphere can touch it.

Cells are visited from blocks to smaller blocks; a block is left out where its highest point is out of reach, and a cell where the
derivative of the distance is larger at its centre than can vanish within it. In each of the others Newton's method goes downhill
from its centre, and from those of its quarters where the surface is sharper than the reach allows for one minimum per cell.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.closest_point import closest, gradient_of
from thirdbody.kernels.height_field import jet_at, within_period
from thirdbody.kernels.tables import height_field as head

MERGE = 1e-3
"""In units of a cell: minima that are nearer to each other are one."""


@njit(**BARE)
def interleaved(m, first):
    """Return the number of every second bit of m, from bit `first` on: a coordinate of block m along the curve of Morton."""
    n, bit = np.int64(0), np.int64(0)
    m >>= first
    while m > 0:
        n |= (m & 1) << bit
        m >>= 2
        bit += 1
    return n


@njit(**BARE)
def outside(low, high):
    """Return the distance of 0 from an interval."""
    return max(low, -high, 0.0)


@njit(**BARE)
def is_unique(field, z):
    """Return whether the squared distance from any point at the height z is convex: it then has one minimum."""
    depth = max(abs(z - field[head.MIN_HEIGHT]), abs(field[head.MAX_HEIGHT] - z))
    return depth * field[head.MAX_CURVATURE] < 1.0


@njit(**BARE)
def insert(foot, reach, merge, minima, n):
    """Insert a minimum into the n rows so far, by distance, then place, if it is within reach and new; return the new n.

    Of more than fit the nearest are kept; n then counts one more than rows.
    """
    if not abs(foot.distance) <= reach:
        return n
    o_x, o_y, rows = foot.x, foot.y, minima.shape[0]
    for k in range(min(n, rows)):
        if abs(minima[k, 0] - o_x) <= merge and abs(minima[k, 1] - o_y) <= merge:
            return n
    k = min(n, rows)
    while k > 0 and (foot.distance, o_x, o_y) < (minima[k - 1, 2], minima[k - 1, 0], minima[k - 1, 1]):
        if k < rows:
            minima[k, 0], minima[k, 1], minima[k, 2] = minima[k - 1, 0], minima[k - 1, 1], minima[k - 1, 2]
        k -= 1
    if k < rows:
        minima[k, 0], minima[k, 1], minima[k, 2] = o_x, o_y, foot.distance
    return min(n + 1, rows + 1)


@njit(**BARE)
def can_vanish(field, centre, o_x, o_y, half, reach):
    """Return whether the derivative of the squared distance can vanish within `half` [m] of an offset (o_x, o_y) [m]."""
    jet = jet_at(field, centre[0] + o_x, centre[1] + o_y)
    g_x, g_y = gradient_of(jet, o_x, o_y, jet.h - centre[2])
    slope = field[head.MAX_SLOPE]
    largest = 1.0 + slope * slope + (reach + slope * half) * field[head.MAX_CURVATURE]
    return g_x * g_x + g_y * g_y <= largest * largest * half * half


@njit(**BARE_CHUNK)
def search_cell(field, centre, o_x, o_y, reach, minima, n):
    """Insert the minima downhill from the four quarters of the cell around an offset (o_x, o_y) [m]; return the new n."""
    d_x, d_y = 1.0 / field[head.RATE_X], 1.0 / field[head.RATE_Y]
    half, merge = 0.5 * math.sqrt(d_x * d_x + d_y * d_y), MERGE * min(d_x, d_y)
    if not can_vanish(field, centre, o_x, o_y, half, reach):
        return n
    if reach * field[head.MAX_CURVATURE] < 1.0:
        return insert(closest(field, centre, o_x, o_y), reach, merge, minima, n)
    for quarter in range(4):
        q_x, q_y = o_x + d_x * (0.5 * (quarter & 1) - 0.25), o_y + d_y * (0.5 * (quarter >> 1) - 0.25)
        if can_vanish(field, centre, q_x, q_y, 0.5 * half, reach):
            n = insert(closest(field, centre, q_x, q_y), reach, merge, minima, n)
    return n


@njit(**BARE)
def is_near(field, level, i, j, low, z, reach):
    """Return whether block (i, j) of a level may be within reach; `low` (2,): its first corner from below the centre [m]."""
    n_y, size = np.int64(field[head.COUNT_Y]), np.int64(1) << level
    d_x, d_y = 1.0 / field[head.RATE_X], 1.0 / field[head.RATE_Y]
    across = (n_y + size - 1) >> level
    at = np.int64(field[head.OFFSET + level - 1]) + i * across + j if level > 0 else np.int64(0)
    up = max(z - field[at], 0.0) if level > 0 else 0.0
    x, y = outside(low[0], low[0] + size * d_x), outside(low[1], low[1] + size * d_y)
    return x * x + y * y + up * up <= reach * reach


@njit(**BARE)
def search_period(field, centre, origin, reach, minima, n):
    """Insert the minima in one period; return the new n. `origin` (2,): where it begins, from below the centre [m]."""
    n_x, n_y, top = np.int64(field[head.COUNT_X]), np.int64(field[head.COUNT_Y]), np.int64(field[head.LEVELS])
    d_x, d_y = 1.0 / field[head.RATE_X], 1.0 / field[head.RATE_Y]
    m, level, end = np.int64(0), top, np.int64(1) << (2 * top)
    while m < end:
        x, y = interleaved(m, 0), interleaved(m, 1)
        low = origin[0] + x * d_x, origin[1] + y * d_y
        if x < n_x and y < n_y and is_near(field, level, x >> level, y >> level, low, centre[2], reach):
            if level > 0:
                level -= 1
                continue
            n = search_cell(field, centre, low[0] + 0.5 * d_x, low[1] + 0.5 * d_y, reach, minima, n)
        m += np.int64(1) << (2 * level)
        while level < top and m & ((np.int64(1) << (2 * (level + 1))) - 1) == 0:
            level += 1
    return n


@njit(**BARE_CHUNK)
def find_minima(field, centre, reach, minima):
    """Write all local minima of the distance of a centre (3,) [m] that are at most `reach` [m] away; return their number.

    Rows of `minima`, the nearest first: offset (x, y) from below the centre, and distance [m], negative below the surface. Of
    more minima than rows the nearest are kept, and the number is one more than rows.
    """
    length_x, length_y = field[head.LENGTH_X], field[head.LENGTH_Y]
    if centre[2] - reach > field[head.MAX_HEIGHT]:
        return np.int64(0)
    x, y = within_period(centre[0], length_x), within_period(centre[1], length_y)
    reduced, n = (x, y, centre[2]), np.int64(0)
    if is_unique(field, centre[2]):
        return insert(closest(field, reduced, 0.0, 0.0), reach, 0.0, minima, n)
    for i in range(math.floor((x - reach) / length_x), math.floor((x + reach) / length_x) + 1):
        for j in range(math.floor((y - reach) / length_y), math.floor((y + reach) / length_y) + 1):
            n = search_period(field, reduced, (i * length_x - x, j * length_y - y), reach, minima, n)
    return n
