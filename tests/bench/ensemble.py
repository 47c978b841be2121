"""The ensemble of the benchmark, and how long an integrator takes to slide it."""

import copy
import functools
import statistics
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import thirdbody
from thirdbody.bodies.packing import projected_area
from thirdbody.kernels.tables import run_totals
from thirdbody.runner.simulate import prepare, set_threads

SCENE = Path(__file__).resolve().parents[2] / "scenes" / "sheared_debris.toml"

PATH = 10e-6  # sliding distance that times are told for, m
EVERY = 1e-6  # way between two stops, m, as in the scene: every step of a body ends there
EXPLICIT, SPRINGS = "explicit, mindlin", 16  # name in tables, and springs of the level mdr


@dataclass(frozen=True)
class Case:
    """One ensemble: speed of the drag, m/s, the whole way and the way between two outputs, m. `fraction`: of the lower plate
    that a layer whose bodies meet covers, seen from above; None for bodies that do not meet."""

    integrator: str
    level: str
    speed: float
    bodies: int
    path: float = PATH
    every: float = EVERY
    fraction: float | None = None
    seed: int = 1

    @property
    def name(self) -> str:
        return f"{self.integrator}, {self.level}" + (f" {SPRINGS}" if self.level == "mdr" else "")


def scene_of(case: Case) -> thirdbody.Scene:
    """The shipped scene with its particles as densely laid, which do not see each other, or at another area fraction, meeting."""
    scene = thirdbody.Scene.load(SCENE)
    settings: dict[str, Any] = {
        "debris.0.count": case.bodies, "debris.0.seed": case.seed, "domain.size": _size(scene, case.bodies),
        "contact.law": "three_spot", "contact.level": case.level, "contact.debris_contact": "none",
        "plates.upper.motion.x.velocity": f"{case.speed:.9g} m/s", "solver.integrator": case.integrator,
        "solver.distance": f"{case.path:.9g} m", "output.every": f"{case.every:.9g} m",
    }  # fmt: skip
    if case.level == "mdr":
        settings["contact.springs"] = SPRINGS
    if case.integrator == "implicit":
        settings["solver.on_failure"] = "continue"
    if case.fraction is not None:
        settings["contact.debris_contact"] = "auto"
        settings["domain.size"] = _size(scene, case.bodies, covered_fraction(case.bodies, case.seed) / case.fraction)
    return scene.with_settings(settings)


def _size(scene: thirdbody.Scene, bodies: int, factor: float = 1.0) -> list[str]:
    """The domain for this number of bodies, its area by a factor larger than that of as dense a layer as shipped."""
    stretch = (factor * bodies / (scene.debris[0].count or 1)) ** 0.5
    return [f"{stretch * length:.9g} m" for length in scene.domain.size]


@functools.cache
def covered_fraction(bodies: int, seed: int) -> float:
    """Fraction of the lower plate that the particles of the shipped scene cover, seen from above, as densely laid as there."""
    state = prepare(scene_of(Case("explicit", "mindlin", 1.0, bodies, seed=seed))).state
    areas = (projected_area(state.S[state.body == number, :4]) for number in range(state.n_bodies))
    return float(sum(areas) / np.prod(state.world.size[:2]))


def warm_up(integrator: str, level: str) -> float:
    started = time.perf_counter()
    simulation = prepare(scene_of(Case(integrator, level, 1.0, 4)), force=True)
    simulation.integrator.advance_to(simulation.settle)
    simulation.integrator.advance_to(distance=0.1e-6)
    simulation.integrator.label()
    return time.perf_counter() - started


def settled(case: Case, threads: int | None = 1) -> tuple[Any, dict[str, float]]:
    """The simulation under load when the drag starts, and the seconds that building and settling took."""
    started = time.perf_counter()
    simulation = prepare(scene_of(case), force=True)
    built = time.perf_counter()
    set_threads(threads)
    simulation.integrator.advance_to(simulation.settle)
    return simulation, {"build_s": built - started, "settle_s": time.perf_counter() - built}


def middle(values: list[float]) -> dict[str, Any]:
    median = statistics.median(values)
    return {"median": median, "spread": (max(values) - min(values)) / median if median else 0.0, "values": values}


def spread_of(steps: np.ndarray) -> dict[str, float]:
    """Of the steps of single particles: median, 99 % and the largest, and which particle that is: one that chatters shows."""
    median, high = float(np.median(steps)), float(np.quantile(steps, 0.99))
    return {"median": median, "99 %": high, "largest": float(steps.max()), "body": int(steps.argmax())}


def time_implicit(case: Case, repeats: int) -> dict[str, Any]:
    """Processor seconds per particle for the whole way, one thread; each repeat slides a fresh copy of the settled ensemble."""
    simulation, report = settled(case)
    seconds, busy = [], []
    for _ in range(repeats):
        integrator = copy.deepcopy(simulation.integrator)
        before = integrator.totals[:, run_totals.STEPS].copy()
        started, used = time.perf_counter(), time.process_time()
        for stop in np.arange(1, round(case.path / case.every) + 1) * case.every:
            integrator.advance_to(distance=float(stop))
        spent = time.process_time() - used
        busy.append(spent / (time.perf_counter() - started))
        seconds.append(spent / case.bodies * PATH / case.path)
    taken = (integrator.totals[:, run_totals.STEPS] - before) * PATH / case.path
    steps, result = float(taken.mean()), middle(seconds)
    return {
        "engine": case.name, "speed": case.speed, "seconds_per_particle": result, "steps_per_particle": steps,
        "steps": spread_of(taken), "seconds_per_step": result["median"] / steps, "busy": middle(busy),
        "unsolved": len(integrator.summary()["unsolved"]), **report,
    }  # fmt: skip


def time_explicit(case: Case, repeats: int, patience: float) -> dict[str, Any]:
    """Processor seconds per particle for the whole way, one thread, from `patience` seconds of it: the first part of the
    sliding. The rest is taken to cost as much per step, with steps as long: steps needed = way / speed / mean step of the
    part."""
    simulation, report = settled(case)
    seconds, busy, shares = [], [], []
    for _ in range(repeats):
        integrator = copy.deepcopy(simulation.integrator)
        state = integrator.state
        time_before, steps_before = state.time, state.A[run_totals.STEPS]
        started, used = time.perf_counter(), time.process_time()
        while time.process_time() - used < patience and state.distance < case.path:
            integrator.advance_to(state.time + 100.0 * state.dt, case.path)
        spent = time.process_time() - used
        busy.append(spent / (time.perf_counter() - started))
        steps, simulated = float(state.A[run_totals.STEPS] - steps_before), state.time - time_before
        seconds.append(spent / steps)
        shares.append(state.distance / PATH)
    step, per_step = simulated / steps, middle(seconds)
    needed = PATH / case.speed / step
    return {
        "engine": case.name, "speed": case.speed, "steps_per_particle": needed, "seconds_per_step": per_step["median"],
        "seconds_per_particle": middle([needed / case.bodies * value for value in seconds]), "busy": middle(busy),
        "ns_per_sphere_step": 1e9 * per_step["median"] / state.n_spheres, "time_step": step, "share_run": min(shares), **report,
    }  # fmt: skip
