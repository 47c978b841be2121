"""The contract of a kind of debris: one class owns its keys, its bodies, their placement and its limits.

A kind derives from `PlacedDebris` (or from `DebrisKind` if its bodies are not placed by the program), declares
`kind: Literal["name"] = "name"` and its keys, and gives `max_spheres` and `clumps`. The rest has defaults. Faults that depend on
several keys go into `checks` or `rules` (see `Part`); those that only show while bodies are made are raised as InputError, with
keys of the kind's own table such as "aspect[2]".
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from thirdbody.scene.debris.population import PlacedClumps, PopulationContext, RandomStreams
from thirdbody.scene.field_types import REST, AngularVelocity, Choice, Count, Fraction, PositiveLength, Seed, Text, Velocity
from thirdbody.scene.schema_base import Part, Place, Wrong, entry

if TYPE_CHECKING:
    from thirdbody.bodies.clump import Clump

MAX_SPHERES_PER_BODY = 100
"""Spheres of one given body: memory for its mass properties grows with the cube, 0.4 GB for 100 and 31 GB for 300."""

CLEARANCE = 1e-9
"""Gap of a resting body to its plates over its size: at the start nothing touches by rounding."""

Placement = Annotated[Literal["layer", "dilute", "dense"], Choice()]


class DebrisKind(Part):
    """A population of debris of one kind: a [[debris]] table of the scene."""

    meets_debris: ClassVar[bool] = True
    """False for a kind whose bodies touch the plates and never another body."""
    file_keys: ClassVar[tuple[str, ...]] = ()
    """Keys that name files, relative to the scene: one name or a list of them."""

    name: Text | None = None

    if TYPE_CHECKING:  # keys of every kind, each at its own place in the order of keys
        kind: str
        material: str
        count: int | None
        velocity: tuple[float, float, float] | None
        angular_velocity: tuple[float, float, float] | None

    @property
    def placement_name(self) -> str | None:
        """The placement of the bodies; None where the scene or a file says their places."""
        return getattr(self, "placement", None)

    @property
    def in_plane(self) -> bool:
        """Whether the bodies have to stay in the plane y = 0."""
        return False

    @classmethod
    def body_count(cls, raw: Any) -> int:
        """Return the number of bodies as far as an unchecked table says it, else 0."""
        count, positions = entry(raw, "count"), entry(raw, "positions")
        if isinstance(count, int):
            return count
        return len(positions) if hasattr(positions, "__len__") and not isinstance(positions, str) else 0

    def max_spheres(self) -> int:
        """Return the largest number of spheres of a body, as far as the scene says it; 1 for bodies that a file has."""
        raise NotImplementedError(f"{type(self).__name__}.max_spheres")

    def clumps(self, random: RandomStreams) -> list[Clump]:
        """Return the bodies of the population at unit density; body k draws from `random.stream(k)` only. Raises InputError."""
        raise NotImplementedError(f"{type(self).__name__}.clumps")

    def notes(self) -> list[str]:
        """Return lines that `check` and `run` print about the bodies."""
        return []

    # What follows has a default for kinds whose bodies need no file, and no place or motion of their own.

    def read(self, context: PopulationContext) -> Any:
        """Read what later methods find as `context.content`. Raises InputError; the faults of all populations are collected."""
        return None

    def number_of_bodies(self, context: PopulationContext) -> int:
        """Return the number of bodies."""
        return self.count or 0

    def typical_diameter(self, context: PopulationContext) -> tuple[float, float]:
        """Return a diameter [m] and the fraction of bodies that are surely not smaller; zero where it is not known yet."""
        size = getattr(self, "size", None)
        return (0.0, 1.0) if size is None else size.typical()

    def bodies(self, context: PopulationContext) -> PlacedClumps:
        """Return the bodies, with their places and motion where the scene or a file says them. Raises InputError."""
        return PlacedClumps(self.clumps(context.random))

    def position_key(self, body: int) -> Place:
        """Return the key, within this table, that says the place of a body of the population; () for the table itself."""
        return ()

    def mesh_shapes(self, context: PopulationContext) -> list[Any]:
        """Return the meshes (`kinds.mesh.MeshShape`) that the bodies follow in turn, if they do."""
        return []


class VolumeKeys(DebrisKind):
    """The `name` of a population, and what the debris of one scene may say of the volume that all "dilute", or all "dense"
    bodies share: its `height` over the lower plate (m) or the `solid_fraction` in it, by default 0.05, or 0.5."""

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


class PlacedDebris(VolumeKeys):
    """The keys of a kind whose bodies are placed by the program: a resting layer, a dilute cloud or a dense bed."""

    kind: str
    material: Text
    count: Count
    seed: Seed = 1
    placement: Placement = "layer"
    velocity: Velocity = REST
    angular_velocity: AngularVelocity = REST
