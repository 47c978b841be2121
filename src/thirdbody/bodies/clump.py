"""Clumps: rigid unions of spheres and their mass properties."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from thirdbody.errors import Fault, InputError
from thirdbody.kernels.union import MOMENTS, break_heights, links, quadrature, union_moments

# Spheres that touch in one point belong together although rounding may part them by this much.
_TOUCH = 1e-9
# Per interval, in units of the largest radius: some 40 intervals then stay below 1e-5 of the volume (> 4).
_TOLERANCE = 2e-7
_QUADRATURE = quadrature()
# Rounding of the sums over slices; stated as error when the quadrature claims to be better than this.
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Clump:
    """A rigid union of spheres of unit density in its own principal frame (origin at the centroid).

    centers (k, 3) m, radii (k,) m, volume m3, inertia (3,) m5 with I1 <= I2 <= I3 (times density: kg m2),
    error: bound on the relative error of volume and principal moments, 0 for a single sphere. sides (k,): what
    each sphere can meet (`kernels.layout`), None for everything.
    """

    centers: np.ndarray
    radii: np.ndarray
    volume: float
    inertia: np.ndarray
    error: float
    sides: np.ndarray | None = None

    @property
    def diameter(self) -> float:
        """Diameter of the sphere of the same volume, m."""
        return (6.0 * self.volume / math.pi) ** (1.0 / 3.0)

    def scaled(self, factor: float) -> Clump:
        """The same shape with all lengths times factor."""
        return Clump(
            self.centers * factor,
            self.radii * factor,
            self.volume * factor**3,
            self.inertia * factor**5,
            self.error,
            self.sides,
        )


def clump(centers, radii) -> Clump:
    """Clump of the spheres with centers (k, 3) and radii (k,), in m; see `clump_with_frame`."""
    return clump_with_frame(centers, radii)[0]


def clump_with_frame(centers, radii) -> tuple[Clump, np.ndarray, np.ndarray]:
    """Clump, centroid (3,) m and quaternion (4,) of its principal frame in the frame of the centers given.

    Given center = centroid + rotate(quaternion, clump center), row by row. Every sphere counts once, however
    many share its volume (mass properties of the union, Green's theorem per slice, see `kernels.union`).
    Axes whose order or sign the shape leaves open are those nearest to the axes given.
    InputError: wrong shapes, radii not positive, or spheres that are not connected.
    """
    centers, radii = _checked(centers, radii)
    scale, anchor = float(radii.max()), centers[np.argmax(radii)]
    c, r = (centers - anchor) / scale, radii / scale
    _refuse_parts(c, r)
    volume, centroid, tensor, error = _mass_properties(c, r)
    inertia, axes = principal_axes(tensor)
    body = Clump((c - centroid) @ axes * scale, radii, volume * scale**3, inertia * scale**5, error)
    return body, anchor + centroid * scale, quaternion_from_matrix(axes)


def quaternion_from_matrix(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,), w >= 0, of a rotation matrix (3, 3); the largest part first (Shepperd 1978)."""
    m = rotation
    squares = np.array([m.trace(), m[0, 0], m[1, 1], m[2, 2]])
    k = int(np.argmax(squares))
    q = np.empty(4)
    if k == 0:
        q[:] = 1.0 + m.trace(), m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    else:
        i, j, n = k - 1, k % 3, (k + 1) % 3
        q[0] = m[n, j] - m[j, n]
        q[1 + i] = 1.0 + m[i, i] - m[j, j] - m[n, n]
        q[1 + j] = m[i, j] + m[j, i]
        q[1 + n] = m[i, n] + m[n, i]
    return q / math.copysign(np.linalg.norm(q), q[0])


def quaternion_product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Quaternion (4,) of the turn q followed by the turn p."""
    vector = p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *vector])


def matrix_from_quaternion(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3), body to world, of a unit quaternion (4,)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def _checked(centers, radii) -> tuple[np.ndarray, np.ndarray]:
    centers = np.array(centers, dtype=np.float64, order="C")
    radii = np.array(radii, dtype=np.float64, order="C")
    if centers.ndim != 2 or centers.shape[1] != 3 or radii.shape != centers.shape[:1] or not len(radii):
        raise InputError(
            f"a clump needs centers (k, 3) and radii (k,), not {centers.shape} and {radii.shape}"
        )
    faults = []
    for i, (center, radius) in enumerate(zip(centers, radii, strict=True)):
        if not np.isfinite(center).all():
            faults.append(Fault(f"spheres[{i}].center", f"{center.tolist()} is not finite"))
        if not (np.isfinite(radius) and radius > 0.0):
            faults.append(Fault(f"spheres[{i}].radius", f"{radius:g} m must be positive and finite"))
    if faults:
        raise InputError(faults)
    return centers, radii


def _refuse_parts(c: np.ndarray, r: np.ndarray) -> None:
    """Raises InputError that names the spheres cut off from sphere 0."""
    reach = np.empty(r.size)
    links(c, r, reach, np.empty(r.size, np.bool_))
    if reach.max() <= 1.0 + _TOUCH:
        return
    together = np.linalg.norm(c[:, None] - c, axis=-1) <= (r[:, None] + r) * (1.0 + _TOUCH)
    part = together[0]
    while (grown := together[part].any(axis=0)).sum() > part.sum():
        part = grown
    raise InputError(
        Fault(f"spheres[{i}]", "not connected to sphere 0: a rigid body must be in one piece")
        for i in np.flatnonzero(~part)
    )


def _mass_properties(c: np.ndarray, r: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, float]:
    """Volume, centroid (3,), inertia tensor (3, 3) about the centroid, error; lengths in largest radii."""
    keep = _not_swallowed(c, r)
    c, r = c[keep], r[keep]
    if r.size == 1:
        volume = 4.0 / 3.0 * math.pi * float(r[0]) ** 3
        return volume, c[0].copy(), 0.4 * volume * r[0] ** 2 * np.eye(3), 0.0
    middle = (c * r[:, None] ** 3).sum(axis=0) / (r**3).sum()
    moments, errors = _moments(np.ascontiguousarray(c - middle), r)
    volume, offset = moments[0], moments[1:4] / moments[0]
    xx, yy, zz, xy, xz, yz = moments[4:]
    second = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - volume * np.outer(offset, offset)
    tensor = np.trace(second) * np.eye(3) - second
    # Weyl: no principal moment moves by more than the norm of the tensor's error; the shift adds its part.
    arm = np.linalg.norm(offset)
    moved = 2.0 * np.linalg.norm(errors[4:]) + 2.0 * arm * np.linalg.norm(errors[1:4]) + arm**2 * errors[0]
    least = np.linalg.eigvalsh(tensor)[0]
    error = max(errors[0] / volume, moved / least, _ROUNDING)
    return float(volume), middle + offset, tensor, float(error)


def _moments(c: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Moments of the union and their error estimates, (2, 10)."""
    n = r.size
    total = np.zeros((2, MOMENTS))
    old, new = np.empty((2, MOMENTS))
    union_moments(
        c, r, break_heights(c, r), *_QUADRATURE, _TOLERANCE, np.empty((6, 2 * n + 7)), total, old, new
    )
    return total


def _not_swallowed(c: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Indices (m,) of the spheres that no single other sphere contains; of equal ones the first stays."""
    inside = np.linalg.norm(c[:, None] - c, axis=-1) + r[:, None] <= r * (1.0 + 1e-12)
    twin = inside & inside.T
    first = np.arange(r.size)[:, None] > np.arange(r.size)
    return np.flatnonzero(~((inside & ~twin) | (twin & first)).any(axis=1))


def principal_axes(tensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Principal moments (3,), rising, and right-handed axes (3, 3) as columns."""
    inertia, axes = np.linalg.eigh(tensor)
    # Without this a ball, whose axes are free, would be turned by rounding.
    if inertia[2] - inertia[0] <= 1e-12 * inertia[2]:
        return inertia, np.eye(3)
    for k in (0, 1):
        axes[:, k] *= math.copysign(1.0, axes[np.argmax(np.abs(axes[:, k])), k])
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return inertia, axes
