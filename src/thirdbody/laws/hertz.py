"""Hertz's normal contact (Willert, Eq. 5, with R_i for every contact)."""

import math
from typing import NamedTuple

from thirdbody.laws.contract import Law, Options, Pair, kernel
from thirdbody.laws.elasticity import e_star
from thirdbody.laws.kernel_data import Normal


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


def mix_hertz(pair: Pair, _options: Options) -> HertzParameters:
    """Return E* of the pair."""
    return HertzParameters(e_star(pair.a, pair.b))


HERTZ = Law(
    name="hertz",
    stage="normal",
    kernel=hertz,
    tangent=hertz_tangent,
    parameters=HertzParameters,
    mix=mix_hertz,
    source="Hertz 1882; Willert, Self-consistency conditions in static three-body contact, Eq. 5",
)
