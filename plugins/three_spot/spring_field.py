"""Spring field of one spot: a vector w, piecewise linear in q = x^2/R over the contact area [0, d].

Springs at half width x have the normal compression d - q (method of dimensionality reduction, Popov and Hess 2015). A field is a
flat array of nodes (q, w_x, w_y), q rising from 0 at the centre to the overlap d at the edge, where w = 0. As q is measured from
the centre, a change of overlap cuts or extends the field at its edge and moves no node. Integrals: with y = sqrt(q), so that x =
sqrt(R) y, a piece has the width h = y_2 - y_1, and every moment of w over dy is a sum of terms of one sign.

No step creates energy: with w_t the old field displaced by the slip, the work T_new ds minus the gain of stored energy is half
the square of w_new - w_old plus w_new.(w_t - w_new), over the contact area. A radial return, a chord within a right angle between
springs so returned, and a projection all leave the second term positive.
"""

import math
from typing import NamedTuple

from thirdbody.plugin import helper

SPARE = 10  # nodes of the array that a field at rest leaves free: a step may add some before it removes others again
COLLINEAR = 1e-12
"""Largest difference of slopes, over the larger of the two, of pieces that count as one; otherwise smooth loading at one rate
would add a piece per step. It bounds the error of all merging together, however small the steps: 1e-12 of the field."""
ROUNDING = 8.0 * 2.0**-52
CURVED = 1e-3
"""Minimum difference of slopes, over the slopes, assumed between pieces when nodes are removed: so the longest of many straight
ones is removed last."""
ROTATION_TOLERANCE = 1e-10
"""Permitted error of the force over mu N from neglecting the rotation of springs in a sliding piece in a step."""
ALIGNED = 1e-7  # its square is below rounding
GAUSS = ((0.5 - math.sqrt(0.15), 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.5 + math.sqrt(0.15), 5.0 / 18.0))


class FieldStep(NamedTuple):
    """A step of the field."""

    slip_x: float
    slip_y: float
    overlap_before: float
    overlap: float
    bound: float
    """Bound of |w| per compression, k in formulas."""


@helper
def piece_mean(q_1, q_2):
    """(h, phi): int w dy over a piece is h [(1 - phi) w_1 + phi w_2]."""
    y_1, y_2 = math.sqrt(q_1), math.sqrt(q_2)
    total = max(y_1 + y_2, 1e-300)
    return (q_2 - q_1) / total, (2.0 * y_1 + y_2) / (3.0 * total)


@helper
def piece_products(q_1, q_2):
    """(c_11, c_12, c_22): int u.v dy = c_11 u_1.v_1 + c_12 (u_1.v_2 + u_2.v_1) + c_22 u_2.v_2 over a piece."""
    y_1, y_2 = math.sqrt(q_1), math.sqrt(q_2)
    total = max(y_1 + y_2, 1e-300)
    h = (q_2 - q_1) / total
    s, u = y_1 / total, h / total
    first = (4.0 * s * s + 5.0 * s * u + 1.6 * u * u) / 3.0
    mixed = 2.0 * (s * s + s * u + 0.2 * u * u) / 3.0
    last = 4.0 * s * s / 3.0 + s * u + 0.2 * u * u
    return h * first, h * mixed, h * last


@helper
def field_force(w, n):
    """int w dy over the contact area, both components."""
    x = y = 0.0
    for i in range(0, 3 * n - 3, 3):
        h, phi = piece_mean(w[i], w[i + 3])
        x += h * (w[i + 1] + phi * (w[i + 4] - w[i + 1]))
        y += h * (w[i + 2] + phi * (w[i + 5] - w[i + 2]))
    return x, y


@helper
def field_energy(w, n, start):
    """int |w|^2 dy beyond q = start."""
    total = 0.0
    for i in range(0, 3 * n - 3, 3):
        q_1, q_2 = w[i], w[i + 3]
        if q_2 > start:
            x_1, y_1 = w[i + 1], w[i + 2]
            if q_1 < start:
                part = (start - q_1) / (q_2 - q_1)
                x_1, y_1, q_1 = x_1 + part * (w[i + 4] - x_1), y_1 + part * (w[i + 5] - y_1), start
            c_11, c_12, c_22 = piece_products(q_1, q_2)
            total += c_11 * (x_1 * x_1 + y_1 * y_1) + c_22 * (w[i + 4] * w[i + 4] + w[i + 5] * w[i + 5])
            total += 2.0 * c_12 * (x_1 * w[i + 4] + y_1 * w[i + 5])
    return total


