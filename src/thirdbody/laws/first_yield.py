"""Pressure at first yield of a pair of materials in contact.

Contacts are computed as elastic beyond it, too.
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


def _assumed_strength(material: Material) -> float:
    """Usual yield strength [Pa] of a material of this stiffness; infinite for an elastomer."""
    young = 2.0 * material.shear_modulus * (1.0 + material.poisson_ratio)
    return YIELD_STRAIN * young if young >= ELASTOMER else math.inf
