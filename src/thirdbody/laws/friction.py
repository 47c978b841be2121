"""Tangential laws with one spring and Coulomb's limit: `coulomb` with a given slip scale, `mindlin` with the no-slip stiffness.

A law brings its stiffness, limit and renewal; here they are joined with a memory (`memory`), and with the renewal of a rolling
contact area (`renewal`) where a scene requires it. Each combination is a law of its own: a scene pays for no number that it does
not need.
"""

import math
from collections import namedtuple
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

from thirdbody.laws.contract import Law, Option, Options, Pair, kernel
from thirdbody.laws.data import Tangential
from thirdbody.laws.hertz import e_star, g_star
from thirdbody.laws.memory import MEMORIES, MEMORY, Memory, friction_tangent, renewed_spring, retained_energy
from thirdbody.laws.renewal import RENEWAL_OF_SPRINGS, growth_of, moved_ground, renewal_rate, renewed

Elastic = namedtuple("Elastic", "stiffness stiffness_rate limit limit_rate critical rubs")
"""Spring of a law under its load: stiffness [N/m] and its rate with the overlap [N/m2]; limit [N] and rate [N/m]; slip of first
sliding [m]; whether there is friction at all."""

Renewing = namedtuple("Renewing", "rate falls")
"""Renewal of a rolling contact area per contact radius of travel, and its relative decrease with the overlap [1/m]."""

GROUND = ("offset_x", "offset_y", "reach")


def kernels_of(elastic: Callable, renewing: Callable, memory: Memory, rolls: bool) -> tuple[Callable, Callable]:
    """Return kernel and tangent of a law with this spring. `rolls`: a rolling contact area is renewed, as `renewing` says."""
    step, remaining, scaled = memory.step, memory.remaining, memory.scaled

    def law(c, load, p, h):
        e, a = elastic(c, load, p), load.contact_radius
        if rolls:
            ground = moved_ground(c.roll_x, c.roll_y, a, h[-3], h[-2], h[-1])
            fraction = renewed(renewing(load, p, e).rate * ground.path / max(a, 1e-300))
            old = h[:-3]
            fill_x, fill_y = fraction.fill * c.slip_x, fraction.fill * c.slip_y
            stuck, own = step(fill_x, fill_y, scaled(old, fraction.retained), e.stiffness, e.limit, 1.0)
            t = renewed_spring(stuck, remaining(old, e.stiffness, 0.0), old[2], c.slip_x, c.slip_y, fraction, e.stiffness)
            new = own + (ground.x, ground.y, ground.reach)
        else:
            t, new = step(c.slip_x, c.slip_y, h, e.stiffness, e.limit, p.retained_energy)
        slip = t.slip if e.rubs else math.sqrt(c.slip_x * c.slip_x + c.slip_y * c.slip_y)
        return Tangential(t.x, t.y, e.limit, e.critical, slip, t.stored, t.dissipated), new

    def tangent(c, load, p, h):
        e, a = elastic(c, load, p), load.contact_radius
        if not rolls:
            k = remaining(h, e.stiffness, e.stiffness_rate)
            x, y = k.x - e.stiffness * c.slip_x, k.y - e.stiffness * c.slip_y
            x_rate, y_rate = k.x_rate - e.stiffness_rate * c.slip_x, k.y_rate - e.stiffness_rate * c.slip_y
            return friction_tangent(x, y, e.limit, e.limit_rate, e.stiffness, x_rate, y_rate)
        renewal = renewing(load, p, e)
        distance = moved_ground(c.roll_x, c.roll_y, a, h[-3], h[-2], h[-1]).path
        fraction = renewed(renewal.rate * distance / max(a, 1e-300))
        fill_x, fill_y = fraction.fill * c.slip_x, fraction.fill * c.slip_y
        k = remaining(scaled(h[:-3], fraction.retained), e.stiffness, e.stiffness_rate)
        x, y = k.x - e.stiffness * fill_x, k.y - e.stiffness * fill_y
        x_rate, y_rate = k.x_rate - e.stiffness_rate * fill_x, k.y_rate - e.stiffness_rate * fill_y
        grows = renewal.falls * (1.0 - fraction.retained) / fraction.fill
        moved = e.stiffness * (grows * fraction.fill - renewal.falls * (fraction.fill - fraction.retained))
        x_rate, y_rate = x_rate + grows * x + moved * c.slip_x, y_rate + grows * y + moved * c.slip_y
        return friction_tangent(x, y, e.limit, e.limit_rate, fraction.fill * e.stiffness, x_rate, y_rate)

    return law, tangent


