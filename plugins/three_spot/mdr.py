"""Partial slip by the method of dimensionality reduction: a row of springs with friction limits.

T = 2 G* int_0^a w dx over springs at x in [0, a] that touch where the overlap exceeds their gap, and that slip at
|w| = kappa h, h the local overlap (Popov and Hess, Method of Dimensionality Reduction in Contact Mechanics and Friction,
2015; kappa = mu E*/G*, Willert, Eq. 13). w is a 2-D vector in the contact plane.

* On a straight path of overlap and slip a spring receives the fraction of the slip after it touched, and is then returned
  onto its limit. Along a line that is exact whatever the length of the step, so 100 steps give the same as one; on a curved
  path the return makes an error of first order in the angle by which a step turns, down to that of the row: for 32 springs
  at most 2e-3 of mu N, by where the edge falls between springs (overlaps 1e-3 to 1e-2 of the radius).
* Two neighbouring springs are merged at the very moment when the contact area reaches the end of the grid (`mdr_springs`):
  n springs suffice for a growing contact, and the state depends on the path only. A shrinking contact keeps its coarse grid
  until it opens. The gap of a spring is the mean over its cell, so merging preserves every field that is linear in x^2, and the
  springs together never exceed mu N (they fall short of it by 1.5 (spacing/2a)^2 at most: 4e-4 for 32 springs).
* Springs that leave the contact area are reset. Where the contact area moves over fresh ground its springs are carried outward
  and leave at the edge, at the rate of Kalker's creep (`thirdbody.laws.renewal`), exactly for uniform springs that stick
  and steps of any length: a spot that rolls without creep loses two thirds of its force in two contact radii, one that sways
  keeps it.
"""

import math
from typing import NamedTuple

from thirdbody.plugin import (
    RENEWAL,
    Law,
    Option,
    Options,
    Pair,
    Tangential,
    e_star,
    g_star,
    helper,
    kernel,
    moved_ground,
    renewal_rate,
    renewed,
    stack_array,
)

from .mdr_springs import (
    MAX_SPRINGS,
    carry,
    cells_of,
    end_of,
    mean_gap,
    merge,
    merges_for,
    springs_tangent,
    squares_lost,
    width_of,
)

SCRATCH = 6 * MAX_SPRINGS  # floats of scratch for a step; numba wants a number by name


class SpringParameters(NamedTuple):
    """Effective shear modulus G* [Pa]; friction; kappa = mu E*/G* (Willert, Eqs. 13, 14); renewal per contact radius."""

    g_star: float
    mu: float
    kappa: float
    renewal: float


def mix_springs(pair: Pair, options: Options) -> SpringParameters:
    """Return the parameters of a pair of materials."""
    shear = g_star(pair.a, pair.b)
    return SpringParameters(shear, pair.friction, pair.friction * e_star(pair.a, pair.b) / shear, renewal_rate(pair, options))


def whole(options: Options, name: str) -> int:
    """Return an option that is a number of springs or nodes. Raises ValueError for one that is not whole."""
    if options[name] % 1.0 != 0.0:
        raise ValueError(f"{name} = {options[name]:g} must be a whole number")
    return int(options[name])


@helper
def squares(rows, n, wide):
    """Return the sum of the squares of n springs, rows[: 2 n], each times the width of its cell in spacings."""
    total = 0.0
    for i in range(n):
        total += width_of(i, wide) * (rows[i] * rows[i] + rows[n + i] * rows[n + i])
    return total


