"""From the debris of a scene to bodies in their places."""

from __future__ import annotations

import numpy as np

from ..bodies.clump import Clump
from ..bodies.spots import rows
from ..bodies.table import Bodies
from ..engine.state import Placed
from .debris import Debris, File, Spheres
from .filed import motion, read_tables
from .make import make_bodies
from .model import Scene
from .place import CLEARANCE, place, placement_of, refuse_placements, spheres_of
from .spots import Spots
from .start import refuse_start
from .types import REST


def populate(scene: Scene, warnings: list[str]) -> Placed:
    """All bodies of the scene, in the order of its populations. Raises InputError when they cannot be made or placed.

    Where the scene does not say the places, `place` finds them.
    """
    tables = read_tables(scene, warnings)
    refuse_placements(scene, tables)
    clumps: list[Clump] = []
    positions, quaternions, counts = [], [], []
    for index, debris in enumerate(scene.debris):
        shapes, turn = make_bodies(scene, index, debris, warnings, tables)
        clumps += shapes
        chosen = placement_of(debris) is not None
        positions.append(np.full((len(shapes), 3), np.nan) if chosen else _given(scene, index, debris, tables))
        quaternions.append(np.broadcast_to(turn, (len(shapes), 4)))
        counts.append(len(shapes))
    x, q = np.concatenate(positions), np.concatenate(quaternions)
    place(scene, clumps, np.repeat(np.arange(len(counts)), counts), x, q, warnings)
    placed = _placed(scene, clumps, x, q, counts)
    for index, table in tables.items():
        debris, own = scene.debris[index], placed.populations == index
        assert isinstance(debris, File)
        placed.velocities[own], placed.angular_velocities[own] = motion(debris, table)
    refuse_start(scene, placed)
    return placed


def _given(scene: Scene, index: int, debris: Debris, tables: dict[int, Bodies]) -> np.ndarray:
    """Positions (count, 3) of the centres of mass that the scene gives."""
    if isinstance(debris, Spots):
        places = rows(debris.count, scene.domain.size) if debris.positions is None else np.array(debris.positions, float)
        height = CLEARANCE * debris.height() - min(spot.z for spot in debris.spots)
        return np.column_stack((places, np.full(debris.count, height)))
    if isinstance(debris, File):
        return tables[index].positions
    assert isinstance(debris, Spheres) and debris.positions is not None
    return np.array(debris.positions, float)


def _placed(scene: Scene, clumps: list[Clump], x: np.ndarray, q: np.ndarray, counts: list[int]) -> Placed:
    names = list(scene.materials)
    of_population = np.array([names.index(debris.material) for debris in scene.debris])
    populations = np.repeat(np.arange(len(counts)), counts)
    densities = np.array([material.density for material in scene.materials.values()])
    materials = of_population[populations]
    return Placed(
        clumps=clumps,
        densities=densities[materials],
        materials=materials,
        populations=populations,
        positions=x,
        quaternions=q,
        velocities=np.array([debris.velocity or REST for debris in scene.debris], float)[populations],
        angular_velocities=np.array([debris.angular_velocity or REST for debris in scene.debris], float)[populations],
    )


def sphere_centres(placed: Placed) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres (n, 3), radii (n,) and body of every sphere."""
    return spheres_of(placed.clumps, placed.positions, placed.quaternions)
