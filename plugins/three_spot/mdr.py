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

from thirdbody.plugin import (
    RENEWAL,
    Law,
    Option,
    Options,
    Pair,
    Tangential,
    e_star,
    g_star,
    kernel,
    moved_ground,
    renewal_rate,
    renewed,
    stack_array,
)

from .mdr_rolling import carried_weights, carry_outward, copy_rows, from_next_cell
from .mdr_tangent import tangent_of_springs
from .numerical_tangent import helper
from .spring_grid import MAX_SPRINGS, cells_of, end_of, mean_gap, merge, merges_for, squares_lost, width_of

SCRATCH = 6 * MAX_SPRINGS + 2
"""Floats of scratch for a step."""


class SpringParameters(NamedTuple):
    """Effective shear modulus (the paper's G*) [Pa]; friction; ratio of the moduli mu E*/G*; renewal per contact radius."""

    g_star: float
    mu: float
    kappa: float
    renewal: float


@helper
def squares(rows, first, stride, n, wide):
    """Return the sum of the squares of n springs, each times the width of its cell in spacings.

    x starts at `first`, y a `stride` later.
    """
    total = 0.0
    for i in range(n):
        x, y = rows[first + i], rows[first + stride + i]
        total += width_of(i, wide) * (x * x + y * y)
    return total


class Rolled(NamedTuple):
    """Rolling within a piece of the path.

    Fraction of a spring lost to the next cell, overlap beyond which springs have left, coefficients of the energy released (of
    spring times slip, of lost spring times slip, of slip squared), and the slip of the whole step.
    """

    lost: float
    overlap: float
    mean: float
    mixed: float
    own: float
    slip_x: float
    slip_y: float


