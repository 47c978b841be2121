"""Schedule of the upper plate, from the motion and load in a scene."""

import math
from itertools import pairwise

from thirdbody.assembly.csv_series import rows_of
from thirdbody.engine.upper_plate import Axis, Schedule, Segment, at_time
from thirdbody.kernels.schedule import POLYNOMIAL, SINE, TRIANGLE
from thirdbody.scene.load_history import Load
from thirdbody.scene.model import Scene
from thirdbody.scene.motion import Constant, Pause, Ramp, Stroke


def schedule(scene: Scene, start: float) -> Schedule:
    """Return the schedule of the upper plate: sliding from `start` [s] on, height and load.

    `start` is the end of settling. The height is prescribed for a plate at a gap that moves vertically; the load, if it changes,
    is relative to the first one. Raises InputError for a table that cannot be read.
    """
    plate = scene.plates.upper
    if plate is None:
        return Schedule()
    gap: Axis = ()
    if plate.gap is not None and plate.closing:
        gap = (Segment(0.0, POLYNOMIAL, plate.gap, -plate.closing),)
    motion = plate.motion
    loading = _loading(scene, plate.loading or (), start)
    return Schedule(_axis(scene, "x", motion.x or (), start), _axis(scene, "y", motion.y or (), start), gap, loading)


def first_load(scene: Scene) -> float:
    """Return the load under which the debris settles [N]: on the plate, or on each patch; 0 at a gap."""
    plate = scene.plates.upper
    assert plate is not None
    area = scene.domain.size[0] * scene.domain.size[1]
    return plate.load if plate.load is not None else (plate.pressure or 0.0) * area


def _loading(scene: Scene, stages: tuple, start: float) -> Axis:
    """Return the load over the settling load: stage after stage; the last load stays."""
    if not stages:
        return ()
    load = first_load(scene)
    segments, t, factor = [Segment(0.0, POLYNOMIAL, 1.0)], start, 1.0
    for k, stage in enumerate(stages):
        if isinstance(stage, Pause):
            rows = [(0.0, factor), (stage.pause, factor)]
        elif isinstance(stage, Load):
            rows = [(0.0, factor), (stage.duration or 0.0, stage.load / load)]
        else:
            location = ("plates", "upper", "loading", *((k,) if len(stages) > 1 else ()), "table")
            table = rows_of(scene, location, stage.table, "load", "force")
            rows = [(t_0 / stage.speed, value / load) for t_0, value in table]
        for (t_0, f_0), (t_1, f_1) in pairwise(rows):
            if t_1 > t_0:
                segments.append(Segment(t + t_0, POLYNOMIAL, f_0, (f_1 - f_0) / (t_1 - t_0)))
        t, factor = t + rows[-1][0], rows[-1][1]
    segments.append(Segment(t, POLYNOMIAL, factor))
    return tuple(segments)


def _axis(scene: Scene, name: str, stages: tuple, start: float) -> Axis:
    """Return the segments of one axis: stages in succession, then rest if the last one ends."""
    segments: list[Segment] = []
    t, x, v = start, 0.0, 0.0
    for stage in stages:
        new, length, v = _stage(scene, name, stage, t, x, v)
        segments += new
        if math.isinf(length):
            return tuple(segments)
        t += length
        x = at_time(tuple(segments), t)
    if segments:
        # a final ramp keeps its velocity; every other stage that ends is followed by rest
        segments.append(Segment(t, POLYNOMIAL, x, v if isinstance(stages[-1], Ramp) else 0.0))
    return tuple(segments)


def _stage(scene: Scene, name: str, stage, t: float, x: float, v: float) -> tuple[list[Segment], float, float]:
    """Return segments, duration and final velocity of a stage from time t, position x, velocity v."""
    if isinstance(stage, Constant):
        length = math.inf if stage.duration is None else stage.duration
        return [Segment(t, POLYNOMIAL, x, stage.velocity)], length, stage.velocity
    if isinstance(stage, Ramp):
        return [Segment(t, POLYNOMIAL, x, v, (stage.ramp - v) / stage.duration)], stage.duration, stage.ramp
    if isinstance(stage, Pause):
        return [Segment(t, POLYNOMIAL, x)], stage.pause, 0.0
    if isinstance(stage, Stroke):
        length = math.inf if stage.cycles is None else stage.cycles / stage.frequency
        if stage.shape == "sine":
            return [Segment(t, SINE, x, stage.stroke, 2.0 * math.pi * stage.frequency)], length, 0.0
        return [Segment(t, TRIANGLE, x, stage.stroke, stage.frequency)], length, 0.0
    table = rows_of(scene, ("plates", "upper", "motion", name, "table"), stage.table, "displacement", "length")
    rows = [(t_0 / stage.speed, x_0) for t_0, x_0 in table]
    segments = [
        Segment(t + t_0, POLYNOMIAL, x + x_0, (x_1 - x_0) / (t_1 - t_0))
        for (t_0, x_0), (t_1, x_1) in zip(rows, rows[1:], strict=False)
    ]
    return segments, rows[-1][0], segments[-1].b
