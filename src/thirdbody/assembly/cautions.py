"""Effects and components of a built scene, on or off and why; what it is warned of: effects that are off and would matter, spots
that get hot or wear, dashpots of clumps."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.assembly.schedule import why_swings
from thirdbody.assembly.upper_plate import Upper
from thirdbody.engine.state import State
from thirdbody.kernels.tables import ONLY_LOWER, ONLY_UPPER, body, sphere
from thirdbody.laws.contract import Law, Material
from thirdbody.laws.damping import HERTZ_DAMPING, damping_number, restitution_of
from thirdbody.laws.hertz import dundurs_beta, e_star, yield_force, yield_limit, yield_speed
from thirdbody.laws.memory import MEMORY
from thirdbody.laws.registry import discover
from thirdbody.scene.model import Scene
from thirdbody.statics.contacts import response
from thirdbody.units import pretty

Part = tuple[str, bool, str]
"""Name of an effect or a component, whether it is on, and why."""

MISMATCH = 0.02
"""Dundurs' beta above which decoupling normal and tangential contact gives a warning."""

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s2]."""

TOUCH = 0.02
"""A sphere nearer to a plate than this fraction of its radius will carry load."""

HEAVY, NEAR, FAST = 0.01, 0.05, 0.1
"""Limits of warnings: weight over load; fraction of a contact's overlap due to its neighbour; drag over shear wave speed."""

ESTIMATE, MATTERS = 0.05, 0.1
"""Work of adhesion of the estimate [J/m2]; pull-off force over the load on a body from which on it warns."""

HEAT, WEAR = "flash_temperature", "wear"
"""Measures that tell what is only estimated here."""

HOT = 100.0
"""Flash temperature [K] from which on a scene is warned: tempered steel softens from some 200 K above room on, oils crack."""

CONDUCTIVITY, CAPACITY = 50.0, 460.0
"""Thermal conductivity [W/(m K)] and heat capacity [J/(kg K)] of a material that has none: those of carbon steel."""

WORN = 0.3
"""Worn depth over overlap from which on a scene is warned: the spot is then no longer that of a fresh sphere."""

WEAR_COEFFICIENT = 1e-14
"""Volume worn per load times slip [m3/J], of steel on steel that is not lubricated: 1e-15 to 1e-13 (Archard 1953)."""


class Heat(NamedTuple):
    """Temperature rise of a spot [K], its Peclet number, names of both materials, whether thermal values are assumed."""

    excess: float
    peclet: float
    pair: str
    assumed: bool


class Wear(NamedTuple):
    """Depth [m] that a spot wears, the same over its overlap, and the names of both materials."""

    depth: float
    fraction: float
    pair: str


def similarity_warnings(choice: CompiledPhysics) -> list[str]:
    """Return a warning of each pair whose normal and tangential contact are coupled."""
    return [
        f"{pair.a.name}/{pair.b.name} are not elastically similar (Dundurs beta {beta:+.3f}): normal and tangential contact are "
        "coupled there, which Hertz-Mindlin theory neglects"
        for pair in choice.pairs
        if abs(beta := dundurs_beta(pair.a, pair.b)) > MISMATCH
    ]


