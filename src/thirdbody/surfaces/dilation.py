"""Heights at which spheres rest on a surface: its dilation by a ball (ISO 16610-41)."""

import numpy as np

from thirdbody.surfaces.surface import Surface

Array = np.ndarray

PER_RADIUS = 8
"""Points per radius of the first evaluation, at least; the grid of the surface may be finer."""

ROUNDS = 4
"""Refinements around every local maximum, each by a factor of 4: it is then known to 1e-8 of the radius."""

POINTS = 2_000_000
"""Largest number of points evaluated at once."""


def dilation(surface: Surface, centres: Array, radii: Array) -> Array:
    """Return the height (n,) [m] above the mean plane at which each sphere touches the surface from above.

    It is the maximum of h(x + u) + sqrt(R^2 - u^2) over all |u| <= R. centres (n, 2 or more): x, y [m] in the coordinates of the
    surface, periodic.
    """
    result, steps = np.empty(len(radii)), np.minimum(surface.spacing, np.asarray(radii)[:, None] / PER_RADIUS)
    counts = np.ceil(np.asarray(radii)[:, None] / steps).astype(np.int64)
    for shape in np.unique(counts, axis=0):
        members = np.flatnonzero((counts == shape).all(axis=1))
        size = max(1, POINTS // int(np.prod(2 * shape + 1)))
        for first in range(0, len(members), size):
            some = members[first : first + size]
            result[some] = _highest(surface, centres[some, :2], radii[some], shape)
    return result


def _highest(surface: Surface, centres: Array, radii: Array, counts: Array) -> Array:
    """Return `dilation` of spheres with the same numbers of points (x, y) per radius."""
    u, v = np.meshgrid(*(np.arange(-n, n + 1) / n for n in counts), indexing="ij")
    offsets = radii[:, None, None, None] * np.stack((u, v), axis=-1)
    values = _touching(surface, centres[:, None, None], radii[:, None, None], offsets)
    sphere, i, j = np.nonzero(_local_maxima(values))
    best, at, step = values[sphere, i, j], offsets[sphere, i, j], radii[sphere, None] / counts
    near = np.stack(np.meshgrid(*(np.arange(-4, 5),) * 2, indexing="ij"), axis=-1).reshape(-1, 2) / 4.0
    for _ in range(ROUNDS):
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


def _local_maxima(values: Array) -> Array:
    """Return which points (n, i, j) are at least as high as their four neighbours."""
    beside = np.pad(values, ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    middle = beside[:, 1:-1, 1:-1]
    maxima = np.isfinite(middle)
    for other in (beside[:, 2:, 1:-1], beside[:, :-2, 1:-1], beside[:, 1:-1, 2:], beside[:, 1:-1, :-2]):
        maxima = maxima & (middle >= other)
    return maxima