@helper
def push_piece(w, n, q, x, y):
    """Append a node and return the new number; a last node collinear with the new one is replaced by it."""
    j = 3 * n - 3
    if n >= 2:
        i = j - 3
        l_1, l_2 = w[j] - w[i], q - w[j]
        x_1, y_1, x_2, y_2 = w[j + 1] - w[i + 1], w[j + 2] - w[i + 2], x - w[j + 1], y - w[j + 2]
        bend = (x_2 * l_1 - x_1 * l_2) ** 2 + (y_2 * l_1 - y_1 * l_2) ** 2
        slope_1, slope_2 = x_1 * x_1 + y_1 * y_1, x_2 * x_2 + y_2 * y_2
        slope = max(slope_1 * l_2 * l_2, slope_2 * l_1 * l_1)
        size = w[j + 1] * w[j + 1] + w[j + 2] * w[j + 2]
        noise = size * (l_1 + l_2) ** 2 + q * q * (slope_1 + slope_2)
        if bend <= COLLINEAR * COLLINEAR * slope + ROUNDING * ROUNDING * noise or l_2 <= ROUNDING * q or 3 * n == len(w):
            n -= 1
    w[3 * n], w[3 * n + 1], w[3 * n + 2] = q, x, y
    return n + 1


@helper
def release_energy(w, j):
    """int w_new.(w_old - w_new) dy if the node at w[j] is dropped: energy released if positive, created if negative."""
    part = (w[j] - w[j - 3]) / max(w[j + 3] - w[j - 3], 1e-300)
    x, y = w[j - 2] + part * (w[j + 4] - w[j - 2]), w[j - 1] + part * (w[j + 5] - w[j - 1])
    v_x, v_y = w[j + 1] - x, w[j + 2] - y
    _, c_12, c_22 = piece_products(w[j - 3], w[j])
    inner = c_12 * (w[j - 2] * v_x + w[j - 1] * v_y) + c_22 * (x * v_x + y * v_y)
    c_11, c_12, _ = piece_products(w[j], w[j + 3])
    return inner + c_11 * (x * v_x + y * v_y) + c_12 * (w[j + 4] * v_x + w[j + 5] * v_y)


@helper
def thin(w, n):
    """Drop the node whose loss changes the field least; return the new number of nodes. Measure: the area between the old and the
    new line as if the two pieces were chords of a smooth curve, |slope change| times length squared. The area itself would let a
    long last piece absorb any number of short new ones unnoticed. Where the new chord holds more energy than the two pieces, the
    whole field shrinks to its projection: int w_new.(w_old - w_new) >= 0 prevents a step from creating energy."""
    best, minimum = 3, math.inf
    for j in range(3, 3 * n - 3, 3):
        l_1, l_2 = w[j] - w[j - 3], w[j + 3] - w[j]
        x_1, y_1, x_2, y_2 = w[j + 1] - w[j - 2], w[j + 2] - w[j - 1], w[j + 4] - w[j + 1], w[j + 5] - w[j + 2]
        bend = (x_2 * l_1 - x_1 * l_2) ** 2 + (y_2 * l_1 - y_1 * l_2) ** 2
        bend += CURVED * CURVED * ((x_1 * x_1 + y_1 * y_1) * l_2 * l_2 + (x_2 * x_2 + y_2 * y_2) * l_1 * l_1)
        length = (l_1 + l_2) * (l_1 + l_2) / max(l_1 * l_2, 1e-300)
        cost = bend * length * length
        if cost < minimum:
            best, minimum = j, cost
    lost = release_energy(w, best)
    n -= 1
    for i in range(best, 3 * n):
        w[i] = w[i + 3]
    if lost < 0.0:
        shrink = max(0.0, 1.0 + lost / max(field_energy(w, n, 0.0), 1e-300))
        for i in range(0, 3 * n, 3):
            w[i + 1], w[i + 2] = shrink * w[i + 1], shrink * w[i + 2]
    return n


