"""A smaller copy of a scene, so that a whole ladder of it is computed in minutes; what was reduced is told."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody import units
from thirdbody.scene.model import Scene

if TYPE_CHECKING:
    from thirdbody.build.simulation import Simulation

SECONDS = 0.75
"""Of integration that one run of a copy may take as the scene asks, at first; the ladder's measured cost then decides."""

FEWEST = 16
"""Bodies that are left at least: fewer tell little of shares of states."""

FRAMES = 20
"""Outputs that are left at least."""

SHORTEST = 0.02
"""Share of the way or time that is left at least."""

BESIDE = 0.5
"""Time of the drag over that of settling that is left at least: a shorter one saves little, and is all first slip."""

CLOSE = 0.8
"""Share of its time that a run must come down to before its way is cut: a trial is no better than that."""

WIDER = 8.0
"""Times the sides of the domain of a thinned copy: of 40 bodies that lie at random where 2000 cover a fifth, two come
near each other in one copy of thirty; in the same domain two pairs did in each."""


def reduce_scene(
    scene: Scene, plugins: Sequence[str | Path], maximum: float = SECONDS, meet: bool = False
) -> tuple[Scene, Simulation, list[str]]:
    """The scene, or a smaller copy of it that is integrated in `maximum` seconds; the simulation of it; what was reduced.

    A thinned copy has its bodies apart, where its ladder tells accuracy and not which of two bodies tips first when they
    collide; with `meet` they stay as close to each other as they were.
    """
    from thirdbody.runner.simulate import prepare, set_threads

    set_threads(1)
    built, report = prepare(scene, plugins), []
    for step in ("thin", "shorten"):
        fraction = maximum / seconds_of(built)
        if step == "thin":
            changes, words = thin(scene, built.state.n_bodies, fraction, meet and built.state.world.debris_meets)
        else:
            changes, words = shorten(built, fraction)
        if changes:
            report += words
            scene = scene.with_settings(changes)
            built = prepare(scene, plugins)
    return scene, built, report


def seconds_of(built: Simulation) -> float:
    """Seconds of one core that a run would take without its frames, from a trial; infinite where a guard stops it."""
    from thirdbody.report.scene_check import check_report

    wall, cpu = time.perf_counter(), time.process_time()
    message = check_report(built)["estimated_step_time"]
    # what other processes took from the trial does not count
    busy = min(1.0, (time.process_time() - cpu) / max(time.perf_counter() - wall, 1e-9))
    return math.inf if math.isnan(message) else max(message * busy, 1e-9)


def thin(scene: Scene, bodies: int, share: float, meet: bool = False) -> tuple[dict[str, Any], list[str]]:
    """A share of the bodies, if it is below 1 and bodies can be left out; what is told of it.

    They can where each carries its own load or the gap is prescribed, and where they are drawn at random on one layer. The
    domain gets wider, or, with `meet`, as much smaller as keeps the bodies as close as they are.
    """
    upper = scene.plates.upper
    alone = upper is None or upper.support == "load_per_particle" or upper.gap is not None
    drawn = all(getattr(debris, "count", None) and getattr(debris, "placement", "") == "layer" for debris in scene.debris)
    if share >= 1.0 or bodies <= FEWEST or not alone or not drawn:
        return {}, []
    keep = max(FEWEST / bodies, share)
    counts = {k: max(1, round(keep * getattr(debris, "count", 1))) for k, debris in enumerate(scene.debris)}
    left = sum(counts.values())
    changes: dict[str, Any] = {f"debris.{k}.count": count for k, count in counts.items()}
    near = math.sqrt(left / bodies)
    times, words = (near, "as close as they were") if meet else (WIDER, "in a domain so wide that they are apart")
    changes["domain.size"] = [units.format_si(times * side, "length") for side in scene.domain.size]
    return changes, [f"{left} of {bodies} bodies, {words}"]


def shorten(built: Simulation, share: float) -> tuple[dict[str, Any], list[str]]:
    """A share of the time, if it is well below 1: a shorter way (or time) after settling, with the frames closer together."""
    solver, output = built.scene.solver, built.scene.output
    settled = built.settle / built.planned_time
    if share >= CLOSE or settled >= 1.0:
        return {}, []
    fits = (share - settled) / (1.0 - settled)
    share = min(1.0, max(fits, SHORTEST, BESIDE * settled / (1.0 - settled)))
    key, kind = ("distance", "length") if solver.distance is not None else ("duration", "time")
    whole = solver.distance if solver.distance is not None else solver.duration
    assert whole is not None
    left = _round(share * whole)
    report = f"{units.pretty(left, kind)} of {units.pretty(whole, kind)} of the {'way' if key == 'distance' else 'time'}"
    changes: dict[str, Any] = {f"solver.{key}": units.format_si(left, kind)}
    span = built.planned_distance if output.every_kind == "distance" else built.planned_time
    every = min(output.every, _round(share * span / FRAMES))
    if every < output.every:
        unit = "length" if output.every_kind == "distance" else "time"
        changes["output.every"] = units.format_si(every, unit)
        report += f", a frame each {units.pretty(every, unit)}"
    return changes, [report]


def coarsened(scene: Scene, built: Simulation) -> tuple[dict[str, Any], list[str]]:
    """An interval of output that leaves `FRAMES` of them, where there are more: writing them takes as long for every rung."""
    by_length = scene.output.every_kind == "distance"
    span, unit = (built.planned_distance, "length") if by_length else (built.planned_time, "time")
    every = _round(span / FRAMES)
    if every <= 1.2 * scene.output.every or every > span:
        return {}, []
    return {"output.every": units.format_si(every, unit)}, [f"a frame each {units.pretty(every, unit)}"]


def _round(value: float) -> float:
    """To two digits."""
    return float(f"{value:.1e}")
