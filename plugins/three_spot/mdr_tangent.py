"""Consistent tangent of the level `mdr`: the derivative of its step, spring by spring.

Every spring carries the derivatives of its elongation by the slip of the whole step, a 2 x 2 matrix, and by the overlap at its
end. A piece of the path moves a spring by its fraction of the slip, which depends on the overlap if the spring is touched within
the step, and on pieces between merges of springs. A spring beyond its limit L is returned onto it, w = L e with e = w'/|w'|, so
dw = e dL + (L/|w'|)(1 - e e^T) dw' (the derivative of a radial return: Simo and Taylor 1985). Merged springs have the mean of
both derivatives. The instants when a spring is touched or two springs merge move with the step; the springs are continuous there,
so this contributes nothing.
"""

import math

from thirdbody.plugin import kernel, stack_array

from .mdr_rolling import carry_with_rates
from .spring_grid import MAX_SPRINGS, cells_of, end_of, mean_gap, merge, width_of

ROWS = 8
"""Rows of n springs: x, y, dx/dd, dy/dd, dx/ds_x, dx/ds_y, dy/ds_x, dy/ds_y."""

SCRATCH = ROWS * MAX_SPRINGS
"""Floats of scratch for a tangent."""


@kernel
def advance_rows(rows, grid, path, slip, ends):
    """Advance the springs along one straight piece of the path as the law does, and their derivatives.

    `rows` (8 n,): springs and derivatives at the start, then at the end of the piece; `grid` = (springs, wide cells,
    spacing^2/R), `path` = overlap before and after, `slip` = slip of the step along x and y, the fraction of it in this piece,
    and its rate with the overlap; `ends` = limit of a spring per compression, its rate, and 1.0 where the overlap after is that
    at the end of the step, 0.0 where springs merge. Without branches, and row by row, so that the compiler vectorises it.
    """
    (n, wide, scale), (before, after) = grid, path
    (slip_x, slip_y, portion, portion_rate), (bound, bound_rate, moves) = slip, ends
    inverse_change = 1.0 / max(after - before, 1e-300)
    for i in range(n):
        gap = mean_gap(i, wide, scale)
        depth = max(after - gap, 0.0)
        fraction = 1.0 if before > gap else depth * inverse_change
        fraction_rate = moves * (1.0 - fraction) * inverse_change if depth > 0.0 else 0.0
        part, rate = fraction * portion, fraction * portion_rate + fraction_rate * portion
        x, y = rows[i] - part * slip_x, rows[n + i] - part * slip_y
        xd, yd = rows[2 * n + i] - rate * slip_x, rows[3 * n + i] - rate * slip_y
        xx, xy, yx, yy = rows[4 * n + i] - part, rows[5 * n + i], rows[6 * n + i], rows[7 * n + i] - part
        size, limit = math.sqrt(x * x + y * y), bound * depth
        slips = 1.0 if size > limit or limit == 0.0 else 0.0
        over = slips / max(size, 1e-300)
        e_x, e_y, back = over * x, over * y, 1.0 - slips + over * limit
        limit_rate = moves * bound + bound_rate * depth if depth > 0.0 else 0.0
        # the motion of a slipping spring along its direction is lost
        by_x, by_y = back * (e_x * xx + e_y * yx), back * (e_x * xy + e_y * yy)
        by_d = back * (e_x * xd + e_y * yd) - limit_rate
        rows[i], rows[n + i] = back * x, back * y
        rows[2 * n + i], rows[3 * n + i] = back * xd - e_x * by_d, back * yd - e_y * by_d
        rows[4 * n + i], rows[5 * n + i] = back * xx - e_x * by_x, back * xy - e_x * by_y
        rows[6 * n + i], rows[7 * n + i] = back * yx - e_y * by_x, back * yy - e_y * by_y


@kernel
def sums_of_rows(rows, n, wide):
    """Return the sums over the springs, each times the width of its cell, of their derivatives."""
    xx = xy = yx = yy = xd = yd = 0.0
    for i in range(n):
        width = width_of(i, wide)
        xd, yd = xd + width * rows[2 * n + i], yd + width * rows[3 * n + i]
        xx, xy = xx + width * rows[4 * n + i], xy + width * rows[5 * n + i]
        yx, yy = yx + width * rows[6 * n + i], yy + width * rows[7 * n + i]
    return xx, xy, yx, yy, xd, yd


