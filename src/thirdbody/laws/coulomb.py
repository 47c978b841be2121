"""Coulomb friction as an elastic-plastic spring with a given slip scale, so that a contact can stick."""

from dataclasses import replace
from typing import NamedTuple

from thirdbody.laws.contract import Law, Option, Options, Pair, kernel
from thirdbody.laws.elasticity import g_star
from thirdbody.laws.patch_renewal import RENEWAL_OF_SPRINGS, growth_of, renewal_rate
from thirdbody.laws.radial_return import MEMORY, retained_energy
from thirdbody.laws.spring import Elastic, Renewing, with_forms


class CoulombParameters(NamedTuple):
    """Friction; slip at the limit over the contact's radius of curvature; G* [Pa]; whether a non-uniform field is remembered."""

    mu: float
    slip_scale: float
    g_star: float
    retained_energy: float  # 1; 0: memory = "rescaled"


class RollingCoulombParameters(NamedTuple):
    """Friction, slip scale, G*, and the renewal of a rolling contact area per contact radius of travel.

    Kalker's creep needs a rate in proportion to the stiffness of the spring: `of_stiffness` is that rate at 2 G* a. One of the
    two rates is zero.
    """

    mu: float
    slip_scale: float
    g_star: float
    renewal: float
    of_stiffness: float


@kernel
def spring_of_load(c, load, p):
    """Spring limited to mu N with stiffness k = mu N/s_0, s_0 = slip_scale R.

    The spring is never stiffer than the elastic contact, 2 G* a: a stiffer one, at large mu N, would need a smaller time step
    than the impact of two bodies. As in `mindlin`, a falling stiffness releases the excess force and energy: no closed path
    creates energy; and without renewal a contact that rolls on keeps its tangential force.
    """
    limit, limit_rate = p.mu * load.force, p.mu * load.stiffness
    stiffness, rate = limit / (p.slip_scale * c.radius), limit_rate / (p.slip_scale * c.radius)
    elastic = 2.0 * p.g_star * load.contact_radius
    if elastic < stiffness:
        stiffness, rate = elastic, p.g_star * load.squared_radius_rate / max(load.contact_radius, 1e-300)
    return Elastic(stiffness, rate, limit, limit_rate, limit / max(stiffness, 1e-300), p.mu > 0.0)


@kernel
def renewal_of_load(load, p, elastic):
    """Renewal at the rate of the scene, or Kalker's in proportion to the stiffness."""
    rate = p.renewal + p.of_stiffness * elastic.stiffness / max(2.0 * p.g_star * load.contact_radius, 1e-300)
    grows = growth_of(load)
    follows = 2.0 * grows - elastic.stiffness_rate / max(elastic.stiffness, 1e-300)
    return Renewing(rate, follows if p.of_stiffness > 0.0 else grows)


def mix_coulomb(pair: Pair, options: Options) -> CoulombParameters:
    """Return friction of the pair, slip scale, G*, and the kind of memory."""
    return CoulombParameters(pair.friction, options["slip_scale"], g_star(pair.a, pair.b), retained_energy(options))


def mix_coulomb_rolling(pair: Pair, options: Options) -> RollingCoulombParameters:
    """As `mix_coulomb`, with the rate of renewal; zero for the rescaled force."""
    p, rate = mix_coulomb(pair, options), renewal_rate(pair, options)
    rates = (0.0, rate) if options["renewal"] == "kalker" else (rate, 0.0)
    return RollingCoulombParameters(p.mu, p.slip_scale, p.g_star, *(p.retained_energy * x for x in rates))


_COULOMB = Law(
    name="coulomb",
    stage="tangential",
    kernel=spring_of_load,
    parameters=CoulombParameters,
    mix=mix_coulomb,
    options=(
        Option(
            "slip_scale",
            "dimensionless",
            1e-3,
            low=1e-9,
            high=1.0,
            doc="slip at which the friction limit is reached, as a fraction of the contact's radius of curvature",
        ),
        MEMORY,
        RENEWAL_OF_SPRINGS,
    ),
    source="Coulomb 1785, regularised as an elastic-plastic spring (Cundall and Strack 1979, stiffness following the load)",
)
_ROLLING = replace(_COULOMB, parameters=RollingCoulombParameters, mix=mix_coulomb_rolling)

COULOMB = with_forms(_COULOMB, spring_of_load, renewal_of_load, _ROLLING, globals())
