"""From the debris of a scene to bodies in their places."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..bodies.clump import Clump
from ..engine.state import Placed
from .debris.population import PlacedClumps
from .make import make_bodies, read_populations
from .model import Scene
from .place import place, refuse_placements, spheres_of
from .start import refuse_start
from .types import REST


def populate(scene: Scene, warnings: list[str]) -> Placed:
    """All bodies of the scene, in the order of its populations. Raises InputError when they cannot be made or placed.

    Where the scene does not say the places, `place` finds them.
    """
    contexts = read_populations(scene, warnings)
    refuse_placements(scene, contexts)
    made = [make_bodies(scene, context) for context in contexts]
    clumps = [body for population in made for body in population.clumps]
    populations = np.repeat(np.arange(len(made)), [len(population.clumps) for population in made])
    x = np.concatenate([_rows(population, population.positions, (np.nan,) * 3) for population in made])
    q = np.concatenate([_rows(population, population.quaternions, population.quaternions) for population in made])
    place(scene, clumps, populations, x, q, warnings)
    placed = _placed(scene, clumps, populations, x, q)
    for debris, population, own in zip(scene.debris, made, _members(populations, len(made)), strict=True):
        placed.velocities[own] = _rows(population, population.velocity, debris.velocity or REST)
        placed.angular_velocities[own] = _rows(population, population.angular_velocity, debris.angular_velocity or REST)
    refuse_start(scene, placed)
    return placed


def _rows(population: PlacedClumps, given: np.ndarray | None, otherwise: Sequence[float] | np.ndarray) -> np.ndarray:
    """A row for each body: what is given, else the same for all."""
    row = np.asarray(otherwise if given is None else given, float)
    return np.broadcast_to(row, (len(population.clumps), row.shape[-1]))


def _members(populations: np.ndarray, count: int) -> list[np.ndarray]:
    """The bodies of each population."""
    return [np.flatnonzero(populations == index) for index in range(count)]


def _placed(scene: Scene, clumps: list[Clump], populations: np.ndarray, x: np.ndarray, q: np.ndarray) -> Placed:
    names = list(scene.materials)
    materials = np.array([names.index(debris.material) for debris in scene.debris])[populations]
    densities = np.array([material.density for material in scene.materials.values()])
    return Placed(
        clumps=clumps,
        densities=densities[materials],
        materials=materials,
        populations=populations,
        positions=x,
        quaternions=q,
        velocities=np.zeros((len(clumps), 3)),
        angular_velocities=np.zeros((len(clumps), 3)),
    )


def sphere_centres(placed: Placed) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres (n, 3), radii (n,) and body of every sphere."""
    return spheres_of(placed.clumps, placed.positions, placed.quaternions)
