"""Pressure profiles of the upper body: a contact with an edge, under which a particle carries the load of its position."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import TypeAdapter, WrapValidator

from thirdbody.schema.fields import PositiveLength, PositivePressure, Quantity, Text, TwoPositiveLengths
from thirdbody.schema.parts import MISSING, Part, Wrong, one_of, table_by_kind

PositiveForce = Annotated[float, Quantity(dimension="force", gt=0)]
LoadFraction = Annotated[float, Quantity(gt=0, le=1)]


class WithEdge(Part):
    """A contact with an edge."""

    debris_fraction: LoadFraction = 1.0
    """Part of the load that debris carries at the start; direct contact of the plates carries the rest. Example: 0.8."""
    out_after: PositiveLength | None = None
    """A body that stays outside the contact while the upper body moves this far is `out`. By default the path of one cycle of
    strokes; without strokes the width of the contact. Example: "100 um"."""


class Uniform(Part):
    """The same pressure everywhere."""

    profile: Literal["uniform"]
    """Pressure profile. Example: "hertz"."""
    load: PositiveForce
    """Load on all bodies together. Example: "2 N"."""


class Punch(WithEdge):
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

    def checks(self) -> list[Wrong]:
        return [] if self.edge <= min(self.width) else [(("edge",), "is longer than a width")]


class Hertz(WithEdge):
    """A ball, or a cylinder whose axis is along y, on a flat: Hertz' pressure of the materials of both plates."""

    profile: Literal["hertz"]
    """Pressure profile. Example: "hertz"."""
    body: Literal["ball", "cylinder"]
    """Upper body; the axis of a cylinder is along y. Example: "ball"."""
    radius: PositiveLength
    """Its radius. Example: "10 mm"."""
    load: PositiveForce | None = None
    """Load on it; for a cylinder, on the part of it in the domain. Example: "5 N"."""
    load_per_length: Annotated[float, Quantity(dimension="line_load", gt=0)] | None = None
    """Load on a cylinder per length along its axis, instead of `load`. Example: "500 N/m"."""

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        if raw.get("body") == "ball" and "load_per_length" in raw:
            return [(("load_per_length",), 'is of body = "cylinder": a ball has a load')]
        if raw.get("body") == "ball" and "load" not in raw:
            return [(("load",), MISSING)]
        return one_of(raw, ("load", "load_per_length"))


class PressureMap(WithEdge):
    """A pressure map from a CSV file, bilinear between the nodes of a regular grid, zero outside."""

    profile: Literal["table"]
    """Map from a file, bilinear between the nodes of a regular grid, zero outside. Example: "table"."""
    table: Text
    """CSV file with the header `x (um), y (um), pressure (MPa)`, and `, gap (um)` where the upper body is not flat outside the
    contact; beyond the map the gap is that at its border. Positions count from the middle of the contact. Example: "map.csv"."""
    load: PositiveForce | None = None
    """Load on the upper body, to which the pressure is scaled; by default the integral of the map. Example: "2 N"."""


Profile = Uniform | Punch | Hertz | PressureMap

KINDS: Mapping[str, type[Part]] = {"uniform": Uniform, "punch": Punch, "hertz": Hertz, "table": PressureMap}

_value = TypeAdapter(PositivePressure)


def _read(value: Any, handler: Any, info: Any) -> Any:
    if isinstance(value, Profile):
        return value
    if isinstance(value, Mapping):
        return table_by_kind(value, info, "profile", KINDS)
    return _value.validate_python(value, context=info.context)


Pressure = Annotated[PositivePressure | Uniform | Punch | Hertz | PressureMap, WrapValidator(_read)]
