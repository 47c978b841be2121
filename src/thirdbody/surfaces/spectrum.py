"""Power spectrum of heights, averaged over directions, and the power law that it follows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PER_OCTAVE = 4
"""Bins of the spectrum per factor of 2 in wavenumber."""

STEEPEST = -5.5
"""Slope of the logarithms below which the spectrum has ended: a self-affine one falls no faster than q^-4."""

FEWEST = 5
"""Smallest number of bins of a power law."""

SCATTER = 0.5
"""Largest rms deviation of ln C from the law; a sum of a few waves has a larger one."""

WIDE_BAND = 3.0
"""Ratio of the longest to the shortest wavelength of a power law from which on its exponent is reported as it is.

Of random surfaces with an exponent of 0.8 it is found as 0.81 over a ratio of 4, 0.82 over one of 3.4, and 0.46 over one of 2.
"""


@dataclass(frozen=True, eq=False)
class Spectrum:
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
        return self.long >= WIDE_BAND * self.short


def radial_spectrum(heights: np.ndarray, spacing: tuple[float, float], periodic: bool) -> Spectrum:
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
    return _binned(q.ravel(), power.ravel(), np.broadcast_to(weight, power.shape).ravel(), np.pi / max(spacing))


def _binned(q: np.ndarray, power: np.ndarray, weight: np.ndarray, highest: float) -> Spectrum:
    """Return means over rings of equal width in ln q, up to the wavenumber of two points per wave along each axis."""
    inside = (q > 0.0) & (q <= highest * (1.0 + 1e-9))
    q, power, weight = q[inside], power[inside], weight[inside]
    if not len(q):
        return Spectrum(np.zeros(0), np.zeros(0), np.zeros(0))
    ring = np.floor(PER_OCTAVE * np.log2(q / q.min()) + 1e-9).astype(int)
    total = np.bincount(ring, weight)
    filled = total > 0
    mean_q, mean_power = (np.bincount(ring, weight * values)[filled] / total[filled] for values in (q, power))
    return Spectrum(mean_q, mean_power, total[filled])


def power_law(spectrum: Spectrum) -> PowerLaw | None:
    """Return the power law that fits best, flat below its long wavelength; None where the spectrum follows none."""
    present = spectrum.power > 1e-12 * spectrum.power.max(initial=0.0)
    count = len(present) if present.all() else int(np.argmin(present))
    if count < FEWEST:
        return None
    x, z = np.log(spectrum.wavenumber[:count]), np.log(spectrum.power[:count])
    end = _end(x, z)
    weight = np.sqrt(spectrum.waves[:end])  # a mean of n powers scatters by 1/sqrt(n)
    best, law = np.inf, None
    for start in range(end - FEWEST + 1):
        knee = np.maximum(x[:end] - x[start], 0.0)
        slope, level = np.polyfit(knee, z[:end], 1, w=weight)
        deviation = float(np.sqrt(np.average((z[:end] - level - slope * knee) ** 2, weights=weight**2)))
        if deviation < best - 1e-9:
            long, short = (float(2.0 * np.pi / np.exp(x[k])) for k in (start, end - 1))
            best, law = deviation, PowerLaw(float(-0.5 * slope - 1.0), long, short, start > 0)
    return law if law is not None and best < SCATTER and law.hurst > -0.5 else None


def _end(x: np.ndarray, z: np.ndarray) -> int:
    """Return how many bins there are up to the one from which on the spectrum falls for good."""
    for k in range(len(x) // 2, len(x) - 1):
        if np.all(z[k + 1 :] < z[k] + STEEPEST * (x[k + 1 :] - x[k])):
            return k + 1
    return len(x)
