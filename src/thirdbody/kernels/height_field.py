"""A periodic height field: height of a surface over its mean plane [m], a bicubic B-spline with continuous curvature.

It is one row of numbers, so that kernels get it as they get all tables:

* the head (`kernels.tables.height_field`): periods, numbers of cells, bounds;
* the coefficients, (count_x + 3, count_y + 3), x by x: coefficient (i, j) of the node at x = i length_x/count_x and
  y = j length_y/count_y is entry (i + 1, j + 1), and the three more per axis repeat the first ones, so no stencil wraps around;
* the pyramid (`closest_point`): level l has a block for 2^l by 2^l cells with a height that the surface does not exceed there.

Within a cell the surface lies between the smallest and the largest of its 16 coefficients, and its derivatives between those of
the differences of the coefficients (the convex hull of a B-spline): all bounds follow from this.
"""

import math
from collections import namedtuple

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.tables import height_field as head

SIXTH = 1.0 / 6.0

RAMP = 0.05
"""In units of a cell: within this distance of its border the third derivatives go over into those of the next cell
(`rounded_jet`)."""

Jet = namedtuple("Jet", "h x y xx xy yy xxx xxy xyy yyy")  # height of a surface and its derivatives at a point


@njit(**BARE)
def spline_weights(t):
    """Return the weights of four coefficients at t in [0, 1) of a cell: of the value and of its three derivatives."""
    u = 1.0 - t
    second, third = SIXTH * (4.0 + t * t * (3.0 * t - 6.0)), SIXTH * (1.0 + t * (3.0 + t * (3.0 - 3.0 * t)))
    return (
        (SIXTH * u * u * u, second, third, SIXTH * t * t * t),
        (-0.5 * u * u, 0.5 * t * (3.0 * t - 4.0), 0.5 * (1.0 + t * (2.0 - 3.0 * t)), 0.5 * t * t),
        (u, 3.0 * t - 2.0, 1.0 - 3.0 * t, t),
        (-1.0, 3.0, -3.0, 1.0),
    )


@njit(**BARE)
def weighted(w, c):
    return w[0] * c[0] + w[1] * c[1] + w[2] * c[2] + w[3] * c[3]


@njit(**BARE)
def four_from(field, at):
    return field[at], field[at + 1], field[at + 2], field[at + 3]


@njit(**BARE)
def across(w, rows):
    return weighted(w, rows[0]), weighted(w, rows[1]), weighted(w, rows[2]), weighted(w, rows[3])


@njit(**BARE)
def cell_of(x, rate, count):
    u = x * rate
    whole = math.floor(u)
    i = np.int64(whole)
    if i < 0 or i >= count:  # a remainder takes longer than all else here
        i %= np.int64(count)
    return i, u - whole


@njit(**BARE)
def within_period(x, length):
    return x - length * math.floor(x / length)


@njit(**BARE)
def has_heights(field):
    """Return whether a plate has a height field (`plates.is_rough`: one of both has) with more than one height."""
    return field.shape[0] > 0 and field[head.MAX_HEIGHT] > field[head.MIN_HEIGHT]


@njit(**BARE)
def jet_at(field, x, y):
    n_x, n_y = field[head.COUNT_X], field[head.COUNT_Y]
    rate_x, rate_y = field[head.RATE_X], field[head.RATE_Y]
    (i, t_x), (j, t_y) = cell_of(x, rate_x, n_x), cell_of(y, rate_y, n_y)
    stride = np.int64(n_y) + 3
    at = head.WIDTH + i * stride + j
    w, v = spline_weights(t_x), spline_weights(t_y)
    at_1, at_2, at_3 = at + stride, at + 2 * stride, at + 3 * stride
    rows = four_from(field, at), four_from(field, at_1), four_from(field, at_2), four_from(field, at_3)
    value, first, second, third = across(v[0], rows), across(v[1], rows), across(v[2], rows), across(v[3], rows)
    return Jet(
        weighted(w[0], value),
        weighted(w[1], value) * rate_x, weighted(w[0], first) * rate_y,
        weighted(w[2], value) * (rate_x * rate_x), weighted(w[1], first) * (rate_x * rate_y),
        weighted(w[0], second) * (rate_y * rate_y),
        weighted(w[3], value) * (rate_x * rate_x * rate_x), weighted(w[2], first) * (rate_x * rate_x * rate_y),
        weighted(w[1], second) * (rate_x * rate_y * rate_y), weighted(w[0], third) * (rate_y * rate_y * rate_y),
    )  # fmt: skip


