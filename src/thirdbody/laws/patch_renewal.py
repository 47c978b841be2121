"""How a rolling patch forgets: fresh ground under a patch, and the rate at which it renews the tangential field.

Where a patch moves over the surfaces, material that was never under it enters unloaded, and loaded material leaves with what the
trailing edge carries. A row of springs w(x), the mean of both sides of the patch, has a half that moves to either edge. So it is
carried outward at a speed that goes as x: dw = -ds - (rate/a) d(x w)/dx dr, with the way dr over fresh ground, the contact radius
a and the slip ds; in a step, w(x) -> kept w(kept x) - fill ds. The force lost is rate w(a) dr, what springs at the edge carry:
a field that falls to nothing there loses of second order in dr. A uniform field stays uniform and decays, dw = -ds - rate w dr/a,
and steady rolling ends at one. A law with one spring has that alone.

What the mean of both sides cannot tell: a uniform field loses half of this at first in truth, and a patch that grows or shrinks
faster than it moves has nothing replaced, while the field here changes its shape in first order of the way, not its force.

Ground is fresh where the patch has not been. A contact remembers the offset of the patch from the middle of the ground that it
knows, and how far from there it was: only way beyond counts, so a spot that sways by a nanometre stays on its ground after the
first sway, and one that rolls on renews all. What is assumed of a turn back: known ground reaches one contact radius from its
middle, which a patch that rolls on draws behind it. So a patch that turns back after a long way must go back by its own diameter,
when it has left the place where it turned, before it renews again. Until then the loss is small in truth too, as the edge that is
then behind carries least. The offset is the mean of those over the two surfaces.

Rate: steady rolling with the creep ds/dr = xi ends at T = 2 G* a^2 xi/rate. Kalker's linear theory of a round patch says
T = G a^2 C11 xi (Kalker, Three-dimensional elastic bodies in rolling contact, 1990), so rate = 2 (G*/G)/C11: 0.59 at nu = 0,
0.55 at 0.25, 0.51 at 0.5.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from thirdbody.laws.contract import Option, Options, Pair, kernel
from thirdbody.laws.elasticity import g_star

RENEWAL = Option(
    "renewal",
    "dimensionless",
    "kalker",
    low=0.0,
    high=100.0,
    words=("kalker",),
    or_number=True,
    doc="rate at which a rolling patch renews its material, per contact radius of way over fresh ground; 'kalker': the rate that"
    " gives Kalker's creep coefficient C11; 0 keeps the history in the patch",
)

RENEWAL_OF_SPRINGS = replace(RENEWAL, default=0.0, doc=RENEWAL.doc + '; memory = "rescaled" has none')
"""The same for laws with one spring, without renewal unless the scene names it. Every contact would pay for it with three more
floats of history (88 bytes, no longer one line of the cache) and an exponential: an explicit step of 16 000 spheres takes 1.9 to
2.3 times as long, of 2000 clumps twice."""

KALKER = ((0.0, 3.40), (0.25, 4.12), (0.5, 5.20))
"""Poisson's ratio and C11 of a round patch (Kalker 1990, table of creepage coefficients)."""


def creep_coefficient(nu: float) -> float:
    """Kalker's C11 of a round patch. Creep is a compliance, nearly linear in nu: 1/C11 is the parabola through his values."""
    total = 0.0
    for x, c in KALKER:
        weight = 1.0
        for other, _ in KALKER:
            weight *= 1.0 if other == x else (nu - other) / (x - other)
        total += weight / c
    return 1.0 / total


def renewal_rate(pair: Pair, options: Options) -> float:
    """Renewal per contact radius of way: the value of the scene, or Kalker's for the mean shear compliance of both materials."""
    given = options.get("renewal", RENEWAL.default)
    if given != "kalker":
        return float(given)
    soft = [1.0 / material.shear_modulus for material in (pair.a, pair.b)]
    compliance = 0.5 * (soft[0] + soft[1])
    nu = 0.5 * (soft[0] * pair.a.poisson_ratio + soft[1] * pair.b.poisson_ratio) / compliance
    return 2.0 * g_star(pair.a, pair.b) * compliance / creep_coefficient(nu)


class Ground(NamedTuple):
    """Way over fresh ground in the step, m; then the offset from the middle of known ground, and how far away the patch was."""

    way: float
    x: float
    y: float
    reach: float


@kernel
def fresh_ground(roll_x, roll_y, radius, x, y, reach):
    """`Ground` after the patch, of contact radius `radius`, went by (roll_x, roll_y) from the offset (x, y), m."""
    x, y = x + roll_x, y + roll_y
    size = math.sqrt(x * x + y * y)
    back = min(size, radius) / max(size, 1e-300)
    return Ground(max(size - reach, 0.0), back * x, back * y, min(max(reach, size), radius))


class Renewal(NamedTuple):
    """A step in which a share of a field is renewed: w = kept w_old - fill ds in a spring that sticks.

    What a spring of unit stiffness then loses is (1 - kept^2) w_old^2/2 - mixed w_old . ds + own ds^2.
    """

    kept: float
    fill: float
    mixed: float
    own: float


@kernel
def renewed(exponent):
    """`Renewal` of dw/dt = -ds/dt - exponent w over a step with a steady slip ds: exact for any length of the step."""
    if exponent < 1e-12:
        return Renewal(1.0, 1.0, 0.0, 0.0)
    lost = -math.expm1(-exponent)
    fill = lost / exponent
    own = exponent * (1.0 / 3.0 - 0.25 * exponent) if exponent < 1e-3 else (1.0 - fill) / exponent - 0.5 * fill * fill
    return Renewal(1.0 - lost, fill, fill * lost, own)
