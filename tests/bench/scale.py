"""One large ensemble in a process of its own: `python scale.py '{"level": "mindlin", "bodies": 1000, ...}'` prints JSON.

A process each, because the peak memory of a process never falls.
"""

import importlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np
from ensemble import Case, scene_of, spread_of, warm_up
from ours import peak as memory_peak

from thirdbody.errors import GuardStop
from thirdbody.kernels.columns import run_totals
from thirdbody.runner.simulate import execute, prepare

CLOCKED = {
    "shapes": ("thirdbody.assembly.populate", "make_bodies"),
    "poses": ("thirdbody.assembly.placement", "settle_all"),
    "places": ("thirdbody.assembly.placement", "place_layer"),
    "populate": ("thirdbody.assembly.simulation", "populate"),
}
"""Parts of building a scene that are timed: the module that calls, and the name that it calls. `populate` holds the others."""


def measure(case: Case, threads: int | None) -> dict[str, Any]:
    """Build, settle and slide one ensemble with its outputs: seconds of each part, peak memory, bytes per particle."""
    seconds: dict[str, float] = {"compile": warm_up(case.integrator, case.level)}
    base = memory_peak()
    for part, (module, name) in CLOCKED.items():
        owner = importlib.import_module(module)
        setattr(owner, name, _clocked(getattr(owner, name), seconds, part))
    started = time.perf_counter()
    simulation = prepare(scene_of(case), force=True)
    seconds["build"] = time.perf_counter() - started
    built = memory_peak()
    disk, stopped = _slide(simulation, threads, seconds)
    summary = simulation.integrator.summary()
    peak, state = memory_peak(), simulation.state
    sizes = {"process": peak - base, "bodies": _size(state), "contacts": _size(state.slots)}
    sizes["integrator"] = _size(simulation.integrator)
    return {
        "engine": case.name, "case": asdict(case), "bodies": case.bodies, "spheres": state.n_spheres, "seconds": seconds,
        "seconds_per_particle": seconds["slide"] / case.bodies, "steps_per_particle": summary["steps_per_body"],
        "steps": spread_of(simulation.integrator.totals[:, run_totals.STEPS]), "unsolved": len(summary["unsolved"]),
        "stopped": stopped, "disk": disk, "peak_memory": {"imported": base, "built": built, "end": peak},
        "bytes_per_particle": {name: size / case.bodies for name, size in sizes.items()},
    }  # fmt: skip


def _slide(simulation: Any, threads: int | None, seconds: dict[str, float]) -> tuple[int, str]:
    """Run the scene into a temporary folder; its size in bytes, and what stopped the run. What is not stepping is `output`."""
    integrator, stopped = simulation.integrator, ""
    seconds |= {"settle": 0.0, "slide": 0.0}
    advance = integrator.advance_to

    def timed(*arguments: Any, **named: Any) -> None:
        settling = simulation.state.time < 0.999999 * simulation.settle
        started = time.perf_counter()
        advance(*arguments, **named)
        part = "settle" if settling else "slide"
        seconds[part] += time.perf_counter() - started

    integrator.advance_to = timed
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        try:
            execute(simulation, Path(folder) / "run", threads)
        except GuardStop as error:
            stopped = str(error)
        whole = time.perf_counter() - started
        disk = sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file())
    seconds["output"] = whole - seconds["settle"] - seconds["slide"]
    return disk, stopped


def _clocked(function: Callable, seconds: dict[str, float], part: str) -> Callable:
    @wraps(function)
    def timed(*arguments: Any, **named: Any) -> Any:
        started = time.perf_counter()
        try:
            return function(*arguments, **named)
        finally:
            seconds[part] = seconds.get(part, 0.0) + time.perf_counter() - started

    return timed


def _size(owner: Any) -> int:
    """Bytes of the arrays of a state, of the candidate contacts, or of the integrator."""
    return sum(value.nbytes for value in vars(owner).values() if isinstance(value, np.ndarray))


def in_process_of_its_own(case: Case, threads: int | None) -> dict[str, Any]:
    """What `measure` gives, from a child. Raises CalledProcessError when the child fails; its words are on stderr."""
    command = [sys.executable, str(Path(__file__).resolve()), json.dumps({"case": asdict(case), "threads": threads})]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)


if __name__ == "__main__":
    requested = json.loads(sys.argv[1])
    print(json.dumps(measure(Case(**requested["case"]), requested["threads"])))
