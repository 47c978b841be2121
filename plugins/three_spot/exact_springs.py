"""Springs of one spot whose slip turns: fixed positions in the contact area, each advanced in closed form along a straight step.

The part of a contact that slides on a curve has no field of finitely many straight pieces: every spring lags by a different
angle. So the contact area is divided into cells of y = sqrt(q) = x/sqrt(R), each with one spring, the mean over its cell. A
spring trails its end at the distance of its bound b (a tractrix, the curve of pursuit): with the angle t between spring and slip,
dt = -sin t dl/b, so tan(t/2) falls by exp(-l/b), and a straight step of any length is exact at constant overlap. Where the bound
changes in the step, b is its logarithmic mean, exact as well. A curve approximated by straight steps is followed to second order
in them, and the cells add an error of about 1 / (their number)^2 of mu N. No step creates energy: each spring alone is an
elastic-plastic spring whose force along the slip grows while it sticks and while it turns, and means of springs hold less energy
than these.

Array: w[0] the spacing h, then all x and all y of the springs. The first m cells are 2 h wide, the others h. When the contact
area outgrows its cells, the next two of width h are merged into one, until all are 2 h wide and the spacing is doubled; when it
has shrunk to half of the width, all cells are split in two. So nearly all cells are in use, whatever the overlap. Means preserve
the force.

Rolling carries springs and fields outward: w(x) -> kept w(kept x) (`laws.renewal`). In q = x^2/R that scales the nodes of a
field, so it remains piecewise linear: the step is exact. Springs of fixed positions become means over the new content of their
cells.
"""

import math

from thirdbody.plugin import helper

from .spring_field import field_energy, field_force, piece_mean, piece_products

ALIGNED = 1e-10  # sine of the angle to the slip up to which a spring counts as parallel to it
IN_LINE = 1e-16  # the same to the last digit
SHORT = 0.1  # path over the bound below which the slip path is the trapezoid of the cosine with end corrections: error 1e-7
SERIES = 1e-2  # relative change of the bound below which its logarithmic mean is computed by a series


@helper
def cells_of(w):
    """Number of springs in the array of the field."""
    return (len(w) - 2) // 2


@helper
def lower_end(i, m, h):
    """Inner edge of cell i over sqrt(R)."""
    return h * (i + min(i, m))


@helper
def spring_product(w, v, m):
    """int w.v dy over the contact area, of springs with the same cells."""
    n, total = cells_of(w), 0.0
    for i in range(n):
        width = lower_end(i + 1, m, w[0]) - lower_end(i, m, w[0])
        total += width * (w[1 + i] * v[1 + i] + w[1 + n + i] * v[1 + n + i])
    return total


@helper
def spring_force(w, m):
    """int w dy over the contact area, both components."""
    n, x, y = cells_of(w), 0.0, 0.0
    for i in range(n):
        width = lower_end(i + 1, m, w[0]) - lower_end(i, m, w[0])
        x, y = x + width * w[1 + i], y + width * w[1 + n + i]
    return x, y


@helper
def cell_means(w, count, d, new):
    """Write springs that are the means of the field (w, count) over the cells for a contact area of overlap d; return m."""
    n, y = cells_of(new), math.sqrt(d)
    spacing = math.ldexp(0.5, math.frexp(y / n)[1])  # of the smallest grid of n cells
    m = min(max(int(math.ceil(y / spacing)) - n, 0), n)
    for i in range(len(new)):
        new[i] = 0.0
    new[0] = spacing
    i, end = 0, lower_end(1, m, spacing)
    for j in range(3, 3 * count, 3):
        q_1, q_2 = w[j - 3], w[j]
        y_1, y_2 = math.sqrt(q_1), math.sqrt(q_2)
        while y_1 < y_2:
            cut = y_2 if y_2 <= end or i == n - 1 else end
            t_1, t_2 = (y_1 * y_1 - q_1) / (q_2 - q_1), (cut * cut - q_1) / (q_2 - q_1)
            h, phi = piece_mean(y_1 * y_1, cut * cut)
            part = t_1 + phi * (t_2 - t_1)
            fraction = h / (end - lower_end(i, m, spacing))
            new[1 + i] += fraction * (w[j - 2] + part * (w[j + 1] - w[j - 2]))
            new[1 + n + i] += fraction * (w[j - 1] + part * (w[j + 2] - w[j - 1]))
            y_1 = cut
            if y_1 >= end and i < n - 1:
                i += 1
                end = lower_end(i + 1, m, spacing)
    return m


