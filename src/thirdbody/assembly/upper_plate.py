"""Upper plate of a scene: patches, foundation, schedule, settling time, expected overlaps."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from thirdbody.assembly.contact_zone import cautions, contact_zone
from thirdbody.assembly.initial_relaxation import UNLOADED_OVERLAP
from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.assembly.placement import CLEARANCE
from thirdbody.assembly.plate_load import direct_contact, limit_words, narrow_gap_warning, times
from thirdbody.assembly.populate import plate_heights, sphere_centres
from thirdbody.assembly.schedule import first_load, schedule
from thirdbody.engine.guards import OVERLAP_GUARD
from thirdbody.engine.placed import Placed
from thirdbody.engine.upper_plate import Foundation, GapLaw, PatchedPlate, Zone
from thirdbody.errors import InputError
from thirdbody.kernels.tables import ONLY_LOWER
from thirdbody.laws.hertz import e_star, yield_limit
from thirdbody.scene.model import Scene
from thirdbody.scene.pressure import Profile, Uniform
from thirdbody.statics.contacts import load_at, overlap_at, response
from thirdbody.surfaces.surface import Surface
from thirdbody.units import pretty

Array = np.ndarray

MAX_HERTZ_OVERLAP = 0.1
"""Overlap over sphere radius above which Hertz' theory is only approximate: the contact radius is 0.3 of the radius."""

HANDFUL = 3
"""Largest number of loaded bodies, of a larger layer, with a warning: a rigid parallel plate rests on few stiff bodies."""

RELAXED = 12.0
"""Settling time of a foundation in relaxation times (dashpot over spring of a patch): the plate comes down in the first ones,
and after the others less than 1e-3 of the load is not yet shared."""


@dataclass(frozen=True)
class Upper:
    """Plate, settling time [s], and number of bodies that carry load initially.

    Overlaps over the radius: `overlap` with the whole load on the tallest body, which the plate touches first; `shared_overlap`
    with the load on all bodies that carry it initially.
    """

    plate: PatchedPlate | None
    settle: float = 0.0
    overlap: float = 0.0
    loaded: int = 0
    shared_overlap: float = 0.0


def upper_plate(
    scene: Scene, choice: CompiledPhysics, placed: Placed, warnings: list[str], surfaces: Mapping[str, Surface]
) -> Upper:
    """Return the upper plate of a scene, if any. Raises InputError for a gap that is too small or a table that is wrong."""
    plate = scene.plates.upper
    if plate is None:
        return Upper(None, 0.0 if isinstance(scene.solver.settle, str) else scene.solver.settle)
    layer = _Layer(scene, choice, placed, warnings, surfaces)
    if plate.support == "foundation":
        return layer.on_foundation()
    if plate.gap is not None:
        return layer.at_gap(plate.gap)
    return layer.each_loaded() if plate.support == "load_per_particle" else layer.rigid()


