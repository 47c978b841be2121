"""What a scene passes to a kind of debris when bodies are made, and what it gets back."""

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
"""The quaternion (w, x, y, z) of no rotation."""


class RandomStreams:
    """Random streams of one population: body k draws from its own stream, so it is the same for every count."""

    def __init__(self, seed: int, population: int) -> None:
        self.seed, self.population = seed, population

    def stream(self, body: int) -> np.random.Generator:
        """Return the generator of one body, at its start."""
        import numpy as np

        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(self.population, body)))

    def diameters(self, size: SizeDistribution, count: int) -> list[float]:
        """Return a diameter [m] for each body: the first number that its stream gives. Raises InputError."""
        from thirdbody.bodies.irregular_clumps import Streams, diameters

        streams = Streams([self.stream(k) for k in range(count)])
        return diameters(streams, count, **size.parameters()).tolist()


@dataclass(frozen=True)
class PopulationContext:
    """What the scene passes to one of its populations.

    `index`: of the population in `debris`; `density` of its material [kg/m3]; `domain`: width and depth [m]; `path`: gives the
    path of a file that the scene names; `warnings`: takes lines for the user; `content`: what `DebrisKind.read` returned.
    """

    index: int
    random: RandomStreams
    density: float
    domain: tuple[float, float]
    path: Callable[[str], Path]
    warnings: list[str]
    content: Any = None


class PlacedClumps(NamedTuple):
    """The bodies of a population at unit density, and what the scene says of their places and motion.

    `quaternions`, (4,) or (n, 4), turn the principal frame of a clump to the world; `positions` (n, 3) of the centres of mass
    [m], None for bodies that a placement puts somewhere; `velocity` [m/s] and `angular_velocity` [rad/s], (n, 3), None for
    those of the scene's table.
    """

    clumps: list[Clump]
    quaternions: Any = UPRIGHT
    positions: np.ndarray | None = None
    velocity: np.ndarray | None = None
    angular_velocity: np.ndarray | None = None