def with_forms(law: Law, elastic: Callable, renewing: Callable, rolling: Law, space: dict[str, Any]) -> Law:
    """Return the law with its kernels, and with a variant for each number of closed rings, with and without renewal (`rolling`).
    Their kernels, which generated modules import by name, are put into the module with the namespace `space`."""
    forms: dict[tuple[int, bool], Law] = {}
    for (count, memory), rolls in product(enumerate(MEMORIES), (False, True)):
        functions = kernels_of(elastic, renewing, memory, rolls)
        name = law.name + ("", "_one_ring", "_two_rings")[count] + "_rolling" * rolls
        for function, own in zip(functions, (name, f"{name}_tangent"), strict=True):
            function.__name__ = function.__qualname__ = own
            function.__module__ = space["__name__"]
            space[own] = kernel(function)
        own_kernels = {"kernel": space[name], "tangent": space[f"{name}_tangent"]}
        history = memory.history + GROUND * rolls
        forms[count, rolls] = replace(rolling if rolls else law, **own_kernels, history=history, rolls=rolls, variant=None)

    def variant(options: Options) -> Law | None:
        count = {"one_ring": 1, "two_rings": 2}.get(str(options.get("memory", MEMORY.default)), 0)  # `assembly` resolves "auto"
        # renewal where the scene requires it, and not with the rescaled force
        key = count, retained_energy(options) > 0.0 and options.get("renewal", 0.0) != 0.0
        return forms[key] if key != (0, False) else None

    return replace(forms[0, False], variant=variant)


def _rate(pair: Pair, options: Options) -> float:  # of renewal; zero for the rescaled force
    return retained_energy(options) * renewal_rate(pair, options)


class CoulombParameters(NamedTuple):
    """Friction; slip at the limit over the contact's radius of curvature; G* [Pa]; whether a non-uniform field is remembered."""

    mu: float
    slip_scale: float
    g_star: float
    retained_energy: float  # 1; 0: memory = "rescaled"


class RollingCoulombParameters(NamedTuple):
    """Friction, slip scale, G*, and the renewal of a rolling contact area per contact radius of travel, or that at 2 G* a:
    Kalker's creep needs a rate in proportion to the stiffness of the spring. One of the two rates is zero."""

    mu: float
    slip_scale: float
    g_star: float
    renewal: float
    of_stiffness: float


@kernel
def spring_of_load(c, load, p):
    """Spring limited to mu N with stiffness k = mu N/s_0, s_0 = slip_scale R, at most that of the elastic contact, 2 G* a: a
    stiffer one would need a smaller time step than the impact of two bodies. As in `mindlin`, a falling stiffness releases the
    excess force and energy, and without renewal a contact that rolls on keeps its tangential force."""
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
    return CoulombParameters(pair.friction, options["slip_scale"], g_star(pair.a, pair.b), retained_energy(options))


_COULOMB = Law(
    "coulomb", "tangential", spring_of_load, CoulombParameters, mix_coulomb,
    "Coulomb 1785, regularised as an elastic-plastic spring (Cundall and Strack 1979, stiffness following the load)",
    (Option(
        "slip_scale", "dimensionless", 1e-3, low=1e-9, high=1.0,
        doc="slip at the friction limit over the contact's radius of curvature",
    ), MEMORY, RENEWAL_OF_SPRINGS),
)  # fmt: skip
_ROLLING = replace(
    _COULOMB, parameters=RollingCoulombParameters,
    mix=lambda pair, options: RollingCoulombParameters(
        *mix_coulomb(pair, options)[:3],
        *((0.0, _rate(pair, options)) if options["renewal"] == "kalker" else (_rate(pair, options), 0.0)),
    ),
)  # fmt: skip
COULOMB = with_forms(_COULOMB, spring_of_load, renewal_of_load, _ROLLING, globals())


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
    """T -= 2 G* a ds, scaled back onto mu N; T and the energy U are the history (`thirdbody.laws.memory`). A decrease of the
    contact area releases force and energy of the lost area (Thornton and Randall 1988; Walton and Braun 1986); a stored
    displacement instead would create energy (Elata and Berryman 1996). The spring belongs to the contact area, not to the
    material under it: without renewal a contact that rolls on keeps its tangential force. In reality unstressed material enters
    the contact, and the force decays over about two contact radii of travel."""
    a = load.contact_radius
    rate = p.g_star * load.squared_radius_rate / max(a, 1e-300)
    return Elastic(2.0 * p.g_star * a, rate, p.mu * load.force, p.mu * load.stiffness, p.kappa * c.overlap, True)


@kernel
def renewal_of_area(load, p, _elastic):
    """Renewal at the rate of the scene, or Kalker's, which is in proportion to the stiffness 2 G* a."""
    return Renewing(p.renewal, growth_of(load))


def mix_mindlin(pair: Pair, options: Options) -> MindlinParameters:
    g = g_star(pair.a, pair.b)
    return MindlinParameters(g, pair.friction, pair.friction * e_star(pair.a, pair.b) / g, retained_energy(options))


_MINDLIN = Law(
    "mindlin", "tangential", spring_of_area, MindlinParameters, mix_mindlin,
    "Mindlin 1949; loss of area: Walton and Braun 1986, Thornton and Randall 1988; memory: thirdbody.laws.memory",
    (MEMORY, RENEWAL_OF_SPRINGS),
)  # fmt: skip
_ROLLING = replace(
    _MINDLIN, parameters=RollingMindlinParameters,
    mix=lambda pair, options: RollingMindlinParameters(*mix_mindlin(pair, options)[:3], _rate(pair, options)),
)  # fmt: skip
MINDLIN = with_forms(_MINDLIN, spring_of_area, renewal_of_area, _ROLLING, globals())
