"""Partial slip without discretisation: the tangential law of the level `exact`.

The springs of the method of dimensionality reduction as a field that is piecewise linear in q = x^2/R, advanced in closed form
(`spring_field`). On slip along one line, with any overlap and load, it is the Hertz-Mindlin contact itself: memory diagrams give
the same force to rounding, and a straight path of any length may be one step. A smooth history of overlap and slip on a line has
a piece for every step. The field holds up to `nodes` - 10 of them, then drops the least important one and counts it (`dropped` in
the history): an error of 3e-4 of mu N with 32 nodes, falling with their square.

Where springs slide on a curve each lags by a different angle, and no field of finitely many pieces is the solution. From the
first such step on the contact area has some 1.5 `nodes` springs, dragged in closed form (`exact_springs`): at constant overlap a
polygon is followed exactly, a curve to second order in the step. The springs themselves add an error of at most 2e-4 of mu N with
48 nodes, which falls with the square of their number. A contact that has slid far along a line is a field again.
What every level neglects: README.md, "Levels".
"""

import math

import numpy as np

from thirdbody.plugin import RENEWAL, Contact, Law, Load, Option, Tangential, helper, kernel, moved_ground, renewed

from .exact_springs import advance_springs, carry_field, carry_springs, cell_means, renewal_loss, spring_force, spring_product
from .mdr import SpringParameters, mix_springs, whole
from .spring_field import GAUSS, FieldStep, advance_field, field_energy, field_force, piece_mean

STEP = 1e-6  # relative step of differences: half the digits of the forces remain


@helper
def step_of(c, load, p, h):
    """Return the step of the springs (`FieldStep`), the fraction of slip that counts, `Ground` and `Renewal`. The slip is
    multiplied by the fraction that remains in the springs while rolling renews them. A negative overlap before the step removes
    the part of the slip before touch. The bound is kappa (d - q) N_total/N_Hertz, so that the whole contact slides at mu times
    the load available to friction."""
    d, d_old = c.overlap, h[0]
    after = d / (d - d_old) if d_old < 0.0 else 1.0
    ground = moved_ground(c.roll_x, c.roll_y, load.contact_radius, h[4], h[5], h[6])
    renewal = renewed(p.renewal * ground.path / load.contact_radius)
    after *= renewal.fill
    k = p.kappa * load.force / load.elastic
    return FieldStep(after * c.slip_x, after * c.slip_y, max(d_old, 0.0), d, k), after, ground, renewal


@helper
def rolled_field(w, n, retained, step):
    """Return the field, or the springs if n is negative, after rolling has carried it outward before the step, and its number."""
    if retained >= 1.0 or n == 0:
        return w, n
    v = np.empty(len(w) + 6)
    if n > 0:
        return v, carry_field(w, n, retained, (step.overlap_before, step.overlap), v)
    carry_springs(w, -n - 1, retained, max(step.overlap_before, step.overlap), v[: len(w)])
    return v[: len(w)], n


@helper
def rotated_springs(w, n, w_new, step):
    """Springs after one step that turns, from a field (w, n) or from springs. Returns (number for the history, slip of the
    centre, loss/(2 G*)). Springs that all slid along one line become one straight field again, if their loss in the step covers
    the energy of the field in excess of its means."""
    sx, sy, d_old, d, k = step
    loss = 0.0
    if n >= 0:
        m = cell_means(w, n, max(d_old, d), w_new)
        loss = 0.5 * max(field_energy(w, n, 0.0) - spring_product(w_new, w_new, m), 0.0)
    else:
        m = -n - 1
        for i in range(len(w_new)):
            w_new[i] = w[i]
    m, slip, lost, straight = advance_springs(w_new, m, step)
    loss += lost
    if straight:
        length, bound = math.sqrt(sx * sx + sy * sy), k * d
        gain = 0.5 * (8.0 / 15.0 * bound * bound * math.sqrt(d) - spring_product(w_new, w_new, m))
        if loss >= gain:
            for i in range(len(w_new)):
                w_new[i] = 0.0
            w_new[1], w_new[2], w_new[3] = bound * sx / length, bound * sy / length, d
            return 2, slip, min(loss - gain, loss)
    return -m - 1, slip, loss