class _Layer:
    """Layer of bodies under the upper plate, not moved yet, and what the plate becomes on them.

    Of each body (n,): height of the plate at which it touches [m], radius of the sphere there [m], row of their pair, mass [kg].
    """

    def __init__(
        self, scene: Scene, choice: CompiledPhysics, placed: Placed, warnings: list[str], surfaces: Mapping[str, Surface]
    ) -> None:
        assert scene.plates.upper is not None
        self.scene, self.choice, self.placed, self.warnings, self.plate = scene, choice, placed, warnings, scene.plates.upper
        self.material = list(scene.materials).index(self.plate.material)
        centres, radii, body = sphere_centres(placed)
        touches = placed.sides() != ONLY_LOWER
        centres, radii, body = centres[touches], radii[touches], body[touches]
        heights = plate_heights(surfaces.get("upper"), centres, radii)
        order = np.lexsort((heights, body))
        highest = order[np.append(np.flatnonzero(np.diff(body[order])), len(body) - 1)]
        self.top, self.radius = heights[highest], radii[highest]
        self.kind = choice.physics.kinds[placed.materials, self.material]
        self.mass = placed.densities * np.array([clump.volume for clump in placed.clumps])
        self.direct: GapLaw | None = direct_contact(scene, choice, surfaces)
        self.load = first_load(scene)
        self.largest = max(schedule(scene, 0.0).largest_load(), 1.0)  # load of the run over the first one

    def at_gap(self, gap: float) -> Upper:
        """Return a rigid plate at a prescribed height [m]."""
        scene, tallest = self.scene, int(np.argmax(self.top))
        remaining = UNLOADED_OVERLAP * self.radius[tallest] if scene.solver.initial_overlap == "relax" else 0.0
        if self.top[tallest] > gap * (1.0 + 2.0 * CLEARANCE) + remaining:
            message = (
                f"{pretty(gap, 'length')} is smaller than body {tallest}, which is "
                f"{pretty(float(self.top[tallest]), 'length')} tall: it would start inside the plate; "
                f"solver.initial_overlap = '{scene.solver.initial_overlap}'"
            )
            raise InputError(scene.fault(("plates", "upper", "gap"), message))
        if scene.plates.moving():
            self.warnings.append(
                "at constant gap a tipping particle wedges and its normal force has no bound; a load lets it tip"
            )
        settle = 0.0 if isinstance(scene.solver.settle, str) else scene.solver.settle
        patch, zero, mass = np.zeros(len(self.top), np.int64), np.zeros(1), np.full(1, self.plate.mass or self.mass.sum())
        plate = PatchedPlate(self.material, np.array([gap]), mass, zero, zero, False, patch, schedule(scene, settle))
        return Upper(plate, settle)

    def each_loaded(self) -> Upper:
        """Return a plate with one free patch per body."""
        n, zone, loads = len(self.top), None, np.full(len(self.top), self.load)
        if self.plate.profile is not None:
            zone, loads = self._by_position(self.plate.profile)
        load, mass = float(loads.max()), np.full(n, self.plate.mass or self.mass.mean())
        # a patch that carries nothing yet has the dashpot of the most loaded one
        pressed = np.full(n, load)
        overlap, dashpot = self._pressed(np.arange(n), pressed, mass)
        self.refuse_crushing(np.arange(n), load * self.largest)
        self._warn_pressed(np.arange(n), pressed * self.largest, overlap)
        settle = self._settle(mass, dashpot, load)
        self._warn_dashpot(settle, dashpot)
        heights, motion = self.top + CLEARANCE * self.radius + (0.0 if zone is None else zone.gaps), schedule(self.scene, settle)
        plate = PatchedPlate(self.material, heights, mass, dashpot, loads, True, np.arange(n), motion, zone=zone)
        max_overlap = float(np.max(overlap / self.radius))
        return Upper(plate, settle, max_overlap, int(np.count_nonzero(loads)), max_overlap)

    def _by_position(self, profile: Profile) -> tuple[Zone, Array]:
        """Return the contact of the first bodies, and the load of each body [N]."""
        scene, lower, direct = self.scene, self.scene.plates.lower, self.scene.plates.contact
        assert lower is not None
        materials, labeller = dict(zip(scene.materials, self.choice.materials, strict=True)), self.choice.labeller
        modulus, positions = e_star(materials[lower.material], materials[self.plate.material]), self.placed.positions[:, :2]
        zone, loads = contact_zone(scene, profile, modulus, positions)
        if not np.any(loads):
            raise InputError(scene.fault(("plates", "upper", "pressure"), "no body is inside the contact"))
        largest = max(clump.diameter for clump in self.placed.clumps)
        self.warnings += cautions(zone, loads, float(self.top.max()), largest)
        if direct is None and self.plate.motion.moving():
            self.warnings.append(
                "what bodies that leave the contact carried is carried without friction: "
                "plates.contact = {friction = ...} gives the friction of the plates on each other"
            )
        if scene.effects.gravity is None and not isinstance(profile, Uniform) and self.plate.motion.moving():
            self.warnings.append(
                "nothing stops bodies outside the contact: they go on at the velocity with which they left it; with "
                'effects.gravity = ["0 m/s2", "0 m/s2", "-9.81 m/s2"] they soon rest'
            )
        codes = (len(labeller.states) - 1, len(labeller.reasons) - 1) if labeller else (0, 0)
        return replace(zone, friction=0.0 if direct is None else direct.friction, out=codes), loads

    def rigid(self) -> Upper:
        """Return one free, parallel plate; the tallest body carries the whole load at first, or direct contact of the plates."""
        load, direct, n = self.load, self.direct, len(self.top)
        tallest, maximum = np.array([int(np.argmax(self.top))]), load * self.largest
        loads, mass = np.full(1, load), np.full(1, self.plate.mass or self.mass.sum())
        overlap, dashpot = self._pressed(tallest, loads, mass)
        if direct is None:
            self.refuse_crushing(np.arange(n), maximum, n)
        # contacts of the bodies that share the load, if the bodies did not move
        level = self._level(self._force, maximum)
        force, carried = self._force(level), maximum - (direct.force(level) if direct else 0.0)
        on = np.flatnonzero(force > 0.0) if np.any(force > 0.0) else tallest
        fraction = force[on] * (carried / force[on].sum()) if force[on].sum() > 0.0 else np.full(1, max(carried, 0.0))
        common = overlap_at(self.choice.physics, fraction, self.radius[on], self.kind[on])
        self._warn_pressed(on, fraction, common)
        self.warnings += narrow_gap_warning(direct, level)
        height, loaded = self.top[tallest] + CLEARANCE * self.radius[tallest], 0
        if direct is not None and direct.gap(load) > height[0]:  # no body touches the plate
            height = np.full(1, direct.gap(load))
            if self.plate.damping is None:
                dashpot = 2.0 * np.sqrt(load / direct.length * mass)
        else:
            loaded = max(1, int(np.count_nonzero(self._force(self._level(self._force, load)))))
        settle = self._settle(mass, dashpot, load)
        if loaded <= HANDFUL < n and direct is None:
            self.warnings.append(
                f"a rigid flat plate, kept parallel, rests on about {loaded} of {n} bodies: they are stiff and of "
                'different height; support = "foundation" or "load_per_particle" shares the load'
            )
        self._warn_dashpot(settle, dashpot)
        patch, motion = np.zeros(n, np.int64), schedule(self.scene, settle)
        plate = PatchedPlate(self.material, height, mass, dashpot, loads, True, patch, motion, direct=direct)
        shared_overlap = float(np.max(common / self.radius[on]))
        return Upper(plate, settle, float(overlap[0] / self.radius[tallest[0]]), loaded, shared_overlap)

    def on_foundation(self) -> Upper:
        """Return a plate of one patch per body, with springs to a common plate under a load or at a height."""
        given, direct, load, n = self.plate, self.direct, self.load, len(self.top)
        assert given.stiffness is not None
        stiffness, preload, automatic = given.stiffness, given.preload or 0.0, isinstance(self.scene.solver.settle, str)
        highest = float(self.top.max())
        height = given.gap if given.gap is not None else highest if direct is None else max(highest, direct.gap(load))
        # a patch without a body hangs preload/stiffness below the plate
        springs = lambda z: np.maximum(stiffness * (self.top - z) + preload, 0.0)  # noqa: E731
        level = height if given.gap is not None else self._level(springs, load + n * preload)
        carried = springs(level)
        self.warnings += narrow_gap_warning(direct, level)
        on, largest = np.flatnonzero(carried), np.array([int(np.argmax(carried))])
        mass, load_fraction = np.full(n, given.mass or self.mass.mean()), np.maximum(carried[largest], 1e-300)
        overlap, dashpot = self._pressed(largest, load_fraction, mass[:1])
        self.refuse_crushing(largest, float(load_fraction[0] * self.largest))
        if len(on):
            loads = carried[on] * self.largest
            self._warn_pressed(on, loads, overlap_at(self.choice.physics, loads, self.radius[on], self.kind[on]))
        total, whole = float(mass.sum()), n * stiffness + (load / direct.length if direct else 0.0)
        common = Foundation(stiffness, height, total, 2.0 * math.sqrt(whole * total), load, free=given.gap is None)
        settle = 0.0  # a plate that has not come down yet presses on no body
        if not automatic or (len(on) and carried[largest[0]] > 0.0):
            settle = self._settle(mass, dashpot, float(load_fraction[0]))
        if automatic and settle > 0.0:
            settle = max(settle, RELAXED * float(dashpot[0]) / stiffness)
        heights, motion = np.maximum(height, self.top) + CLEARANCE * self.radius, schedule(self.scene, settle)
        loads, dashpots = np.full(n, preload), np.full(n, dashpot[0])
        plate = PatchedPlate(self.material, heights, mass, dashpots, loads, True, np.arange(n), motion, common, direct)
        max_overlap = float(overlap[0] / self.radius[largest[0]])
        return Upper(plate, settle, max_overlap, len(on), max_overlap)

    def _pressed(self, who: Array, loads: Array, mass: Array) -> tuple[Array, Array]:
        """Return overlaps [m] of the highest spheres under the largest load, and the dashpots [kg/s].

        By default a dashpot is critical with the contact stiffness under the first load.
        """
        physics, radius, kind = self.choice.physics, self.radius[who], self.kind[who]
        overlap = overlap_at(physics, loads, radius, kind)
        max_overlap = overlap if self.largest <= 1.0 else overlap_at(physics, self.largest * loads, radius, kind)
        if self.plate.damping is not None:
            return max_overlap, np.full(len(who), self.plate.damping)
        stiffness = response(physics, overlap, radius, kind).stiffness
        if not np.all(np.isfinite(stiffness)):
            message = 'needs a value, such as "2e-4 kg/s": without a tangent of the laws critical damping is not known'
            raise InputError(self.scene.fault(("plates", "upper", "damping"), message))
        return max_overlap, 2.0 * np.sqrt(stiffness * mass)

    def refuse_crushing(self, who: Array, load: float, n_sharing: int = 1) -> None:
        """Raise InputError if even the strongest contacts of these bodies would exceed the guard's overlap.

        `load` [N] is the value in the scene; `n_sharing` bodies carry it together at best.
        """
        radius = self.radius[who]
        forces = response(self.choice.physics, OVERLAP_GUARD * radius, radius, self.kind[who]).force
        allowed = float(forces.min()) if n_sharing == 1 else float(forces.mean()) * n_sharing
        if load <= allowed:
            return
        key = next(key for key in ("load", "pressure", "gap") if getattr(self.plate, key) is not None)  # of the largest load
        on = "each body" if n_sharing == 1 else f"all {n_sharing} bodies together"
        message = (
            f"adhesion alone presses contacts in by more than {OVERLAP_GUARD:g} of the radius, where the overlap guard stops a "
            "run, under any load; lower the work of adhesion, or take stiffer or larger bodies"
            if allowed <= 0.0
            else f"{pretty(load, 'force')} on {on} would press contacts in by more than {OVERLAP_GUARD:g} of the radius, where "
            f"the overlap guard stops a run; allowed: at most {pretty(allowed, 'force')} on {on}, or stiffer or larger bodies"
        )
        raise InputError(self.scene.fault(("plates", "upper", key), message))

    def _warn_pressed(self, who: Array, load: Array, overlap: Array) -> None:
        """Warn of deep contacts, and of peak pressures above first yield by pair of materials, under loads (n,) [N]."""
        radius, kind, physics = self.radius[who], self.kind[who], self.choice.physics
        depth = overlap / radius
        deepest = int(np.argmax(depth))
        if depth[deepest] > MAX_HERTZ_OVERLAP:
            self.warnings.append(
                f"expected overlap {depth[deepest]:.2g} of the radius under {pretty(float(load[deepest]), 'force')}: Hertz' "
                f"theory is for small contacts (below {MAX_HERTZ_OVERLAP:g}), and a run stops at {OVERLAP_GUARD:g}; lower the "
                "load or use stiffer bodies"
            )
        if physics.loss == "plastic":
            return
        pressure = response(physics, overlap, radius, kind).pressure
        for k, pair in enumerate(self.choice.pairs):
            here, limit = np.flatnonzero(kind == k), yield_limit(pair.a, pair.b)
            worst = here[[np.argmax(pressure[here])]] if len(here) else here
            if not np.any(pressure[worst] > limit.pressure):
                continue
            peak, allowed = float(pressure[worst[0]]), load_at(physics, np.array([limit.pressure]), radius[worst], kind[worst])
            self.warnings.append(
                f"{pair.a.name}/{pair.b.name}: expected peak pressure {pretty(peak, 'pressure')}, {times(peak / limit.pressure)} "
                f"{limit_words(limit.material, limit.pressure, limit.strength, limit.assumed)}: it would flow, but is computed "
                f"as elastic; at most {pretty(float(allowed[0]), 'force')} on such a contact or harder materials keep it so, "
                "[effects.elastic_plastic] lets it flow"
            )

    def _force(self, z: float) -> Array:
        """Return the normal force (n,) [N] of a plate at height z [m]."""
        overlap = np.maximum(self.top - z, 0.0)
        return np.where(overlap > 0.0, response(self.choice.physics, overlap, self.radius, self.kind).force, 0.0)

    def _level(self, force: Callable[[float], Array], load: float) -> float:
        """Return the height [m] at which a plate carries a load [N] by a force and direct contact, by bisection; negative for
        very soft springs."""
        low, high, direct = 0.0, float(self.top.max()), self.direct
        if direct is not None and direct.gap(load) >= high:  # no body reaches the plate
            return direct.gap(load)

        def total(z: float) -> float:
            return float(np.sum(force(z) if direct is None else np.append(force(z), direct.force(z))))

        while total(low) < load and low > -1e6 * high:
            low = 2.0 * low - high
        for _ in range(80):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if total(middle) > load else (low, middle)
        return high

    def _settle(self, mass: Array, dashpot: Array, load: float) -> float:
        """Return the settling time [s]; by default that in which a patch falls by 1/4 of the largest body.

        A body that is loaded off its balance tips into a new position, and its patch comes down by about that distance; a bed of
        several layers is compacted by about a tenth of its height.
        """
        if not isinstance(self.scene.solver.settle, str):
            return self.scene.solver.settle
        if not self.scene.plates.driven():
            return 0.0
        distance = max(0.25 * max(clump.diameter for clump in self.placed.clumps), 0.1 * float(self.top.max()))
        return math.sqrt(2.0 * distance * (self.mass.max() + mass.max()) / load) + float(dashpot.max()) * distance / load

    def _warn_dashpot(self, settle: float, dashpot: Array) -> None:
        fraction = float(dashpot.max()) * schedule(self.scene, settle).top_speed() / self.load
        if fraction > 1.0:
            enough = pretty(float(dashpot.max()) / fraction, "damping")
            self.warnings.append(
                f"the patches' dashpot carries up to {fraction:.1f} times the load when they rise or fall at the drag speed: the "
                "motion is not quasi-static, and what bodies that roll should rub the dashpots take; a motion "
                f'{fraction:.2g} times slower or plates.upper.damping = "{enough}" leaves them no more than the load'
            )
