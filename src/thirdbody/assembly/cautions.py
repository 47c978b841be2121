"""Effects and components of a built scene, on or off and why; what it is warned of: effects that are off and would matter, spots
that get hot or wear, dashpots of clumps."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.assembly.schedule import why_swings
from thirdbody.assembly.upper_plate import Upper
from thirdbody.engine.state import State
from thirdbody.kernels.tables import ONLY_LOWER, ONLY_UPPER, body, sphere
from thirdbody.laws.contract import Law
from thirdbody.laws.damping import HERTZ_DAMPING, damping_number, restitution_of
from thirdbody.laws.hertz import dundurs_beta, e_star, yield_force, yield_limit, yield_speed
from thirdbody.laws.memory import MEMORY
from thirdbody.laws.registry import discover
from thirdbody.scene.model import Scene
from thirdbody.statics.contacts import Response, response
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


class Expected:
    """What a built scene leads to expect, by its state at the start; `end`: of the run [s]."""

    def __init__(self, scene: Scene, choice: CompiledPhysics, state: State, upper: Upper, end: float) -> None:
        self.scene, self.choice, self.state, self.upper, self.end = scene, choice, state, upper, end
        self.top_speed, self.radii = state.world.schedule.top_speed(), state.S[:, sphere.RADIUS]
        self.measures = {measure.name for measure in choice.measures}
        # load on one load-carrying body [N], infinite where nothing is pressed on the debris; weight of the heaviest body over it
        plate, self.load = state.world.upper, math.inf
        if plate is not None and float(np.max(plate.load)) > 0.0:
            self.load = float(np.max(plate.load)) / (1 if len(plate.heights) > 1 else max(1, upper.loaded))
        weight = float(np.max(state.bodies.mass)) * STANDARD_GRAVITY
        self.weight = weight / self.load if math.isfinite(self.load) else math.nan
        self.median = float(np.median(state.spheres.radius))

    def warnings(self) -> list[str]:
        """Return warnings of effects that are off or neglected and would matter in this scene."""
        result, speed, (fraction, distance) = [], self.top_speed, self.neighbours
        if self.scene.effects.gravity is None and self.weight > HEAVY:  # false without a load
            text = f"gravity is off, but a body weighs up to {self.weight:.2g} of its load"
            result.append(f"{text}: effects.gravity switches it on")
        if fraction > NEAR and not self.choice.interactions:
            result.append(
                f"spots of a body stand as near as {distance:.1f} contact radii: each presses its neighbour's surface down by "
                f"about {100.0 * fraction:.0f} % of the overlap, which Hertz and Mindlin neglect: effects.close_spots takes it "
                "into account"
            )
        wave = min(math.sqrt(m.shear_modulus / m.density) for m in self.choice.materials)
        if speed > FAST * wave:
            result.append(
                f"the drag, {speed:.3g} m/s, is {speed / wave:.2g} of the slowest shear wave: contacts are computed as "
                "quasi-static"
            )
        result += self.adhesion_warnings(self.load)
        heat, wear = self.heat, self.wear
        if heat is not None and heat.excess >= HOT and HEAT not in self.measures:
            how = "with the conductivity of steel where the scene gives none" if heat.assumed else "by the conductivities given"
            result.append(
                f"friction heats a spot of {heat.pair} by some {heat.excess:.0f} K at the top speed, {how} (slow source; Peclet "
                f"number {heat.peclet:.2g}): measures.{HEAT} tells it per contact; properties stay as they are"
            )
        if wear is not None and wear.fraction >= WORN and WEAR not in self.measures:
            result.append(
                f"a spot of {wear.pair} that slides all the way wears by some {1e9 * wear.depth:.2g} nm, {wear.fraction:.2g} of "
                f"its overlap, at {WEAR_COEFFICIENT:g} m3/J (steel, not lubricated): measures.{WEAR} tells where; shapes stay as "
                "they are"
            )
        return result

    @cached_property
    def spots(self) -> Response:
        """Contact of a sphere of median radius with the overlap that all pairs share, of each pair."""
        n = len(self.choice.pairs)
        radius = np.full(n, self.median)
        return response(self.state.physics, self.upper.shared_overlap * radius, radius, np.arange(n))

    @cached_property
    def neighbours(self) -> tuple[float, float]:
        """Fraction of the overlap due to the nearest contact of the body and plate, and its distance over a.

        Both contacts carry the same load F: the own overlap is 3 F/(4 E* a), and at the distance r the other one's load lowers
        the surface by F/(pi E* r) (Boussinesq; K.L. Johnson, Contact Mechanics, 1985, Eq. 3.22), so the fraction is
        4 a/(3 pi r), for r > 2 a, with the contact radius a. The contacts are those that touch before loading. (0, inf) without
        two of them, or without a load.
        """
        if self.upper.overlap <= 0.0:
            return 0.0, math.inf
        S, nearest, bodies, plate, radius = self.state.S, math.inf, self.state.body, self.state.world.upper, self.radii
        sides = [(S[:, sphere.Z] - radius, ONLY_UPPER)]
        if plate is not None:
            sides.append((plate.heights[plate.patch[bodies]] - S[:, sphere.Z] - radius, ONLY_LOWER))
        for gap, other in sides:
            touching = np.flatnonzero((np.abs(gap) < TOUCH * radius) & (self.state.side != other))  # in the order of bodies
            for k in range(1, len(touching)):
                pairs = np.flatnonzero(bodies[touching[k:]] == bodies[touching[:-k]])
                if not pairs.size:
                    break
                i, j = touching[pairs], touching[pairs + k]
                apart = np.hypot(S[i, sphere.X] - S[j, sphere.X], S[i, sphere.Y] - S[j, sphere.Y])
                nearest = min(nearest, float(np.min(apart / (math.sqrt(self.upper.overlap) * np.maximum(radius[i], radius[j])))))
        return (4.0 / (3.0 * math.pi * nearest), nearest) if nearest < math.inf else (0.0, math.inf)

    @cached_property
    def remarks(self) -> list[tuple[str, str, bool]]:
        """Names of both materials, what the laws say of adhesion of the pair, and whether that is a warning."""
        low, high = 0.5 * float(self.radii.min()), float(self.radii.max())  # two equal spheres; a sphere on a plate
        return [
            (f"{pair.a.name}/{pair.b.name}", *law.remark(pair, law.options_of(pair, self.choice.options[law.name]), low, high))
            for law in self.choice.chain.laws
            if law.remark is not None
            for pair in self.choice.pairs
        ]

    def adhesion_warnings(self, load: float) -> list[str]:
        """Return warnings of a model that hardly fits, or of missing adhesion; `load`: on a body [N], infinite without a plate.

        The estimate is 3/2 pi w R of the largest sphere on a plate, against the load, or the weight of the lightest body.
        """
        if self.remarks or any(law.stage == "adhesion" or law.reach for law in self.choice.chain.laws):
            return [f"adhesion of {pair}: {text}" for pair, text, warns in self.remarks if warns]
        if math.isinf(load) and (gravity := self.scene.effects.gravity) is not None:
            load = float(np.min(self.state.bodies.mass)) * float(np.linalg.norm(gravity))
        pull = 1.5 * math.pi * ESTIMATE * float(self.radii.max())
        if not (0.0 < load < math.inf and pull > MATTERS * load):
            return []
        return [
            f"adhesion is off, but with a work of adhesion of {1e3 * ESTIMATE:.0f} mJ/m2 a contact would pull with up to "
            f"{pretty(pull, 'force')}, {pull / load:.2g} of the load on a body: effects.adhesion switches it on"
        ]

    @cached_property
    def heat(self) -> Heat | None:
        """Heat of the hottest pair: a sphere of median radius that slides at the top speed under the expected load.

        T = mu N v/(4 a (k_1 + k_2)): Holm 1948; Archard 1959, Wear 2, 438, Eq. 2, for slow sources; the Peclet number is
        v a/(2 kappa) of the slower side. None where no load or no speed is known.
        """
        speed = self.top_speed
        if self.upper.shared_overlap <= 0.0 or not 0.0 < speed < math.inf:
            return None
        a, heats = math.sqrt(self.upper.shared_overlap) * self.median, []
        for pair, load in zip(self.choice.pairs, self.spots.force.tolist(), strict=True):
            conductivities = [m.thermal_conductivity or CONDUCTIVITY for m in (pair.a, pair.b)]
            assumed = any(m.thermal_conductivity is None or m.heat_capacity is None for m in (pair.a, pair.b))
            # thermal diffusivity k/(rho c) [m2/s]
            slower = min(k / (m.density * (m.heat_capacity or CAPACITY))
                         for k, m in zip(conductivities, (pair.a, pair.b), strict=True))  # fmt: skip
            excess = pair.friction * load * speed / (4.0 * a * sum(conductivities))
            heats.append(Heat(excess, 0.5 * speed * a / slower, f"{pair.a.name}/{pair.b.name}", assumed))
        return max(heats)

    @cached_property
    def wear(self) -> Wear | None:
        """Wear of the pair that wears deepest: a sphere of median radius that slides on one spot until the end.

        h = k p s with the mean pressure p of Hertz under the expected load and the path s of the plate (Archard 1953, J. Appl.
        Phys. 24, 981, Eq. 4, with k = K/H). None where no load is known.
        """
        path, overlap = self.state.world.schedule.path(0.0, self.end), self.upper.shared_overlap
        if overlap <= 0.0 or not 0.0 < path < math.inf:
            return None
        area, deepest = math.pi * overlap * self.median * self.median, int(self.spots.force.argmax())
        depth, pair = WEAR_COEFFICIENT * float(self.spots.force[deepest]) / area * path, self.choice.pairs[deepest]
        return Wear(depth, depth / (overlap * self.median), f"{pair.a.name}/{pair.b.name}")

    def parts(self) -> list[dict[str, Any]]:
        """Return every effect and component of a built scene: `part`, `on`, `reason`."""
        rows = [*self._laws(), *self._effects(), *self._machinery()]
        return [{"part": part, "on": bool(on), "reason": reason} for part, on, reason in rows]

    def _laws(self) -> list[Part]:
        choice, scene = self.choice, self.scene
        rows = [(f"{law.stage}: {law.name}", True, f"of the level {choice.level}") for law in choice.chain.laws]
        if (memory := choice.memory) is not None:
            given = scene.contact.options.get(MEMORY.name, MEMORY.default) != MEMORY.default
            reason = "contact.memory" if given else why_swings(scene) or "no motion or load of a plate turns"
            rows.append((f"memory: {memory}", True, reason))
        rows += [(f"adhesion of {pair}", True, text) for pair, text, _ in self.remarks]
        return rows + [(name, False, "no pair requires it") for name in choice.off]

    def _effects(self) -> list[Part]:
        registry = discover()
        on = {effect.name for effect in self.choice.other_effects} | {law.name for law in self.choice.chain.laws}
        rows, reasons = [], {True: "the scene names it", False: "the scene does not name it"}
        for name, effect in registry.effects.items():
            if isinstance(effect, Law) and name in on:
                continue  # reported as a law
            reason = reasons[name in on]
            if name == "gravity" and name not in on and math.isfinite(self.weight):
                reason = f"weight/load = {self.weight:.1g}; effects.gravity switches it on"
            rows.append((f"effect: {name}", name in on, reason))
        for name in registry.measures:
            reason = reasons[name in self.measures]
            if name == HEAT and (heat := self.heat) is not None:
                reason += f"; a spot of {heat.pair} gets {heat.excess:.1g} K hotter at the top speed"
            if name == WEAR and (wear := self.wear) is not None:
                reason += f"; a spot of {wear.pair} that slides all the way wears by some {pretty(wear.depth, 'length')}"
            rows.append((f"measure: {name}", name in self.measures, reason))
        return rows

    def _machinery(self) -> list[Part]:
        choice, state, (fraction, distance) = self.choice, self.state, self.neighbours
        plate, meet = state.world.upper, state.world.debris_meets
        declared = self.scene.contact.debris_contact == "none"
        why = "bodies may meet" if meet else "contact.debris_contact = 'none'" if declared else "no two bodies can meet"
        spots = f"the nearest are {distance:.1f} contact radii apart: {100.0 * fraction:.1g} % of the overlap is neglected"
        if choice.interactions:
            spots = f"the scene names {choice.interactions[0].name}"
        elif fraction == 0.0:
            spots = "no two spots of a body are known to touch before the load comes"
        return [
            ("motion of bodies and their spheres", True, "always"),
            ("contact geometry", True, "always"),
            ("debris-debris contact", meet, why),
            ("labels", choice.labeller is not None, choice.labeller.name if choice.labeller else "no labeller is installed"),
            ("foundation", plate is not None and plate.foundation is not None, "plates.upper.support"),
            ("rolling resistance's moments", state.physics.moments, "a law of the stage rolling"),
            ("first yield", True, self._yield_reason()),
            ("elastic interaction of spots", len(state.physics.interaction) > 0, spots),
        ]

    def _yield_reason(self) -> str:
        """Return the highest peak pressure expected of a sphere of median radius, by pair, and how yield is treated."""
        choice, radius, expected = self.choice, self.median, ""
        given = [m.name for m in choice.materials if m.yield_strength]
        source = f"yield strength of {', '.join(given)} from the scene" if given else "yield strengths assumed, E/100"
        source += ", others assumed" if 0 < len(given) < len(choice.materials) else ""
        if self.upper.shared_overlap > 0.0 and (peak := float(self.spots.pressure.max())) > 0.0:
            expected = f"expected peak pressure {pretty(peak, 'pressure')}; "
        how = "contacts flow" if choice.physics.loss == "plastic" else "a warning, no plastic flow"
        onsets = []
        for pair, row in zip(choice.pairs, choice.rows, strict=True):
            modulus, limit = e_star(pair.a, pair.b), yield_limit(pair.a, pair.b)
            pressure = getattr(row[0], "yield_pressure", limit.pressure)  # of a plastic law: of its options
            softer = pair.a if pair.a.name == limit.material else pair.b
            speed = yield_speed(modulus, pressure, softer.density)
            onsets.append((yield_force(radius, modulus, pressure), speed, pressure, modulus, f"{pair.a.name}/{pair.b.name}"))
        force, speed, pressure, modulus, names = min(onsets)
        onset = "no material is known to yield"
        if pressure < modulus:
            where = f"on a sphere of {pretty(radius, 'length')} against a plane, or at {pretty(speed, 'velocity')} in its impact"
            onset = f"{names} yields at {pretty(pressure, 'pressure')}: from {pretty(force, 'force')} {where}"
        return f"{expected}{source}: {how}; {onset}"
