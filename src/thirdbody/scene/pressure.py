"""Pressure profiles of the upper body: a contact with an edge, under which a particle carries the load of its position."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import TypeAdapter, WrapValidator

from thirdbody.schema.fields import PositiveLength, PositivePressure, Quantity, TwoPositiveLengths
from thirdbody.schema.parts import Part, Wrong, table_by_kind

PositiveForce = Annotated[float, Quantity(dimension="force", gt=0)]
LoadFraction = Annotated[float, Quantity(gt=0, le=1)]


class Uniform(Part):
    """The same pressure everywhere."""

    profile: Literal["uniform"]
    """Pressure profile. Example: "hertz"."""
    load: PositiveForce
    """Load on all bodies together. Example: "2 N"."""


class Punch(Part):
    """A flat punch: the same pressure on its face; beyond its edge a chamfer of 45 degrees."""

    profile: Literal["punch"]
    """Pressure profile. Example: "punch"."""
    load: PositiveForce
    """Load on the upper body. Example: "2 N"."""
    width: TwoPositiveLengths
    """Width of its face along x and y; where it is the width of the domain the face has no edge in that
    direction. Example: ["200 um", "100 um"]."""
    edge: PositiveLength
    """Length over which the pressure falls to zero around the edge. Example: "10 um"."""
    debris_fraction: LoadFraction = 1.0
    """Part of the load that debris carries at the start; direct contact of the plates carries the rest. Example: 0.8."""
    out_after: PositiveLength | None = None
    """A body that stays outside the contact while the upper body moves this far is `out`. By default the path of one cycle of
    strokes; without strokes the width of the contact. Example: "100 um"."""

    def checks(self) -> list[Wrong]:
        return [] if self.edge <= min(self.width) else [(("edge",), "is longer than a width")]


class Hertz(Part):
    """A ball, or a cylinder whose axis is along y, on a flat: Hertz' pressure of the materials of both plates."""

    profile: Literal["hertz"]
    """Pressure profile. Example: "hertz"."""
    body: Literal["ball", "cylinder"]
    """Upper body; the axis of a cylinder is along y. Example: "ball"."""
    radius: PositiveLength
    """Its radius. Example: "10 mm"."""
    load: PositiveForce
    """Load on it; for a cylinder, on the part of it in the domain. Example: "5 N"."""
    debris_fraction: LoadFraction = 1.0
    """Part of the load that debris carries at the start; direct contact of the plates carries the rest. Example: 0.8."""
    out_after: PositiveLength | None = None
    """A body that stays outside the contact while the upper body moves this far is `out`. By default the path of one cycle of
    strokes; without strokes the width of the contact. Example: "100 um"."""


Profile = Uniform | Punch | Hertz

KINDS: Mapping[str, type[Part]] = {"uniform": Uniform, "punch": Punch, "hertz": Hertz}

_value = TypeAdapter(PositivePressure)


def _read(value: Any, handler: Any, info: Any) -> Any:
    if isinstance(value, Profile):
        return value
    if isinstance(value, Mapping):
        return table_by_kind(value, info, "profile", KINDS)
    return _value.validate_python(value, context=info.context)


Pressure = Annotated[PositivePressure | Uniform | Punch | Hertz, WrapValidator(_read)]
