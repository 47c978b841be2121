"""Pivoting friction: the moment of a contact area that opposes spin about its normal. Inactive unless a scene names it.

    [effects]
    pivoting = {}

Elastic half-spaces that turn against each other about the normal of their circular contact area transmit M = 16/3 G a^3 angle,
1/G = 1/G_i + 1/G_j, without slip (Mindlin 1949; Johnson 1985, section 3.9). Friction limits the moment: slip
everywhere under Hertz' pressure gives the integral of mu p r over the contact area, 3 pi/16 mu N a (Deresiewicz 1954). Here the
spring is elastic up to that limit; the annulus that slips below it, which softens a real contact on its way to the limit, is left
out. So is that slip and spin share one limit: a spot that slides as a whole pivots almost freely, and a spot that spins
slides more easily. The factor 3 pi/16 = 0.589 belongs to Hertz' pressure; a uniform one would give 2/3.
"""

import math
from typing import NamedTuple

from thirdbody.plugin import Law, Option, Options, Pair, Plugin, Twisting, kernel

TORSION = 16.0 / 3.0  # moment over G a^3 and angle of a half-space whose surface turns as a rigid disc (Reissner and Sagoci 1944)
FULL_SLIP = 3.0 * math.pi / 16.0  # moment of slip everywhere under Hertz' pressure over mu N a (Deresiewicz 1954)
INERTIA = 2.0 / 5.0  # moment of inertia of a ball about its centre over m R^2


class PivotingParameters(NamedTuple):
    """Torsional stiffness over a^3 [Pa]; limit over N a; viscosity over that of critical damping of a ball on a plane."""

    torsion: float
    limit: float
    ratio: float


@kernel
def pivoting(c, twist, load, p, h):
    """M -= 16/3 G a^3 d(angle), scaled back onto 3 pi/16 mu N a; the moment M and its energy U are the history. M and U give the
    stiffness M^2/(2 U) of the area that carries the moment: a contact area that has grown since takes nothing over, one that
    shrinks below it releases its fraction of moment and energy. So no closed path makes energy, and a cycle of the load releases
    once, not each time (as `mindlin` with its force)."""
    old, energy = h
    a = load.contact_radius
    limit = p.limit * load.force * a
    stiffness = max(p.torsion * a * a * a, 1e-150)
    saved = min(2.0 * stiffness * energy / max(old * old, 1e-150), 1.0)
    scaled = saved * old
    uniform = 0.5 * scaled * scaled / stiffness
    beyond = max(saved * energy - uniform, 0.0)
    moment = scaled - stiffness * twist.angle
    size = abs(moment)
    back = limit / max(size, max(limit, 1e-300))
    moment = back * moment
    turn = (1.0 - back) * size / stiffness
    left = back * back * beyond
    stored = 0.5 * moment * moment / stiffness + left
    viscosity = p.ratio * c.radius * math.sqrt(c.mass * stiffness)
    dissipated = energy - uniform - left + back * size * turn
    return Twisting(moment, limit, viscosity, turn, stored, dissipated), (moment, stored)


@kernel
def pivoting_tangent(c, twist, load, p, h):
    """Consistent tangent of one step: dM/d(angle) [N m/rad] and dM/dd [N]."""
    old, energy = h
    a = load.contact_radius
    growth = 0.5 * load.squared_radius_rate / max(a * a, 1e-300)  # (da/dd)/a
    stiffness = max(p.torsion * a * a * a, 1e-150)
    fraction = 2.0 * stiffness * energy / max(old * old, 1e-150)
    saved, rate = (1.0, 0.0) if fraction >= 1.0 else (fraction, 3.0 * growth * fraction)
    moment = saved * old - stiffness * twist.angle
    limit = p.limit * load.force * a
    if abs(moment) <= limit:
        return -stiffness, rate * old - 3.0 * growth * stiffness * twist.angle
    return 0.0, math.copysign(p.limit * a * (load.stiffness + load.force * growth), moment)


def mix_pivoting(pair: Pair, options: Options) -> PivotingParameters:
    """Return 16/3 G with both half-spaces in series, 3 pi/16 mu, and 2 zeta sqrt(2/5)."""
    modulus = 1.0 / (1.0 / pair.a.shear_modulus + 1.0 / pair.b.shear_modulus)
    return PivotingParameters(TORSION * modulus, FULL_SLIP * pair.friction, 2.0 * options["damping"] * math.sqrt(INERTIA))


PIVOTING = Law(
    name="pivoting",
    stage="twisting",
    kernel=pivoting,
    tangent=pivoting_tangent,
    parameters=PivotingParameters,
    mix=mix_pivoting,
    history=("moment", "energy"),
    options=(
        Option(
            "damping", "dimensionless", 0.0, low=0.0, high=10.0,
            doc="viscous moment over critical damping of a ball that spins on a plane",
        ),
    ),
    source="Mindlin 1949, J. Appl. Mech. 16, 259; Deresiewicz 1954, J. Appl. Mech. 21, 52; Johnson 1985, Contact Mechanics, 3.9",
)  # fmt: skip

PLUGIN = Plugin(name="pivoting", effects=(PIVOTING,), source="Mindlin 1949; Deresiewicz 1954")