@kernel
def exact(c, load, p, h, w, w_new):
    """T = -2 G* int_0^a w dx, U = G* int_0^a |w|^2 dx. `h` = (overlap before the step, nodes of the field, force, ground, nodes
    dropped for lack of space); instead of the number of nodes, -1 minus the number of wide cells if there are springs. `w` is the
    field or the springs, displaced by the slip of i relative to j. Dissipated: by springs that slide, the mean of their bounds
    while sliding times their slip (exact at constant overlap, second order in the step otherwise), and the energy released by
    rolling and by loss of contact area. None of these is a difference of works, none is negative. The slip is that of the centre,
    which sticks while any spring does. Rolling: unstressed material enters the contact area; the field is carried outward with
    the travel over fresh ground (`exact_springs`), at the rate of Kalker's creep."""
    limit, d = p.mu * load.force, c.overlap
    if not (d > 0.0 and load.contact_radius > 0.0 and load.elastic > 0.0):
        for i in range(len(w_new)):
            w_new[i] = 0.0
        return Tangential(0.0, 0.0, limit, p.kappa * max(d, 0.0), 0.0, 0.0, 0.0), (max(d, 0.0),) + (0.0,) * 7
    step, _, ground, renewal = step_of(c, load, p, h)
    n, modulus = int(h[1]), p.g_star * load.contact_radius / math.sqrt(d)
    v, m = rolled_field(w, n, renewal.retained, step)
    count, slip, loss, dropped, as_springs = 0, 0.0, 0.0, 0, m < 0
    if not as_springs:
        count, slip, loss, dropped, as_springs = advance_field(v, m, w_new, step)
        if d < step.overlap_before:
            loss += 0.5 * field_energy(v, m, d)
    if as_springs:
        count, slip, loss = rotated_springs(v, m, w_new, step)
        dropped = 0
    if renewal.retained < 1.0 and n != 0:
        loss += 0.5 * renewal_loss(w, n, v, m, step, renewal, (c.slip_x, c.slip_y), slip > 0.0)
    x, y = field_force(w_new, count) if count >= 0 else spring_force(w_new, -count - 1)
    stored = modulus * (field_energy(w_new, count, 0.0) if count >= 0 else spring_product(w_new, w_new, -count - 1))
    x, y = -2.0 * modulus * x, -2.0 * modulus * y
    size = math.sqrt(x * x + y * y)
    # a contact that slides in one direction has two nodes left: then the force is the limit to the last digit
    fraction = limit / max(size, 1e-300) if (slip > 0.0 and count == 2) or size > limit else 1.0
    x, y = fraction * x, fraction * y
    answer = Tangential(x, y, limit, p.kappa * d, slip, stored, 2.0 * modulus * loss)
    return answer, (d, float(count), x, y, ground.x, ground.y, ground.reach, h[7] + dropped)


@helper
def spring_at(w, n, q):
    """Old spring at q and its slope: (x, y, dx/dq, dy/dq)."""
    for i in range(3, 3 * n, 3):
        if q <= w[i]:
            length = max(w[i] - w[i - 3], 1e-300)
            slope_x, slope_y = (w[i + 1] - w[i - 2]) / length, (w[i + 2] - w[i - 1]) / length
            return w[i - 2] + (q - w[i - 3]) * slope_x, w[i - 1] + (q - w[i - 3]) * slope_y, slope_x, slope_y
    return 0.0, 0.0, 0.0, 0.0


@helper
def spring_rates(w, n, rates, step, q):
    """dw_x/ds_x, dw_x/ds_y, dw_y/ds_y, dw_x/dd, dw_y/dd of the spring at q after the step, from the field (w, n). `rates` =
    (fraction of the slip that counts, its rate with the overlap; that of log `retained`, by which rolling has scaled the field
    and carried it outward; that of the bound per compression)."""
    sx, sy, d_old, d, k = step
    after, after_rate, retained_rate, k_rate = rates
    x, y, slope_x, slope_y = spring_at(w, n, q)
    # d/dd of kept w(kept^2 q)
    x_rate, y_rate = retained_rate * (x + 2.0 * q * slope_x), retained_rate * (y + 2.0 * q * slope_y)
    f, f_rate = 1.0, 0.0
    if q > d_old:
        f = (d - q) / (d - d_old)
        f_rate = (1.0 - f) / (d - d_old)
    x, y = x + f * sx, y + f * sy
    x_rate += (f_rate + f * after_rate) * sx
    y_rate += (f_rate + f * after_rate) * sy
    size, bound = math.sqrt(x * x + y * y), k * (d - q)
    f *= after
    if size <= bound:
        return f, 0.0, f, x_rate, y_rate
    e_x, e_y, back = x / size, y / size, bound / size
    xx, xy, yy = back * (1.0 - e_x * e_x), -back * e_x * e_y, back * (1.0 - e_y * e_y)
    bound_rate = k + k_rate * (d - q)
    return f * xx, f * xy, f * yy, xx * x_rate + xy * y_rate + bound_rate * e_x, xy * x_rate + yy * y_rate + bound_rate * e_y


