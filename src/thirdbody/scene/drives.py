"""How the upper plate moves sideways: constant velocity, ramp, pause, strokes, a table; or a list of such stages."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import PlainSerializer, PlainValidator, ValidationError, ValidationInfo

from thirdbody.scene.fields import Choice, show
from thirdbody.scene.part import MISSING, Part, Wrong, bundle, wrongs_of
from thirdbody.scene.types import PositiveFrequency, PositiveLength, PositiveNumber, PositiveTime, Speed, Text


class Constant(Part):
    """A constant velocity, m/s; in a list of stages for `duration`, s."""

    velocity: Speed
    duration: PositiveTime | None = None


class Ramp(Part):
    """Velocity changing evenly to `ramp`, m/s, during `duration`, s, and kept from then on."""

    ramp: Speed
    duration: PositiveTime


class Pause(Part):
    """Rest for a time, s."""

    pause: PositiveTime


class Stroke(Part):
    """Strokes to and fro: peak to peak length, m, and frequency, Hz; a sine starts from rest at one end.

    In a list of stages `cycles` says how many.
    """

    stroke: PositiveLength
    frequency: PositiveFrequency
    shape: Annotated[Literal["sine", "triangle"], Choice()] = "sine"
    cycles: PositiveNumber | None = None


class Table(Part):
    """Displacement from a CSV file with a header `time (unit), displacement (unit)`, linear in between."""

    table: Text


_DRIVES: dict[str, type[Part]] = {"velocity": Constant, "ramp": Ramp, "pause": Pause, "stroke": Stroke, "table": Table}


def _drive_of(value: Any, info: ValidationInfo) -> Any:
    """One drive: the table is of the kind whose leading key it has."""
    if isinstance(value, tuple(_DRIVES.values())):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(f"expected a table such as {{velocity = \"1 m/s\"}}, got {show(value)}")
    kinds = [key for key in _DRIVES if key in value]
    if not kinds:
        near = [_nearest_key(key) for key in value]
        kinds = [key for key in near if key is not None]
    if len(kinds) != 1:
        raise ValueError(f"give one of {', '.join(_DRIVES)}" + (f", not {' and '.join(kinds)}" if kinds else ""))
    return _DRIVES[kinds[0]].model_validate(value, context=info.context)


def _nearest_key(key: str) -> str | None:
    close = difflib.get_close_matches(key, _DRIVES, 1, 0.6)
    return close[0] if close else None


Drive = Constant | Ramp | Pause | Stroke | Table


def _stages(value: Any, info: ValidationInfo) -> Any:
    """A drive, or a list of them as stages one after the other. Raises ValidationError."""
    entries = list(value) if isinstance(value, list | tuple) else [value]
    if not entries:
        raise ValueError("the list of stages is empty")
    stages = []
    wrongs: list[Wrong] = []
    for k, entry in enumerate(entries):
        place: tuple[str | int, ...] = (k,) if isinstance(value, list | tuple) else ()
        try:
            stages.append(_drive_of(entry, info))
        except ValidationError as error:
            wrongs += [((*place, *where), text) for where, text in wrongs_of(error)]
        except ValueError as error:
            wrongs.append((place, str(error)))
    wrongs += [((k, key), text) for k, key, text in _endless(stages)]
    if wrongs:
        raise bundle(wrongs)
    return tuple(stages)


def _endless(stages: list[Any]) -> list[tuple[int, str, str]]:
    """Stages before the last that never end."""
    found = []
    for k, stage in enumerate(stages[:-1]):
        if isinstance(stage, Constant) and stage.duration is None:
            found.append((k, "duration", f"{MISSING}: only the last stage may go on for ever"))
        if isinstance(stage, Stroke) and stage.cycles is None:
            found.append((k, "cycles", f"{MISSING}: only the last stage may go on for ever"))
    return found


def _plain_stages(stages: tuple[Part, ...]) -> Any:
    """A single drive as a table, several as a list."""
    told = [stage.model_dump(exclude_none=True) for stage in stages]
    return told[0] if len(told) == 1 else told


Stages = Annotated[tuple[Drive, ...], PlainValidator(_stages), PlainSerializer(_plain_stages)]


class Motion(Part):
    """Motion of the upper plate along x and y; an axis that is not named rests. Time counts from the end of settling."""

    x: Stages | None = None
    y: Stages | None = None

    def moving(self) -> bool:
        """True when anything ever moves."""
        drives = (*(self.x or ()), *(self.y or ()))
        return any(not isinstance(drive, Pause) and getattr(drive, "velocity", 1.0) != 0.0 for drive in drives)
