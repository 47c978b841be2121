"""Computes variants in a separate process (`worker_process.Worker`): requests and answers are lines of JSON.

A request holds what to `do`, the `scene` (file), the `changes` to it, `plugins`, the `folder` for the run, the `limit` ([s] of
one core for one run) and the number of a displacement of the start (`nudge`), 0 for none. `make` saves a smaller copy of the
scene in the folder; `run` compiles the variant by a run that ends at once and then runs it into its folder; `time` integrates it
again. Only the integration from stop to stop is timed (`stopwatch.bare`): neither compiling, nor building the scene, nor the work
at an output, which is the same for all. One thread computes, so its processor seconds are reported along with the wall seconds:
on an idle machine they are equal, on a busy one they still measure the cost of a variant. All variants of a study are computed
alternately by one process, so that a temporary disturbance of the machine affects all of them.
"""

import json
import math
import os
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from thirdbody.errors import GuardStop, Interrupted, ThirdbodyError
from thirdbody.scene.model import Scene
from thirdbody.studies.nudge import nudge
from thirdbody.studies.stopwatch import Late, attach, bare

BATCH, ENOUGH = 9, 0.1
"""Largest number of runs in the batch of a timing, and its duration [s]; the result is the median.

The first runs find the processor's caches cold, which is not part of their cost.
"""


def timed_run(scene: Scene, folder: Path, plugins: Sequence[str], limit: float, displacement: int = 0) -> dict[str, Any]:
    """Run a variant into a folder, from a displaced start if that has a number.

    Return the seconds of integration, its step, how it ended, and the fraction `done`.

    Raises ThirdbodyError for a scene that cannot be built.
    """
    from thirdbody.runner.run_loop import WallTimes
    from thirdbody.runner.simulate import execute, prepare

    built = prepare(scene, plugins)
    if displacement:
        nudge(built.state, displacement)
    clock, message = attach(built.integrator), ""
    end = time.process_time() + limit
    try:
        # a busy machine makes a variant late, not costly: the limit is one of the processor's time
        never = WallTimes(every=math.inf)
        execute(built, folder, threads=1, overwrite=True, times=never, stop=lambda: time.process_time() > end)
    except GuardStop as error:
        message = str(error)
    except Interrupted:
        done = built.state.time / built.planned_time
        message = f"given up after {limit:.3g} s of one core, at {100.0 * done:.0f} % of the run"
    report = {"wall_s": clock.wall, "cpu_s": clock.cpu, "done": built.state.time / built.planned_time,
            "integrator": built.plan.kind, "message": message, "stable": not message}  # fmt: skip
    if built.plan.kind == "implicit":
        return report | {"step": built.integrator.accuracy.tolerance, "step_kind": "tolerance"}  # type: ignore[union-attr]
    return report | {"step": built.state.dt, "step_kind": "time_step"}


def timed(scene: Scene, plugins: Sequence[str], limit: float) -> dict[str, Any]:
    """Return the seconds of integrating a variant: medians of a batch. Raises GuardStop, Late and ThirdbodyError."""
    from thirdbody.runner.simulate import prepare, set_threads

    set_threads(1)
    times: list[tuple[float, float]] = []
    while len(times) < BATCH and (not times or sum(cpu for _, cpu in times) < ENOUGH):
        times.append(bare(prepare(scene, plugins), limit))
    wall, cpu = (statistics.median(column) for column in zip(*times, strict=True))
    return {"wall_s": wall, "cpu_s": cpu, "stable": True, "message": ""}


def answer(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result of a request; a failed one has a `message` and is not `stable`.

    `compile_s`: time of its first, empty run.
    """
    from thirdbody.studies.study_setup import make_copy

    began, folder, limit = time.process_time(), Path(request["folder"]), float(request["limit"])
    result: dict[str, Any] = {"stable": False, "message": ""}
    try:
        scene = Scene.load(request["scene"], request["plugins"])
        scene = scene.with_settings(request["changes"]) if request["changes"] else scene
        if request["do"] == "make":
            copied = make_copy(scene, folder, request["plugins"], request["most"], request["few"])
            result |= copied | {"stable": True}
        elif request["do"] == "time":
            result |= timed(scene, request["plugins"], limit)
        else:
            folder.parent.mkdir(parents=True, exist_ok=True)
            timed_run(scene, folder, request["plugins"], 0.0)
            result["compile_s"] = time.process_time() - began
            result |= timed_run(scene, folder, request["plugins"], limit, request["nudge"])
    except Late:
        result |= {"stable": False, "message": f"given up after {limit:.3g} s of one core"}
    except ThirdbodyError as error:
        result |= {"stable": False, "message": str(error), "exit_code": error.exit_code}
    return result | {"used_cpu": time.process_time() - began}


def serve() -> None:
    """Answer requests on standard input until it ends; all other output goes to standard error."""
    replies = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    import thirdbody.runner.simulate  # noqa: F401  (before it is ready: the start is what takes long)

    print(json.dumps({"ready": True}), file=replies, flush=True)
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line))), file=replies, flush=True)


if __name__ == "__main__":
    serve()
