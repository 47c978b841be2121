"""Heights of sinusoidal waves, and of grooves with straight flanks and rounded corners."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class GrooveProfile(NamedTuple):
    """Depth, width at the top, length of a flank along the plane, half a rounded corner, distance from groove to groove [m]."""

    depth: float
    width: float
    flank: float
    corner: float
    period: float


def phases(shape: tuple[int, int], waves: tuple[int, int], phase: float) -> np.ndarray:
    """Return the phase (n_y, n_x) of a wave at the grid points, in periods, 0 to 1: `waves` along x and y, `phase` [rad]."""
    along_x, along_y = np.arange(shape[1]) * waves[0] / shape[1], np.arange(shape[0]) * waves[1] / shape[0]
    return np.asarray((along_y[:, None] + along_x[None, :] - phase / (2.0 * np.pi)) % 1.0)


def sine_heights(phase: np.ndarray, amplitude: float) -> np.ndarray:
    """Return heights of a cosine [m] at a phase in periods."""
    return amplitude * np.cos(2.0 * np.pi * phase)


def groove_heights(phase: np.ndarray, profile: GrooveProfile) -> np.ndarray:
    """Return heights of grooves [m], 0 on the land; the middle of a groove is at phase 0."""
    x = ((phase + 0.5) % 1.0 - 0.5) * profile.period
    top, half = 0.5 * profile.width, profile.corner
    bottom = top - profile.flank
    flanks = sum(_rounded_ramp(side - bottom, half) - _rounded_ramp(side - top, half) for side in (x, -x))
    return np.asarray(profile.depth / profile.flank * flanks - profile.depth)


def _rounded_ramp(x: np.ndarray, half: float) -> np.ndarray:
    """Return max(x, 0) averaged with a triangle of half width `half`: cubic pieces, continuous to the second derivative."""
    third = sum(weight * np.maximum(x + shift, 0.0) ** 3 for shift, weight in ((half, 1.0), (0.0, -2.0), (-half, 1.0)))
    inner = third / (6.0 * half**2)
    return np.asarray(np.where(x >= half, x, np.where(x <= -half, 0.0, inner)))