@helper
def tangent_of_field(c, load, p, h, w):
    """Result of `exact_tangent` for an overlap above zero."""
    step, after, _, renewal = step_of(c, load, p, h)
    d = c.overlap
    modulus = p.g_star * load.contact_radius / math.sqrt(d)
    k_rate = step.bound * (load.stiffness / load.force - 1.5 / d) if load.force > 0.0 else 0.0
    # the exponent of renewal goes as d^-0.5
    retained_rate = 0.5 * (1.0 - renewal.retained) / renewal.fill / d
    after_rate = (1.0 / d - 1.0 / (d - h[0])) if h[0] < 0.0 else 0.0
    after_rate += 0.5 * (1.0 - renewal.retained / renewal.fill) / d
    new = np.zeros(len(w))
    v, n = rolled_field(w, int(h[1]), renewal.retained, step)
    count, _, _, _, _ = advance_field(v, n, new, step)
    xx = xy = yy = x_d = y_d = 0.0
    for i in range(0, 3 * count - 3, 3):
        # the fraction of the slip has a kink at the old edge of the contact area, even where the field has none
        corner = min(max(step.overlap_before, new[i]), new[i + 3])
        for q_a, q_b in ((new[i], corner), (corner, new[i + 3])):
            h_piece, _ = piece_mean(q_a, q_b)
            y_a = math.sqrt(q_a)
            for node, weight in GAUSS:
                y = y_a + node * h_piece
                q = min(y * y, d)
                rates = spring_rates(v, n, (after, after_rate, retained_rate, k_rate), step, q)
                part = -2.0 * modulus * weight * h_piece
                xx, xy, yy = xx + part * rates[0], xy + part * rates[1], yy + part * rates[2]
                x_d, y_d = x_d + part * rates[3], y_d + part * rates[4]
    return xx, xy, xy, yy, x_d, y_d


@helper
def curved_tangent(c, load, p, h, w):
    """Tangent by central differences of the step: consistent with it whatever happens within. With the overlap the part of Hertz
    in the load goes as d^1.5, the contact radius as d^0.5, the total by its stiffness."""
    e_d, e_s = STEP * c.overlap, STEP * max(p.kappa, 1e-3) * c.overlap
    forces, w_new = np.empty((6, 2)), np.empty(len(w))
    for k in range(6):  # one call only: the law is inlined, and six copies take seconds more to compile
        size = 1.0 if k % 2 == 0 else -1.0
        x, y = c.slip_x + (size * e_s if k < 2 else 0.0), c.slip_y + (size * e_s if k // 2 == 1 else 0.0)
        d = c.overlap + (size * e_d if k >= 4 else 0.0)
        increment = d - c.overlap
        fraction = increment / c.overlap
        elastic, radius = load.elastic * (1.0 + 1.5 * fraction), load.contact_radius * (1.0 + 0.5 * fraction)
        there = Contact(d, c.radius, c.mass, c.v_n, x, y, c.v_x, c.v_y, c.roll_x, c.roll_y)
        pressed = Load(load.force + load.stiffness * increment, elastic, radius, load.stiffness, load.squared_radius_rate)
        answer = exact(there, pressed, p, h, w, w_new)[0]
        forces[k, 0], forces[k, 1] = answer.x, answer.y
    return (
        0.5 * (forces[0, 0] - forces[1, 0]) / e_s, 0.5 * (forces[2, 0] - forces[3, 0]) / e_s,
        0.5 * (forces[0, 1] - forces[1, 1]) / e_s, 0.5 * (forces[2, 1] - forces[3, 1]) / e_s,
        0.5 * (forces[4, 0] - forces[5, 0]) / e_d, 0.5 * (forces[4, 1] - forces[5, 1]) / e_d,
    )  # fmt: skip


@kernel
def exact_tangent(c, load, p, h, w):
    """Consistent tangent of one step. Along an axis in closed form: sticking springs follow the slip, others the bound. Ends of
    pieces move with the step, but the field is continuous there, so they do not contribute: dT/ds is 2 G* times the radius of the
    stick area. Off an axis by differences: there the step also adds and drops nodes, which changes the force."""
    # without friction no spring holds, not even at rest
    if not (c.overlap > 0.0 and load.contact_radius > 0.0 and load.elastic > 0.0 and p.kappa * load.force > 0.0):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    # in every planar problem slip and springs lie along one axis of the frame
    along_x, along_y = c.slip_x != 0.0, c.slip_y != 0.0
    for i in range(0, 3 * int(h[1]), 3):
        along_x, along_y = along_x or w[i + 1] != 0.0, along_y or w[i + 2] != 0.0
    if h[1] >= 0.0 and not (along_x and along_y):
        return tangent_of_field(c, load, p, h, w)
    return curved_tangent(c, load, p, h, w)


NODES = Option(
    "nodes", "dimensionless", 48.0, low=24.0, high=4096.0,
    doc="how much of its past a contact can store: for slip on a line, about `nodes` - 10 reversals; on a curve, 1.5 `nodes`"
    " springs",
)  # fmt: skip


EXACT = Law(
    name="exact",
    stage="tangential",
    assumes="hertz",
    kernel=exact,
    tangent=exact_tangent,
    parameters=SpringParameters,
    mix=mix_springs,
    options=(NODES, RENEWAL),
    history=("overlap", "nodes", "force_x", "force_y", "offset_x", "offset_y", "reach", "dropped"),
    field=lambda options: 3 * whole(options, "nodes"),
    rolls=True,
    source="Aleshin et al. 2015; Popov and Hess 2015; Willert, Self-consistency conditions in static three-body contact",
)  # fmt: skip
