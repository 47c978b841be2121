"""Mindlin's no-slip stiffness with Coulomb's limit; its memory does not decay under load cycles."""

from dataclasses import replace
from typing import NamedTuple

from thirdbody.laws.contract import Law, Options, Pair, kernel
from thirdbody.laws.elasticity import e_star, g_star
from thirdbody.laws.kernel_data import Tangential
from thirdbody.laws.patch_renewal import RENEWAL_OF_SPRINGS, moved_ground, renewal_rate, renewed
from thirdbody.laws.radial_return import (
    MEMORY,
    friction_tangent,
    growth_of,
    renews,
    retained_energy,
    rolled,
    rolled_tangent,
    stretched,
    stretched_tangent,
)


class MindlinParameters(NamedTuple):
    """Effective shear modulus G* [Pa]; friction; kappa; whether the energy of a non-uniform field is remembered."""

    g_star: float
    mu: float
    kappa: float  # mu E*/G*
    retained_energy: float  # 1; 0: memory = "rescaled"


@kernel
def mindlin(c, load, p, h):
    """T -= 2 G* a ds, scaled back onto mu N; T and the energy U are the history (`stretched`).

    A decrease of the contact area releases force and energy of the lost area (Thornton and Randall 1988; Walton and Braun 1986);
    a stored displacement instead would create energy (Elata and Berryman 1996). The spring belongs to the contact area, not to
    the material under it: a contact that rolls on keeps its tangential force. In `mindlin_rolling` it decays.
    """
    limit = p.mu * load.force
    t = stretched(c.slip_x, c.slip_y, h, 2.0 * p.g_star * load.contact_radius, limit, p.retained_energy)
    return Tangential(t.x, t.y, limit, p.kappa * c.overlap, t.slip, t.stored, t.dissipated), (t.x, t.y, t.stored)


@kernel
def mindlin_tangent(c, load, p, h):
    """Consistent tangent of one step: dT/d(slip) and dT/d(overlap), with the stiffness of the load in the limit."""
    a = load.contact_radius
    stiffness, rate = 2.0 * p.g_star * a, p.g_star * load.squared_radius_rate / max(a, 1e-300)
    x, y, x_rate, y_rate = stretched_tangent(c.slip_x, c.slip_y, h, stiffness, rate)
    return friction_tangent(x, y, p.mu * load.force, p.mu * load.stiffness, stiffness, x_rate, y_rate)


class RollingMindlinParameters(NamedTuple):
    """Fields of `MindlinParameters`, and the renewal of a rolling contact area per contact radius of travel."""

    g_star: float
    mu: float
    kappa: float
    renewal: float


@kernel
def mindlin_rolling(c, load, p, h):
    """`mindlin` with renewal of the contact area in rolling (`thirdbody.laws.patch_renewal`).

    In reality unstressed material enters the contact, and the force decays over about two contact radii of travel.
    """
    limit, a = p.mu * load.force, load.contact_radius
    ground = moved_ground(c.roll_x, c.roll_y, a, h[3], h[4], h[5])
    fraction = renewed(p.renewal * ground.path / max(a, 1e-300))
    t = rolled(c.slip_x, c.slip_y, (h[0], h[1], h[2]), fraction, 2.0 * p.g_star * a, limit)
    answer = Tangential(t.x, t.y, limit, p.kappa * c.overlap, t.slip, t.stored, t.dissipated)
    return answer, (t.x, t.y, t.stored, ground.x, ground.y, ground.reach)


@kernel
def mindlin_rolling_tangent(c, load, p, h):
    """As `mindlin_tangent`, with the fraction of the slip that renewal leaves."""
    a = load.contact_radius
    stiffness, rate = 2.0 * p.g_star * a, p.g_star * load.squared_radius_rate / max(a, 1e-300)
    distance = moved_ground(c.roll_x, c.roll_y, a, h[3], h[4], h[5]).path
    fraction = renewed(p.renewal * distance / max(a, 1e-300))
    x, y, x_rate, y_rate = rolled_tangent(c.slip_x, c.slip_y, (h[0], h[1], h[2]), fraction, growth_of(load), stiffness, rate)
    return friction_tangent(x, y, p.mu * load.force, p.mu * load.stiffness, fraction.fill * stiffness, x_rate, y_rate)


def mix_mindlin(pair: Pair, options: Options) -> MindlinParameters:
    """Return G*, friction, kappa = mu E*/G* (Willert, Eqs. 13, 14), and the kind of memory."""
    g = g_star(pair.a, pair.b)
    return MindlinParameters(g, pair.friction, pair.friction * e_star(pair.a, pair.b) / g, retained_energy(options))


def mix_mindlin_rolling(pair: Pair, options: Options) -> RollingMindlinParameters:
    """As `mix_mindlin`, with the rate of renewal; zero for the rescaled force."""
    p = mix_mindlin(pair, options)
    return RollingMindlinParameters(p.g_star, p.mu, p.kappa, p.retained_energy * renewal_rate(pair, options))


def renewing_mindlin(options: Options) -> Law | None:
    """Return the variant with renewal in rolling, where these options require it, or None."""
    return MINDLIN_ROLLING if renews(options) else None


MINDLIN = Law(
    name="mindlin",
    stage="tangential",
    kernel=mindlin,
    tangent=mindlin_tangent,
    parameters=MindlinParameters,
    mix=mix_mindlin,
    history=("force_x", "force_y", "energy"),
    options=(MEMORY, RENEWAL_OF_SPRINGS),
    variant=renewing_mindlin,
    source="Mindlin 1949; loss of area: Walton and Braun 1986, Thornton and Randall 1988; memory: thirdbody.laws.radial_return",
)

MINDLIN_ROLLING = replace(
    MINDLIN,
    kernel=mindlin_rolling,
    tangent=mindlin_rolling_tangent,
    parameters=RollingMindlinParameters,
    mix=mix_mindlin_rolling,
    history=(*MINDLIN.history, "offset_x", "offset_y", "reach"),
    rolls=True,
    variant=None,
)
