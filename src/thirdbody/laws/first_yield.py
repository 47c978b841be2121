"""First yield of a pair of materials in contact: pressure, force of a contact, speed of an impact.

Contacts are computed as elastic beyond it, too, unless the scene names `effects.elastic_plastic`.
"""

import math
from typing import NamedTuple

from thirdbody.laws.contract import Material

FIRST_YIELD = 1.6
"""Peak pressure at first yield over the yield strength (K.L. Johnson, Contact Mechanics, 1985, Eq. 4.35; Poisson's ratio 0.3)."""

YIELD_STRAIN = 0.01
"""Assumed yield strength over Young's modulus if the scene gives none. M.F. Ashby (Materials Selection in Mechanical Design, 4th
ed. 2011, modulus-strength chart) has 0.001 to 0.01 for metals and about 0.01 and more for engineering polymers and, in
compression, ceramics: 0.01 is a hard metal, so a pressure above the assumed limit is above that of most metals too."""

ELASTOMER = 1e8
"""Young's modulus below which no yield strength is assumed [Pa]: elastomers (same chart) stay elastic to strains of 1 and
more."""


class YieldLimit(NamedTuple):
    """Peak pressure at first yield of a pair.

    Pressure [Pa] (infinite if neither yields), the material that yields first, its yield strength [Pa], and whether that was
    assumed because the scene gives none.
    """

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
    limits = [YieldLimit(FIRST_YIELD * strength, m.name, strength, not m.yield_strength)
              for m in (a, b) for strength in (m.yield_strength or _assumed_strength(m),)]  # fmt: skip
    return min(limits, key=lambda limit: limit.pressure)


def yield_force(radius: float, modulus: float, pressure: float) -> float:
    """Return the force [N] at which a contact of this effective radius reaches a peak pressure: pi^3 R^2 p^3/(6 E*^2) (Hertz)."""
    return math.pi**3 * radius**2 * pressure**3 / (6.0 * modulus**2)


def yield_speed(modulus: float, pressure: float, density: float) -> float:
    """Return the speed [m/s] at which a ball that hits a plane reaches a peak pressure.

    V = pi^2/(2 sqrt(10)) sqrt(p^5/(E*^4 rho)): half m V^2 is the elastic energy of Hertz' contact at that pressure, (4/15) pi p
    a^4/R with a = pi R p/(2 E*) (Thornton and Ning 1998, Eq. 17, who round the factor to 1.56).
    """
    return math.pi**2 / (2.0 * math.sqrt(10.0)) * math.sqrt(pressure**5 / (modulus**4 * density))


def _assumed_strength(material: Material) -> float:
    """Usual yield strength [Pa] of a material of this stiffness; infinite for an elastomer."""
    young = 2.0 * material.shear_modulus * (1.0 + material.poisson_ratio)
    return YIELD_STRAIN * young if young >= ELASTOMER else math.inf
