"""Clumps of spheres fitted to the surface of a mesh, with the mass properties of the mesh."""

from dataclasses import dataclass
from hashlib import sha256
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import cKDTree

from thirdbody.bodies.clump import Clump, clump, quaternion_from_matrix
from thirdbody.bodies.mesh import Mesh, mass_properties
from thirdbody.bodies.mesh_fit_quality import ContactRadii, Distances, contact_radii, distances, surface_samples
from thirdbody.bodies.union_moments import longest_links
from thirdbody.errors import Fault, InputError

SPHERES = (4, 40)

MAX_CACHED = 1000
"""Largest number of cached fits: populations of one scene often share meshes."""

# Lengths in R, the radius of the sphere of the same volume.
_SAMPLES = 8000
_BALLS = 1000
_LARGEST = 3.0
# Smoothing widths of the distance to the union: a large one lets spheres far from a surface point move together, zero
# is the union itself.
_WIDTHS = (0.1, 0.02, 0.0)
_STEPS = 30
# Weight of the initial position of each sphere, as a fraction of all samples: far below any relevant misfit, and enough
# to hold a sphere that reaches no sample, which would otherwise drift or shrink to nothing.
_TETHER = 1e-3
# Linked spheres overlap at least until the distance of their centers is this fraction of the sum of radii.
_NECK = 0.95
# Attempts to move spheres hidden inside others to the places of largest misfit.
_ROUNDS = 2


@dataclass(frozen=True, eq=False)
class Fit:
    """Accuracy of a clump's fit to its mesh, and the position of the clump's frame in that of the mesh.

    size: R [m], radius of the sphere of the mesh's volume; to_spheres, to_mesh: distances from the mesh to the union and back,
    over R; volume_ratio: union over mesh (the clump has the mesh's volume); contacts: radii of curvature; mesh point = centroid
    (3,) [m] + rotate(quaternion (4,), clump point).
    """

    size: float
    to_spheres: Distances
    to_mesh: Distances
    volume_ratio: float
    contacts: ContactRadii
    centroid: np.ndarray
    quaternion: np.ndarray

    @property
    def rms(self) -> float:
        """The larger of the two rms distances, over R."""
        return max(self.to_spheres.rms, self.to_mesh.rms)

    @property
    def maximum(self) -> float:
        """The larger of the two largest distances, over R."""
        return max(self.to_spheres.maximum, self.to_mesh.maximum)


_cache: dict[Any, tuple[Clump, Fit]] = {}


def clump_from_mesh(mesh: Mesh, n_spheres: int, seed: int = 0) -> tuple[Clump, Fit]:
    """Return a clump with the mesh's mass properties and spheres fitted to its surface, and the fit.

    Spheres that touch the surface from inside (medial axis: Ma, Bae & Choi 2012, Vis. Comput. 28, 7) are chosen one by one, each
    where it reduces the misfit most; then all centers and radii are adjusted to the surface by least squares. The same mesh and
    seed give the same clump, fitted once for all populations; position, orientation and unit of the mesh enter by rounding only.
    InputError: n_spheres out of range, or spheres that do not connect.
    """
    shape = sha256(mesh.vertices.tobytes()).digest(), sha256(mesh.faces.tobytes()).digest()
    key = (*shape, mesh.name, n_spheres, seed)
    if key not in _cache:
        if len(_cache) == MAX_CACHED:
            _cache.clear()
        _cache[key] = _clump_of(mesh, n_spheres, seed)
    return _cache[key]


def _clump_of(mesh: Mesh, n_spheres: int, seed: int) -> tuple[Clump, Fit]:
    """`clump_from_mesh` without the cache."""
    minimum, maximum = SPHERES
    if not minimum <= n_spheres <= maximum:
        raise InputError(Fault("spheres", f"{n_spheres} is outside {minimum} to {maximum}, the spheres that represent a mesh"))
    mass = mass_properties(mesh)
    size = (0.75 * mass.volume / np.pi) ** (1.0 / 3.0)
    unit = Mesh((mesh.vertices - mass.centroid) @ mass.axes / size, mesh.faces, mesh.name)
    rng = np.random.default_rng(seed)
    centers, radii = _fitted(unit, n_spheres, rng)
    _refuse_parts(centers, radii, mesh.name)
    there, back = distances(unit, centers, radii, rng)
    contacts = contact_radii(unit, centers, radii, rng)
    contacts = ContactRadii(contacts.spheres, contacts.fraction, contacts.radius * size, contacts.local_radius * size)
    ratio = clump(centers, radii).volume / (4.0 / 3.0 * np.pi)
    body = Clump(centers * size, radii * size, mass.volume, mass.inertia, mass.error)
    return body, Fit(size, there, back, ratio, contacts, mass.centroid, quaternion_from_matrix(mass.axes))


