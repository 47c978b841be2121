"""How long the program takes to its first step and to tell its help; and what a step costs that has hardly anything to do.

python tests/bench/startup.py [--small]
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from machine import screen
from ours import advance
from peers_scenes import count_contacts, generated, simulation_of, spheres_of, start_of
from rich.console import Console
from rich.table import Table

from thirdbody.runner.simulate import set_threads

SCENE = Path(__file__).resolve().parents[2] / "scenes" / "sheared_debris.toml"

FIRST_STEP = """
import sys, thirdbody
from thirdbody.runner.simulate import prepare
simulation = prepare(thirdbody.Scene.load(sys.argv[1]))
simulation.integrator.advance_to(1e-12)
"""
"""Everything from nothing to one step, of any integrator: a time that is shorter than the shortest step."""

COLD = 2  # caches that are started from nothing
BUDGET = {"cold": 10.0, "warm": 1.5, "help": 0.3}  # what is promised, s
NUMBERS = (1, 10, 100, 1000)
# most steps of a timing, which has ten times as many sphere-steps at most; and of the count of what Python does
STEPS, COUNTED = 20_000, 1_280


def measure_startup(rounds: int) -> dict[str, Any]:
    """Seconds of wall time and of the processor, all processes together, from the start of the interpreter to its end. cold: the
    first process with a new cache; warm: the next ones with the same; help: `thirdbody --help`."""
    report: dict[str, Any] = {"cold": [], "warm": [], "help": []}
    command = [sys.executable, "-c", FIRST_STEP, str(SCENE)]
    for _ in range(COLD):
        with tempfile.TemporaryDirectory() as folder:
            environment = os.environ | {"THIRDBODY_CACHE": folder}
            report["cold"].append(_seconds(command, environment))
            report["warm"] += [_seconds(command, environment) for _ in range(-(-rounds // COLD))]
    report["help"] = [_seconds([sys.executable, "-m", "thirdbody.cli.main", "--help"], dict(os.environ)) for _ in range(rounds)]
    return report


def _seconds(command: list[str], environment: dict[str, str]) -> dict[str, float]:
    """Of one process with its children. Raises CalledProcessError; its words are on stderr."""
    before, started = os.times(), time.perf_counter()
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
    wall, after = time.perf_counter() - started, os.times()
    busy = after.children_user + after.children_system - before.children_user - before.children_system
    return {"wall": wall, "cpu": busy}


def _spread(values: list[float], form: str) -> str:
    return f"{statistics.median(values):{form}}  ({min(values):{form}} .. {max(values):{form}})"


def print_startup(report: dict[str, Any], console: Console) -> None:
    table = Table("start", "wall, s", "processor, s", "budget, s", title=f"start-up: {SCENE.name} to the first step")
    for name, times in report.items():
        table.add_row(name, *(_spread([row[kind] for row in times], ".2f") for kind in ("wall", "cpu")), f"{BUDGET[name]:g}")
    console.print(table)


def measure_small(rounds: int) -> list[dict[str, Any]]:
    """For each number of bodies: ns per step on one thread, and how often Python is at work in between, per step."""
    set_threads(1)
    return [_measure(number, rounds) for number in NUMBERS]


def _measure(bodies: int, rounds: int) -> dict[str, Any]:
    start = start_of("S", generated(bodies))
    simulation = simulation_of(start)
    steps = max(200, min(STEPS, 10 * STEPS // bodies))
    advance(simulation, min(steps, 2000))
    searches = simulation.integrator.summary()["searches"]
    seconds = []
    for _ in range(rounds):
        began = time.perf_counter()
        taken = advance(simulation, steps)
        seconds.append((time.perf_counter() - began) / taken)
    searches = simulation.integrator.summary()["searches"] - searches
    calls, events = _python(simulation, min(steps, COUNTED))
    return {
        "bodies": bodies, "steps": steps, "ns_per_step": [1e9 * t for t in seconds],
        "contacts": sum(count_contacts(start, spheres_of(simulation)["points"])),
        "steps_per_search": rounds * steps / max(1, searches), "python_calls_per_step": calls, "events_per_step": events,
    }  # fmt: skip


def _python(simulation: Any, steps: int) -> tuple[float, float]:
    """Calls of Python functions, and of `watch`, per step: both in a run of its own, which the counting makes slow."""
    calls, events = [0], [0]

    def count(frame: Any, event: str, argument: Any) -> None:
        calls[0] += event == "call"  # those inside numba too: it looks for the version to call

    def watch() -> None:
        events[0] += 1

    state = simulation.state
    sys.setprofile(count)
    try:
        simulation.integrator.advance_to(time=state.time + (steps - 0.5) * state.dt, watch=watch)
    finally:
        sys.setprofile(None)
    return (calls[0] - events[0]) / steps, events[0] / steps


def print_small(rows: list[dict[str, Any]], console: Console) -> None:
    table = Table("bodies", "contacts", "ns/step", "ns/sphere-step", "steps/search", "Python calls/step", "events/step",
                  title="few bodies: a step and what Python adds to it")  # fmt: skip
    for row in rows:
        each = statistics.median(row["ns_per_step"]) / row["bodies"]
        table.add_row(f"{row['bodies']}", f"{row['contacts']}", _spread(row["ns_per_step"], ".0f"), f"{each:.0f}",
                      f"{row['steps_per_search']:.0f}", f"{row['python_calls_per_step']:.3f}",
                      f"{row['events_per_step']:.4f}")  # fmt: skip
    console.print(table)


if __name__ == "__main__":
    if sys.argv[1:] == ["--small"]:
        print_small(measure_small(5), screen())
    elif sys.argv[1:]:
        sys.exit(__doc__)
    else:
        print_startup(measure_startup(5), screen())
