"""Consistent tangent of the level `mdr`: the derivative of its step, spring by spring.

Every spring carries the derivatives of its elongation by the slip of the whole step, a 2 x 2 matrix, and by the overlap at its
end. A piece of the path moves a spring by its fraction of the slip, which depends on the overlap if the spring is touched within
the step, and on pieces between merges of springs. A spring beyond its limit L is returned onto it, w = L e with e = w'/|w'|, so
dw = e dL + (L/|w'|)(1 - e e^T) dw' (the derivative of a radial return: Simo and Taylor 1985). Merged springs have the mean of
both derivatives. The instants when a spring is touched or two springs merge move with the step; the springs are continuous there,
so this contributes nothing.
"""

import math

import numpy as np

from .mdr_rolling import carried_rate, carry_outward
from .numerical_tangent import helper
from .spring_grid import cells_of, end_of, mean_gap, merge, width_of

ROWS = 8
"""Rows of n springs: x, y, dx/ds_x, dx/ds_y, dy/ds_x, dy/ds_y, dx/dd, dy/dd."""


@helper
def loaded_rows(w, grid, overlap, kept, kept_rate):
    """Return the rows (8 n,) of springs carried outward by rolling; `kept_rate`: of log `kept` with the overlap [1/m]."""
    n = len(w) // 2
    rows = np.zeros(ROWS * n)
    if kept >= 1.0:
        for i in range(2 * n):
            rows[i] = w[i]
        return rows
    carry_outward(w, rows, grid, overlap, kept)
    for i in range(n):
        x, y = carried_rate(w, i, grid, overlap, kept)
        rows[6 * n + i], rows[7 * n + i] = kept_rate * kept * x, kept_rate * kept * y
    return rows


@helper
def advance_rows(rows, grid, path, slip, share, bound, moves):
    """Advance the springs along one straight piece of the path as the law does, and their derivatives.

    `grid` = (springs, wide cells, spacing^2/R), `path` = overlap before and after. `share` is the fraction of the step's `slip`
    in this piece, and its rate with the overlap; `bound` the limit of a spring per compression, and its rate. `moves` is 1.0
    where `after` is the overlap at the end of the step, 0.0 where springs merge. Without branches, and row by row, so that the
    compiler vectorises it.
    """
    (n, wide, scale), (before, after) = grid, path
    per_rise = 1.0 / max(after - before, 1e-300)
    for i in range(n):
        gap = mean_gap(i, wide, scale)
        depth = max(after - gap, 0.0)
        took = 1.0 if before > gap else depth * per_rise
        took_rate = moves * (1.0 - took) * per_rise if depth > 0.0 else 0.0
        part, rate = took * share[0], took * share[1] + took_rate * share[0]
        x, y = rows[i] - part * slip[0], rows[n + i] - part * slip[1]
        xx, xy, yx, yy = rows[2 * n + i] - part, rows[3 * n + i], rows[4 * n + i], rows[5 * n + i] - part
        xd, yd = rows[6 * n + i] - rate * slip[0], rows[7 * n + i] - rate * slip[1]
        size, limit = math.sqrt(x * x + y * y), bound[0] * depth
        slips = 1.0 if size > limit or limit == 0.0 else 0.0
        over = slips / max(size, 1e-300)
        e_x, e_y, back = over * x, over * y, 1.0 - slips + over * limit
        limit_rate = moves * bound[0] + bound[1] * depth if depth > 0.0 else 0.0
        # the motion of a slipping spring along its direction is lost
        by_x, by_y = back * (e_x * xx + e_y * yx), back * (e_x * xy + e_y * yy)
        by_d = back * (e_x * xd + e_y * yd) - limit_rate
        rows[i], rows[n + i] = back * x, back * y
        rows[2 * n + i], rows[3 * n + i] = back * xx - e_x * by_x, back * xy - e_x * by_y
        rows[4 * n + i], rows[5 * n + i] = back * yx - e_y * by_x, back * yy - e_y * by_y
        rows[6 * n + i], rows[7 * n + i] = back * xd - e_x * by_d, back * yd - e_y * by_d


@helper
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
    bound = (limit, p.kappa * load.stiffness / load.elastic - 1.5 * limit / c.overlap)
    # the renewal of a given travel goes as 1/a, so its exponent as d^-0.5
    exponent = (1.0 - renewal.kept) / renewal.fill
    grid = (n, wide, spacing * spacing / c.radius)
    rows = loaded_rows(w, grid, max(before, c.overlap), renewal.kept, 0.5 * exponent / c.overlap)
    fill, fill_rate = renewal.fill, 0.5 * (renewal.fill - renewal.kept) / c.overlap
    slip, fraction, done = (c.slip_x, c.slip_y), (fill, fill_rate), before
    end = end_of(n, wide, spacing, c.radius)
    if c.overlap > end:
        per_rise = 1.0 / (c.overlap - before)
        while c.overlap > end:
            part = (end - done) * per_rise
            fraction = (part * fill, part * (fill_rate - fill * per_rise))
            advance_rows(rows, (n, wide, spacing * spacing / c.radius), (done, end), slip, fraction, bound, 0.0)
            merge(rows, ROWS, n, wide)
            merges, done = merges + 1, end
            spacing, wide = cells_of(merges, n, c.radius)
            end = end_of(n, wide, spacing, c.radius)
        part = (c.overlap - done) * per_rise
        fraction = (part * fill, part * fill_rate + (1.0 - part) * per_rise * fill)
    advance_rows(rows, (n, wide, spacing * spacing / c.radius), (done, c.overlap), slip, fraction, bound, 1.0)
    xx = xy = yx = yy = xd = yd = 0.0
    for i in range(n):
        width = width_of(i, wide)
        xx, xy = xx + width * rows[2 * n + i], xy + width * rows[3 * n + i]
        yx, yy = yx + width * rows[4 * n + i], yy + width * rows[5 * n + i]
        xd, yd = xd + width * rows[6 * n + i], yd + width * rows[7 * n + i]
    stiffness = 2.0 * p.g_star * spacing
    return stiffness * xx, stiffness * xy, stiffness * yx, stiffness * yy, stiffness * xd, stiffness * yd