def motion_warnings(scene: Scene, choice: CompiledPhysics, state: State) -> list[str]:
    """Return warnings of balls that nothing stops spinning about the normal of the plates, and of clumps that may land in flight.

    n equal contacts of a clump are one with n times the stiffness and the viscosity: sqrt(n) times the damping number.
    """
    result, upper, count = [], scene.plates.upper, np.diff(state.start)
    if scene.plates.lower is not None and upper is not None and not any(law.stage == "twisting" for law in choice.chain.laws):
        spinning = int(np.count_nonzero(state.B[count == 1, body.SPIN + 2]))
        if spinning and any(pair.friction > 0.0 for pair in choice.pairs):
            result.append(
                f"{spinning} {'ball spins' if spinning == 1 else 'balls spin'} about the normal of the plates: at a single spot "
                "on each plate only pivoting friction brakes that, and it is off; effects.pivoting = {} switches it on"
            )
    largest = int(count.max())
    free = upper is None or (upper.gap is not None and any(getattr(d, "placement", None) == "dilute" for d in scene.debris))
    restitution = min((pair.restitution for pair in choice.pairs), default=1.0)
    if free and largest > 1 and restitution != 1.0 and HERTZ_DAMPING in choice.chain.laws:
        alpha = damping_number(restitution)
        values = ", ".join(f"{restitution_of(math.sqrt(n) * alpha):.2g} on {n}" for n in sorted({2, min(largest, 3), largest}))
        result.append(
            f"restitution {restitution:g} is that of one contact: a clump in free flight that lands on several spheres at once "
            f"leaves with less, {values} (its largest number); pairs.restitution = {restitution_of(alpha / math.sqrt(2.0)):.2g} "
            f"gives {restitution:g} on 2"
        )
    return result


def cautions(scene: Scene, choice: CompiledPhysics, state: State, upper: Upper, end: float) -> list[str]:
    """Return warnings of effects that are off or neglected and would matter in this scene; `end`: of the run [s]."""
    result, load, speed = [], load_on_body(state, upper), state.world.schedule.top_speed()
    weight, (fraction, distance) = weight_over_load(state, upper), neighbours(state, upper)
    if scene.effects.gravity is None and weight > HEAVY:  # false without a load
        result.append(f"gravity is off, but a body weighs up to {weight:.2g} of its load: effects.gravity switches it on")
    if fraction > NEAR and not choice.interactions:
        result.append(
            f"spots of a body stand as near as {distance:.1f} contact radii: each presses its neighbour's surface down by about "
            f"{100.0 * fraction:.0f} % of the overlap, which Hertz and Mindlin neglect: effects.close_spots takes it into account"
        )
    wave = min(math.sqrt(m.shear_modulus / m.density) for m in choice.materials)
    if speed > FAST * wave:
        result.append(
            f"the drag, {speed:.3g} m/s, is {speed / wave:.2g} of the slowest shear wave: contacts are computed as quasi-static"
        )
    result += adhesion_warnings(scene, choice, state, load)
    measured = {measure.name for measure in choice.measures}
    heat, wear = expected_heat(choice, state, upper), expected_wear(choice, state, upper, end)
    if heat is not None and heat.excess >= HOT and HEAT not in measured:
        values = "with the conductivity of steel where the scene gives none" if heat.assumed else "by the conductivities given"
        result.append(
            f"friction heats a spot of {heat.pair} by some {heat.excess:.0f} K at the top speed, {values} (slow source; Peclet "
            f"number {heat.peclet:.2g}): measures.{HEAT} tells it per contact; properties stay as they are"
        )
    if wear is not None and wear.fraction >= WORN and WEAR not in measured:
        result.append(
            f"a spot of {wear.pair} that slides all the way wears by some {1e9 * wear.depth:.2g} nm, {wear.fraction:.2g} of its "
            f"overlap, at {WEAR_COEFFICIENT:g} m3/J (steel, not lubricated): measures.{WEAR} tells where; shapes stay as they are"
        )
    return result


def load_on_body(state: State, upper: Upper) -> float:
    """Return the load on one load-carrying body [N]; infinite where nothing is pressed on the debris."""
    plate = state.world.upper
    if plate is None or not float(np.max(plate.load)) > 0.0:
        return math.inf
    return float(np.max(plate.load)) / (1 if len(plate.heights) > 1 else max(1, upper.loaded))


def weight_over_load(state: State, upper: Upper) -> float:
    """Return the weight of the heaviest body over the load on one; NaN without a load."""
    load = load_on_body(state, upper)
    return float(np.max(state.bodies.mass)) * STANDARD_GRAVITY / load if math.isfinite(load) else math.nan


