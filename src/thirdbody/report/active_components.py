"""Effects and components of a built scene: on or off, and why; where an absent one matters."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.assembly.schedule import why_swings
from thirdbody.kernels.tables import ONLY_LOWER, ONLY_UPPER, sphere
from thirdbody.laws.hertz import e_star, yield_force, yield_limit, yield_speed
from thirdbody.laws.memory import MEMORY
from thirdbody.report import heat_check, wear_check
from thirdbody.report.adhesion_check import adhesion_warnings, remarks
from thirdbody.statics.contacts import response
from thirdbody.units import pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s2]."""

TOUCH = 0.02
"""A sphere nearer to a plate than this fraction of its radius will carry load."""

HEAVY, NEAR, FAST = 0.01, 0.05, 0.1
"""Limits of warnings: weight over load; fraction of a contact's overlap due to its neighbour; drag over shear wave speed."""


def parts(built: Simulation) -> list[dict[str, Any]]:
    """Return every effect and component: `part`, `on`, `reason`."""
    return [*_laws(built), *_effects(built), *_machinery(built)]


def part_warnings(built: Simulation) -> list[str]:
    """Return warnings of effects that are off or neglected and would matter in this scene."""
    result = []
    weight, load = _weight_over_load(built), _load(built)
    if built.scene.effects.gravity is None and weight > HEAVY and math.isfinite(load):
        result.append(f"gravity is off, but a body weighs up to {weight:.2g} of its load: effects.gravity switches it on")
    fraction, distance = neighbours(built)
    if fraction > NEAR and not built.choice.interactions:
        result.append(
            f"spots of a body stand as near as {distance:.1f} contact radii: each presses its neighbour's surface down by about "
            f"{100.0 * fraction:.0f} % of the overlap, which Hertz and Mindlin neglect: effects.close_spots takes it into account"
        )
    speed, wave = built.schedule.top_speed(), _wave_speed(built)
    if speed > FAST * wave:
        result.append(
            f"the drag, {speed:.3g} m/s, is {speed / wave:.2g} of the slowest shear wave: contacts are computed as quasi-static"
        )
    return result + adhesion_warnings(built, load) + heat_check.heat_warnings(built) + wear_check.wear_warnings(built)


def neighbours(built: Simulation) -> tuple[float, float]:
    """Return the fraction of the overlap due to the nearest contact of the body and plate, and its distance over a.

    Both contacts carry the same load F: the own overlap is 3 F/(4 E* a), and at the distance r the other one's load lowers the
    surface by F/(pi E* r) (Boussinesq; K.L. Johnson, Contact Mechanics, 1985, Eq. 3.22), so the fraction is 4 a/(3 pi r), for r >
    2 a, with the contact radius a. The contacts are those that touch before loading. (0, inf) without two of them, or without a
    load.
    """
    state, overlap = built.state, built.upper.overlap
    if overlap <= 0.0:
        return 0.0, math.inf
    S, near, nearest = state.S, TOUCH, math.inf
    radius, body = S[:, sphere.RADIUS], state.body
    upper = state.world.upper
    sides = [(S[:, sphere.Z] - radius, ONLY_UPPER)]
    if upper is not None:
        sides.append((upper.heights[upper.patch[body]] - S[:, sphere.Z] - radius, ONLY_LOWER))
    for gap, other in sides:
        touching = np.flatnonzero((np.abs(gap) < near * radius) & (state.side != other))  # in the order of bodies
        for k in range(1, len(touching)):
            pairs = np.flatnonzero(body[touching[k:]] == body[touching[:-k]])
            if not pairs.size:
                break
            i, j = touching[pairs], touching[pairs + k]
            apart = np.hypot(S[i, sphere.X] - S[j, sphere.X], S[i, sphere.Y] - S[j, sphere.Y])
            nearest = min(nearest, float(np.min(apart / (math.sqrt(overlap) * np.maximum(radius[i], radius[j])))))
    return (4.0 / (3.0 * math.pi * nearest), nearest) if nearest < math.inf else (0.0, math.inf)


def _laws(built: Simulation) -> list[dict[str, Any]]:
    """Return the contact laws: those in use, and those that no pair uses."""
    rows = [_row(f"{law.stage}: {law.name}", True, f"of the level {built.choice.level}") for law in built.choice.chain.laws]
    if (memory := built.choice.memory) is not None:
        given = built.scene.contact.options.get(MEMORY.name, MEMORY.default) != MEMORY.default
        reason = "contact.memory" if given else why_swings(built.scene) or "no motion or load of a plate turns"
        rows.append(_row(f"memory: {memory}", True, reason))
    rows += [_row(f"adhesion of {pair}", True, text) for pair, text, _ in remarks(built)]
    return rows + [_row(name, False, "no pair requires it") for name in built.choice.off]


