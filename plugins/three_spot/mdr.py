"""Partial slip by the method of dimensionality reduction: a row of springs under the patch, each with its own friction limit.

T = 2 G* int_0^a w dx over springs at x in [0, a] that touch where the overlap exceeds their gap, and that slip at
|w| = kappa h, h the local overlap (Popov and Hess, Method of Dimensionality Reduction in Contact Mechanics and Friction,
2015; kappa = mu E*/G*, Willert, Eq. 13). w is a 2-D vector in the contact plane.

* On a straight path of overlap and slip a spring takes the share of the slip that came after it touched, and is then returned
  onto its limit. Along a line that is exact whatever the length of the step, so 100 steps give what one gives; on a curved
  path the return makes an error of first order in the angle that a step turns by, down to that of the row: up to 2e-3 of mu N
  for 32 springs, 4e-4 for 64, 1e-4 for 128.
* The grid of n springs doubles its spacing at the very moment when the patch reaches its end, by merging neighbours: between
  n/2 and n springs carry a growing patch, and the state depends on the path alone. A patch that shrinks keeps its coarse grid
  until the contact opens. The gap of a spring is the mean over its cell, so merging keeps every field that is linear in x^2,
  and the springs together never pass mu N (they fall short of it by 1.5 (spacing/2a)^2 at most: 4e-4 for 32 springs).
* Springs that leave the patch forget. Where the patch moves on over fresh ground its material is renewed, exponentially in the
  way and at the rate of Kalker's creep (`thirdbody.laws.renewal`), exactly for steps of any length where springs stick: a spot
  that rolls without creep has lost two thirds of its force after two contact radii, one that sways keeps it.
"""

from __future__ import annotations

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

from .differences import helper
from .mdr_tangent import tangent_of_springs

FIRST = 2.0**-20
"""Half width of the first grid over the radius of curvature: an overlap of 1e-12 of it."""


class SpringParameters(NamedTuple):
    """Effective shear modulus (the paper's G*), Pa; friction; ratio of the moduli mu E*/G*; renewal per contact radius."""

    g_star: float
    mu: float
    kappa: float
    renewal: float


