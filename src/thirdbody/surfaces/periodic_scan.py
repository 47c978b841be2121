"""From a measured height map to a periodic surface: crop, fill, level, filter, sample, join."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from thirdbody.errors import Fault, InputError
from thirdbody.quantity import percent
from thirdbody.surfaces import grid
from thirdbody.surfaces.height_map import HeightMap
from thirdbody.surfaces.levelling import fill_missing, levelled
from thirdbody.surfaces.surface import Surface, about_mean_plane
from thirdbody.units import pretty

BLEND = 0.1
"""Length of the blend over that of a copy."""

FULLY_PASSED = 1.5
"""Wavelength from which on all is kept, over the short one, below which nothing is: in between the filter is a cosine."""


class ScanOptions(NamedTuple):
    """How a map becomes a surface; the keys of the scene have these names. Crop: first and last position along x, along y."""

    level: str = "plane"
    crop: tuple[tuple[float, float] | None, tuple[float, float] | None] = (None, None)
    short: float | None = None
    join: str = "blend"
    missing: float = 0.05


class _Axis(NamedTuple):
    """Copies of the map along an axis of the domain, grid points of one, and how many samples are taken for each."""

    copies: int
    points: int
    samples: int

    def period(self, length: float) -> float:
        """Return the length of a copy [m]."""
        return length / self.copies

    @property
    def all_samples(self) -> int:
        """Number of samples in a copy."""
        return self.points * self.samples


def periodic_scan(scan: HeightMap, size: tuple[float, float], options: ScanOptions) -> Surface:
    """Return the surface of a domain made of copies of a map, which is never stretched: what is too long is left out.

    Raises InputError for a crop outside the map, too many missing points, a short wavelength that the points cannot show.
    """
    part = cropped(scan, options.crop)
    if part.missing > options.missing:
        allowed = f"at most {percent(options.missing)} are filled (key missing)"
        raise InputError(Fault("missing", f"{percent(part.missing)} of the points have no height; {allowed}", scan.name))
    heights, short = levelled(fill_missing(part.heights), options.level), _shortest(part, size, options.short)
    axes = [_axis(length, step, short, n, options.join == "mirror")
            for length, step, n in zip(size, part.spacing, heights.shape[::-1], strict=True)]  # fmt: skip
    counts = [(axis.all_samples, axis.points * axis.copies) for axis in axes]
    if max(math.prod(pair) for pair in zip(*counts, strict=True)) > grid.MAX_POINTS:
        text = f"{pretty(short, 'length')} needs a grid of more than {grid.MAX_POINTS:.2g} points: give a longer one"
        raise InputError(Fault("short", text, scan.name))
    for number, axis in enumerate(axes):
        step = axis.period(size[number]) / axis.all_samples
        sampled = _sampled(heights, step / part.spacing[number], axis, 1 - number, options.join)
        heights = _joined(sampled, axis, 1 - number, options.join)
    steps = [axis.period(length) / axis.all_samples for length, axis in zip(size, axes, strict=True)]
    heights = _filtered(heights, steps, short)[:: axes[1].samples, :: axes[0].samples]
    whole = about_mean_plane(np.tile(heights, (axes[1].copies, axes[0].copies)))
    notes = _notes(part, axes, size, options)
    return Surface(whole, size, short, notes=tuple(notes), copies=(axes[0].copies, axes[1].copies))


def cropped(scan: HeightMap, crop: tuple[tuple[float, float] | None, tuple[float, float] | None]) -> HeightMap:
    """Return a part of a map. Raises InputError for one outside it, or with fewer than four points along an axis."""
    faults, slices = [], []
    for axis, ends, step, length in zip("xy", crop, scan.spacing, scan.size, strict=True):
        low, high = ends or (0.0, length)
        first, last = math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6)
        if high > length * (1.0 + 1e-6):
            faults.append(
                Fault(f"crop.{axis}", f"ends at {pretty(high, 'length')}, the map at {pretty(length, 'length')}", scan.name)
            )
        elif last - first < 3:
            faults.append(Fault(f"crop.{axis}", f"leaves {max(0, last - first + 1)} points, at least 4 are needed", scan.name))
        slices.append(slice(first, last + 1))
    if faults:
        raise InputError(faults)
    return HeightMap(scan.heights[slices[1], slices[0]], scan.spacing, scan.name)


def _shortest(part: HeightMap, size: tuple[float, float], wanted: float | None) -> float:
    finest = 2.0 * max(part.spacing)
    short = 2.0 * finest if wanted is None else wanted
    if short < finest * (1.0 - 1e-9):
        text = f"{pretty(short, 'length')} is shorter than two points of the file, {pretty(finest, 'length')}"
        raise InputError(Fault("short", text, part.name))
    if short > 0.5 * min(*part.size, *size):
        text = f"{pretty(short, 'length')} is longer than half the map or half the domain"
        raise InputError(Fault("short", text, part.name))
    return short


def _axis(length: float, step: float, short: float, n: int, mirror: bool) -> _Axis:
    """Return how many copies of at most the length of a map fit an axis of the domain, and their points."""
    extent = (n - 1) * step * (1.0 + 1e-9)
    copies = math.ceil(length / (2.0 * extent) if mirror else length * (1.0 + BLEND) / extent)
    points = grid.grid_points(length / copies, short / grid.POINTS_PER_WAVE)
    return _Axis(copies, points, math.ceil(length / copies / points / step * (1.0 - 1e-9)))


def _sampled(heights: np.ndarray, step: float, axis: _Axis, number: int, join: str) -> np.ndarray:
    """Return heights along one array axis at equal steps, by a cubic spline; `step` in points of the map."""
    from scipy.interpolate import CubicSpline

    count = axis.all_samples // 2 + 1 if join == "mirror" else axis.all_samples + int(BLEND * axis.all_samples)
    at = np.minimum(np.arange(count) * step, heights.shape[number] - 1.0)
    return np.asarray(CubicSpline(np.arange(heights.shape[number]), heights, axis=number)(at))


def _filtered(heights: np.ndarray, spacing: list[float], short: float) -> np.ndarray:
    """Return periodic heights without waves shorter than `short`; those longer than `FULLY_PASSED` times that stay."""
    n_y, n_x = heights.shape
    q = np.hypot(np.fft.fftfreq(n_y, spacing[1])[:, None], np.fft.rfftfreq(n_x, spacing[0])[None, :]) * short
    fade = np.clip((1.0 - q) / (1.0 - 1.0 / FULLY_PASSED), 0.0, 1.0)
    return np.asarray(np.fft.irfft2(np.fft.rfft2(heights) * (0.5 - 0.5 * np.cos(np.pi * fade)), s=heights.shape))


def _joined(heights: np.ndarray, axis: _Axis, number: int, join: str) -> np.ndarray:
    """Return one period along an array axis.

    In the blend the end fades out while the start fades in; both are divided by the root of the sum of squares of the weights,
    so that the variance of unrelated heights stays.
    """
    z = np.moveaxis(heights, number, 0)
    if join == "mirror":
        whole = np.concatenate([z, z[-2:0:-1]])
    else:
        end = z[axis.all_samples :]
        s = (np.arange(len(end)) + 0.5) / len(end)
        fade = (s**3 * (10.0 - 15.0 * s + 6.0 * s**2))[:, None]
        whole = z[: axis.all_samples].copy()
        whole[: len(end)] = (fade * whole[: len(end)] + (1.0 - fade) * end) / np.sqrt(fade**2 + (1.0 - fade) ** 2)
    return np.moveaxis(whole, 0, number)


def _notes(part: HeightMap, axes: list[_Axis], size: tuple[float, float], options: ScanOptions) -> list[str]:
    """Return what was done, in words."""
    notes = []
    if part.missing:
        notes.append(f"{percent(part.missing)} of the points had no height and were filled from their surroundings")
    periods = [length / axis.copies for length, axis in zip(size, axes, strict=True)]
    of = " by ".join(pretty(length, "length") for length in part.size)
    copies = f"{axes[0].copies} x {axes[1].copies} copies of {' by '.join(pretty(length, 'length') for length in periods)}"
    joined = (
        "every second one turned round: the surface is even about its seams, with no slope across them"
        if options.join == "mirror"
        else f"each faded into the next over {percent(BLEND)} of its length, where heights of both are mixed"
    )
    notes.append(f"{copies}, from {of}; {joined}")
    return notes
