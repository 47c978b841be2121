"""Random self-affine heights with a given spectrum (Persson et al. 2005, J. Phys.: Condens. Matter 17:R1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Spectrum(NamedTuple):
    """Rms height [m], Hurst exponent, and the wavelengths [m] between which the power falls as q^(-2 - 2 H)."""

    rms: float
    hurst: float
    long: float
    short: float


def self_affine(shape: tuple[int, int], size: tuple[float, float], spectrum: Spectrum, seed: int, stream: int) -> np.ndarray:
    """Return heights (n_y, n_x) [m] with random phases, the root of their mean square equal to the given one.

    A phase belongs to its wave: waves are sorted by their wavenumber and take the phases in this order, so that another grid
    leaves the surface as it is, and a shorter short wavelength adds waves to it. `stream` tells the surfaces of one seed apart.
    """
    m, n, q = _waves(size, spectrum.short)
    amplitude = np.maximum(q, 1.0 / spectrum.long) ** (-1.0 - spectrum.hurst)
    amplitude *= spectrum.rms / np.sqrt(2.0 * np.sum(amplitude**2))  # a wave and its conjugate
    waves = amplitude * np.exp(2j * np.pi * _uniform(len(q), seed, stream))
    transform = np.zeros(shape, complex)
    transform[n % shape[0], m % shape[1]] = waves
    transform[-n % shape[0], -m % shape[1]] = np.conj(waves)
    return np.ascontiguousarray(np.fft.ifft2(transform, norm="forward").real)


def _waves(size: tuple[float, float], short: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the waves along x and y of the domain, one of each conjugate pair, by rising wavenumber, and that [1/m]."""
    m_max, n_max = int(size[0] / short), int(size[1] / short)
    m, n = (wave.ravel() for wave in np.meshgrid(np.arange(-m_max, m_max + 1), np.arange(n_max + 1), indexing="ij"))
    square = (m / size[0]) ** 2 + (n / size[1]) ** 2
    inside = (square <= (1.0 + 1e-9) / short**2) & ((n > 0) | (m > 0))
    m, n, square = m[inside], n[inside], square[inside]
    order = np.lexsort((m, n, square))
    return m[order], n[order], np.sqrt(square[order])


def _uniform(count: int, seed: int, stream: int) -> np.ndarray:
    """Return numbers in [0, 1) from the raw bits of PCG64, which are the same for every version of numpy."""
    bits = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(stream,))).random_raw(count)
    return (bits >> np.uint64(11)) * 2.0**-53
