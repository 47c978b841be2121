"""Debris of the kind `spheres`: bodies of given spheres, placed by the program or at given positions."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator

from thirdbody.errors import Fault, InputError
from thirdbody.scene.debris.contract import MAX_SPHERES_PER_BODY, Placement, VolumeKeys
from thirdbody.scene.debris.population import UPRIGHT, PlacedClumps, PopulationContext
from thirdbody.scene.field_types import (
    AT_REST,
    AngularVelocity,
    Count,
    Number,
    Point,
    PositiveLength,
    Seed,
    Text,
    Velocity,
    listing,
)
from thirdbody.scene.schema_base import MISSING, Location, Part, Wrong, one_of

if TYPE_CHECKING:
    import numpy as np

    from thirdbody.bodies.clump import Clump


class Ball(Part):
    """One sphere of a body: its centre and radius, m."""

    center: Point = AT_REST
    """Centre in the frame of the body. Example: ["3 um", "0 um", "0 um"]."""
    radius: PositiveLength
    """Radius of the sphere. Example: "2 um"."""


def _unit_quaternion(q: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return the normalised quaternion. Raises ValueError for zero."""
    # One of unit length up to rounding is unchanged; else saving and reading would change its last bits.
    if abs(math.hypot(*q) - 1.0) < 1e-15:
        return q
    largest = max(abs(part) for part in q)
    if largest == 0.0:
        raise ValueError("a quaternion (w, x, y, z) of length zero is no orientation")
    w, x, y, z = (part / largest for part in q)
    norm = math.hypot(w, x, y, z)
    return w / norm, x / norm, y / norm, z / norm


Quaternion = Annotated[
    tuple[Number, Number, Number, Number], listing("a list of 4 values (w, x, y, z)", 4), AfterValidator(_unit_quaternion)
]


class Spheres(VolumeKeys):
    """Bodies of given spheres: single balls of one `radius`, or all of one `shape`; by `placement` or at
    `positions` (centres of mass, m) in one `orientation` (w, x, y, z; body to world).
    """

    kind: Literal["spheres"] = "spheres"
    material: Text
    radius: PositiveLength | None = None
    """Radius of single spheres; give it or `shape`. Example: "5 um"."""
    shape: Annotated[tuple[Ball, ...], listing("a list of tables {center, radius}")] | None = None
    """Spheres of one body, the same for all bodies; give it or `radius`.

    Example: [{center = ["0 um", "0 um", "0 um"], radius = "2 um"}, {center = ["3 um", "0 um", "0 um"], radius = "2 um"}].
    """
    count: Count
    """Number of bodies; may be left out where `positions` are given. Example: 100."""
    seed: Seed = 1
    placement: Placement | None = None
    """How bodies are placed; "layer" unless `positions` are given. Example: "dilute"."""
    positions: Annotated[tuple[Point, ...], listing("a list of points")] | None = None
    """Centres of mass, one point per body; instead of `placement`. Example: [["5 um", "5 um", "5 um"]]."""
    orientation: Quaternion | None = None
    """Quaternion (w, x, y, z), body to world; needs `positions`. Example: [1, 0, 0, 0]."""
    velocity: Velocity = AT_REST
    angular_velocity: AngularVelocity = AT_REST

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        """Return faults that follow from which keys are given."""
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
        """Return the table with the count of the positions, or with the default placement."""
        if "positions" not in raw:
            return {"placement": "layer"} | raw
        positions = raw["positions"]
        return {"count": len(positions)} | raw if hasattr(positions, "__len__") else raw

    def checks(self) -> list[Wrong]:
        """Return faults between count and positions, and of a body of too many spheres."""
        if self.shape is not None and len(self.shape) > MAX_SPHERES_PER_BODY:
            return [(("shape",), f"{len(self.shape)} spheres, at most {MAX_SPHERES_PER_BODY} make a body")]
        if self.positions is None or self.count == len(self.positions):
            return []
        return [(("count",), f"{self.count} is not the number of positions, {len(self.positions)}")]

    def max_spheres(self) -> int:
        """Return the number of spheres of a body."""
        return len(self.shape) if self.shape else 1

    def typical_diameter(self, context: PopulationContext) -> tuple[float, float]:
        """Return the diameter [m] of the largest sphere."""
        radii = [self.radius] if self.radius is not None else [ball.radius for ball in self.shape or ()]
        return 2.0 * max(radii), 1.0

    def bodies(self, context: PopulationContext) -> PlacedClumps:
        """Return the bodies, all alike. Raises InputError."""
        import numpy as np

        from thirdbody.rotations import quaternion_product

        body, frame = self._body(context.index)
        rotation = np.array(UPRIGHT if self.orientation is None else self.orientation)
        positions = None if self.positions is None else np.array(self.positions, float)
        return PlacedClumps([body] * self.count, quaternion_product(rotation, frame), positions)

    def _body(self, population: int) -> tuple[Clump, np.ndarray]:
        """Return the body, and the quaternion of its principal frame in the frame of `shape`."""
        import numpy as np

        from thirdbody.bodies.clump import clump_with_frame, repeated_spheres

        if self.shape is None:
            body, _, frame = clump_with_frame(np.zeros((1, 3)), np.array([self.radius]))
            return body, frame
        centers = np.array([ball.center for ball in self.shape], float)
        radii = np.array([ball.radius for ball in self.shape])
        if repeated := repeated_spheres(centers, radii):
            message = "repeats debris[{}].shape[{}]: the same center and radius; remove one"
            raise InputError(Fault(f"shape[{k}]", message.format(population, first)) for k, first in repeated)
        try:
            body, _, frame = clump_with_frame(centers, radii)
        except InputError as error:  # its keys are "spheres[6]", for spheres in the scene's `shape`
            raise InputError(Fault("shape" + _index(fault.key), fault.message) for fault in error.faults) from None
        return body, frame

    def position_key(self, body: int) -> Location:
        """Return the entry of `positions`."""
        return () if self.positions is None else ("positions", body)


def _index(key: str) -> str:
    """Return the first index in a key such as "spheres[6].center": "[6]"."""
    return "".join(re.findall(r"\[\d+\]", key)[:1])


KIND = Spheres
