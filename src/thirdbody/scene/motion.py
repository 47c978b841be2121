"""Sliding of the upper plate: constant velocity, ramp, pause, strokes, a table; or a list of such stages."""

from typing import Annotated, Any, Literal

from pydantic import PlainSerializer

from thirdbody.scene.field_types import Choice, PositiveFrequency, PositiveLength, PositiveNumber, PositiveTime, Speed, Text
from thirdbody.scene.json_schema import ShortForm
from thirdbody.scene.schema_base import Part
from thirdbody.scene.stages import plain_stages, stages


class Constant(Part):
    """A constant velocity [m/s]; in a list of stages for `duration` [s]."""

    velocity: Speed
    duration: PositiveTime | None = None


class Ramp(Part):
    """Linear change of the velocity to `ramp` [m/s] during `duration` [s]; constant afterwards."""

    ramp: Speed
    duration: PositiveTime


class Pause(Part):
    """Rest for a time [s]."""

    pause: PositiveTime


class Stroke(Part):
    """Reciprocating motion: stroke peak to peak [m] and frequency [Hz]; a sine starts from rest at one end.

    In a list of stages `cycles` is the number of cycles.
    """

    stroke: PositiveLength
    frequency: PositiveFrequency
    shape: Annotated[Literal["sine", "triangle"], Choice()] = "sine"
    cycles: PositiveNumber | None = None


class Table(Part):
    """Displacement from a CSV file with a header `time (unit), displacement (unit)`, linear in between."""

    table: Text


_DRIVES: dict[str, type[Part]] = {"velocity": Constant, "ramp": Ramp, "pause": Pause, "stroke": Stroke, "table": Table}

Drive = Constant | Ramp | Pause | Stroke | Table


def _endless(stage: Any) -> str | None:
    """Return the key that a stage before the last lacks, since it would never end."""
    if isinstance(stage, Constant) and stage.duration is None:
        return "duration"
    return "cycles" if isinstance(stage, Stroke) and stage.cycles is None else None


Stages = Annotated[
    tuple[Drive, ...], stages(_DRIVES, '{velocity = "1 m/s"}', _endless), PlainSerializer(plain_stages), ShortForm()
]


class Motion(Part):
    """Motion of the upper plate along x and y; an axis that is not given rests. Time counts from the end of settling."""

    x: Stages | None = None
    y: Stages | None = None

    def moving(self) -> bool:
        """Return whether anything ever moves."""
        drives = (*(self.x or ()), *(self.y or ()))
        return any(not isinstance(drive, Pause) and getattr(drive, "velocity", 1.0) != 0.0 for drive in drives)
