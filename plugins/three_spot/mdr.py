"""Partial slip by the method of dimensionality reduction: a row of springs with friction limits.

T = 2 G* int_0^a w dx over springs at x in [0, a] that touch where the overlap exceeds their gap, and that slip at
|w| = kappa h, h the local overlap (Popov and Hess, Method of Dimensionality Reduction in Contact Mechanics and Friction,
2015; kappa = mu E*/G*, Willert, Eq. 13). w is a 2-D vector in the contact plane.

* On a straight path of overlap and slip a spring receives the fraction of the slip after it touched, and is then returned
  onto its limit. Along a line that is exact whatever the length of the step, so 100 steps give the same as one; on a curved
  path the return makes an error of first order in the angle by which a step turns, down to that of the row: 4e-4 of
  mu N for 32 springs, 5e-5 for 128.
* Two neighbouring springs are merged at the very moment when the contact area reaches the end of the grid (`spring_grid`):
  n springs suffice for a growing contact, and the state depends on the path only. A shrinking contact keeps its coarse grid
  until it opens. The gap of a spring is the mean over its cell, so merging preserves every field that is linear in x^2, and the
  springs together never exceed mu N (they fall short of it by 1.5 (spacing/2a)^2 at most: 4e-4 for 32 springs).
* Springs that leave the contact area are reset. Where the contact area moves over fresh ground its springs are carried outward
  and leave at the edge, at the rate of Kalker's creep (`thirdbody.laws.patch_renewal`), exactly for uniform springs that stick
  and steps of any length: a spot that rolls without creep loses two thirds of its force in two contact radii, one that sways
  keeps it.
"""

import math
from typing import NamedTuple

import numpy as np

from thirdbody.plugin import (
    RENEWAL,
    Law,
    Option,
    Options,
    Pair,
    Tangential,
    e_star,
    fresh_ground,
    g_star,
    kernel,
    renewal_rate,
    renewed,
)

from .mdr_rolling import carry_outward, renewal_heat
from .mdr_tangent import tangent_of_springs
from .numerical_tangent import helper
from .spring_grid import cells_of, end_of, mean_gap, merge, merges_for, squares_lost, width_of


class SpringParameters(NamedTuple):
    """Effective shear modulus (the paper's G*) [Pa]; friction; ratio of the moduli mu E*/G*; renewal per contact radius."""

    g_star: float
    mu: float
    kappa: float
    renewal: float


@helper
def sums(w, n, wide):
    """Sums of the elongations along x and y and of their squares, each times the width of its cell in spacings."""
    x, y, square = 0.0, 0.0, 0.0
    for i in range(n):
        width = width_of(i, wide)
        along, across = width * w[i], width * w[n + i]
        x, y, square = x + along, y + across, square + (along * w[i] + across * w[n + i])
    return x, y, square


@helper
def segment(w, grid, path, slip, bound, back):
    """Advance the springs along one straight piece of the path; return (heat of friction, slip of the centre).

    `grid` = (springs, wide cells, spacing^2/R), `path` = overlap before and after, `slip` along x and y.

    The heat of a spring is int b |d(slip)| with its limit b [m2]: times the stiffness of a cell one spacing wide it is energy. A
    spring slides from the point where it reaches the limit, at b_t; limit and displacement being linear in time, the mean of the
    limit is that of b_t and its end. That is exact for a spring that moves along one line, reversing or not, and of second order
    in the angle of a step otherwise. A spring that leaves the contact area slides before it does, as its limit falls to zero.
    `back` (3 n,) is scratch. Two loops, the expensive one without branches or sums, so that the compiler vectorises it.
    """
    (n, wide, scale), (before, after), (slip_x, slip_y) = grid, path, slip
    per_rise = 1.0 / max(abs(after - before), 1e-300)
    for i in range(n):
        gap = mean_gap(i, wide, scale)
        depth, old_depth = max(after - gap, 0.0), max(before - gap, 0.0)
        fraction = 1.0 if min(depth, old_depth) > 0.0 else min((depth + old_depth) * per_rise, 1.0)
        x_old, y_old = w[i], w[n + i]
        x_try, y_try = x_old - fraction * slip_x, y_old - fraction * slip_y
        size, limit = math.sqrt(x_try * x_try + y_try * y_try), bound * depth
        back[i] = limit / max(size, limit, 1e-300)
        back[n + i] = size
        w[i], w[n + i] = back[i] * x_try, back[i] * y_try
        start = (x_old * x_try + y_old * y_try) / max(size, 1e-300)
        far, margin = max(size - limit, 0.0), max(bound * old_depth - start, 0.0)
        # b_t from the spring: the limit before the step has no significant digits for huge friction
        met = start + (size - start) * (margin / max(margin + far, 1e-300))
        back[2 * n + i] = 0.5 * (met + limit) * far
    heat = 0.0
    for i in range(n):
        heat += width_of(i, wide) * back[2 * n + i]
    return heat, (1.0 - back[0]) * back[n]


