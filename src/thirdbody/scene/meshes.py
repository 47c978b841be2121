"""Debris of the kind `mesh`: the surfaces that a population names, and the clumps that stand for them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..bodies.clump import Clump
from ..bodies.fit import Fit, clump_from_mesh
from ..bodies.mesh import SUFFIXES, load_mesh
from ..bodies.mesh import Mesh as Surface
from ..errors import Fault, InputError
from . import units
from .debris import Mesh
from .model import Scene
from .part import Wrong


class MeshShape(NamedTuple):
    """A surface, the clump that stands for it, and how well its spheres follow the surface."""

    name: str
    surface: Surface
    clump: Clump
    fit: Fit


def meshes_in(folder: Path) -> list[Path]:
    """The mesh files of a folder, in the order of their names; hidden ones and those of folders below are left out."""
    files = (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and not path.name.startswith("."))
    return sorted((path for path in files if path.is_file()), key=lambda path: path.name)


def mesh_shapes(scene: Scene, index: int, warnings: list[str]) -> list[MeshShape]:
    """The shapes of a population; its body k has shape k modulo their number. Raises InputError with all faults."""
    debris = scene.debris[index]
    assert isinstance(debris, Mesh)
    files = _files(scene, index, debris)
    if len(files) > debris.count:
        warnings.append(f"debris[{index}]: {debris.count} bodies of {len(files)} meshes: the last ones are not used")
    shapes, wrongs = [], list[Wrong]()
    for place, name, path in files[: debris.count]:
        try:
            surface = load_mesh(path, debris.unit)
            shapes.append(MeshShape(name, surface, *clump_from_mesh(surface, debris.spheres, debris.seed)))
        except InputError as error:
            wrongs.append((place, str(error)))
    if wrongs or (wrongs := _too_large(scene, debris, shapes)):
        raise InputError(scene.fault(("debris", index, *place), message) for place, message in wrongs)
    warnings.append(_closeness(debris, shapes))
    return shapes


def _files(scene: Scene, index: int, debris: Mesh) -> list[tuple[tuple[str | int, ...], str, Path]]:
    """Place within the population, name and path of every mesh file, in order. Raises InputError for an empty folder."""
    if not isinstance(debris.file, str):
        return [(("file", k), name, scene.beside(name)) for k, name in enumerate(debris.file)]
    path = scene.beside(debris.file)
    if not os.path.isdir(path):  # that of a path raises for names that are too long
        return [(("file",), debris.file, path)]
    try:
        found = meshes_in(path)
    except OSError as error:
        raise InputError(scene.fault(("debris", index, "file"), f"{path}: cannot be read ({error.strerror})")) from None
    if not found:
        empty = Fault("mesh", f"is a folder that holds no mesh file ({', '.join(SUFFIXES)})", str(path))
        raise InputError(scene.fault(("debris", index, "file"), str(empty)))
    return [(("file",), file.name, file) for file in found]


def _too_large(scene: Scene, debris: Mesh, shapes: list[MeshShape]) -> list[Wrong]:
    """A fault where the unit makes bodies that do not fit into the domain."""
    widest = max(shapes, key=lambda shape: shape.clump.diameter)
    if debris.size is not None or widest.clump.diameter <= min(scene.domain.size):
        return []
    width, depth = (units.pretty(v, "length") for v in scene.domain.size)
    message = (
        f"{units.pretty(debris.unit, 'length')} per unit of {widest.name} makes bodies of "
        f"{units.pretty(widest.clump.diameter, 'length')}, which do not fit into the domain ({width} by {depth})"
    )
    return [(("unit",), message)]


def _closeness(debris: Mesh, shapes: list[MeshShape]) -> str:
    """How well the spheres follow the surfaces."""
    rms = [100.0 * shape.fit.rms for shape in shapes]
    ratios = [float(np.median(shape.fit.contacts.ratio)) for shape in shapes]
    worst = max(shapes, key=lambda shape: shape.fit.maximum)
    if len(shapes) == 1:
        return (
            f"{worst.name}: {debris.spheres} spheres follow the mesh to {rms[0]:.1f} % of its radius (rms; worst "
            f"{100.0 * worst.fit.maximum:.0f} %); where a plane can touch, their radius is {ratios[0]:.2f} times that of the mesh"
        )
    return (
        f"{len(shapes)} meshes in turn: {debris.spheres} spheres follow each to {min(rms):.1f} to {max(rms):.1f} % of its radius "
        f"(rms; worst {100.0 * worst.fit.maximum:.0f} %, {worst.name}); where a plane can touch, the radius of the spheres is "
        f"{min(ratios):.2f} to {max(ratios):.2f} times that of the mesh"
    )
