"""The point of a height field that is closest to a point above it, and the geometry of a contact there.

Let c be the centre of a sphere and p = (x, y, h) a point of the surface with the tangents t_x = (1, 0, h_x), t_y = (0, 1, h_y).
A local minimum of f = (p - c)^2/2 is a zero of

    g_i = p_i - c_i + (h - c_z) h_i      with the derivatives      F = G + (h - c_z) H,      G = I + grad h grad h

(G: metric, H: second derivatives of h). With M = F^-1 it moves with the centre by dp = M (t.dc); all derivatives follow.
Distance and normal are those along c - p. On a field of zeros they are exactly the height of c and (0, 0, 1).

All minima within some reach are found from blocks of cells to smaller blocks, along the curve of Morton; a block is left out
where its highest point is out of reach, and a cell where the derivative of the distance cannot vanish. In each of the others
Newton's method goes downhill from its centre, and from those of its quarters where the surface is sharper than one minimum per
cell allows.
"""

import math
from collections import namedtuple

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.height_field import jet_at, jet_beside, rounded_jet, within_period
from thirdbody.kernels.tables import height_field as head

CLOSE = 1e-6
"""In units of a cell: a correction of Newton's method that is completed by Taylor's series, to rounding, without another one."""

LOCAL = 1e-2
"""In units of a cell: a correction that is accepted whether or not the distance becomes smaller, which rounding would decide."""

ITERATIONS, HALVINGS = 100, 30  # most iterations, and halvings of a correction: each goes down, by one cell at most

CURVED = 0.1
"""Smallest curvature of f/2 along any direction that a correction assumes where f is not convex; it is 1 on a plane."""

FLATTEST = 0.01
"""Smallest (R/R_eff)^2: in a hollow nearly as narrow as itself a sphere has at most ten times its own radius. It is approached
from twice that on, so that its derivatives do not jump."""

Foot = namedtuple("Foot", "x y distance normal jet inverse evaluations")
"""A local minimum of the distance between a point and the surface: x, y from straight below the point, the same in every period;
distance, negative below the surface; unit normal, upwards; jet there; M (xx, xy, yy); number of evaluations of the surface."""


@njit(**BARE)
def matrix_of(jet, below):
    """Return F: xx, xy, yy; `below`: h - c_z [m]."""
    return 1.0 + jet.x * jet.x + below * jet.xx, jet.x * jet.y + below * jet.xy, 1.0 + jet.y * jet.y + below * jet.yy


@njit(**BARE)
def inverse_of(a, b, c):
    inverse = 1.0 / (a * c - b * b)
    return c * inverse, -b * inverse, a * inverse


@njit(**BARE)
def higher_correction(jet, below, d_x, d_y):
    """Return what the third derivatives of f add to the correction (d_x, d_y) of Newton's method (2,) [m]."""
    s_x, s_y = jet.xx * d_x + jet.xy * d_y, jet.xy * d_x + jet.yy * d_y
    slope, bend = jet.x * d_x + jet.y * d_y, s_x * d_x + s_y * d_y
    third_x = (jet.xxx * d_x + 2.0 * jet.xxy * d_y) * d_x + jet.xyy * d_y * d_y
    third_y = (jet.xxy * d_x + 2.0 * jet.xyy * d_y) * d_x + jet.yyy * d_y * d_y
    g_x = 0.5 * (jet.x * bend + 2.0 * slope * s_x + below * third_x)
    g_y = 0.5 * (jet.y * bend + 2.0 * slope * s_y + below * third_y)
    a, b, c = matrix_of(jet, below)
    xx, xy, yy = inverse_of(a, b, c)
    return -(xx * g_x + xy * g_y), -(xy * g_x + yy * g_y)


