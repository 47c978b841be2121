"""From the motion in a scene to the schedule that the engine follows."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from ..engine.plates import Axis, Schedule, Segment, at_time
from ..errors import InputError
from ..kernels.motion import POLYNOMIAL, SINE, TRIANGLE
from . import units
from .drives import Constant, Pause, Ramp, Stroke, Table
from .model import Scene


def schedule(scene: Scene, start: float) -> Schedule:
    """Sideways motion from `start` on (the end of settling, s) and the height of a plate that is moved up and down.

    Raises InputError for a table that cannot be read.
    """
    plate = scene.plates.upper
    if plate is None:
        return Schedule()
    gap: Axis = ()
    if plate.gap is not None and plate.closing:
        gap = (Segment(0.0, POLYNOMIAL, plate.gap, -plate.closing),)
    motion = plate.motion
    return Schedule(_axis(scene, "x", motion.x or (), start), _axis(scene, "y", motion.y or (), start), gap)


def _axis(scene: Scene, name: str, stages: tuple, start: float) -> Axis:
    """The segments of one axis: every stage begins where the one before ended; after the last one that ends it rests."""
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
        # a last ramp keeps its velocity, everything else that ends is followed by rest
        segments.append(Segment(t, POLYNOMIAL, x, v if isinstance(stages[-1], Ramp) else 0.0))
    return tuple(segments)


def _stage(scene: Scene, name: str, stage, t: float, x: float, v: float) -> tuple[list[Segment], float, float]:
    """Segments of a stage that begins at time t, place x and velocity v; its length in time; the velocity that it leaves."""
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
    rows = _read_table(scene, name, stage)
    segments = [
        Segment(t + t_0, POLYNOMIAL, x + x_0, (x_1 - x_0) / (t_1 - t_0))
        for (t_0, x_0), (t_1, x_1) in zip(rows, rows[1:], strict=False)
    ]
    return segments, rows[-1][0], segments[-1].b


def _read_table(scene: Scene, name: str, stage: Table) -> list[tuple[float, float]]:
    """Rows (time, displacement) of a CSV file, from (0, 0) on. Raises InputError with the line at fault."""
    path = scene.beside(stage.table)
    place = ("plates", "upper", "motion", name, "table")

    def fault(message: str) -> InputError:
        return InputError(scene.fault(place, f"{path}: {message}"))

    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise fault(f"cannot be read ({error})") from None
    lines = [row for row in csv.reader(text.splitlines()) if row]
    scales = _header(lines[0] if lines else [], fault)
    rows: list[tuple[float, float]] = []
    for number, row in enumerate(lines[1:], 2):
        try:
            t, x = (float(cell) * scale for cell, scale in zip(row, scales, strict=True))
        except ValueError:
            raise fault(f"line {number}: expected 2 numbers, got {', '.join(row)}") from None
        if not (math.isfinite(t) and math.isfinite(x)):
            raise fault(f"line {number}: not a finite number")
        if rows and t <= rows[-1][0]:
            raise fault(f"line {number}: times must grow")
        rows.append((t, x))
    if len(rows) < 2:
        raise fault("needs at least two rows")
    if rows[0] != (0.0, 0.0):
        raise fault("the first row must be time 0, displacement 0")
    return rows


def _header(cells: list[str], fault) -> tuple[float, float]:
    """Scales of the two columns from a header `time (us), displacement (um)`."""
    expected = (("time", "time"), ("displacement", "length"))
    scales = []
    for cell, (word, dimension) in zip(cells, expected, strict=False):
        name, _, unit = cell.strip().partition("(")
        if name.strip() != word or not unit.endswith(")"):
            raise fault(f"line 1: expected '{word} (unit)', got '{cell.strip()}'")
        try:
            scales.append(units.parse(f"1 {unit[:-1]}", dimension))
        except ValueError as error:
            raise fault(f"line 1: {error}") from None
    if len(scales) != 2 or len(cells) != 2:
        raise fault("line 1: expected the header 'time (unit), displacement (unit)'")
    return scales[0], scales[1]
