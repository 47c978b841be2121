"""Closed triangle surfaces: reading, checks and exact mass properties."""

import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from thirdbody.bodies.bounded_read import LARGEST, SMALLEST, read_bytes
from thirdbody.bodies.clump import principal_axes
from thirdbody.errors import Fault, InputError

SUFFIXES = (".stl", ".obj", ".ply")

# Files store the corners of each triangle separately in single precision: corners within this distance, over the largest
# coordinate, are one vertex (a step of float32 is 1.2e-7).
_SAME = 2e-7
# Smallest volume over area times extent of a body; less is a sheet (a leaf of paper has 2e-4).
_FLAT = 1e-7
# Header, count, and bytes per triangle of a binary STL file.
_STL_HEADER, _STL_TRIANGLE = 84, 50


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface: vertices (v, 3) [m], faces (f, 3) counter-clockwise from outside, name.

    Meshes of `load_mesh` and `checked_mesh` are closed, connected, consistent and of positive volume. Self-intersection is not
    checked: volume and inertia then count the common part twice.
    """

    vertices: np.ndarray
    faces: np.ndarray
    name: str

    @property
    def corners(self) -> np.ndarray:
        """Corners of the triangles, (f, 3, 3) [m]."""
        return self.vertices[self.faces]


@dataclass(frozen=True, eq=False)
class MassProperties:
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
    several pieces, flat or inside out.
    """
    vertices, faces = np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64)
    if not faces.size:
        raise _fault(name, "holds no triangles: it is empty, cut short, or not of the format its name says")
    if not np.isfinite(vertices).all():
        bad = int((~np.isfinite(vertices).all(axis=1)).sum())
        raise _fault(name, f"{bad} of {len(vertices)} vertices are not finite numbers; export the surface again")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise _fault(name, "a triangle names a vertex that is not there: the file is cut short; export it again")
    largest = float(np.abs(vertices).max())
    vertices, faces = _merged(vertices, faces)
    if not faces.size:
        message = "all triangles are empty: every one has two corners at the same position"
        raise _fault(name, f"{message} (within {_SAME:g} of the largest coordinate, {largest:.3g} m)")
    _refuse_planar(vertices, name)
    _refuse_open(faces, name)
    _refuse_pieces(faces, name)
    mesh = Mesh(vertices, faces, name)
    _refuse_flat(mesh)
    return mesh


def mass_properties(mesh: Mesh) -> MassProperties:
    """Return exact volume, centroid and principal inertia of the polyhedron, at unit density.

    Divergence theorem: signed tetrahedra from a common point to each triangle (Tonon 2004, J. Math. Stat. 1, 8). With J = det(a,
    b, c), s = a + b + c: volume J/6, first moment J s/24, second J (aa + bb + cc + ss)/120.
    """
    anchor = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    corners = mesh.corners - anchor
    jacobian = _determinants(corners)
    total = corners.sum(axis=1)
    volume = jacobian.sum() / 6.0
    centroid = (jacobian @ total) / (24.0 * volume)
    flat = corners.reshape(-1, 3)
    second = (np.repeat(jacobian, 3) * flat.T) @ flat + (jacobian * total.T) @ total
    second = second / 120.0 - volume * np.outer(centroid, centroid)
    inertia, axes = principal_axes(np.trace(second) * np.eye(3) - second)
    # Terms of either sign cancel: the rounding is that of the sum of their absolute values.
    size = np.abs(jacobian) @ ((corners**2).sum(axis=(1, 2)) + (total**2).sum(axis=1)) / 120.0
    lost = max(np.abs(jacobian).sum() / (6.0 * volume), 2.0 * size / inertia[0])
    error = 4.0 * np.finfo(np.float64).eps * lost
    return MassProperties(float(volume), anchor + centroid, inertia, axes, float(error))


def _determinants(corners: np.ndarray) -> np.ndarray:
    """Return six times the signed volumes (f,) of tetrahedra from the origin to triangles (f, 3, 3)."""
    return np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))


def _fault(name: str, message: str) -> InputError:
    return InputError(Fault("mesh", message, name))


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (v, 3) in units of the file and faces (f, 3), unchanged."""
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
    """Raise InputError for a truncated binary STL file, which would be read as text without triangles."""
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


def _merged(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the used vertices, coincident ones merged, and faces without those that have collapsed to a line."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    points, inverse = np.unique(vertices[faces.ravel()], axis=0, return_inverse=True)
    pairs = cKDTree(points).query_pairs(_SAME * float(np.abs(points).max()), output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(points), len(points)))
    count, label = connected_components(links, directed=False)
    merged = np.empty((count, 3))
    merged[label[::-1]] = points[::-1]
    faces = label[inverse.reshape(-1, 3)].astype(np.int64)
    sound = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    used, faces = np.unique(faces[sound], return_inverse=True)
    return merged[used], faces.reshape(-1, 3)


def _refuse_open(faces: np.ndarray, name: str) -> None:
    """Raise InputError unless every edge belongs to two triangles that run along it in opposite directions."""
    edges = np.stack((faces, np.roll(faces, -1, axis=1)), axis=2).reshape(-1, 2)
    _, uses = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    if (uses == 1).any():
        message = f"is not watertight: {(uses == 1).sum()} edges have a triangle on one side only; close the holes"
        raise _fault(name, message + " in a mesh editor, or export again if the file was cut short")
    if (uses > 2).any():
        message = f"is not the surface of a body: {(uses > 2).sum()} edges have more than two triangles; "
        raise _fault(name, message + "remove inner walls and doubled triangles in a mesh editor")
    _, uses = np.unique(edges, axis=0, return_counts=True)
    if (uses > 1).any():
        message = f"has triangles of mixed winding along {(uses > 1).sum()} edges; make all normals point outwards"
        raise _fault(name, message + " in a mesh editor")


def _refuse_pieces(faces: np.ndarray, name: str) -> None:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = int(faces.max()) + 1
    links = coo_array((np.ones(faces.size), (faces.ravel(), np.roll(faces, 1, axis=1).ravel())), shape=(n, n))
    count, _ = connected_components(links, directed=False)
    if count > 1:
        message = f"holds {count} separate surfaces; save each body to its own file, and fill cavities"
        raise _fault(name, message)


def _refuse_planar(vertices: np.ndarray, name: str) -> None:
    """Raise InputError for a flattened body, before the edges: its two sides merge, and every edge seems doubled."""
    singular_values = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    if singular_values[-1] <= _SAME * singular_values[0]:
        raise _fault(name, "encloses no volume: all vertices lie in one plane; a sheet is not a body, give it a thickness")


def _refuse_flat(mesh: Mesh) -> None:
    """Raise InputError unless the volume is positive and more than that of a sheet."""
    corners = mesh.corners - mesh.vertices.mean(axis=0)
    volume = _determinants(corners).sum() / 6.0
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2.0
    if abs(volume) <= _FLAT * area * np.ptp(mesh.vertices, axis=0).max():
        raise _fault(mesh.name, f"encloses no volume ({volume:.3g} m3): a sheet is not a body; give it a thickness")
    if volume < 0.0:
        raise _fault(mesh.name, "is inside out: its normals point inwards; flip all normals in a mesh editor")
