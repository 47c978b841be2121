"""Mindlin's no-slip stiffness with Coulomb's limit, in the rescaled force form that never makes energy."""

from __future__ import annotations

import math
from typing import NamedTuple

from .contract import Law, Options, Pair, Tangential, kernel
from .elasticity import e_star, g_star
from .friction import friction_tangent


class MindlinParameters(NamedTuple):
    """Effective shear modulus (the paper's G*), Pa; friction; ratio of the moduli E*/G*."""

    g_star: float
    mu: float
    kappa: float  # mu E*/G*


@kernel
def mindlin(c, load, p, h):
    """T* = T min(1, a/a_old); T* -= 2 G* a ds; scaled back onto mu N; U = T^2/(4 G* a).

    Loss of contact area releases its share of the force and of the energy (Thornton and Randall 1988; Walton and Braun
    1986), which is why the stored force is rescaled: the stored displacement form makes energy (Elata and Berryman 1996).
    The spring belongs to the patch, not to the material under it: a spot that rolls on keeps its tangential force, where in
    truth fresh material enters the patch unloaded and the force dies within about two contact radii of travel.
    Dissipated: the energy that a change of area releases at fixed force or strain, and the work of the slip at the limit.
    """
    x_old, y_old, a_old = h
    a = load.contact_radius
    stiffness = 2.0 * p.g_star * a
    now, then = max(stiffness, 1e-150), max(2.0 * p.g_star * a_old, 1e-150)
    inverse = 1.0 / (now * then)  # one division for three
    compliance, old_compliance = inverse * then, inverse * now
    kept = min(stiffness * old_compliance, 1.0) if a < a_old else 1.0
    x_kept, y_kept = kept * x_old, kept * y_old
    x_try, y_try = x_kept - stiffness * c.slip_x, y_kept - stiffness * c.slip_y
    limit = p.mu * load.force
    size = math.sqrt(x_try * x_try + y_try * y_try)
    back = limit / max(size, max(limit, 1e-300))
    x, y = back * x_try, back * y_try
    slip = (1.0 - back) * size * compliance
    before = 0.5 * (x_old * x_old + y_old * y_old) * old_compliance
    loaded = 0.5 * (x_kept * x_kept + y_kept * y_kept) * compliance
    stored = 0.5 * (x * x + y * y) * compliance
    dissipated = before - loaded + back * size * slip
    return Tangential(x, y, limit, p.kappa * c.overlap, slip, stored, dissipated), (x, y, a)


@kernel
def mindlin_tangent(c, load, p, h):
    """Consistent tangent of one step: dT/d(slip) and dT/d(overlap), with the load's own stiffness in the limit."""
    x_old, y_old, a_old = h
    a = load.contact_radius
    a_rate = 0.5 * c.radius / max(a, 1e-300)
    stiffness = 2.0 * p.g_star * a
    kept = a / max(a, a_old, 1e-300)
    kept_rate = a_rate / a_old if a < a_old else 0.0
    x, y = kept * x_old - stiffness * c.slip_x, kept * y_old - stiffness * c.slip_y
    x_rate = kept_rate * x_old - 2.0 * p.g_star * a_rate * c.slip_x
    y_rate = kept_rate * y_old - 2.0 * p.g_star * a_rate * c.slip_y
    return friction_tangent(x, y, p.mu * load.force, p.mu * load.stiffness, stiffness, x_rate, y_rate)


def mix_mindlin(pair: Pair, _options: Options) -> MindlinParameters:
    """G*, friction and kappa = mu E*/G* (Willert, Eqs. 13, 14)."""
    g = g_star(pair.a, pair.b)
    return MindlinParameters(g, pair.friction, pair.friction * e_star(pair.a, pair.b) / g)


MINDLIN = Law(
    name="mindlin",
    stage="tangential",
    kernel=mindlin,
    tangent=mindlin_tangent,
    parameters=MindlinParameters,
    mix=mix_mindlin,
    history=("force_x", "force_y", "contact_radius"),
    source="Mindlin 1949; rescaled force form: Walton and Braun 1986, Thornton and Randall 1988",
)