@njit(**BARE_CHUNK)
def closest(field, centre, o_x, o_y):
    """Return the `Foot` of a centre (3,) [m], downhill from an offset (o_x, o_y) [m]; from one right to a hundredth of a cell in
    two evaluations."""
    length_x, length_y = field[head.LENGTH_X], field[head.LENGTH_Y]
    x, y, z = within_period(centre[0], length_x), within_period(centre[1], length_y), centre[2]
    d_x, d_y = 1.0 / field[head.RATE_X], 1.0 / field[head.RATE_Y]
    spacing = min(d_x, d_y)
    jet, evaluations = jet_at(field, x + o_x, y + o_y), 1
    while True:
        below = jet.h - z
        a, b, c = matrix_of(jet, below)
        half = 0.5 * (a - c)
        low = 0.5 * (a + c) - math.sqrt(half * half + b * b)  # the smaller eigenvalue
        convex, g_x, g_y = low > 0.0, o_x + below * jet.x, o_y + below * jet.y
        # Newton's correction, downhill also where f is not convex
        xx, xy, yy = inverse_of(a, b, c) if convex else inverse_of(a - low + max(CURVED, -low), b, c - low + max(CURVED, -low))
        m_x, m_y = -(xx * g_x + xy * g_y), -(xy * g_x + yy * g_y)
        small = math.sqrt(m_x * m_x + m_y * m_y) <= CLOSE * spacing
        if small and convex or evaluations >= ITERATIONS:
            break
        if small:  # a quarter cell from a saddle or a maximum, along which f falls fastest
            m_x, m_y = (low - c, b) if abs(low - c) >= abs(low - a) else (b, low - a)
            size = math.sqrt(m_x * m_x + m_y * m_y)
            m_x, m_y = (0.25 * spacing * m_x / size, 0.25 * spacing * m_y / size) if size > 0.0 else (0.25 * spacing, 0.0)
        part = 1.0 / max(1.0, abs(m_x) / d_x, abs(m_y) / d_y)
        m_x, m_y = part * m_x, part * m_y
        square = o_x * o_x + o_y * o_y + below * below
        near = convex and math.sqrt(m_x * m_x + m_y * m_y) <= LOCAL * spacing
        for _ in range(HALVINGS):
            jet = jet_at(field, x + (o_x + m_x), y + (o_y + m_y))
            evaluations += 1
            now = (o_x + m_x) * (o_x + m_x) + (o_y + m_y) * (o_y + m_y) + (jet.h - z) * (jet.h - z)
            if near or now < square:
                break
            m_x, m_y = 0.5 * m_x, 0.5 * m_y
        o_x, o_y = o_x + m_x, o_y + m_y
    if convex:
        more_x, more_y = higher_correction(jet, below, m_x, m_y)
        jet = jet_beside(jet, m_x + more_x, m_y + more_y)
        o_x, o_y = o_x + m_x + more_x, o_y + m_y + more_y
    n = 1.0 / math.sqrt(1.0 + jet.x * jet.x + jet.y * jet.y)
    n_x, n_y, below = (0.0 - jet.x) * n, (0.0 - jet.y) * n, jet.h - z
    distance = (0.0 - below) * n - (o_x * n_x + o_y * n_y)
    a, b, c = matrix_of(jet, below)
    return Foot(o_x, o_y, distance, (n_x, n_y, n), jet, inverse_of(a, b, c), evaluations)


@njit(**BARE)
def limited_ratio(ratio):
    """Return (R/R_eff)^2, at least FLATTEST, and its derivative with (1 + R k_1)(1 + R k_2)."""
    if ratio >= 2.0 * FLATTEST:
        return ratio, 1.0
    part = max(ratio, 0.0) / (2.0 * FLATTEST)
    return FLATTEST * (1.0 + part * part), part


@njit(**BARE)
def effective_radius(jet, radius):
    """Return R_eff [m] of a sphere of radius R on the surface: (R/R_eff)^2 = (1 + R k_1)(1 + R k_2), at least FLATTEST; principal
    curvatures k are positive where it bulges upwards. Exactly R on a plane."""
    square = 1.0 / (1.0 + jet.x * jet.x + jet.y * jet.y)
    trace = (1.0 + jet.y * jet.y) * jet.xx - 2.0 * jet.x * jet.y * jet.xy + (1.0 + jet.x * jet.x) * jet.yy
    total, product = (0.0 - trace) * (square * math.sqrt(square)), (jet.xx * jet.yy - jet.xy * jet.xy) * (square * square)
    return radius / math.sqrt(limited_ratio(1.0 + radius * (total + radius * product))[0])


