"""Rough plates made in Python, for tests: height fields from functions, and scenes built with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from scipy.ndimage import spline_filter

from thirdbody.assembly import simulation
from thirdbody.kernels.height_field import pack_field

Heights = Callable[[np.ndarray, np.ndarray], np.ndarray]


def field(heights: Heights, size: tuple[float, float], cells: tuple[int, int]) -> np.ndarray:
    """The height field that has these heights at its nodes."""
    x, y = (np.arange(n) * (length / n) for n, length in zip(cells, size, strict=True))
    values = heights(*np.meshgrid(x, y, indexing="ij")) + np.zeros(cells)
    return pack_field(spline_filter(values, order=3, mode="grid-wrap"), *size)


class Packed(NamedTuple):
    """What `build` needs of a surface."""

    packed: np.ndarray
    curvature: bool
    notes: tuple[str, ...] = ()


@contextmanager
def rough_plates(lower: np.ndarray | None, upper: np.ndarray | None = None, curved: bool = True) -> Iterator[None]:
    """Let `build` make plates with these height fields."""
    surfaces = {side: Packed(row, curved) for side, row in (("lower", lower), ("upper", upper)) if row is not None}
    with patch.object(simulation, "plate_surfaces", lambda scene: surfaces):
        yield
