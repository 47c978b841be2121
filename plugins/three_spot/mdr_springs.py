"""Springs of the level `mdr`: their cells in a growing contact area, the effect of rolling on them, and the tangent of a step.

Cells: the inner ones are two spacings wide, the others one. When the contact area reaches the end of the grid, the innermost two
narrow cells are merged, and a cell is added outside. When these were the last two, all cells are wide, the added one too: the
spacing doubles and all are narrow. So all cells are in use whatever the size of a growing contact, merged cells lie wholly within
it, and the grid depends on the number of merges only.

Rolling carries springs outward, w(x) -> kept w(kept x) (`laws.renewal`). In a short step a cell gets its content from itself and
the next one inward only.

Tangent: the derivative of the step, spring by spring. Every spring carries the derivatives of its elongation by the slip of the
whole step, a 2 x 2 matrix, and by the overlap at its end. A piece of the path moves a spring by its fraction of the slip, which
depends on the overlap if the spring is touched within the step, and on pieces between merges of springs. A spring beyond its
limit L is returned onto it, w = L e with e = w'/|w'|, so dw = e dL + (L/|w'|)(1 - e e^T) dw' (the derivative of a radial return:
Simo and Taylor 1985). Merged springs have the mean of both derivatives. The instants when a spring is touched or two springs
merge move with the step; the springs are continuous there, so this contributes nothing."""

import math

from thirdbody.plugin import helper, kernel, moved_ground, renewed, stack_array

MAX_SPRINGS = 512  # largest number of springs of a contact
FIRST = 2.0**-20  # half width of the smallest grid over the radius of curvature: an overlap of 1e-12 of it
DOUBLINGS = 50
"""Maximum number of doublings of the spacing: half widths of 1e9 radii, which occur only in a run about to be stopped."""
ENDLESS = FIRST * 2.0**DOUBLINGS
ROWS = 8  # rows of n springs for a tangent: x, y, dx/dd, dy/dd, dx/ds_x, dx/ds_y, dy/ds_x, dy/ds_y
TANGENT_SCRATCH = ROWS * MAX_SPRINGS  # floats


@helper
def cells_of(merges, n, radius):
    """(spacing, number of wide cells) of a grid of n cells after this number of merges."""
    doublings = merges // (n - 1)
    return FIRST * radius / n * (1 << doublings), merges - doublings * (n - 1)


@helper
def end_of(n, wide, spacing, radius):
    """Largest overlap whose contact area fits the grid [m]."""
    half_width = (n + wide) * spacing
    return half_width * half_width / radius if spacing * n < ENDLESS * radius else math.inf


@helper
def merges_for(overlap, n, radius):
    """Smallest number of merges after which the contact area of an overlap fits the grid."""
    cells = math.sqrt(max(overlap, 0.0) / radius) / FIRST
    doublings = min(max(math.frexp(cells)[1] - 1, 0), DOUBLINGS)
    wide = int(math.ceil(n * math.ldexp(cells, -doublings))) - n
    return (n - 1) * doublings + min(max(wide, 0), n - 1)


@helper
def width_of(i, wide):
    """Width of cell i, in spacings."""
    return 2.0 if i < wide else 1.0


@helper
def mean_gap(i, wide, scale):
    """Mean gap over cell i [m], with `scale` = spacing^2/R."""
    position, scale = (i + 0.5, 4.0 * scale) if i < wide else (i + 0.5 + wide, scale)
    return scale * (position * position + 1.0 / 12.0)


@helper
def merge(rows, count, n, wide):
    """In each of `count` rows of n springs replace number `wide` and the next by their mean; add a spring at rest outside."""
    for row in range(count):
        first, last = row * n + wide, row * n + n - 1
        rows[first] = 0.5 * (rows[first] + rows[first + 1])
        for i in range(first + 1, last):
            rows[i] = rows[i + 1]
        rows[last] = 0.0


