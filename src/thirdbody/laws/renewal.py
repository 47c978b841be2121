"""Renewal: loss of tangential memory where a contact area rolls over fresh ground, and its rate.

Where a contact area moves over the surfaces, unloaded material enters at its leading edge, and loaded material leaves with the
force at the trailing edge. A row of springs w(x), the mean of both sides of the area, has halves that move to either edge. So it
is carried outward at a speed proportional to x: dw = -ds - (rate/a) d(x w)/dx dr, with the travel dr over fresh ground, the
contact radius a and the slip ds; in a step, w(x) -> retained w(retained x) - fill ds. The force lost is rate w(a) dr, the force
of the springs at the edge: for a field that vanishes there the loss is of second order in dr. A uniform field stays uniform and
decays, dw = -ds - rate w dr/a, and steady rolling leads to one. A law with a single spring has that field only.

Limits of the mean of both sides: a uniform field in reality loses half of this at first, and in a contact area that grows or
shrinks faster than it moves nothing is replaced, while the field here changes its shape, not its force, in first order of the
travel.

Ground is fresh where the contact area has not been. A contact stores the offset of the contact area from the middle of the known
ground, and its largest distance from there: only travel beyond counts, so a contact that sways by a nanometre stays on its ground
after the first sway, and one that rolls on renews all. Assumption for a reversal: known ground extends one contact radius from
its middle, which follows a contact area that rolls on. So a contact area that reverses must travel back by its own diameter
before it renews again; the edge that is then trailing carries least. The offset is the mean of those over the two surfaces.

Rate: steady rolling with the creep ds/dr = xi ends at T = 2 G* a^2 xi/rate. Kalker's linear theory of a circular contact has T =
G a^2 C11 xi (Kalker, Three-dimensional elastic bodies in rolling contact, 1990), so rate = 2 (G*/G)/C11: 0.59 at nu = 0, 0.55 at
0.25, 0.51 at 0.5. A spring of another stiffness k has T = k a xi/rate, so `coulomb` renews at k/(G a C11).
"""

import math
from collections import namedtuple
from dataclasses import replace

from thirdbody.laws.contract import Option, Options, Pair, kernel
from thirdbody.laws.hertz import g_star

RENEWAL = Option(
    "renewal", "dimensionless", "kalker", low=0.0, high=100.0, words=("kalker",), or_number=True,
    doc="rate at which a rolling contact renews its material, per contact radius of fresh travel; 'kalker': that of Kalker's"
    " creep coefficient C11; 0 keeps the history",
)  # fmt: skip

RENEWAL_OF_SPRINGS = replace(RENEWAL, default=0.0, doc=RENEWAL.doc + '; memory = "rescaled" has none')
"""The same for laws with one spring, zero unless the scene sets it: it costs every contact three more floats of history (88
bytes, more than one cache line) and an exponential; an explicit step of 16 000 spheres takes 1.9 to 2.3 times as long, of 2000
clumps twice."""

KALKER = ((0.0, 3.40), (0.25, 4.12), (0.5, 5.20))
"""Poisson's ratio and C11 of a circular contact (Kalker 1990, table of creepage coefficients)."""


def renewal_rate(pair: Pair, options: Options) -> float:
    """Renewal per contact radius of travel: value of the scene, or Kalker's for the mean shear compliance of both materials.

    Parameters
    ----------
    pair : Pair
        The two materials.
    options : mapping
        Options of the law, with `renewal`: "kalker" or a number.

    Returns
    -------
    float
    """
    given = options.get("renewal", RENEWAL.default)
    if given != "kalker":
        return float(given)
    soft = [1.0 / material.shear_modulus for material in (pair.a, pair.b)]
    compliance = 0.5 * (soft[0] + soft[1])
    nu = 0.5 * (soft[0] * pair.a.poisson_ratio + soft[1] * pair.b.poisson_ratio) / compliance
    softness = 0.0  # 1/C11, a compliance nearly linear in nu: the parabola through Kalker's values
    for x, c in KALKER:
        weight = 1.0
        for other, _ in KALKER:
            weight *= 1.0 if other == x else (nu - other) / (x - other)
        softness += weight / c
    return 2.0 * g_star(pair.a, pair.b) * compliance / (1.0 / softness)


Ground = namedtuple("Ground", "path x y reach")
"""Travel over fresh ground in the step [m]; offset from the middle of known ground [m]; largest distance from it [m]."""


@kernel
def moved_ground(roll_x, roll_y, radius, x, y, reach):
    """Return how much fresh ground a contact area meets as it moves on.

    Parameters
    ----------
    roll_x, roll_y : float
        Travel of the contact area in the step [m].
    radius : float
        Its radius [m].
    x, y : float
        Offset before the step from the middle of the ground that it knows, at most its radius [m].
    reach : float
        Largest offset so far: ground within it is not fresh [m].

    Returns
    -------
    Ground
    """
    x, y = x + roll_x, y + roll_y
    size = math.sqrt(x * x + y * y)
    back = min(size, radius) / max(size, 1e-300)
    return Ground(max(size - reach, 0.0), back * x, back * y, min(max(reach, size), radius))


class Renewal(namedtuple("Renewal", "retained fill mixed own")):
    """A step in which a fraction of a field is renewed: w = retained w_old - fill ds in a spring that sticks.

    A spring of unit stiffness then loses the energy (1 - retained^2) w_old^2/2 - mixed w_old . ds + own ds^2."""


@kernel
def renewed(exponent):
    """Return the renewal of a field over a step with a steady slip: dw/dt = -ds/dt - exponent w, exact for any length of step.

    Parameters
    ----------
    exponent : float
        Rate of renewal times the fresh ground of the step over the contact radius.

    Returns
    -------
    Renewal
    """
    if exponent < 1e-12:
        return Renewal(1.0, 1.0, 0.0, 0.0)
    lost = -math.expm1(-exponent)
    fill = lost / exponent
    own = exponent * (1.0 / 3.0 - 0.25 * exponent) if exponent < 1e-3 else (1.0 - fill) / exponent - 0.5 * fill * fill
    return Renewal(1.0 - lost, fill, fill * lost, own)


@kernel
def growth_of(load):
    """Relative growth of the contact radius with the overlap, (da/dd)/a [1/m]."""
    return 0.5 * load.squared_radius_rate / max(load.contact_radius * load.contact_radius, 1e-300)
