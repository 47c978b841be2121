"""Initial bodies of a scene, from its debris tables."""

from collections.abc import Mapping, Sequence

import numpy as np

from thirdbody.assembly.clumps import make_bodies, read_populations
from thirdbody.assembly.initial_checks import refuse_start
from thirdbody.assembly.placement import place_bodies, refuse_placements, spheres_of
from thirdbody.assembly.rough_start import lift_bodies
from thirdbody.engine.placed import Placed
from thirdbody.scene.debris.population import UPRIGHT, PlacedClumps
from thirdbody.scene.field_types import AT_REST
from thirdbody.scene.model import Scene
from thirdbody.surfaces.surface import Surface

UNPLACED = (float("nan"),) * 3
"""Position of a body before its placement."""


def populate(scene: Scene, warnings: list[str], surfaces: Mapping[str, Surface] | None = None) -> Placed:
    """Return all bodies of the scene, in the order of its populations. Raises InputError.

    Bodies without positions in the scene are placed by `place_bodies`; `surfaces`: of rough plates, by side.
    """
    contexts = read_populations(scene, warnings)
    refuse_placements(scene, contexts)
    built = [make_bodies(scene, context) for context in contexts]
    clumps = [body for population in built for body in population.clumps]
    populations = np.repeat(np.arange(len(built)), [len(population.clumps) for population in built])
    names = list(scene.materials)
    materials = np.array([names.index(debris.material) for debris in scene.debris])[populations]
    densities = np.array([material.density for material in scene.materials.values()])
    motions = [(debris.velocity or AT_REST, debris.angular_velocity or AT_REST) for debris in scene.debris]
    each = list(zip(built, motions, strict=True))
    placed = Placed(
        clumps=clumps,
        densities=densities[materials],
        materials=materials,
        populations=populations,
        positions=np.concatenate([_rows(bodies, bodies.positions, UNPLACED) for bodies in built]),
        quaternions=np.concatenate([_rows(bodies, bodies.quaternions, UPRIGHT) for bodies in built]),
        velocities=np.concatenate([_rows(bodies, bodies.velocity, v) for bodies, (v, _) in each]),
        angular_velocities=np.concatenate([_rows(bodies, bodies.angular_velocity, w) for bodies, (_, w) in each]),
    )
    place_bodies(scene, clumps, populations, placed.positions, placed.quaternions, warnings)
    lower = (surfaces or {}).get("lower")
    if lower is not None:
        _lift(scene, placed, lower)
    refuse_start(scene, placed, lower)
    return placed


def _lift(scene: Scene, placed: Placed, lower: Surface) -> None:
    """Set the bodies of a layer onto a rough lower plate, and raise what else was placed out of it."""
    how = np.array([debris.placement_name or "given" for debris in scene.debris])[placed.populations]
    clumps, x, q = list(placed.clumps), placed.positions, placed.quaternions
    lift_bodies(scene, clumps, np.flatnonzero(how == "layer"), x, q, lower)
    others = np.flatnonzero((how == "dilute") | (how == "dense"))
    if len(others):
        x[others, 2] += float(lower.heights.max())


def _rows(bodies: PlacedClumps, given: np.ndarray | None, otherwise: Sequence[float]) -> np.ndarray:
    """Return one row per body of a population: the given rows, else the same default for all."""
    row = np.asarray(otherwise if given is None else given, float)
    return np.broadcast_to(row, (len(bodies.clumps), row.shape[-1]))


def sphere_centres(placed: Placed) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return centres (n, 3) [m], radii (n,) [m] and body (n,) of every sphere."""
    return spheres_of(placed.clumps, placed.positions, placed.quaternions)