@kernel
def segment(new, grid, path, slip, bound, scratch):
    """Advance the springs along one straight piece of the path; write those at its end into `new`. Returns the heat of friction,
    the slip of the centre, and the sums of the new springs and of their squares, each times the width of its cell. `scratch` (6
    n,): the springs at the start of the piece, then the fractions that the limits leave (output), and what the loops need; `grid`
    = (springs, wide cells, spacing^2/R), `path` = overlap before and after, `slip` along x and y. The heat of a spring is int b
    |d(slip)| with its limit b [m2]: times the stiffness of a cell one spacing wide it is energy. A spring slides from the point
    where it reaches the limit, at b_t; limit and displacement being linear in time, the mean of the limit is that of b_t and its
    end. That is exact for a spring that moves along one line, reversing or not, and of second order in the angle of a step
    otherwise. A spring that leaves the contact area slides before it does, as its limit falls to zero. Two loops, the expensive
    one without branches or sums, so that the compiler vectorises it."""
    (n, wide, scale), (before, after), (slip_x, slip_y) = grid, path, slip
    inverse_change = 1.0 / max(abs(after - before), 1e-300)
    for i in range(n):
        gap = mean_gap(i, wide, scale)
        depth, old_depth = max(after - gap, 0.0), max(before - gap, 0.0)
        fraction = 1.0 if min(depth, old_depth) > 0.0 else min((depth + old_depth) * inverse_change, 1.0)
        x_old, y_old = scratch[i], scratch[n + i]
        x_try, y_try = x_old - fraction * slip_x, y_old - fraction * slip_y
        size, limit = math.sqrt(x_try * x_try + y_try * y_try), bound * depth
        beyond, inverse = max(size - limit, 0.0), 1.0 / max(size, 1e-300)
        back = limit * inverse if size > limit else 1.0
        new[i], new[n + i] = back * x_try, back * y_try
        # b_t from the spring: the limit before the step has no significant digits for huge friction
        along = x_old * x_try + y_old * y_try
        margin = max(bound * old_depth * size - along, 0.0)
        start = along * inverse
        crossing = start + (size - start) * (margin / max(margin + size * beyond, 1e-300))
        scratch[2 * n + i], scratch[3 * n + i] = back, size
        scratch[4 * n + i] = 0.5 * (crossing + limit) * beyond
    heat, x, y, square = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        width = width_of(i, wide)
        heat += width * scratch[4 * n + i]
        along, across = width * new[i], width * new[n + i]
        x, y, square = x + along, y + across, square + (along * new[i] + across * new[n + i])
    return heat, (1.0 - scratch[2 * n]) * scratch[3 * n], (x, y, square)


@kernel
def released_by_rolling(w, new, grid, before, roll, scratch):
    """Return the energy that rolling releases in a step of one piece, of springs of unit stiffness. `roll`: coefficients of
    spring times slip, of lost spring times slip, of slip squared, and the slip along x and y; `scratch`: that of `segment` after
    it, with the springs w carried outward at first. Exact for uniform springs that stick and for springs that slide in one
    direction throughout, of first order in the renewal of a step in between."""
    (n, wide, scale), (mean, mixed, own, slip_x, slip_y) = grid, roll
    for i in range(n):
        slips = 1.0 if before > mean_gap(i, wide, scale) else 0.0
        s_x, s_y = slips * slip_x, slips * slip_y
        x, y, x_old, y_old = w[i], w[n + i], scratch[i], scratch[n + i]
        lost_x, lost_y = x - x_old, y - y_old
        sliding = 0.5 * ((lost_x - mean * s_x) * (x + new[i]) + (lost_y - mean * s_y) * (y + new[n + i]))
        # mean over the step minus the fraction `fill` of the end, where the springs decay from one to the other
        sticking = 0.5 * (lost_x * (x + x_old) + lost_y * (y + y_old)) + own * (s_x * s_x + s_y * s_y)
        sticking -= s_x * (mean * x + mixed * lost_x) + s_y * (mean * y + mixed * lost_y)
        scratch[5 * n + i] = width_of(i, wide) * (sliding if scratch[2 * n + i] < 1.0 else sticking)
    released = 0.0
    for i in range(n):
        released += scratch[5 * n + i]
    return max(released, 0.0)


