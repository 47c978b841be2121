"""Kernels and tangents of tangential laws with one spring and Coulomb's limit, from what is the law's own.

A law brings its stiffness, limit and renewal; here they are joined with a memory (`radial_return`, `rings`), and with the renewal
of a rolling contact area (`patch_renewal`) where a scene asks for it. Each combination is a law of its own, so that a scene pays
for no number that it does not need.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from thirdbody.laws import radial_return as two_number
from thirdbody.laws import rings
from thirdbody.laws.contract import Law, Options, kernel
from thirdbody.laws.kernel_data import Tangential
from thirdbody.laws.patch_renewal import moved_ground, renewed
from thirdbody.laws.radial_return import friction_tangent, renewed_spring, renews, rings_of


class Elastic(NamedTuple):
    """Spring of a law under its load, and derivatives by the overlap.

    Stiffness [N/m] and rate [N/m2]; limit [N] and rate [N/m]; slip of first sliding [m]; whether there is friction at all.
    """

    stiffness: float
    stiffness_rate: float
    limit: float
    limit_rate: float
    critical: float
    rubs: bool


class Renewing(NamedTuple):
    """Renewal of a rolling contact area per contact radius of travel, and its relative decrease with the overlap [1/m]."""

    rate: float
    falls: float


class Memory(NamedTuple):
    """A kind of memory: names of its floats; a step of the spring; what the area keeps; all displacements scaled."""

    history: tuple[str, ...]
    step: Callable
    remaining: Callable
    scaled: Callable


MEMORIES = (
    Memory(rings.HISTORY[:3], two_number.stretched, two_number.remaining, two_number.scaled),
    Memory(rings.HISTORY[:8], rings.swung_once, rings.remaining_one, rings.scaled_one),
    Memory(rings.HISTORY, rings.swung_twice, rings.remaining_two, rings.scaled_two),
)
"""By the number of closed rings."""

GROUND = ("offset_x", "offset_y", "reach")


def spring_kernels(elastic: Callable, memory: Memory) -> tuple[Callable, Callable]:
    """Return kernel and tangent of a law with this spring: `elastic(c, load, p)` returns `Elastic`."""
    step, remaining = memory.step, memory.remaining

    def law(c, load, p, h):
        e = elastic(c, load, p)
        t, new = step(c.slip_x, c.slip_y, h, e.stiffness, e.limit, p.retained_energy)
        slip = t.slip if e.rubs else math.sqrt(c.slip_x * c.slip_x + c.slip_y * c.slip_y)
        return Tangential(t.x, t.y, e.limit, e.critical, slip, t.stored, t.dissipated), new

    def tangent(c, load, p, h):
        e = elastic(c, load, p)
        k = remaining(h, e.stiffness, e.stiffness_rate)
        x, y = k.x - e.stiffness * c.slip_x, k.y - e.stiffness * c.slip_y
        x_rate, y_rate = k.x_rate - e.stiffness_rate * c.slip_x, k.y_rate - e.stiffness_rate * c.slip_y
        return friction_tangent(x, y, e.limit, e.limit_rate, e.stiffness, x_rate, y_rate)

    return law, tangent


def rolling_kernels(elastic: Callable, renewing: Callable, memory: Memory) -> tuple[Callable, Callable]:
    """As `spring_kernels`, with `renewing(load, p, elastic)` that returns `Renewing`."""
    step, remaining, scaled = memory.step, memory.remaining, memory.scaled

    def law(c, load, p, h):
        e, a = elastic(c, load, p), load.contact_radius
        ground = moved_ground(c.roll_x, c.roll_y, a, h[-3], h[-2], h[-1])
        fraction = renewed(renewing(load, p, e).rate * ground.path / max(a, 1e-300))
        old = h[:-3]
        fill_x, fill_y = fraction.fill * c.slip_x, fraction.fill * c.slip_y
        t, new = step(fill_x, fill_y, scaled(old, fraction.retained), e.stiffness, e.limit, 1.0)
        t = renewed_spring(t, remaining(old, e.stiffness, 0.0), old[2], c.slip_x, c.slip_y, fraction, e.stiffness)
        slip = t.slip if e.rubs else math.sqrt(c.slip_x * c.slip_x + c.slip_y * c.slip_y)
        answer = Tangential(t.x, t.y, e.limit, e.critical, slip, t.stored, t.dissipated)
        return answer, (*new, ground.x, ground.y, ground.reach)

    def tangent(c, load, p, h):
        e, a = elastic(c, load, p), load.contact_radius
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
    """Return the law with its kernels, and with a variant for each number of closed rings, with and without renewal.

    `rolling` has the parameters of the variants with renewal. Their kernels, which generated modules import by name, are put into
    the module with this namespace.
    """
    forms: dict[tuple[int, bool], Law] = {}
    for count, memory in enumerate(MEMORIES):
        ring = ("", "_one_ring", "_two_rings")[count]
        for base, ending, functions in (
            (law, ring, spring_kernels(elastic, memory)),
            (rolling, f"{ring}_rolling", rolling_kernels(elastic, renewing, memory)),
        ):
            names = f"{law.name}{ending}", f"{law.name}{ending}_tangent"
            for function, name in zip(functions, names, strict=True):
                function.__name__ = function.__qualname__ = name
                function.__module__ = space["__name__"]
                space[name] = kernel(function)
            rolls = base is rolling
            history = memory.history + (GROUND if rolls else ())
            forms[count, rolls] = replace(
                base, kernel=space[names[0]], tangent=space[names[1]], history=history, rolls=rolls, variant=None
            )
    return replace(forms[0, False], variant=variant_of(forms))


def variant_of(forms: Mapping[tuple[int, bool], Law]) -> Callable[[Options], Law | None]:
    """Return the function of options that chooses among the forms of a law; None for the first of them."""

    def variant(options: Options) -> Law | None:
        key = rings_of(options), renews(options)
        return forms[key] if key != (0, False) else None

    return variant
