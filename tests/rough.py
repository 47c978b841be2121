"""Rough plates made in Python, for tests: height fields from functions, and scenes built with them."""

from contextlib import contextmanager
from unittest.mock import patch

import numpy as np
from thirdbody.assembly import simulation
from thirdbody.surfaces.surface import Surface


def field(heights, size, cells, curvature=True):
    """The surface that has these heights at its nodes; their mean is not taken off."""
    x, y = (np.arange(n) * (length / n) for n, length in zip(cells, size, strict=True))
    return Surface(heights(*np.meshgrid(x, y)) + np.zeros(cells[::-1]), size, size[0], curvature)


@contextmanager
def rough_plates(lower, upper=None):
    """Let `build` make plates with these surfaces."""
    surfaces = {side: surface for side, surface in (("lower", lower), ("upper", upper)) if surface is not None}
    with patch.object(simulation, "plate_surfaces", lambda scene: surfaces):
        yield
