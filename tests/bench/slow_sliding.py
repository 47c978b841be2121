"""What does slow sliding cost? Our explicit and implicit engines and the fastest C++ peer, side by side.

    python tests/bench/slow_sliding.py [--layers] [--bodies N]

The first prints the processor seconds of one thread per particle for 10 um of sliding at 1 m/s, 10 mm/s and 1 mm/s. The particles
are those of `scenes/sheared_debris.toml`, each under its own load, blind to the others. A cell is the median of the repeats,
their spread (largest less smallest, over the median) and the peer's time over ours.

- explicit: a few seconds of the sliding are run and extrapolated.
- implicit: the whole way is run, with a stop every um.
- peer: not run here. Its measured cost per sphere and step (`PEER` says what differs) times spheres per particle times steps:
  with the time step that it is usually given, a fraction of the Rayleigh time of the smallest sphere, and with that of our
  explicit engine.

With --layers: the bodies meet, and cover 0.05 to 0.5 of the lower plate, seen from above; 1 mm/s. Printed are the processor
seconds per particle and um by the implicit engine, from the first 2 um, and by the explicit one, extrapolated: median, smallest
and largest of three layers of different particles, and the median of the ratios. Timings mean something on an idle machine only.
"""

import argparse
import copy
import functools
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from machine import head, screen
from rich.console import Console
from rich.table import Table
import thirdbody
from thirdbody.bodies.packing import projected_area
from thirdbody.engine.state import rayleigh_times
from thirdbody.kernels.tables import run_totals
from thirdbody.runner.simulate import prepare, set_threads

SCENE = Path(__file__).resolve().parents[2] / "scenes" / "sheared_debris.toml"
SPEEDS = [1.0, 10e-3, 1e-3]
FRACTIONS, SEEDS, REPEATS, EXPLICIT_SECONDS = [0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5], 3, 5, 3.0
PATH, EVERY, LAYER_PATH, LAYER_EVERY = 10e-6, 1e-6, 2e-6, 0.5e-6
"""Sliding distance of the times and way between two stops, m, at which every step of a body ends."""

EXPLICIT, SPRINGS = "explicit, mindlin", 16  # name in tables, and springs of the level mdr
PEER, PEER_NS, PEER_FRACTION = "LIGGGHTS 3.8.0", 58.0, 0.18
"""ns per sphere and step, and time step in Rayleigh times of the smallest sphere: Debian 12, fix rigid, Hertz with tangential
history, 2000 steel clumps of 4 to 8 spheres (12092 in all), friction .3, restitution .6, pinched between two plates without
contact between clumps, upper plate .5 m/s, on one shared core (AMD Zen 5), where the same run varied by up to 1.8. The next one,
LAMMPS (22 Jul 2025, pair style granular), took 83 ns there, YADE 2023.02a 488. The peer's clumps had 2 contacts with the plates
each at first and .5 to 1 later; ours carry a load each, on 3 to 4 contacts: the comparison favours the peer."""


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


def scene_of(case: Case) -> thirdbody.Scene:
    """The shipped scene with its particles as densely laid, which do not see each other, or at another area fraction, meeting."""
    scene = thirdbody.Scene.load(SCENE)
    area = case.bodies / (scene.debris[0].count or 1)
    if case.fraction is not None:
        area *= covered_fraction(case.bodies, case.seed) / case.fraction
    settings: dict[str, Any] = {
        "debris.0.count": case.bodies, "debris.0.seed": case.seed,
        "domain.size": [f"{area**0.5 * length:.9g} m" for length in scene.domain.size],
        "contact.law": "three_spot", "contact.level": case.level,
        "contact.debris_contact": "none" if case.fraction is None else "auto",
        "plates.upper.motion.x.velocity": f"{case.speed:.9g} m/s", "solver.integrator": case.integrator,
        "solver.distance": f"{case.path:.9g} m", "output.every": f"{case.every:.9g} m",
    }  # fmt: skip
    settings |= {"contact.springs": SPRINGS} if case.level == "mdr" else {}
    return scene.with_settings(settings | ({"solver.on_failure": "continue"} if case.integrator == "implicit" else {}))


@functools.cache
def covered_fraction(bodies: int, seed: int) -> float:
    """Fraction of the lower plate that the particles of the shipped scene cover, seen from above, as densely laid as there."""
    state = prepare(scene_of(Case("explicit", "mindlin", 1.0, bodies, seed=seed))).state
    areas = (projected_area(state.S[state.body == number, :4]) for number in range(state.n_bodies))
    return float(sum(areas) / np.prod(state.world.size[:2]))


def warm_up(integrator: str, level: str) -> None:
    simulation = settled(Case(integrator, level, 1.0, 4))
    simulation.integrator.advance_to(distance=0.1e-6)


def settled(case: Case) -> Any:
    """The simulation under load when the drag starts, on one thread."""
    simulation = prepare(scene_of(case), force=True)
    set_threads(1)
    simulation.integrator.advance_to(simulation.settle)
    return simulation


def time_implicit(case: Case, repeats: int) -> dict[str, Any]:
    """Processor seconds per particle for PATH; each repeat slides a fresh copy of the settled ensemble the way of the case."""
    simulation, seconds = settled(case), []
    for _ in range(repeats):
        integrator = copy.deepcopy(simulation.integrator)
        before, used = integrator.totals[:, run_totals.STEPS].copy(), time.process_time()
        for stop in np.arange(1, round(case.path / case.every) + 1) * case.every:
            integrator.advance_to(distance=float(stop))
        seconds.append((time.process_time() - used) / case.bodies * PATH / case.path)
    steps = float((integrator.totals[:, run_totals.STEPS] - before).mean()) * PATH / case.path
    return {"seconds": seconds, "steps": steps, "unsolved": len(integrator.summary()["unsolved"])}


