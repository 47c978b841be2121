"""Coulomb friction as an elastic-plastic spring with a given slip scale, so that a contact can stick."""

import math
from dataclasses import replace
from typing import NamedTuple

from thirdbody.laws.contract import Law, Option, Options, Pair, kernel
from thirdbody.laws.elasticity import g_star
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


class CoulombParameters(NamedTuple):
    """Friction; slip at the limit over the contact's radius of curvature; G* [Pa]; whether a non-uniform field is remembered."""

    mu: float
    slip_scale: float
    g_star: float
    retained_energy: float  # 1; 0: memory = "rescaled"


@kernel
def coulomb(c, load, p, h):
    """Spring limited to mu N with stiffness k = mu N/s_0, s_0 = slip_scale R.

    The history is T and the energy U (`stretched`). The spring is never stiffer than the elastic contact, 2 G* a: a stiffer one,
    at large mu N, would need a smaller time step than the impact of two bodies. As in `mindlin`, a falling stiffness releases the
    excess force and energy: no closed path creates energy; and a contact that rolls on keeps its tangential force. In
    `coulomb_rolling` it decays.
    """
    limit = p.mu * load.force
    stiffness = min(limit / (p.slip_scale * c.radius), 2.0 * p.g_star * load.contact_radius)
    t = stretched(c.slip_x, c.slip_y, h, stiffness, limit, p.retained_energy)
    rubs = 1.0 if p.mu > 0.0 else 0.0
    free = math.sqrt(c.slip_x * c.slip_x + c.slip_y * c.slip_y)
    slip, critical = rubs * t.slip + (1.0 - rubs) * free, limit / max(stiffness, 1e-300)
    return Tangential(t.x, t.y, limit, critical, slip, t.stored, t.dissipated), (t.x, t.y, t.stored)


@kernel
def coulomb_tangent(c, load, p, h):
    """Consistent tangent of one step: dT/d(slip) and dT/d(overlap)."""
    limit, limit_rate = p.mu * load.force, p.mu * load.stiffness
    stiffness, rate = limit / (p.slip_scale * c.radius), limit_rate / (p.slip_scale * c.radius)
    elastic = 2.0 * p.g_star * load.contact_radius
    if elastic < stiffness:
        stiffness, rate = elastic, p.g_star * load.squared_radius_rate / max(load.contact_radius, 1e-300)
    x, y, x_rate, y_rate = stretched_tangent(c.slip_x, c.slip_y, h, stiffness, rate)
    return friction_tangent(x, y, limit, limit_rate, stiffness, x_rate, y_rate)


class RollingCoulombParameters(NamedTuple):
    """Fields of `CoulombParameters`, and the renewal of a rolling contact area per contact radius of travel.

    Kalker's creep needs a rate in proportion to the stiffness of the spring: `of_stiffness` is that rate at 2 G* a. One of
    both is zero.
    """

    mu: float
    slip_scale: float
    g_star: float
    renewal: float
    of_stiffness: float


@kernel
def coulomb_rolling(c, load, p, h):
    """`coulomb` with renewal of the material where the contact area rolls over fresh ground (`thirdbody.laws.patch_renewal`)."""
    limit, a = p.mu * load.force, load.contact_radius
    stiffness = min(limit / (p.slip_scale * c.radius), 2.0 * p.g_star * a)
    ground = moved_ground(c.roll_x, c.roll_y, a, h[3], h[4], h[5])
    rate = p.renewal + p.of_stiffness * stiffness / max(2.0 * p.g_star * a, 1e-300)
    fraction = renewed(rate * ground.path / max(a, 1e-300))
    t = rolled(c.slip_x, c.slip_y, (h[0], h[1], h[2]), fraction, stiffness, limit)
    rubs = 1.0 if p.mu > 0.0 else 0.0
    free = math.sqrt(c.slip_x * c.slip_x + c.slip_y * c.slip_y)
    slip, critical = rubs * t.slip + (1.0 - rubs) * free, limit / max(stiffness, 1e-300)
    answer = Tangential(t.x, t.y, limit, critical, slip, t.stored, t.dissipated)
    return answer, (t.x, t.y, t.stored, ground.x, ground.y, ground.reach)


@kernel
def coulomb_rolling_tangent(c, load, p, h):
    """As `coulomb_tangent`, with the fraction of the slip that renewal leaves."""
    limit, limit_rate, a = p.mu * load.force, p.mu * load.stiffness, load.contact_radius
    stiffness, rate = limit / (p.slip_scale * c.radius), limit_rate / (p.slip_scale * c.radius)
    elastic = 2.0 * p.g_star * a
    if elastic < stiffness:
        stiffness, rate = elastic, p.g_star * load.squared_radius_rate / max(a, 1e-300)
    renewal, shrinks = p.renewal, growth_of(load)  # the renewal, and its relative decrease with the overlap
    if p.of_stiffness > 0.0:
        renewal = p.of_stiffness * stiffness / max(elastic, 1e-300)
        shrinks = 2.0 * shrinks - rate / max(stiffness, 1e-300)
    distance = moved_ground(c.roll_x, c.roll_y, a, h[3], h[4], h[5]).path
    fraction = renewed(renewal * distance / max(a, 1e-300))
    x, y, x_rate, y_rate = rolled_tangent(c.slip_x, c.slip_y, (h[0], h[1], h[2]), fraction, shrinks, stiffness, rate)
    return friction_tangent(x, y, limit, limit_rate, fraction.fill * stiffness, x_rate, y_rate)


def mix_coulomb(pair: Pair, options: Options) -> CoulombParameters:
    """Return friction of the pair, slip scale, G*, and the kind of memory."""
    return CoulombParameters(pair.friction, options["slip_scale"], g_star(pair.a, pair.b), retained_energy(options))


def mix_coulomb_rolling(pair: Pair, options: Options) -> RollingCoulombParameters:
    """As `mix_coulomb`, with the rate of renewal; zero for the rescaled force."""
    p, rate = mix_coulomb(pair, options), renewal_rate(pair, options)
    rates = (0.0, rate) if options["renewal"] == "kalker" else (rate, 0.0)
    return RollingCoulombParameters(p.mu, p.slip_scale, p.g_star, *(p.retained_energy * x for x in rates))


def renewing_coulomb(options: Options) -> Law | None:
    """Return the variant with renewal in rolling, where these options require it, or None."""
    return COULOMB_ROLLING if renews(options) else None


COULOMB = Law(
    name="coulomb",
    stage="tangential",
    kernel=coulomb,
    tangent=coulomb_tangent,
    parameters=CoulombParameters,
    mix=mix_coulomb,
    history=("force_x", "force_y", "energy"),
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
    variant=renewing_coulomb,
    source="Coulomb 1785, regularised as an elastic-plastic spring (Cundall and Strack 1979, stiffness following the load)",
)

COULOMB_ROLLING = replace(
    COULOMB,
    kernel=coulomb_rolling,
    tangent=coulomb_rolling_tangent,
    parameters=RollingCoulombParameters,
    mix=mix_coulomb_rolling,
    history=(*COULOMB.history, "offset_x", "offset_y", "reach"),
    rolls=True,
    variant=None,
)
