"""Report of `thirdbody shapes`: the bodies of a scene's populations, the fit of spheres to a mesh, the kinds of debris."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.assembly.populate import population_context, shapes_of
from thirdbody.bodies.clump import summit_radii
from thirdbody.bodies.mesh import SUFFIXES, load_mesh, mass_properties
from thirdbody.bodies.mesh_to_clump import clump_from_mesh
from thirdbody.debris.mesh import MeshShape, meshes_in
from thirdbody.debris.registry import DebrisKinds
from thirdbody.errors import InputError, UsageError, nearest
from thirdbody.report.tables import print_json, table
from thirdbody.rotations import matrix_from_quaternion
from thirdbody.scene.keys import table_keys
from thirdbody.scene.model import Scene
from thirdbody.system.terminal import print_line
from thirdbody.units import parse_unit, pretty, with_unit

if TYPE_CHECKING:
    from thirdbody.bodies.clump import Clump
    from thirdbody.bodies.mesh import Mesh
    from thirdbody.bodies.mesh_to_clump import Fit

SEED = 1
"""For a mesh file, as for debris of the kind `mesh`."""


_ROWS = (
    ("diameter (of equal volume)", "diameter", "length"), ("spheres per body", "spheres", "dimensionless"),
    ("volume", "volume", "volume"), ("mass", "mass", "mass"), ("radius of the spheres", "sphere_radius", "length"),
    ("radius where a plane touches", "contact_radius", "length"), ("  over the equivalent radius", "sharpness", "dimensionless"),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Population:
    """Bodies of one population: name, kind, material, density [kg/m3], the meshes that they follow in turn, and notes."""

    name: str
    kind: str
    material: str
    density: float
    clumps: list[Clump]
    meshes: Sequence[MeshShape] = ()
    notes: Sequence[str] = ()


def populations(scene: Scene) -> list[Population]:
    """Return the bodies of every population of a scene. Raises InputError when they cannot be generated."""
    result = []
    for index, debris in enumerate(scene.debris):
        clumps = shapes_of(scene, index, [])
        meshes = debris.mesh_shapes(population_context(scene, index, []))  # those of `shapes_of`, fitted once
        density = scene.materials[debris.material].density
        name, notes = debris.name or f"debris[{index}]", debris.notes()
        result.append(Population(name, debris.kind, debris.material, density, clumps, meshes, notes))
    return result


def mesh_population(path: Path, unit: str | None, spheres: int | None, seed: int | None) -> Population:
    """Return one body that follows a mesh file, of unit density. Raises UsageError for the unit, InputError for the mesh."""
    if unit is None:
        raise UsageError(f"{path}: a mesh file carries no unit: give one, such as --unit um")
    try:
        length = parse_unit(unit)
    except ValueError as error:
        raise UsageError(f"--unit: {error}") from None
    mesh = load_mesh(path, length)
    body, fit = clump_from_mesh(mesh, spheres, SEED if seed is None else seed)
    return Population(path.name, "mesh", "", 1.0, [body], [MeshShape(path.name, mesh, body, fit)])


def read_shapes(
    path: Path, unit: str | None, spheres: int | None, seed: int | None, settings: Mapping[str, str], plugins: Sequence[Path]
) -> list[Population]:
    """Return the populations of a scene file, or the bodies of a mesh file or of a folder of them.

    Raises UsageError for options that do not belong to the file, InputError for the file.
    """
    folder = os.path.isdir(path)  # `Path.is_dir` raises for names that are too long
    meshes = folder or path.suffix.lower() in SUFFIXES
    if meshes and settings:
        raise UsageError("--set replaces values of a scene; a mesh file has --unit, --spheres and --seed")
    if folder:
        files = meshes_in(path)
        if not files:
            raise InputError(f"{path}: the folder holds no mesh file ({', '.join(SUFFIXES)})")
        return [mesh_population(file, unit, spheres, seed) for file in files]
    if meshes:
        return [mesh_population(path, unit, spheres, seed)]
    given = [name for name, value in (("--unit", unit), ("--spheres", spheres), ("--seed", seed)) if value is not None]
    if given:
        known = ", ".join(SUFFIXES)
        raise UsageError(f"{', '.join(given)}: only for a mesh file ({known}); a scene holds these values itself")
    if path.suffix.lower() != ".toml":
        raise InputError(f"{path}: neither a scene (.toml) nor a mesh ({', '.join(SUFFIXES)})")
    return populations(Scene.load(path, plugins).with_settings(settings))


def population_statistics(population: Population) -> dict[str, Any]:
    """Return statistics of a population in SI; each over its bodies, but `sphere_radius` over all spheres.

    `contact_radius` is the radius of the sphere that a plane touches, mean over all directions; `sharpness` the same over the
    body's equivalent radius (1 for a sphere).
    """
    clumps, density = population.clumps, population.density
    diameter = np.array([body.diameter for body in clumps])
    summit = np.array([summit_radii(body).mean() for body in clumps])
    inertia = density * np.array([body.inertia for body in clumps])
    entry: dict[str, Any] = {
        "name": population.name,
        "kind": population.kind,
        "material": population.material,
        "density": density,
        "count": len(clumps),
        "diameter": _statistics(diameter),
        "spheres": _statistics(np.array([len(body.radii) for body in clumps], float)),
        "volume": _statistics(np.array([body.volume for body in clumps])),
        "mass": _statistics(density * np.array([body.volume for body in clumps])),
        "inertia": [_statistics(column) for column in inertia.T],
        "sphere_radius": _statistics(np.concatenate([body.radii for body in clumps])),
        "contact_radius": _statistics(summit),
        "sharpness": _statistics(2.0 * summit / diameter),
        "relative_error": max(body.error for body in clumps),
    }
    if population.notes:
        entry["notes"] = list(population.notes)
    if population.meshes:
        entry["fits"] = [_fit(shape.surface, shape.fit) for shape in population.meshes]
        if len(population.meshes) == 1:
            entry["fit"] = entry["fits"][0]
    return entry


def _statistics(values: np.ndarray) -> dict[str, float]:
    low, high = float(values.min()), float(values.max())
    # sizes that are equal but for rounding have no spread
    mean, deviation = (low, 0.0) if high - low <= 1e-12 * high else (float(values.mean()), float(values.std()))
    return {"mean": mean, "std": deviation, "min": low, "median": float(np.median(values)), "max": high}


def _fit(mesh: Mesh, fit: Fit) -> dict[str, Any]:
    mass, ratio = mass_properties(mesh), fit.contact_ratio
    return {
        "mesh": mesh.name,
        "triangles": len(mesh.faces),
        "radius": fit.size,
        "rms": fit.rms,
        "maximum": fit.maximum,
        "mesh_volume": mass.volume,
        "mesh_inertia": mass.inertia,
        "union_volume_ratio": fit.volume_ratio,
        "union_extent_ratio": fit.extents,
        "contact_radius_ratio": {"min": float(ratio.min()), "median": float(np.median(ratio)), "max": float(ratio.max())},
    }


def shapes_report(result: list[Population], json: bool) -> None:
    """Print the statistics of all populations, as tables or as JSON."""
    entries = [population_statistics(population) for population in result]
    if json:
        print_json({"populations": entries})
        return
    columns = ("mean", "std", "min", "median", "max")
    for number, entry in enumerate(entries):
        if number:
            print()
        rows = [[name, *(pretty(entry[key][column], unit) for column in columns)] for name, key, unit in _ROWS]
        for axis, values in enumerate(entry["inertia"], 1):
            rows.append([f"moment of inertia I{axis}, kg m2", *(f"{values[column]:.3g}" for column in columns)])
        material = f" of {entry['material']}" if entry["material"] else ", density 1 kg/m3"
        table(f"{entry['name']}: {_bodies(entry['count'])}, {entry['kind']}{material}", ("", *columns), rows)
        for note in entry.get("notes", ()):
            print_line(note)
        for fit in entry.get("fits", ()):
            table("fit to the mesh", ("", ""), _fit_rows(fit))


def _bodies(count: int) -> str:
    return "1 body" if count == 1 else f"{count} bodies"


def _fit_rows(fit: dict[str, Any]) -> list[tuple[str, str]]:
    ratio = fit["contact_radius_ratio"]
    volume, inertia = pretty(fit["mesh_volume"], "volume"), ", ".join(f"{value:.4g}" for value in fit["mesh_inertia"])
    extents = ", ".join(f"{value:.3g}" for value in fit["union_extent_ratio"])
    span = f"{ratio['min']:.3g} to {ratio['max']:.3g}"
    return [
        ("mesh", f"{fit['mesh']}, {fit['triangles']} triangles, R = {pretty(fit['radius'], 'length')} (ball of the same volume)"),
        ("distance of surfaces", f"{100 * fit['rms']:.2g} % of R (rms), {100 * fit['maximum']:.2g} % at most"),
        ("volume, inertia", f"those of the mesh: {volume}; {inertia} m5 at density 1"),
        ("union of the spheres", f"{fit['union_volume_ratio']:.3g} of its volume, {extents} of its length, width, thickness"),
        ("where a plane touches", f"{ratio['median']:.3g} of the mesh's radius (median; {span})"),
    ]


def draw_shapes(result: list[Population], title: str, png: Path) -> Path:
    """Draw a gallery of the populations' bodies; return the path. Raises like `render.gallery.draw_gallery`."""
    from thirdbody.render.gallery import draw_gallery

    groups = []
    for one in result:
        count = len(one.meshes)
        if count < 2:
            groups.append(_group(one))
        for k, shape in enumerate(one.meshes if count > 1 else ()):  # a group for each mesh
            part = replace(one, name=f"{one.name}: {shape.name}", clumps=one.clumps[k::count], meshes=[shape])
            groups.append(_group(part))
    return draw_gallery(groups, title, png)