@kernel
def springs(c, load, p, h, w, w_new):
    """Return force, energies and the new row of springs after a straight step from the overlap and the grid in h."""
    n = len(w) // 2
    before, merges = h[0], int(h[1])
    if before <= 0.0:
        merges = merges_for(c.overlap, n, c.radius)
    spacing, wide = cells_of(merges, n, c.radius)
    scratch = stack_array(SCRATCH)
    # Coulomb's limit uses the total normal force, including the dashpot
    bound = p.kappa * load.force / max(load.elastic, 1e-300)
    ground = moved_ground(c.roll_x, c.roll_y, load.contact_radius, h[4], h[5], h[6])
    renewal = renewed(p.renewal * ground.path / max(load.contact_radius, 1e-300))
    slip_x, slip_y = renewal.fill * c.slip_x, renewal.fill * c.slip_y
    end, grid = end_of(n, wide, spacing, c.radius), (n, wide, spacing * spacing / c.radius)
    done, slip, energy, rolling, merged = before, 0.0, 0.0, 0.0, c.overlap > end
    rolls = renewal.retained < 1.0
    carry(w, scratch, grid, max(before, c.overlap), renewal.retained)
    if rolls and merged:
        start, rest = squares(w, n, wide), squares(scratch, n, wide)
        rolling = (start - rest) / max(start + rest, 1e-300)
        start *= p.g_star * spacing
    else:
        start = 0.0
    while True:  # one call of `segment`, which is inlined
        whole = not c.overlap > end
        path = (done, c.overlap if whole else end)
        part = (path[1] - done) / (c.overlap - before) if merged else 1.0
        heat, middle, total = segment(w_new, grid, path, (part * slip_x, part * slip_y), bound, scratch)
        slip += middle
        if whole:
            break
        energy += p.g_star * spacing * (2.0 * heat + total[2])
        merge(w_new, 2, n, wide)
        energy -= p.g_star * spacing * squares(w_new, n, wide + 1)
        for i in range(2 * n):
            scratch[i] = w_new[i]
        merges, done = merges + 1, end
        spacing, wide = cells_of(merges, n, c.radius)
        end, grid = end_of(n, wide, spacing, c.radius), (n, wide, spacing * spacing / c.radius)
    stiffness = 2.0 * p.g_star * spacing
    x, y, stored = stiffness * total[0], stiffness * total[1], 0.5 * stiffness * total[2]
    energy += stiffness * heat
    if before <= 0.0 < c.overlap:  # the smaller grids passed: a virgin field is linear in x^2, its work goes as slope . slip
        slope = math.hypot(w_new[0], w_new[n]) / (c.overlap - mean_gap(0, wide, grid[2]))
        rate = math.hypot(slip_x, slip_y) / (c.overlap - before)
        energy += 0.5 * stiffness * slope * rate * squares_lost(merges, n, spacing) / (c.radius * c.radius)
    if merged:  # those before and after differ: int rate U by the trapezoid, exact without slip
        energy += rolling * (start + stored)
    elif rolls:
        mean = 1.0 - renewal.fill
        mixed = renewal.fill - mean / (1.0 - renewal.retained)
        roll = mean, mixed, renewal.own, c.slip_x, c.slip_y
        energy += stiffness * released_by_rolling(w, w_new, grid, before, roll, scratch)
    answer = Tangential(x, y, p.mu * load.force, p.kappa * c.overlap, slip, stored, energy)
    return answer, (c.overlap, float(merges), x, y, ground.x, ground.y, ground.reach)


MDR = Law(
    name="mdr",
    stage="tangential",
    assumes="hertz",
    kernel=springs,
    tangent=springs_tangent,
    parameters=SpringParameters,
    mix=mix_springs,
    options=(
        Option("springs", "dimensionless", 32.0, low=4.0, high=float(MAX_SPRINGS), doc="springs per contact, a whole number"),
        RENEWAL,
    ),
    history=("overlap", "merges", "force_x", "force_y", "offset_x", "offset_y", "reach"),
    field=lambda options: 2 * whole(options, "springs"),
    rolls=True,
    source="Popov and Hess 2015; Willert, Self-consistency conditions in static three-body contact, Eqs. 11-13",
)  # fmt: skip
