"""Schedule of the upper plate, from the motion and load in a scene and from CSV files of a quantity over time; whether loads can
swing, and the memory of tangential springs that `memory = "auto"` chooses by it."""

import math
from itertools import pairwise
from typing import Any

from thirdbody.assembly.csv_table import numbers_of
from thirdbody.assembly.pressure_map import load_of
from thirdbody.engine.upper_plate import Axis, Schedule, Segment, at_time, ends_of
from thirdbody.kernels.schedule import POLYNOMIAL, SINE, TRIANGLE
from thirdbody.laws.memory import MEMORY
from thirdbody.scene.model import Scene
from thirdbody.scene.motion import Constant, Load, LoadPause, Ramp, Stroke
from thirdbody.scene.pressure import Profile

ROUNDING = 1e-12
"""Relative jump between the segments of a schedule that is no change of it."""


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
    x, y = (_axis(scene, name, getattr(plate.motion, name) or (), start) for name in "xy")
    return Schedule(x, y, gap, _loading(scene, plate.loading or (), start), plate.motion.through)


def first_load(scene: Scene) -> float:
    """Return the load under which the debris settles [N]: on the plate, or on each patch (of a profile the mean); 0 at a gap."""
    plate = scene.plates.upper
    assert plate is not None
    area = scene.domain.size[0] * scene.domain.size[1]
    if isinstance(plate.pressure, Profile):
        return load_of(scene, plate.pressure) / sum(kind.body_count(kind) for kind in scene.debris)
    return plate.load if plate.load is not None else (plate.pressure or 0.0) * area


def smallest_load(schedule: Schedule) -> float:
    """Return the smallest load of a run over the first one; 1 if the load does not change."""
    return min((min(piece.value(piece.start), piece.value(end)) for piece, end in ends_of(schedule.load)), default=1.0)


def _loading(scene: Scene, stages: tuple, start: float) -> Axis:
    if not stages:
        return ()
    load = first_load(scene)
    segments, t, factor = [Segment(0.0, POLYNOMIAL, 1.0)], start, 1.0
    for k, stage in enumerate(stages):
        if isinstance(stage, LoadPause):
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
    if isinstance(stage, Constant):
        length = math.inf if stage.duration is None else stage.duration
        return [Segment(t, POLYNOMIAL, x, stage.velocity)], length, stage.velocity
    if isinstance(stage, Ramp):
        return [Segment(t, POLYNOMIAL, x, v, (stage.ramp - v) / stage.duration)], stage.duration, stage.ramp
    if isinstance(stage, LoadPause):
        return [Segment(t, POLYNOMIAL, x)], stage.pause, 0.0
    if isinstance(stage, Stroke):
        length = math.inf if stage.cycles is None else stage.cycles / stage.frequency
        if stage.shape == "sine":
            return [Segment(t, SINE, x, stage.stroke, 2.0 * math.pi * stage.frequency)], length, 0.0
        return [Segment(t, TRIANGLE, x, stage.stroke, stage.frequency)], length, 0.0
    table = rows_of(scene, ("plates", "upper", "motion", name, "table"), stage.table, "displacement", "length")
    rows = [(t_0 / stage.speed, x_0) for t_0, x_0 in table]
    pieces = pairwise(rows)
    segments = [Segment(t + t_0, POLYNOMIAL, x + x_0, (x_1 - x_0) / (t_1 - t_0)) for (t_0, x_0), (t_1, x_1) in pieces]
    return segments, rows[-1][0], segments[-1].b


def rows_of(scene: Scene, location: tuple, file: str, word: str, dimension: str) -> list[tuple[float, float]]:
    """Read rows (time [s], value in SI) of a file with the header `time (unit), <word> (unit)`.

    Time and displacement begin at 0, a load is never negative. Raises InputError at the key `location` of the scene, with the
    line.
    """
    lines, fault = numbers_of(scene, location, file, {"time": "time", word: dimension})
    rows: list[tuple[float, float]] = []
    for number, (t, x) in lines:
        if dimension == "force" and x < 0.0:
            raise fault(f"line {number}: a load is never negative")
        if rows and t <= rows[-1][0]:
            raise fault(f"line {number}: times must grow")
        rows.append((t, x))
    if len(rows) < 2:
        raise fault("needs at least two rows")
    if rows[0][0] != 0.0 or (dimension == "length" and rows[0][1] != 0.0):
        raise fault("the first row must be time 0" + (f", {word} 0" if dimension == "length" else ""))
    return rows


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
