"""How long the program takes to its first step and to print its help: `python tests/bench/startup.py`."""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from machine import screen
from rich.console import Console
from rich.table import Table

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


if __name__ == "__main__":
    print_startup(measure_startup(5), screen())
