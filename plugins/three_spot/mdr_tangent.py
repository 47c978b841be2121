"""Consistent tangent of the level `mdr`: the derivative of its step, spring by spring.

Every spring carries the derivatives of its elongation by the slip of the whole step, a 2 x 2 matrix, and by the overlap at its
end. A piece of the path moves a spring by its fraction of the slip, which depends on the overlap if the spring is touched within
the step, and on pieces between merges of springs. A spring beyond its limit L is returned onto it, w = L e with e = w'/|w'|, so
dw = e dL + (L/|w'|)(1 - e e^T) dw' (the derivative of a radial return: Simo and Taylor 1985). Merged springs have the mean of
both derivatives. The instants when a spring is touched or two springs merge move with the step; the springs are continuous there,
so this contributes nothing.
"""

import math
from typing import NamedTuple

from thirdbody.plugin import kernel, stack_array

from .mdr_rolling import carried_rate, carried_weights, carry_outward, copy_rows, from_next_cell
from .numerical_tangent import helper
from .spring_grid import MAX_SPRINGS, cells_of, end_of, mean_gap, merge, width_of

ROWS = 8
"""Rows of n springs: x, y, dx/ds_x, dx/ds_y, dy/ds_x, dy/ds_y, dx/dd, dy/dd."""

SCRATCH = (ROWS + 2) * MAX_SPRINGS + 2
"""Floats of scratch for a tangent."""


class RolledRate(NamedTuple):
    """Rolling within a piece of the path: fraction lost to the next cell, rate of what is kept with the overlap, overlap beyond
    which springs have left."""

    lost: float
    retained_rate: float
    overlap: float


@helper
def load_rows(w, rows, grid, overlap, retained, retained_rate):
    """Write the springs at the start of the first piece into `rows`; return what rolling is left to `advance_rows`.

    `retained_rate`: rate of `retained` with the overlap [1/m].
    """
    n, wide, _ = grid
    if from_next_cell(n, wide, 1.0 - retained):
        copy_rows(w, n, rows, ROWS * n)
        return RolledRate(1.0 - retained, retained_rate, overlap)
    carry_outward(w, rows, ROWS * n, grid, overlap, retained)
    for i in range(n):
        x_rate, y_rate = carried_rate(w, i, grid, overlap, retained)
        rows[6 * n + i], rows[7 * n + i] = retained_rate * x_rate, retained_rate * y_rate
    return RolledRate(0.0, 0.0, overlap)


@kernel
def advance_rows(rows, grid, path, slip, roll, ends):
    """Advance the springs along one straight piece of the path as the law does, and their derivatives.

    `rows` (10 n + 2,): the springs at the end and all derivatives, then the springs at the start (`copy_rows`); `grid` =
    (springs, wide cells, spacing^2/R), `path` = overlap before and after, `slip` = slip of the step along x and y, the fraction
    of it in this piece, and its rate with the overlap; `ends` = limit of a spring per compression, its rate, and 1.0 where the
    overlap after is that at the end of the step, 0.0 where springs merge. Without branches, and row by row, so that the compiler
    vectorises it.
    """
    (n, wide, scale), (before, after) = grid, path
    old_x, old_y = 8 * n, 9 * n + 1
    (slip_x, slip_y, portion, portion_rate), (bound, bound_rate, moves) = slip, ends
    inverse_change = 1.0 / max(after - before, 1e-300)
    for i in range(n):
        gap = mean_gap(i, wide, scale)
        depth = max(after - gap, 0.0)
        fraction = 1.0 if before > gap else depth * inverse_change
        fraction_rate = moves * (1.0 - fraction) * inverse_change if depth > 0.0 else 0.0
        part, rate = fraction * portion, fraction * portion_rate + fraction_rate * portion
        near, far, position = carried_weights(i, wide, roll.lost)
        inside = 1.0 if gap < roll.overlap else 0.0
        near, far, retained_rate = inside * near, inside * far, inside * roll.retained_rate
        x_w, x_inner, y_w, y_inner = rows[old_x + 1 + i], rows[old_x + i], rows[old_y + 1 + i], rows[old_y + i]
        x, y = near * x_w + far * x_inner - part * slip_x, near * y_w + far * y_inner - part * slip_y
        xx, xy, yx, yy = rows[2 * n + i] - part, rows[3 * n + i], rows[4 * n + i], rows[5 * n + i] - part
        xd = rows[6 * n + i] - rate * slip_x + retained_rate * ((position + 1) * x_w - position * x_inner)
        yd = rows[7 * n + i] - rate * slip_y + retained_rate * ((position + 1) * y_w - position * y_inner)
        size, limit = math.sqrt(x * x + y * y), bound * depth
        slips = 1.0 if size > limit or limit == 0.0 else 0.0
        over = slips / max(size, 1e-300)
        e_x, e_y, back = over * x, over * y, 1.0 - slips + over * limit
        limit_rate = moves * bound + bound_rate * depth if depth > 0.0 else 0.0
        # the motion of a slipping spring along its direction is lost
        by_x, by_y = back * (e_x * xx + e_y * yx), back * (e_x * xy + e_y * yy)
        by_d = back * (e_x * xd + e_y * yd) - limit_rate
        rows[i], rows[n + i] = back * x, back * y
        rows[2 * n + i], rows[3 * n + i] = back * xx - e_x * by_x, back * xy - e_x * by_y
        rows[4 * n + i], rows[5 * n + i] = back * yx - e_y * by_x, back * yy - e_y * by_y
        rows[6 * n + i], rows[7 * n + i] = back * xd - e_x * by_d, back * yd - e_y * by_d


