"""Parts of spheres and of straight lines in the slabs between equidistant planes, in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Slabs:
    """Slabs of equal thickness from `start` to `end` [m]; if `periodic`, the last is followed by the first."""

    start: float
    end: float
    count: int
    periodic: bool = False

    @property
    def planes(self) -> Array:
        """Positions of the planes, (count + 1,) [m]."""
        return np.linspace(self.start, self.end, self.count + 1)

    def images(self, position: Array) -> tuple[Array, ...]:
        """Return positions for every image that can reach the slabs: themselves, or wrapped ones and their neighbours."""
        if not self.periodic:
            return (position,)
        period = self.end - self.start
        wrapped = self.start + np.mod(position - self.start, period)
        return wrapped, wrapped - period, wrapped + period


def sphere_parts(slabs: Slabs, centres: Array, radii: Array) -> tuple[Array, Array]:
    """Return the volume of each sphere in each slab (n, count) [m3], and its first moment about the centre [m4].

    `centres` (n,): positions across the slabs [m]. A sphere of radius R has the cross section pi (R^2 - h^2) at the height h
    above its centre, so that below h lie the volume pi (R^2 h - h^3/3 + 2 R^3/3) and the moment pi (R^2 h^2/2 - h^4/4 - R^4/4).
    What lies outside all slabs is left out. In a periodic domain a sphere is thinner than the period.
    """
    volume, moment = np.zeros((len(radii), slabs.count)), np.zeros((len(radii), slabs.count))
    R = radii[:, None]
    for centre in slabs.images(centres):
        h = np.clip(slabs.planes - centre[:, None], -R, R)
        volume += np.diff(math.pi * (R**2 * h - h**3 / 3.0), axis=1)
        moment += np.diff(math.pi * (R**2 * h**2 / 2.0 - h**4 / 4.0), axis=1)
    return volume, moment


def line_parts(slabs: Slabs, starts: Array, changes: Array) -> Array:
    """Return the fraction of each straight line in each slab, (n, count).

    `starts` (n,): positions of one end across the slabs [m]; `changes` (n,): to the other end. A line along a plane lies in the
    slab that ends there.
    """
    fractions = np.zeros((len(starts), slabs.count))
    length = np.abs(changes)[:, None]
    for start in slabs.images(np.minimum(starts, starts + changes)):
        beyond = slabs.planes - start[:, None]
        reached = np.divide(np.clip(beyond, 0.0, length), length, out=(beyond > 0.0).astype(float), where=length > 0.0)
        fractions += np.diff(reached, axis=1)
    return fractions
