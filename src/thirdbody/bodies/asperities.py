"""Asperities: small spheres on a clump, at points where a plane can touch it."""

import math
from dataclasses import dataclass

import numpy as np

from thirdbody.bodies.clump import Clump, clump
from thirdbody.errors import Fault, InputError

MAX_ASPERITIES = 32
"""Largest number of asperities of a body: mass properties cost the cube of the number of spheres."""
LARGEST = 0.5
"""Largest radius of an asperity over the body's equivalent radius; larger ones would change the body."""

# Candidate points per asperity, of which the farthest from those placed before is chosen (best candidate).
_CANDIDATES = 12
# The radius depends on the size of the whole body, which the asperities change: each iteration reduces the misfit
# to less than this fraction (at most 0.5; 0.01 for small ones), so that rounding is reached long before the limit.
_ROUNDS = 60


@dataclass(frozen=True)
class Asperities:
    """Spheres on a body: `count`, and `radius` [m] or `relative` to the equivalent radius."""

    count: int
    radius: float | None = None
    relative: float | None = None

    def fraction(self, diameter: float) -> float:
        """Return the radius over the equivalent radius of a body of this volume-equivalent diameter [m].

        InputError: count or fraction out of range, or not exactly one of radius and relative.
        """
        if not 1 <= self.count <= MAX_ASPERITIES:
            raise InputError(Fault("asperities.count", f"{self.count} must be 1 to {MAX_ASPERITIES}"))
        if (self.radius is None) == (self.relative is None):
            raise InputError(Fault("asperities.radius", "give the radius, or its relation to the body's"))
        value = self.relative if self.radius is None else 2.0 * self.radius / diameter
        assert value is not None
        if not 0.0 < value <= LARGEST:
            report = f"{value:.3g} of the equivalent radius of a body of diameter {diameter:.3g} m"
            raise InputError(Fault("asperities.radius", f"{report} must be more than 0 and at most {LARGEST:g}"))
        return value


def with_asperities(rng: np.random.Generator, body: Clump, count: int, fraction: float) -> Clump:
    """Return the body with `count` spheres on its surface, of its original volume-equivalent diameter.

    The centre of each sphere lies on the surface of the body, where a plane from a random direction would touch it: its summit
    protrudes by its own radius towards that plane, which then touches it and nothing else; the body stays in one piece. The
    points are spread: each is the farthest of 12 candidates from those before. The radius is `fraction` of the equivalent radius
    (half the diameter) of the whole; the asperities come last among the spheres, all of one radius.
    """
    centers = _surface_points(rng, body, count)
    radius = 0.5 * body.diameter
    small, size = fraction * radius, radius
    for _ in range(_ROUNDS):
        whole = clump(np.concatenate((body.centers, centers)), np.concatenate((body.radii, np.full(count, small))))
        before, size = size, 0.5 * whole.diameter
        if abs(size - before) <= 1e-14 * size:
            break
        small = fraction * size
    return whole.scaled(radius / size)


def _surface_points(rng: np.random.Generator, body: Clump, count: int) -> np.ndarray:
    """Return points (count, 3) of the surface that a plane can touch, far from each other."""
    normals = rng.normal(size=(count, _CANDIDATES, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    sphere = touched(body, normals.reshape(-1, 3)).reshape(count, _CANDIDATES)
    points = body.centers[sphere] + body.radii[sphere][:, :, None] * normals
    chosen = np.empty((count, 3))
    chosen[0] = points[0, 0]
    for k in range(1, count):
        apart = ((points[k][:, None] - chosen[:k]) ** 2).sum(axis=2).min(axis=1)
        chosen[k] = points[k, np.argmax(apart)]
    return chosen


def touched(body: Clump, normals: np.ndarray) -> np.ndarray:
    """Return the sphere (m,) that a plane touches first, for outward unit normals (m, 3)."""
    return (normals @ body.centers.T + body.radii).argmax(axis=1)


def sphere_points(count: int) -> np.ndarray:
    """Return points (count, 3) distributed evenly over the unit sphere (Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    rotation = math.pi * (1.0 + math.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - z * z)
    return np.column_stack((ring * np.cos(rotation), ring * np.sin(rotation), z))


_DIRECTIONS = sphere_points(400)


def summit_radii(body: Clump) -> np.ndarray:
    """Return radii (400,) [m] of the spheres that planes touch, over evenly distributed directions.

    Divided by the equivalent radius it measures sharpness: 1 for a sphere, less for sharp bodies.
    """
    return body.radii[touched(body, _DIRECTIONS)]
