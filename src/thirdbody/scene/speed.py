"""A scene with another speed of its drive: the same path, faster or slower."""

from __future__ import annotations

import math

from thirdbody.scene.model import Scene
from thirdbody.scene.motion import Constant, Drive, Load, LoadStage, Pause, Ramp, Stroke, Table
from thirdbody.scene.output import Output
from thirdbody.scene.tables import Solver, UpperPlate


def at_speed(scene: Scene, factor: float) -> Scene:
    """Return the scene with its drive `factor` times as fast, over the same distances.

    Velocities of the upper plate (sliding and closing) and frequencies of strokes are multiplied by the factor; durations of
    stages, of the run and of time between outputs are divided by it, so that every event happens at the same displacement. The
    load history is divided too: a load belongs to the place on the path where it acts. A wanted inertial number is that of the
    new speed. Settling, the time step and the initial
    velocities of bodies are no part of the drive and stay as they are. Raises ValueError unless the factor is positive.
    """
    if not 0.0 < factor < math.inf:
        raise ValueError(f"factor = {factor}: must be greater than 0 and finite")
    plates, upper = scene.plates, scene.plates.upper
    if upper is not None:
        plates = plates.model_copy(update={"upper": _plate(upper, factor)})
    changes = {"plates": plates, "solver": _solver(scene.solver, factor), "output": _output(scene.output, factor)}
    return scene.model_copy(update=changes)


def _plate(upper: UpperPlate, factor: float) -> UpperPlate:
    motion = upper.motion.model_copy(update={"x": _drives(upper.motion.x, factor), "y": _drives(upper.motion.y, factor)})
    loading = None if upper.loading is None else tuple(_load(stage, factor) for stage in upper.loading)
    closing = None if upper.closing is None else upper.closing * factor
    return upper.model_copy(update={"motion": motion, "loading": loading, "closing": closing})


def _drives(stages: tuple[Drive, ...] | None, factor: float) -> tuple[Drive, ...] | None:
    return None if stages is None else tuple(_drive(stage, factor) for stage in stages)


def _drive(stage: Drive, factor: float) -> Drive:
    """Return a stage of motion at another speed."""
    if isinstance(stage, Constant):
        return stage.model_copy(update={"velocity": stage.velocity * factor, "duration": _shorter(stage.duration, factor)})
    if isinstance(stage, Ramp):
        return stage.model_copy(update={"ramp": stage.ramp * factor, "duration": stage.duration / factor})
    if isinstance(stage, Stroke):
        return stage.model_copy(update={"frequency": stage.frequency * factor})
    return _pause_or_table(stage, factor)


def _load(stage: LoadStage, factor: float) -> LoadStage:
    """Return a stage of the load, in another time."""
    if isinstance(stage, Load):
        return stage.model_copy(update={"duration": _shorter(stage.duration, factor)})
    return _pause_or_table(stage, factor)


def _pause_or_table(stage: Pause | Table, factor: float) -> Pause | Table:
    if isinstance(stage, Pause):
        return stage.model_copy(update={"pause": stage.pause / factor})
    return stage.model_copy(update={"speed": stage.speed * factor})


def _solver(solver: Solver, factor: float) -> Solver:
    number = solver.inertial_number
    number = None if number is None else number * factor
    return solver.model_copy(update={"duration": _shorter(solver.duration, factor), "inertial_number": number})


def _output(output: Output, factor: float) -> Output:
    return output.model_copy(update={"every": output.every / factor}) if output.every_kind == "time" else output


def _shorter(duration: float | None, factor: float) -> float | None:
    return None if duration is None else duration / factor
