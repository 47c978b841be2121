"""Debris of the kind `file`: bodies of a table of spheres, at positions of the file or by a placement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Literal

from thirdbody.errors import Fault, InputError
from thirdbody.scene.debris.contract import Placement, VolumeKeys
from thirdbody.scene.debris.population import UPRIGHT, PlacedClumps, PopulationContext
from thirdbody.scene.field_types import AngularVelocity, Count, Seed, Text, Velocity
from thirdbody.scene.schema_base import Location, Wrong, entry
from thirdbody.scene.size_distributions import Size

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
    material: Text
    file: Text
    """CSV (units in the header) or NPZ (SI) table of spheres, relative to the scene. Example: "particles.csv"."""
    count: Count | None = None
    """Number of bodies, taken from the file in turn; needs `placement`. By default as many as the file has. Example: 200."""
    seed: Seed = 1
    size: Size | None = None
    """Volume-equivalent diameter to which each body is rescaled; needs `placement`.

    Example: {distribution = "uniform", min = "5 um", max = "20 um"}.
    """
    placement: Placement | None = None
    """How bodies are placed; without it they lie where the file says. Example: "layer"."""
    velocity: Velocity | None = None
    angular_velocity: AngularVelocity | None = None

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        """Return faults that follow from which keys are given."""
        faults = super().rules(raw, context)
        if "placement" in raw:
            return faults
        why = "needs placement: without one, the bodies are those of the file, where it says"
        return faults + [((key,), why) for key in ("count", "size") if key in raw]

    @classmethod
    def body_count(cls, raw: Any) -> int:
        """Return the count, or 2 for as many bodies as the file has, which is read later."""
        count = entry(raw, "count")
        return count if isinstance(count, int) else 2

    def max_spheres(self) -> int:
        """Return 1: the number is known only after reading the file."""
        return 1

    def read(self, context: PopulationContext) -> Bodies:
        """Return the bodies of the table; warn of orientations and velocities that a placement does not use."""
        from thirdbody.bodies.body_tables import load_bodies

        try:
            table = load_bodies(context.path(self.file))
        except InputError as error:
            raise InputError(Fault("file", str(fault)) for fault in error.faults) from None
        unused = _poses_and_motion(table)
        if self.placement is not None and unused:
            only = f'placement = "{self.placement}" takes the shapes only'
            context.warnings.append(f"{self.file}: its {' and '.join(unused)} are not used: {only}")
        if self.placement is None and (faults := self._motion_given_twice(table)):
            raise InputError(faults)
        return table

    def _motion_given_twice(self, table: Bodies) -> list[Fault]:
        message = "give only one: {} has the {} of each body"
        return [
            Fault(key, message.format(self.file, key.replace("_", " ")))
            for key in ("velocity", "angular_velocity")
            if getattr(self, key) is not None and getattr(table, key) is not None
        ]

    def number_of_bodies(self, context: PopulationContext) -> int:
        """Return the count, or as many as the file has."""
        return self.count or len(context.content.clumps)

    def typical_diameter(self, context: PopulationContext) -> tuple[float, float]:
        """Return that of the size, or the root mean square of the file's bodies."""
        import numpy as np

        if self.size is not None:
            return self.size.typical()
        return float(np.sqrt(np.mean([body.diameter**2 for body in context.content.clumps]))), 1.0

    def bodies(self, context: PopulationContext) -> PlacedClumps:
        """Return the shapes in turn, each with its own size, or the bodies with the positions and motion of the file."""
        table: Bodies = context.content
        shapes = [table.clumps[k % len(table.clumps)] for k in range(self.number_of_bodies(context))]
        if self.size is not None:
            sizes = context.random.diameters(self.size, len(shapes))
            shapes = [body.scaled(size / body.diameter) for body, size in zip(shapes, sizes, strict=True)]
        if self.placement is not None:
            return PlacedClumps(shapes, UPRIGHT)
        return PlacedClumps(shapes, table.quaternions, table.positions, table.velocity, table.angular_velocity)

    def position_key(self, body: int) -> Location:
        """Return the key of the file that gives the positions."""
        return ("file",) if self.placement is None else ()


def _poses_and_motion(table: Bodies) -> list[str]:
    given = {"quaternions": table.has_orientations, "velocities": table.velocity is not None}
    given["angular velocities"] = table.angular_velocity is not None
    return [name for name, there in given.items() if there]


KIND = File