@helper
def merge(w, n):
    """Two neighbouring springs become one; the outer half of the row is empty afterwards."""
    for part in range(2):
        first = part * n
        for i in range(n // 2):
            w[first + i] = 0.5 * (w[first + 2 * i] + w[first + 2 * i + 1])
        for i in range(n // 2, n):
            w[first + i] = 0.0


@helper
def squares(w):
    """Sum of the squared elongations."""
    total = 0.0
    for i in range(len(w)):
        total += w[i] * w[i]
    return total


@helper
def renewal_heat(w, w_new, n, back, step, share):
    """int (renewal rate) w^2 over the step, summed over the springs, m2: times the stiffness of a spring it is energy.

    `step` = (slip x, y, number of springs that touched before); `share` is the `Renewal` of the step. Exact for springs that
    stick and for those that slide one way throughout, of first order in the renewal of a step between.
    """
    slip_x, slip_y, old = step
    total = 0.0
    for i in range(n):
        s_x, s_y = (slip_x, slip_y) if i < old else (0.0, 0.0)
        x, y = w[i], w[n + i]
        if back[i] < 1.0:
            lost_x = (1.0 - share.kept) * x - (1.0 - share.fill) * s_x
            lost_y = (1.0 - share.kept) * y - (1.0 - share.fill) * s_y
            total += max(0.5 * (lost_x * (x + w_new[i]) + lost_y * (y + w_new[n + i])), 0.0)
        else:
            total += 0.5 * (1.0 - share.kept * share.kept) * (x * x + y * y)
            total += share.own * (s_x * s_x + s_y * s_y) - share.mixed * (x * s_x + y * s_y)
    return total


@helper
def segment(w, n, spacing, radius, before, after, slip_x, slip_y, bound, back):
    """One straight piece of the path, overlap from `before` to `after`; returns (heat of friction, slip of the middle).

    The heat of a spring is int b |d(slip)| with its limit b, in m2: times the stiffness of a spring it is energy. A spring slides
    from where it meets the limit, at b_t; limit and way being linear in time, the mean of the limit is that of b_t and its end.
    That is exact for a spring that moves along one line, turning round or not, and of second order in the angle of a step else.
    A spring that leaves the patch slides before it does, as its limit falls to nothing. `back` (3 n,) is scratch. Two loops, the
    expensive one without branches or sums, so that the compiler does several springs at once.
    """
    per_rise = 1.0 / max(abs(after - before), 1e-300)
    cell = spacing * spacing / 12.0
    for i in range(n):
        x = (i + 0.5) * spacing
        gap = (x * x + cell) / radius
        depth, old_depth = max(after - gap, 0.0), max(before - gap, 0.0)
        share = 1.0 if min(depth, old_depth) > 0.0 else min((depth + old_depth) * per_rise, 1.0)
        x_old, y_old = w[i], w[n + i]
        x_try, y_try = x_old - share * slip_x, y_old - share * slip_y
        size, limit = math.sqrt(x_try * x_try + y_try * y_try), bound * depth
        back[i] = limit / max(size, limit, 1e-300)
        back[n + i] = size
        w[i], w[n + i] = back[i] * x_try, back[i] * y_try
        start = (x_old * x_try + y_old * y_try) / max(size, 1e-300)
        far, room = max(size - limit, 0.0), max(bound * old_depth - start, 0.0)
        # b_t is read off the spring: the limit before the step has no digits left for huge friction
        met = start + (size - start) * (room / max(room + far, 1e-300))
        back[2 * n + i] = 0.5 * (met + limit) * far
    heat = 0.0
    for i in range(n):
        heat += back[2 * n + i]
    return heat, (1.0 - back[0]) * back[n]


@kernel
def springs(c, load, p, h, w, w_new):
    """Force, energies and the new row of springs after a straight step from the overlap and the spacing in h."""
    before, spacing = h[0], h[1]
    n = len(w) // 2
    for i in range(2 * n):
        w_new[i] = w[i]
    scratch = np.empty(3 * n)
    if spacing == 0.0:
        spacing = FIRST * c.radius / n
    # Coulomb's limit uses the whole normal force, dashpot included
    bound = p.kappa * load.force / max(load.elastic, 1e-300)
    ground = fresh_ground(c.roll_x, c.roll_y, load.contact_radius, h[4], h[5], h[6])
    share = renewed(p.renewal * ground.way / max(load.contact_radius, 1e-300))
    slip_x, slip_y = share.fill * c.slip_x, share.fill * c.slip_y
    energy = 0.0
    if share.kept < 1.0:
        for i in range(2 * n):
            w_new[i] *= share.kept
    done, slip = before, 0.0
    end = (n * spacing) * (n * spacing) / c.radius
    while c.overlap > end:
        part = (end - done) / (c.overlap - before)
        heat, middle = segment(w_new, n, spacing, c.radius, done, end, part * slip_x, part * slip_y, bound, scratch)
        stored = p.g_star * spacing * squares(w_new)
        merge(w_new, n)
        energy += 2.0 * p.g_star * spacing * heat + stored - 2.0 * p.g_star * spacing * squares(w_new)
        spacing, done, slip = 2.0 * spacing, end, slip + middle
        end = (n * spacing) * (n * spacing) / c.radius
    part = (c.overlap - done) / (c.overlap - before) if done > before else 1.0
    heat, middle = segment(w_new, n, spacing, c.radius, done, c.overlap, part * slip_x, part * slip_y, bound, scratch)
    energy += 2.0 * p.g_star * spacing * heat
    if share.kept < 1.0:
        if spacing == h[1]:
            old = math.sqrt(max(before, 0.0) * c.radius) / spacing + 0.5
            energy += 2.0 * p.g_star * spacing * renewal_heat(w, w_new, n, scratch, (c.slip_x, c.slip_y, old), share)
        else:  # the grid is another one now
            energy += (1.0 - share.kept * share.kept) * p.g_star * h[1] * squares(w)
    x, y = 0.0, 0.0
    for i in range(n):
        x += w_new[i]
        y += w_new[n + i]
    stiffness = 2.0 * p.g_star * spacing
    stored = 0.5 * stiffness * squares(w_new)
    limit = p.mu * load.force
    x, y = stiffness * x, stiffness * y
    answer = Tangential(x, y, limit, p.kappa * c.overlap, slip + middle, stored, energy)
    return answer, (c.overlap, spacing, x, y, ground.x, ground.y, ground.reach)


@kernel
def springs_tangent(c, load, p, h, w):
    """Consistent tangent of one step, whatever happens within it: springs that stick, slip, touch or merge (`mdr_tangent`)."""
    spacing = h[1] if h[1] > 0.0 else FIRST * c.radius / (len(w) // 2)
    way = fresh_ground(c.roll_x, c.roll_y, load.contact_radius, h[4], h[5], h[6]).way
    return tangent_of_springs(c, load, p, (h[0], spacing, renewed(p.renewal * way / max(load.contact_radius, 1e-300))), w)


def mix_springs(pair: Pair, options: Options) -> SpringParameters:
    """G*, friction and kappa = mu E*/G* (Willert, Eqs. 13, 14)."""
    g = g_star(pair.a, pair.b)
    return SpringParameters(g, pair.friction, pair.friction * e_star(pair.a, pair.b) / g, renewal_rate(pair, options))


def width(options: Options) -> int:
    """Floats of the field: two per spring. Raises ValueError for a number of springs that does not come in pairs."""
    springs = options["springs"]
    if springs % 2.0 != 0.0:
        raise ValueError(f"springs = {springs:g} must be an even whole number: neighbours merge as the patch grows")
    return 2 * int(springs)


MDR = Law(
    name="mdr",
    stage="tangential",
    kernel=springs,
    tangent=springs_tangent,
    parameters=SpringParameters,
    mix=mix_springs,
    options=(Option("springs", "dimensionless", 32.0, low=4.0, high=512.0, doc="springs per contact, an even number"), RENEWAL),
    history=("overlap", "spacing", "force_x", "force_y", "offset_x", "offset_y", "reach"),
    field=width,
    rolls=True,
    source="Popov and Hess 2015; Willert, Self-consistency conditions in static three-body contact, Eqs. 11-13",
)
