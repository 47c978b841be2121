"""Coulomb friction as an elastic-plastic spring with a named slip scale, so that a contact can stick."""

from __future__ import annotations

import math
from typing import NamedTuple

from .contract import Law, Option, Options, Pair, Tangential, kernel
from .elasticity import g_star
from .friction import friction_tangent


class CoulombParameters(NamedTuple):
    """Friction, slip at which the limit is reached over the contact's radius of curvature, effective shear modulus G*, Pa."""

    mu: float
    slip_scale: float
    g_star: float


@kernel
def coulomb(c, load, p, h):
    """Spring cut at mu N, stiffness k = mu N/s_0 with s_0 = slip_scale R; the force is rescaled when the stiffness falls.

    The spring is never stiffer than the elastic contact, 2 G* a: a stiffer one, at large mu N, would need a smaller time step
    than the impact of two bodies. U = T^2/(2 k), and, as in `mindlin`, a falling stiffness releases its share of force and
    energy: no closed path makes energy. As in `mindlin`, a spot that rolls on keeps its tangential force.
    """
    x_old, y_old, k_old = h
    limit = p.mu * load.force
    stiffness = min(limit / (p.slip_scale * c.radius), 2.0 * p.g_star * load.contact_radius)
    kept = stiffness / max(max(stiffness, k_old), 1e-300)
    x_kept, y_kept = kept * x_old, kept * y_old
    x_try, y_try = x_kept - stiffness * c.slip_x, y_kept - stiffness * c.slip_y
    size = math.sqrt(x_try * x_try + y_try * y_try)
    back = limit / max(size, max(limit, 1e-300))
    x, y = back * x_try, back * y_try
    compliance = 1.0 / max(stiffness, 1e-300)
    rubs = 1.0 if p.mu > 0.0 else 0.0
    free = math.sqrt(c.slip_x * c.slip_x + c.slip_y * c.slip_y)
    slip = rubs * (1.0 - back) * size * compliance + (1.0 - rubs) * free
    before = 0.5 * (x_old * x_old + y_old * y_old) / max(k_old, 1e-300)
    loaded = 0.5 * (x_kept * x_kept + y_kept * y_kept) * compliance
    stored = 0.5 * (x * x + y * y) * compliance
    dissipated = before - loaded + back * size * slip
    return Tangential(x, y, limit, limit * compliance, slip, stored, dissipated), (x, y, stiffness)


@kernel
def coulomb_tangent(c, load, p, h):
    """Consistent tangent of one step: dT/d(slip) and dT/d(overlap)."""
    x_old, y_old, k_old = h
    limit, limit_rate = p.mu * load.force, p.mu * load.stiffness
    stiffness, rate = limit / (p.slip_scale * c.radius), limit_rate / (p.slip_scale * c.radius)
    elastic = 2.0 * p.g_star * load.contact_radius
    if elastic < stiffness:
        stiffness, rate = elastic, p.g_star * c.radius / max(load.contact_radius, 1e-300)
    kept = stiffness / max(max(stiffness, k_old), 1e-300)
    kept_rate = rate / k_old if stiffness < k_old else 0.0
    x, y = kept * x_old - stiffness * c.slip_x, kept * y_old - stiffness * c.slip_y
    x_rate = kept_rate * x_old - rate * c.slip_x
    y_rate = kept_rate * y_old - rate * c.slip_y
    return friction_tangent(x, y, limit, limit_rate, stiffness, x_rate, y_rate)


def mix_coulomb(pair: Pair, options: Options) -> CoulombParameters:
    """Friction of the pair, the scene's slip scale, and G*."""
    return CoulombParameters(pair.friction, options["slip_scale"], g_star(pair.a, pair.b))


COULOMB = Law(
    name="coulomb",
    stage="tangential",
    kernel=coulomb,
    tangent=coulomb_tangent,
    parameters=CoulombParameters,
    mix=mix_coulomb,
    history=("force_x", "force_y", "stiffness"),
    options=(
        Option(
            "slip_scale",
            "dimensionless",
            1e-3,
            low=1e-9,
            high=1.0,
            doc="slip at which the friction limit is reached, as a fraction of the contact's radius of curvature",
        ),
    ),
    source="Coulomb 1785, regularised as an elastic-plastic spring (Cundall and Strack 1979, stiffness following the load)",
)
