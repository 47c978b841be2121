"""Measured surfaces: a height map, and the periodic surface made of it: crop, fill, level, filter, sample, join."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from thirdbody.errors import Fault, InputError
from thirdbody.surfaces import grid
from thirdbody.surfaces.surface import Surface, about_mean_plane
from thirdbody.units import percent, pretty

TEXTS = (".csv", ".txt")
"""Suffixes of files of text, which name neither a unit nor the spacing of their points."""
# Smallest spacing and largest side [m] of a map, and the largest range of its heights over the larger side, that are no fault of
# a unit.
_FINEST, _WIDEST, _STEEPEST = 1e-12, 1.0, 10.0
# Largest number of sweeps that smooth filled points.
_SWEEPS = 300
# Least and largest length over which a copy and the next both have heights, over that of a copy: the cut lies there.
_OVERLAP = (0.1, 0.5)
# Correlation of heights a copy apart from which on copies go on in each other, as those of grooves can.
_ALIKE = 0.7
# Range about the length of a copy, relative, in which a better one is looked for.
_OTHER_LENGTHS = 0.2
# Wavelength from which on all is kept, over the short one, below which nothing is: in between the filter is a cosine.
_FULLY_PASSED = 1.5


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
    if min(spacing) < _FINEST or side > _WIDEST:
        steps = " and ".join(pretty(step, "length") for step in spacing)
        raise InputError(Fault("spacing", f"points {steps} apart, {pretty(side, 'length')} in all; is the unit right?", name))
    if height > _STEEPEST * side:
        where = f"{pretty(height, 'length')} from lowest to highest on {pretty(side, 'length')}"
        raise InputError(Fault("heights", f"{where}; is the unit right?", name))
    return result


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
    for _ in range(_SWEEPS):
        padded[y, x] = 0.25 * (padded[y - 1, x] + padded[y + 1, x] + padded[y, x - 1] + padded[y, x + 1])
        padded[0], padded[-1], padded[:, 0], padded[:, -1] = padded[1], padded[-2], padded[:, 1], padded[:, -2]
    return padded[1:-1, 1:-1]


class ScanOptions(NamedTuple):
    """How a map becomes a surface; the keys of the scene have these names. Crop: first and last position along x, along y."""

    level: str = "plane"
    crop: tuple[tuple[float, float] | None, tuple[float, float] | None] = (None, None)
    short: float | None = None
    join: str = "blend"
    missing: float = 0.05


class _Axis(NamedTuple):
    """Copies of the map along an axis of the domain, grid points of one, and how many samples are taken for each.

    `alike`: correlation of heights a copy apart; NaN where copies are not cut. `better`: a length of the domain [m] with one
    above `_ALIKE`, 0 where none is needed or near.
    """

    copies: int
    points: int
    samples: int
    alike: float
    better: float

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
    if options.join == "periodic":
        return _of_periods(part, size, options.short)
    heights, short = levelled(fill_missing(part.heights), options.level), _shortest(part, size, options.short)
    axes = [_axis(length, step, short, z, options.join == "mirror")
            for length, step, z in zip(size, part.spacing, (heights.T, heights), strict=True)]  # fmt: skip
    counts = [(axis.all_samples, axis.points * axis.copies) for axis in axes]
    if max(math.prod(pair) for pair in zip(*counts, strict=True)) > grid.MAX_POINTS:
        text = f"{pretty(short, 'length')} needs a grid of more than {grid.MAX_POINTS:.2g} points: give a longer one"
        raise InputError(Fault("short", text, scan.name))
    for number, axis in enumerate(axes):
        step = axis.period(size[number]) / axis.all_samples
        sampled = _sampled(heights, step / part.spacing[number], axis, 1 - number, options.join)
        heights = _joined(sampled, axis, 1 - number, options.join, short / step)
    steps = [axis.period(length) / axis.all_samples for length, axis in zip(size, axes, strict=True)]
    heights = _filtered(heights, steps, short)[:: axes[1].samples, :: axes[0].samples]
    whole = about_mean_plane(np.tile(heights, (axes[1].copies, axes[0].copies)))
    notes = _notes(part, axes, size)
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
    return replace(scan, heights=scan.heights[slices[1], slices[0]])


def _of_periods(part: HeightMap, size: tuple[float, float], short: float | None) -> Surface:
    """Return the surface of a domain made of whole periods: the points as they are, or without waves below `short` if given."""
    copies = [max(1, round(length / period)) for length, period in zip(size, part.size, strict=True)]
    if any(abs(length - n * period) > grid.FIT * length for length, n, period in zip(size, copies, part.size, strict=True)):
        (of, domain), fit = (_by(lengths) for lengths in (part.size, size)), _by(np.multiply(copies, part.size))
        text = f"'periodic': the map repeats after {of}, which does not fit the domain of {domain} a whole number of times"
        raise InputError(Fault("join", f"{text}; {fit} would", part.name))
    heights = part.heights
    if part.missing:
        around = [(n // 2, n // 2) for n in heights.shape]
        heights = fill_missing(np.pad(heights, around, mode="wrap"))[tuple(slice(n, -n) for n, _ in around)]
    if short is not None:
        from scipy.signal import resample

        heights = _filtered(heights, list(part.spacing), _shortest(part, size, short))
        for number, length in enumerate(part.size):
            heights = resample(heights, grid.grid_points(length, short / grid.POINTS_PER_WAVE), axis=1 - number)
    if heights.size * math.prod(copies) > grid.MAX_POINTS:
        raise InputError(Fault("file", f"its periods have more than {grid.MAX_POINTS:.2g} points in all", part.name))
    notes = [*_notes(part), f"{copies[0]} x {copies[1]} periods of {_by(part.size)}"]
    whole = about_mean_plane(np.tile(heights, copies[::-1]))
    return Surface(whole, size, short or 4.0 * max(part.spacing), notes=tuple(notes), copies=(copies[0], copies[1]))


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


def _axis(length: float, step: float, short: float, z: np.ndarray, mirror: bool) -> _Axis:
    """Return how many copies of at most the length of a map fit an axis of the domain, and their points.

    z (n, m): its heights along that axis. Copies are as few as possible, or up to twice as many where those go on in each other.
    """
    extent = (len(z) - 1) * step * (1.0 + 1e-9)
    copies = math.ceil(length / (2.0 * extent) if mirror else length * (1.0 + _OVERLAP[0]) / extent)
    alike, better = math.nan, 0.0
    if not mirror:
        correlation = _correlation(z)
        steps = {number: round(length / number / step) for number in range(copies, 2 * copies + 1)}
        copies = next((number for number, n in steps.items() if correlation[n] >= _ALIKE), copies)
        alike, n = float(correlation[steps[copies]]), steps[copies]
        longest = min(int((1.0 + _OTHER_LENGTHS) * n), int((len(z) - 1) / (1.0 + _OVERLAP[0])))
        near = np.arange(int((1.0 - _OTHER_LENGTHS) * n), longest + 1)
        best = near[correlation[near] > correlation[near].max() - 0.02]
        if alike < _ALIKE <= correlation[best].min():
            better = copies * step * float(best[np.argmin(np.abs(best - n))])
    points = grid.grid_points(length / copies, short / grid.POINTS_PER_WAVE)
    return _Axis(copies, points, math.ceil(length / copies / points / step * (1.0 - 1e-9)), alike, better)


def _correlation(z: np.ndarray) -> np.ndarray:
    """Return the correlation (n,) of heights (n, m) of mean 0 with those 0 to n - 1 rows further, from some 256 columns."""
    some = z[:, :: max(1, z.shape[1] // 256)]
    power = np.sum(np.abs(np.fft.rfft(some, 2 * len(z), axis=0)) ** 2, axis=1)
    product = np.fft.irfft(power)[: len(z)]
    energy = np.cumsum(np.sum(some**2, axis=1))
    first, last = energy[::-1], energy[-1] - np.concatenate([[0.0], energy[:-1]])
    return product / np.sqrt(np.maximum(first * last, 1e-300))


def _sampled(heights: np.ndarray, step: float, axis: _Axis, number: int, join: str) -> np.ndarray:
    """Return heights along one array axis at equal steps, by a cubic spline; `step` in points of the map."""
    from scipy.interpolate import CubicSpline

    last = heights.shape[number] - 1.0
    wanted = axis.all_samples // 2 + 1 if join == "mirror" else int((1.0 + _OVERLAP[1]) * axis.all_samples)
    at = np.minimum(np.arange(min(wanted, int(last / step * (1.0 + 1e-9)) + 1)) * step, last)
    return np.asarray(CubicSpline(np.arange(heights.shape[number]), heights, axis=number)(at))


def _filtered(heights: np.ndarray, spacing: list[float], short: float) -> np.ndarray:
    """Return periodic heights without waves shorter than `short`; those longer than `_FULLY_PASSED` times that stay."""
    n_y, n_x = heights.shape
    q = np.hypot(np.fft.fftfreq(n_y, spacing[1])[:, None], np.fft.rfftfreq(n_x, spacing[0])[None, :]) * short
    fade = np.clip((1.0 - q) / (1.0 - 1.0 / _FULLY_PASSED), 0.0, 1.0)
    return np.asarray(np.fft.irfft2(np.fft.rfft2(heights) * (0.5 - 0.5 * np.cos(np.pi * fade)), s=heights.shape))


def _joined(heights: np.ndarray, axis: _Axis, number: int, join: str, fade: float) -> np.ndarray:
    """Return one period along an array axis; `fade`: half the least width of the blend about a cut, in samples.

    Where a copy and the next overlap, heights are those of one before a cut and of the other behind it, so that crests and
    wavelengths of both stay. About the cut, which runs where they differ least, one fades into the other, with weights of sum 1,
    over a width that makes no slopes above the rms one out of what is left of their difference.
    """
    z = np.moveaxis(heights, number, 0)
    if join == "mirror":
        return np.moveaxis(np.concatenate([z, z[-2:0:-1]]), 0, number)
    whole, end = z[: axis.all_samples].copy(), z[axis.all_samples :]
    start = whole[: len(end)].copy()
    cut = _cut(start - end, len(end) // 4)
    gap = float(np.abs(start - end)[cut, np.arange(len(cut))].max())
    slope = max(float(np.diff(z, axis=0).std()), 1e-300)
    width = min(max(fade, gap / slope), 0.25 * len(end))
    weight = 0.5 + 0.5 * np.sin(0.5 * np.pi * np.clip((np.arange(len(end))[:, None] - cut) / width, -1.0, 1.0))
    whole[: len(end)] = end + weight * (start - end)
    return np.moveaxis(whole, 0, number)


def _cut(difference: np.ndarray, margin: int) -> np.ndarray:
    """Return where two pieces (n, m) that overlap differ least: a row per column, by at most one from column to column.

    It ends where it begins, so that it closes on a period; dynamic programming (Efros and Freeman 2001, Proc. SIGGRAPH, 341).
    """
    from scipy.ndimage import minimum_filter1d

    cost = difference.T[:, margin : len(difference) - margin] ** 2
    first = int(np.argmin(cost[0]))
    cost[0, np.arange(cost.shape[1]) != first] = np.inf
    for before, each in itertools.pairwise(cost):
        each += minimum_filter1d(before, 3, mode="nearest")
    rows = [first]
    for each in cost[-2::-1]:
        low = max(rows[-1] - 1, 0)
        rows.append(low + int(np.argmin(each[low : rows[-1] + 2])))
    return margin + np.array(rows[::-1])


def _by(lengths: Iterable[float]) -> str:
    return " by ".join(pretty(float(length), "length") for length in lengths)


def _notes(part: HeightMap, axes: Sequence[_Axis] = (), size: tuple[float, float] = (0.0, 0.0)) -> list[str]:
    notes = list(part.notes)
    if part.missing:
        notes.append(f"{percent(part.missing)} of the points had no height and were filled from their surroundings")
    if not axes:
        return notes
    periods = [axis.period(length) for length, axis in zip(size, axes, strict=True)]
    joined = (
        "every second one turned round: the surface is even about its seams, with no slope across them"
        if math.isnan(axes[0].alike)
        else "cut where each differs least from the next, and blended about the cut"
    )
    notes.append(f"{axes[0].copies} x {axes[1].copies} copies of {_by(periods)}, from {_by(part.size)}; {joined}")
    for name, axis, length in zip("xy", axes, size, strict=True):
        if axis.better:
            lengths = f"{pretty(axis.better, 'length')} instead of {pretty(length, 'length')}"
            why = f"copies do not go on in each other (correlation {axis.alike:.2f})"
            notes.append(f"along {name} {why}: a domain of {lengths} would let them")
    return notes
