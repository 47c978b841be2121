"""What happens once before the points of a sweep run: code is compiled, memory is measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from thirdbody.errors import ThirdbodyError
from thirdbody.scene.model import Scene
from thirdbody.studies.sweep.point import Point

EXAMINED = 200
"""Approximate number of points whose laws are looked at; a worker compiles what none of them has."""


@dataclass(frozen=True)
class Warmed:
    """Memory of this process after building a point [bytes], about what a worker needs; 0 where it is unknown."""

    memory: int = 0


def warm_up(points: Sequence[Point]) -> Warmed:
    """Build one point for each composition of laws, so that all compiled code is in the cache before workers start.

    A point that cannot be built is left to its own run, which gives the reason.
    """
    from thirdbody.runner.simulate import prepare

    compiled: set[str] = set()
    for point in points[:: 1 + len(points) // EXAMINED]:
        code = _sections(point.scene)
        if code in compiled:
            continue
        compiled.add(code)
        try:
            prepare(Scene.parse(point.scene, "scene.toml", point.scene_folder, point.plugins), point.plugins)
        except ThirdbodyError:
            continue
    return Warmed(_peak_memory())


def _sections(scene: str) -> str:
    """Return the names of laws, levels, whole-number options and effects of a resolved scene: what decides on its code."""
    import tomllib

    tables = tomllib.loads(scene)
    contact = {key: value for key, value in tables.get("contact", {}).items() if not isinstance(value, float)}
    choice = (contact, sorted(tables.get("effects", {})), tables["solver"].get("integrator"), len(tables.get("pairs", ())))
    rolling = any("rolling_friction" in pair for pair in tables.get("pairs", ()))
    return repr((*choice, rolling))


def _peak_memory() -> int:
    try:
        import resource
    except ImportError:  # not on Windows
        return 0
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
