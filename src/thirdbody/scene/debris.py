"""The debris of a scene: populations of irregular bodies, of spheres, or of bodies from a mesh or a table."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, ValidationInfo
from pydantic_core import core_schema

from thirdbody.scene import units
from thirdbody.scene.fields import Choice, Quantity, Whole, listing, show
from thirdbody.scene.json_schema import ShortForm, quantity_schema
from thirdbody.scene.part import MISSING, Part, Wrong, one_of, tagged
from thirdbody.scene.sizes import Size
from thirdbody.scene.spots import Spots
from thirdbody.scene.types import (
    REST,
    THREE,
    AngularVelocity,
    Count,
    Fraction,
    Number,
    Point,
    PositiveLength,
    Seed,
    Text,
    Velocity,
)

_WHOLE = Whole(ge=1, le=64)
MOST_OF_A_BODY = 100
"""Spheres of one given body: memory for its mass properties grows with the cube, 0.4 GB for 100 and 31 GB for 300."""

SpheresPerBody = Annotated[int, _WHOLE]
Placement = Annotated[Literal["layer", "dilute", "dense"], Choice()]


class _Volume(Part):
    """The `name` of a population, and what the debris of one scene may say of the volume that all "dilute", or all "dense"
    bodies share: its `height` over the lower plate (m) or the `solid_fraction` in it, by default 0.05, or 0.5."""

    name: Text | None = None
    height: PositiveLength | None = None
    solid_fraction: Fraction | None = None

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        """Faults that show in which keys are given."""
        if "height" in raw and "solid_fraction" in raw:
            return [(("solid_fraction",), "give only one of height, solid_fraction: height is given too")]
        if raw.get("placement", "layer") != "layer":
            return []
        why = "needs placement = 'dilute' or 'dense'"
        return [((key,), why) for key in ("height", "solid_fraction") if key in raw]


def _sphere_range(value: Any, info: ValidationInfo) -> Any:
    """A single number as the range that it stands for."""
    if hasattr(value, "__len__"):
        return value
    number = _WHOLE.read(value, info)
    return [number, number]


_RELATIVE = Quantity(gt=0, le=0.5)
_ABSOLUTE = Quantity(dimension="length", gt=0)


@dataclass(frozen=True)
class _LengthOrFraction:
    """A length as text with a unit, kept as that text, or a bare fraction: in a scene nothing else tells them apart."""

    def read(self, value: Any, info: ValidationInfo) -> float | str:
        """The fraction, or the text. Raises ValueError."""
        if isinstance(value, str):
            _ABSOLUTE.read(value, info)
            return value
        try:
            return _RELATIVE.read(value, info)
        except ValueError as error:
            raise ValueError(f"{error}: a length ('0.5 um'), or a fraction of the body's equivalent radius") from None

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.with_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {"anyOf": [quantity_schema("dimensionless", _RELATIVE.limits()), quantity_schema("length", {})]}


class Asperities(Part):
    """Small spheres on each body: `count` of one `radius`, a length ("0.5 um") or a fraction of the body's equivalent radius."""

    count: Annotated[int, Whole(ge=1, le=32)] = 3
    radius: Annotated[float | str, _LengthOrFraction()]

    @property
    def length(self) -> float | None:
        """The radius in m; None if it is a fraction."""
        return units.parse(self.radius, "length") if isinstance(self.radius, str) else None


class Irregular(_Volume):
    """Random clumps. `size` is the volume-equivalent diameter (m), `spheres` the least and most per clump.

    `angularity` (0 to 1) shrinks the spheres towards the corners of the hull; `asperities` sit on the surface.
    """

    kind: Literal["irregular"] = "irregular"
    material: Text
    count: Count
    seed: Seed = 1
    size: Size
    spheres: Annotated[
        tuple[SpheresPerBody, SpheresPerBody],
        listing("[least, most] or one whole number", 2),
        BeforeValidator(_sphere_range),
        ShortForm({"type": "integer"}),
    ]
    aspect: Annotated[tuple[Fraction, Fraction, Fraction], THREE]
    angularity: Annotated[float, Quantity(ge=0, le=1)] | None = None
    asperities: Asperities | None = None
    placement: Placement = "layer"
    velocity: Velocity = REST
    angular_velocity: AngularVelocity = REST

    def checks(self) -> list[Wrong]:
        """Faults between the limits."""
        least, most = self.spheres
        return [(("spheres",), f"the least, {least}, is more than the most, {most}")] if least > most else []


class Ball(Part):
    """One sphere of a body: its centre and radius, m."""

    center: Point = REST
    radius: PositiveLength


