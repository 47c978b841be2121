"""Changes of the load of the upper plate: a ramp or step, a pause, a table; or a list of such stages."""

from typing import Annotated

from pydantic import PlainSerializer

from thirdbody.scene.field_types import Force, PositiveTime
from thirdbody.scene.json_schema import ShortForm
from thirdbody.scene.motion import Pause, Table
from thirdbody.scene.schema_base import Part
from thirdbody.scene.stages import plain_stages, stages


class Load(Part):
    """Linear change of the load to `load` [N] during `duration` [s]; without a duration at once."""

    load: Force
    """Load at the end of a linear change. Example: "0 N"."""
    duration: PositiveTime | None = None
    """Duration of the change; without one it is sudden. Example: "1 us"."""


LoadStage = Load | Pause | Table

_LOADS: dict[str, type[Part]] = {"load": Load, "pause": Pause, "table": Table}

Loading = Annotated[
    tuple[LoadStage, ...],
    stages(_LOADS, '{load = "1 mN", duration = "1 us"}', lambda stage: None),
    PlainSerializer(plain_stages),
    ShortForm(),
]
"""Loads after the end of settling; the last one stays. They have the meaning of `load`: on the plate, or on each patch."""