@helper
def crossing(ax, ay, b_a, bx, by, b_b, t):
    """Position t in [0, 1] between a and b at which |w| meets the bound, searched from the end t beyond it; -1 if there is none.

    |w| - bound is convex along a piece, so Newton's steps from outside never pass the root; on a line they reach it at once.
    """
    dx, dy, db = bx - ax, by - ay, b_b - b_a
    for _ in range(60):
        x, y = ax + t * dx, ay + t * dy
        size = math.sqrt(x * x + y * y)
        rate = (x * dx + y * dy) / max(size, 1e-300) - db
        if rate == 0.0:
            return -1.0
        new = t - (size - b_a - t * db) / rate
        if not 0.0 <= new <= 1.0:
            return -1.0
        if abs(new - t) <= 4e-16:
            return new
        t = new
    return t


@helper
def slip_loss(q, size, x, y, step):
    """Energy lost by a spring that slides in the step, over 2 G* dy: mean bound while it slides times the distance. `size` = |w|
    of the trial, (x, y) its vector. Bound and trial move on straight lines in time, so the spring begins to slide after the
    fraction t of the step, at the bound b_t."""
    sx, sy, d_old, d, k = step
    touched = 1.0 if q <= d_old or d <= d_old else (d - q) / (d - d_old)
    x_0, y_0 = x - touched * sx, y - touched * sy
    size_0 = math.sqrt(x_0 * x_0 + y_0 * y_0)
    size_0 = size_0 if size_0 > ROUNDING * size else 0.0
    b_0, b_1 = max(k * (d_old - q), size_0), k * (d - q)
    excess = max(size - b_1, 0.0)
    t = (b_0 - size_0) / max(b_0 - size_0 + excess, 1e-300)
    return 0.5 * ((1.0 - t) * b_0 + (1.0 + t) * b_1) * excess


@helper
def slide(new, n, a, b, step):
    """Return the springs of a trial piece from node a to b beyond the bound onto it. Returns (nodes, energy lost over 2 G*,
    whether they turn). A rotation counts by its effect on the force: by the part of the ends, or of the slip, across the
    springs."""
    (q_a, ax, ay), (q_b, bx, by), (sx, sy, _, d, k) = a, b, step
    length = q_b - q_a
    h, _ = piece_mean(q_a, q_b)
    y_a, loss = math.sqrt(q_a), 0.0
    for node, weight in GAUSS:
        y = y_a + node * h
        part = min(max((y * y - q_a) / max(length, 1e-300), 0.0), 1.0)
        x, y = ax + part * (bx - ax), ay + part * (by - ay)
        loss += weight * h * slip_loss(q_a + part * length, math.sqrt(x * x + y * y), x, y, step)
    size_a, size_b = math.sqrt(ax * ax + ay * ay), math.sqrt(bx * bx + by * by)
    across = abs(ax * by - ay * bx) + abs(ax * sy - ay * sx) + abs(bx * sy - by * sx)
    noise = ROUNDING * (abs(sx) + abs(sy) + size_a + size_b)
    rotates = across * h > max(size_a, size_b) * (ROTATION_TOLERANCE * k * d * math.sqrt(d) + noise * h)
    back = min(k * (d - q_b) / max(size_b, 1e-300), 1.0)
    return push_piece(new, n, q_b, back * bx, back * by), loss, rotates