@helper
def fit_cells(w, m, y):
    """Adapt the cells to a contact area that extends to y; return (new m, twice the energy released by averaging, over 2 G*)."""
    n = cells_of(w)
    if y <= w[0] * (n + m) <= 2.0 * y:
        return m, 0.0
    before = spring_product(w, w, m)
    while y > w[0] * (n + m):  # cells m and m + 1 become one, which leaves the outermost empty
        if m == n:  # all are wide
            w[0], m = 2.0 * w[0], 0
        for first in (1, 1 + n):
            outer = w[first + m + 1] if m + 1 < n else 0.0
            w[first + m] = 0.5 * (w[first + m] + outer)
            for i in range(m + 1, n - 1):
                w[first + i] = w[first + i + 1]
            if m + 1 < n:
                w[first + n - 1] = 0.0
        m += 1
    while 2.0 * y < w[0] * (n + m):  # every cell becomes two, as far as there is space: the outer half is empty
        for first in (1, 1 + n):
            for i in range(n - 1, -1, -1):
                w[first + i] = w[first + i // 2]
        w[0], m = 0.5 * w[0], min(2 * m, n)
    return m, max(before - spring_product(w, w, m), 0.0)


@helper
def mean_bound(b_1, b_2):
    """Logarithmic mean of a bound that changes linearly from b_1 to b_2: its length over int dl / b."""
    change = b_2 - b_1
    if abs(change) <= SERIES * b_1:
        fraction = change / b_1 if change != 0.0 else 0.0
        return b_1 * (1.0 + fraction * (0.5 - fraction * (1.0 / 12.0 - fraction / 24.0)))
    return change / math.log(b_2 / b_1) if b_2 > 0.0 and b_1 > 0.0 else 0.0


@helper
def drag(x, y, b_0, b_1, e_x, e_y, length):
    """Advance one spring through a straight slip of this length along e while its bound changes from b_0 to b_1. Returns (x, y,
    energy lost over its stiffness, slip). It sticks until it reaches the bound, at the fraction t of the path, and slides from
    there on. Energy: mean bound times slip, exact on a line and of second order otherwise."""
    square = x * x + y * y
    size = math.sqrt(square)
    b_0 = max(b_0, size)
    bound_change, along = b_1 - b_0, x * e_x + y * e_y
    b, c, b_t, remaining = along * length - b_0 * bound_change, square - b_0 * b_0, b_0, length
    if not (b > 0.0 and c >= -1e-15 * square):
        # |w + t l e| = b_0 + t rise, the root where the bound is crossed outwards
        a = length * length - bound_change * bound_change
        root = math.sqrt(max(b * b - a * c, 0.0))
        t = -c / (b + root) if b > 0.0 else (root - b) / a if a > 0.0 else 1.0
        t = min(max(t, 0.0), 1.0)
        x, y, b_t, remaining = x + t * length * e_x, y + t * length * e_y, b_0 + t * bound_change, (1.0 - t) * length
        size = math.sqrt(x * x + y * y)
        along = x * e_x + y * e_y
    cosine, sine = 1.0, 0.0
    if size > 0.0:
        per_size = 1.0 / size
        cosine, sine = along * per_size, (y * e_x - x * e_y) * per_size
    if cosine > 0.0 and abs(sine) < IN_LINE:
        distance = max(remaining - (b_1 - b_t), 0.0)
        return b_1 * e_x, b_1 * e_y, 0.5 * (b_t + b_1) * distance, distance
    mean = mean_bound(b_t, b_1)
    distances = remaining / max(mean, 1e-300)
    fall = math.exp(-distances)
    ahead, behind = 1.0 + cosine, (1.0 - cosine) * fall * fall
    total = ahead + behind
    # a spring exactly opposite to the slip stays so
    along, across, distance = -1.0, 0.0, -remaining
    if total > 1e-300:
        per_total = 1.0 / total
        along, across = (ahead - behind) * per_total, 2.0 * sine * fall * per_total
        if distances < SHORT:
            distance = remaining * (0.5 * (cosine + along) + distances * (sine * sine - across * across) * (1.0 / 12.0))
        else:
            distance = remaining + mean * math.log(0.5 * total)
    distance = max(distance - (b_1 - b_t), 0.0)
    return b_1 * (along * e_x - across * e_y), b_1 * (along * e_y + across * e_x), 0.5 * (b_t + b_1) * distance, distance


@helper
def advance_springs(w, m, step):
    """Advance the springs in place through one straight step. Returns (new m, slip of the centre, loss/(2 G*), whether all slid
    along it). `step` as for `spring_field.advance_field`."""
    sx, sy, d_old, d, k = step
    m, merged = fit_cells(w, m, math.sqrt(max(d_old, d)))
    n, loss = cells_of(w), 0.5 * merged
    length = math.sqrt(sx * sx + sy * sy)
    e_x, e_y = (sx / length, sy / length) if length > 0.0 else (1.0, 0.0)
    inverse_change = 1.0 / max(abs(d - d_old), 1e-300)
    centre, straight, y_1 = 0.0, length > 0.0, 0.0
    for i in range(n):
        width = 2.0 * w[0] if i < m else w[0]
        y_2 = y_1 + width
        gap = (y_1 * y_1 + y_1 * y_2 + y_2 * y_2) * (1.0 / 3.0)
        y_1 = y_2
        old, new = max(d_old - gap, 0.0), max(d - gap, 0.0)
        if old + new == 0.0:
            w[1 + i], w[1 + n + i] = 0.0, 0.0
            continue
        fraction = 1.0 if min(old, new) > 0.0 else min((old + new) * inverse_change, 1.0)
        x, y, part = w[1 + i], w[1 + n + i], fraction * length
        x_1, y_try, bound = x + part * e_x, y + part * e_y, k * new
        distance = 0.0
        if x_1 * x_1 + y_try * y_try > bound * bound:
            x_1, y_try, lost, distance = drag(x, y, k * old, bound, e_x, e_y, part)
            loss += width * lost
        w[1 + i], w[1 + n + i] = x_1, y_try
        if straight and new > 0.0:
            straight = distance > 0.0 and x_1 * e_x + y_try * e_y > 0.0 and abs(x_1 * e_y - y_try * e_x) <= ALIGNED * bound
        centre = distance if i == 0 else centre
    return m, centre, loss, straight


# -- rolling


@helper
def carry_field(w, n, retained, ends, new):
    """Write the field (w, n) carried outward by rolling; return its number of nodes. `new` needs space for two more nodes. `ends`
    = (overlap before and after the step): zero beyond the larger one. If they differ, a node is placed at the first, as springs
    beyond it touch within the step."""
    d_old, d = ends
    stretch, end = 1.0 / (retained * retained), max(d_old, d)
    new[0], new[1], new[2] = 0.0, retained * w[1], retained * w[2]
    count = 3
    for i in range(3, 3 * n, 3):
        q, x, y = stretch * w[i], retained * w[i + 1], retained * w[i + 2]
        for stop in (d_old, end):
            q_0, x_0, y_0 = new[count - 3], new[count - 2], new[count - 1]
            if q_0 < stop < q:
                part = (stop - q_0) / (q - q_0)
                new[count], new[count + 1], new[count + 2] = stop, x_0 + part * (x - x_0), y_0 + part * (y - y_0)
                count += 3
        if q > end:
            break
        new[count], new[count + 1], new[count + 2] = q, x, y
        count += 3
    return count // 3


@helper
def field_beyond(w, n, start):
    """(int w_x dy, int w_y dy, int |w|^2 dy) beyond q = start."""
    f_x = f_y = energy = 0.0
    for i in range(0, 3 * n - 3, 3):
        q_1, q_2 = w[i], w[i + 3]
        if q_2 > start:
            x_1, y_1, x_2, y_2 = w[i + 1], w[i + 2], w[i + 4], w[i + 5]
            if q_1 < start:
                part = (start - q_1) / (q_2 - q_1)
                x_1, y_1, q_1 = x_1 + part * (x_2 - x_1), y_1 + part * (y_2 - y_1), start
            h, phi = piece_mean(q_1, q_2)
            f_x, f_y = f_x + h * (x_1 + phi * (x_2 - x_1)), f_y + h * (y_1 + phi * (y_2 - y_1))
            c_11, c_12, c_22 = piece_products(q_1, q_2)
            energy += c_11 * (x_1 * x_1 + y_1 * y_1) + c_22 * (x_2 * x_2 + y_2 * y_2) + 2.0 * c_12 * (x_1 * x_2 + y_1 * y_2)
    return f_x, f_y, energy


@helper
def field_product(w, n, v, m):
    """int w.v dy of two fields over the nodes of both, up to the end of the shorter one."""
    i = j = 3
    q_1, a_x, a_y, b_x, b_y = 0.0, w[1], w[2], v[1], v[2]
    total = 0.0
    while i < 3 * n and j < 3 * m:
        q_2 = min(w[i], v[j])
        part, other = (q_2 - q_1) / max(w[i] - q_1, 1e-300), (q_2 - q_1) / max(v[j] - q_1, 1e-300)
        a_x2, a_y2 = a_x + part * (w[i + 1] - a_x), a_y + part * (w[i + 2] - a_y)
        b_x2, b_y2 = b_x + other * (v[j + 1] - b_x), b_y + other * (v[j + 2] - b_y)
        c_11, c_12, c_22 = piece_products(q_1, q_2)
        total += c_11 * (a_x * b_x + a_y * b_y) + c_22 * (a_x2 * b_x2 + a_y2 * b_y2)
        total += c_12 * (a_x * b_x2 + a_y * b_y2 + a_x2 * b_x + a_y2 * b_y)
        q_1, a_x, a_y, b_x, b_y = q_2, a_x2, a_y2, b_x2, b_y2
        i, j = i + 3 if w[i] <= q_2 else i, j + 3 if v[j] <= q_2 else j
    return total


@helper
def carry_springs(w, m, retained, overlap, new):
    """Write the springs (w, m) carried outward by rolling, as means over the cells. Zero beyond the larger `overlap` of the step.
    A cell holds the content of `retained` times its ends, so force is lost across the edge only. That interval is no wider than
    any cell that it intersects: two at most."""
    n, h = cells_of(w), w[0]
    new[0] = h
    for i in range(1, len(new)):  # a row of an even length has one number more than the cells need: history must not be undefined
        new[i] = 0.0
    for i in range(n):
        y_1, y_2 = lower_end(i, m, h), lower_end(i + 1, m, h)
        if (y_1 * y_1 + y_1 * y_2 + y_2 * y_2) / 3.0 < overlap:  # mean of q over the cell
            y, wide = retained * y_1, 2.0 * h * m
            first = min(int(y / (2.0 * h)) if y < wide else m + int((y - wide) / h), i)
            second = min(first + 1, n - 1)
            outer = min(max(retained * y_2 - lower_end(first + 1, m, h), 0.0) / (y_2 - y_1), retained)
            inner = retained - outer
            new[1 + i] = inner * w[1 + first] + outer * w[1 + second]
            new[1 + n + i] = inner * w[1 + n + first] + outer * w[1 + n + second]


@helper
def renewal_loss(w, n, v, m, step, renewal, slip, slides):
    """Energy released by rolling in the step, over G*. Of the field (w, n), which is (v, m) when carried outward; springs: n
    negative. `slip` is that of the step, `step` as for `advance_field`. Exact for a uniform field that sticks and for one that
    slides in one direction throughout, of first order in the renewal of a step in between."""
    (s_x, s_y), retained, k = slip, renewal.retained, -n - 1
    if n >= 0:
        x, y = field_force(w, n)
        energy = field_energy(w, n, 0.0)
        beyond_x, beyond_y, initial_gap = field_beyond(w, n, retained * retained * max(step.overlap_before, step.overlap))
        loss = (1.0 - retained) * energy + retained * initial_gap
    else:
        x, y = spring_force(w, k)
        energy, (x_new, y_new) = spring_product(w, w, k), spring_force(v, k)
        beyond_x, beyond_y, loss = x - x_new, y - y_new, energy - spring_product(v, v, k)
    left, work = 1.0 - renewal.fill, s_x * x + s_y * y
    if slides:
        common = field_product(w, n, v, m) if n >= 0 else spring_product(w, v, k)
        apart = 2.0 * (energy - common) - loss
        return max(loss + apart + 2.0 * left * work, 0.0)
    mixed = renewal.fill - left / (1.0 - renewal.retained)
    own = renewal.own * (s_x * s_x + s_y * s_y) * math.sqrt(min(step.overlap_before, step.overlap))
    return max(loss + 2.0 * (left * work + mixed * (s_x * beyond_x + s_y * beyond_y) + own), 0.0)
