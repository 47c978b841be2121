"""Quality of the fit of a clump to a mesh: distances in both directions, and radii of curvature."""

import math

import numpy as np
from scipy.spatial import cKDTree

from thirdbody.bodies.clump import sphere_points
from thirdbody.bodies.mesh import Mesh, surface_samples

# Number of points that distances are averaged over, and of those that distances are measured to. The latter, on
# spheres, matter only for nearest points on a crease: spaced by 0.025 R, they add less than 1e-3 R to a distance.
_MEASURED = 4000
_TARGETS = 20000
_DIRECTIONS = 500
# Nearest samples whose triangles may contain the nearest point.
_CANDIDATES = 8
# Spheres whose surfaces may be the nearest to a point inside the union; more lie farther away than these.
_NEIGHBOURS = 40
# Radius of the patch for the fit of a radius of curvature, over R: smallest and largest.
_PATCH = (0.1, 0.3)
_PATCH_POINTS = 18
# Twice the unknowns of the quadric through the vertex: fewer points do not average.
_MIN_POINTS = 10
# Cosine of the largest angle between normals of one patch; beyond it is the other face of a thin body.
_ONE_SIDE = 0.2


def union_samples(centers, radii, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return about `count` points (k, 3) sampled by area on the surface of the union of spheres."""
    number = count
    for _ in range(2):
        owner = np.searchsorted(np.cumsum(radii**2) / (radii**2).sum(), rng.random(number)).clip(max=len(radii) - 1)
        directions = rng.normal(size=(number, 3))
        points = centers[owner] + radii[owner, None] * directions / np.linalg.norm(directions, axis=1)[:, None]
        free = points[_exposed(points, radii[owner], centers, radii)]
        # Hidden parts yield no points: sampled again with a count scaled by the exposed fraction.
        number = math.ceil(count * count / max(1, len(free)))
    return free


def distances(mesh: Mesh, centers, radii, rng: np.random.Generator) -> tuple[float, float]:
    """Return the rms and the largest distance from the mesh to the union of spheres or back, the larger ones, over R."""
    points, _, _ = surface_samples(mesh, _MEASURED, rng)
    union = union_samples(centers, radii, _TARGETS, rng)
    target, _, face = surface_samples(mesh, _TARGETS, rng)
    there = distance_to_union(points, centers, radii, union)
    # Corners protrude farthest and random samples miss them.
    corners = distance_to_union(mesh.vertices, centers, radii, union)
    some = union[:: max(1, len(union) // _MEASURED)]
    back = np.linalg.norm(nearest_points(some, mesh, target, face) - some, axis=1)
    return math.sqrt(max((there**2).mean(), (back**2).mean())), float(max(there.max(), corners.max(), back.max()))


def distance_to_union(points, centers, radii, union: np.ndarray) -> np.ndarray:
    """Return the distance (p,) to the union of spheres; exact except near creases.

    In closed form outside, and inside where the nearest point is the foot of a perpendicular on an exposed part of a sphere;
    otherwise to the nearest of the points `union` on the surface, which is never too short.
    """
    nearest, _ = cKDTree(union).query(points)
    near = _by_power(centers, radii, points, min(len(radii), _NEIGHBOURS))[1]
    for first in range(0, len(points), 512):
        p, block = points[first : first + 512], slice(first, first + 512)
        c, r = centers[near[block]], radii[near[block]]
        arm = p[:, None] - c
        length = np.linalg.norm(arm, axis=2)
        depth = length - r
        feet = c + arm * (r / np.maximum(length, 1e-12))[:, :, None]
        square = (feet**2).sum(axis=2)[:, :, None] - 2.0 * feet @ c.transpose(0, 2, 1) + (c**2).sum(axis=2)[:, None]
        inside = square < (r**2 * (1.0 - 1e-9))[:, None]
        inside[:, np.arange(r.shape[1]), np.arange(r.shape[1])] = False
        reach = np.where(inside.any(axis=2), np.inf, np.abs(depth)).min(axis=1)
        gap = depth.min(axis=1)
        nearest[block] = np.where(gap >= 0.0, gap, np.minimum(nearest[block], reach))
    return nearest


def contact_ratio(mesh: Mesh, centers, radii, rng: np.random.Generator) -> np.ndarray:
    """Return the radius over that of the mesh, (m,), of the m spheres that planes touch; 1 is a contact as stiff as the mesh's.

    That of the mesh is the median over evenly distributed directions of the radius where a plane touches it, sqrt(R' R'') of
    the two principal radii (equivalent radius of an elliptical contact: Johnson 1985, section 4.2), inf where it is flat.
    """
    ups = sphere_points(_DIRECTIONS)
    vertices = np.array([np.argmax(mesh.vertices @ up) for up in ups])
    touched = (ups @ centers.T + radii).argmax(axis=1)
    corners, inverse = np.unique(vertices, return_inverse=True)
    local = local_radii(mesh, corners, rng)[inverse]
    spheres, count = np.unique(touched, return_counts=True)
    median = np.array([np.sort(local[touched == k])[(n - 1) // 2] for k, n in zip(spheres, count, strict=True)])
    return radii[spheres] / median


def local_radii(mesh: Mesh, corners: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the radii of curvature sqrt(R' R'') (k,) of the mesh at vertices `corners`, over R.

    A quadric through the vertex is fitted to the surrounding vertices or, where these are few, to points of the triangles. Edges
    are therefore rounded at the size of the patch. inf: flat or saddle-shaped there.
    """
    normals = mesh.unit.vertex_normals
    tree = cKDTree(mesh.vertices)
    points, across, _ = surface_samples(mesh, _TARGETS, rng)
    cloud = cKDTree(points)
    result = np.empty(len(corners))
    for k, corner in enumerate(corners):
        result[k], at, up = math.inf, mesh.vertices[corner], normals[corner]
        distance = tree.query(at, min(_PATCH_POINTS, len(normals)))[0][-1]
        near = tree.query_ball_point(at, min(max(distance, _PATCH[0]), _PATCH[1]))
        patch = mesh.vertices[[i for i in near if i != corner and normals[i] @ up > _ONE_SIDE]]
        if len(patch) < _MIN_POINTS:
            near = cloud.query_ball_point(at, _PATCH[1])
            patch = points[[i for i in near if across[i] @ up > _ONE_SIDE]]
        if len(patch) < _MIN_POINTS:
            continue
        side = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
        side /= np.linalg.norm(side)
        patch = patch - at
        # z = p x + q y + a x2/2 + b x y + c y2/2
        x, y, z = patch @ side, patch @ np.cross(up, side), patch @ up
        p, q, a, b, c = np.linalg.lstsq(np.stack((x, y, 0.5 * x * x, x * y, 0.5 * y * y), axis=1), z)[0]
        # do Carmo 1976, section 3-3: Gaussian curvature of a graph; convex where the second derivatives are negative.
        gauss = (a * c - b * b) / (1.0 + p * p + q * q) ** 2
        if gauss > 0.0 and a + c < 0.0:
            result[k] = 1.0 / math.sqrt(gauss)
    return result


def _exposed(points, own, centers, radii) -> np.ndarray:
    """Return which points (p,), on spheres of radius `own` (p,), lie in no other sphere."""
    return _by_power(centers, radii, points, 1)[0][:, 0] >= -1e-9 * own**2


def _by_power(centers, radii, points, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the least powers |x - c|2 - r2 of the points and the spheres they belong to, (p, count) in rising order.

    With a fourth coordinate sqrt(max r2 - r2) of the centers, powers are squared distances but for a constant.
    """
    largest = radii.max() ** 2
    tree = cKDTree(np.column_stack((centers, np.sqrt(largest - radii**2))))
    distance, near = tree.query(np.column_stack((points, np.zeros(len(points)))), range(1, count + 1))
    return distance**2 - largest, near


def union_volume(centers, radii) -> float:
    """Return the volume of the union of spheres, to some 2e-3 of it.

    A third of the integral of x.n over the surface (divergence theorem), by points spread evenly over every sphere.
    """
    ups = sphere_points(max(200, _TARGETS // len(radii)))
    points = centers[:, None] + radii[:, None, None] * ups
    own = np.repeat(radii, len(ups))
    free = _exposed(points.reshape(-1, 3), own, centers, radii).reshape(len(radii), -1)
    return float((4.0 * np.pi / 3.0 / len(ups) * radii**2 * ((points * ups).sum(axis=2) * free).sum(axis=1)).sum())


def nearest_points(points, mesh: Mesh, target: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Return the nearest points (p, 3) of the mesh, on the triangles of those of its samples `target` that are nearest."""
    from trimesh.triangles import closest_point

    _, near = cKDTree(target).query(points, _CANDIDATES)
    repeated = np.repeat(points, _CANDIDATES, axis=0)
    feet = closest_point(mesh.corners[face[near.ravel()]], repeated)
    best = np.linalg.norm(feet - repeated, axis=1).reshape(near.shape).argmin(axis=1)
    return feet.reshape(*near.shape, 3)[np.arange(len(points)), best]