def neighbours(state: State, upper: Upper) -> tuple[float, float]:
    """Return the fraction of the overlap due to the nearest contact of the body and plate, and its distance over a.

    Both contacts carry the same load F: the own overlap is 3 F/(4 E* a), and at the distance r the other one's load lowers the
    surface by F/(pi E* r) (Boussinesq; K.L. Johnson, Contact Mechanics, 1985, Eq. 3.22), so the fraction is 4 a/(3 pi r), for r >
    2 a, with the contact radius a. The contacts are those that touch before loading. (0, inf) without two of them, or without a
    load.
    """
    if upper.overlap <= 0.0:
        return 0.0, math.inf
    S, nearest, bodies, plate = state.S, math.inf, state.body, state.world.upper
    radius = S[:, sphere.RADIUS]
    sides = [(S[:, sphere.Z] - radius, ONLY_UPPER)]
    if plate is not None:
        sides.append((plate.heights[plate.patch[bodies]] - S[:, sphere.Z] - radius, ONLY_LOWER))
    for gap, other in sides:
        touching = np.flatnonzero((np.abs(gap) < TOUCH * radius) & (state.side != other))  # in the order of bodies
        for k in range(1, len(touching)):
            pairs = np.flatnonzero(bodies[touching[k:]] == bodies[touching[:-k]])
            if not pairs.size:
                break
            i, j = touching[pairs], touching[pairs + k]
            apart = np.hypot(S[i, sphere.X] - S[j, sphere.X], S[i, sphere.Y] - S[j, sphere.Y])
            nearest = min(nearest, float(np.min(apart / (math.sqrt(upper.overlap) * np.maximum(radius[i], radius[j])))))
    return (4.0 / (3.0 * math.pi * nearest), nearest) if nearest < math.inf else (0.0, math.inf)


def adhesion_remarks(choice: CompiledPhysics, state: State) -> list[tuple[str, str, bool]]:
    """Return names of both materials, what the laws say of adhesion of the pair, and whether that is a warning."""
    radius = state.S[:, sphere.RADIUS]
    low, high = 0.5 * float(radius.min()), float(radius.max())  # two equal spheres; a sphere on a plate
    return [
        (f"{pair.a.name}/{pair.b.name}", *law.remark(pair, law.options_of(pair, choice.options[law.name]), low, high))
        for law in choice.chain.laws
        if law.remark is not None
        for pair in choice.pairs
    ]


def adhesion_warnings(scene: Scene, choice: CompiledPhysics, state: State, load: float) -> list[str]:
    """Return warnings of a model that hardly fits, or of missing adhesion; `load`: on a body [N], infinite without a plate.

    The estimate is 3/2 pi w R of the largest sphere on a plate, against the load, or the weight of the lightest body.
    """
    remarks, gravity = adhesion_remarks(choice, state), scene.effects.gravity
    if remarks or any(law.stage == "adhesion" or law.reach for law in choice.chain.laws):
        return [f"adhesion of {pair}: {text}" for pair, text, warns in remarks if warns]
    if math.isinf(load) and gravity is not None:
        load = float(np.min(state.bodies.mass)) * float(np.linalg.norm(gravity))
    pull = 1.5 * math.pi * ESTIMATE * float(state.S[:, sphere.RADIUS].max())
    if not (0.0 < load < math.inf and pull > MATTERS * load):
        return []
    return [
        f"adhesion is off, but with a work of adhesion of {1e3 * ESTIMATE:.0f} mJ/m2 a contact would pull with up to "
        f"{pretty(pull, 'force')}, {pull / load:.2g} of the load on a body: effects.adhesion switches it on"
    ]