def _effects(built: Simulation) -> list[dict[str, Any]]:
    from thirdbody.laws.contract import Law
    from thirdbody.laws.registry import discover

    choice = built.choice
    on = {effect.name for effect in choice.other_effects} | {law.name for law in built.choice.chain.laws}
    rows = []
    for name, effect in discover().effects.items():
        if isinstance(effect, Law) and name in on:
            continue  # reported as a law
        reason = "the scene names it" if name in on else "the scene does not name it"
        if name == "gravity" and name not in on:
            weight = _weight_over_load(built)
            reason = f"weight/load = {weight:.1g}; effects.gravity switches it on" if math.isfinite(weight) else reason
        rows.append(_row(f"effect: {name}", name in on, reason))
    for name in discover().measures:
        named = name in {measure.name for measure in built.choice.measures}
        reason = "the scene names it" if named else "the scene does not name it"
        if name == heat_check.MEASURE and (heat := heat_check.expected_heat(built)) is not None:
            reason += f"; a spot of {heat.pair} gets {heat.excess:.1g} K hotter at the top speed"
        if name == wear_check.MEASURE and (wear := wear_check.expected_wear(built)) is not None:
            reason += f"; a spot of {wear.pair} that slides all the way wears by some {pretty(wear.depth, 'length')}"
        rows.append(_row(f"measure: {name}", named, reason))
    return rows


def _machinery(built: Simulation) -> list[dict[str, Any]]:
    state = built.state
    upper, debris_meet = state.world.upper, state.world.debris_meets
    founded = upper is not None and upper.foundation is not None
    report = "bodies may meet" if debris_meet else (
        "contact.debris_contact = 'none'" if built.scene.contact.debris_contact == "none" else "no two bodies can meet"
    )  # fmt: skip
    return [
        _row("motion of bodies and their spheres", True, "always"),
        _row("contact geometry", True, "always"),
        _row("debris-debris contact", debris_meet, report),
        _row("labels", built.labeller is not None, built.labeller.name if built.labeller else "no labeller is installed"),
        _row("foundation", founded, "plates.upper.support"),
        _row("rolling resistance's moments", state.physics.moments, "a law of the stage rolling"),
        _row("first yield", True, _yield_reason(built)),
        _row("elastic interaction of spots", len(state.physics.interaction) > 0, _spots_reason(built)),
    ]


def _row(part: str, on: bool, reason: str) -> dict[str, Any]:
    return {"part": part, "on": bool(on), "reason": reason}


def _yield_reason(built: Simulation) -> str:
    given = [m.name for m in built.choice.materials if m.yield_strength]
    source = f"yield strength of {', '.join(given)} from the scene" if given else "yield strengths assumed, E/100"
    source += ", others assumed" if 0 < len(given) < len(built.choice.materials) else ""
    pressure = _peak_pressure(built)
    expected = f"expected peak pressure {pretty(pressure, 'pressure')}; " if pressure > 0.0 else ""
    how = "contacts flow" if built.state.physics.loss == "plastic" else "a warning, no plastic flow"
    return f"{expected}{source}: {how}; {_onset(built)}"


def _onset(built: Simulation) -> str:
    """Describe first yield of the pair of debris and plate, or of two bodies, that yields first."""
    choice, radius, onsets = built.choice, float(np.median(built.state.spheres.radius)), []
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
    fraction, distance = neighbours(built)
    if fraction == 0.0:
        return "no two spots of a body are known to touch before the load comes"
    return f"the nearest are {distance:.1f} contact radii apart: {100.0 * fraction:.1g} % of the overlap is neglected"


def _peak_pressure(built: Simulation) -> float:
    """Return the peak pressure under the expected load [Pa], of a sphere of median radius and the pair with the highest one."""
    if built.upper.shared_overlap <= 0.0:
        return 0.0
    kinds = np.arange(len(built.choice.pairs))
    radius = np.full(len(kinds), float(np.median(built.state.spheres.radius)))
    return float(response(built.state.physics, built.upper.shared_overlap * radius, radius, kinds).pressure.max())


def _load(built: Simulation) -> float:
    """Return the load on one load-carrying body [N]; infinite where nothing is pressed on the debris."""
    upper = built.state.world.upper
    if upper is None or not float(np.max(upper.load)) > 0.0:
        return math.inf
    n_sharing = 1 if len(upper.heights) > 1 else max(1, built.upper.loaded)
    return float(np.max(upper.load)) / n_sharing


def _weight_over_load(built: Simulation) -> float:
    """Return the weight of the heaviest body over the load on one; NaN without a load."""
    load = _load(built)
    return float(np.max(built.state.bodies.mass)) * STANDARD_GRAVITY / load if math.isfinite(load) else math.nan


def _wave_speed(built: Simulation) -> float:
    """Return the speed of shear waves in the slowest material [m/s]."""
    return min(math.sqrt(m.shear_modulus / m.density) for m in built.choice.materials)