def time_explicit(case: Case, repeats: int, patience: float) -> dict[str, Any]:
    """Processor seconds per particle for PATH, from `patience` seconds of it: the first part of the sliding. The rest is taken
    to cost as much per step, with steps as long."""
    simulation, seconds = settled(case), []
    for _ in range(repeats):
        integrator = copy.deepcopy(simulation.integrator)
        state = integrator.state
        time_before, steps_before, used = state.time, state.A[run_totals.STEPS], time.process_time()
        while time.process_time() - used < patience and state.distance < case.path:
            integrator.advance_to(state.time + 100.0 * state.dt, case.path)
        spent, step = time.process_time() - used, (state.time - time_before) / float(state.A[run_totals.STEPS] - steps_before)
        seconds.append(spent / (state.time - time_before) * PATH / case.speed / case.bodies)
    return {"seconds": seconds, "time_step": step, "share_run": state.distance / PATH}


def print_speeds(bodies: int, console: Console) -> None:
    for case in (("explicit", "mindlin"), ("implicit", "mindlin"), ("implicit", "mdr")):
        warm_up(*case)
    explicit = {v: time_explicit(Case("explicit", "mindlin", v, bodies), REPEATS, EXPLICIT_SECONDS) for v in SPEEDS}
    simulation = prepare(scene_of(Case("implicit", "mindlin", 1.0, bodies)))
    state = simulation.state
    per_radius = (rayleigh_times(state, simulation.choice.materials) / state.rayleigh_radius)[state.body]
    own = PEER_FRACTION * float((per_radius * state.spheres.radius).min())
    nanoseconds = PEER_NS * state.n_spheres / bodies
    steps = {v: {f"{PEER_FRACTION:g} Rayleigh": own, "our explicit step": explicit[v]["time_step"]} for v in SPEEDS}
    peer = {v: {rule: 1e-9 * nanoseconds * PATH / v / step for rule, step in steps[v].items()} for v in SPEEDS}
    title = f"processor seconds per particle per {1e6 * PATH:g} um of sliding, one thread; {bodies} particles"
    table = Table("engine", *(f"{v:g} m/s" for v in SPEEDS), title=f"{title}, median of {REPEATS}",
                  caption="x: the peer's time (shorter one) over ours")  # fmt: skip
    for rule in peer[SPEEDS[0]]:
        table.add_row(f"{PEER}, {rule}", *(f"{peer[v][rule]:.3g}" for v in SPEEDS))
    rows = {EXPLICIT: explicit}
    for level, name in (("mindlin", "implicit, mindlin"), ("mdr", f"implicit, mdr {SPRINGS}")):
        rows[name] = {v: time_implicit(Case("implicit", level, v, bodies), REPEATS) for v in SPEEDS}
    for name, row in rows.items():
        cells = []
        for v in SPEEDS:
            seconds, median = row[v]["seconds"], statistics.median(row[v]["seconds"])
            spread = (max(seconds) - min(seconds)) / median
            cells.append(f"{median:.3g} (spread {100.0 * spread:.0f} %)  {min(peer[v].values()) / median:.3g} x")
        table.add_row(name, *cells)
    console.print(table)
    shares = ", ".join(f"{100.0 * row['share_run']:.3g} %" for row in explicit.values())
    console.print(f"share of the way that was run explicitly: {shares}; the peer is computed, not run here")


def print_layers(bodies: int, console: Console) -> None:
    warm_up("implicit", "mindlin"), warm_up("explicit", "mindlin")
    title = f"processor seconds per particle and um of sliding at {SPEEDS[-1]:g} m/s, one thread; {bodies} particles, "
    title += f"median (smallest to largest) of {SEEDS} layers"
    table = Table("area fraction", "implicit", "steps per um", "unsolved", "explicit, extrapolated", "ratio", title=title)
    for fraction in FRACTIONS:
        implicit, explicit = [], []
        for seed in range(1, SEEDS + 1):
            drag = SPEEDS[-1], bodies, LAYER_PATH, LAYER_EVERY, fraction, seed
            implicit.append(time_implicit(Case("implicit", "mindlin", *drag), REPEATS))
            explicit.append(time_explicit(Case("explicit", "mindlin", *drag), REPEATS, EXPLICIT_SECONDS))
        ours, theirs = ([statistics.median(run["seconds"]) * 1e-6 / PATH for run in runs] for runs in (implicit, explicit))
        table.add_row(f"{fraction:g}", _with_range(ours), _with_range([run["steps"] * 1e-6 / PATH for run in implicit]),
                      str(sum(run["unsolved"] for run in implicit)), _with_range(theirs),
                      f"{statistics.median(b / a for a, b in zip(ours, theirs, strict=True)):.3g}")  # fmt: skip
    console.print(table)


def _with_range(values: Sequence[float]) -> str:
    return f"{statistics.median(values):.3g} ({min(values):.3g} to {max(values):.3g})"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", type=int, default=300, help="particles of the ensemble (default %(default)s)")
    parser.add_argument("--layers", action="store_true", help="the second part: layers whose bodies meet, by area fraction")
    requested = parser.parse_args()
    head(screen())
    (print_layers if requested.layers else print_speeds)(requested.bodies, screen())