def _expected_spots(choice: CompiledPhysics, state: State, upper: Upper) -> tuple[float, list[float]]:
    """Return the radius [m] of the sphere of median size, and the load [N] of its spot by the overlap that all pairs share."""
    n = len(choice.pairs)
    radius = np.full(n, float(np.median(state.spheres.radius)))
    loads = response(state.physics, upper.shared_overlap * radius, radius, np.arange(n)).force
    return float(radius[0]), [float(load) for load in loads]


def expected_heat(choice: CompiledPhysics, state: State, upper: Upper) -> Heat | None:
    """Return the heat of the hottest pair: a sphere of median radius that slides at the top speed under the expected load.

    T = mu N v/(4 a (k_1 + k_2)): Holm 1948; Archard 1959, Wear 2, 438, Eq. 2, for slow sources; the Peclet number is
    v a/(2 kappa) of the slower side. None where no load or no speed is known.
    """
    speed = state.world.schedule.top_speed()
    if upper.shared_overlap <= 0.0 or not 0.0 < speed < math.inf:
        return None
    radius, loads = _expected_spots(choice, state, upper)
    a, heats = math.sqrt(upper.shared_overlap) * radius, []
    for pair, load in zip(choice.pairs, loads, strict=True):
        both = sum(m.thermal_conductivity or CONDUCTIVITY for m in (pair.a, pair.b))
        assumed = any(m.thermal_conductivity is None or m.heat_capacity is None for m in (pair.a, pair.b))
        peclet = 0.5 * speed * a / min(_diffusivity(pair.a), _diffusivity(pair.b))
        heats.append(Heat(pair.friction * load * speed / (4.0 * a * both), peclet, f"{pair.a.name}/{pair.b.name}", assumed))
    return max(heats)


def _diffusivity(material: Material) -> float:
    """Return the thermal diffusivity k/(rho c) [m2/s], with assumed values where the material has none."""
    return (material.thermal_conductivity or CONDUCTIVITY) / (material.density * (material.heat_capacity or CAPACITY))


def expected_wear(choice: CompiledPhysics, state: State, upper: Upper, end: float) -> Wear | None:
    """Return the wear of the pair that wears deepest: a sphere of median radius that slides on one spot until `end` [s].

    h = k p s with the mean pressure p of Hertz under the expected load and the path s of the plate (Archard 1953, J. Appl. Phys.
    24, 981, Eq. 4, with k = K/H). None where no load is known.
    """
    path = state.world.schedule.path(0.0, end)
    if upper.shared_overlap <= 0.0 or not 0.0 < path < math.inf:
        return None
    radius, loads = _expected_spots(choice, state, upper)
    area, deepest = math.pi * upper.shared_overlap * radius * radius, loads.index(max(loads))
    depth, pair = WEAR_COEFFICIENT * loads[deepest] / area * path, choice.pairs[deepest]
    return Wear(depth, depth / (upper.shared_overlap * radius), f"{pair.a.name}/{pair.b.name}")


def parts(scene: Scene, choice: CompiledPhysics, state: State, upper: Upper, end: float) -> list[dict[str, Any]]:
    """Return every effect and component of a built scene: `part`, `on`, `reason`; `end`: of the run [s]."""
    rows = [*_laws(scene, choice, state), *_effects(choice, state, upper, end), *_machinery(scene, choice, state, upper)]
    return [{"part": part, "on": bool(on), "reason": reason} for part, on, reason in rows]


def _laws(scene: Scene, choice: CompiledPhysics, state: State) -> list[Part]:
    rows = [(f"{law.stage}: {law.name}", True, f"of the level {choice.level}") for law in choice.chain.laws]
    if (memory := choice.memory) is not None:
        given = scene.contact.options.get(MEMORY.name, MEMORY.default) != MEMORY.default
        reason = "contact.memory" if given else why_swings(scene) or "no motion or load of a plate turns"
        rows.append((f"memory: {memory}", True, reason))
    rows += [(f"adhesion of {pair}", True, text) for pair, text, _ in adhesion_remarks(choice, state)]
    return rows + [(name, False, "no pair requires it") for name in choice.off]


