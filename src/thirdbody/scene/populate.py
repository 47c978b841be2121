"""From the debris of a scene to bodies in their places."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..bodies.clump import Clump, clump_with_frame
from ..bodies.placement import overlaps, place_layer
from ..bodies.poses import quaternion_product, settle
from ..bodies.shapes import diameters, population
from ..engine.state import Placed, rotation_matrices
from ..errors import Fault, InputError
from . import units
from .debris import Irregular, Mesh, Spheres
from .model import Scene
from .sizes import Constant, Lognormal, Uniform
from .sizes import Normal as NormalSize

CLEARANCE = 1e-9
"""Gap of a resting body to its plates over its size: at the start nothing touches by rounding."""

LAYER_STREAM = 1_000_003
"""Spawn key of the random stream that poses and places the layer, apart from those of the populations."""

COVERAGE = 4.0
"""Bodies of one layer whose equal-volume spheres would cover the domain this often cannot all rest on it, however they nest."""


def populate(scene: Scene, warnings: list[str]) -> Placed:
    """All bodies of the scene, in the order of its populations. Raises InputError when they cannot be made or placed.

    The bodies of all layers are laid together, each in a stable pose on the lower plate.
    """
    _refuse_crowd(scene)
    clumps: list[Clump] = []
    positions, quaternions, layered = [], [], []
    for index, debris in enumerate(scene.debris):
        shapes, turn = _shapes(scene, index, debris, warnings)
        clumps += shapes
        in_layer = _in_layer(debris)
        layered += [in_layer] * len(shapes)
        given = np.full((len(shapes), 3), np.nan) if in_layer else np.array(_given(debris), float)
        positions.append(given)
        quaternions.append(np.tile(turn, (len(shapes), 1)))
    x, q = np.concatenate(positions), np.concatenate(quaternions)
    mask = np.array(layered)
    if mask.any():
        _lay(scene, clumps, mask, x, q)
    counts = [debris.count for debris in scene.debris]
    placed = _placed(scene, clumps, x, q, counts)
    _refuse_overlaps(scene, placed)
    return placed


def _in_layer(debris: Irregular | Spheres | Mesh) -> bool:
    return not (isinstance(debris, Spheres) and debris.positions is not None)


def _refuse_crowd(scene: Scene) -> None:
    """Raise InputError for a count that is out of all proportion, before hours are spent on making and placing it."""
    if scene.plates.lower is None and any(map(_in_layer, scene.debris)):
        first = next(i for i, debris in enumerate(scene.debris) if _in_layer(debris))
        message = 'placement = "layer" lays bodies on [plates.lower], which is missing'
        raise InputError(scene.fault(("debris", first), message))
    faults = []
    width, depth = scene.domain.size
    for i, debris in enumerate(scene.debris):
        # only half of the bodies are larger than the median
        diameter, share = _typical(debris)
        cover = share * debris.count * 0.25 * np.pi * diameter**2 / (width * depth)
        if _in_layer(debris) and cover > COVERAGE:
            message = (
                f"{debris.count} bodies of {units.pretty(diameter, 'length')} would cover the domain "
                f"({units.pretty(width, 'length')} by {units.pretty(depth, 'length')}) {cover:.3g} times; a layer covers it "
                "less than once: lower count or enlarge domain.size"
            )
            faults.append(scene.fault(("debris", i, "count"), message))
    if faults:
        raise InputError(faults)


def _typical(debris: Irregular | Spheres | Mesh) -> tuple[float, float]:
    """A diameter, m, and the share of the bodies that surely is not smaller."""
    if isinstance(debris, Spheres):
        radii = [debris.radius] if debris.radius is not None else [ball.radius for ball in debris.shape or ()]
        return 2.0 * max(radii), 1.0
    size = debris.size
    if size is None:  # as in the mesh file, which is read later
        return 0.0, 1.0
    if isinstance(size, Constant):
        return size.value, 1.0
    if isinstance(size, Lognormal):
        return max(size.median, size.min or 0.0), 0.5
    return (max(size.mean, size.min), 0.5) if isinstance(size, NormalSize) else (0.5 * (size.min + size.max), 0.5)


def _given(debris: Irregular | Spheres | Mesh) -> tuple[tuple[float, float, float], ...]:
    assert isinstance(debris, Spheres) and debris.positions is not None
    return debris.positions


def _shapes(
    scene: Scene, index: int, debris: Irregular | Spheres | Mesh, warnings: list[str]
) -> tuple[list[Clump], np.ndarray]:
    """Clumps of one population and the orientation that given positions start from."""
    if isinstance(debris, Mesh):
        return _from_mesh(scene, index, debris, warnings), np.array([1.0, 0.0, 0.0, 0.0])
    if isinstance(debris, Irregular):
        shapes = population(debris.seed, index, debris.count, debris.spheres, debris.aspect, **_distribution(debris.size))
        return shapes, np.array([1.0, 0.0, 0.0, 0.0])
    if debris.radius is not None:
        body, _, frame = clump_with_frame(np.zeros((1, 3)), np.array([debris.radius]))
    else:
        assert debris.shape is not None
        centers = np.array([ball.center for ball in debris.shape], float)
        body, _, frame = clump_with_frame(centers, np.array([ball.radius for ball in debris.shape]))
    turn = np.array([1.0, 0.0, 0.0, 0.0]) if debris.orientation is None else np.array(debris.orientation)
    return [body] * debris.count, quaternion_product(turn, frame)


def _distribution(size: Constant | Lognormal | NormalSize | Uniform) -> dict[str, Any]:
    """The size distribution as the keywords of `bodies.shapes.diameters`."""
    given = {name: getattr(size, name) for name in type(size).model_fields}
    return {name: value for name, value in given.items() if value is not None}


def _from_mesh(scene: Scene, index: int, debris: Mesh, warnings: list[str]) -> list[Clump]:
    """Clumps that stand for a mesh, each of its own size; tells how well the spheres fit."""
    from ..bodies.fit import clump_from_mesh
    from ..bodies.mesh import load_mesh

    try:
        body, fit = clump_from_mesh(load_mesh(scene.beside(debris.file), debris.unit), debris.spheres, debris.seed)
    except InputError as error:
        raise InputError(scene.fault(("debris", index, "file"), str(error))) from None
    warnings.append(
        f"{debris.file}: {debris.spheres} spheres follow the mesh to {100.0 * fit.rms:.1f} % of its radius (rms; worst "
        f"{100.0 * fit.maximum:.0f} %); where a plane can touch, their radius is {float(np.median(fit.contacts.ratio)):.2f} "
        "times that of the mesh"
    )
    if debris.size is None:
        return [body] * debris.count
    streams = (np.random.SeedSequence(debris.seed, spawn_key=(index, k)) for k in range(debris.count))
    sizes = [diameters(np.random.default_rng(stream), 1, **_distribution(debris.size))[0] for stream in streams]
    return [body.scaled(float(size) / body.diameter) for size in sizes]


def _lay(scene: Scene, clumps: list[Clump], mask: np.ndarray, x: np.ndarray, q: np.ndarray) -> None:
    """Give the bodies of the layer a stable pose, a height and a place."""
    rng = np.random.default_rng(np.random.SeedSequence(scene.debris[0].seed, spawn_key=(LAYER_STREAM,)))
    members = np.flatnonzero(mask)
    for b in members:
        q[b], height = settle(clumps[b], rng)
        x[b, 2] = height + CLEARANCE * clumps[b].diameter
    laid = [clumps[b] for b in members]
    try:
        x[members, :2] = place_layer(laid, q[members], scene.domain.size, scene.domain.periodic, rng)
    except InputError as error:
        raise InputError([scene.fault(("domain", "size"), fault.message) for fault in error.faults]) from None


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
        velocities=np.array([debris.velocity for debris in scene.debris], float)[populations],
        angular_velocities=np.array([debris.angular_velocity for debris in scene.debris], float)[populations],
    )


def sphere_centres(placed: Placed) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres (n, 3), radii (n,) and body of every sphere."""
    body = np.repeat(np.arange(len(placed.clumps)), [len(clump.radii) for clump in placed.clumps])
    offsets = np.concatenate([clump.centers for clump in placed.clumps])
    turns = rotation_matrices(placed.quaternions)
    centres = placed.positions[body] + np.einsum("nij,nj->ni", turns[body], offsets)
    return centres, np.concatenate([clump.radii for clump in placed.clumps]), body