@kernel
def tangent_of_springs(c, load, p, start, w):
    """dTx/dsx, dTx/dsy, dTy/dsx, dTy/dsy, dTx/dd, dTy/dd [N/m] of a straight step of the law `springs`.

    `start`: the overlap and the merges before the step, and the `Renewal` in it; `w` (2 n,) its springs. The normal force is that
    of Hertz: the elastic part goes as d^1.5, the contact radius as d^0.5; `load.stiffness` is the rate of the load available to
    friction.
    """
    if not (c.overlap > 0.0 and load.contact_radius > 0.0 and load.elastic > 0.0):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    before, merges, renewal = start
    n = len(w) // 2
    spacing, wide = cells_of(merges, n, c.radius)
    limit = p.kappa * load.force / load.elastic
    limit_rate = p.kappa * load.stiffness / load.elastic - 1.5 * limit / c.overlap
    # the renewal of a given travel goes as 1/a, so its exponent as d^-0.5
    exponent = (1.0 - renewal.retained) / renewal.fill
    grid = (n, wide, spacing * spacing / c.radius)
    rows = stack_array(SCRATCH)
    for i in range(ROWS * n):
        rows[i] = 0.0
    retained_rate = 0.5 * exponent * renewal.retained / c.overlap
    roll = load_rows(w, rows, grid, max(before, c.overlap), renewal.retained, retained_rate)
    fill, fill_rate, done = renewal.fill, 0.5 * (renewal.fill - renewal.retained) / c.overlap, before
    end = end_of(n, wide, spacing, c.radius)
    merged = c.overlap > end
    inverse_change = 1.0 / (c.overlap - before) if merged else 0.0
    while True:  # one call of `advance_rows`, which is inlined
        whole = not c.overlap > end
        path = (done, c.overlap if whole else end)
        part = (path[1] - done) * inverse_change if merged else 1.0
        part_rate = (1.0 - part if whole else -part) * inverse_change
        slip = (c.slip_x, c.slip_y, part * fill, part * fill_rate + part_rate * fill)
        advance_rows(rows, grid, path, slip, roll, (limit, limit_rate, 1.0 if whole else 0.0))
        if whole:
            break
        merge(rows, ROWS, n, wide)
        copy_rows(rows, n, rows, ROWS * n)
        roll, merges, done = RolledRate(0.0, 0.0, math.inf), merges + 1, end
        spacing, wide = cells_of(merges, n, c.radius)
        end, grid = end_of(n, wide, spacing, c.radius), (n, wide, spacing * spacing / c.radius)
    xx = xy = yx = yy = xd = yd = 0.0
    for i in range(n):
        width = width_of(i, wide)
        xx, xy = xx + width * rows[2 * n + i], xy + width * rows[3 * n + i]
        yx, yy = yx + width * rows[4 * n + i], yy + width * rows[5 * n + i]
        xd, yd = xd + width * rows[6 * n + i], yd + width * rows[7 * n + i]
    stiffness = 2.0 * p.g_star * spacing
    return stiffness * xx, stiffness * xy, stiffness * yx, stiffness * yy, stiffness * xd, stiffness * yd
