"""Interface between a scene and a kind of debris: the context of a population, and its bodies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import numpy as np

    from thirdbody.bodies.clump import Clump
    from thirdbody.scene.size_distributions import SizeDistribution

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
