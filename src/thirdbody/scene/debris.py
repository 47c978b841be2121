"""The debris of a scene: populations of irregular bodies, of spheres, or of bodies from a mesh."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, ValidationInfo

from thirdbody.scene.fields import Choice, Whole, listing
from thirdbody.scene.part import MISSING, Part, Wrong, one_of, tagged
from thirdbody.scene.sizes import Size
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
SpheresPerBody = Annotated[int, _WHOLE]
Placement = Annotated[Literal["layer"], Choice(later=("dilute", "dense"))]


def _sphere_range(value: Any, info: ValidationInfo) -> Any:
    """A single number as the range that it stands for."""
    if hasattr(value, "__len__"):
        return value
    number = _WHOLE.read(value, info)
    return [number, number]


class Irregular(Part):
    """Random clumps. `size` is the volume-equivalent diameter (m), `spheres` the least and most per clump."""

    kind: Literal["irregular"] = "irregular"
    material: Text
    count: Count
    seed: Seed = 1
    size: Size
    spheres: Annotated[
        tuple[SpheresPerBody, SpheresPerBody],
        listing("[least, most] or one whole number", 2),
        BeforeValidator(_sphere_range),
    ]
    aspect: Annotated[tuple[Fraction, Fraction, Fraction], THREE]
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


class Spheres(Part):
    """Bodies of given spheres: single balls of one `radius`, or all of one `shape`; laid as a layer or at
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
        wrongs = one_of(raw, ("radius", "shape"))
        for key in ("shape", "positions"):
            if isinstance(raw.get(key), list | tuple) and not raw[key]:
                wrongs.append(((key,), "the list is empty"))
        if "positions" not in raw:
            if "count" not in raw:
                wrongs.append((("count",), f"{MISSING}: give count, or positions"))
            if "orientation" in raw:
                wrongs.append((("orientation",), "needs positions: a layer chooses the pose of each body"))
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
        """Faults between count and positions."""
        if self.positions is None or self.count == len(self.positions):
            return []
        return [(("count",), f"{self.count} is not the number of positions, {len(self.positions)}")]


class Mesh(Part):
    """Bodies from a closed surface mesh (STL, OBJ or PLY): clumps of `spheres` spheres with the mesh's volume and inertia.

    `unit` is the length of one unit of the file, m; `size` (volume-equivalent diameter, m), if given, rescales each body.
    """

    kind: Literal["mesh"] = "mesh"
    material: Text
    file: Text
    unit: PositiveLength
    spheres: Annotated[int, Whole(ge=4, le=40)] = 12
    count: Count
    seed: Seed = 1
    size: Size | None = None
    placement: Placement = "layer"
    velocity: Velocity = REST
    angular_velocity: AngularVelocity = REST


KINDS: dict[str, type[Part]] = {"irregular": Irregular, "spheres": Spheres, "mesh": Mesh}
Debris = Annotated[Irregular | Spheres | Mesh, tagged("kind", KINDS, later=("file", "spots"))]
