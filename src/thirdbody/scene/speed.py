"""A scene with another speed of its drive: the same path, faster or slower."""

from __future__ import annotations

import math
from typing import Any

from thirdbody.scene.model import Scene
from thirdbody.schema.parts import Part

_MULTIPLIED = {"velocity", "ramp", "frequency", "speed", "closing", "inertial_number"}
_DIVIDED = {"duration", "pause"}
"""Keys of the upper plate with its motion and loading, and of the solver."""


def at_speed(scene: Scene, factor: float) -> Scene:
    """Return the scene with its drive `factor` times as fast, over the same distances.

    Velocities of the upper plate (sliding and closing) and frequencies of strokes are multiplied by the factor; durations of
    stages, of the run and of time between outputs are divided by it, so that every event happens at the same displacement. The
    load history is divided too: a load belongs to the place on the path where it acts. A wanted inertial number is that of the
    new speed. Settling, the time step and the initial velocities of bodies are no part of the drive and stay as they are. Raises
    ValueError unless the factor is positive.
    """
    if not 0.0 < factor < math.inf:
        raise ValueError(f"factor = {factor}: must be greater than 0 and finite")
    plates = scene.plates.model_copy(update={"upper": _faster(scene.plates.upper, factor)})
    output = scene.output
    if output.every_kind == "time":
        output = output.model_copy(update={"every": output.every / factor})
    return scene.model_copy(update={"plates": plates, "solver": _faster(scene.solver, factor), "output": output})


def _faster(value: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        return tuple(_faster(entry, factor) for entry in value)
    if not isinstance(value, Part):
        return value
    given = {key: entry for key in type(value).model_fields if (entry := getattr(value, key)) is not None}
    return value.model_copy(update={
        key: entry * factor if key in _MULTIPLIED else entry / factor if key in _DIVIDED else _faster(entry, factor)
        for key, entry in given.items()
    })  # fmt: skip
