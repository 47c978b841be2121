"""Scene -> running simulation: the only file that knows all parts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..engine.explicit import Explicit
from ..engine.probe import overlap_at, response
from ..engine.state import Placed, State, UpperPlate, World, assemble
from ..errors import InputError
from ..kernels import layout as at
from ..laws.contract import Labeller
from ..laws.elasticity import dundurs_beta
from ..laws.registry import Registry, discover
from . import units
from .choose import Choice, choose
from .model import Scene
from .populate import CLEARANCE, populate, sphere_centres

SKIN = 0.15
"""Search skin over the mean sphere radius: rare searches, few idle candidates (measured optimum .1 to .2)."""

STEPS = 1e13
"""Steps that no machine takes in a year; the clock would soon not notice such a step at all."""

MISMATCH = 0.02
"""Dundurs' beta above which the decoupling of normal and tangential contact is told to be an approximation."""


@dataclass
class Simulation:
    """A scene ready to run, and what `check` prints of it."""

    scene: Scene
    choice: Choice
    labeller: Labeller | None
    state: State
    integrator: Explicit
    settle: float
    expected_overlap: float
    warnings: list[str]

    @property
    def end_time(self) -> float:
        """Time at which a run by duration ends, s; infinite for a run by distance."""
        duration = self.scene.solver.duration
        return math.inf if duration is None else self.settle + duration

    @property
    def end_distance(self) -> float:
        """Sliding distance at which a run by distance ends, m; infinite for a run by duration."""
        distance = self.scene.solver.distance
        return math.inf if distance is None else distance

    @property
    def speed(self) -> float:
        """Speed of the upper plate, m/s."""
        upper = self.scene.plates.upper
        return 0.0 if upper is None else math.hypot(*upper.motion.velocity())

    @property
    def planned_time(self) -> float:
        """Simulated time of the whole run, s."""
        return self.end_time if math.isfinite(self.end_time) else self.settle + self.end_distance / self.speed


def build(scene: Scene, registry: Registry | None = None, force: bool = False) -> Simulation:
    """Everything of the scene, compiled and in place at time zero. Raises InputError with what cannot work.

    `force` lets a fixed time step exceed its bound.
    """
    registry = registry or discover()
    choice = choose(scene, registry)
    labeller = choice.labeller
    placed = populate(scene)
    warnings = _similarity_warnings(choice)
    upper, settle, expected = _upper_plate(scene, choice, placed, warnings)
    names = list(scene.materials)
    lower = None if scene.plates.lower is None else names.index(scene.plates.lower.material)
    meets = scene.contact.debris_contact == "auto" and len(placed.clumps) > 1
    bounded = not scene.domain.periodic and lower is not None
    world = World(scene.domain.size, scene.domain.periodic, bounded, lower, upper, meets)
    radii = np.concatenate([clump.radii for clump in placed.clumps])
    state = assemble(placed, world, choice.physics, SKIN * float(radii.mean()))
    _refuse_narrow_domain(scene, state)
    fixed = None if isinstance(scene.solver.time_step, str) else scene.solver.time_step
    integrator = Explicit(state, list(choice.materials), fixed, force=force)
    integrator.start()
    if fixed is not None and not force:
        _refuse_large_step(scene, integrator, fixed)
    simulation = Simulation(scene, choice, labeller, state, integrator, settle, expected, warnings)
    if fixed is not None:
        _refuse_tiny_step(simulation, fixed)
    return simulation


def _similarity_warnings(choice: Choice) -> list[str]:
    warnings = []
    for pair in choice.pairs:
        beta = dundurs_beta(pair.a, pair.b)
        if abs(beta) > MISMATCH:
            warnings.append(
                f"{pair.a.name}/{pair.b.name} are not elastically similar (Dundurs beta {beta:+.3f}): "
                "normal and tangential contact are coupled there, which Hertz-Mindlin theory neglects"
            )
    return warnings


def _upper_plate(scene: Scene, choice: Choice, placed: Placed, warnings: list[str]) -> tuple[UpperPlate | None, float, float]:
    """The upper plate with its defaults, the settling time, and the expected overlap over the radius."""
    plate = scene.plates.upper
    if plate is None:
        return None, 0.0, 0.0
    names = list(scene.materials)
    material = names.index(plate.material)
    top, radius = _tops(placed)
    kind = choice.physics.kinds[placed.materials, material]
    velocity = plate.motion.velocity()
    n = len(top)
    single = plate.support == "load_per_particle"
    patch = np.arange(n) if single else np.zeros(n, np.int64)
    if plate.gap is not None:
        _refuse_small_gap(scene, plate.gap, top)
        zero = np.zeros(1)
        return UpperPlate(material, np.array([plate.gap]), np.ones(1), zero, zero, False, patch, velocity), 0.0, 0.0
    load = plate.load if plate.load is not None else (plate.pressure or 0.0) * scene.domain.size[0] * scene.domain.size[1]
    masses = placed.densities * np.array([clump.volume for clump in placed.clumps])
    # a rigid flat plate comes down on the tallest body, which carries the load at first
    first = np.arange(n) if single else np.array([int(np.argmax(top))])
    loads = np.full(len(first), load)
    overlap = overlap_at(choice.physics, loads, radius[first], kind[first])
    expected = float(np.max(overlap / radius[first]))
    _warn_pressure(choice, loads, overlap, radius[first], kind[first], warnings)
    mass = np.full(len(first), plate.mass if plate.mass is not None else (masses.mean() if single else masses.sum()))
    damping = plate.damping
    if damping is None:
        stiffness = response(choice.physics, overlap, radius[first], kind[first])[1]
        if not np.all(np.isfinite(stiffness)):
            message = "needs a value: the normal law has no tangent to find the critical damping from"
            raise InputError(scene.fault(("plates", "upper", "damping"), message))
        dashpot = 2.0 * np.sqrt(stiffness * mass)
    else:
        dashpot = np.full(len(first), damping)
    heights = (top if single else np.array([top.max()])) + CLEARANCE * radius[first]
    settle = _settle(scene, placed, masses, mass, dashpot, load)
    _warn_dashpot(dashpot, load, math.hypot(*velocity), warnings)
    if not single and n > 3:
        warnings.append(
            "a rigid flat plate on one layer of stiff bodies of different sizes rests on one of them (kept parallel); "
            'support = "load_per_particle" loads every body'
        )
    return UpperPlate(material, heights, mass, dashpot, loads, True, patch, velocity, settle), settle, expected