@njit(**BARE)
def ratio_derivatives(jet, radius):
    """Return (R/R_eff)^2 and its derivatives (2,) [1/m] along x and y of the surface."""
    h_x, h_y, xx, xy, yy = jet.x, jet.y, jet.xx, jet.xy, jet.yy
    square = 1.0 / (1.0 + h_x * h_x + h_y * h_y)
    cube, fourth = square * math.sqrt(square), square * square
    trace, determinant = (1.0 + h_y * h_y) * xx - 2.0 * h_x * h_y * xy + (1.0 + h_x * h_x) * yy, xx * yy - xy * xy
    ratio, change = limited_ratio(1.0 + radius * (radius * determinant * fourth - trace * cube))
    if change == 0.0:
        return ratio, 0.0, 0.0
    # of the trace by first and by third derivatives, of the determinant, and of 1 + h_x^2 + h_y^2 along x, then along y
    t_x = 2.0 * (h_y * xy * xx - (xx * h_y + h_x * xy) * xy + h_x * xx * yy)
    t_x += (1.0 + h_y * h_y) * jet.xxx - 2.0 * h_x * h_y * jet.xxy + (1.0 + h_x * h_x) * jet.xyy
    t_y = 2.0 * (h_y * yy * xx - (xy * h_y + h_x * yy) * xy + h_x * xy * yy)
    t_y += (1.0 + h_y * h_y) * jet.xxy - 2.0 * h_x * h_y * jet.xyy + (1.0 + h_x * h_x) * jet.yyy
    d_x, d_y = jet.xxx * yy + xx * jet.xyy - 2.0 * xy * jet.xxy, jet.xxy * yy + xx * jet.yyy - 2.0 * xy * jet.xyy
    q_x, q_y = 2.0 * square * (h_x * xx + h_y * xy), 2.0 * square * (h_x * xy + h_y * yy)
    along_x = change * radius * (radius * fourth * (d_x - 2.0 * determinant * q_x) - cube * (t_x - 1.5 * trace * q_x))
    along_y = change * radius * (radius * fourth * (d_y - 2.0 * determinant * q_y) - cube * (t_y - 1.5 * trace * q_y))
    return ratio, along_x, along_y


@njit(**BARE)
def bent_jet(field, centre, foot):
    """Return the jet at a closest point with second derivatives that are smooth (`rounded_jet`)."""
    x, y = within_period(centre[0], field[head.LENGTH_X]) + foot.x, within_period(centre[1], field[head.LENGTH_Y]) + foot.y
    return rounded_jet(field, foot.jet, x, y)


@njit(**BARE)
def log_radius_gradient(foot, bent, radius):
    """Return the gradient (3,) [1/m] of ln R_eff with the centre of the sphere, along the surface; `bent`: see `bent_jet`."""
    ratio, r_x, r_y = ratio_derivatives(bent, radius)
    xx, xy, yy = foot.inverse
    factor = -0.5 / ratio
    g_x, g_y = factor * (xx * r_x + xy * r_y), factor * (xy * r_x + yy * r_y)
    return g_x, g_y, g_x * foot.jet.x + g_y * foot.jet.y


@njit(**BARE)
def normal_derivative(foot):
    """Return the derivative of the normal with the centre [1/m], xx, xy, xz, yy, yz, zz: k/(1 + k D) in principal directions."""
    jet, (m_xx, m_xy, m_yy) = foot.jet, foot.inverse
    # -n_z G^-1 H M, symmetric, between the tangents
    factor = (0.0 - foot.normal[2]) / (1.0 + jet.x * jet.x + jet.y * jet.y)
    a, b, c = 1.0 + jet.y * jet.y, -jet.x * jet.y, 1.0 + jet.x * jet.x
    h_xx, h_xy = jet.xx * m_xx + jet.xy * m_xy, jet.xx * m_xy + jet.xy * m_yy
    h_yx, h_yy = jet.xy * m_xx + jet.yy * m_xy, jet.xy * m_xy + jet.yy * m_yy
    xx, xy, yy = factor * (a * h_xx + b * h_yx), factor * (a * h_xy + b * h_yy), factor * (b * h_xy + c * h_yy)
    xz, yz = xx * jet.x + xy * jet.y, xy * jet.x + yy * jet.y
    return xx, xy, xz, yy, yz, xz * jet.x + yz * jet.y