@kernel
def sums_of_one_piece(rows, grid, path, slip, ends):
    """Return what `advance_rows` and `sums_of_rows` do for a path of one piece, in half the time.

    Before the step no spring depends on the slip: the matrices are those of the radial return of the unit matrix.
    """
    (n, wide, scale), (before, after) = grid, path
    (slip_x, slip_y, portion, portion_rate), (bound, bound_rate) = slip, ends
    inverse_change = 1.0 / max(after - before, 1e-300)
    for i in range(n):
        gap, width = mean_gap(i, wide, scale), width_of(i, wide)
        depth = max(after - gap, 0.0)
        fraction = 1.0 if before > gap else depth * inverse_change
        fraction_rate = (1.0 - fraction) * inverse_change if depth > 0.0 else 0.0
        part, rate = fraction * portion, fraction * portion_rate + fraction_rate * portion
        x, y = rows[i] - part * slip_x, rows[n + i] - part * slip_y
        xd, yd = rows[2 * n + i] - rate * slip_x, rows[3 * n + i] - rate * slip_y
        size, limit = math.sqrt(x * x + y * y), bound * depth
        slips = 1.0 if size > limit or limit == 0.0 else 0.0
        over = slips / max(size, 1e-300)
        e_x, e_y, back = over * x, over * y, 1.0 - slips + over * limit
        limit_rate = bound + bound_rate * depth if depth > 0.0 else 0.0
        by_d = back * (e_x * xd + e_y * yd) - limit_rate
        loss = width * (back * part)
        rows[2 * n + i], rows[3 * n + i] = width * (back * xd - e_x * by_d), width * (back * yd - e_y * by_d)
        rows[4 * n + i], rows[5 * n + i] = loss * (e_x * e_x - 1.0), loss * (e_x * e_y)
        rows[6 * n + i] = loss * (e_y * e_y - 1.0)
    xx = xy = yy = xd = yd = 0.0
    for i in range(n):
        xd, yd = xd + rows[2 * n + i], yd + rows[3 * n + i]
        xx, xy, yy = xx + rows[4 * n + i], xy + rows[5 * n + i], yy + rows[6 * n + i]
    return xx, xy, xy, yy, xd, yd


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
    grid, end = (n, wide, spacing * spacing / c.radius), end_of(n, wide, spacing, c.radius)
    rows = stack_array(SCRATCH)
    retained_rate = 0.5 * exponent * renewal.retained / c.overlap
    carry_with_rates(w, rows, grid, max(before, c.overlap), (renewal.retained, retained_rate))
    fill, fill_rate, done = renewal.fill, 0.5 * (renewal.fill - renewal.retained) / c.overlap, before
    if not c.overlap > end:
        slip, path = (c.slip_x, c.slip_y, fill, fill_rate), (before, c.overlap)
        sums = sums_of_one_piece(rows, grid, path, slip, (limit, limit_rate))
    else:
        for i in range(4 * n, ROWS * n):
            rows[i] = 0.0
        inverse_change = 1.0 / (c.overlap - before)
        while True:  # one call of `advance_rows`, which is inlined
            whole = not c.overlap > end
            path = (done, c.overlap if whole else end)
            part = (path[1] - done) * inverse_change
            part_rate = (1.0 - part if whole else -part) * inverse_change
            slip = (c.slip_x, c.slip_y, part * fill, part * fill_rate + part_rate * fill)
            advance_rows(rows, grid, path, slip, (limit, limit_rate, 1.0 if whole else 0.0))
            if whole:
                break
            merge(rows, ROWS, n, wide)
            merges, done = merges + 1, end
            spacing, wide = cells_of(merges, n, c.radius)
            end, grid = end_of(n, wide, spacing, c.radius), (n, wide, spacing * spacing / c.radius)
        sums = sums_of_rows(rows, n, wide)
    k = 2.0 * p.g_star * spacing
    return k * sums[0], k * sums[1], k * sums[2], k * sums[3], k * sums[4], k * sums[5]
