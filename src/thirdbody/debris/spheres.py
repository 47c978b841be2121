"""Debris of the kind `spheres`: bodies of given spheres, placed by the program or at given positions."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator

from thirdbody.debris.contract import MAX_SPHERES_PER_BODY, UPRIGHT, PlacedClumps, Placement, PopulationContext, VolumeKeys
from thirdbody.errors import Fault, InputError
from thirdbody.schema.fields import AT_REST, Count, Point, PositiveLength, Quantity, listing
from thirdbody.schema.parts import MISSING, Location, Part, Wrong, one_of


class Ball(Part):
    """One sphere of a body: its centre and radius, m."""

    center: Point = AT_REST
    """Centre in the frame of the body. Example: ["3 um", "0 um", "0 um"]."""
    radius: PositiveLength
    """Radius of the sphere. Example: "2 um"."""


def _unit_quaternion(q: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    # One of unit length up to rounding is unchanged; else saving and reading would change its last bits.
    if abs(math.hypot(*q) - 1.0) < 1e-15:
        return q
    largest = max(abs(part) for part in q)
    if largest == 0.0:
        raise ValueError("a quaternion (w, x, y, z) of length zero is no orientation")
    w, x, y, z = (part / largest for part in q)
    norm = math.hypot(w, x, y, z)
    return w / norm, x / norm, y / norm, z / norm


_Number = Annotated[float, Quantity()]
Quaternion = Annotated[
    tuple[_Number, _Number, _Number, _Number], listing("a list of 4 values (w, x, y, z)", 4), AfterValidator(_unit_quaternion)
]


class Spheres(VolumeKeys):
    """Bodies of given spheres: single balls of one `radius`, or all of one `shape`; by `placement` or at
    `positions` (centres of mass, m) in one `orientation` (w, x, y, z; body to world).
    """

    kind: Literal["spheres"] = "spheres"
    radius: PositiveLength | None = None
    """Radius of single spheres; give it or `shape`. Example: "5 um"."""
    shape: Annotated[tuple[Ball, ...], listing("a list of tables {center, radius}")] | None = None
    """Spheres of each body; give it or `radius`.
    Example: [{radius = "2 um"}, {center = ["3 um", "0 um", "0 um"], radius = "2 um"}]."""
    count: Count
    """Number of bodies; may be left out with `positions`. Example: 100."""
    placement: Placement | None = None
    """How bodies are placed; by default "layer", unless `positions` are given. Example: "dilute"."""
    positions: Annotated[tuple[Point, ...], listing("a list of points")] | None = None
    """Centres of mass, one per body; instead of `placement`. Example: [["5 um", "5 um", "5 um"]]."""
    orientation: Quaternion | None = None
    """Quaternion (w, x, y, z), body to world; needs `positions`. Example: [1, 0, 0, 0]."""

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        faults = super().rules(raw, context) + one_of(raw, ("radius", "shape"))
        for key in ("shape", "positions"):
            if isinstance(raw.get(key), list | tuple) and not raw[key]:
                faults.append(((key,), "the list is empty"))
        if "positions" not in raw:
            if "count" not in raw:
                faults.append((("count",), f"{MISSING}: give count, or positions"))
            if "orientation" in raw:
                faults.append((("orientation",), "needs positions: a placement chooses the pose of each body"))
        elif "placement" in raw:
            faults.append((("placement",), "give only one of placement, positions"))
        return faults

    @classmethod
    def arrange(cls, raw: dict[str, Any]) -> dict[str, Any]:
        if "positions" not in raw:
            return {"placement": "layer"} | raw
        positions = raw["positions"]
        return {"count": len(positions)} | raw if hasattr(positions, "__len__") else raw

    def checks(self) -> list[Wrong]:
        if self.shape is not None and len(self.shape) > MAX_SPHERES_PER_BODY:
            return [(("shape",), f"{len(self.shape)} spheres, at most {MAX_SPHERES_PER_BODY} make a body")]
        if self.positions is None or self.count == len(self.positions):
            return []
        return [(("count",), f"{self.count} is not the number of positions, {len(self.positions)}")]

    def max_spheres(self) -> int:
        return len(self.shape) if self.shape else 1

    def typical_diameter(self, context: PopulationContext) -> tuple[float, float]:
        radii = [self.radius] if self.radius is not None else [ball.radius for ball in self.shape or ()]
        return 2.0 * max(radii), 1.0

    def bodies(self, context: PopulationContext) -> PlacedClumps:
        import numpy as np

        from thirdbody.bodies.clump import clump_with_frame, repeated_spheres
        from thirdbody.rotations import quaternion_product

        balls = (self.shape or ()) if self.radius is None else (Ball(radius=self.radius),)
        centers, radii = np.array([ball.center for ball in balls], float), np.array([ball.radius for ball in balls])
        if repeated := repeated_spheres(centers, radii):
            message = "repeats debris[{}].shape[{}]: the same center and radius; remove one"
            raise InputError(Fault(f"shape[{k}]", message.format(context.index, first)) for k, first in repeated)
        try:
            body, _, frame = clump_with_frame(centers, radii)
        except InputError as error:  # its keys are "spheres[6].center", for spheres in the scene's `shape`
            indices = ["".join(re.findall(r"\[\d+\]", fault.key)[:1]) for fault in error.faults]
            raise InputError(
                Fault(f"shape{index}", fault.message) for index, fault in zip(indices, error.faults, strict=True)
            ) from None
        rotation = np.array(UPRIGHT if self.orientation is None else self.orientation)
        positions = None if self.positions is None else np.array(self.positions, float)
        return PlacedClumps([body] * self.count, quaternion_product(rotation, frame), positions)

    def position_key(self, body: int) -> Location:
        return () if self.positions is None else ("positions", body)


KIND = Spheres
