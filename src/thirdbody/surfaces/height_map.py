"""A measured height map: heights on a regular grid, some of them missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thirdbody.errors import Fault, InputError
from thirdbody.units import pretty

TEXTS = (".csv", ".txt")
"""Suffixes of files of text, which name neither a unit nor the spacing of their points."""

FINEST, WIDEST = 1e-12, 1.0
"""Smallest spacing and largest side [m] of a map that is no fault of its unit."""

STEEPEST = 10.0
"""Largest range of the heights, over the larger side of the map, that is no fault of a unit."""


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Heights (n_y, n_x) [m], NaN where there is none; spacing of the points along x and y [m]; name of the file; what a reader
    has to tell.
    """

    heights: np.ndarray
    spacing: tuple[float, float]
    name: str
    notes: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[float, float]:
        """Number of points times their spacing along x and y [m]: of a map that is periodic its period."""
        n_y, n_x = self.heights.shape
        return n_x * self.spacing[0], n_y * self.spacing[1]

    @property
    def missing(self) -> float:
        """Fraction of points without a height."""
        return float(np.mean(np.isnan(self.heights)))


def checked_map(heights: np.ndarray, spacing: tuple[float, float], name: str) -> HeightMap:
    """Return the map. Raises InputError for one that no surface can be: wrong units, no heights, infinite ones."""
    faults = [Fault("spacing", f"{step:g} m along {axis} must be a positive length", name)
              for axis, step in zip("xy", spacing, strict=True) if not (np.isfinite(step) and step > 0.0)]  # fmt: skip
    if min(heights.shape) < 4:
        faults.append(Fault("heights", f"has {heights.shape[1]} x {heights.shape[0]} points, at least 4 x 4 are needed", name))
    elif np.isnan(heights).all():
        faults.append(Fault("heights", "holds no height at all: every point is missing", name))
    elif infinite := int(np.isinf(heights).sum()):
        faults.append(Fault("heights", f"{infinite} of its points are infinite; write NaN where a height is missing", name))
    if faults:
        raise InputError(faults)
    result = HeightMap(heights, spacing, name)
    side, height = max(result.size), float(np.nanmax(heights) - np.nanmin(heights))
    if min(spacing) < FINEST or side > WIDEST:
        steps = " and ".join(pretty(step, "length") for step in spacing)
        raise InputError(Fault("spacing", f"points {steps} apart, {pretty(side, 'length')} in all; is the unit right?", name))
    if height > STEEPEST * side:
        where = f"{pretty(height, 'length')} from lowest to highest on {pretty(side, 'length')}"
        raise InputError(Fault("heights", f"{where}; is the unit right?", name))
    return result