def _effects(choice: CompiledPhysics, state: State, upper: Upper, end: float) -> list[Part]:
    registry = discover()
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
        if name == WEAR and (wear := expected_wear(choice, state, upper, end)) is not None:
            reason += f"; a spot of {wear.pair} that slides all the way wears by some {pretty(wear.depth, 'length')}"
        rows.append((f"measure: {name}", named, reason))
    return rows


def _machinery(scene: Scene, choice: CompiledPhysics, state: State, upper: Upper) -> list[Part]:
    plate, meet = state.world.upper, state.world.debris_meets
    declared = scene.contact.debris_contact == "none"
    why = "bodies may meet" if meet else "contact.debris_contact = 'none'" if declared else "no two bodies can meet"
    return [
        ("motion of bodies and their spheres", True, "always"),
        ("contact geometry", True, "always"),
        ("debris-debris contact", meet, why),
        ("labels", choice.labeller is not None, choice.labeller.name if choice.labeller else "no labeller is installed"),
        ("foundation", plate is not None and plate.foundation is not None, "plates.upper.support"),
        ("rolling resistance's moments", state.physics.moments, "a law of the stage rolling"),
        ("first yield", True, _yield_reason(choice, state, upper)),
        ("elastic interaction of spots", len(state.physics.interaction) > 0, _spots_reason(choice, state, upper)),
    ]


def _yield_reason(choice: CompiledPhysics, state: State, upper: Upper) -> str:
    """Return the expected peak pressure of a sphere of median radius, by the pair with the highest, and how yield is treated."""
    shared, n = upper.shared_overlap, len(choice.pairs)
    given = [m.name for m in choice.materials if m.yield_strength]
    source = f"yield strength of {', '.join(given)} from the scene" if given else "yield strengths assumed, E/100"
    source += ", others assumed" if 0 < len(given) < len(choice.materials) else ""
    median, expected = float(np.median(state.spheres.radius)), ""
    if shared > 0.0:
        radius = np.full(n, median)
        pressure = float(response(state.physics, shared * radius, radius, np.arange(n)).pressure.max())
        expected = f"expected peak pressure {pretty(pressure, 'pressure')}; " if pressure > 0.0 else ""
    how = "contacts flow" if choice.physics.loss == "plastic" else "a warning, no plastic flow"
    return f"{expected}{source}: {how}; {_onset(choice, median)}"


def _onset(choice: CompiledPhysics, radius: float) -> str:
    onsets = []
    for pair, row in zip(choice.pairs, choice.rows, strict=True):
        modulus, limit = e_star(pair.a, pair.b), yield_limit(pair.a, pair.b)
        pressure = getattr(row[0], "yield_pressure", limit.pressure)  # of a plastic law: of its options
        softer = pair.a if pair.a.name == limit.material else pair.b
        speed = yield_speed(modulus, pressure, softer.density)
        onsets.append((yield_force(radius, modulus, pressure), speed, pressure, modulus, f"{pair.a.name}/{pair.b.name}"))
    force, speed, pressure, modulus, names = min(onsets)
    if not pressure < modulus:
        return "no material is known to yield"
    where = f"on a sphere of {pretty(radius, 'length')} against a plane, or at {pretty(speed, 'velocity')} in its impact"
    return f"{names} yields at {pretty(pressure, 'pressure')}: from {pretty(force, 'force')} {where}"


def _spots_reason(choice: CompiledPhysics, state: State, upper: Upper) -> str:
    if choice.interactions:
        return f"the scene names {choice.interactions[0].name}"
    fraction, distance = neighbours(state, upper)
    if fraction == 0.0:
        return "no two spots of a body are known to touch before the load comes"
    return f"the nearest are {distance:.1f} contact radii apart: {100.0 * fraction:.1g} % of the overlap is neglected"