def _refuse_overlaps(scene: Scene, placed: Placed) -> None:
    """Raise InputError for bodies that overlap each other or the lower plate by more than rounding, or start outside."""
    centres, radii, body = sphere_centres(placed)
    faults: list[Fault] = _outside(scene, placed)
    if scene.contact.debris_contact != "none":
        found = overlaps(centres, radii, body, scene.domain.size, scene.domain.periodic)
        deep = [(a, b, depth) for a, b, depth in found if depth > 1e-9 * radii.min()]
        if deep:
            a, b, depth = deep[0]
            more = f" ({len(deep)} pairs overlap)" if len(deep) > 1 else ""
            how_much = units.pretty(depth, "length")
            message = f"bodies {a} and {b} overlap by {how_much} at the start{more}; initial_overlap = 'refuse'"
            faults.append(scene.fault(_place_of(scene, placed, b), message))
    if scene.plates.lower is not None:
        depth_below = radii - centres[:, 2]
        deepest = int(np.argmax(depth_below))
        if depth_below[deepest] > 1e-9 * radii[deepest]:
            how_much = units.pretty(float(depth_below[deepest]), "length")
            message = f"body {body[deepest]} starts {how_much} deep in the lower plate (z = 0); initial_overlap = 'refuse'"
            faults.append(scene.fault(_place_of(scene, placed, int(body[deepest])), message))
    if faults:
        raise InputError(faults)


def _place_of(scene: Scene, placed: Placed, body: int) -> tuple[str | int, ...]:
    """Where the scene says the position of a body: its entry in `positions`, or its population."""
    population = int(placed.populations[body])
    if _in_layer(scene.debris[population]):
        return ("debris", population)
    return ("debris", population, "positions", body - int(np.searchsorted(placed.populations, population)))


def _outside(scene: Scene, placed: Placed) -> list[Fault]:
    """The first body whose centre is given outside a domain that is not periodic."""
    if scene.domain.periodic or scene.plates.lower is None:
        return []
    x = placed.positions[:, :2]
    beyond = np.flatnonzero(((x < 0.0) | (x > np.array(scene.domain.size))).any(axis=1))
    if not len(beyond):
        return []
    where = ", ".join(units.pretty(float(v), "length") for v in x[beyond[0]])
    width, depth = (units.pretty(v, "length") for v in scene.domain.size)
    message = f"body {beyond[0]} starts at x, y = {where}, outside the domain (0 to {width}, 0 to {depth}; not periodic)"
    return [scene.fault(_place_of(scene, placed, int(beyond[0])), message)]
