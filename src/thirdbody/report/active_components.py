"""Effects and components of a built scene in `thirdbody check`: on or off, and why."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.assembly.cautions import HEAT, WEAR, adhesion_remarks, expected_heat, expected_wear, neighbours, weight_over_load
from thirdbody.assembly.schedule import why_swings
from thirdbody.laws.contract import Law
from thirdbody.laws.hertz import e_star, yield_force, yield_limit, yield_speed
from thirdbody.laws.memory import MEMORY
from thirdbody.laws.registry import discover
from thirdbody.statics.contacts import response
from thirdbody.units import pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation


def parts(built: Simulation) -> list[dict[str, Any]]:
    """Return every effect and component: `part`, `on`, `reason`."""
    rows = [*_laws(built), *_effects(built), *_machinery(built)]
    return [{"part": part, "on": bool(on), "reason": reason} for part, on, reason in rows]


def _laws(built: Simulation) -> list[tuple[str, bool, str]]:
    choice = built.choice
    rows = [(f"{law.stage}: {law.name}", True, f"of the level {choice.level}") for law in choice.chain.laws]
    if (memory := choice.memory) is not None:
        given = built.scene.contact.options.get(MEMORY.name, MEMORY.default) != MEMORY.default
        reason = "contact.memory" if given else why_swings(built.scene) or "no motion or load of a plate turns"
        rows.append((f"memory: {memory}", True, reason))
    rows += [(f"adhesion of {pair}", True, text) for pair, text, _ in adhesion_remarks(choice, built.state)]
    return rows + [(name, False, "no pair requires it") for name in choice.off]


def _effects(built: Simulation) -> list[tuple[str, bool, str]]:
    choice, state, upper, registry = built.choice, built.state, built.upper, discover()
    on = {effect.name for effect in choice.other_effects} | {law.name for law in choice.chain.laws}
    rows, reasons = [], {True: "the scene names it", False: "the scene does not name it"}
    for name, effect in registry.effects.items():
        if isinstance(effect, Law) and name in on:
            continue  # reported as a law
        reason = reasons[name in on]
        if name == "gravity" and name not in on and math.isfinite(weight := weight_over_load(state, upper)):
            reason = f"weight/load = {weight:.1g}; effects.gravity switches it on"
        rows.append((f"effect: {name}", name in on, reason))
    for name in registry.measures:
        named = name in {measure.name for measure in choice.measures}
        reason = reasons[named]
        if name == HEAT and (heat := expected_heat(choice, state, upper)) is not None:
            reason += f"; a spot of {heat.pair} gets {heat.excess:.1g} K hotter at the top speed"
        if name == WEAR and (wear := expected_wear(choice, state, upper, built.planned_time)) is not None:
            reason += f"; a spot of {wear.pair} that slides all the way wears by some {pretty(wear.depth, 'length')}"
        rows.append((f"measure: {name}", named, reason))
    return rows


def _machinery(built: Simulation) -> list[tuple[str, bool, str]]:
    state = built.state
    upper, meet = state.world.upper, state.world.debris_meets
    declared = built.scene.contact.debris_contact == "none"
    why = "bodies may meet" if meet else "contact.debris_contact = 'none'" if declared else "no two bodies can meet"
    return [
        ("motion of bodies and their spheres", True, "always"),
        ("contact geometry", True, "always"),
        ("debris-debris contact", meet, why),
        ("labels", built.labeller is not None, built.labeller.name if built.labeller else "no labeller is installed"),
        ("foundation", upper is not None and upper.foundation is not None, "plates.upper.support"),
        ("rolling resistance's moments", state.physics.moments, "a law of the stage rolling"),
        ("first yield", True, _yield_reason(built)),
        ("elastic interaction of spots", len(state.physics.interaction) > 0, _spots_reason(built)),
    ]


def _yield_reason(built: Simulation) -> str:
    """Return the expected peak pressure of a sphere of median radius, by the pair with the highest, and how yield is treated."""
    choice, shared, n = built.choice, built.upper.shared_overlap, len(built.choice.pairs)
    given = [m.name for m in choice.materials if m.yield_strength]
    source = f"yield strength of {', '.join(given)} from the scene" if given else "yield strengths assumed, E/100"
    source += ", others assumed" if 0 < len(given) < len(choice.materials) else ""
    median, expected = float(np.median(built.state.spheres.radius)), ""
    if shared > 0.0:
        radius = np.full(n, median)
        pressure = float(response(built.state.physics, shared * radius, radius, np.arange(n)).pressure.max())
        expected = f"expected peak pressure {pretty(pressure, 'pressure')}; " if pressure > 0.0 else ""
    how = "contacts flow" if choice.physics.loss == "plastic" else "a warning, no plastic flow"
    return f"{expected}{source}: {how}; {_onset(built, median)}"


def _onset(built: Simulation, radius: float) -> str:
    choice, onsets = built.choice, []
    for pair, row in zip(choice.pairs, choice.rows, strict=True):
        modulus, limit = e_star(pair.a, pair.b), yield_limit(pair.a, pair.b)
        pressure = row[0].yield_pressure if choice.physics.loss == "plastic" else limit.pressure
        softer = pair.a if pair.a.name == limit.material else pair.b
        speed = yield_speed(modulus, pressure, softer.density)
        onsets.append((yield_force(radius, modulus, pressure), speed, pressure, modulus, f"{pair.a.name}/{pair.b.name}"))
    force, speed, pressure, modulus, names = min(onsets)
    if not pressure < modulus:
        return "no material is known to yield"
    where = f"on a sphere of {pretty(radius, 'length')} against a plane, or at {pretty(speed, 'velocity')} in its impact"
    return f"{names} yields at {pretty(pressure, 'pressure')}: from {pretty(force, 'force')} {where}"


def _spots_reason(built: Simulation) -> str:
    if built.choice.interactions:
        return f"the scene names {built.choice.interactions[0].name}"
    fraction, distance = neighbours(built.state, built.upper)
    if fraction == 0.0:
        return "no two spots of a body are known to touch before the load comes"
    return f"the nearest are {distance:.1f} contact radii apart: {100.0 * fraction:.1g} % of the overlap is neglected"
