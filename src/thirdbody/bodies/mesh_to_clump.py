"""Clumps of spheres fitted to the surface of a mesh, with the mass properties of the mesh."""

from collections.abc import Iterator
from hashlib import sha256
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import cKDTree

from thirdbody.bodies.clump import Clump
from thirdbody.bodies.mesh import Mesh, mass_properties, surface_samples
from thirdbody.bodies.mesh_fit_quality import contact_ratio, distances, nearest_points, union_volume
from thirdbody.errors import Fault, InputError
from thirdbody.rotations import quaternion_from_matrix

SPHERES, DEFAULT = (4, 1500), 12
"""Range of the number of spheres: a flake of aspect 30 takes some 1200. By default so many, and more where they miss."""

RMS, VOLUME, EXTENT = 0.2, (0.5, 1.5), 1.5
"""Accepted fits: largest rms distance of the surfaces over R; volume of the union over the mesh's; extents along the principal
axes over the mesh's.

Fits that follow a body keep below 0.16, between 0.94 and 1.21, and below 1.4; those that miss a flake of aspect 10 make it 2.6
times as thick, thinner ones hundreds of times. Small spheres along a sheet, which touch their neighbours and both faces, fill
0.6 of it.
"""

# Largest number of cached fits: populations of one scene often share meshes.
_MAX_CACHED = 1000
_ALLOWED = f"allowed: {VOLUME[0]:g} to {VOLUME[1]:g} times, {EXTENT:g} times, {100 * RMS:g} %"
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
# Largest number of spheres that are adjusted (the cost grows with the cube: 0.5 s for 12, 6 s for 40), and the one tried where
# the default misses; beyond, they lie along the sheet.
_ADJUSTED, _SECOND = 40, 24
# Samples, each with a ball, for spheres along a sheet; balls of less than this fraction of the median reach into edges. Steps
# towards equal distances: more would draw the spheres back from the outline. Factors between numbers of spheres that are tried.
_ALL_OVER, _EDGE, _EVEN, _CLOSE, _MORE = 20000, 0.6, 3, 1.04, 1.2
# Attempts to move spheres hidden inside others to the places of largest misfit.
_ROUNDS = 2


class Fit(NamedTuple):
    """Accuracy of a clump's fit to its mesh, and the position of the clump's frame in that of the mesh.

    size: R [m], radius of the sphere of the mesh's volume; rms, maximum: distances from the mesh to the union or back, the larger
    one, over R; volume_ratio, extents (3,) along the principal axes: union over mesh (the clump has the mesh's volume);
    contact_ratio: radii of curvature, spheres over mesh; mesh point = centroid (3,) [m] + rotate(quaternion (4,), clump point).
    """

    size: float
    rms: float
    maximum: float
    volume_ratio: float
    extents: np.ndarray
    contact_ratio: np.ndarray
    centroid: np.ndarray
    quaternion: np.ndarray


_cache: dict[Any, tuple[Clump, Fit]] = {}


