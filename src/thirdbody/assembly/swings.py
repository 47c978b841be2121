"""Whether the loads of a scene can swing, and the memory of tangential springs that `memory = "auto"` chooses by it."""

from itertools import pairwise
from typing import Any

from thirdbody.assembly.schedule import schedule
from thirdbody.engine.upper_plate import Axis
from thirdbody.kernels.schedule import POLYNOMIAL
from thirdbody.laws.memory import MEMORY
from thirdbody.scene.model import Scene

ROUNDING = 1e-12
"""Relative jump between the segments of a schedule that is no change of it."""


def why_swings(scene: Scene) -> str:
    """Return why load and shear of a contact can swing together, again and again; "" where nothing makes them.

    Loads swing where the motion or the load of the upper plate turns, or a plate is rough: what slides on it goes up and down. A
    drag that goes on in one direction leaves contacts no time: they slide, roll on or open within a few radii of slip. Raises
    InputError for a table that cannot be read.
    """
    drive = schedule(scene, 0.0)
    if _reverses(drive.x) or _reverses(drive.y):
        return "the motion of the upper plate turns"
    if _reverses(drive.load):
        return "the load of the upper plate turns"
    for side in ("lower", "upper"):
        plate = getattr(scene.plates, side)
        if plate is not None and plate.surface is not None:
            return f"the {side} plate is rough"
    return ""


def chosen_memory(scene: Scene, values: dict[str, Any]) -> dict[str, Any]:
    """Return the options of a law with the memory that "auto" stands for in this scene."""
    if values.get(MEMORY.name) != "auto":
        return values
    return values | {MEMORY.name: "two_rings" if why_swings(scene) else "two_number"}


def _reverses(axis: Axis) -> bool:
    """Whether a schedule turns: it rises and falls, a reciprocating segment or linear ones of either sign."""
    rates = [rate for s, after in pairwise(axis) for rate in (s.rate(s.start), s.rate(after.start))]
    last = [s.rate(t) for s in axis[-1:] for t in (s.start, s.start + 1.0)]
    jumps = [after.a - s.value(after.start) for s, after in pairwise(axis)]
    size = max((abs(s.a) for s in axis), default=0.0)
    changes = [*rates, *last, *(jump for jump in jumps if abs(jump) > ROUNDING * size)]
    return any(s.kind != POLYNOMIAL for s in axis) or min(changes, default=0.0) < 0.0 < max(changes, default=0.0)
