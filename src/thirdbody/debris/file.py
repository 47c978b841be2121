"""Debris of the kind `file`: bodies of a table of spheres, at positions of the file or by a placement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Literal

from thirdbody.debris.contract import PlacedClumps, Placement, PopulationContext, VolumeKeys
from thirdbody.errors import Fault, InputError
from thirdbody.schema.fields import AngularVelocity, Count, Text, Velocity
from thirdbody.schema.parts import Location, Wrong, entry
from thirdbody.schema.sizes import Size

if TYPE_CHECKING:
    from thirdbody.bodies.body_tables import Bodies


class File(VolumeKeys):
    """Bodies from a table of spheres, CSV (units in its header) or NPZ (SI); `file` is relative to the scene.

    Without `placement` the bodies lie where the file says: its centers are world coordinates, and quaternions turn each
    body about its centre of mass. With `placement` only the shapes are taken, one after the other, from the first again
    after the last, for `count` bodies (as many as the file has), each rescaled to `size` (volume-equivalent diameter, m).
    `velocity` and `angular_velocity` hold for all bodies, where the file has none.
    """

    file_keys: ClassVar[tuple[str, ...]] = ("file",)

    kind: Literal["file"] = "file"
    file: Text
    """Table of spheres, relative to the scene: CSV (units in the header) or NPZ (SI). Example: "particles.csv"."""
    count: Count | None = None
    """Number of bodies, taken from the file in turn; needs `placement`; by default each once. Example: 200."""
    size: Size | None = None
    """Volume-equivalent diameter of rescaled bodies; needs `placement`.
    Example: {distribution = "uniform", min = "5 um", max = "20 um"}."""
    placement: Placement | None = None
    """How bodies are placed; by default where the file says. Example: "layer"."""
    velocity: Velocity | None = None
    angular_velocity: AngularVelocity | None = None

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        faults = super().rules(raw, context)
        if "placement" in raw:
            return faults
        why = "needs placement: without one, the bodies are those of the file, where it says"
        return faults + [((key,), why) for key in ("count", "size") if key in raw]

    @classmethod
    def body_count(cls, raw: Any) -> int:
        count = entry(raw, "count")
        return count if isinstance(count, int) else 2  # as many as the file has, which is read later

    def max_spheres(self) -> int:
        return 1  # known only after reading the file

    def read(self, context: PopulationContext) -> Bodies:
        """Return the bodies of the table; warn of orientations and velocities that a placement does not use."""
        from thirdbody.bodies.body_tables import load_bodies

        try:
            table = load_bodies(context.path(self.file))
        except InputError as error:
            raise InputError(Fault("file", str(fault)) for fault in error.faults) from None
        given = {
            "quaternions": table.has_orientations,
            "velocities": table.velocity is not None,
            "angular velocities": table.angular_velocity is not None,
        }
        unused = [name for name, there in given.items() if there and self.placement is not None]
        if unused:
            only = f'placement = "{self.placement}" takes the shapes only'
            context.warnings.append(f"{self.file}: its {' and '.join(unused)} are not used: {only}")
        twice = [
            Fault(key, f"give only one: {self.file} has the {key.replace('_', ' ')} of each body")
            for key in ("velocity", "angular_velocity")
            if self.placement is None and getattr(self, key) is not None and getattr(table, key) is not None
        ]
        if twice:
            raise InputError(twice)
        return table

    def number_of_bodies(self, context: PopulationContext) -> int:
        return self.count or len(context.content.clumps)

    def typical_diameter(self, context: PopulationContext) -> tuple[float, float]:
        import numpy as np

        if self.size is not None:
            return self.size.typical()
        return float(np.sqrt(np.mean([body.diameter**2 for body in context.content.clumps]))), 1.0

    def bodies(self, context: PopulationContext) -> PlacedClumps:
        table: Bodies = context.content
        shapes = context.random.bodies_in_turn(table.clumps, self.number_of_bodies(context), self.size)
        if self.placement is not None:
            return PlacedClumps(shapes)
        return PlacedClumps(shapes, table.quaternions, table.positions, table.velocity, table.angular_velocity)

    def position_key(self, body: int) -> Location:
        return ("file",) if self.placement is None else ()


KIND = File
