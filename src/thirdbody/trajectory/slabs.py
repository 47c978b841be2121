"""Parts of spheres and of straight lines in the slabs between equidistant planes, in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Slabs:
    """Slabs of equal thickness from `start` to `end` [m]; if `periodic`, the last is followed by the first."""

    start: float
    end: float
    count: int
    periodic: bool = False

    def images(self, position: Array) -> tuple[Array, ...]:
        """Return positions for every image that can reach the slabs: themselves, or wrapped ones and their neighbours."""
        if not self.periodic:
            return (position,)
        period = self.end - self.start
        wrapped = self.start + np.mod(position - self.start, period)
        return wrapped, wrapped - period, wrapped + period

    def touched(self, low: Array, high: Array) -> tuple[Ints, Ints]:
        """Return every pair of an interval and a slab that it touches: number of the interval `low` to `high` [m], and slab."""
        thickness = (self.end - self.start) / self.count
        first, last = (np.clip(np.floor((x - self.start) / thickness), 0, self.count - 1) for x in (low, high))
        number = np.where((high < self.start) | (low >= self.end), 0, last - first + 1).astype(np.int64)
        row = np.repeat(np.arange(len(low)), number)
        before = np.cumsum(number) - number
        return row, first.astype(np.int64)[row] + np.arange(len(row)) - before[row]

    def planes(self, slab: Ints) -> tuple[Array, Array]:
        """Return the positions of the planes below and above slabs [m]."""
        thickness = (self.end - self.start) / self.count
        below = self.start + slab.astype(np.float64) * thickness
        return below, below + thickness


class Parts(NamedTuple):
    """Parts of things in slabs: number of the thing, slab, and how much of it lies there."""

    thing: Ints
    slab: Ints
    amount: Array


def sphere_parts(slabs: Slabs, centres: Array, radii: Array) -> tuple[Parts, Array]:
    """Return the volumes of spheres in the slabs that they touch [m3], and their first moments about the centres [m4].

    `centres` (n,): positions across the slabs [m]. A sphere of radius R has the cross section pi (R^2 - h^2) at the height h
    above its centre, so that below h lie the volume pi (R^2 h - h^3/3 + 2 R^3/3) and the moment pi (R^2 h^2/2 - h^4/4 - R^4/4).
    What lies outside all slabs is left out. In a periodic domain a sphere is thinner than the period.
    """
    parts, moments = [], []
    for centre in slabs.images(centres):
        row, slab = slabs.touched(centre - radii, centre + radii)
        R = radii[row]
        low, high = (np.clip(plane - centre[row], -R, R) for plane in slabs.planes(slab))
        volume = math.pi * (high - low) * (R**2 - (high**2 + high * low + low**2) / 3.0)
        parts.append(Parts(row, slab, volume))
        moments.append(math.pi * (high**2 - low**2) * (R**2 / 2.0 - (high**2 + low**2) / 4.0))
    return _joined(parts), np.concatenate(moments)


def line_parts(slabs: Slabs, starts: Array, changes: Array) -> Parts:
    """Return the fractions of straight lines in the slabs that they touch.

    `starts` (n,): positions of one end across the slabs [m]; `changes` (n,): to the other end. A line without extent across the
    slabs lies in one of them.
    """
    parts, length = [], np.abs(changes)
    for begin in slabs.images(np.minimum(starts, starts + changes)):
        row, slab = slabs.touched(begin, begin + length)
        low, high = (np.clip(plane - begin[row], 0.0, length[row]) for plane in slabs.planes(slab))
        parts.append(Parts(row, slab, np.divide(high - low, length[row], out=np.ones(len(row)), where=length[row] > 0.0)))
    return _joined(parts)


def _joined(parts: list[Parts]) -> Parts:
    return Parts(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
