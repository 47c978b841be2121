"""A second normal law under the laws that are tested: a blunt cone, whose contact radius grows as the overlap.

A law that takes the contact area from the normal law (`Load`) is right under any of them; one that assumes a sphere is not.
"""

import math

from thirdbody.laws.contract import Law, kernel
from thirdbody.laws.data import Normal
from thirdbody.laws.hertz import HertzParameters, mix_hertz

SLOPE = 20.0
"""Contact radius over overlap."""


@kernel
def cone(c, p):
    """N = E* a d with a = SLOPE d, stored energy N d/3 (Sneddon 1965); pressure: the mean one, as that of the tip is infinite."""
    a = SLOPE * c.overlap
    force = p.e_star * a * c.overlap
    return Normal(force, a, force * c.overlap / 3.0, 0.0, p.e_star / (math.pi * SLOPE), 2.0 * SLOPE * a)


@kernel
def cone_tangent(c, p):
    """dN/dd = 2 E* a [N/m]."""
    return 2.0 * p.e_star * SLOPE * c.overlap


CONE = Law(
    name="cone",
    stage="normal",
    kernel=cone,
    tangent=cone_tangent,
    parameters=HertzParameters,
    mix=mix_hertz,
    source="Sneddon 1965, International Journal of Engineering Science 3, 47",
)