def clump_from_mesh(mesh: Mesh, n_spheres: int | None, seed: int = 0) -> tuple[Clump, Fit]:
    """Return a clump with the mesh's mass properties and spheres that follow its surface, and the fit.

    Up to 40 spheres: those that touch the surface from inside (medial axis: Ma, Bae & Choi 2012, Vis. Comput. 28, 7) are chosen
    one by one, each where it reduces the misfit most; then all centers and radii are adjusted to the surface by least squares.
    More: small spheres evenly along the medial axis, which in a flake or needle touch both faces. n_spheres None: 12, and where
    these miss as many as do not. The same mesh and seed give the same clump, fitted once for all populations; position,
    orientation and unit of the mesh enter by rounding only. InputError: n_spheres out of range, or a fit beyond `RMS`, `VOLUME`
    or `EXTENT`, or in parts; with the number that would fit.
    """
    shape = sha256(mesh.vertices.tobytes()).digest(), sha256(mesh.faces.tobytes()).digest()
    key = (*shape, mesh.name, n_spheres, seed)
    if key in _cache:
        return _cache[key]
    lowest, limit = SPHERES
    if n_spheres is not None and not lowest <= n_spheres <= limit:
        raise InputError(Fault("spheres", f"{n_spheres} is outside {lowest} to {limit}, the spheres that represent a mesh"))
    mass = mass_properties(mesh)
    size = (0.75 * mass.volume / np.pi) ** (1.0 / 3.0)
    unit = Mesh((mesh.vertices - mass.centroid) @ mass.axes / size, mesh.faces, mesh.name)
    problem = ""
    for centers, radii in _fits(unit, n_spheres or DEFAULT, seed):
        rng = np.random.default_rng(seed)
        volume = union_volume(centers, radii) / (4.0 / 3.0 * np.pi)
        rms, maximum = distances(unit, centers, radii, rng)
        reach = (centers + radii[:, None]).max(axis=0) - (centers - radii[:, None]).min(axis=0)
        extents = reach / np.ptp(unit.vertices, axis=0)
        far, parts = extents.max(), _tree(centers, radii)[1] > 1.0
        if not parts and rms <= RMS and VOLUME[0] <= volume <= VOLUME[1] and far <= EXTENT:
            break
        what = f"have {volume:.3g} times its volume, reach {far:.3g} times as far and are {100.0 * rms:.2g} % of R off"
        what = "do not connect" if parts else f"{what} (rms; {_ALLOWED})"
        problem = problem or f"{len(radii)} spheres miss this shape: they {what}; "
    else:
        needed = _number_along(unit, *_thin_balls(unit, seed))
        remedy = (
            f"nor do other numbers up to {limit}; smooth the mesh, or give its spheres in a table (kind 'file')"
            if needed < limit
            else f"small spheres all along it would be some {needed:.2g}, at most {limit} make a body: sheets and needles may be "
            "up to some thirty times as long as thick; give the mesh a larger thickness, or cut a smaller piece of it"
        )
        raise InputError(Fault("spheres", problem + remedy, mesh.name))
    if problem and n_spheres is not None:
        message = f"{problem}{len(radii)} fit (where no number is given, as many as it needs are taken)"
        raise InputError(Fault("spheres", message, mesh.name))
    ratio = contact_ratio(unit, centers, radii, rng)
    body = Clump(centers * size, radii * size, mass.volume, mass.inertia, mass.error)
    if len(_cache) == _MAX_CACHED:
        _cache.clear()
    frame = quaternion_from_matrix(mass.axes)
    _cache[key] = body, Fit(size, rms, maximum, volume, extents, ratio, mass.centroid, frame)
    return _cache[key]


