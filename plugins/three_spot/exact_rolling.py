"""Effect of rolling on the field of the level `exact`: springs are carried outward.

w(x) -> kept w(kept x) (`laws.renewal`). In q = x^2/R that scales the nodes of a field, so it remains piecewise linear: the
step is exact. Springs of fixed positions (`exact_springs`) become means over the new content of their cells.
"""

import math

from .exact_springs import cells_of, gap_of, lower_end, spring_energy, spring_force
from .numerical_tangent import helper
from .spring_field import field_energy, field_force, piece_mean, piece_products


@helper
def carry_field(w, n, retained, ends, new):
    """Write the field (w, n) carried outward by rolling; return its number of nodes. `new` needs space for two more nodes.

    `ends` = (overlap before and after the step): zero beyond the larger one. If they differ, a node is placed at the first, as
    springs beyond it touch within the step.
    """
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
def cell_at(y, m, h):
    """Cell that contains the position y."""
    wide = 2.0 * h * m
    return int(y / (2.0 * h)) if y < wide else m + int((y - wide) / h)


@helper
def carry_springs(w, m, retained, overlap, new):
    """Write the springs (w, m) carried outward by rolling, as means over the cells.

    Zero beyond the larger `overlap` of the step. A cell holds the content of `retained` times its ends, so force is lost across
    the edge only. That interval is no wider than any cell that it intersects: two at most.
    """
    n, h = cells_of(w), w[0]
    new[0] = h
    for i in range(1, len(new)):  # a row of an even length has one number more than the cells need: history must not be undefined
        new[i] = 0.0
    for i in range(n):
        if gap_of(i, m, h) < overlap:
            y_1, y_2 = lower_end(i, m, h), lower_end(i + 1, m, h)
            first = min(cell_at(retained * y_1, m, h), i)
            second = min(first + 1, n - 1)
            outer = min(max(retained * y_2 - lower_end(first + 1, m, h), 0.0) / (y_2 - y_1), retained)
            inner = retained - outer
            new[1 + i] = inner * w[1 + first] + outer * w[1 + second]
            new[1 + n + i] = inner * w[1 + n + first] + outer * w[1 + n + second]


@helper
def springs_product(w, v, m):
    """int w.v dy of two rows of springs in the same cells."""
    n, total = cells_of(w), 0.0
    for i in range(n):
        width = lower_end(i + 1, m, w[0]) - lower_end(i, m, w[0])
        total += width * (w[1 + i] * v[1 + i] + w[1 + n + i] * v[1 + n + i])
    return total


@helper
def lost_by(w, n, v, retained, end):
    """(int w_x dy, int w_y dy, int |w|^2 dy) of a field or of springs, and the loss of each when v is carried outward.

    `end`: the larger overlap of the step.
    """
    if n >= 0:
        x, y = field_force(w, n)
        energy = field_energy(w, n, 0.0)
        beyond_x, beyond_y, initial_gap = field_beyond(w, n, retained * retained * end)
        return x, y, energy, beyond_x, beyond_y, (1.0 - retained) * energy + retained * initial_gap
    m = -n - 1
    x, y = spring_force(w, m)
    x_new, y_new = spring_force(v, m)
    energy = spring_energy(w, m)
    return x, y, energy, x - x_new, y - y_new, energy - spring_energy(v, m)


@helper
def renewal_loss(w, n, v, m, step, renewal, slip, slides):
    """Energy released by rolling in the step, over G*.

    Of the field (w, n), which is (v, m) when carried outward; springs: n negative. `slip` is that of the step, `step` as for
    `spring_field.advance_field`. Exact for a uniform field that sticks and for one that slides in one direction throughout, of
    first order in the renewal of a step in between.
    """
    s_x, s_y = slip
    x, y, energy, beyond_x, beyond_y, loss = lost_by(w, n, v, renewal.retained, max(step.overlap_before, step.overlap))
    left, work = 1.0 - renewal.fill, s_x * x + s_y * y
    if slides:
        common = field_product(w, n, v, m) if n >= 0 else springs_product(w, v, -n - 1)
        apart = 2.0 * (energy - common) - loss
        return max(loss + apart + 2.0 * left * work, 0.0)
    mixed = renewal.fill - left / (1.0 - renewal.retained)
    own = renewal.own * (s_x * s_x + s_y * s_y) * math.sqrt(min(step.overlap_before, step.overlap))
    return max(loss + 2.0 * (left * work + mixed * (s_x * beyond_x + s_y * beyond_y) + own), 0.0)