def _fitted(mesh: Mesh, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return fitted centers (n, 3) and radii (n,) of the spheres, in units of R."""
    points, normals, _ = surface_samples(mesh, _SAMPLES, rng)
    some = rng.permutation(_SAMPLES)
    balls = _inscribed(points, normals, some[:_BALLS])
    # Ten samples per unknown for the largest number of spheres, forty for the smallest.
    x = points[some[-(600 + 25 * n) :]]
    chosen = _cover(*balls, x, np.full(len(x), np.inf), n)
    centers, radii = balls[0][chosen], balls[1][chosen]
    for width in _WIDTHS:
        centers, radii = _adjusted(centers, radii, x, width)
    for _ in range(_ROUNDS):
        gaps = np.linalg.norm(x[:, None] - centers, axis=2) - radii
        idle = np.setdiff1d(np.arange(n), gaps.argmin(axis=1))
        if not idle.size:
            break
        replacements = _cover(*balls, x, gaps.min(axis=1) ** 2, idle.size)
        centers[idle], radii[idle] = balls[0][replacements], balls[1][replacements]
        centers, radii = _adjusted(centers, radii, x, 0.0)
    return centers, radii


def _inscribed(points: np.ndarray, normals: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centers (k, 3), radii (k,) of the largest inscribed spheres at the surface points `at`.

    Shrinking ball: while a sample lies inside, it is replaced by the sphere through that sample that touches at the same point.
    """
    tree = cKDTree(points)
    p, n = points[at], normals[at]
    radii = np.full(len(at), _LARGEST)
    while True:
        centers = p - radii[:, None] * n
        distance, nearest = tree.query(centers)
        arm = p - points[nearest]
        height = (arm * n).sum(axis=1)
        # Samples are not dense: dents up to a hundredth of the radius are below their resolution.
        shrinks = (distance < 0.99 * radii) & (height > 0.0)
        if not shrinks.any():
            return centers, radii
        radii[shrinks] = (arm**2).sum(axis=1)[shrinks] / (2.0 * height[shrinks])


def _cover(centers, radii, x: np.ndarray, misfit: np.ndarray, n: int) -> np.ndarray:
    """Return the spheres (n,) that, one by one, most reduce the squared distances misfit (m,) of x (m, 3)."""
    square = (np.linalg.norm(x - centers[:, None], axis=2) - radii[:, None]) ** 2
    chosen = []
    for _ in range(n):
        chosen.append(int(np.minimum(square, misfit).sum(axis=1).argmin()))
        misfit = np.minimum(misfit, square[chosen[-1]])
    return np.array(chosen)


def _adjusted(centers, radii, x: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Fit centers and radii to bring the union's signed distance at the surface points x (m, 3) to zero."""
    n, start = len(radii), np.column_stack((centers, np.log(radii)))
    first, second = _tree(centers, radii)
    tether, tie = np.sqrt(_TETHER * len(x) / n), np.sqrt(len(x))
    rows = np.arange(n - 1)

    def residual(p: np.ndarray) -> np.ndarray:
        c, r = _unpacked(p)
        apart = np.linalg.norm(c[first] - c[second], axis=1)
        torn = np.maximum(0.0, apart - _NECK * (r[first] + r[second]))
        return np.concatenate((_distance(c, r, x, width)[0], tether * (p - start.ravel()), tie * torn))

    def slope(p: np.ndarray) -> np.ndarray:
        c, r = _unpacked(p)
        _, part, distance = _distance(c, r, x, width)
        surface = np.concatenate((-part[:, :, None] * distance, (-part * r)[:, :, None]), axis=2)
        link = np.zeros((n - 1, n, 4))
        arm = c[first] - c[second]
        apart = np.linalg.norm(arm, axis=1)
        torn = tie * (apart > _NECK * (r[first] + r[second]))
        direction = (torn / np.maximum(apart, 1e-12))[:, None] * arm
        link[rows, first, :3], link[rows, second, :3] = direction, -direction
        link[rows, first, 3], link[rows, second, 3] = -_NECK * torn * r[first], -_NECK * torn * r[second]
        return np.concatenate((surface.reshape(len(x), -1), tether * np.eye(4 * n), link.reshape(n - 1, -1)))

    result = least_squares(residual, start.ravel(), jac=slope, method="lm", max_nfev=_STEPS, xtol=1e-6, ftol=1e-6)
    return _unpacked(result.x)


def _unpacked(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centers and radii; logarithms keep the radii positive, and a bad trial step finite."""
    q = p.reshape(-1, 4)
    return q[:, :3], np.exp(np.clip(q[:, 3], -10.0, 10.0))


def _distance(c, r, x: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return signed distance (m,) of x to the union (positive outside), weights (m, n), directions (m, n, 3).

    The distance is -width ln(sum exp(-g / width)) of the distances g to the spheres; for width 0 the smallest of them. Weights
    are those of the spheres in this sum.
    """
    arm = x[:, None] - c
    length = np.sqrt((arm * arm).sum(axis=2))
    gaps = length - r
    minimum = gaps.min(axis=1)
    distance = arm / np.maximum(length, 1e-12)[:, :, None]
    if width == 0.0:
        part = np.zeros_like(gaps)
        part[np.arange(len(x)), gaps.argmin(axis=1)] = 1.0
        return minimum, part, distance
    part = np.exp((minimum[:, None] - gaps) / width)
    total = part.sum(axis=1)
    return minimum - width * np.log(total), part / total[:, None], distance


def _tree(centers, radii) -> tuple[np.ndarray, np.ndarray]:
    """Return the n - 1 pairs that link all spheres with the smallest stretch (minimum spanning tree)."""
    # Coincident centers would read as no link: a sparse graph holds no zeros.
    apart = np.linalg.norm(centers[:, None] - centers, axis=2) / (radii[:, None] + radii)
    return minimum_spanning_tree(np.triu(apart + 1e-12, 1)).nonzero()


def _refuse_parts(centers, radii, name: str) -> None:
    longest = np.empty(1)
    longest_links(np.ascontiguousarray(centers)[None], radii[None], longest)
    if longest[0] > 1.0:
        message = f"{len(radii)} spheres are too few for this shape: they do not connect; take more"
        raise InputError(Fault("spheres", message, name))
