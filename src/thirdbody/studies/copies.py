"""What the workers of a study of cost do: make a smaller copy of a scene, compile, time; the reductions are reported."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from thirdbody import units
from thirdbody.assembly.physics import compile_physics
from thirdbody.assembly.simulation import Simulation
from thirdbody.engine.accuracy import Accuracy
from thirdbody.engine.units import EXPLICIT, MARK
from thirdbody.errors import GuardStop, InputError, UsageError
from thirdbody.jit.cache import cache_folder
from thirdbody.laws.registry import discover
from thirdbody.runner.measurements import is_bed
from thirdbody.runner.outlook import expected_integration
from thirdbody.runner.simulate import prepare, set_threads
from thirdbody.scene.model import Scene
from thirdbody.scene.output import STORED
from thirdbody.scene.tables import IMPLICIT_KEYS
from thirdbody.studies.point import Point, named_files
from thirdbody.studies.timing import bare, rate
from thirdbody.studies.variants import Base, springs_option

# Least number of bodies left: fewer give poor statistics of states, or, where they meet, meet images of their neighbours.
FEWEST, FEWEST_THAT_MEET = 16, 50
MANY = 512  # number of bodies above which a scene is thinned, if it can be, before its time is estimated
FRAMES = 20  # least number of outputs left
SHORTEST = 0.02  # least fraction of the distance or time left
BESIDE = 0.5  # least ratio of the time of the drag to that of settling: a shorter drag saves little, and is all first slip

# Time of a copy, over the one that it was made for, above which a smaller one is made, and above which the trial of the smallest
# ends; how much smaller one is made whose time is not known; number of copies that are tried.
DEAR, LAST, SMALLER, SIZES = 2.5, 60.0, 0.25, 4

UNKNOWN = 10.0  # time with the other integrator over that with its own, where it is not known
SHORTEST_SETTLING = 0.125  # least fraction of the expected settling time left
CLOSE = 0.8  # fraction of its time to which a run must be reduced before its distance is cut: a trial is no more accurate

RUNS_OF_COPY, FEW_RUNS, ENOUGH_RUNS = 400.0, 4.0, 40.0
"""Budget over the time of one run of the copy with the scene's own settings: some 20 variants, of which the reference takes as
long as a hundred of these runs, and their timings; where the smallest copy takes longer, below which a study is refused; for the
cheap variants, the finest law and the steps."""

BATCH, ENOUGH = 3, 0.05
"""Largest number of runs in the batch of a timing, and its duration [s]; the result is the median.

