"""Drive of the upper plate: its sliding and its load after settling, each a stage or a list of stages."""

from typing import Annotated, Any, Literal

from pydantic import PlainSerializer

from thirdbody.schema.fields import Force, PositiveLength, PositiveNumber, PositiveTime, Quantity, ShortForm, Speed, Text
from thirdbody.schema.parts import Part, Wrong, one_or_more

Through = Annotated[float, Quantity(dimension="stiffness", gt=0)] | None


class Constant(Part):
    """A constant velocity [m/s]; in a list of stages for `duration` [s]."""

    velocity: Speed
    """Constant velocity. Example: "1 m/s"."""
    duration: PositiveTime | None = None
    """Duration; required before another stage. Example: "10 us"."""
    through: Through = None
    """Stiffness of the spring through which this motion pulls the plate; only in the first stage. Example: "1e6 N/m"."""


class Ramp(Part):
    """Linear change of the velocity to `ramp` [m/s] during `duration` [s]; constant afterwards."""

    ramp: Speed
    """Velocity at the end of a linear change, constant afterwards. Example: "1 m/s"."""
    duration: PositiveTime
    """Duration of the change. Example: "1 us"."""
    through: Through = None
    """Stiffness of the spring through which this motion pulls the plate; only in the first stage. Example: "1e6 N/m"."""


class LoadPause(Part):
    """Rest for a time [s]."""

    pause: PositiveTime
    """Duration of a stage without change. Example: "1 us"."""


class Stroke(Part):
    """Reciprocating motion: stroke peak to peak [m] and frequency [Hz]; a sine starts from rest at one end.

    In a list of stages `cycles` is the number of cycles.
    """

    stroke: PositiveLength
    """Peak-to-peak stroke of a reciprocating motion. Example: "50 um"."""
    frequency: Annotated[float, Quantity(dimension="frequency", gt=0)]
    """Cycles per second. Example: "5 Hz"."""
    shape: Literal["sine", "triangle"] = "sine"
    """Displacement over time; a sine starts from rest at one end. Example: "triangle"."""
    cycles: PositiveNumber | None = None
    """Number of cycles; required before another stage. Example: 3."""
    through: Through = None
    """Stiffness of the spring through which this motion pulls the plate; only in the first stage. Example: "1e6 N/m"."""


class LoadTable(Part):
    """Displacement from a CSV file with a header `time (unit), displacement (unit)`, linear in between."""

    table: Text
    """CSV file, linear in between; header `time (us), displacement (um)`; for a load `time (us), load (mN)`.
    Example: "path.csv"."""
    speed: Annotated[float, Quantity(ge=1e-9, le=1e9)] = 1.0
    """How many times as fast the table is followed. Example: 10."""


class Load(Part):
    """Linear change of the load to `load` [N] during `duration` [s]; without a duration at once."""

    load: Force
    """Load at the end of a linear change. Example: "0 N"."""
    duration: PositiveTime | None = None
    """Duration of the change; without it sudden. Example: "1 us"."""


class Pause(LoadPause):
    """Rest for a time [s]."""

    through: Through = None
    """Stiffness of the spring through which this motion pulls the plate; only in the first stage. Example: "1e6 N/m"."""


class Table(LoadTable):
    """Displacement from a CSV file with a header `time (unit), displacement (unit)`, linear in between."""

    through: Through = None
    """Stiffness of the spring through which this motion pulls the plate; only in the first stage. Example: "1e6 N/m"."""


Drive = Constant | Ramp | Pause | Stroke | Table
LoadStage = Load | LoadPause | LoadTable

_DRIVES: dict[str, type[Part]] = {"velocity": Constant, "ramp": Ramp, "pause": Pause, "stroke": Stroke, "table": Table}
_LOADS: dict[str, type[Part]] = {"load": Load, "pause": LoadPause, "table": LoadTable}


def _endless(stage: Any) -> str | None:
    if isinstance(stage, Constant) and stage.duration is None:
        return "duration"
    return "cycles" if isinstance(stage, Stroke) and stage.cycles is None else None


@PlainSerializer
def _plain_stages(stages: tuple[Part, ...]) -> Any:
    tables = [stage.model_dump(exclude_none=True) for stage in stages]
    return tables[0] if len(tables) == 1 else tables


Stages = Annotated[
    tuple[Drive, ...], one_or_more("stages", _DRIVES, '{velocity = "1 m/s"}', _endless), _plain_stages, ShortForm()
]
Loading = Annotated[
    tuple[LoadStage, ...], one_or_more("stages", _LOADS, '{load = "1 mN", duration = "1 us"}'), _plain_stages, ShortForm()
]
"""Loads after the end of settling; the last one stays. They have the meaning of `load`: on the plate, or on each patch."""


class Motion(Part):
    """Motion of the upper plate along x and y; an axis that is not given rests. Time counts from the end of settling."""

    x: Stages | None = None
    """Motion along this axis after settling, a stage or a list; by default at rest. Example: {velocity = "1 m/s"}."""
    y: Stages | None = None
    """Motion along this axis after settling, a stage or a list; by default at rest. Example: {velocity = "1 m/s"}."""

    def checks(self) -> list[Wrong]:
        late = "belongs to the first stage: the spring is that of the whole axis"
        axes = {"x": self.x or (), "y": self.y or ()}
        return [((axis, k, "through"), late) for axis, stages in axes.items() for k in range(1, len(stages)) if stages[k].through]

    @property
    def through(self) -> tuple[float, float]:
        """Stiffness of the springs along x and y [N/m]; 0: none."""
        x, y = (stages[0].through or 0.0 if stages else 0.0 for stages in (self.x, self.y))
        return x, y

    @property
    def springs(self) -> dict[str, float]:
        """Stiffness [N/m] of each spring by its key in this table."""
        firsts = {
            "x.0" if len(self.x or ()) > 1 else "x": self.through[0],
            "y.0" if len(self.y or ()) > 1 else "y": self.through[1],
        }
        return {f"{first}.through": through for first, through in firsts.items() if through}

    def moving(self) -> bool:
        """Return whether anything ever moves."""
        drives = (*(self.x or ()), *(self.y or ()))
        return any(not isinstance(drive, Pause) and getattr(drive, "velocity", 1.0) != 0.0 for drive in drives)
