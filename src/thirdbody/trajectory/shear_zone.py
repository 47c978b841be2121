"""The band of a bed that carries the shear, from the velocities of its bodies over the height."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

EDGE = 0.1
"""Fractions EDGE and 1 - EDGE of the velocity difference of the bed are reached at the edges of the shear zone."""


class ShearZone(NamedTuple):
    """Shear rate [1/s], and the heights of the zone's edges above the lower plate [m]."""

    rate: float
    bottom: float
    top: float


def shear_zone(heights: Array, velocities: Array, masses: Array, diameter: float) -> ShearZone | None:
    """Return the shear zone of bodies at heights (n,) [m] with velocities (n, 3) [m/s]; None where all lie in one layer.

    The bed shears by the difference between the mean velocities of its lowest and its highest layer, one `diameter` [m] thick.
    The edges of the zone are where a profile that does not fall reaches the fractions EDGE and 1 - EDGE of it; the rate is the
    difference between the edges over their distance. A zone is at least a diameter thick: grains are not sheared themselves.
    """
    low, high = heights <= heights.min() + diameter, heights >= heights.max() - diameter
    if np.any(low & high):
        return None
    base = np.average(velocities[low, :2], axis=0, weights=masses[low])
    difference = np.average(velocities[high, :2], axis=0, weights=masses[high]) - base
    size = float(np.linalg.norm(difference))
    if size == 0.0:
        return ShearZone(0.0, float(heights.min()), float(heights.max()))
    order = np.argsort(heights, kind="stable")
    along = (velocities[order, :2] - base) @ (difference / size)
    profile = rising_profile(along, masses[order])
    bottom, top = (_height_of(fraction * size, profile, heights[order]) for fraction in (EDGE, 1.0 - EDGE))
    within = 1.0 - 2.0 * EDGE
    return ShearZone(within * size / max(top - bottom, within * diameter), bottom, top)


def rising_profile(values: Array, weights: Array) -> Array:
    """Return the sequence (n,) that never falls and is nearest to `values` (n,) by weighted least squares."""
    from scipy.optimize import isotonic_regression

    return np.asarray(isotonic_regression(values, weights=weights).x, float)


def _height_of(value: float, profile: Array, heights: Array) -> float:
    """Return the height [m] at which a profile that does not fall reaches a value, linear between bodies."""
    k = int(np.searchsorted(profile, value))
    if k in (0, len(profile)):
        return float(heights[min(k, len(profile) - 1)])
    below, above = profile[k - 1], profile[k]
    return float(heights[k - 1] + (value - below) / (above - below) * (heights[k] - heights[k - 1]))
