"""Worn surfaces: a depth on the cells of a map, taken from the heights of a surface without loss of volume."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from thirdbody.surfaces import grid
from thirdbody.surfaces.surface import Surface

Array = np.ndarray

CELLS_PER_WAVE = 4.0
"""Cells of a map per shortest wave of the worn depth: so many points of a measured surface make one, too."""


def flat_surface(size: tuple[float, float], cells: tuple[int, int], curvature: bool) -> Surface:
    """Return a surface of zero height that wear on a map of so many cells along x and y can change. `size`: period [m]."""
    short = CELLS_PER_WAVE * max(length / n for length, n in zip(size, cells, strict=True))
    shape = grid.grid_counts(size, (short / grid.POINTS_PER_WAVE,) * 2)
    note = "flat, so its surface has zero height until it wears" + "; its curvature leaves contacts as they are" * (not curvature)
    return Surface(np.zeros(shape), size, short, curvature, (note,))


def worn_surface(surface: Surface, depth: Array) -> Surface:
    """Return the surface less a depth (n_y, n_x) [m] on the cells of a periodic map, means over their areas.

    The depth is the trigonometric polynomial through the middles of the cells, smoothed by the Gaussian filter of ISO 16610-21.
    Its cut-off is the shortest wavelength of the surface, or `CELLS_PER_WAVE` cells if that is more: sharper edges would have
    curvatures that Hertz' theory excludes. The mean depth, thus the volume, is kept to rounding. Neglected: waves shorter than
    two points of the surface, of which the filter leaves at most 6 %, and what it smears over the length of a cut-off.
    """
    shape, (n_y, n_x) = surface.heights.shape, depth.shape
    cell = max(length / n for length, n in zip(surface.size, (n_x, n_y), strict=True))
    cutoff = max(surface.shortest, CELLS_PER_WAVE * cell)
    # whole numbers of waves along y and x that both grids hold
    waves = [np.fft.fftfreq(n, 1.0 / n) for n in (n_y, n_x)]
    within = [np.abs(k) < 0.5 * min(n, m) for k, n, m in zip(waves, (n_y, n_x), shape, strict=True)]
    k_y, k_x = (k[mask] for k, mask in zip(waves, within, strict=True))
    square = (k_y[:, None] / surface.size[1]) ** 2 + (k_x[None, :] / surface.size[0]) ** 2
    # the first cell has its middle, the first point its place at half a cell from the other
    middle = np.exp(-1j * np.pi * (k_y[:, None] / n_y + k_x[None, :] / n_x))
    transform = np.zeros(shape, complex)
    transform[np.ix_(k_y.astype(int) % shape[0], k_x.astype(int) % shape[1])] = (
        np.fft.fft2(depth, norm="forward")[np.ix_(*within)] * middle * np.exp(-math.log(2.0) * cutoff**2 * square)
    )
    loss = np.fft.ifft2(transform, norm="forward").real
    return replace(surface, heights=np.ascontiguousarray(surface.heights - loss), copies=(1, 1))


def worn_surfaces(surfaces: Mapping[str, Surface], depths: Array) -> dict[str, Surface]:
    """Return the surfaces of the plates, by `lower` and `upper`, less depths (2, n_y, n_x) [m] of the lower and the upper one."""
    return {side: worn_surface(surface, depths[0 if side == "lower" else 1]) for side, surface in surfaces.items()}
