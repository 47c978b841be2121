"""Levelling of measured heights, and filling of missing points."""

from __future__ import annotations

import numpy as np

SWEEPS = 300
"""Largest number of sweeps that smooth filled points."""


def levelled(heights: np.ndarray, level: str) -> np.ndarray:
    """Return heights without their mean, plane or polynomial of second order (least squares); `level` names which."""
    order = {"mean": 0, "plane": 1, "curved": 2}[level]
    n_y, n_x = heights.shape
    y, x = np.linspace(-1.0, 1.0, n_y)[:, None], np.linspace(-1.0, 1.0, n_x)[None, :]
    powers = [(a, b) for a in range(order + 1) for b in range(order + 1 - a)]
    terms = [np.broadcast_to(x**a * y**b, heights.shape).ravel() for a, b in powers]
    normal = np.array([[first @ second for second in terms] for first in terms])
    factors = np.linalg.solve(normal, [term @ heights.ravel() for term in terms])
    result = heights.copy()
    for factor, (a, b) in zip(factors, powers, strict=True):
        result -= factor * (x**a * y**b)
    return result


def fill_missing(heights: np.ndarray) -> np.ndarray:
    """Return heights with missing points (NaN) filled smoothly: the nearest height, then means of the four neighbours."""
    from scipy.ndimage import distance_transform_edt

    holes = np.isnan(heights)
    if not holes.any():
        return heights
    nearest = distance_transform_edt(holes, return_distances=False, return_indices=True)
    padded = np.pad(heights[tuple(nearest)], 1, mode="edge")
    y, x = np.nonzero(holes)
    y, x = y + 1, x + 1
    for _ in range(SWEEPS):
        padded[y, x] = 0.25 * (padded[y - 1, x] + padded[y + 1, x] + padded[y, x - 1] + padded[y, x + 1])
        padded[0], padded[-1], padded[:, 0], padded[:, -1] = padded[1], padded[-2], padded[:, 1], padded[:, -2]
    return padded[1:-1, 1:-1]
