"""From a scene to a simulation that can be integrated: the only module that imports all components."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from thirdbody import units
from thirdbody.assembly.bed import Bed, SpeedScale, at_computed_speed, bed_of, fast_bed_warnings, refuse_scale, speed_scale
from thirdbody.assembly.cautions import Expected, motion_warnings, similarity_warnings
from thirdbody.assembly.initial_relaxation import RelaxedStart, relax_start
from thirdbody.assembly.integrator import Plan, examine_inertia, implicit, plan, units_of
from thirdbody.assembly.physics import CompiledPhysics, compile_physics
from thirdbody.assembly.populate import populate
from thirdbody.assembly.schedule import schedule
from thirdbody.assembly.surfaces import SurfaceScales, plate_surfaces, surface_scales, with_flat_surfaces, with_surfaces
from thirdbody.assembly.upper_plate import Upper, upper_plate
from thirdbody.engine.placed import in_columns
from thirdbody.engine.state import State, World, assemble
from thirdbody.engine.upper_plate import Schedule
from thirdbody.engine.wear import Wear
from thirdbody.errors import InputError
from thirdbody.kernels.tables import EVERYTHING
from thirdbody.laws.contract import Labeller
from thirdbody.laws.registry import Registry, discover
from thirdbody.scene.checks import too_long, too_long_message, unusual_values
from thirdbody.scene.model import Scene
from thirdbody.surfaces.surface import Surface

if TYPE_CHECKING:
    from thirdbody.engine.explicit import Explicit
    from thirdbody.engine.implicit import Implicit

SKIN = 0.12
"""Search skin over the mean sphere radius: rare searches, few idle candidates (measured optimum 0.1 to 0.2)."""

STEPS = 1e13
"""Largest number of steps of a run: with more, one step nears the rounding of the clock."""

SPHERE_STEP, PATIENCE = 1e-7, 90 * 86400.0
"""Approximate seconds per sphere and step; and the longest run [s] that starts without --force."""

MAX_FRAMES = 1_000_000
"""Largest number of outputs of a run: more would fill any disk."""

EXTENSIONS = 8
"""Parts of the expected settling time by which settling may be extended, one by one."""


@dataclass
class Simulation:
    """Scene, state, integrator and compiled physics, ready to run, with the warnings for `check`.

    `scene` has the speed at which it is computed, `requested` the one that was given: files and texts hold the latter. `bed`: the
    debris between two plates, where bodies meet. `extended`: by how many parts of its expected time settling was extended so far.
    """

    scene: Scene
    requested: Scene
    choice: CompiledPhysics
    labeller: Labeller | None
    state: State
    integrator: Explicit | Implicit
    plan: Plan
    upper: Upper
    warnings: list[str]
    force: bool = False
    relaxed: RelaxedStart | None = None
    bed: Bed | None = None
    speed_scale: SpeedScale | None = None
    surfaces: dict[str, Surface] = field(default_factory=dict)
    extended: int = 0

    @cached_property
    def surface_scales(self) -> dict[str, SurfaceScales]:
        """Scales of the rough plates against the debris, by side."""
        return surface_scales(self.surfaces, float(self.state.spheres.radius.max()), self.upper.shared_overlap)

    @property
    def settle(self) -> float:
        """Time under load before the motion starts [s]; until the end of settling is found, the earliest end."""
        return self.settle_after(self.extended)

    def settle_after(self, extended: float) -> float:
        """Return the settling time after so many extensions [s]."""
        return self.upper.settle * (1.0 + extended / EXTENSIONS)

    def extend_settling(self, extended: int) -> None:
        """Let settling last longer by so many parts in all: motion, loading and what ends with settling move with its end."""
        self.extended, plate = extended, self.upper.plate
        assert plate is not None
        for name in ("planned_time", "planned_distance"):
            self.__dict__.pop(name, None)
        plate = replace(plate, schedule=schedule(self.scene, self.settle))
        self.upper, self.state.world = replace(self.upper, plate=plate), replace(self.state.world, upper=plate)
        self.state.schedule[:] = plate.schedule.tables()[0]
        if not self.integrator.divisible:
            cast("Implicit", self.integrator).schedule = plate.schedule
        _end_settling(self.scene, self.choice, self.settle)

    @property
    def schedule(self) -> Schedule:
        """Prescribed motion and load of the upper plate."""
        return Schedule() if self.upper.plate is None else self.upper.plate.schedule

    @property
    def end_time(self) -> float:
        """Time at which a run by duration ends [s]; infinite for a run by distance."""
        duration = self.scene.solver.duration
        return math.inf if duration is None else self.settle + duration

    @property
    def end_distance(self) -> float:
        """Sliding distance at which a run by distance ends [m]; infinite for a run by duration."""
        distance = self.scene.solver.distance
        return math.inf if distance is None else distance

    @cached_property
    def planned_time(self) -> float:
        """Simulated time of the whole run [s]; infinite if the motion ends before the distance is reached."""
        return self.end_time if math.isfinite(self.end_time) else self.schedule.time_of(self.end_distance, self.settle)

    @cached_property
    def planned_distance(self) -> float:
        """Sliding distance of the whole run [m]."""
        return self.end_distance if math.isfinite(self.end_distance) else self.schedule.path(self.settle, self.end_time)

    @property
    def time_scale(self) -> float:
        """Time of the scene as it was given over computed time, during the drag."""
        return self.speed_scale.factor if self.speed_scale else 1.0

    def scene_time(self, time: float) -> float:
        """Return the time [s] in the scene as it was given, at a computed time; they are the same until the end of settling."""
        return time if time <= self.settle else self.settle + (time - self.settle) * self.time_scale

    @property
    def expected(self) -> Expected:
        """What the state at the start leads to expect: `warnings` that `check` gives besides, and `parts`, on or off and why."""
        return Expected(self.scene, self.choice, self.state, self.upper, self.planned_time)

    @property
    def announcement(self) -> list[str]:
        """What a run says before it starts: an integrator that expected steps decided, a speed that is not that of the scene."""
        lines = [f"integrator {self.plan.kind}: {self.plan.reason}"] if self.plan.matters else []
        return [*lines, f"speed: {self.speed_scale}"] if self.speed_scale else lines

    @property
    def shortest_interval(self) -> float:
        """Output interval below which frames are one step apart [s or m]; 0 where steps end at every output."""
        if not self.integrator.divisible:
            return 0.0
        by_time, drag = self.scene.output.every_kind == "time", self.planned_time - self.settle
        return self.state.dt if by_time else self.planned_distance * self.state.dt / drag


def build(
    scene: Scene, registry: Registry | None = None, force: bool = False,
    ready: Callable[[Sequence[str]], None] = lambda units: None, before: str = "",
) -> Simulation:  # fmt: skip
    """Build the simulation of a scene, compiled and at time zero. Raises InputError for a scene that cannot run.

    `force` lets a fixed time step exceed its bound. `ready` is called once the integrator is chosen, with the units that it needs
    (`engine.units`), before they are called. `before`: the integrator with which a run began.
    """
    registry = registry or discover()
    choice = compile_physics(scene, registry)
    rough = with_flat_surfaces(scene, plate_surfaces(scene), choice)
    notes = (f"{side} plate: {note}" for side, surface in rough.items() for note in surface.notes)
    warnings = [*unusual_values(scene.materials, scene.pairs), *notes, *similarity_warnings(choice)]
    if choice.physics.stiffness is None:
        bare = ", ".join(choice.chain.without_tangent)
        warnings.append(f"{bare} has no tangent: the time step follows from the Rayleigh time alone")
    placed, relaxed = relax_start(scene, choice, populate(scene, warnings, rough))
    warnings += [relaxed.text(len(placed.clumps))] if relaxed else []
    # bodies given by spots touch plates only
    meet = sum(clump.sides is None or bool(np.any(clump.sides == EVERYTHING)) for clump in placed.clumps)
    debris_contact = scene.contact.debris_contact == "auto" and meet > 1
    order = np.arange(len(placed.clumps))
    if debris_contact:
        diameters = np.cbrt([6.0 / math.pi * clump.volume for clump in placed.clumps])
        order = in_columns(placed.positions, float(np.mean(diameters)))
    placed = placed.reordered(order)
    requested, bed = scene, bed_of(scene, choice, placed) if debris_contact else None
    scale = speed_scale(scene, choice, bed)
    scene = at_computed_speed(scene, scale)
    upper = upper_plate(scene, choice, placed, warnings, rough)
    _end_settling(scene, choice, upper.settle)
    lower = None if scene.plates.lower is None else list(scene.materials).index(scene.plates.lower.material)
    domain, bounded = scene.domain, scene.domain.bounded and lower is not None
    ends = domain.walls is not None, domain.ends == "open_x"
    world = World(domain.size, domain.periodic, bounded, lower, upper.plate, debris_contact, *ends)
    world, radii = with_surfaces(world, rough), np.concatenate([clump.radii for clump in placed.clumps])
    state = assemble(placed, world, choice.physics, SKIN * float(radii.mean()), order, choice.reach(float(radii.max())))
    state.wear = Wear(state, rough, scene.plates.wear.times) if scene.plates.wear else None
    _refuse_narrow_domain(scene, state)
    chosen = plan(scene, choice, state, upper, before)
    ready(units_of(chosen, state))
    warnings += [*_bed_warnings(scene, state, chosen), *examine_inertia(scene, state)]
    warnings += motion_warnings(scene, choice, state)
    integrator: Explicit | Implicit
    if chosen.kind == "implicit":
        refuse_scale(scene, scale)
        integrator = implicit(scene, choice, state, upper, warnings)
    else:
        warnings += fast_bed_warnings(scene, bed) if bed else []
        integrator = _explicit(scene, choice, state, force)
    simulation = Simulation(
        scene, requested, choice, choice.labeller, state, integrator, chosen, upper, warnings, force, relaxed, bed, scale, rough
    )  # fmt: skip
    _examine_length(simulation)
    warnings += [text for side, scales in simulation.surface_scales.items() for text in scales.warnings(side)]
    if chosen.kind == "explicit":
        _refuse_endless(simulation, force)
    return simulation


def _explicit(scene: Scene, choice: CompiledPhysics, state: State, force: bool) -> Explicit:
    # imported here, as is the implicit one: a run loads one of them
    from thirdbody.engine.explicit import Explicit

    choice.set_parameters("explicit")
    step = None if isinstance(scene.solver.time_step, str) else scene.solver.time_step
    integrator = Explicit(state, list(choice.materials), step, force=force)
    integrator.start()
    if step is None or force:
        return integrator
    bound = integrator.bound
    assert bound is not None
    limit = min(bound.rayleigh, bound.stability)
    if step > limit:
        what = "Rayleigh time" if limit == bound.rayleigh else "stability limit"
        message = (
            f"{units.pretty(step, 'time')} is above the bound {units.pretty(limit, 'time')} ({what} of body {bound.body}); "
            f'"auto" would take {units.pretty(bound.step, "time")}'
        )
        fault = scene.fault(("solver", "time_step"), message)
        remedy = " runs it all the same"
        raise InputError(fault._replace(python=f"; force=True{remedy}", command=f"; --force{remedy}"))
    return integrator


def _end_settling(scene: Scene, choice: CompiledPhysics, settle: float) -> None:
    passing = [effect.name for effect in choice.effects if effect.settling]
    if not passing:
        return
    if settle <= 0.0:
        message = 'acts while the debris settles, and this scene has no such phase: give solver.settle, such as "20 us"'
        raise InputError([scene.fault(("effects", name), message) for name in passing])
    choice.physics.effect_parameters[-1] = settle


def _bed_warnings(scene: Scene, state: State, chosen: Plan) -> list[str]:
    packed = [debris for debris in scene.debris if getattr(debris, "placement", None) == "dense"]
    if not packed or state.n_bodies < 2:
        return []
    bed = f'{state.n_bodies} bodies, packed by placement = "dense",'
    if scene.contact.debris_contact == "none":
        return [f'{bed} have no contact with each other (contact.debris_contact = "none"), so they pass through one another and '
                'carry no load from plate to plate; contact.debris_contact = "auto" lets them meet']  # fmt: skip
    if chosen.kind == "implicit":
        return [f'{bed} all touch, and the implicit integrator solves those that touch together, in steps of the shortest; '
                'solver.integrator = "explicit" is made for beds']  # fmt: skip
    return []


def _refuse_narrow_domain(scene: Scene, state: State) -> None:
    """Raise InputError for a period below twice the largest distance of candidates: nearest images would not be unique."""
    if not scene.domain.periodic or not state.world.debris_meets:
        return
    distance = 2.0 * float(state.spheres.radius.max()) + state.skin + state.reach
    if min(scene.domain.size[: 1 if scene.domain.walls else 2]) < 2.0 * distance:
        shortest = units.pretty(2.0 * distance, "length")
        message = f"a periodic side must be at least {shortest}, twice the distance of candidates of the largest radius"
        raise InputError(scene.fault(("domain", "size"), message))


def _examine_length(simulation: Simulation) -> None:
    """Raise InputError for a distance that is never reached, and for an interval that makes too many frames; warn of an interval
    longer than the run. (An interval longer than a given distance is refused when the scene is read.)"""
    scene = simulation.scene
    if math.isinf(simulation.planned_time):
        message = f"{units.pretty(simulation.end_distance, 'length')} is never reached: the motion ends before"
        raise InputError(scene.fault(("solver", "distance"), message))
    every, by_time = scene.output.every, scene.output.every_kind == "time"
    whole = simulation.planned_time if by_time else simulation.planned_distance
    kind = "time" if by_time else "length"
    shown = simulation.time_scale if by_time else 1.0
    if whole > 0.0 and too_long(every, whole):
        report = too_long_message(shown * every, shown * whole, kind)
        simulation.warnings.append(f"output.every: {report}; only the start and the end are written")
    if every < simulation.shortest_interval:
        step = units.pretty(shown * simulation.shortest_interval, kind)
        simulation.warnings.append(
            f"output.every: {units.pretty(shown * every, kind)} is less than one time step, {step}"
            f"{'' if by_time else ' of sliding'}: there is one frame after every step, and no more"
        )
    if whole > MAX_FRAMES * every:
        message = (
            f"{units.pretty(shown * every, kind)} makes {whole / every:.3g} frames of {units.pretty(shown * whole, kind)}, "
            f"at most {MAX_FRAMES:g} are written"
        )
        raise InputError(scene.fault(("output", "every"), message))


def _refuse_endless(simulation: Simulation, force: bool) -> None:
    scene, state, planned = simulation.scene, simulation.state, simulation.planned_time
    steps = planned / state.dt
    wall = steps * state.n_spheres * SPHERE_STEP
    if steps < STEPS and (wall < PATIENCE or force):
        return
    bound = cast("Explicit", simulation.integrator).bound
    assert bound is not None
    years = f"about {wall / (365.25 * 86400.0):.2g} years" if wall > PATIENCE else f"about {wall / 86400.0:.2g} days"
    message = (
        f"{units.pretty(state.dt, 'time')} would take {steps:.2g} steps for {units.pretty(planned, 'time')}, {years} of "
        f'explicit integration; "auto" would take {units.pretty(bound.step, "time")}'
    )
    if simulation.scene.solver.integrator == "auto":
        message += f" (explicit, because {simulation.plan.reason})"
    raise InputError(scene.fault(("solver", "time_step"), message))
