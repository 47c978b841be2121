"""Closed triangle surfaces: reading, checks and exact mass properties."""

import io
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from thirdbody.bodies.clump import principal_axes
from thirdbody.errors import Fault, InputError
from thirdbody.input_files import LARGEST, SMALLEST, read_bytes

SUFFIXES = (".stl", ".obj", ".ply")

# Files store the corners of each triangle separately in single precision: corners within this distance, over the largest
# coordinate, are one vertex (a step of float32 is 1.2e-7).
_SAME = 2e-7
# Smallest volume over area times extent of a body; less is a sheet (a leaf of paper has 2e-4).
_FLAT = 1e-7
# Lines along which the layers of a surface are counted, and the most of the volume that may be counted twice or negative:
# scans have folds of the size of a triangle, which change mass and moments by no more than that.
_LINES, _FOLDED = 500, 1e-3
# Header, count, and bytes per triangle of a binary STL file.
_STL_HEADER, _STL_TRIANGLE = 84, 50


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface: vertices (v, 3) [m], faces (f, 3) counter-clockwise from outside, name.

    Meshes of `load_mesh` and `checked_mesh` are closed, connected, consistent, of positive volume, and do not cut themselves.
    """

    vertices: np.ndarray
    faces: np.ndarray
    name: str

    @property
    def corners(self) -> np.ndarray:
        """Corners of the triangles, (f, 3, 3) [m]."""
        return self.vertices[self.faces]

    @cached_property
    def frame(self) -> tuple[float, np.ndarray]:
        """The largest extent [m] and the middle (3,) [m]."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        return float((high - low).max()), 0.5 * (low + high)

    @cached_property
    def unit(self) -> Any:
        """The same from the middle, in units of the extent, as a `trimesh.Trimesh`, whose tolerances are for such lengths."""
        import trimesh

        extent, middle = self.frame
        return trimesh.Trimesh((self.vertices - middle) / extent, self.faces, process=False)


class MassProperties(NamedTuple):
    """Mass properties at unit density: volume [m3], centroid (3,) [m], principal inertia (3,) [m5], I1 <= I2 <= I3.

    axes (3, 3): principal axes as columns, right-handed; error: bound on the relative rounding of volume and inertia.
    """

    volume: float
    centroid: np.ndarray
    inertia: np.ndarray
    axes: np.ndarray
    error: float


def load_mesh(path: str | Path, unit: float) -> Mesh:
    """Return the surface in an STL, OBJ or PLY file; unit: metres per unit of the file, 1e-3 for mm.

    Corners that coincide are merged, and so are the objects of an OBJ file. InputError: one fault with the path, if the file is
    missing, not readable or truncated, or as `checked_mesh`.
    """
    if not (math.isfinite(unit) and unit > 0.0):
        raise InputError(Fault("unit", f"{unit:g} m per unit of the mesh file must be positive and finite"))
    path = Path(path)
    vertices, faces = _read(path)
    with np.errstate(over="ignore", invalid="ignore"):
        extent = float(np.ptp(vertices, axis=0).max()) * unit if len(vertices) else math.nan
    # non-finite coordinates and single points are reported below
    if np.isfinite(vertices).all() and (extent > LARGEST or 0.0 < extent < SMALLEST):
        message = f"{extent:.3g} m across with {unit:.3g} m per unit, outside {SMALLEST:g} to {LARGEST:g} m; is the unit right?"
        raise _fault(str(path), message)
    return checked_mesh(vertices * unit, faces, str(path))


def checked_mesh(vertices, faces, name: str) -> Mesh:
    """Return the checked mesh, with coincident vertices merged and without empty triangles.

    InputError: one fault that names the file and a remedy, for a mesh that is not finite, empty, open, of mixed winding, in
    several pieces, flat or inside out, or that cuts through itself.
    """
    from trimesh.grouping import clusters

    vertices, faces = np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64)
    if not faces.size:
        raise _fault(name, "holds no triangles: it is empty, cut short, or not of the format its name says")
    if not np.isfinite(vertices).all():
        bad = int((~np.isfinite(vertices).all(axis=1)).sum())
        raise _fault(name, f"{bad} of {len(vertices)} vertices are not finite numbers; export the surface again")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise _fault(name, "a triangle names a vertex that is not there: the file is cut short; export it again")
    # the used vertices, coincident ones merged, without faces that have collapsed to a line
    points, inverse = np.unique(vertices[faces.ravel()], axis=0, return_inverse=True)
    label = np.arange(len(points))
    for group in clusters(points, _SAME * float(np.abs(points).max())):
        label[group] = group.min()
    faces = label[inverse.reshape(-1, 3)]
    used, faces = np.unique(faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)], return_inverse=True)
    mesh = Mesh(points[used], faces.reshape(-1, 3), name)
    if not mesh.faces.size:
        message = "all triangles are empty: every one has two corners at the same position"
        raise _fault(name, f"{message} (within {_SAME:g} of the largest coordinate, {np.abs(vertices).max():.3g} m)")
    if problem := _not_closed(mesh) or _folded(mesh):
        raise _fault(name, problem)
    return mesh