@helper
def span(new, n, a, b, step):
    """Transfer one piece of the trial field, from node a, excluded, to b. It is unchanged where it sticks, and goes onto the
    bound where it slides. Returns (nodes, energy lost over 2 G*, whether it turned)."""
    (q_a, ax, ay), (q_b, bx, by), d, k = a, b, step.overlap, step.bound
    b_a, b_b = k * (d - q_a), k * (d - q_b)
    a_out = ax * ax + ay * ay > b_a * b_a * (1.0 + ROUNDING)
    b_out = bx * bx + by * by > b_b * b_b * (1.0 + ROUNDING)
    if not a_out and not b_out:
        return push_piece(new, n, q_b, bx, by), 0.0, False
    dq, dx, dy = q_b - q_a, bx - ax, by - ay
    first, loss, rotates = 0.0, 0.0, False
    if a_out:
        # within a right angle the new chord has less energy than the old one if both ends do: a sag inside may be dropped
        acute = b_out and ax * bx + ay * by >= 0.0
        first = -1.0 if acute else crossing(ax, ay, b_a, bx, by, b_b, 0.0)
        if first < 0.0 and b_out:
            return slide(new, n, a, b, step)
        first = first if first >= 0.0 else 1.0
        n, loss, rotates = slide(new, n, a, (q_a + first * dq, ax + first * dx, ay + first * dy), step)
        if not b_out:
            return push_piece(new, n, q_b, bx, by), loss, rotates
    t = max(crossing(ax, ay, b_a, bx, by, b_b, 1.0), first)  # none: lost by rounding at the inner end
    # the trial itself, not k (d - q), which has no significant digits for huge friction
    q, x, y = q_a + t * dq, ax + t * dx, ay + t * dy
    n = push_piece(new, n, q, x, y)
    n, more, again = slide(new, n, (q, x, y), b, step)
    return n, loss + more, rotates or again


@helper
def advance_field(w, n, new, step):
    """Compute the field `new` after one step from (w, n). (w, n) may have been carried beyond the old overlap by rolling
    (`exact_springs`). Returns (nodes, slip of the centre, loss/(2 G*), nodes dropped for lack of space, whether sliding springs
    turn). In the last case the result is not a field: see `exact_springs`. `step`: a `FieldStep`. Every spring receives the
    fraction of the slip during which it touched, then returns radially onto |w| <= k (d - q). In one direction this is exact for
    a straight path of overlap and slip of any length. Source: Popov and Hess 2015; its 1-D case is the memory diagram of Aleshin,
    Bou Matar and Van Den Abeele 2015."""
    sx, sy, d_old, d, k = step
    inverse_change = 1.0 / (d - d_old) if d > d_old else 0.0
    x, y, q = sx, sy, 0.0
    if n > 0:
        x, y = w[1] + sx, w[2] + sy
    size, bound = math.sqrt(x * x + y * y), k * d
    excess = size - bound
    back = 1.0 if excess <= 0.0 else bound / size
    count = push_piece(new, 0, 0.0, back * x, back * y)
    loss, rotates = 0.0, False
    for i in range(3, 3 * n, 3):
        q_b = w[i]
        touched = 1.0 - max(q_b - d_old, 0.0) * inverse_change
        bx, by = w[i + 1] + touched * sx, w[i + 2] + touched * sy
        if q_b >= d:
            part = (d - q) / max(q_b - q, 1e-300)
            q_b, bx, by = d, x + part * (bx - x), y + part * (by - y)
        count, lost, rotated = span(new, count, (q, x, y), (q_b, bx, by), step)
        loss, rotates = loss + lost, rotates or rotated
        q, x, y = q_b, bx, by
        if q >= d or rotates:
            break
    if q < d and not rotates:
        count, lost, rotated = span(new, count, (q, x, y), (d, 0.0, 0.0), step)
        loss, rotates = loss + lost, rotates or rotated
    last = 3 * count - 3
    new[last], new[last + 1], new[last + 2] = d, 0.0, 0.0
    if excess > 0.0 and count > 2:  # one line, if all springs are at the bound and parallel up to `ALIGNED`
        size, straight = max(math.sqrt(new[1] * new[1] + new[2] * new[2]), 1e-300), True
        e_x, e_y = new[1] / size, new[2] / size
        for i in range(0, last, 3):
            bound = k * (d - new[i])
            along, across = new[i + 1] * e_x + new[i + 2] * e_y, new[i + 2] * e_x - new[i + 1] * e_y
            straight = straight and not (abs(across) > ALIGNED * bound or along < bound * (1.0 - 1e-13))
        if straight:
            new[3], new[4], new[5] = d, 0.0, 0.0
            count = 2
    dropped = 0
    while count > len(new) // 3 - SPARE:
        count = thin(new, count)
        dropped += 1
    for i in range(3 * count, len(new)):
        new[i] = 0.0
    return count, max(excess, 0.0), loss, dropped, rotates
