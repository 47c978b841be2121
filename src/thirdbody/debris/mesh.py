"""Debris of the kind `mesh`: surfaces from files, and the clumps fitted to them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

from thirdbody import units
from thirdbody.debris.contract import PlacedClumps, PlacedDebris, PopulationContext
from thirdbody.errors import Fault, InputError
from thirdbody.schema.fields import Read, Unit, Whole, show
from thirdbody.schema.sizes import Size

if TYPE_CHECKING:
    from thirdbody.bodies.clump import Clump
    from thirdbody.bodies.mesh import Mesh as Surface
    from thirdbody.bodies.mesh_to_clump import Fit


def _file_names(value: Any) -> str | list[str]:
    names = list(value) if isinstance(value, list | tuple) else [value]
    if not names or not all(isinstance(name, str) for name in names):
        raise ValueError(f"expected a file, a folder or a list of files, got {show(value)}")
    return value if isinstance(value, str) else names


_FILES = Read(_file_names, {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]})


class MeshShape(NamedTuple):
    """A surface, the clump fitted to it, and the quality of the fit."""

    name: str
    surface: Surface
    clump: Clump
    fit: Fit


class Mesh(PlacedDebris):
    """Bodies from closed surface meshes (STL, OBJ or PLY): clumps of spheres with the mesh's volume and inertia.

    `file` is a mesh file, a list of them, or a folder of them (in the order of their names): the bodies take the meshes in
    turn, from the first again after the last. `unit` is the length of one unit of the files, m; `size` (volume-equivalent
    diameter, m), if given, rescales each body.
    """

    file_keys: ClassVar[tuple[str, ...]] = ("file",)

    kind: Literal["mesh"] = "mesh"
    file: Annotated[str | list[str], _FILES]
    """Closed mesh (STL, OBJ, PLY), list or folder of them, relative to the scene; used in turn. Example: "flake.stl"."""
    unit: Unit
    """Length of one unit of the files, such as "1 um", or its name. Example: "um"."""
    spheres: Annotated[int, Whole(ge=4, le=1500)] | None = None
    """Number of spheres of each body; by default 12, more for a thin body that 12 would miss. Example: 12."""
    size: Size | None = None
    """Volume-equivalent diameter of rescaled bodies. Example: {distribution = "lognormal", median = "6 um", sigma = 0.15}."""

    def max_spheres(self) -> int:
        return self.spheres or 1  # 1 where it follows from the mesh

    def bodies(self, context: PopulationContext) -> PlacedClumps:
        clumps = [shape.clump for shape in self.mesh_shapes(context)]
        return PlacedClumps(context.random.bodies_in_turn(clumps, self.count, self.size))

    def mesh_shapes(self, context: PopulationContext) -> list[MeshShape]:
        from thirdbody.bodies.mesh import load_mesh
        from thirdbody.bodies.mesh_to_clump import clump_from_mesh

        files = self._files(context)
        if len(files) > self.count:
            number = f"debris[{context.index}]: {self.count} bodies of {len(files)} meshes"
            context.warnings.append(f"{number}: the last ones are not used")
        shapes, faults = [], list[Fault]()
        for key, name, path in files[: self.count]:
            try:
                surface = load_mesh(path, self.unit)
                shapes.append(MeshShape(name, surface, *clump_from_mesh(surface, self.spheres, self.seed)))
            except InputError as error:
                faults.append(Fault(key, str(error)))
        if faults:
            raise InputError(faults)
        widest = max(shapes, key=lambda shape: shape.clump.diameter)
        if self.size is None and widest.clump.diameter > min(context.domain):
            unit, diameter, width, depth = (
                units.pretty(length, "length") for length in (self.unit, widest.clump.diameter, *context.domain)
            )
            report = f"{unit} per unit of {widest.name} makes bodies of {diameter}"
            raise InputError(Fault("unit", f"{report}, which do not fit into the domain ({width} by {depth})"))
        context.warnings.append(_closeness(shapes))
        return shapes

    def _files(self, context: PopulationContext) -> list[tuple[str, str, Path]]:
        """Return key, name and path of every mesh file, in order. Raises InputError for an empty folder."""
        from thirdbody.bodies.mesh import SUFFIXES

        if not isinstance(self.file, str):
            return [(f"file[{k}]", name, context.path(name)) for k, name in enumerate(self.file)]
        path = context.path(self.file)
        if not os.path.isdir(path):  # Path.is_dir raises for names that are too long
            return [("file", self.file, path)]
        try:
            result = meshes_in(path)
        except OSError as error:
            raise InputError(Fault("file", f"{path}: cannot be read ({error.strerror})")) from None
        if not result:
            empty = Fault("mesh", f"is a folder that holds no mesh file ({', '.join(SUFFIXES)})", str(path))
            raise InputError(Fault("file", str(empty)))
        return [("file", file.name, file) for file in result]


def meshes_in(folder: Path) -> list[Path]:
    """Return the mesh files of a folder, sorted by name; hidden files and subfolders are left out."""
    from thirdbody.bodies.mesh import SUFFIXES

    files = (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and not path.name.startswith("."))
    return sorted((path for path in files if path.is_file()), key=lambda path: path.name)


def _closeness(shapes: list[MeshShape]) -> str:
    import numpy as np

    number = sorted({len(shape.clump.radii) for shape in shapes})
    spheres = " to ".join(str(n) for n in dict.fromkeys((number[0], number[-1])))
    rms = [100.0 * shape.fit.rms for shape in shapes]
    ratios = [float(np.median(shape.fit.contact_ratio)) for shape in shapes]
    worst = max(shapes, key=lambda shape: shape.fit.maximum)
    if len(shapes) == 1:
        return (
            f"{worst.name}: {spheres} spheres follow the mesh to {rms[0]:.1f} % of its radius (rms; worst "
            f"{100.0 * worst.fit.maximum:.0f} %); where a plane can touch, their radius is {ratios[0]:.2f} times that of the mesh"
        )
    return (
        f"{len(shapes)} meshes in turn: {spheres} spheres follow each to {min(rms):.1f} to {max(rms):.1f} % of its radius "
        f"(rms; worst {100.0 * worst.fit.maximum:.0f} %, {worst.name}); where a plane can touch, the radius of the spheres is "
        f"{min(ratios):.2f} to {max(ratios):.2f} times that of the mesh"
    )


KIND = Mesh
