"""What a sweep would cost: points, time, disk and memory, from points that are done or from trials of a few."""

from __future__ import annotations

import math
import os
import statistics
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from thirdbody.errors import ThirdbodyError
from thirdbody.scene.model import Scene
from thirdbody.studies.sweep.plan import Plan
from thirdbody.studies.sweep.point import DONE, Point, read_result
from thirdbody.system.cpu_count import cores
from thirdbody.system.terminal import print_line
from thirdbody.units import duration, file_size

TRIALS = 5
"""Largest number of points of which the cost is estimated, spread evenly over the sweep."""


@dataclass(frozen=True)
class Estimate:
    """Cost of the points that are missing: seconds of one core, wall time [s] on `workers`, disk and memory [bytes].

    `measured`: number of points whose time is known; else that of `trials` is estimated. `failures`: trials that cannot start.
    """

    points: int
    done: int
    workers: int
    core_seconds: float
    wall_time: float
    disk: int
    memory_per_worker: int
    measured: int
    trials: int
    failures: tuple[str, ...]


def estimate(plan: Plan, workers: int | None) -> Estimate:
    """Return the cost of a plan; a dry run, which writes nothing."""
    saved = [result for point in plan.points if (result := read_result(point)) is not None]
    missing = [point for point in plan.points if read_result(point) is None]
    seconds = [result.seconds for result in saved if result.status == DONE]
    sizes = [size for point in plan.points if (size := _bytes(point.folder)) and read_result(point) is not None]
    chosen = missing[:: max(1, math.ceil(len(missing) / TRIALS))]
    trials, failures = _trials(chosen)
    each = statistics.fmean(seconds) if seconds else _mean([float(trial["estimated_wall_time"]) for trial in trials])
    stored = 1 if plan.points[0].keep == "all" else 0
    disk = statistics.fmean(sizes) if sizes else stored * _mean([float(trial["disk"]) for trial in trials])
    count = max(1, min(workers or cores(), len(missing)))
    total = each * len(missing) if missing else 0.0
    memory = max((int(trial["memory"]) for trial in trials), default=0)
    bytes_written = int(disk * len(missing)) if missing and math.isfinite(disk) else 0
    return Estimate(len(plan.points), len(saved), count, total, total / count, bytes_written, memory,
                    len(seconds), len(trials), tuple(failures))  # fmt: skip


def _trials(points: list[Point]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the reports of `thirdbody check` for some points, and why others cannot start."""
    from thirdbody.report.scene_check import check_report
    from thirdbody.runner.simulate import prepare, set_threads

    set_threads(1)
    trials, failures = [], []
    for point in points:
        try:
            scene = Scene.parse(point.scene, "scene.toml", point.scene_folder, point.plugins)
            trials.append(check_report(prepare(scene, point.plugins)))
        except ThirdbodyError as error:
            failures.append(f"point {point.number}: {error.message}")
    return trials, failures


def _mean(values: list[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return statistics.fmean(known) if known else math.nan


def _bytes(folder: Path) -> int:
    """Return the bytes of the files in a folder."""
    try:
        return sum(entry.stat().st_size for entry in os.scandir(folder) if entry.is_file())
    except OSError:
        return 0


def print_estimate(plan: Plan, cost: Estimate, json: bool) -> None:
    """Print the axes and the cost of a sweep."""
    from thirdbody.report.tables import print_json, table

    if json:
        axes = [{"key": column.key, "unit": column.unit, "values": _distinct(column.values)} for column in plan.columns]
        print_json({"title": plan.title, "design": plan.design, "axes": axes, "results": plan.results} | asdict(cost))
        return
    table(plan.title, ["axis", "unit", "values"], [[c.key, c.unit, _shown(_distinct(c.values))] for c in plan.columns])
    origin = f"{cost.measured} points that are done" if cost.measured else f"trials of {cost.trials} points"
    hours = f"{duration(cost.core_seconds)} of one core, {duration(cost.wall_time)} on {cost.workers} workers"
    print_line(f"points: {cost.points}, {cost.done} of them done already")
    print_line(f"time: {hours} (from {origin})")
    print_line(
        f"disk: {file_size(cost.disk)}; memory of a worker: about 0.3 GB, and {file_size(cost.memory_per_worker)} for a run"
    )
    for failure in cost.failures:
        print_line(f"warning: {failure}", err=True)


def _distinct(values: Any) -> list[Any]:
    return list(dict.fromkeys(values))


def _shown(values: list[Any]) -> str:
    texts = [f"{value:g}" if isinstance(value, int | float) else value for value in values]
    return ", ".join(texts) if len(texts) <= 8 else f"{', '.join(texts[:3])} ... {texts[-1]} ({len(texts)})"