@kernel
def springs(c, load, p, h, w, w_new):
    """Return force, energies and the new row of springs after a straight step from the overlap and the grid in h."""
    n = len(w) // 2
    before, merges = h[0], int(h[1])
    if before <= 0.0:
        merges = merges_for(c.overlap, n, c.radius)
    spacing, wide = cells_of(merges, n, c.radius)
    for i in range(2 * n):
        w_new[i] = w[i]
    scratch = np.empty(5 * n)
    # Coulomb's limit uses the total normal force, including the dashpot
    bound = p.kappa * load.force / max(load.elastic, 1e-300)
    ground = fresh_ground(c.roll_x, c.roll_y, load.contact_radius, h[4], h[5], h[6])
    fraction = renewed(p.renewal * ground.way / max(load.contact_radius, 1e-300))
    slip_x, slip_y = fraction.fill * c.slip_x, fraction.fill * c.slip_y
    energy, rolled, start_spacing, start_wide = 0.0, scratch[3 * n :], spacing, wide
    if fraction.kept < 1.0:
        carry_outward(w, rolled, (n, wide, spacing * spacing / c.radius), max(before, c.overlap), fraction.kept)
        for i in range(2 * n):
            w_new[i] = rolled[i]
    done, slip, merged = before, 0.0, False
    end = end_of(n, wide, spacing, c.radius)
    while c.overlap > end:
        part = (end - done) / (c.overlap - before)
        grid = (n, wide, spacing * spacing / c.radius)
        heat, middle = segment(w_new, grid, (done, end), (part * slip_x, part * slip_y), bound, scratch)
        energy += p.g_star * spacing * (2.0 * heat + sums(w_new, n, wide)[2])
        merge(w_new, 2, n, wide)
        energy -= p.g_star * spacing * sums(w_new, n, wide + 1)[2]
        merges, done, slip, merged = merges + 1, end, slip + middle, True
        spacing, wide = cells_of(merges, n, c.radius)
        end = end_of(n, wide, spacing, c.radius)
    part = (c.overlap - done) / (c.overlap - before) if merged else 1.0
    grid = (n, wide, spacing * spacing / c.radius)
    heat, middle = segment(w_new, grid, (done, c.overlap), (part * slip_x, part * slip_y), bound, scratch)
    stiffness = 2.0 * p.g_star * spacing
    x, y, square = sums(w_new, n, wide)
    stored = 0.5 * stiffness * square
    energy += stiffness * heat
    if before <= 0.0 < c.overlap:  # the smaller grids passed: a virgin field is linear in x^2, its work goes as slope . slip
        slope = math.hypot(w_new[0], w_new[n]) / (c.overlap - mean_gap(0, wide, grid[2]))
        rate = math.hypot(slip_x, slip_y) / (c.overlap - before)
        energy += 0.5 * stiffness * slope * rate * squares_lost(merges, n, spacing) / (c.radius * c.radius)
    if fraction.kept < 1.0:
        if merged:  # springs before and after differ: int rate U by the trapezoid, exact without slip
            before_renewal = p.g_star * start_spacing * sums(w, n, start_wide)[2]
            after_renewal = p.g_star * start_spacing * sums(rolled, n, start_wide)[2]
            renewed_part = (before_renewal - after_renewal) / max(before_renewal + after_renewal, 1e-300)
            energy += renewed_part * (before_renewal + stored)
        else:
            energy += stiffness * renewal_heat(w, rolled, w_new, grid, scratch, (before, c.slip_x, c.slip_y), fraction)
    limit = p.mu * load.force
    x, y = stiffness * x, stiffness * y
    answer = Tangential(x, y, limit, p.kappa * c.overlap, slip + middle, stored, energy)
    return answer, (c.overlap, float(merges), x, y, ground.x, ground.y, ground.reach)


@kernel
def springs_tangent(c, load, p, h, w):
    """Consistent tangent of one step, including springs that stick, slip, touch or merge within it (`mdr_tangent`)."""
    merges = int(h[1]) if h[0] > 0.0 else merges_for(c.overlap, len(w) // 2, c.radius)
    distance = fresh_ground(c.roll_x, c.roll_y, load.contact_radius, h[4], h[5], h[6]).way
    return tangent_of_springs(c, load, p, (h[0], merges, renewed(p.renewal * distance / max(load.contact_radius, 1e-300))), w)


def mix_springs(pair: Pair, options: Options) -> SpringParameters:
    """Return G*, friction and kappa = mu E*/G* (Willert, Eqs. 13, 14)."""
    g = g_star(pair.a, pair.b)
    return SpringParameters(g, pair.friction, pair.friction * e_star(pair.a, pair.b) / g, renewal_rate(pair, options))


def width(options: Options) -> int:
    """Number of floats of the field: two per spring. Raises ValueError for a non-integer number of springs."""
    springs = options["springs"]
    if springs % 1.0 != 0.0:
        raise ValueError(f"springs = {springs:g} must be a whole number")
    return 2 * int(springs)


MDR = Law(
    name="mdr",
    stage="tangential",
    kernel=springs,
    tangent=springs_tangent,
    parameters=SpringParameters,
    mix=mix_springs,
    options=(Option("springs", "dimensionless", 32.0, low=4.0, high=512.0, doc="springs per contact, a whole number"), RENEWAL),
    history=("overlap", "merges", "force_x", "force_y", "offset_x", "offset_y", "reach"),
    field=width,
    rolls=True,
    source="Popov and Hess 2015; Willert, Self-consistency conditions in static three-body contact, Eqs. 11-13",
)
