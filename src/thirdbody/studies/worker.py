"""One rung in a process of its own: `python -m thirdbody.studies.worker JOB`, JSON in, JSON on the last line of the output.

A job holds `scene` (file), `variants` (one or more tables of changes to it), `plugins`, `folder` (for the runs), `repeats`,
`limit` (s of one core for one run) and `until` (see `process.in_process`). Each variant is compiled first, by a run that ends at
once; then it is run into its folder, and then timed; several variants take turns, so that what disturbs the machine for a while
disturbs all of them. Timed is the integration alone, from stop to stop (`clock.bare`): neither compiling, nor building the scene,
nor what is done at an output, which is the same for all. One thread computes, so its seconds of processor time are told beside
those of the wall: on a machine that does nothing else they are the same, on a busy one they still tell what a rung costs. With
`beside`, changes that make the scene a yardstick, short runs take turns with that one too, and its seconds are told with theirs:
a busy machine is slower by some minutes than by others.
"""

from __future__ import annotations

import json
import math
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from thirdbody.errors import GuardStop, Interrupted, ThirdbodyError
from thirdbody.scene.model import Scene

from .budget import LONG, SHORT, repeats_of
from .clock import Late, attach, bare

BATCH = 9
"""A repeat of a short run is up to so many, one after the other, and their median: the first ones find the processor's caches
cold, which is nothing of theirs."""


def measured(scene: Scene, folder: Path, plugins: Sequence[str], limit: float) -> dict[str, Any]:
    """One run into a folder: seconds of integration, its step, how it ended, and which share of it was `done`.

    Raises ThirdbodyError for what cannot be built.
    """
    from thirdbody.simulate import execute, prepare

    built = prepare(scene, plugins)
    clock, message = attach(built.integrator), ""
    end = time.process_time() + limit
    try:
        # a busy machine makes a rung late, not costly: the limit is one of the processor's time
        execute(built, folder, threads=1, overwrite=True, every=math.inf, stop=lambda: time.process_time() > end)
    except GuardStop as error:
        message = str(error)
    except Interrupted:
        done = built.state.time / built.planned_time
        message = f"given up after {limit:.3g} s of one core, at {100.0 * done:.0f} % of the run"
    told = {"wall_s": clock.wall, "cpu_s": clock.cpu, "done": built.state.time / built.planned_time,
            "integrator": built.plan.kind, "message": message, "stable": not message}  # fmt: skip
    if built.plan.kind == "implicit":
        return told | {"step": built.integrator.accuracy.tolerance, "step_kind": "tolerance"}  # type: ignore[union-attr]
    return told | {"step": built.state.dt, "step_kind": "time_step"}


def work(job: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What each variant of a job took and told; `wall` and `cpu` hold the seconds of its repeats."""
    base = Scene.load(job["scene"])
    scenes: list[Scene] = []
    found: list[dict[str, Any]] = []
    for k, changes in enumerate(job["variants"]):
        told: dict[str, Any] = {"wall": [], "cpu": [], "stable": False}
        try:
            scenes.append(base.with_settings(changes) if changes else base)
            folder = Path(job["folder"]) / str(k)
            measured(scenes[-1], folder, job["plugins"], 0.0)
            told |= measured(scenes[-1], folder, job["plugins"], job["limit"])
            if not told["stable"] or told["cpu_s"] > LONG:
                told["wall"].append(told["wall_s"])
                told["cpu"].append(told["cpu_s"])
        except ThirdbodyError as error:
            scenes[k:] = [base]
            told["message"] = str(error)
        found.append(told)
    _repeat(job, scenes, found)
    return found


def _repeat(job: Mapping[str, Any], scenes: Sequence[Scene], found: Sequence[dict[str, Any]]) -> None:
    """Time what came to its end, in turns, until each has enough repeats, or one and no time is left for more."""
    going = [(told, scene) for told, scene in zip(found, scenes, strict=True) if told["stable"]]
    whole = sum(told["cpu_s"] for told, _ in going)
    each = whole / max(len(going), 1)
    repeats = repeats_of(each, int(job["repeats"]))
    until = math.inf if job.get("until") is None else float(job["until"])
    batch = max(1, min(BATCH, round(SHORT / each))) if going and each > 0.0 else 1
    if len({len(told["cpu"]) for told, _ in going}) > 1:  # only some are long: none of the pairs is to be torn
        for told, _ in going:
            told["wall"], told["cpu"] = [], []
    yardstick = _yardstick(job) if each < SHORT and going else None
    while going and len(going[0][0]["cpu"]) < repeats:
        if going[0][0]["cpu"] and time.time() + whole > until:
            return
        for told, scene in going:
            try:
                wall, cpu = _timed(scene, job, batch)
                if yardstick is not None:
                    told.setdefault("beside", []).append(_timed(yardstick, job, batch)[1])
            except Late:
                return
            told["wall"].append(wall)
            told["cpu"].append(cpu)


def _yardstick(job: Mapping[str, Any]) -> Scene | None:
    """The scene that is the yardstick of a job, if it has one."""
    changes = job.get("beside")
    return None if changes is None else Scene.load(job["scene"]).with_settings(changes)


def _timed(scene: Scene, job: Mapping[str, Any], batch: int) -> tuple[float, float]:
    """Seconds (wall, processor) of one integration: medians of a batch."""
    from thirdbody.simulate import prepare

    built = [prepare(scene, job["plugins"]) for _ in range(batch)]
    times = [bare(simulation, job["limit"]) for simulation in built]
    return statistics.median(wall for wall, _ in times), statistics.median(cpu for _, cpu in times)


if __name__ == "__main__":
    with open(sys.argv[1], encoding="utf-8") as file:
        answer = work(json.load(file))
    print(json.dumps(answer))
