"""The periodic grid of a surface: how many points a domain needs, and which waves fit into it."""

import math
from typing import NamedTuple

POINTS_PER_WAVE = 8
"""Grid points per shortest wavelength.

The spline through 8 points per wave differs from a band-limited self-affine surface (H = 0.3 to 1, a decade of wavelengths) by
3e-5 to 8e-5 of the rms height; rms slope and rms curvature differ by 0.05 % and 2 % from those of 32 points.
"""

POINTS_PER_SINE = 32
"""Grid points per wavelength of a single sine, whose curvature is then within 0.4 % of the formula."""

POINTS_PER_CORNER = 4
"""Grid points per half of a rounded corner of a groove."""

ASPECT = 4.0
"""Largest ratio of the two spacings, so that the cells of a search are not too long."""

FEWEST = 16
"""Smallest number of points along a side."""

MAX_POINTS = 30_000_000
"""Largest number of points of a surface: 240 MB of coefficients."""

FIT = 1e-3
"""Relative deviation of a wave vector below which a wave is taken as the nearest one that fits."""


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
    while _reduced(wanted) != 1 or wanted % 2:
        wanted += 1
    return wanted


def _reduced(number: int) -> int:
    for prime in (2, 3, 5):
        while number % prime == 0:
            number //= prime
    return number


def grid_counts(size: tuple[float, float], spacing: tuple[float, float]) -> tuple[int, int]:
    """Return the numbers of points along y and x with at most these spacings along x and y [m]."""
    finest = ASPECT * min(spacing)
    n_x, n_y = (grid_points(length, min(step, finest)) for length, step in zip(size, spacing, strict=True))
    return n_y, n_x