The first runs find the processor's caches cold, which is not part of their cost.
"""


class StudySource(NamedTuple):
    """Scene file with changed settings, its plug-ins, and the folder of the study."""

    scene: Path
    settings: Mapping[str, Any]
    folder: Path
    plugins: Sequence[str | Path]

    def read(self) -> Scene:
        """Return the scene. Raises InputError."""
        return Scene.load(self.scene, self.plugins).with_settings(self.settings)


@dataclass(frozen=True)
class Copy:
    """A copy of a scene: its TOML with absolute paths, the settings of the scene itself, what was reduced.

    `other`: expected time with the other integrator over that with its own.
    """

    scene: str
    base: Base
    reduction: list[str]
    other: float

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Copy:
        """Return the copy of a document, which `dataclasses.asdict` gives."""
        return cls(**{**document, "base": Base(**document["base"])})


def make_copy(source: StudySource, target: float, few: bool, _stop: Callable[[], bool] = lambda: False) -> Copy:
    """Return a copy of a scene that integrates in about `target` seconds on one core; called in a worker. Raises InputError.

    The copy is run once, without frames, for its time and, where the explicit step is automatic, for the smallest one; a copy
    whose time is far off is replaced. Raises UsageError where even the smallest one takes a large part of the budget. `few`:
    with few frames, which take longer to write than a short run to integrate.
    """
    scene = source.read()
    lean: dict[str, Any] = {f"output.{key}": None for key in STORED if key in scene.output.model_fields_set}
    if few:  # what is compared
        lean |= {"output.blocks": ["clumps"], "output.arrays": ["quaternion"]}
    scene = scene.with_settings(lean)
    set_threads(1)
    maximum, limit, bodies = target, DEAR * target, sum(getattr(debris, "count", None) or 1 for debris in scene.debris)
    # building and trying all of them would take a small budget
    many = thin(scene, bodies, MANY / bodies) if few else {}
    copy = scene.with_settings(many)
    first = built = prepare(copy, source.plugins)
    for attempt in range(SIZES):
        smaller, built = reduce_scene(copy, source.plugins, maximum, built)
        if attempt and smaller == copy:  # no smaller one can be made
            limit = LAST * target
        copy, trial = smaller, prepare(smaller, source.plugins)
        try:
            seconds = rate(trial, limit)
        except GuardStop:  # its run will tell
            seconds = target
        if seconds <= DEAR * target or limit > DEAR * target:
            break
        maximum = SMALLER * target if seconds > limit else target
    if seconds * FEW_RUNS > target * RUNS_OF_COPY:
        budget, each, needed = (units.duration(x) for x in (target * RUNS_OF_COPY, seconds, seconds * ENOUGH_RUNS))
        raise UsageError(f"--budget {budget}: one run of the smallest copy of this scene takes {each}; {needed} suffice")
    base = base_of(copy, built, source.plugins)
    by_length = copy.output.every_kind == "distance"
    span, unit = (built.planned_distance, "length") if by_length else (built.scene_time(built.planned_time), "time")
    if few and 1.2 * copy.output.every < (every := _round(span / FRAMES)) <= span:  # frames take as long for every variant
        copy = copy.with_settings({"output.every": units.format_si(every, unit)})
    words = reductions(scene, bodies if many else first.state.n_bodies, first.settle, copy, built)
    if base.kind == "explicit" and isinstance(copy.solver.time_step, str):
        if seconds <= limit:
            base = replace(base, step=min(base.step, float(trial.integrator.summary()["time_step_limit"]["smallest"])))
        words.append(f"the time step held at {units.pretty(base.step, 'time')}, the smallest that `auto` takes")
    base = replace(base, sheared_bed=base.kind == "explicit" and is_bed(built) and scene.plates.moving())
    steps = built.plan.steps
    other = UNKNOWN if steps is None else steps.gain if base.kind == "implicit" else 1.0 / steps.gain
    return Copy(portable(copy).to_toml(), base, words, other)


def reduce_scene(scene: Scene, plugins: Sequence[str | Path], maximum: float, built: Simulation) -> tuple[Scene, Simulation]:
    """Return the scene, `built` its simulation, or a smaller copy that is integrated in `maximum` seconds, after a trial."""
    set_threads(1)
    if built.plan.estimated:  # a smaller copy might have another one
        scene = scene.with_settings({"solver.integrator": built.plan.kind})
    fewest, fraction = FEWEST_THAT_MEET if built.state.world.debris_meets else FEWEST, maximum / seconds_of(built)
    while changes := thin(scene, built.state.n_bodies, fraction, fewest):
        try:
            built, scene = prepare(scene.with_settings(changes), plugins), scene.with_settings(changes)
        except InputError:  # a domain narrower than its largest bodies need
            fewest *= 2
            continue
        fraction = maximum / seconds_of(built)
        break
    if changes := shorten(built, fraction):
        scene = scene.with_settings(changes)
        built = prepare(scene, plugins)
    return scene, built


def reductions(scene: Scene, bodies: int, settle: float, copy: Scene, built: Simulation) -> list[str]:
    """Return in words what a copy, `built` its simulation, omits of a scene with so many bodies and this settling time [s]."""
    words = []
    if built.state.n_bodies < bodies:
        words.append(f"{built.state.n_bodies} of {bodies} bodies, as close as they were")
    for key, kind, what in (("distance", "length", "way"), ("duration", "time", "time")):
        whole, left = getattr(scene.solver, key), getattr(copy.solver, key)
        if whole is not None and left is not None and left < whole:
            words.append(f"{units.pretty(left, kind)} of {units.pretty(whole, kind)} of the {what}")
    if copy.solver.settle != scene.solver.settle:
        words.append(f"{units.pretty(built.settle, 'time')} of {units.pretty(settle, 'time')} of settling")
    if copy.output.every != scene.output.every:
        unit = "length" if copy.output.every_kind == "distance" else "time"
        words.append(f"a frame each {units.pretty(copy.output.every, unit)}")
    return words


def seconds_of(built: Simulation) -> float:
    """Return the time of a run without its frames on one core [s], from a trial of it; infinite where a guard stops it."""
    wall, cpu = time.perf_counter(), time.process_time()
    seconds = float(expected_integration(built)["estimated_step_time"])
    # time used by other processes is excluded
    busy = min(1.0, (time.process_time() - cpu) / max(time.perf_counter() - wall, 1e-9))
    return math.inf if math.isnan(seconds) else max(seconds * busy, 1e-9)


def thin(scene: Scene, bodies: int, fraction: float, fewest: int = FEWEST) -> dict[str, Any]:
    """Return the changes to keep a fraction of the bodies, if it is below 1 and bodies can be omitted.

    They can where bodies are drawn at random, and where a plate that they carry together keeps its pressure: its load, mass and
    dashpot shrink with the domain, which gets smaller such that the bodies stay as close as they are. The fraction is a power of
    two: a second study, which measures other times, mostly computes the same copy.
    """
    upper, carried = scene.plates.upper, dict[str, str]()
    drawn = all(getattr(debris, "count", None) and getattr(debris, "placement", "") for debris in scene.debris)
    # in a smaller domain the same contact would be another, and walls would be nearer to each other
    edge = (upper is not None and upper.profile is not None) or scene.domain.walls is not None
    if fraction >= 1.0 or bodies <= fewest or not drawn or edge:
        return {}
    if upper is not None and upper.support != "load_per_particle" and upper.gap is None:
        if upper.loading is not None and upper.pressure is None:
            return {}
        carried = {"load": "force"} | ({"mass": "mass", "damping": "damping"} if upper.support == "rigid" else {})
    retained = max(fewest / bodies, _power_of_two(fraction))
    while retained < 1.0:
        counts = [max(1, round(retained * getattr(debris, "count", 1))) for debris in scene.debris]
        near = math.sqrt(sum(counts) / bodies)
        changes: dict[str, Any] = {f"debris.{k}.count": count for k, count in enumerate(counts)}
        changes["domain.size"] = [units.format_si(near * side, "length") for side in scene.domain.size]
        for key, kind in carried.items():
            if (value := getattr(upper, key)) is not None:
                changes[f"plates.upper.{key}"] = units.format_si(near**2 * value, kind)
        for key, through in (upper.motion.springs if upper else {}).items():  # fewer bodies pull the plate
            changes[f"plates.upper.motion.{key}"] = units.format_si(near**2 * through, "stiffness")
        try:
            scene.with_settings(changes)
        except InputError:  # a domain shorter than the waves of its surfaces
            retained *= 2.0
        else:
            return changes
    return {}


def _power_of_two(fraction: float) -> float:
    return 2.0 ** math.floor(math.log2(fraction)) if 0.0 < fraction < math.inf else 1e-9


def shorten(built: Simulation, fraction: float) -> dict[str, Any]:
    """Return the changes to keep a fraction of the time, if it is well below 1.

    A shorter distance (or time) after settling, with the frames closer together; where that does not suffice, shorter settling,
    down to an eighth. Fractions are powers of two as in `thin`.
    """
    solver, output = built.requested.solver, built.requested.output
    settled = built.settle / built.planned_time
    if fraction >= CLOSE or settled >= 1.0:
        return {}
    fits = _power_of_two(max((fraction - settled) / (1.0 - settled), 0.5 * SHORTEST))
    calm = 1.0  # what stays of settling
    shortest = min(1.0, max(SHORTEST, BESIDE * settled / (1.0 - settled)))
    if solver.distance is not None and solver.settle == "auto" and fraction < 0.5 * (settled + shortest * (1.0 - settled)):
        calm = max(SHORTEST_SETTLING, _power_of_two(fraction / (settled + shortest * (1.0 - settled))))
    fraction = min(1.0, max(fits, SHORTEST, BESIDE * calm * settled / (1.0 - settled)))
    key, kind = ("distance", "length") if solver.distance is not None else ("duration", "time")
    whole = float(getattr(solver, key))
    left = _round(fraction * whole)
    changes: dict[str, Any] = {f"solver.{key}": units.format_si(left, kind)} if left < whole else {}
    if calm < 1.0:
        changes["solver.settle"] = units.format_si(_round(calm * built.settle), "time")
    span = built.planned_distance if output.every_kind == "distance" else built.scene_time(built.planned_time)
    every = min(output.every, _round(fraction * span / FRAMES))
    if every < output.every:
        changes["output.every"] = units.format_si(every, "length" if output.every_kind == "distance" else "time")
    return changes


def _round(value: float) -> float:
    return float(f"{value:.1e}")


def base_of(scene: Scene, built: Simulation, plugins: Sequence[str | Path]) -> Base:
    """Return the settings of the scene itself: its law and springs, its integrator, and the steps of both."""
    option = springs_option(built.choice.family, built.choice.level)
    springs = None if option is None else int(scene.contact.options.get("springs", option))
    step = built.state.dt
    if built.plan.kind == "implicit":
        step = math.nan
        if units_are_compiled(EXPLICIT):  # compiling them takes as long as a small study
            other = {"solver.integrator": "explicit", **{f"solver.{key}": None for key in IMPLICIT_KEYS}}
            step = prepare(scene.with_settings(other), plugins, force=True).state.dt
    tolerance = scene.solver.tolerance or Accuracy().tolerance
    meets = bool(built.state.world.debris_meets)
    return Base(built.plan.kind, built.choice.level, springs, step, tolerance, meets=meets)


def units_are_compiled(units: Sequence[str]) -> bool:
    """Return whether these units of the kernels (`engine.units`) are in the cache."""
    return all((cache_folder() / f"{MARK}{unit}").exists() for unit in units)


def portable(scene: Scene) -> Scene:
    """Return the scene with absolute paths of the files that it names, which can be saved in any folder."""
    files = {f"debris.{k}.{key}": getattr(debris, key) for k, debris in enumerate(scene.debris) for key in debris.file_keys}
    files |= dict(named_files(scene.document()["plates"], location="plates"))
    changes = {}
    for key, file in files.items():
        names = [str(scene.beside(name).absolute()) for name in ([file] if isinstance(file, str) else file or ())]
        if names:
            changes[key] = names[0] if isinstance(file, str) else names
    return scene.with_settings(changes)


def time_point(point: Point, limit: float, stop: Callable[[], bool] = lambda: False) -> tuple[float, float]:
    """Return the seconds (wall, processor) of integrating a variant: medians of a batch. Raises GuardStop and Late."""
    set_threads(1)
    times: list[tuple[float, float]] = []
    while len(times) < BATCH and (not times or sum(cpu for _, cpu in times) < ENOUGH) and not stop():
        times.append(bare(prepare(point.parsed(), point.plugins), limit))
    wall, cpu = (statistics.median(column) for column in zip(*times, strict=True))
    return wall, cpu


def compile_law(source: StudySource, changes: dict[str, Any], kind: str, _stop: Callable[[], bool] = lambda: False) -> None:
    """Compile the laws of a scene with these changes into the cache."""
    physics = compile_physics(source.read().with_settings(changes), discover(tuple(source.plugins))).physics
    if kind == "implicit":
        _ = physics.tangents  # compiled where it is named first


def compile_point(point: Point, _stop: Callable[[], bool] = lambda: False) -> None:
    """Compile all that a variant needs into the cache."""
    prepare(point.parsed(), point.plugins)


def rate_point(point: Point, limit: float, _stop: Callable[[], bool] = lambda: False) -> float:
    """Return the expected seconds of integrating a variant on one core, from a trial of at most `limit` seconds."""
    set_threads(1)
    return rate(prepare(point.parsed(), point.plugins), limit)