@helper
def squares_lost(merges, n, spacing):
    """Reduction of the sum of squares (`sums` in `mdr`) of a field w = R d - x^2 by this number of merges during its growth [m4].
    Two narrow cells at the distance x lose (2 spacing x)^2/2. The sum of that over all x is cubic in the number of cells, the sum
    over all doublings a geometric series."""
    doublings = merges // (n - 1)
    wide = float(merges - doublings * (n - 1))
    all_wide = n - 1.0
    before = all_wide * (4.0 * all_wide * all_wide - 1.0) * (1.0 - 0.03125**doublings) / 31.0
    return 2.0 / 3.0 * spacing**4 * (wide * (4.0 * wide * wide - 1.0) + before)


@helper
def next_weights(i, wide, retained):
    """Weights of cell i and the next one inward in the content of cell i, and the position of its inner end in its widths."""
    inner = float(i) if i < wide else float(i) + wide
    far = inner * (1.0 - retained)
    return retained - far, far, inner


@helper
def source_of(i, n, wide, retained):
    """From which two cells cell i gets its content, the inner one first, and their weights."""
    width, inner = width_of(i, wide), float(i + min(i, wide))
    y = retained * inner
    j = min(int(0.5 * y) if y < 2.0 * wide else wide + int(y - 2.0 * wide), i)
    far = min(max(retained * (inner + width) - (j + 1 + min(j + 1, wide)), 0.0) / width, retained)
    return j, min(j + 1, n - 1), retained - far, far


@kernel
def copied_behind_pad(w, rows, pad):
    """Copy the springs w (2 n,) behind `rows[pad]`, where every one has a neighbour; return where x and y begin. The neighbours
    of the innermost springs have no weight."""
    rows[pad] = 0.0
    for i in range(len(w)):
        rows[pad + 1 + i] = w[i]
    return pad + 1, pad + 1 + len(w) // 2


@kernel
def carry(w, rows, grid, overlap, retained):
    """Write the springs w (2 n,) carried outward by rolling into rows[: 2 n], as means over the cells; zero beyond `overlap`.
    `rows` (4 n + 1,) is scratch otherwise; `grid` = (springs, wide cells, spacing^2/R). A cell holds the content of the interval
    of `retained` times its ends, so force is lost across the edge only."""
    n, wide, scale = grid
    if retained == 1.0:
        for i in range(2 * n):
            rows[i] = w[i]
    elif (n + wide) * (1.0 - retained) <= 1.0:  # every cell gets its content from itself and the next one inward
        x, y = copied_behind_pad(w, rows, 2 * n)
        for i in range(n):
            near, far, _ = next_weights(i, wide, retained)
            inside = 1.0 if mean_gap(i, wide, scale) < overlap else 0.0
            near, far = inside * near, inside * far
            rows[i] = near * rows[x + i] + far * rows[x - 1 + i]
            rows[n + i] = near * rows[y + i] + far * rows[y - 1 + i]
    else:
        for i in range(n):
            j, k, near, far = source_of(i, n, wide, retained)
            inside = 1.0 if mean_gap(i, wide, scale) < overlap else 0.0
            near, far = inside * near, inside * far
            rows[i], rows[n + i] = near * w[j] + far * w[k], near * w[n + j] + far * w[n + k]


