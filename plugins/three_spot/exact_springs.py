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
"""

import math

from .numerical_tangent import helper
from .spring_field import piece_mean

ALIGNED = 1e-10
"""Sine of the angle to the slip up to which a spring counts as parallel to it."""
IN_LINE = 1e-16
"""The same to the last digit."""
SHORT = 0.1
"""Path over the bound below which the slip path is the trapezoid of the cosine with end corrections: error 1e-7."""
SERIES = 1e-2
"""Relative change of the bound below which its logarithmic mean is computed by a series."""


@helper
def cells_of(w):
    """Number of springs in the array of the field."""
    return (len(w) - 2) // 2


@helper
def lower_end(i, m, h):
    """Inner edge of cell i over sqrt(R)."""
    return h * (i + min(i, m))


@helper
def gap_of(i, m, h):
    """Mean of q over cell i: a spring touches where the overlap exceeds it."""
    y_1, y_2 = lower_end(i, m, h), lower_end(i + 1, m, h)
    return (y_1 * y_1 + y_1 * y_2 + y_2 * y_2) / 3.0


@helper
def grid_for(d, n):
    """(spacing, number m of wide cells) of the smallest grid of n cells for a contact area of overlap d."""
    y = math.sqrt(d)
    spacing = math.ldexp(0.5, math.frexp(y / n)[1])
    m = int(math.ceil(y / spacing)) - n
    return spacing, min(max(m, 0), n)


@helper
def spring_energy(w, m):
    """int |w|^2 dy over the contact area."""
    n, total = cells_of(w), 0.0
    for i in range(n):
        x, y = w[1 + i], w[1 + n + i]
        total += (lower_end(i + 1, m, w[0]) - lower_end(i, m, w[0])) * (x * x + y * y)
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
    n = cells_of(new)
    spacing, m = grid_for(d, n)
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
def merge_next(w, m):
    """Merge cells m and m + 1, which leaves the outermost empty; return the new m.

    With all cells wide, the spacing doubles.
    """
    n = cells_of(w)
    if m == n:
        w[0], m = 2.0 * w[0], 0
    for part in range(2):
        first = 1 + part * n
        outer = w[first + m + 1] if m + 1 < n else 0.0
        w[first + m] = 0.5 * (w[first + m] + outer)
        for i in range(m + 1, n - 1):
            w[first + i] = w[first + i + 1]
        if m + 1 < n:
            w[first + n - 1] = 0.0
    return m + 1


@helper
def cut_all(w, m):
    """Split every cell into two of half its width, as far as there is space; return the new m.

    The outer half must be empty.
    """
    n = cells_of(w)
    for part in range(2):
        first = 1 + part * n
        for i in range(n - 1, -1, -1):
            w[first + i] = w[first + i // 2]
    w[0] *= 0.5
    return min(2 * m, n)


@helper
def fit_cells(w, m, y):
    """Adapt the cells to a contact area that extends to y; return (new m, twice the energy released by averaging, over 2 G*)."""
    n = cells_of(w)
    if y <= w[0] * (n + m) <= 2.0 * y:
        return m, 0.0
    before = spring_energy(w, m)
    while y > w[0] * (n + m):
        m = merge_next(w, m)
    while 2.0 * y < w[0] * (n + m):
        m = cut_all(w, m)
    return m, max(before - spring_energy(w, m), 0.0)


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
    """Advance one spring through a straight slip of this length along e while its bound changes from b_0 to b_1.

    Returns (x, y, energy lost over its stiffness, slip). It sticks until it reaches the bound, at the fraction t of the path, and
    slides from there on. Energy: mean bound times slip, exact on a line and of second order otherwise.
    """
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
    """Advance the springs in place through one straight step.

    Returns (new m, slip of the centre, loss/(2 G*), whether all slid along it). `step` as for `spring_field.advance_field`.
    """
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
