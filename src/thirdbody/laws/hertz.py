"""Hertz's normal contact, the effective moduli of two elastic half-spaces, and first yield under a contact.

Willert: E. Willert, Self-consistency conditions in static three-body elastic tangential contact; R_i for every contact.
Contacts are computed as elastic beyond first yield, too, unless the scene names `effects.elastic_plastic`.
"""

import math
from typing import NamedTuple

from thirdbody.laws.contract import Law, Material, kernel
from thirdbody.laws.data import Normal


def e_star(a: Material, b: Material) -> float:
    """Effective modulus of normal contact: 1/E* = (1 - nu_a)/(2 G_a) + (1 - nu_b)/(2 G_b) (Willert, Eq. 4).

    Parameters
    ----------
    a, b : Material
        The two bodies.

    Returns
    -------
    float
        E* [Pa].

    Examples
    --------
    >>> steel = plugin.Material("steel", shear_modulus=80e9, poisson_ratio=0.3, density=7850.0)
    >>> f"{plugin.e_star(steel, steel):.4e}"
    '1.1429e+11'
    """
    return 1.0 / ((1.0 - a.poisson_ratio) / (2.0 * a.shear_modulus) + (1.0 - b.poisson_ratio) / (2.0 * b.shear_modulus))


def g_star(a: Material, b: Material) -> float:
    """Effective modulus of tangential contact: 1/G* = (2 - nu_a)/(4 G_a) + (2 - nu_b)/(4 G_b) (Willert, Eq. 14).

    Parameters
    ----------
    a, b : Material
        The two bodies.

    Returns
    -------
    float
        G* [Pa], four times the G_eff of most DEM codes.
    """
    return 1.0 / ((2.0 - a.poisson_ratio) / (4.0 * a.shear_modulus) + (2.0 - b.poisson_ratio) / (4.0 * b.shear_modulus))


def dundurs_beta(a: Material, b: Material) -> float:
    """Dundurs' second parameter: zero if the pair is elastically similar, as Hertz-Mindlin assumes (Willert, Eq. 3).

    Parameters
    ----------
    a, b : Material
        The two bodies.

    Returns
    -------
    float
        beta = ((1-2 nu_a)/G_a - (1-2 nu_b)/G_b)/(2 (1-nu_a)/G_a + 2 (1-nu_b)/G_b) (Johnson 1985, Eq. 5.3).
    """
    x, y = (1.0 - 2.0 * a.poisson_ratio) / a.shear_modulus, (1.0 - 2.0 * b.poisson_ratio) / b.shear_modulus
    s, t = (2.0 - 2.0 * a.poisson_ratio) / a.shear_modulus, (2.0 - 2.0 * b.poisson_ratio) / b.shear_modulus
    return (x - y) / (s + t)


class HertzParameters(NamedTuple):
    """Effective modulus E* [Pa]."""

    e_star: float


@kernel
def hertz(c, p):
    """N = (4/3) E* sqrt(R) d^1.5, a = sqrt(R d), stored energy (2/5) N d, peak pressure 3 N/(2 pi a^2) = 2 E* d/(pi a)."""
    a = math.sqrt(c.radius * c.overlap)
    force = 4.0 / 3.0 * p.e_star * a * c.overlap
    pressure = p.e_star * (2.0 * c.overlap / (math.pi * max(a, 1e-300)))
    return Normal(force, a, 0.4 * force * c.overlap, 0.0, pressure, c.radius)


@kernel
def hertz_tangent(c, p):
    """dN/dd = 2 E* a [N/m]."""
    return 2.0 * p.e_star * math.sqrt(c.radius * c.overlap)


HERTZ = Law(
    "hertz", "normal", hertz, HertzParameters, lambda pair, options: HertzParameters(e_star(pair.a, pair.b)),
    "Hertz 1882; Willert, Self-consistency conditions in static three-body contact, Eq. 5", tangent=hertz_tangent,
)  # fmt: skip


FIRST_YIELD = 1.6
"""Peak pressure at first yield over the yield strength (K.L. Johnson, Contact Mechanics, 1985, Eq. 4.35; Poisson's ratio 0.3)."""

YIELD_STRAIN = 0.01
"""Assumed yield strength over Young's modulus if the scene gives none. M.F. Ashby (Materials Selection in Mechanical Design, 4th
ed. 2011, modulus-strength chart) has 0.001 to 0.01 for metals and about 0.01 and more for engineering polymers and, in
compression, ceramics: 0.01 is a hard metal, so a pressure above the assumed limit is above that of most metals too."""

ELASTOMER = 1e8
"""Young's modulus below which no yield strength is assumed [Pa]: elastomers (same chart) stay elastic to strains of 1 or more."""


class YieldLimit(NamedTuple):
    """Peak pressure [Pa] at first yield of a pair (infinite: never), the material that yields first, its yield strength [Pa], and
    whether that was assumed because the scene gives none."""

    pressure: float
    material: str
    strength: float
    assumed: bool


def yield_limit(a: Material, b: Material) -> YieldLimit:
    """Return the limit of the pair, that of the softer material: both bodies of a contact carry the same pressure.

    Parameters
    ----------
    a, b : Material
        The two materials. One without a yield strength is given E/100, the strength of a hard metal, unless it is an elastomer.

    Returns
    -------
    YieldLimit
    """
    limits = []
    for m in (a, b):
        young = 2.0 * m.shear_modulus * (1.0 + m.poisson_ratio)
        strength = m.yield_strength or (YIELD_STRAIN * young if young >= ELASTOMER else math.inf)
        limits.append(YieldLimit(FIRST_YIELD * strength, m.name, strength, not m.yield_strength))
    return min(limits, key=lambda limit: limit.pressure)


def yield_force(radius: float, modulus: float, pressure: float) -> float:
    """Return the force [N] at which a contact of this effective radius reaches a peak pressure: pi^3 R^2 p^3/(6 E*^2) (Hertz)."""
    return math.pi**3 * radius**2 * pressure**3 / (6.0 * modulus**2)


def yield_speed(modulus: float, pressure: float, density: float) -> float:
    """Return the speed [m/s] at which a ball that hits a plane reaches a peak pressure: pi^2/(2 sqrt(10)) sqrt(p^5/(E*^4 rho)),
    where half m V^2 is the elastic energy of Hertz' contact (Thornton and Ning 1998, Eq. 17, who round the factor to 1.56)."""
    return math.pi**2 / (2.0 * math.sqrt(10.0)) * math.sqrt(pressure**5 / (modulus**4 * density))
