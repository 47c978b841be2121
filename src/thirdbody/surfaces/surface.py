"""A surface of a first body: heights on a periodic grid, the spline through them, and where spheres rest on it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from thirdbody.surfaces.statistics import Statistics, surface_statistics

# Points per radius of the first evaluation of a dilation, at least; the grid of the surface may be finer.
_PER_RADIUS = 8
# Refinements around every local maximum, each by a factor of 4: it is then known to 1e-8 of the radius.
_ROUNDS = 4
# Largest number of points evaluated at once.
_POINTS = 2_000_000

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Surface:
    """Heights above the mean plane at the points of a periodic grid, and what made them.

    heights (n_y, n_x) [m], mean 0: the first point is at the origin of the domain, x changes fastest; size: period along x and y
    [m]; shortest: shortest wavelength that it is meant to have [m]; curvature: whether its curvature changes the radius of
    contacts; notes: what was done to a measured surface; copies: equal parts along x and y of which it consists.
    """

    heights: np.ndarray = field(repr=False)
    size: tuple[float, float]
    shortest: float
    curvature: bool = True
    notes: tuple[str, ...] = ()
    copies: tuple[int, int] = (1, 1)

    @property
    def one_copy(self) -> np.ndarray:
        """Heights of the first of its equal parts, which is periodic too."""
        n_y, n_x = self.heights.shape
        return self.heights[: n_y // self.copies[1], : n_x // self.copies[0]]

    @property
    def spacing(self) -> tuple[float, float]:
        """Distance of the grid points along x and y [m]."""
        return self.size[0] / self.heights.shape[1], self.size[1] / self.heights.shape[0]

    @cached_property
    def coefficients(self) -> np.ndarray:
        """Coefficients (n_y, n_x) [m] of the periodic bicubic B-spline that passes through the heights."""
        from scipy.ndimage import spline_filter

        return np.asarray(spline_filter(self.heights, order=3, output=np.float64, mode="grid-wrap"))

    @cached_property
    def statistics(self) -> Statistics:
        """Its statistics, of one of its equal parts."""
        return surface_statistics(self.one_copy, self.spacing)

    @cached_property
    def packed(self) -> np.ndarray:
        """The spline as kernels take it (`kernels.height_field`): one row of numbers."""
        from thirdbody.kernels.height_field import pack_field

        return pack_field(self.coefficients.T, *self.size)


def about_mean_plane(heights: np.ndarray) -> np.ndarray:
    """Return heights with mean 0."""
    return np.ascontiguousarray(heights - heights.mean())


def dilation(surface: Surface, centres: Array, radii: Array) -> Array:
    """Return the height (n,) [m] above the mean plane at which each sphere touches the surface from above (ISO 16610-41).

    It is the maximum of h(x + u) + sqrt(R^2 - u^2) over all |u| <= R. centres (n, 2 or more): x, y [m] in the coordinates of the
    surface, periodic.
    """
    result, steps = np.empty(len(radii)), np.minimum(surface.spacing, np.asarray(radii)[:, None] / _PER_RADIUS)
    counts = np.ceil(np.asarray(radii)[:, None] / steps).astype(np.int64)
    for shape in np.unique(counts, axis=0):
        members = np.flatnonzero((counts == shape).all(axis=1))
        size = max(1, _POINTS // int(np.prod(2 * shape + 1)))
        for first in range(0, len(members), size):
            some = members[first : first + size]
            result[some] = _highest(surface, centres[some, :2], radii[some], shape)
    return result


def _highest(surface: Surface, centres: Array, radii: Array, counts: Array) -> Array:
    """Return `dilation` of spheres with the same numbers of points (x, y) per radius."""
    u, v = np.meshgrid(*(np.arange(-n, n + 1) / n for n in counts), indexing="ij")
    offsets = radii[:, None, None, None] * np.stack((u, v), axis=-1)
    values = _touching(surface, centres[:, None, None], radii[:, None, None], offsets)
    # points at least as high as their four neighbours
    beside = np.pad(values, ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    maxima = np.isfinite(values)
    for other in (beside[:, 2:, 1:-1], beside[:, :-2, 1:-1], beside[:, 1:-1, 2:], beside[:, 1:-1, :-2]):
        maxima &= values >= other
    sphere, i, j = np.nonzero(maxima)
    best, at, step = values[sphere, i, j], offsets[sphere, i, j], radii[sphere, None] / counts
    near = np.stack(np.meshgrid(*(np.arange(-4, 5),) * 2, indexing="ij"), axis=-1).reshape(-1, 2) / 4.0
    for _ in range(_ROUNDS):
        tries = at[:, None] + step[:, None] * near
        values = _touching(surface, centres[sphere, None], radii[sphere, None], tries)
        k, rows = values.argmax(axis=1), np.arange(len(at))
        best, at, step = np.maximum(best, values[rows, k]), tries[rows, k], step / 4.0
    result = np.full(len(radii), -np.inf)
    np.maximum.at(result, sphere, best)
    return result


def _touching(surface: Surface, centres: Array, radii: Array, offsets: Array) -> Array:
    """Return h + sqrt(R^2 - u^2) at offsets u (..., 2) from the centres; -inf beyond the sphere."""
    from scipy.ndimage import map_coordinates

    rest = radii**2 - (offsets**2).sum(axis=-1)
    at = (centres + offsets) / np.array(surface.spacing)
    heights = map_coordinates(surface.coefficients, [at[..., 1], at[..., 0]], order=3, mode="grid-wrap", prefilter=False)
    return np.where(rest >= 0.0, heights + np.sqrt(np.maximum(rest, 0.0)), -np.inf)
