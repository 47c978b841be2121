"""Statistics of heights on a grid: rms height, slope and curvature, skewness, extremes, power spectrum with its power law."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

# Bins of the spectrum per factor of 2 in wavenumber.
_PER_OCTAVE = 4
# Slope of the logarithms below which the spectrum has ended: a self-affine one falls no faster than q^-4.
_STEEPEST = -5.5
# Smallest number of bins of a power law.
_FEWEST = 5
# Largest rms deviation of ln C from the law; a sum of a few waves has a larger one.
_SCATTER = 0.5
# Ratio of the longest to the shortest wavelength of a power law from which on its exponent is reported as it is: of random
# surfaces with an exponent of 0.8 it is found as 0.81 over a ratio of 4, 0.82 over one of 3.4, and 0.46 over one of 2.
_WIDE_BAND = 3.0


@dataclass(frozen=True, eq=False)
class RadialSpectrum:
    """Wavenumbers q = 2 pi / wavelength [rad/m], and the power C(q) [m4] there, the mean over all directions.

    C = |H|^2 / A with the Fourier transform H of the heights over the area A, so that the mean square of the height is the
    integral of C q / (2 pi) (Jacobs, Junge and Pastewka 2017, Surf. Topogr. 5:013001).
    """

    wavenumber: np.ndarray
    power: np.ndarray
    waves: np.ndarray
    """Number of waves in each mean."""


@dataclass(frozen=True)
class PowerLaw:
    """C ~ q^(-2 - 2 H) between two wavelengths [m]; `rolls_off`: flat above `long`, else the heights do not reach so far."""

    hurst: float
    long: float
    short: float
    rolls_off: bool

    @property
    def is_certain(self) -> bool:
        """Whether the band is wide enough for the exponent to mean something."""
        return self.long >= _WIDE_BAND * self.short


def radial_spectrum(heights: np.ndarray, spacing: tuple[float, float], periodic: bool) -> RadialSpectrum:
    """Return the spectrum of heights (n_y, n_x) [m]; without a period they are weighted by a Hann window."""
    n_y, n_x = heights.shape
    window = np.ones_like(heights) if periodic else np.hanning(n_y)[:, None] * np.hanning(n_x)[None, :]
    transform = np.fft.rfft2((heights - np.average(heights, weights=window)) * window)
    power = np.abs(transform) ** 2 * (spacing[0] * spacing[1]) / np.sum(window**2)
    q_x, q_y = (2.0 * np.pi * np.fft.fftfreq(n, step) for n, step in ((n_x, spacing[0]), (n_y, spacing[1])))
    q = np.hypot(np.abs(q_x[: power.shape[1]]), q_y[:, None])
    # the column of q_x = 0, and the last one of an even number, are their own conjugates
    weight = np.full(power.shape[1], 2.0)
    weight[0] = 1.0
    if n_x % 2 == 0:
        weight[-1] = 1.0
    q, power, weight = q.ravel(), power.ravel(), np.broadcast_to(weight, power.shape).ravel()
    # means over rings of equal width in ln q, up to the wavenumber of two points per wave along each axis
    inside = (q > 0.0) & (q <= np.pi / max(spacing) * (1.0 + 1e-9))
    q, power, weight = q[inside], power[inside], weight[inside]
    if not len(q):
        return RadialSpectrum(np.zeros(0), np.zeros(0), np.zeros(0))
    ring = np.floor(_PER_OCTAVE * np.log2(q / q.min()) + 1e-9).astype(int)
    total = np.bincount(ring, weight)
    filled = total > 0
    mean_q, mean_power = (np.bincount(ring, weight * values)[filled] / total[filled] for values in (q, power))
    return RadialSpectrum(mean_q, mean_power, total[filled])


def power_law(spectrum: RadialSpectrum) -> PowerLaw | None:
    """Return the power law that fits best, flat below its long wavelength; None where the spectrum follows none."""
    present = spectrum.power > 1e-12 * spectrum.power.max(initial=0.0)
    count = len(present) if present.all() else int(np.argmin(present))
    if count < _FEWEST:
        return None
    x, z = np.log(spectrum.wavenumber[:count]), np.log(spectrum.power[:count])
    # the bins up to the one from which on the spectrum falls for good
    falls = (np.all(z[k + 1 :] < z[k] + _STEEPEST * (x[k + 1 :] - x[k])) for k in range(count // 2, count - 1))
    end = next((k + 1 for k, steep in enumerate(falls, count // 2) if steep), count)
    weight = np.sqrt(spectrum.waves[:end])  # a mean of n powers scatters by 1/sqrt(n)
    best, law = np.inf, None
    for start in range(end - _FEWEST + 1):
        knee = np.maximum(x[:end] - x[start], 0.0)
        slope, level = np.polyfit(knee, z[:end], 1, w=weight)
        deviation = float(np.sqrt(np.average((z[:end] - level - slope * knee) ** 2, weights=weight**2)))
        if deviation < best - 1e-9:
            long, short = (float(2.0 * np.pi / np.exp(x[k])) for k in (start, end - 1))
            best, law = deviation, PowerLaw(float(-0.5 * slope - 1.0), long, short, start > 0)
    return law if law is not None and best < _SCATTER and law.hurst > -0.5 else None


@dataclass(frozen=True)
class Statistics:
    """Statistics of a surface, in SI.

    Heights [m]: `rms_height`, `highest`, `lowest` (over the mean); `skewness` and `kurtosis` (3 for a Gaussian surface);
    `rms_slope` and `max_slope` of the gradient; `rms_curvature` of the mean curvature, and the largest principal curvatures of
    crests and of valleys, both positive [1/m]. `spectrum`: None where it was not computed; `law`: its power law, None where it
    follows none.
    """

    rms_height: float
    highest: float
    lowest: float
    skewness: float
    kurtosis: float
    rms_slope: float
    max_slope: float
    rms_curvature: float
    crest_curvature: float
    valley_curvature: float
    spectrum: RadialSpectrum | None = None
    law: PowerLaw | None = None

    def document(self) -> dict[str, Any]:
        """Return the statistics as plain numbers and lists."""
        plain = {name: value for name, value in vars(self).items() if isinstance(value, float)}
        spectrum = self.spectrum
        columns = {} if spectrum is None else {"wavenumber": spectrum.wavenumber.tolist(), "power": spectrum.power.tolist()}
        return plain | {"spectrum": columns, "power_law": asdict(self.law) if self.law else None}


def with_spectrum(statistics: Statistics, heights: np.ndarray, spacing: tuple[float, float], periodic: bool = True) -> Statistics:
    """Return statistics with the spectrum of the heights, and its power law."""
    spectrum = radial_spectrum(heights, spacing, periodic)
    return replace(statistics, spectrum=spectrum, law=power_law(spectrum))


def surface_statistics(heights: np.ndarray, spacing: tuple[float, float], periodic: bool = True) -> Statistics:
    """Return the statistics of the spline through heights (n_y, n_x) [m], without their spectrum.

    Without a period a margin of 2 points is left out of slopes and curvatures.
    """
    z = heights - heights.mean()
    x, y, xx, xy, yy = _derivatives(z, spacing, periodic)
    square = x**2 + y**2
    # the mean curvature, positive at crests, and half the difference of the principal ones
    area = 1.0 + x**2 + y**2
    mean = -((1.0 + y**2) * xx - 2.0 * x * y * xy + (1.0 + x**2) * yy) / (2.0 * area**1.5)
    difference = np.sqrt(np.maximum(mean**2 - (xx * yy - xy**2) / area**2, 0.0))
    rms = float(np.sqrt(np.mean(z**2)))
    return Statistics(
        rms_height=rms,
        highest=float(z.max()),
        lowest=float(z.min()),
        skewness=float(np.mean(z**3)) / rms**3 if rms else 0.0,
        kurtosis=float(np.mean(z**4)) / rms**4 if rms else 0.0,
        rms_slope=float(np.sqrt(np.mean(square))),
        max_slope=float(np.sqrt(square.max())),
        rms_curvature=float(np.sqrt(np.mean(mean**2))),
        crest_curvature=max(0.0, float((mean + difference).max())),
        valley_curvature=max(0.0, float((difference - mean).max())),
    )


def _derivatives(heights: np.ndarray, spacing: tuple[float, float], periodic: bool) -> list[np.ndarray]:
    """Return h_x, h_y, h_xx, h_xy, h_yy of the bicubic spline at the grid points."""
    from scipy.ndimage import convolve1d, spline_filter

    mode = "grid-wrap" if periodic else "mirror"
    coefficients = spline_filter(heights, order=3, output=np.float64, mode=mode)
    d_x, d_y = spacing
    value, first, second = [1 / 6, 2 / 3, 1 / 6], [0.5, 0.0, -0.5], [1.0, -2.0, 1.0]

    def part(along_x: list[float], along_y: list[float], scale: float) -> np.ndarray:
        rows = convolve1d(coefficients, along_x, axis=1, mode=mode)
        result = convolve1d(rows, along_y, axis=0, mode=mode) / scale
        return result if periodic else result[2:-2, 2:-2]

    return [part(first, value, d_x), part(value, first, d_y), part(second, value, d_x**2), part(first, first, d_x * d_y),
            part(value, second, d_y**2)]  # fmt: skip
