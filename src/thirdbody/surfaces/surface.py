"""A surface of a first body: heights on a periodic grid, and the spline through them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from thirdbody.surfaces.statistics import Statistics


@dataclass(frozen=True, eq=False)
class Surface:
    """Heights above the mean plane at the points of a periodic grid, and what made them.

    Attributes
    ----------
    heights : ndarray (n_y, n_x)
        Heights [m], mean 0; the first point is at the origin of the domain, x changes fastest.
    size : tuple of float
        Period along x and y [m].
    shortest : float
        Shortest wavelength that it is meant to have [m].
    curvature : bool
        Whether its curvature changes the radius of contacts.
    notes : tuple of str
        What was done to a measured surface.
    copies : tuple of int
        Equal parts along x and y of which it consists.
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
        from thirdbody.surfaces.statistics import surface_statistics

        return surface_statistics(self.one_copy, self.spacing)

    @cached_property
    def packed(self) -> np.ndarray:
        """The spline as kernels take it (`kernels.height_field`): one row of numbers."""
        from thirdbody.kernels.height_field import pack_field

        return pack_field(self.coefficients.T, *self.size)


def about_mean_plane(heights: np.ndarray) -> np.ndarray:
    """Return heights with mean 0."""
    return np.ascontiguousarray(heights - heights.mean())
