"""Clumps: rigid unions of spheres and their mass properties."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from thirdbody.bodies.union_moments import longest_links, union_moments
from thirdbody.errors import Fault, InputError
from thirdbody.rotations import cross, dot, quaternion_from_matrix

# Tolerance in the test of connectedness: rounding may separate spheres that touch in one point by this much.
_TOUCH = 1e-9
# Spheres whose centers and radii differ by less, in units of the largest radius of the body, are one sphere given twice.
_TWICE = 1e-9
# Rounding of the sums over slices; the stated error is never smaller than this.
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Clump:
    """A rigid union of spheres of unit density in its principal frame (origin at the centroid).

    Attributes
    ----------
    centers : ndarray (k, 3)
        Centres of the spheres [m].
    radii : ndarray (k,)
        Radii of the spheres [m].
    volume : float
        Of the union [m3].
    inertia : ndarray (3,)
        Principal moments I1 <= I2 <= I3 [m5]; times density: kg m2.
    error : float
        Bound on the relative error of volume and principal moments, 0 for a single sphere.
    sides : ndarray (k,) or None
        Surfaces and bodies that each sphere can touch (`kernels.tables`); None: all.
    shape : Clump or None
        The clump of which this is a copy of another size (`resized`), so that what follows from the shape is computed once.
    """

    centers: np.ndarray
    radii: np.ndarray
    volume: float
    inertia: np.ndarray
    error: float
    sides: np.ndarray | None = None
    shape: Clump | None = None

    @property
    def diameter(self) -> float:
        """Diameter of the sphere of the same volume [m]."""
        return (6.0 * self.volume / math.pi) ** (1.0 / 3.0)

    def scaled(self, factor: float) -> Clump:
        """Return the same shape with all lengths times factor."""
        return Clump(
            self.centers * factor, self.radii * factor, self.volume * factor**3, self.inertia * factor**5, self.error, self.sides
        )

    def resized(self, diameter: float) -> Clump:
        """Return a copy of this shape with the diameter [m], which knows its `shape`."""
        return replace(self.scaled(diameter / self.diameter), shape=self)


def clump(centers, radii) -> Clump:
    """Return the clump of spheres; each volume counts once, however many spheres share it.

    Parameters
    ----------
    centers : array_like (k, 3)
        Centres of the spheres [m].
    radii : array_like (k,)
        Radii of the spheres [m].

    Returns
    -------
    Clump
        At unit density, in its principal frame.

    Raises
    ------
    InputError
        Wrong shapes, radii not positive, or spheres that are not connected.

    Examples
    --------
    >>> ball = plugin.clump([[0.0, 0.0, 0.0]], [2.0])
    >>> round(ball.volume, 3)
    33.51
    """
    return clump_with_frame(centers, radii)[0]


def clump_with_frame(centers, radii) -> tuple[Clump, np.ndarray, np.ndarray]:
    """Return the clump of spheres with its principal frame.

    Parameters
    ----------
    centers, radii : array_like (k, 3) and (k,)
        Spheres [m]; refused as by `clump`.

    Returns
    -------
    clump : Clump
        Mass properties are those of the union of the spheres (Green's theorem per slice, `bodies.union_moments`).
    centroid : ndarray (3,)
        Centre of mass in the frame of `centers` [m].
    quaternion : ndarray (4,)
        Principal frame in that of `centers`: given center = centroid + rotate(quaternion, clump center), row by row. Axes whose
        order or sign the shape leaves undetermined are those nearest to the given axes.
    """
    centers = np.array(centers, dtype=np.float64, order="C")
    radii = np.array(radii, dtype=np.float64, order="C")
    if centers.ndim != 2 or centers.shape[1] != 3 or radii.shape != centers.shape[:1] or not len(radii):
        raise InputError(f"a clump needs centers (k, 3) and radii (k,), not {centers.shape} and {radii.shape}")
    faults = []
    for i, (center, radius) in enumerate(zip(centers, radii, strict=True)):
        if not np.isfinite(center).all():
            faults.append(Fault(f"spheres[{i}].center", f"{center.tolist()} is not finite"))
        if not (np.isfinite(radius) and radius > 0.0):
            faults.append(Fault(f"spheres[{i}].radius", f"{radius:g} m must be positive and finite"))
    if faults:
        raise InputError(faults)
    bodies, centroids, axes = _with_frames(centers[None], radii[None])
    return bodies[0], centroids[0], quaternion_from_matrix(axes[0])


def stacks(sizes: Sequence[int] | np.ndarray, margin: int) -> Iterator[tuple[int, np.ndarray]]:
    """Yield sphere count n and members (m,) of stacks of bodies with n spheres each, of at most margin / n^3 bodies.

    The margin bounds the memory of tables over triples of spheres.
    """
    sizes = np.asarray(sizes)
    for n in np.unique(sizes):
        members = np.flatnonzero(sizes == n)
        maximum = max(1, margin // int(n) ** 3)
        for first in range(0, len(members), maximum):
            yield int(n), members[first : first + maximum]


def clumps(centers: np.ndarray, radii: np.ndarray) -> list[Clump]:
    """Return clumps of bodies of n spheres each, centers (b, n, 3) [m] and radii (b, n) [m].

    Finite centers and positive radii are assumed. InputError: spheres of a body that are not connected.
    """
    return _with_frames(centers, radii)[0]


def _with_frames(centers: np.ndarray, radii: np.ndarray) -> tuple[list[Clump], np.ndarray, np.ndarray]:
    """Return clumps of a stack (b, n, 3), (b, n), their centroids (b, 3) [m] and principal axes (b, 3, 3) as columns."""
    scale, largest = radii.max(axis=1), radii.argmax(axis=1)
    anchor = centers[np.arange(len(radii)), largest]
    c, r = (centers - anchor[:, None]) / scale[:, None, None], radii / scale[:, None]
    _refuse_parts(c, r)
    volume, centroid, tensor, moved = _mass_properties(c, r)
    inertia, axes = principal_axes(tensor)
    # Weyl: no principal moment changes by more than the norm of the tensor's error.
    error = np.maximum(moved[0] / volume, moved[1] / inertia[:, 0])
    own = (c - centroid[:, None]) @ axes * scale[:, None, None]
    size, moments = volume * scale**3, inertia * scale[:, None] ** 5
    built = zip(own, radii, size.tolist(), moments, error.tolist(), strict=True)
    return [Clump(*parts) for parts in built], anchor + centroid * scale[:, None], axes


def impossible_moments(inertia) -> tuple[int, str] | None:
    """Return the first row of principal moments (n, 3) that no body has, and what is wrong: one above the sum of the others.

    I1 + I2 - I3 is twice the integral of z2 dm (Landau & Lifshitz 1976, section 32); of a plate without thickness it is rounding.
    """
    small, middle, large = np.sort(np.asarray(inertia, float), axis=1).T
    odd = np.flatnonzero(large > (small + middle) * (1.0 + 1e-6))
    if not len(odd):
        return None
    k = int(odd[0])
    others = f"{small[k]:.3g} + {middle[k]:.3g}, the sum of the other moments of inertia"
    return k, f"{large[k]:.3g} is above {others}: no body has such"


def repeated_spheres(centers: np.ndarray, radii: np.ndarray) -> list[tuple[int, int]]:
    """Return indices (k, i) of spheres k with the center and radius of an earlier sphere i of the body.

    Such a sphere adds nothing to the body's volume, but would double every contact.
    """
    apart = np.linalg.norm(centers[:, None] - centers, axis=-1) + np.abs(radii[:, None] - radii)
    same = np.tril(apart <= _TWICE * radii.max(), -1)
    return [(int(k), int(same[k].argmax())) for k in np.flatnonzero(same.any(axis=1))]


def _refuse_parts(centers: np.ndarray, radii: np.ndarray) -> None:
    apart = np.flatnonzero(longest_links(centers, radii) > 1.0 + _TOUCH)
    if not len(apart):
        return
    from scipy.sparse.csgraph import connected_components

    c, r = centers[apart[0]], radii[apart[0]]
    together = np.linalg.norm(c[:, None] - c, axis=-1) <= (r[:, None] + r) * (1.0 + _TOUCH)
    _, part = connected_components(together, directed=False)
    why = "not connected to sphere 0: a rigid body must be in one piece"
    raise InputError(Fault(f"spheres[{i}]", why) for i in np.flatnonzero(part != part[0]))


def _mass_properties(c: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return volumes (b,), centroids (b, 3), central inertia tensors (b, 3, 3) and errors of volume and tensor (2, b).

    For a stack (b, n, 3), (b, n) in units of the largest radius.
    """
    bodies = len(r)
    volume, centroid = np.empty(bodies), np.empty((bodies, 3))
    tensor, error = np.empty((bodies, 3, 3)), np.zeros((2, bodies))
    # spheres inside no other one; of equal ones the first counts
    arm = c[:, :, None] - c[:, None]
    inside = np.sqrt(dot(arm, arm)) + r[:, :, None] <= (r * (1.0 + 1e-12))[:, None]
    twin, first = inside & inside.transpose(0, 2, 1), np.tri(r.shape[1], k=-1, dtype=bool)
    exposed = ~((inside & ~twin) | (twin & first)).any(axis=2)
    saved = exposed.sum(axis=1)
    for m in np.unique(saved):
        rows = np.flatnonzero(saved == m)
        inner, radii = c[rows][exposed[rows]].reshape(-1, m, 3), r[rows][exposed[rows]].reshape(-1, m)
        if m == 1:
            volume[rows] = 4.0 / 3.0 * math.pi * radii[:, 0] ** 3
            centroid[rows] = inner[:, 0]
            tensor[rows] = (0.4 * volume[rows] * radii[:, 0] ** 2)[:, None, None] * np.eye(3)
        else:
            volume[rows], centroid[rows], tensor[rows], error[:, rows] = _union_properties(inner, radii)
    return volume, centroid, tensor, error


def _union_properties(c: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """`_mass_properties` of spheres none of which lies inside another."""
    weight = r**3
    middle = (c * weight[:, :, None]).sum(axis=1) / weight.sum(axis=1)[:, None]
    moments, errors = union_moments(np.ascontiguousarray(c - middle[:, None]), r)
    volume = moments[:, 0]
    offset = moments[:, 1:4] / volume[:, None]
    xx, yy, zz, xy, xz, yz = moments[:, 4:].T
    second = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
    second = second - volume[:, None, None] * (offset[:, :, None] * offset[:, None])
    tensor = np.trace(second, axis1=1, axis2=2)[:, None, None] * np.eye(3) - second
    # The shift adds its part to the error of the second moments; rounding adds to all errors.
    arm = np.sqrt(dot(offset, offset))
    first, whole = np.linalg.norm(errors[:, 1:4], axis=1), np.linalg.norm(errors[:, 4:], axis=1)
    moved = 2.0 * whole + 2.0 * arm * first + arm**2 * errors[:, 0]
    return volume, middle + offset, tensor, np.array([np.maximum(errors[:, 0], _ROUNDING * volume), moved])


def principal_axes(tensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ascending principal moments (..., 3) and right-handed axes (..., 3, 3), as columns, of tensors."""
    inertia, axes = np.linalg.eigh(tensor)
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=-2)[..., None, :], axis=-2)
    axes = axes * np.copysign(1.0, largest)
    axes[..., 2] = cross(axes[..., 0], axes[..., 1])
    # Without this, rounding would rotate a sphere, whose axes are undetermined.
    axes[inertia[..., 2] - inertia[..., 0] <= 1e-12 * inertia[..., 2]] = np.eye(3)
    return inertia, axes


def sphere_points(count: int) -> np.ndarray:
    """Return points (count, 3) distributed evenly over the unit sphere (Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    rotation = math.pi * (1.0 + math.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - z * z)
    return np.column_stack((ring * np.cos(rotation), ring * np.sin(rotation), z))


_DIRECTIONS = sphere_points(400)


def touched(body: Clump, normals: np.ndarray) -> np.ndarray:
    """Return the sphere (m,) that a plane touches first, for outward unit normals (m, 3)."""
    return (normals @ body.centers.T + body.radii).argmax(axis=1)


def summit_radii(body: Clump) -> np.ndarray:
    """Return radii (400,) [m] of the spheres that planes touch, over evenly distributed directions.

    Divided by the equivalent radius it measures sharpness: 1 for a sphere, less for sharp bodies.
    """
    return body.radii[touched(body, _DIRECTIONS)]