def _tops(placed: Placed) -> tuple[np.ndarray, np.ndarray]:
    """Height of the highest point of each body and the radius of its sphere there, m."""
    centres, radii, body = sphere_centres(placed)
    order = np.lexsort((centres[:, 2] + radii, body))
    last = np.append(np.flatnonzero(np.diff(body[order])), len(body) - 1)
    highest = order[last]
    return centres[highest, 2] + radii[highest], radii[highest]


def _settle(scene: Scene, placed: Placed, masses, mass, dashpot, load: float) -> float:
    """Time under load before the drag, s. Automatic: what a patch needs to fall by a quarter of the largest body's size.

    A body that is pressed off its balance tips into a new seat, and its patch comes down by about that much.
    """
    if not isinstance(scene.solver.settle, str):
        return scene.solver.settle
    if not scene.plates.moving():
        return 0.0
    way = 0.25 * max(clump.diameter for clump in placed.clumps)
    return math.sqrt(2.0 * way * (masses.max() + mass.max()) / load) + float(dashpot.max()) * way / load


def _warn_pressure(choice: Choice, load, overlap, radius, kind, warnings: list[str]) -> None:
    """First yield under a sphere at p0 = 1.6 Y (Johnson 1985, Eq. 4.35); told when the scene gives Y."""
    p0 = 1.5 * load / (math.pi * radius * overlap)
    for k, pair in enumerate(choice.pairs):
        soft = min((m.yield_strength for m in (pair.a, pair.b) if m.yield_strength), default=None)
        here = p0[kind == k]
        if soft is not None and len(here) and here.max() > 1.6 * soft:
            warnings.append(
                f"{pair.a.name}/{pair.b.name}: Hertz pressure {units.pretty(float(here.max()), 'pressure')} exceeds first yield "
                f"({units.pretty(1.6 * soft, 'pressure')}): contacts are computed as elastic all the same"
            )


def _warn_dashpot(dashpot, load: float, speed: float, warnings: list[str]) -> None:
    share = float(dashpot.max()) * speed / load
    if share > 1.0:
        warnings.append(
            f"the patches' dashpot carries up to {share:.1f} of the load when they rise or fall at the drag speed: "
            "the motion is not quasi-static; lower plates.upper.damping or the speed"
        )


def _refuse_small_gap(scene: Scene, gap: float, top: np.ndarray) -> None:
    tallest = int(np.argmax(top))
    if top[tallest] > gap * (1.0 + 1e-9):
        message = (
            f"{units.pretty(gap, 'length')} is smaller than body {tallest}, which is "
            f"{units.pretty(float(top[tallest]), 'length')} tall: it would start inside the plate; initial_overlap = 'refuse'"
        )
        raise InputError(scene.fault(("plates", "upper", "gap"), message))


def _refuse_narrow_domain(scene: Scene, state: State) -> None:
    """Nearest images are unique only if a period is wider than twice the longest reach."""
    if not scene.domain.periodic or not state.world.debris_meets:
        return
    reach = 2.0 * float(state.S[:, at.S_R].max()) + state.skin
    if min(scene.domain.size) < 2.0 * reach:
        message = f"a periodic side must be at least {units.pretty(2.0 * reach, 'length')}, twice the reach of the largest sphere"
        raise InputError(scene.fault(("domain", "size"), message))


def _refuse_large_step(scene: Scene, integrator: Explicit, step: float) -> None:
    bound = integrator.bound
    assert bound is not None
    limit = min(bound.rayleigh, bound.stability)
    if step > limit:
        what = "Rayleigh time" if limit == bound.rayleigh else "stability limit"
        message = (
            f"{units.pretty(step, 'time')} is above the bound {units.pretty(limit, 'time')} ({what} of body {bound.body}); "
            f'"auto" would take {units.pretty(bound.step, "time")}; --force runs it all the same'
        )
        raise InputError(scene.fault(("solver", "time_step"), message))


def _refuse_tiny_step(simulation: Simulation, step: float) -> None:
    steps = simulation.planned_time / step
    if steps > STEPS:
        scene, bound = simulation.scene, simulation.integrator.bound
        assert bound is not None
        message = (
            f"{units.pretty(step, 'time')} would take {steps:.2g} steps for {units.pretty(simulation.planned_time, 'time')}; "
            f'"auto" would take {units.pretty(bound.step, "time")}'
        )
        raise InputError(scene.fault(("solver", "time_step"), message))
