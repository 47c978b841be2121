"""Coulomb friction as an elastic-plastic spring with a named slip scale, so that a contact can stick."""

from __future__ import annotations

import math
from typing import NamedTuple

from .contract import Law, Option, Options, Pair, Tangential, kernel
from .elasticity import g_star
from .friction import MEMORY, friction_tangent, keeps, stretched, stretched_tangent


class CoulombParameters(NamedTuple):
    """Friction; slip at which the limit is reached over the contact's radius of curvature; effective shear modulus G*, Pa; what
    is kept of a non-uniform field."""

    mu: float
    slip_scale: float
    g_star: float
    keeps: float  # 1; 0: memory = "rescaled"


@kernel
def coulomb(c, load, p, h):
    """Spring cut at mu N, stiffness k = mu N/s_0 with s_0 = slip_scale R; T and the energy U are remembered (`stretched`).

    The spring is never stiffer than the elastic contact, 2 G* a: a stiffer one, at large mu N, would need a smaller time step
    than the impact of two bodies. As in `mindlin`, a falling stiffness releases force and energy that no longer fit: no closed
    path makes energy; and a spot that rolls on keeps its tangential force.
    """
    limit = p.mu * load.force
    stiffness = min(limit / (p.slip_scale * c.radius), 2.0 * p.g_star * load.contact_radius)
    t = stretched(c.slip_x, c.slip_y, h, stiffness, limit, p.keeps)
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
        stiffness, rate = elastic, p.g_star * c.radius / max(load.contact_radius, 1e-300)
    x, y, x_rate, y_rate = stretched_tangent(c.slip_x, c.slip_y, h, stiffness, rate)
    return friction_tangent(x, y, limit, limit_rate, stiffness, x_rate, y_rate)


def mix_coulomb(pair: Pair, options: Options) -> CoulombParameters:
    """Friction of the pair, the scene's slip scale, G*, and the scene's memory."""
    return CoulombParameters(pair.friction, options["slip_scale"], g_star(pair.a, pair.b), keeps(options))


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
    ),
    source="Coulomb 1785, regularised as an elastic-plastic spring (Cundall and Strack 1979, stiffness following the load)",
)