MERGE = 1e-3  # in units of a cell: minima that are nearer to each other are one


@njit(**BARE)
def interleaved(m, first):
    """Return the number of every second bit of m, from bit `first` on: a coordinate of block m."""
    n, bit = np.int64(0), np.int64(0)
    m >>= first
    while m > 0:
        n |= (m & 1) << bit
        m >>= 2
        bit += 1
    return n


@njit(**BARE)
def insert(foot, reach, merge, minima, n):
    """Insert a new minimum within reach into the n rows, by distance, then place; return the new n, at most rows + 1."""
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
    below = jet.h - centre[2]
    g_x, g_y = o_x + below * jet.x, o_y + below * jet.y
    slope = field[head.MAX_SLOPE]
    largest = 1.0 + slope * slope + (reach + slope * half) * field[head.MAX_CURVATURE]
    return g_x * g_x + g_y * g_y <= largest * largest * half * half


@njit(**BARE_CHUNK)
def search_cell(field, centre, o_x, o_y, reach, minima, n):
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
def search_period(field, centre, origin, reach, minima, n):
    """Insert the minima in one period; return the new n. `origin` (2,): where it begins, from below the centre [m]."""
    n_x, n_y, top = np.int64(field[head.COUNT_X]), np.int64(field[head.COUNT_Y]), np.int64(field[head.LEVELS])
    d_x, d_y = 1.0 / field[head.RATE_X], 1.0 / field[head.RATE_Y]
    m, level, end = np.int64(0), top, np.int64(1) << (2 * top)
    while m < end:
        x, y = interleaved(m, 0), interleaved(m, 1)
        low = origin[0] + x * d_x, origin[1] + y * d_y
        near = x < n_x and y < n_y
        if near:  # whether the block may be within reach
            size, up = np.int64(1) << level, 0.0
            if level > 0:
                at = np.int64(field[head.OFFSET + level - 1]) + (x >> level) * ((n_y + size - 1) >> level) + (y >> level)
                up = max(centre[2] - field[at], 0.0)
            b_x, b_y = max(low[0], -(low[0] + size * d_x), 0.0), max(low[1], -(low[1] + size * d_y), 0.0)
            near = b_x * b_x + b_y * b_y + up * up <= reach * reach
        if near:
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
    """Write the local minima of the distance of a centre (3,) within `reach` [m], the nearest first: offset (x, y) and distance,
    negative below the surface. Returns their number; of more than rows the nearest are kept, and it is one more than rows."""
    length_x, length_y = field[head.LENGTH_X], field[head.LENGTH_Y]
    if centre[2] - reach > field[head.MAX_HEIGHT]:
        return np.int64(0)
    x, y = within_period(centre[0], length_x), within_period(centre[1], length_y)
    reduced, n = (x, y, centre[2]), np.int64(0)
    depth = max(abs(centre[2] - field[head.MIN_HEIGHT]), abs(field[head.MAX_HEIGHT] - centre[2]))
    if depth * field[head.MAX_CURVATURE] < 1.0:  # the squared distance is convex: it has one minimum
        return insert(closest(field, reduced, 0.0, 0.0), reach, 0.0, minima, n)
    for i in range(math.floor((x - reach) / length_x), math.floor((x + reach) / length_x) + 1):
        for j in range(math.floor((y - reach) / length_y), math.floor((y + reach) / length_y) + 1):
            n = search_period(field, reduced, (i * length_x - x, j * length_y - y), reach, minima, n)
    return n
