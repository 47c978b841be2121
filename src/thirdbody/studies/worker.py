"""One rung in a process of its own: `python -m thirdbody.studies.worker JOB`, JSON in, JSON on the last line of the output.

A job holds `scene` (file), `variants` (one or more tables of changes to it), `plugins`, `folder` (for the runs), `repeats` and
`limit` (s of one core for one run). Each variant is compiled first, by a run that ends at once, and then timed; several
variants take turns, so that what disturbs the machine for a while disturbs all of them. Timed is the integration alone: neither
compiling, nor building the scene, nor writing its frames. One thread computes, so its seconds of processor time are told beside
those of the wall: on a machine that does nothing else they are the same, on a busy one they still tell what a rung costs.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from thirdbody.errors import GuardStop, Interrupted, ThirdbodyError
from thirdbody.scene.model import Scene

SHORT, MORE = 0.3, 3
"""Runs shorter than so many seconds are repeated so many times as often: their times spread most."""


class Clock:
    """Seconds that an integrator spent in its steps: of the wall, and of the processor."""

    def __init__(self, integrator: Any):
        self.wall, self.cpu, self.advance = 0.0, 0.0, integrator.advance_to
        integrator.advance_to = self._timed

    def _timed(self, *arguments: Any, **keys: Any) -> None:
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            self.advance(*arguments, **keys)
        finally:
            self.wall += time.perf_counter() - wall
            self.cpu += time.process_time() - cpu


def measured(scene: Scene, folder: Path, plugins: Sequence[str], limit: float) -> dict[str, Any]:
    """One run into a folder: seconds of integration, its step, how it ended. Raises ThirdbodyError for what cannot be built."""
    from thirdbody.simulate import execute, prepare

    built = prepare(scene, plugins)
    clock, message = Clock(built.integrator), ""
    end = time.process_time() + limit
    try:
        # a busy machine makes a rung late, not costly: the limit is one of the processor's time
        execute(built, folder, threads=1, overwrite=True, every=math.inf, stop=lambda: time.process_time() > end)
    except GuardStop as error:
        message = str(error)
    except Interrupted:
        done = built.state.time / built.planned_time
        message = f"given up after {limit:.3g} s of one core, at {100.0 * done:.0f} % of the run"
    told = {"wall_s": clock.wall, "cpu_s": clock.cpu, "integrator": built.plan.kind, "message": message, "stable": not message}
    if built.plan.kind == "implicit":
        return told | {"step": built.integrator.accuracy.tolerance, "step_kind": "tolerance"}  # type: ignore[union-attr]
    return told | {"step": built.state.dt, "step_kind": "time_step"}


def work(job: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What each variant of a job took and told; `wall` and `cpu` hold the seconds of its repeats."""
    base, repeats = Scene.load(job["scene"]), int(job["repeats"])
    folders = [Path(job["folder"]) / str(k) for k in range(len(job["variants"]))]
    scenes: list[Scene | None] = []
    found: list[dict[str, Any]] = []
    for changes, folder in zip(job["variants"], folders, strict=True):
        try:
            scenes.append(base.with_settings(changes) if changes else base)
            measured(scenes[-1], folder, job["plugins"], 0.0)  # type: ignore[arg-type]
            found.append({"wall": [], "cpu": []})
        except ThirdbodyError as error:
            scenes[len(found) :] = [None]
            found.append({"wall": [], "cpu": [], "stable": False, "message": str(error)})
    turn = 0
    while turn < repeats:
        for told, scene, folder in zip(found, scenes, folders, strict=True):
            if scene is not None and told.get("stable", True):
                told |= measured(scene, folder, job["plugins"], job["limit"])
                told["wall"].append(told["wall_s"])
                told["cpu"].append(told["cpu_s"])
        turn += 1
        done = [told["wall"][-1] for told in found if told["wall"]]
        if turn == repeats and done and max(done) < SHORT and repeats == int(job["repeats"]):
            repeats *= MORE
        if turn == 2 and sum(done) * repeats > job["limit"]:
            break  # a long one: two tell the spread
    return found


if __name__ == "__main__":
    with open(sys.argv[1], encoding="utf-8") as file:
        answer = work(json.load(file))
    print(json.dumps(answer))
