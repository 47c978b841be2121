"""Mindlin's no-slip stiffness with Coulomb's limit; its memory does not decay under load cycles."""

from dataclasses import replace
from typing import NamedTuple

from thirdbody.laws.contract import Law, Options, Pair, kernel
from thirdbody.laws.elasticity import e_star, g_star
from thirdbody.laws.patch_renewal import RENEWAL_OF_SPRINGS, growth_of, renewal_rate
from thirdbody.laws.radial_return import MEMORY, retained_energy
from thirdbody.laws.spring import Elastic, Renewing, with_forms


class MindlinParameters(NamedTuple):
    """Effective shear modulus G* [Pa]; friction; kappa; whether the energy of a non-uniform field is remembered."""

    g_star: float
    mu: float
    kappa: float  # mu E*/G*
    retained_energy: float  # 1; 0: memory = "rescaled"


class RollingMindlinParameters(NamedTuple):
    """G*, friction and kappa, and the renewal of a rolling contact area per contact radius of travel."""

    g_star: float
    mu: float
    kappa: float
    renewal: float


@kernel
def spring_of_area(c, load, p):
    """T -= 2 G* a ds, scaled back onto mu N; T and the energy U are the history (`thirdbody.laws.radial_return`).

    A decrease of the contact area releases force and energy of the lost area (Thornton and Randall 1988; Walton and Braun 1986);
    a stored displacement instead would create energy (Elata and Berryman 1996). The spring belongs to the contact area, not to
    the material under it: without renewal a contact that rolls on keeps its tangential force. In reality unstressed material
    enters the contact, and the force decays over about two contact radii of travel.
    """
    a = load.contact_radius
    rate = p.g_star * load.squared_radius_rate / max(a, 1e-300)
    return Elastic(2.0 * p.g_star * a, rate, p.mu * load.force, p.mu * load.stiffness, p.kappa * c.overlap, True)


@kernel
def renewal_of_area(load, p, _elastic):
    """Renewal at the rate of the scene, or Kalker's, which is in proportion to the stiffness 2 G* a."""
    return Renewing(p.renewal, growth_of(load))


def mix_mindlin(pair: Pair, options: Options) -> MindlinParameters:
    """Return G*, friction, kappa = mu E*/G* (Willert, Eqs. 13, 14), and the kind of memory."""
    g = g_star(pair.a, pair.b)
    return MindlinParameters(g, pair.friction, pair.friction * e_star(pair.a, pair.b) / g, retained_energy(options))


def mix_mindlin_rolling(pair: Pair, options: Options) -> RollingMindlinParameters:
    """As `mix_mindlin`, with the rate of renewal; zero for the rescaled force."""
    p = mix_mindlin(pair, options)
    return RollingMindlinParameters(p.g_star, p.mu, p.kappa, p.retained_energy * renewal_rate(pair, options))


_MINDLIN = Law(
    name="mindlin",
    stage="tangential",
    kernel=spring_of_area,
    parameters=MindlinParameters,
    mix=mix_mindlin,
    options=(MEMORY, RENEWAL_OF_SPRINGS),
    source="Mindlin 1949; loss of area: Walton and Braun 1986, Thornton and Randall 1988; memory: thirdbody.laws.radial_return",
)
_ROLLING = replace(_MINDLIN, parameters=RollingMindlinParameters, mix=mix_mindlin_rolling)

MINDLIN = with_forms(_MINDLIN, spring_of_area, renewal_of_area, _ROLLING, globals())
