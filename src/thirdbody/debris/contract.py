"""The contract of a kind of debris: one class defines its keys, bodies, placement and limits.

A kind derives from `PlacedDebris` (or from `DebrisKind` if the program does not place its bodies), declares `kind:
Literal["name"] = "name"` and its keys, and implements `max_spheres` and `clumps`. All other methods have defaults. Faults that
depend on several keys go into `checks` or `rules` (see `Part`); faults that appear only while bodies are made are raised as
InputError, with keys of the kind's table such as "aspect[2]".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

from thirdbody.schema.fields import AT_REST, AngularVelocity, Count, Fraction, PositiveLength, Seed, Text, Velocity
from thirdbody.schema.parts import Location, Part, Wrong, entry

if TYPE_CHECKING:
    import numpy as np

    from thirdbody.bodies.clump import Clump
    from thirdbody.schema.sizes import SizeDistribution

MAX_SPHERES = 10_000_000
"""Largest number of spheres of a scene: about 10 GB of state and contacts. More is refused before anything is allocated."""

MAX_SPHERES_PER_BODY = 100
"""Largest number of spheres of a given body: the memory grows with the cube, 0.4 GB for 100 and 31 GB for 300."""

CLEARANCE = 1e-9
"""Gap of a resting body to its plates over its size, so that rounding makes no contact at the start."""

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
"""Quaternion (w, x, y, z) of the identity."""


class RandomStreams:
    """Random streams of one population: body k draws from its own stream, so it is the same for every count."""

    def __init__(self, seed: int, population: int) -> None:
        self.seed, self.population = seed, population

    def stream(self, body: int) -> np.random.Generator:
        """Return the generator of one body, in its initial state."""
        import numpy as np

        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(self.population, body)))

    def diameters(self, size: SizeDistribution, count: int) -> list[float]:
        """Return a diameter [m] for each body: the first number of its stream. Raises InputError."""
        from thirdbody.bodies.irregular_clumps import diameters

        return diameters([self.stream(k) for k in range(count)], **size.parameters()).tolist()

    def bodies_in_turn(self, shapes: list[Clump], count: int, size: SizeDistribution | None) -> list[Clump]:
        """Return bodies of these shapes, from the first again after the last, each rescaled to its own size if one is given."""
        bodies = [shapes[k % len(shapes)] for k in range(count)]
        if size is None:
            return bodies
        return [body.scaled(d / body.diameter) for body, d in zip(bodies, self.diameters(size, count), strict=True)]


@dataclass(frozen=True)
class PopulationContext:
    """Context in which the bodies of one population are made.

    Attributes
    ----------
    index : int
        Of the population in `debris`.
    random : RandomStreams
        Random streams of its bodies.
    density : float
        Of its material [kg/m3].
    domain : tuple of float
        Width and depth [m].
    path : callable
        Converts a file name in the scene to its path.
    warnings : list of str
        Messages are appended to it.
    content
        What `DebrisKind.read` returned.
    """

    index: int
    random: RandomStreams
    density: float
    domain: tuple[float, float]
    path: Callable[[str], Path]
    warnings: list[str]
    content: Any = None


class PlacedClumps(NamedTuple):
    """Bodies of a population at unit density, with their positions and motion where the scene gives them.

    Attributes
    ----------
    clumps : list of Clump
        The bodies.
    quaternions : ndarray (4,) or (n, 4)
        Rotate the principal frame of a clump to the world.
    positions : ndarray (n, 3) or None
        Centres of mass [m]; None for bodies that a placement positions.
    velocity, angular_velocity : ndarray (n, 3) or None
        [m/s], [rad/s]; None for those of the scene's table.
    """

    clumps: list[Clump]
    quaternions: Any = UPRIGHT
    positions: np.ndarray | None = None
    velocity: np.ndarray | None = None
    angular_velocity: np.ndarray | None = None


Placement = Literal["layer", "dilute", "dense"]


class DebrisKind(Part):
    """A population of debris of one kind: a [[debris]] table of the scene."""

    meets_debris: ClassVar[bool] = True
    """False for a kind whose bodies touch the plates only and never another body."""
    file_keys: ClassVar[tuple[str, ...]] = ()
    """Keys that name files, relative to the scene: one name or a list of them."""

    name: Text | None = None
    """Name of the population in tables, pictures and files; by default material and kind. Example: "soft debris"."""
    kind: str
    """Kind of debris, which decides on the other keys. Example: "irregular"."""
    material: Text
    """Name of the material. Example: "steel"."""
    count: Count | None = None
    """Number of bodies. Example: 2000."""
    velocity: Velocity | None = AT_REST
    """Initial velocity of all bodies. Example: ["0 m/s", "0 m/s", "-1 m/s"]."""
    angular_velocity: AngularVelocity | None = AT_REST
    """Initial angular velocity of all bodies, world axes. Example: ["0 rad/s", "1e5 rad/s", "0 rad/s"]."""

    @property
    def placement_name(self) -> str | None:
        """Return the placement of the bodies; None where the scene or a file gives their positions."""
        return getattr(self, "placement", None)

    @property
    def in_plane(self) -> bool:
        """Return whether the bodies have to stay in the plane y = 0."""
        return False

    @classmethod
    def body_count(cls, raw: Any) -> int:
        """Return the number of bodies as far as an unchecked table gives it, else 0."""
        count, positions = entry(raw, "count"), entry(raw, "positions")
        if isinstance(count, int):
            return count
        return len(positions) if hasattr(positions, "__len__") and not isinstance(positions, str) else 0

    def max_spheres(self) -> int:
        """Return the largest number of spheres of a body, as far as the scene gives it; 1 for bodies from a file."""
        raise NotImplementedError(f"{type(self).__name__}.max_spheres")

    def clumps(self, random: RandomStreams) -> list[Clump]:
        """Return the bodies of the population at unit density; body k draws from `random.stream(k)` only. Raises InputError."""
        raise NotImplementedError(f"{type(self).__name__}.clumps")

    def notes(self) -> list[str]:
        """Return lines that `check` and `run` print about the bodies."""
        return []

    def read(self, context: PopulationContext) -> Any:
        """Return the content of the population's files, later `context.content`. Raises InputError.

        The faults of all populations are reported together.
        """
        return None

    def number_of_bodies(self, context: PopulationContext) -> int:
        """Return the number of bodies."""
        return self.count or 0

    def typical_diameter(self, context: PopulationContext) -> tuple[float, float]:
        """Return a diameter [m] and the fraction of bodies that are certainly not smaller; zeros if not known yet."""
        size = getattr(self, "size", None)
        return (0.0, 1.0) if size is None else size.typical()

    def bodies(self, context: PopulationContext) -> PlacedClumps:
        """Return the bodies, with positions and motion where the scene or a file gives them. Raises InputError."""
        return PlacedClumps(self.clumps(context.random))

    def position_key(self, body: int) -> Location:
        """Return the key, within this table, that gives the position of a body of the population; () for the table itself."""
        return ()

    def mesh_shapes(self, context: PopulationContext) -> list[Any]:
        """Return the meshes (`debris.mesh.MeshShape`) that the bodies follow in turn; empty for other kinds."""
        return []


class VolumeKeys(DebrisKind):
    """Keys of kinds whose bodies may be placed: all "dilute", or all "dense" bodies of a scene share one volume."""

    seed: Seed = 1
    """Seed of the random numbers; body k is the same for every count. Example: 1."""
    placement: Placement | None = "layer"
    """"layer": in stable poses on the lower plate; "dilute": at random in a volume; "dense": a packed bed. Example: "dense"."""
    height: PositiveLength | None = None
    """Height of the volume of all "dilute" or all "dense" bodies; instead of `solid_fraction`. Example: "60 um"."""
    solid_fraction: Fraction | None = None
    """Solid fraction in that volume; by default 0.05 for "dilute", 0.5 for "dense". Example: 0.58."""

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        if "height" in raw and "solid_fraction" in raw:
            return [(("solid_fraction",), "give only one of height, solid_fraction: height is given too")]
        if raw.get("placement", "layer") != "layer":
            return []
        why = "needs placement = 'dilute' or 'dense'"
        return [((key,), why) for key in ("height", "solid_fraction") if key in raw]


class PlacedDebris(VolumeKeys):
    """Keys of a kind whose bodies the program places: in a resting layer, a dilute cloud or a dense bed."""

    count: Count
    placement: Placement = "layer"
