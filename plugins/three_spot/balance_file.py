"""Input file of a single particle, read by `thirdbody balance` and checked in one go.

    balance = 1
    [materials.upper]                 # also lower, particle
    shear_modulus = "80 GPa"          # or youngs_modulus
    poisson_ratio = 0.3
    [friction]
    upper = 0.3
    lower = 0.3
    [particle]
    weight = "0 N"
    spots = [{side = "upper", x = "0.2 um", z = "2 um", radius = "2 um"}, ...]   # y = "0 um"
    [path]
    indentation = "10 nm"             # or load
    drag = "24 nm"
    steps = 480
    direction = [-1, 0]
    [effects]
    close_spots = {}                  # spots on one side lower the plate under each other

Instead of `spots` a `clump = [{center = ["0 um", "0 um", "0 um"], radius = "5 um"}, ...]` rotated by `quaternion` = [w, x, y, z]:
every sphere is a candidate of both sides, in the order upper, lower of the first sphere, then of the next.
"""

from __future__ import annotations

import math
import os
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from thirdbody.plugin import (
    Fault,
    Grip,
    InputError,
    Length,
    Part,
    PositiveLength,
    Quantity,
    Solid,
    Spot,
    Whole,
    Wrong,
    clump_with_frame,
    listing,
    matrix_from_quaternion,
    one_of,
    read_part,
)

VERSION = 1
MAX_SPHERES = 100
"""Maximum number of spheres of a clump: memory for its mass properties grows with the cube, 0.4 GB for 100 and 31 GB for 300."""
MAX_SPOTS = 1000  # maximum number of candidates of a balance, whose equations are solved together

Array = NDArray[np.float64]
Friction = Annotated[float, Quantity(ge=0)]
Number = Annotated[float, Quantity()]


class Materials(Part):
    """The two first bodies and the particle."""

    upper: Solid
    lower: Solid
    particle: Solid


class Frictions(Part):
    """Coefficient of friction of each side."""

    upper: Friction
    lower: Friction


class Ball(Part):
    """A sphere of a clump, m."""

    center: Annotated[tuple[Length, Length, Length], listing("a list of 3 lengths", 3)]
    radius: PositiveLength


class Particle(Part):
    """A rigid particle by its spots, or by the spheres that it is made of."""

    weight: Annotated[float, Quantity(dimension="force", ge=0)] = 0.0
    spots: Annotated[tuple[Spot, ...], listing("a list of tables {side, x, y, z, radius}")] | None = None
    clump: Annotated[tuple[Ball, ...], listing("a list of tables {center, radius}")] | None = None
    quaternion: Annotated[tuple[Number, Number, Number, Number], listing("a list of 4 numbers w, x, y, z", 4)] | None = None

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        """Spots or a clump, and a quaternion for a clump only."""
        if "quaternion" in raw and "clump" not in raw:
            return [*one_of(raw, ("spots", "clump")), (("quaternion",), "turns a clump; spots stand as they are given")]
        return one_of(raw, ("spots", "clump"))

    def checks(self) -> list[Wrong]:
        """Both sides, and the upper one above."""
        if self.quaternion is not None and not any(self.quaternion):
            return [(("quaternion",), "has no length")]
        if self.spots is None:
            if self.clump and len(self.clump) > MAX_SPHERES:
                return [(("clump",), f"{len(self.clump)} spheres, at most {MAX_SPHERES} make a body")]
            return [] if self.clump else [(("clump",), "at least one sphere is needed")]
        if len(self.spots) > MAX_SPOTS:
            return [(("spots",), f"{len(self.spots)} spots, at most {MAX_SPOTS}")]
        sides = {spot.side for spot in self.spots}
        missing = [side for side in ("lower", "upper") if side not in sides]
        if missing:
            return [(("spots",), f"no spot on the {side} side: nothing holds the particle against the other") for side in missing]
        if max(s.z for s in self.spots if s.side == "upper") <= min(s.z for s in self.spots if s.side == "lower"):
            return [(("spots",), "the upper spots are not above the lower ones: z is measured upwards from the centre of mass")]
        return []


class Path(Part):
    """Pressing, then drag of the upper body along `direction`; lengths in m, load in N. Without drag, the pressed state only."""

    indentation: PositiveLength | None = None
    load: Annotated[float, Quantity(dimension="force", gt=0)] | None = None
    drag: Annotated[float, Quantity(dimension="length", ge=0)] = 0.0
    steps: Annotated[int, Whole(ge=1, le=1_000_000)] = 480
    direction: Annotated[tuple[Number, Number], listing("a list of 2 numbers", 2)] = (-1.0, 0.0)

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        """Indentation or load."""
        return one_of(raw, ("indentation", "load"))

    def checks(self) -> list[Wrong]:
        """Return a fault for a direction of zero length."""
        return [] if any(self.direction) else [(("direction",), "has no length")]

    def heading(self) -> tuple[float, float]:
        """Return the unit vector of the drag."""
        size = math.hypot(*self.direction)
        return self.direction[0] / size, self.direction[1] / size


class Effects(Part):
    """Effects of a balance, absent unless named. Of those of a scene no other belongs to a quasi-static path of Hertz' spots."""

    close_spots: Part | None = None


class BalanceFile(Part):
    """A whole balance file. `BalanceFile.load(path)`, or built in Python; either raises InputError with all faults."""

    balance: Annotated[int, Whole(ge=VERSION, le=VERSION)] = VERSION
    materials: Materials
    friction: Frictions
    particle: Particle
    path: Path
    effects: Effects = Effects()

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> BalanceFile:
        """Read the particle in a TOML file. Raises InputError with every fault, each with file, line and column."""
        return read_part(cls, path, "balance", VERSION)

    def spots(self) -> tuple[Grip, Array]:
        """Return the spots of the particle, and their radii (n,) [m]. Raises InputError for a clump in several parts."""
        if (spots := self.particle.spots) is not None:
            position, up = np.array([(s.x, s.y, s.z) for s in spots]), np.array([s.side == "upper" for s in spots])
            radius, flat = np.array([s.radius for s in spots]), not position[:, 1].any()
        else:
            position, radius, flat = self._summits()
            up = np.arange(len(radius)) % 2 == 0
        z = position[:, 2]
        gap = np.where(up, z[up].max() - z, z - z[~up].min())
        return Grip(position, gap, up, self.particle.weight, bool(flat and self.path.heading()[1] == 0.0)), radius

    def _summits(self) -> tuple[Array, Array, bool]:
        """Return place and radius of the candidates of a clump, and whether it lies in the plane y = 0."""
        balls = self.particle.clump or ()
        center, radius = np.array([b.center for b in balls]), np.array([b.radius for b in balls])
        try:
            centroid = clump_with_frame(center, radius)[1]
        except InputError as problem:
            raise InputError([Fault("particle.clump", fault.message) for fault in problem.faults]) from None
        rotation = np.array(self.particle.quaternion or (1.0, 0.0, 0.0, 0.0))
        flat = not center[:, 1].any() and rotation[1] == 0.0 == rotation[3]
        arm = (center - centroid) @ matrix_from_quaternion(rotation / np.linalg.norm(rotation)).T
        if flat and self.path.heading()[1] == 0.0:
            arm[:, 1] = 0.0  # the centroid of coplanar spheres is off their plane by rounding only
        position = np.repeat(arm, 2, axis=0)
        position[::2, 2] += radius
        position[1::2, 2] -= radius
        return position, np.repeat(radius, 2), flat
