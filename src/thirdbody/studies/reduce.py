"""A smaller copy of a scene, so that a whole ladder of it is computed in minutes; what was reduced is told."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from thirdbody.scene import units
from thirdbody.scene.model import Scene

if TYPE_CHECKING:
    from thirdbody.scene.build import Simulation

SECONDS = 1.0
"""Of integration that one run of the scene may take as it stands: some 18 rungs, repeated three times, up to fifty times as
slow, then end within minutes."""

FEWEST = 25
"""Bodies that are left at least: fewer tell nothing of shares of states."""

FRAMES = 20
"""Outputs that are left at least."""

SHORTEST = 0.02
"""Share of the way or time that is left at least."""

BESIDE = 0.1
"""Time of the drag over that of settling that is left at least: where settling takes most, the drag costs little."""


def thinned(scene: Scene, bodies: int, seconds: float) -> tuple[dict[str, Any], list[str]]:
    """Fewer bodies in the same domain, if the scene takes longer than `SECONDS` and its bodies can be left out.

    They can where each carries its own load or the gap is prescribed, and where they are drawn at random on one layer.
    """
    upper = scene.plates.upper
    alone = upper is None or upper.support == "load_per_particle" or upper.gap is not None
    drawn = all(getattr(debris, "count", None) and getattr(debris, "placement", "") == "layer" for debris in scene.debris)
    if seconds <= SECONDS or bodies <= FEWEST or not alone or not drawn:
        return {}, []
    keep = max(FEWEST / bodies, SECONDS / seconds)
    counts = {k: max(1, round(keep * getattr(debris, "count", 1))) for k, debris in enumerate(scene.debris)}
    left = sum(counts.values())
    return {f"debris.{k}.count": count for k, count in counts.items()}, [f"{left} of {bodies} bodies, in the same domain"]


def shortened(built: Simulation, seconds: float) -> tuple[dict[str, Any], list[str]]:
    """A shorter way (or time) after settling, with the frames closer together, if it still takes longer than `SECONDS`."""
    solver, output = built.scene.solver, built.scene.output
    if not seconds > SECONDS:
        return {}, []
    settled = built.settle / built.planned_time
    if settled >= 1.0:
        return {}, []
    fits = (SECONDS / seconds - settled) / (1.0 - settled)
    share = min(1.0, max(fits, SHORTEST, BESIDE * settled / (1.0 - settled)))
    key, kind = ("distance", "length") if solver.distance is not None else ("duration", "time")
    whole = solver.distance if solver.distance is not None else solver.duration
    assert whole is not None
    left = _round(share * whole)
    told = f"{units.pretty(left, kind)} of {units.pretty(whole, kind)} of the {'way' if key == 'distance' else 'time'}"
    changes: dict[str, Any] = {f"solver.{key}": units.format_si(left, kind)}
    span = built.planned_distance if output.every_kind == "distance" else built.planned_time
    every = min(output.every, _round(share * span / FRAMES))
    if every < output.every:
        unit = "length" if output.every_kind == "distance" else "time"
        changes["output.every"] = units.format_si(every, unit)
        told += f", a frame each {units.pretty(every, unit)}"
    return changes, [told]


def _round(value: float) -> float:
    """To two digits."""
    return float(f"{value:.1e}")
