"""Plastic flow of contacts that yield: the elastic, perfectly plastic sphere of Thornton and Ning, in place of Hertz's law.

    [effects.elastic_plastic]
    yield_ratio = 1.6

With the yield pressure p_y (`yield_ratio` times the yield strength of the softer material) a contact area of radius a and a
sphere of radius R, all in one contact:

* Hertz up to the peak pressure p_y: a_y = pi R p_y/(2 E*), d_y = a_y^2/R, N_y = (2/3) pi p_y a_y^2.
* Plastic flow beyond: the pressure is cut off at p_y, so dN/dd = pi p_y R, and a^2 = R d still.
* Unloading from the largest overlap m, where the force is N_m and the contact radius a_m: Hertz with the flattened radius R_p =
  4 E* a_m^3/(3 N_m) and the permanent indentation d_p = m - a_m^2/R_p, so force and contact radius are continuous. Reloading is
  elastic up to m. (Thornton and Ning 1998, Eqs. 10 to 17; R_p from their Eq. 13 with the radius of equal contact area.)

Stored is (2/5) N (d - d_p). Dissipated is the work of loading less what a contact stores at m, W(m) - (2/5) N_m (m - d_p(m)), a
function of m alone that grows with m: exact for steps of any length, and never negative. What a spot remembers, its rebound and
its limits: README.md of the plug-ins, "Plastic flow".
"""

import math
from typing import NamedTuple

from thirdbody.plugin import Law, Normal, Option, Options, Pair, Plugin, e_star, kernel, yield_limit

NEVER = 1e6  # yield pressure over E* of materials that do not yield: beyond any pressure of a contact, and finite


class YieldParameters(NamedTuple):
    """Effective modulus E* [Pa]; yield pressure p_y [Pa]; overlap at first yield over the effective radius."""

    e_star: float
    yield_pressure: float
    yield_overlap: float


class Dent(NamedTuple):
    """Unloaded state of a spot.

    Flattened radius of curvature [m], permanent indentation [m], energy dissipated since the contact closed [J].
    """

    radius: float
    depth: float
    dissipated: float


@kernel
def dent_of(m, radius, p):
    """Return the dent that the largest overlap m leaves in a contact of this effective radius (formulas: head of the module)."""
    first = p.yield_overlap * radius
    more = max(m - first, 0.0)
    rate = math.pi * p.yield_pressure * radius
    at_yield = 2.0 / 3.0 * rate * first
    force = at_yield + rate * more
    # in ratios to first yield, so that m = d_y gives R_p = R and no dent without round-off
    flat = math.sqrt(m / first) * (m / first) / (1.0 + 1.5 * more / first) if more > 0.0 else 1.0
    elastic = m / flat
    work = 0.4 * at_yield * first + (at_yield + 0.5 * rate * more) * more
    heat = max(work - 0.4 * force * elastic, 0.0) if more > 0.0 else 0.0
    return Dent(radius * flat, m - elastic if more > 0.0 else 0.0, heat)


@kernel
def elastic_plastic(c, p, h):
    """N = (4/3) E* a^3/R_p with a^2 = R_p (d - d_p), at the largest overlap so far: h = (m, energy dissipated)."""
    m = max(c.overlap, h[0])
    dent = dent_of(m, c.radius, p)
    depth = max(c.overlap - dent.depth, 0.0)
    a = math.sqrt(dent.radius * depth)
    force = 4.0 / 3.0 * p.e_star * a * depth
    pressure = min(p.e_star * (2.0 * depth / (math.pi * max(a, 1e-300))), p.yield_pressure)
    flows = c.overlap > h[0] and c.overlap > p.yield_overlap * c.radius
    rate = c.radius if flows else (dent.radius if depth > 0.0 else 0.0)
    heat = max(dent.dissipated, h[1])
    return Normal(force, a, 0.4 * force * depth, heat - h[1], pressure, rate), (m, heat)


@kernel
def elastic_plastic_tangent(c, p, h):
    """dN/dd [N/m]: pi p_y R where the spot flows, else 2 E* a."""
    if c.overlap > h[0] and c.overlap > p.yield_overlap * c.radius:
        return math.pi * p.yield_pressure * c.radius
    dent = dent_of(max(c.overlap, h[0]), c.radius, p)
    return 2.0 * p.e_star * math.sqrt(dent.radius * max(c.overlap - dent.depth, 0.0))


def mix_elastic_plastic(pair: Pair, options: Options) -> YieldParameters:
    """Return E*, p_y and d_y/R = (pi p_y/(2 E*))^2 of a pair; the softer of the two materials yields."""
    modulus = e_star(pair.a, pair.b)
    pressure = min(options["yield_ratio"] * yield_limit(pair.a, pair.b).strength, NEVER * modulus)
    return YieldParameters(modulus, pressure, (math.pi * pressure / (2.0 * modulus)) ** 2)


ELASTIC_PLASTIC = Law(
    name="elastic_plastic",
    stage="normal",
    replaces="hertz",
    kernel=elastic_plastic,
    tangent=elastic_plastic_tangent,
    parameters=YieldParameters,
    mix=mix_elastic_plastic,
    history=("largest_overlap", "plastic_work"),
    options=(
        Option(
            "yield_ratio", "dimensionless", 1.6, low=1.0, high=10.0,
            doc="yield pressure over yield strength of the softer material: 1.6 at first yield, 2.8 fully plastic",
        ),
    ),
    source="Thornton and Ning 1998, Powder Technology 99, 154; Thornton 1997, J. Appl. Mech. 64, 383",
)  # fmt: skip

PLUGIN = Plugin(name="elastic_plastic", effects=(ELASTIC_PLASTIC,), source="Thornton and Ning 1998")