def _group(population: Population) -> Any:
    from thirdbody.render.gallery import Group

    entry = population_statistics(population)
    diameter, spheres = entry["diameter"], entry["spheres"]
    # VTK's fonts draw square brackets as round ones
    name = population.name.replace("[", " ").replace("]", "")
    heading = ", ".join(part for part in (name, population.kind, population.material, _bodies(entry["count"])) if part)
    size = with_unit(diameter["mean"], "m")
    if diameter["std"] > 0.0:
        size += f" ({with_unit(diameter['min'], 'm')} to {with_unit(diameter['max'], 'm')})"
    if not population.meshes:
        number = f"{spheres['min']:g}" if spheres["min"] == spheres["max"] else f"{spheres['min']:g} to {spheres['max']:g}"
        touching = f"radius where a plane touches {entry['sharpness']['mean']:.2f} of the equivalent radius"
        facts = f"diameter {size}   ·   {number} sphere{'s' * (spheres['max'] > 1)}   ·   {touching}"
        return Group(heading, facts, population.clumps)
    (shape,), body = population.meshes, population.clumps[0]
    fit = shape.fit
    error = f"surfaces {100 * fit.rms:.2g} % of R apart (at most {100 * fit.maximum:.2g} %)"
    facts = f"diameter {size}   ·   {error}   ·   touching radius {np.median(fit.contact_ratio):.2f} of the mesh's"
    # the mesh is scaled with bodies of another size than the file's
    scale = body.diameter / (2.0 * fit.size)
    vertices = (shape.surface.vertices - fit.centroid) @ matrix_from_quaternion(fit.quaternion) * scale
    return Group(heading, facts, population.clumps, vertices, shape.surface.faces)


