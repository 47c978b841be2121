"""Coulomb friction as an elastic-plastic spring with a named slip scale, so that a contact can stick."""

from __future__ import annotations

import math
from typing import NamedTuple

from .contract import Law, Option, Options, Pair, Tangential, kernel
from .friction import friction_tangent


class CoulombParameters(NamedTuple):
    """Friction, and the slip at which the limit is reached as a fraction of the contact's radius of curvature."""

    mu: float
    slip_scale: float


@kernel
def coulomb(c, load, p, h):
    """Spring of stiffness k = mu N/s_0, s_0 = slip_scale R, cut at mu N; the force is rescaled when N falls.

    The stiffness follows the load, so U = T^2/(2 k) and, as in `mindlin`, a falling load releases its share of force and
    energy: no closed path makes energy.
    """
    x_old, y_old, n_old = h
    s_0 = p.slip_scale * c.radius
    limit = p.mu * load.force
    stiffness = limit / s_0
    kept = load.force / max(max(load.force, n_old), 1e-300)
    x_kept, y_kept = kept * x_old, kept * y_old
    x_try, y_try = x_kept - stiffness * c.slip_x, y_kept - stiffness * c.slip_y
    size = math.sqrt(x_try * x_try + y_try * y_try)
    back = limit / max(size, max(limit, 1e-300))
    x, y = back * x_try, back * y_try
    compliance = 1.0 / max(stiffness, 1e-300)
    slides = 1.0 if p.mu > 0.0 else 0.0
    free = math.sqrt(c.slip_x * c.slip_x + c.slip_y * c.slip_y)
    slip = slides * (1.0 - back) * size * compliance + (1.0 - slides) * free
    before = 0.5 * (x_old * x_old + y_old * y_old) * s_0 / max(p.mu * n_old, 1e-300)
    loaded = 0.5 * (x_kept * x_kept + y_kept * y_kept) * compliance
    stored = 0.5 * (x * x + y * y) * compliance
    dissipated = before - loaded + back * size * slip
    return Tangential(x, y, limit, slides * s_0, slip, stored, dissipated), (x, y, load.force)


@kernel
def coulomb_tangent(c, load, p, h):
    """Consistent tangent of one step: dT/d(slip) and dT/d(overlap)."""
    x_old, y_old, n_old = h
    s_0 = p.slip_scale * c.radius
    limit = p.mu * load.force
    limit_rate = p.mu * load.stiffness
    stiffness = limit / s_0
    kept = load.force / max(max(load.force, n_old), 1e-300)
    kept_rate = load.stiffness / n_old if load.force < n_old else 0.0
    x, y = kept * x_old - stiffness * c.slip_x, kept * y_old - stiffness * c.slip_y
    x_rate = kept_rate * x_old - limit_rate / s_0 * c.slip_x
    y_rate = kept_rate * y_old - limit_rate / s_0 * c.slip_y
    return friction_tangent(x, y, limit, limit_rate, stiffness, x_rate, y_rate)


def mix_coulomb(pair: Pair, options: Options) -> CoulombParameters:
    """Friction of the pair and the scene's slip scale."""
    return CoulombParameters(pair.friction, options["slip_scale"])


COULOMB = Law(
    name="coulomb",
    stage="tangential",
    kernel=coulomb,
    tangent=coulomb_tangent,
    parameters=CoulombParameters,
    mix=mix_coulomb,
    history=("force_x", "force_y", "load"),
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
    source="Coulomb 1785, regularised as an elastic-plastic spring (Cundall and Strack 1979 with a load-following stiffness)",
)