def _unit_quaternion(q: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """The quaternion at length 1. Raises ValueError for zero."""
    # One that is unit to rounding stays as it is, or saving and reading would change its last bits.
    if abs(math.hypot(*q) - 1.0) < 1e-15:
        return q
    largest = max(abs(part) for part in q)
    if largest == 0.0:
        raise ValueError("a quaternion (w, x, y, z) of length zero is no orientation")
    w, x, y, z = (part / largest for part in q)
    norm = math.hypot(w, x, y, z)
    return w / norm, x / norm, y / norm, z / norm


Quaternion = Annotated[
    tuple[Number, Number, Number, Number],
    listing("a list of 4 values (w, x, y, z)", 4),
    AfterValidator(_unit_quaternion),
]


class Spheres(_Volume):
    """Bodies of given spheres: single balls of one `radius`, or all of one `shape`; by `placement` or at
    `positions` (centres of mass, m) in one `orientation` (w, x, y, z; body to world)."""

    kind: Literal["spheres"] = "spheres"
    material: Text
    radius: PositiveLength | None = None
    shape: Annotated[tuple[Ball, ...], listing("a list of tables {center, radius}")] | None = None
    count: Count
    seed: Seed = 1
    placement: Placement | None = None
    positions: Annotated[tuple[Point, ...], listing("a list of points")] | None = None
    orientation: Quaternion | None = None
    velocity: Velocity = REST
    angular_velocity: AngularVelocity = REST

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        """Faults that show in which keys are given."""
        wrongs = super().rules(raw, context) + one_of(raw, ("radius", "shape"))
        for key in ("shape", "positions"):
            if isinstance(raw.get(key), list | tuple) and not raw[key]:
                wrongs.append(((key,), "the list is empty"))
        if "positions" not in raw:
            if "count" not in raw:
                wrongs.append((("count",), f"{MISSING}: give count, or positions"))
            if "orientation" in raw:
                wrongs.append((("orientation",), "needs positions: a placement chooses the pose of each body"))
        elif "placement" in raw:
            wrongs.append((("placement",), "give only one of placement, positions"))
        return wrongs

    @classmethod
    def arrange(cls, raw: dict[str, Any]) -> dict[str, Any]:
        """The table with the count of the positions, or the placement that stands for none."""
        if "positions" not in raw:
            return {"placement": "layer"} | raw
        positions = raw["positions"]
        return {"count": len(positions)} | raw if hasattr(positions, "__len__") else raw

    def checks(self) -> list[Wrong]:
        """Faults between count and positions, and a body of too many spheres."""
        if self.shape is not None and len(self.shape) > MOST_OF_A_BODY:
            return [(("shape",), f"{len(self.shape)} spheres, at most {MOST_OF_A_BODY} make a body")]
        if self.positions is None or self.count == len(self.positions):
            return []
        return [(("count",), f"{self.count} is not the number of positions, {len(self.positions)}")]


@dataclass(frozen=True)
class _Files:
    """The name of a file or folder, or a list of names of files."""

    def read(self, value: Any, info: ValidationInfo) -> str | list[str]:
        """The name or the names. Raises ValueError."""
        names = list(value) if isinstance(value, list | tuple) else [value]
        if not names or not all(isinstance(name, str) for name in names):
            raise ValueError(f"expected a file, a folder or a list of files, got {show(value)}")
        return value if isinstance(value, str) else names

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.with_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]}


class Mesh(_Volume):
    """Bodies from closed surface meshes (STL, OBJ or PLY): clumps of `spheres` spheres with the mesh's volume and inertia.

    `file` is a mesh file, a list of them, or a folder of them (in the order of their names): the bodies take the meshes in
    turn, from the first again after the last. `unit` is the length of one unit of the files, m; `size` (volume-equivalent
    diameter, m), if given, rescales each body.
    """

    kind: Literal["mesh"] = "mesh"
    material: Text
    file: Annotated[str | list[str], _Files()]
    unit: PositiveLength
    spheres: Annotated[int, Whole(ge=4, le=40)] = 12
    count: Count
    seed: Seed = 1
    size: Size | None = None
    placement: Placement = "layer"
    velocity: Velocity = REST
    angular_velocity: AngularVelocity = REST


class File(_Volume):
    """Bodies from a table of spheres, CSV (units in its header) or NPZ (SI); `file` is relative to the scene.

    Without `placement` the bodies lie where the file says: its centers are world coordinates, and quaternions turn each
    body about its centre of mass. With `placement` only the shapes are taken, one after the other, from the first again
    after the last, for `count` bodies (as many as the file has), each rescaled to `size` (volume-equivalent diameter, m).
    `velocity` and `angular_velocity` hold for all bodies, where the file has none.
    """

    kind: Literal["file"] = "file"
    material: Text
    file: Text
    count: Count | None = None
    seed: Seed = 1
    size: Size | None = None
    placement: Placement | None = None
    velocity: Velocity | None = None
    angular_velocity: AngularVelocity | None = None

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        """Faults that show in which keys are given."""
        wrongs = super().rules(raw, context)
        if "placement" in raw:
            return wrongs
        why = "needs placement: without one, the bodies are those of the file, where it says"
        return wrongs + [((key,), why) for key in ("count", "size") if key in raw]


KINDS: dict[str, type[Part]] = {"irregular": Irregular, "spheres": Spheres, "mesh": Mesh, "spots": Spots, "file": File}
Debris = Annotated[Irregular | Spheres | Mesh | Spots | File, tagged("kind", KINDS)]


def population_names(populations: Sequence[Debris]) -> list[str]:
    """Names of all populations: what the scene gives, else material and kind: `bronze (irregular)`, `bronze (irregular) 2`."""
    taken = {debris.name for debris in populations if debris.name}
    names = []
    for debris in populations:
        name = debris.name
        if not name:
            plain = f"{debris.material} ({debris.kind})"
            numbered = (f"{plain} {k}" for k in itertools.count(2))
            name = next(text for text in itertools.chain([plain], numbered) if text not in taken)
            taken.add(name)
        names.append(name)
    return names


def most_spheres(debris: Debris) -> int:
    """Spheres of one body at most, as far as the scene tells: 1 for bodies that a file has."""
    if isinstance(debris, Irregular):
        return debris.spheres[1] + (debris.asperities.count if debris.asperities else 0)
    if isinstance(debris, Spots):
        return len(debris.spots)
    return debris.spheres if isinstance(debris, Mesh) else len(getattr(debris, "shape", None) or (0,))