def kinds_report(kind: str | None, plugins: Sequence[Path], json: bool) -> None:
    """Print all kinds of debris and their sources, or the keys of one kind. Raises UsageError for an unknown kind."""
    result = DebrisKinds(plugins)
    failures, usable = result.failures(), result.usable()
    if kind is not None and kind not in usable:
        raise UsageError(failures.get(kind) or f"--list {kind}: no such kind of debris, {nearest(kind, usable)}")
    first = {name: " ".join((one.__doc__ or "").split()).split(". ")[0].rstrip(".") for name, one in usable.items()}
    entries: list[dict[str, Any]] = [
        {"kind": name, "from": result.source(name), "description": first[name], "schema": one.model_json_schema()}
        for name, one in usable.items()
        if kind in (None, name)
    ]
    if json:
        print_json({"kinds": entries, "failures": failures})
        return
    if kind is None:
        rows = [[str(entry[key]) for key in ("kind", "from", "description")] for entry in entries]
        table("kinds of debris (debris.kind)", ("kind", "from", "bodies"), rows)
        for why in failures.values():
            print_line(f"kind of debris {why}")
        print("\nthe keys of one of them: thirdbody shapes --list KIND")
        return
    (entry,) = entries
    rows = [[key.path, key.value, key.default, key.meaning] for key in table_keys(entry["schema"])]
    table(f"{kind}: {entry['description']}", ("key", "value", "default", "meaning"), rows)
