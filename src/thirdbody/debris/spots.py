"""The debris kind `spots`: a particle given by the spots that it rests on, as in Willert's three-spot theory."""

import math
import numbers
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, ValidationInfo

from thirdbody.debris.contract import CLEARANCE, DebrisKind, PlacedClumps, PopulationContext
from thirdbody.schema.fields import (
    AT_REST,
    THREE,
    Count,
    Flag,
    Length,
    PositiveLength,
    PositiveMass,
    Quantity,
    ShortForm,
    TwoLengths,
    listing,
    plain,
    quantity_schema,
)
from thirdbody.schema.parts import Location, Part, Wrong

_INERTIA = Quantity(dimension="inertia", gt=0)


class Spot(Part):
    """A summit that meets one plate only: its place relative to the centre of mass (m), and its radius of curvature."""

    side: Literal["lower", "upper"]
    """Plate that the spot meets, its only partner. Example: "lower"."""
    x: Length
    """Position relative to the centre of mass. Example: "-2 um"."""
    y: Length = 0.0
    """Position relative to the centre of mass. Example: "1 um"."""
    z: Length
    """Position relative to the centre of mass. Example: "-2 um"."""
    radius: PositiveLength
    """Radius of curvature. Example: "1 um"."""


def _three_moments(value: Any, info: ValidationInfo) -> Any:
    if not isinstance(value, str | numbers.Real):
        return value
    _INERTIA.read(value, info)  # so that a fault is reported once
    return [value] * 3


Moments = Annotated[
    tuple[Annotated[float, _INERTIA], Annotated[float, _INERTIA], Annotated[float, _INERTIA]],
    THREE,
    BeforeValidator(_three_moments),
    ShortForm(quantity_schema("inertia", _INERTIA.limits())),
]


class Spots(DebrisKind):
    """Particles given by spots, their mass (kg) and their moments of inertia about x, y, z (kg m2; one stands for all).

    Every spot meets the plate of its side and nothing else, however large its radius. `planar` particles have their spots
    in the plane y = 0, and nothing may drive them out of it. They stand as they are given, on the lower plate, in rows
    over the domain or at `positions` (x, y; m).
    """

    meets_debris: ClassVar[bool] = False

    kind: Literal["spots"] = "spots"
    spots: Annotated[tuple[Spot, ...], listing("a list of tables {side, x, y, z, radius}")]
    """Spots of a body, at least one on each side. Example: [{side = "upper", x = "0.2 um", z = "2 um", radius = "2 um"},
    {side = "lower", x = "0 um", z = "-2 um", radius = "1 um"}]."""
    mass: PositiveMass
    """Mass of a body. Example: "1e-13 kg"."""
    inertia: Moments
    """Moments of inertia about x, y, z, or one for all. Example: "2e-25 kg m2"."""
    planar: Flag = False
    """Whether bodies must stay in the plane y = 0; a drive out of it is refused. Example: true."""
    count: Count = 1
    """Number of equal bodies; may be left out with `positions`. Example: 3."""
    positions: Annotated[tuple[TwoLengths, ...], listing("a list of points [x, y]")] | None = None
    """Positions x, y of the centres of mass; by default rows over the domain. Example: [["6 um", "4 um"]]."""

    @classmethod
    def arrange(cls, raw: dict[str, Any]) -> dict[str, Any]:
        positions = plain(raw.get("positions"))
        return {"count": len(positions)} | raw if isinstance(positions, list) and positions else raw

    def checks(self) -> list[Wrong]:
        from thirdbody.bodies.clump import impossible_moments

        sides = {spot.side for spot in self.spots}
        faults: list[Wrong] = [
            (("spots",), f"no spot on the {side} side: a third body touches both")
            for side in ("lower", "upper")
            if side not in sides
        ]
        if odd := impossible_moments([self.inertia]):
            faults.append((("inertia",), f"{odd[1]} (kg m2)"))
        if self.positions is not None and len(self.positions) != self.count:
            faults.append((("count",), f"{self.count} is not the number of positions, {len(self.positions)}"))
        if not faults and self.height() <= 0.0:
            message = "the upper spots are not above the lower ones: z is measured upwards from the centre of mass"
            faults.append((("spots",), message))
        if self.planar:
            faults += [
                (("spots", k, "y"), "must be 0 in a planar particle") for k, spot in enumerate(self.spots) if spot.y != 0.0
            ]
            if (self.velocity or AT_REST)[1] != 0.0:
                faults.append((("velocity", 1), "must be 0 in a planar particle, which moves in the plane y = 0"))
            why = "must be 0 in a planar particle, which turns about y only"
            faults += [(("angular_velocity", axis), why) for axis in (0, 2) if (self.angular_velocity or AT_REST)[axis] != 0.0]
        return faults

    def height(self) -> float:
        """Return the distance between the highest upper and the lowest lower spot [m]."""
        z = {side: [spot.z for spot in self.spots if spot.side == side] for side in ("lower", "upper")}
        return max(z["upper"]) - min(z["lower"])

    @property
    def in_plane(self) -> bool:
        return self.planar

    def max_spheres(self) -> int:
        return len(self.spots)

    def bodies(self, context: PopulationContext) -> PlacedClumps:
        import numpy as np

        from thirdbody.bodies.clump import Clump
        from thirdbody.kernels.tables import ONLY_LOWER, ONLY_UPPER

        radii = np.array([spot.radius for spot in self.spots])
        upper = np.array([spot.side == "upper" for spot in self.spots])
        # a summit is the point that touches first; axes are the principal ones
        centers = np.array([(spot.x, spot.y, spot.z) for spot in self.spots])
        centers[:, 2] -= np.where(upper, radii, -radii)
        volume, inertia = self.mass / context.density, np.array(self.inertia) / context.density
        body = Clump(centers, radii, volume, inertia, 0.0, np.where(upper, ONLY_UPPER, ONLY_LOWER))
        k, (width, depth) = np.arange(self.count), context.domain
        columns = max(1, round(math.sqrt(self.count * width / depth)))  # in rows: a nearly square rectangular grid
        lines = math.ceil(self.count / columns)
        locations = np.column_stack(((k % columns + 0.5) * width / columns, (k // columns + 0.5) * depth / lines))
        if self.positions is not None:
            locations = np.array(self.positions, float)
        height = CLEARANCE * self.height() - min(spot.z for spot in self.spots)
        return PlacedClumps([body] * self.count, positions=np.column_stack((locations, np.full(self.count, height))))

    def position_key(self, body: int) -> Location:
        return ("positions", body)


KIND = Spots
