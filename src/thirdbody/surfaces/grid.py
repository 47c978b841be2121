"""The periodic grid of a surface, and heights generated on it: random self-affine ones, sinusoidal waves, grooves."""

import math
from typing import NamedTuple

import numpy as np

# Grid points per shortest wavelength. The spline through 8 points per wave differs from a band-limited self-affine surface (H =
# 0.3 to 1, a decade of wavelengths) by 3e-5 to 8e-5 of the rms height; rms slope and rms curvature differ by 0.05 % and 2 %
# from those of 32 points.
POINTS_PER_WAVE = 8
# Grid points per wavelength of a single sine, whose curvature is then within 0.4 % of the formula.
POINTS_PER_SINE = 32
# Grid points per half of a rounded corner of a groove.
POINTS_PER_CORNER = 4
# Largest ratio of the two spacings, so that the cells of a search are not too long.
ASPECT = 4.0
# Smallest number of points along a side.
FEWEST = 16
# Largest number of points of a surface: 240 MB of coefficients.
MAX_POINTS = 30_000_000
# Relative deviation of a wave vector below which a wave is taken as the nearest one that fits.
FIT = 1e-3


class WholeWaves(NamedTuple):
    """The nearest wave that fits a domain: waves along x and y, wavelength [m], angle [rad], relative deviation."""

    along: tuple[int, int]
    wavelength: float
    angle: float
    deviation: float


def angle_of(direction: float | str) -> float:
    """Return the angle of a direction [rad]: an axis, or an angle."""
    return {"x": 0.0, "y": 0.5 * math.pi}[direction] if isinstance(direction, str) else direction


def whole_waves(size: tuple[float, float], wavelength: float, angle: float) -> WholeWaves:
    """Return the wave with whole numbers along both sides that is nearest to a wave vector."""
    wanted = (size[0] * math.cos(angle) / wavelength, size[1] * math.sin(angle) / wavelength)
    m, n = round(wanted[0]), round(wanted[1])
    if m == n == 0:  # longer than the domain: one wave along the side that it rather follows
        m, n = (1, 0) if abs(wanted[0]) >= abs(wanted[1]) else (0, 1)
    q = (m / size[0], n / size[1])
    away = math.hypot(q[0] - math.cos(angle) / wavelength, q[1] - math.sin(angle) / wavelength) * wavelength
    return WholeWaves((m, n), 1.0 / math.hypot(*q), math.atan2(q[1], q[0]), away)


def grid_points(length: float, spacing: float) -> int:
    """Return the number of points along a side with at most this spacing: even, with small prime factors, for the FFT."""
    wanted = max(FEWEST, math.ceil(length / spacing * (1.0 - 1e-9)))
    while True:
        rest = wanted
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1 and wanted % 2 == 0:
            return wanted
        wanted += 1


def grid_counts(size: tuple[float, float], spacing: tuple[float, float]) -> tuple[int, int]:
    """Return the numbers of points along y and x with at most these spacings along x and y [m]."""
    finest = ASPECT * min(spacing)
    n_x, n_y = (grid_points(length, min(step, finest)) for length, step in zip(size, spacing, strict=True))
    return n_y, n_x


def self_affine(
    shape: tuple[int, int], size: tuple[float, float], rms: float, hurst: float, long: float, short: float, seed: int, stream: int
) -> np.ndarray:  # fmt: skip
    """Return random self-affine heights (n_y, n_x) [m] (Persson et al. 2005, J. Phys.: Condens. Matter 17:R1).

    Rms height [m], Hurst exponent, and the wavelengths [m] between which the power falls as q^(-2 - 2 H); phases are random.
    A phase belongs to its wave: waves are sorted by their wavenumber and take the phases in this order, so that another grid
    leaves the surface as it is, and a shorter short wavelength adds waves to it. `stream` tells the surfaces of one seed apart.
    """
    # the waves of the domain, one of each conjugate pair, by rising wavenumber
    m_max, n_max = int(size[0] / short), int(size[1] / short)
    m, n = (wave.ravel() for wave in np.meshgrid(np.arange(-m_max, m_max + 1), np.arange(n_max + 1), indexing="ij"))
    square = (m / size[0]) ** 2 + (n / size[1]) ** 2
    inside = (square <= (1.0 + 1e-9) / short**2) & ((n > 0) | (m > 0))
    m, n, square = m[inside], n[inside], square[inside]
    order = np.lexsort((m, n, square))
    m, n, q = m[order], n[order], np.sqrt(square[order])
    amplitude = np.maximum(q, 1.0 / long) ** (-1.0 - hurst)
    amplitude *= rms / np.sqrt(2.0 * np.sum(amplitude**2))  # a wave and its conjugate
    # raw bits of PCG64 are the same for every version of numpy
    bits = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(stream,))).random_raw(len(q))
    waves = amplitude * np.exp(2j * np.pi * ((bits >> np.uint64(11)) * 2.0**-53))
    transform = np.zeros(shape, complex)
    transform[n % shape[0], m % shape[1]] = waves
    transform[-n % shape[0], -m % shape[1]] = np.conj(waves)
    return np.ascontiguousarray(np.fft.ifft2(transform, norm="forward").real)


def phases(shape: tuple[int, int], waves: tuple[int, int], phase: float) -> np.ndarray:
    """Return the phase (n_y, n_x) of a wave at the grid points, in periods, 0 to 1: `waves` along x and y, `phase` [rad]."""
    along_x, along_y = np.arange(shape[1]) * waves[0] / shape[1], np.arange(shape[0]) * waves[1] / shape[0]
    return np.asarray((along_y[:, None] + along_x[None, :] - phase / (2.0 * np.pi)) % 1.0)


def sine_heights(phase: np.ndarray, amplitude: float) -> np.ndarray:
    """Return heights of a cosine [m] at a phase in periods."""
    return amplitude * np.cos(2.0 * np.pi * phase)


def groove_heights(phase: np.ndarray, depth: float, width: float, flank: float, corner: float, period: float) -> np.ndarray:
    """Return heights of grooves [m], 0 on the land; the middle of a groove is at phase 0.

    Width at the top, length of a flank along the plane, half a rounded corner, distance from groove to groove [m].
    """
    x, top = ((phase + 0.5) % 1.0 - 0.5) * period, 0.5 * width
    flanks = sum(_rounded_ramp(side - (top - flank), corner) - _rounded_ramp(side - top, corner) for side in (x, -x))
    return np.asarray(depth / flank * flanks - depth)


def _rounded_ramp(x: np.ndarray, half: float) -> np.ndarray:
    """Return max(x, 0) averaged with a triangle of half width `half`: cubic pieces, continuous to the second derivative."""
    third = sum(weight * np.maximum(x + shift, 0.0) ** 3 for shift, weight in ((half, 1.0), (0.0, -2.0), (-half, 1.0)))
    inner = third / (6.0 * half**2)
    return np.asarray(np.where(x >= half, x, np.where(x <= -half, 0.0, inner)))