def mass_properties(mesh: Mesh) -> MassProperties:
    """Return exact volume, centroid and principal inertia of the polyhedron, at unit density (`trimesh`; Eberly 2002)."""
    (extent, middle), raw = mesh.frame, mesh.unit.mass_properties
    inertia, axes = principal_axes(np.asarray(raw.inertia))
    # Terms of either sign, up to the area times the extent, cancel to the volume; the least moment lies between larger ones.
    error = np.finfo(np.float64).eps * mesh.unit.area / raw.volume * inertia[2] / inertia[0]
    centroid = middle + extent * raw.center_mass
    return MassProperties(float(raw.volume * extent**3), centroid, inertia * extent**5, axes, float(error))


def surface_samples(mesh: Mesh, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points (count, 3) sampled by area, unit normals (count, 3), triangle indices (count,)."""
    area = mesh.unit.area_faces
    levels = (np.arange(count) + rng.random(count)) / count
    face = np.searchsorted(np.cumsum(area) / area.sum(), levels).clip(max=len(area) - 1)
    first, second = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack((1.0 - first, first * (1.0 - second), first * second), axis=1)
    points = np.einsum("pk,pki->pi", weights, mesh.corners[face])
    return points, mesh.unit.face_normals[face], face


def _fault(name: str, message: str) -> InputError:
    return InputError(Fault("mesh", message, name))


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    name = str(path)
    if path.suffix.lower() not in SUFFIXES:
        known = ", ".join(SUFFIXES)
        raise _fault(name, f"'{path.suffix}' is not a mesh file that can be read; save it as one of {known}")
    data = read_bytes(path, "mesh")
    if not data:
        raise _fault(name, "is empty: damaged or cut short; export the surface again")
    if path.suffix.lower() == ".stl":
        _refuse_short_stl(data, name)
    import trimesh

    try:
        options = {"skip_materials": True} if path.suffix.lower() == ".obj" else {}
        # Unprocessed: the checks must see what the library would repair silently (NaN, open seams).
        with np.errstate(all="ignore"):
            loaded = trimesh.load_mesh(io.BytesIO(data), file_type=path.suffix[1:].lower(), process=False, **options)
        return np.asarray(loaded.vertices, np.float64), np.asarray(loaded.faces, np.int64)
    # The parsers raise any exception on a broken file.
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".strip().splitlines()[0]
        line = _odd_vertex(data) if path.suffix.lower() == ".stl" else None
        raise _fault(name, line or f"is damaged or cut short ({reason}); export the surface again") from None


def _refuse_short_stl(data: bytes, name: str) -> None:
    # trimesh would read it as text without triangles
    if b"endsolid" in data.lower():
        return
    if data[:5].lower() == b"solid" and b"facet" in data[: _STL_TRIANGLE * 20].lower():
        raise _fault(name, "is cut short: no 'endsolid' ends it; export the surface again")
    count = int.from_bytes(data[_STL_HEADER - 4 : _STL_HEADER], "little")
    if len(data) < _STL_HEADER or len(data) != _STL_HEADER + _STL_TRIANGLE * count:
        complete = max(0, len(data) - _STL_HEADER) // _STL_TRIANGLE
        message = f"is cut short or no STL file: {count} triangles announced, {complete} held; export the surface again"
        raise _fault(name, message)


def _odd_vertex(data: bytes) -> str | None:
    """Return the fault of the first corner of a text STL file that is not three finite numbers."""
    for number, line in enumerate(data.splitlines(), 1):
        words = line.split()
        if not words or words[0].lower() != b"vertex":
            continue
        try:
            sound = len(words) == 4 and all(math.isfinite(float(word)) for word in words[1:])
        except ValueError:
            sound = False
        if not sound:
            shown = line.strip()[:60].decode("ascii", "replace")
            return f"line {number}: '{shown}' is not three finite numbers; export the surface again"
    return None


def _not_closed(mesh: Mesh) -> str:
    from trimesh.graph import connected_component_labels

    singular_values = np.linalg.svd(mesh.vertices - mesh.vertices.mean(axis=0), compute_uv=False)
    if singular_values[-1] <= _SAME * singular_values[0]:  # its two sides have merged, and every edge seems doubled
        return "encloses no volume: all vertices lie in one plane; a sheet is not a body, give it a thickness"
    surface = mesh.unit
    uses = np.bincount(surface.edges_unique_inverse)
    if (uses == 1).any():
        message = f"is not watertight: {(uses == 1).sum()} edges have a triangle on one side only; close the holes"
        return message + " in a mesh editor, or export again if the file was cut short"
    if (uses > 2).any():
        message = f"is not the surface of a body: {(uses > 2).sum()} edges have more than two triangles; in a mesh editor, "
        return message + "remove inner walls and doubled triangles, and part bodies that share an edge"
    if not surface.is_winding_consistent:
        mixed = (np.unique(surface.edges, axis=0, return_counts=True)[1] > 1).sum()
        return f"has triangles of mixed winding along {mixed} edges; make all normals point outwards in a mesh editor"
    # by edges: bodies that share no more than a vertex are two
    pieces = connected_component_labels(surface.face_adjacency, len(mesh.faces)).max() + 1
    if pieces > 1:
        return f"holds {pieces} separate surfaces; save each body to its own file, and fill cavities"
    if abs(surface.volume) <= _FLAT * surface.area:
        return f"encloses no volume ({surface.volume * mesh.frame[0] ** 3:.3g} m3): a sheet is not a body; give it a thickness"
    return "is inside out: its normals point inwards; flip all normals in a mesh editor" if surface.volume < 0.0 else ""


def _folded(mesh: Mesh) -> str:
    """Return where the surface cuts through itself by more than a thousandth of its volume.

    Lines in one direction through random points of the surface: from outside, they enter and leave the body in turn. A stretch
    that they have entered twice, or left before they entered, counts double or negative in volume and moments.
    """
    extent, middle = mesh.frame
    rng = np.random.default_rng(0)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = (surface_samples(mesh, _LINES, rng)[0] - middle) / extent @ rotation
    corners = mesh.unit.triangles @ rotation
    low, high = corners[:, :, :2].min(axis=1), corners[:, :, :2].max(axis=1)
    wrong, length, first = 0.0, 0.0, None
    for point in points:
        near = np.flatnonzero(((low <= point[:2]) & (high >= point[:2])).all(axis=1))
        arm = corners[near, :, :2] - point[:2]
        ahead = np.roll(arm, -1, axis=1)
        # Twice the areas that the edges span with the point: equal but for their sign in both triangles of an edge.
        parts = np.roll(arm[:, :, 0] * ahead[:, :, 1] - arm[:, :, 1] * ahead[:, :, 0], -1, axis=1)
        inside = (parts > 0.0).all(axis=1) | (parts < 0.0).all(axis=1)
        parts, near = parts[inside], near[inside]
        heights = (parts * corners[near, :, 2]).sum(axis=1) / parts.sum(axis=1)
        order = np.argsort(heights)
        layers = -np.cumsum(np.sign(parts[order, 0]))
        if not len(order) or layers[-1] != 0.0:
            continue  # through an edge, to the last digit
        steps = np.diff(heights[order])
        folded = (layers[:-1] < 0.0) | (layers[:-1] > 1.0)
        wrong, length = wrong + steps[folded].sum(), length + steps[~folded & (layers[:-1] == 1.0)].sum()
        if first is None and folded.any():
            k = int(np.where(folded, steps, 0.0).argmax())
            first = near[order[k : k + 2]]
    if wrong <= _FOLDED * length or first is None:
        return ""
    where = ", ".join(f"{value:.3g}" for value in mesh.corners[first[0]].mean(axis=0))
    message = f"cuts through itself: about {100.0 * wrong / (wrong + length):.2g} % of its volume counts twice or negative, as "
    return f"{message}between triangles {first[0]} and {first[1]} near ({where}) m; unite its parts in a mesh editor"