def _fits(mesh: Mesh, n: int, seed: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield centers (k, 3) and radii (k,) of the n spheres, then of more, in units of R."""
    for number in dict.fromkeys((n, max(n, DEFAULT), max(n, _SECOND))):
        if number <= _ADJUSTED:
            yield _fitted(mesh, number, np.random.default_rng(seed))
    balls = _thin_balls(mesh, seed)
    low, maximum = max(n, _ADJUSTED), SPHERES[1]
    order = _farthest_points(*balls, maximum if _number_along(mesh, *balls) < 2 * maximum else low)
    if n > _ADJUSTED:
        yield _along(mesh, balls, order[:n], seed)
    high = len(order)
    while high > _CLOSE * low:  # the least number that connects and has the volume, closely
        number = (low + high) // 2
        centers, radii = _along(mesh, balls, order[:number], seed)
        enough = (radii**3).sum() >= VOLUME[0] and _tree(centers, radii)[1] <= 1.0
        low, high = (low, number) if enough else (number, high)
    while n < high <= len(order):
        yield _along(mesh, balls, order[:high], seed)
        high = int(_MORE * high)


def _fitted(mesh: Mesh, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return fitted centers (n, 3) and radii (n,) of the spheres, in units of R."""
    points, normals, face = surface_samples(mesh, _SAMPLES, rng)
    some = rng.permutation(_SAMPLES)
    balls = _inscribed(mesh, points, normals, face, some[:_BALLS])
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


def _inscribed(mesh: Mesh, points: np.ndarray, normals, face, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centers (k, 3), radii (k,) of the largest inscribed spheres at the samples `at` of the surface.

    Shrinking ball: while the surface comes inside, it is replaced by the sphere through the point nearest to its center that
    touches at the same sample.
    """
    p, n = points[at], normals[at]
    radii, left = np.full(len(at), _LARGEST), np.arange(len(at))
    while len(left):
        centers = p[left] - radii[left, None] * n[left]
        nearest = nearest_points(centers, mesh, points, face)
        arm = p[left] - nearest
        length, height = np.linalg.norm(arm, axis=1), (arm * n[left]).sum(axis=1)
        smaller = length**2 / np.maximum(2.0 * height, 1e-12)
        # An opposite wall counts; facets beside the sample, less than a hundredth of the radius inside, do not.
        beside = (np.linalg.norm(centers - nearest, axis=1) >= 0.99 * radii[left]) & (height < 0.5 * length)
        shrinks = (height > 0.0) & (smaller < (1.0 - 1e-4) * radii[left]) & ~beside
        left = left[shrinks]
        radii[left] = smaller[shrinks]
    return p - radii[:, None] * n, radii


def _thin_balls(mesh: Mesh, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return centers (k, 3) and radii (k,) of inscribed spheres at points all over the surface, without those in edges."""
    points, normals, face = surface_samples(mesh, _ALL_OVER, np.random.default_rng(seed))
    centers, radii = _inscribed(mesh, points, normals, face, np.arange(_ALL_OVER))
    wide = radii > _EDGE * np.median(radii)
    return centers[wide], radii[wide]


def _number_along(mesh: Mesh, centers, radii) -> float:
    """Return about how many spheres along a sheet connect: hexagons of the diameter on half the area, and a third more."""
    return 1.35 * 0.5 * mesh.unit.area * mesh.frame[0] ** 2 * float((1.0 / (2.0 * np.sqrt(3.0) * radii**2)).mean())


def _farthest_points(centers, radii, n: int) -> np.ndarray:
    """Return n of the spheres, each the farthest from those before it in units of both radii (farthest point sampling)."""
    chosen, gap = [int(radii.argmax())], np.full(len(radii), np.inf)
    while len(chosen) < n:
        last = chosen[-1]
        gap = np.minimum(gap, np.linalg.norm(centers - centers[last], axis=1) / (radii + radii[last]))
        chosen.append(int(gap.argmax()))
    return np.array(chosen)


def _along(mesh: Mesh, balls: tuple[np.ndarray, np.ndarray], chosen: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the chosen balls after steps towards equal distances (Lloyd 1982, IEEE Trans. Inf. Theory 28, 129), inscribed."""
    means = balls[0][chosen]
    for _ in range(_EVEN):
        own = cKDTree(means).query(balls[0])[1]
        sums = [np.bincount(own, balls[0][:, k], len(means)) for k in range(3)]
        number = np.bincount(own, minlength=len(means))
        means = np.where(number[:, None] > 0, np.transpose(sums) / np.maximum(number, 1)[:, None], means)
    centers = balls[0][np.unique(cKDTree(balls[0]).query(means)[1])]
    points, _, face = surface_samples(mesh, _ALL_OVER, np.random.default_rng(seed))
    return centers, np.linalg.norm(nearest_points(centers, mesh, points, face) - centers, axis=1)


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
    (first, second), _ = _tree(centers, radii)
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
    # logarithms keep the radii positive, and a bad trial step finite
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


def _tree(centers, radii) -> tuple[tuple[np.ndarray, np.ndarray], float]:
    """Return the n - 1 pairs that link all spheres with the smallest stretch (minimum spanning tree), and the largest of these.

    The stretch is the distance of the centers over the sum of radii: the spheres are in one piece where none is above 1.
    """
    # Coincident centers would read as no link: a sparse graph holds no zeros.
    apart = np.linalg.norm(centers[:, None] - centers, axis=2) / (radii[:, None] + radii)
    links = minimum_spanning_tree(np.triu(apart + 1e-12, 1))
    return links.nonzero(), float(links.data.max(initial=0.0))
