"""Smaller copy of a scene, so that all variants of it are computed in minutes; the reductions are reported."""

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from thirdbody import units
from thirdbody.assembly.simulation import Simulation
from thirdbody.scene.model import Scene

SECONDS = 0.75
"""Initial limit of the integration time of a copy with the scene's settings [s]; the measured cost then decides."""

FEWEST, FEWEST_THAT_MEET = 16, 50
"""Least number of bodies left: fewer give poor statistics of states, or, where they meet, meet images of their neighbours."""

FRAMES = 20
"""Least number of outputs left."""

SHORTEST = 0.02
"""Least fraction of the distance or time left."""

BESIDE = 0.5
"""Least ratio of the time of the drag to that of settling: a shorter drag saves little, and is all first slip."""

CLOSE = 0.8
"""Fraction of its time to which a run must be reduced before its distance is cut: a trial is no more accurate."""


def reduce_scene(scene: Scene, plugins: Sequence[str | Path], maximum: float = SECONDS) -> tuple[Scene, Simulation, list[str]]:
    """Return the scene, or a smaller copy that is integrated in `maximum` seconds; its simulation; the reductions."""
    from thirdbody.runner.simulate import prepare, set_threads

    set_threads(1)
    built, report = prepare(scene, plugins), []
    if built.plan.estimated:  # a smaller copy might have another one
        scene = scene.with_settings({"solver.integrator": built.plan.kind})
    for step in ("thin", "shorten"):
        fraction = maximum / seconds_of(prepare(scene, plugins))
        if step == "thin":
            fewest = FEWEST_THAT_MEET if built.state.world.debris_meets else FEWEST
            changes, words = thin(scene, built.state.n_bodies, fraction, fewest)
        else:
            changes, words = shorten(built, fraction)
        if changes:
            report += words
            scene = scene.with_settings(changes)
            built = prepare(scene, plugins)
    return scene, built, report


def seconds_of(built: Simulation) -> float:
    """Return the time of a run without its frames on one core [s], from a trial of it; infinite where a guard stops it."""
    from thirdbody.report.scene_check import check_report

    wall, cpu = time.perf_counter(), time.process_time()
    message = check_report(built)["estimated_step_time"]
    # time used by other processes is excluded
    busy = min(1.0, (time.process_time() - cpu) / max(time.perf_counter() - wall, 1e-9))
    return math.inf if math.isnan(message) else max(message * busy, 1e-9)


def thin(scene: Scene, bodies: int, fraction: float, fewest: int = FEWEST) -> tuple[dict[str, Any], list[str]]:
    """Return the changes to keep a fraction of the bodies, if it is below 1 and bodies can be omitted, and their description.

    They can where each carries a separate load or the gap is prescribed, and where they are drawn at random on one layer. The
    domain gets smaller such that the bodies stay as close as they are.
    """
    upper = scene.plates.upper
    alone = upper is None or upper.support == "load_per_particle" or upper.gap is not None
    drawn = all(getattr(debris, "count", None) and getattr(debris, "placement", "") == "layer" for debris in scene.debris)
    if fraction >= 1.0 or bodies <= fewest or not alone or not drawn:
        return {}, []
    retained = max(fewest / bodies, fraction)
    counts = {k: max(1, round(retained * getattr(debris, "count", 1))) for k, debris in enumerate(scene.debris)}
    left = sum(counts.values())
    changes: dict[str, Any] = {f"debris.{k}.count": count for k, count in counts.items()}
    near = math.sqrt(left / bodies)
    changes["domain.size"] = [units.format_si(near * side, "length") for side in scene.domain.size]
    return changes, [f"{left} of {bodies} bodies, as close as they were"]


def shorten(built: Simulation, fraction: float) -> tuple[dict[str, Any], list[str]]:
    """Return the changes to keep a fraction of the time, if well below 1, and their description.

    A shorter distance (or time) after settling, with the frames closer together.
    """
    solver, output = built.requested.solver, built.requested.output
    settled = built.settle / built.planned_time
    if fraction >= CLOSE or settled >= 1.0:
        return {}, []
    fits = (fraction - settled) / (1.0 - settled)
    fraction = min(1.0, max(fits, SHORTEST, BESIDE * settled / (1.0 - settled)))
    key, kind = ("distance", "length") if solver.distance is not None else ("duration", "time")
    whole = solver.distance if solver.distance is not None else solver.duration
    assert whole is not None
    left = _round(fraction * whole)
    report = f"{units.pretty(left, kind)} of {units.pretty(whole, kind)} of the {'way' if key == 'distance' else 'time'}"
    changes: dict[str, Any] = {f"solver.{key}": units.format_si(left, kind)}
    span = built.planned_distance if output.every_kind == "distance" else built.scene_time(built.planned_time)
    every = min(output.every, _round(fraction * span / FRAMES))
    if every < output.every:
        unit = "length" if output.every_kind == "distance" else "time"
        changes["output.every"] = units.format_si(every, unit)
        report += f", a frame each {units.pretty(every, unit)}"
    return changes, [report]


def coarsened(scene: Scene, built: Simulation) -> tuple[dict[str, Any], list[str]]:
    """Return the change to an output interval that leaves `FRAMES` frames, where there are more, and its description.

    Writing them takes as long for every variant.
    """
    by_length = scene.output.every_kind == "distance"
    span, unit = (built.planned_distance, "length") if by_length else (built.scene_time(built.planned_time), "time")
    every = _round(span / FRAMES)
    if every <= 1.2 * scene.output.every or every > span:
        return {}, []
    return {"output.every": units.format_si(every, unit)}, [f"a frame each {units.pretty(every, unit)}"]


def _round(value: float) -> float:
    """Round to two digits."""
    return float(f"{value:.1e}")