@kernel
def carry_with_rates(w, rows, grid, overlap, renewal):
    """Do it, and write the derivatives of the carried springs by the overlap behind them, rows[2 n : 4 n]. `rows` (6 n + 1,) is
    scratch otherwise; `renewal` = fraction retained, and its derivative by the overlap [1/m]."""
    (n, wide, scale), (retained, rate) = grid, renewal
    if retained == 1.0:
        for i in range(2 * n):
            rows[i], rows[2 * n + i] = w[i], 0.0
    elif (n + wide) * (1.0 - retained) <= 1.0:
        x, y = copied_behind_pad(w, rows, 4 * n)
        for i in range(n):
            near, far, inner = next_weights(i, wide, retained)
            inside = 1.0 if mean_gap(i, wide, scale) < overlap else 0.0
            near, far, part = inside * near, inside * far, inside * rate
            x_near, x_far, y_near, y_far = rows[x + i], rows[x - 1 + i], rows[y + i], rows[y - 1 + i]
            rows[i], rows[n + i] = near * x_near + far * x_far, near * y_near + far * y_far
            rows[2 * n + i] = part * ((inner + 1.0) * x_near - inner * x_far)
            rows[3 * n + i] = part * ((inner + 1.0) * y_near - inner * y_far)
    else:
        for i in range(n):
            j, k, near, far = source_of(i, n, wide, retained)
            inner = float(i) if i < wide else float(i) + wide
            inside = 1.0 if mean_gap(i, wide, scale) < overlap else 0.0
            near, far, part, last = inside * near, inside * far, inside * rate, k if far > 0.0 else j
            rows[i], rows[n + i] = near * w[j] + far * w[k], near * w[n + j] + far * w[n + k]
            rows[2 * n + i] = part * ((inner + 1.0) * w[last] - inner * w[j])
            rows[3 * n + i] = part * ((inner + 1.0) * w[n + last] - inner * w[n + j])


@kernel
def advance_rows(rows, grid, path, slip, ends):
    """Advance the springs along one straight piece of the path as the law does, and their derivatives. `rows` (8 n,): springs and
    derivatives at the start, then at the end of the piece; `grid` = (springs, wide cells, spacing^2/R), `path` = overlap before
    and after, `slip` = slip of the step along x and y, the fraction of it in this piece, and its rate with the overlap; `ends` =
    limit of a spring per compression, its rate, and 1.0 where the overlap after is that at the end of the step, 0.0 where springs
    merge. Without branches, and row by row, so that the compiler vectorises it."""
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
def sums_of_one_piece(rows, grid, path, slip, ends):
    """Sums over the springs, times the width of their cell, of their derivatives: `advance_rows` in half the time for one piece.
    Before the step no spring depends on the slip: the matrices are those of the radial return of the unit matrix."""
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
def springs_tangent(c, load, p, h, w):
    """Consistent tangent of one step of `springs`, including springs that stick, slip, touch or merge within it. The normal force
    is that of Hertz: the elastic part goes as d^1.5, the contact radius as d^0.5; `load.stiffness` is the rate of the load
    available to friction."""
    before, n = h[0], len(w) // 2
    merges = int(h[1]) if before > 0.0 else merges_for(c.overlap, n, c.radius)
    path_over_ground = moved_ground(c.roll_x, c.roll_y, load.contact_radius, h[4], h[5], h[6]).path
    renewal = renewed(p.renewal * path_over_ground / max(load.contact_radius, 1e-300))
    if not (c.overlap > 0.0 and load.contact_radius > 0.0 and load.elastic > 0.0):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    spacing, wide = cells_of(merges, n, c.radius)
    limit = p.kappa * load.force / load.elastic
    limit_rate = p.kappa * load.stiffness / load.elastic - 1.5 * limit / c.overlap
    # the renewal of a given travel goes as 1/a, so its exponent as d^-0.5
    exponent = (1.0 - renewal.retained) / renewal.fill
    grid, end = (n, wide, spacing * spacing / c.radius), end_of(n, wide, spacing, c.radius)
    rows = stack_array(TANGENT_SCRATCH)
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
        xx = xy = yx = yy = xd = yd = 0.0
        for i in range(n):
            width = width_of(i, wide)
            xd, yd = xd + width * rows[2 * n + i], yd + width * rows[3 * n + i]
            xx, xy = xx + width * rows[4 * n + i], xy + width * rows[5 * n + i]
            yx, yy = yx + width * rows[6 * n + i], yy + width * rows[7 * n + i]
        sums = xx, xy, yx, yy, xd, yd
    k = 2.0 * p.g_star * spacing
    return k * sums[0], k * sums[1], k * sums[2], k * sums[3], k * sums[4], k * sums[5]