@kernel
def segment(rows, grid, path, slip, bound, roll, scratch):
    """Advance the springs along one straight piece of the path.

    Returns the heat of friction, the energy released by rolling, the slip of the centre, and the sums of the new springs and
    of their squares, each times the width of its cell. `rows` = springs before the step, and at the end of the piece (output);
    those at its start lie in `scratch` (6 n + 2,) from 4 n on (`copy_rows`); `grid` = (springs, wide cells, spacing^2/R), `path`
    = overlap before and after, `slip` along x and y.

    The heat of a spring is int b |d(slip)| with its limit b [m2]: times the stiffness of a cell one spacing wide it is energy. A
    spring slides from the point where it reaches the limit, at b_t; limit and displacement being linear in time, the mean of the
    limit is that of b_t and its end. That is exact for a spring that moves along one line, reversing or not, and of second order
    in the angle of a step otherwise. A spring that leaves the contact area slides before it does, as its limit falls to zero.

    The energy released by rolling is exact for uniform springs that stick and for springs that slide in one direction throughout,
    of first order in the renewal of a step in between. Two loops, the expensive one without branches or sums, so that the
    compiler vectorises it.
    """
    (w, new), (n, wide, scale), (before, after), (slip_x, slip_y) = rows, grid, path, slip
    old_x, old_y = 4 * n, 5 * n + 1
    inverse_change = 1.0 / max(abs(after - before), 1e-300)
    for i in range(n):
        gap = mean_gap(i, wide, scale)
        depth, old_depth = max(after - gap, 0.0), max(before - gap, 0.0)
        fraction = 1.0 if min(depth, old_depth) > 0.0 else min((depth + old_depth) * inverse_change, 1.0)
        near, far, _ = carried_weights(i, wide, roll.lost)
        inside = 1.0 if gap < roll.overlap else 0.0
        near, far = inside * near, inside * far
        x_old = near * scratch[old_x + 1 + i] + far * scratch[old_x + i]
        y_old = near * scratch[old_y + 1 + i] + far * scratch[old_y + i]
        x_try, y_try = x_old - fraction * slip_x, y_old - fraction * slip_y
        size, limit = math.sqrt(x_try * x_try + y_try * y_try), bound * depth
        back = limit / max(size, limit, 1e-300)
        x_new, y_new = back * x_try, back * y_try
        new[i], new[n + i] = x_new, y_new
        start = (x_old * x_try + y_old * y_try) / max(size, 1e-300)
        beyond, margin = max(size - limit, 0.0), max(bound * old_depth - start, 0.0)
        # b_t from the spring: the limit before the step has no significant digits for huge friction
        crossing = start + (size - start) * (margin / max(margin + beyond, 1e-300))
        scratch[i], scratch[n + i] = back, size
        scratch[2 * n + i] = 0.5 * (crossing + limit) * beyond
        slips = 1.0 if before > gap else 0.0
        s_x, s_y = slips * roll.slip_x, slips * roll.slip_y
        x, y = w[i], w[n + i]
        lost_x, lost_y = x - x_old, y - y_old
        sliding = 0.5 * ((lost_x - roll.mean * s_x) * (x + x_new) + (lost_y - roll.mean * s_y) * (y + y_new))
        # mean over the step minus the fraction `fill` of the end, where the springs decay from one to the other
        sticking = 0.5 * (lost_x * (x + x_old) + lost_y * (y + y_old)) + roll.own * (s_x * s_x + s_y * s_y)
        sticking -= s_x * (roll.mean * x + roll.mixed * lost_x) + s_y * (roll.mean * y + roll.mixed * lost_y)
        scratch[3 * n + i] = sliding if back < 1.0 else sticking
    heat, released, x, y, square = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        width = width_of(i, wide)
        heat, released = heat + width * scratch[2 * n + i], released + width * scratch[3 * n + i]
        along, across = width * new[i], width * new[n + i]
        x, y, square = x + along, y + across, square + (along * new[i] + across * new[n + i])
    return heat, max(released, 0.0), (1.0 - scratch[0]) * scratch[n], (x, y, square)


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
    done, slip, energy, released, merged = before, 0.0, 0.0, 0.0, c.overlap > end
    mean, lost = 1.0 - renewal.fill, 1.0 - renewal.retained
    mixed, last = renewal.fill - mean / max(lost, 1e-300), max(before, c.overlap)
    if lost > 0.0 and (merged or not from_next_cell(n, wide, lost)):
        carry_outward(w, scratch, 4 * n, grid, last, renewal.retained)
        start, rest = squares(w, 0, n, n, wide), squares(scratch, 4 * n + 1, n + 1, n, wide)
        released, lost = (start - rest) / max(start + rest, 1e-300), 0.0
        start *= p.g_star * spacing
    else:
        start = 0.0
        copy_rows(w, n, scratch, 4 * n)
    rows, roll = (w, w_new), Rolled(lost, last, mean, mixed, renewal.own, c.slip_x, c.slip_y)
    while True:  # one call of `segment`, which is inlined
        whole = not c.overlap > end
        path = (done, c.overlap if whole else end)
        part = (path[1] - done) / (c.overlap - before) if merged else 1.0
        heat, heat_of_rolling, middle, total = segment(rows, grid, path, (part * slip_x, part * slip_y), bound, roll, scratch)
        slip += middle
        if whole:
            break
        energy += p.g_star * spacing * (2.0 * heat + total[2])
        merge(w_new, 2, n, wide)
        energy -= p.g_star * spacing * squares(w_new, 0, n, n, wide + 1)
        copy_rows(w_new, n, scratch, 4 * n)
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
    # where springs merge those before and after differ: int rate U by the trapezoid, exact without slip
    energy += released * (start + stored) if merged else stiffness * heat_of_rolling
    answer = Tangential(x, y, p.mu * load.force, p.kappa * c.overlap, slip, stored, energy)
    return answer, (c.overlap, float(merges), x, y, ground.x, ground.y, ground.reach)


@kernel
def springs_tangent(c, load, p, h, w):
    """Consistent tangent of one step, including springs that stick, slip, touch or merge within it (`mdr_tangent`)."""
    merges = int(h[1]) if h[0] > 0.0 else merges_for(c.overlap, len(w) // 2, c.radius)
    distance = moved_ground(c.roll_x, c.roll_y, load.contact_radius, h[4], h[5], h[6]).path
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
    field=width,
    rolls=True,
    source="Popov and Hess 2015; Willert, Self-consistency conditions in static three-body contact, Eqs. 11-13",
)
