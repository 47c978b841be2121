"""From one population of a scene to its bodies: a branch for every kind of debris."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ..bodies.asperities import Asperities
from ..bodies.clump import Clump, clump_with_frame, quaternion_product, repeated_spheres
from ..bodies.shapes import Streams, diameters, population
from ..bodies.spots import spot_body
from ..bodies.table import Bodies
from ..errors import InputError
from .debris import Debris, File, Irregular, Mesh
from .filed import drawn, read_tables
from .model import Scene
from .sizes import Constant, Lognormal, Normal, Uniform
from .spots import Spots

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])

THINNEST = 1e-6
"""Least axis ratio of an irregular body: far thinner ones lose their size to rounding."""


def _from_spots(scene: Scene, debris: Spots) -> list[Clump]:
    summits = np.array([(spot.x, spot.y, spot.z) for spot in debris.spots])
    radii = np.array([spot.radius for spot in debris.spots])
    upper = np.array([spot.side == "upper" for spot in debris.spots])
    density = scene.materials[debris.material].density
    return [spot_body(summits, radii, upper, debris.mass, debris.inertia, density)] * debris.count


def shapes_of(scene: Scene, index: int, warnings: list[str]) -> list[Clump]:
    """The bodies of one population, at unit density. Raises InputError when they cannot be made."""
    return make_bodies(scene, index, scene.debris[index], warnings, read_tables(scene, warnings))[0]


def make_bodies(
    scene: Scene, index: int, debris: Debris, warnings: list[str], tables: dict[int, Bodies]
) -> tuple[list[Clump], np.ndarray]:
    """Clumps of one population and the orientation that given positions start from, one for all or (n, 4)."""
    if isinstance(debris, File):
        shapes = drawn(debris, tables[index])
        placed = debris.placement is not None
        return _sized(scene, index, debris, shapes), UPRIGHT if placed else tables[index].quaternions
    if isinstance(debris, Spots):
        return _from_spots(scene, debris), UPRIGHT
    if isinstance(debris, Mesh):
        return _from_mesh(scene, index, debris, warnings), UPRIGHT
    if isinstance(debris, Irregular):
        return _irregular(scene, index, debris), UPRIGHT
    if debris.radius is not None:
        body, _, frame = clump_with_frame(np.zeros((1, 3)), np.array([debris.radius]))
    else:
        assert debris.shape is not None
        centers = np.array([ball.center for ball in debris.shape], float)
        radii = np.array([ball.radius for ball in debris.shape])
        if repeated := repeated_spheres(centers, radii):
            message = "repeats debris[{}].shape[{}]: the same center and radius; remove one"
            places = [(("debris", index, "shape", k), message.format(index, first)) for k, first in repeated]
            raise InputError(scene.fault(place, message) for place, message in places)
        try:
            body, _, frame = clump_with_frame(centers, radii)
        except InputError as error:  # its keys are "spheres[6]", of spheres that are in the scene's `shape`
            told = [(_numbers(fault.key), fault.message) for fault in error.faults]
            raise InputError(scene.fault(("debris", index, "shape", *where), message) for where, message in told) from None
    turn = UPRIGHT if debris.orientation is None else np.array(debris.orientation)
    return [body] * debris.count, quaternion_product(turn, frame)


def _numbers(key: str) -> tuple[int, ...]:
    """The first index in a key such as "spheres[6]"."""
    return tuple(int(number) for number in re.findall(r"\[(\d+)\]", key)[:1])


def _irregular(scene: Scene, index: int, debris: Irregular) -> list[Clump]:
    thin = int(np.argmin(debris.aspect))
    if debris.aspect[thin] < THINNEST:
        message = f"{debris.aspect[thin]:g} is less than the {THINNEST:g} that spheres can fill"
        raise InputError(scene.fault(("debris", index, "aspect", thin), message))
    named, asperities = debris.asperities, None
    if named is not None:
        relative = None if isinstance(named.radius, str) else named.radius
        asperities = Asperities(named.count, named.length, relative)
    shape = (debris.spheres, debris.aspect, debris.angularity or 0.0, asperities)
    try:
        return population(debris.seed, index, debris.count, *shape, **_distribution(debris.size))
    except InputError as error:
        raise _of_debris(scene, index, error) from None


def _of_debris(scene: Scene, index: int, error: InputError) -> InputError:
    """The faults of a population's bodies with their places in the scene."""
    told = [(tuple(fault.key.split(".")) if fault.key else (), fault.message) for fault in error.faults]
    return InputError(scene.fault(("debris", index, *key), message) for key, message in told)


def _distribution(size: Constant | Lognormal | Normal | Uniform) -> dict[str, Any]:
    """The size distribution as the keywords of `bodies.shapes.diameters`."""
    given = {name: getattr(size, name) for name in type(size).model_fields}
    return {name: value for name, value in given.items() if value is not None}


def _from_mesh(scene: Scene, index: int, debris: Mesh, warnings: list[str]) -> list[Clump]:
    """Clumps that stand for the meshes of a population in turn, each of its own size; tells how well the spheres fit."""
    from .meshes import mesh_shapes

    shapes = mesh_shapes(scene, index, warnings)
    return _sized(scene, index, debris, [shapes[k % len(shapes)].clump for k in range(debris.count)])


def _sized(scene: Scene, index: int, debris: Mesh | File, shapes: list[Clump]) -> list[Clump]:
    """The shapes, each rescaled to a size of its own when the scene gives sizes; body k draws from its own stream."""
    if debris.size is None:
        return shapes
    seeds = (np.random.SeedSequence(debris.seed, spawn_key=(index, k)) for k in range(len(shapes)))
    streams = Streams([np.random.default_rng(seed) for seed in seeds])
    try:
        sizes = diameters(streams, len(shapes), **_distribution(debris.size)).tolist()
    except InputError as error:
        raise _of_debris(scene, index, error) from None
    return [body.scaled(size / body.diameter) for body, size in zip(shapes, sizes, strict=True)]