@njit(**BARE)
def jet_beside(jet, d_x, d_y):
    """Return the jet at a small distance (d_x, d_y) [m] from that of `jet`, by Taylor's series."""
    h, x, y, xx, xy, yy, xxx, xxy, xyy, yyy = jet
    m_xx, m_xy, m_yy = xxx * d_x + xxy * d_y, xxy * d_x + xyy * d_y, xyy * d_x + yyy * d_y
    third_x, third_y = m_xx * d_x + m_xy * d_y, m_xy * d_x + m_yy * d_y
    second_x, second_y = xx * d_x + xy * d_y, xy * d_x + yy * d_y
    return Jet(
        h + (x + 0.5 * second_x + SIXTH * third_x) * d_x + (y + 0.5 * second_y + SIXTH * third_y) * d_y,
        x + second_x + 0.5 * third_x, y + second_y + 0.5 * third_y,
        xx + m_xx, xy + m_xy, yy + m_yy, xxx, xxy, xyy, yyy,
    )  # fmt: skip


@njit(**BARE)
def rounded(left, right, beyond, spacing):
    """Return the third derivative near a border, and what its ramp adds to the second one; `beyond`: distance from it [cells]."""
    rest = RAMP - abs(beyond)
    third = 0.5 * (left + right + (right - left) * beyond / RAMP)
    return third, 0.25 * (right - left) * spacing * rest * rest / RAMP


@njit(**BARE_CHUNK)
def rounded_jet(field, jet, x, y):
    """Return the jet at a point (x, y) [m] with second derivatives whose kinks between cells are rounded off. The third
    derivatives jump there, and with them the gradient force: a sphere that it traps there is in balance on neither side, and no
    step ends."""
    h, s_x, s_y, xx, xy, yy, xxx, xxy, xyy, yyy = jet
    rate_x, rate_y = field[head.RATE_X], field[head.RATE_Y]
    i, j = math.floor(x * rate_x + 0.5), math.floor(y * rate_y + 0.5)  # the nearest borders
    d_x, d_y = x * rate_x - i, y * rate_y - j
    if abs(d_x) < RAMP:
        left, right = jet_at(field, (i - 0.5) / rate_x, y).xxx, jet_at(field, (i + 0.5) / rate_x, y).xxx
        xxx, more = rounded(left, right, d_x, 1.0 / rate_x)
        xx += more
    if abs(d_y) < RAMP:
        left, right = jet_at(field, x, (j - 0.5) / rate_y).yyy, jet_at(field, x, (j + 0.5) / rate_y).yyy
        yyy, more = rounded(left, right, d_y, 1.0 / rate_y)
        yy += more
    return Jet(h, s_x, s_y, xx, xy, yy, xxx, xxy, xyy, yyy)


def pack_field(coefficients: np.ndarray, length_x: float, length_y: float) -> np.ndarray:
    """Return a height field as one row from its spline coefficients (count_x, count_y) [m] and its periods [m]."""
    wrapped = np.pad(np.asarray(coefficients, float), ((1, 2), (1, 2)), mode="wrap")
    count_x, count_y = np.shape(coefficients)
    levels = _pyramid(wrapped)
    first = head.WIDTH + wrapped.size
    row = np.zeros(head.WIDTH)
    row[head.LENGTH_X], row[head.LENGTH_Y], row[head.COUNT_X], row[head.COUNT_Y] = length_x, length_y, count_x, count_y
    row[head.RATE_X], row[head.RATE_Y] = count_x / length_x, count_y / length_y
    row[head.MAX_HEIGHT], row[head.MIN_HEIGHT] = wrapped.max(), wrapped.min()
    row[head.MAX_SLOPE], row[head.MAX_CURVATURE] = _bounds(wrapped, length_x / count_x, length_y / count_y)
    row[head.LEVELS] = len(levels)
    row[head.OFFSET24][: len(levels)] = first + np.cumsum([0] + [level.size for level in levels[:-1]])
    return np.concatenate([row, wrapped.ravel()] + [level.ravel() for level in levels])


def _bounds(c: np.ndarray, d_x: float, d_y: float) -> tuple[float, float]:
    along, across = np.diff(c, axis=0) / d_x, np.diff(c, axis=1) / d_y
    slope = math.hypot(np.abs(along).max(), np.abs(across).max())
    xx, yy, xy = np.diff(along, axis=0) / d_x, np.diff(across, axis=1) / d_y, np.diff(along, axis=1) / d_y
    return slope, float(max(np.abs(xx).max(), np.abs(yy).max()) + np.abs(xy).max())


def _pyramid(c: np.ndarray) -> list[np.ndarray]:
    blocks = c
    for axis in (0, 1):
        n = blocks.shape[axis] - 3
        blocks = np.max([np.take(blocks, range(k, k + n), axis) for k in range(4)], axis=0)
    levels: list[np.ndarray] = []
    while not levels or max(blocks.shape) > 1:
        blocks = np.pad(blocks, [(0, n % 2) for n in blocks.shape], mode="edge")
        blocks = np.maximum(np.maximum(blocks[::2, ::2], blocks[1::2, ::2]), np.maximum(blocks[::2, 1::2], blocks[1::2, 1::2]))
        levels.append(blocks)
    return levels
