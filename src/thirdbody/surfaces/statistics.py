"""Statistics of heights on a grid: rms height, slope and curvature, skewness, extremes, spectrum with its power law."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from thirdbody.surfaces.spectrum import PowerLaw, Spectrum, power_law, radial_spectrum


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
    spectrum: Spectrum | None = None
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
    mean, difference = _curvatures(x, y, xx, xy, yy)
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


def _curvatures(x: np.ndarray, y: np.ndarray, xx: np.ndarray, xy: np.ndarray, yy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean curvature, positive at crests, and half the difference of the principal ones [1/m]."""
    area = 1.0 + x**2 + y**2
    mean = -((1.0 + y**2) * xx - 2.0 * x * y * xy + (1.0 + x**2) * yy) / (2.0 * area**1.5)
    gauss = (xx * yy - xy**2) / area**2
    return mean, np.sqrt(np.maximum(mean**2 - gauss, 0.0))
