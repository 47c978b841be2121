"""Bodies given by their spots: each spot is a sphere that touches one plate only."""

import math
from collections.abc import Sequence

import numpy as np

from thirdbody.bodies.clump import Clump
from thirdbody.kernels.tables import ONLY_LOWER, ONLY_UPPER


def spot_body(
    summits: np.ndarray, radii: np.ndarray, upper: np.ndarray, mass: float, inertia: Sequence[float], density: float
) -> Clump:
    """Return a body in its principal axes x, y, z, origin at the centre of mass.

    summits (k, 3) [m]: the points that touch first; radii (k,) [m] of curvature; upper (k,) bool: which plate a spot touches.
    mass [kg], inertia (3,) [kg m2]; the volume follows from the mass and this density [kg/m3].
    """
    up = np.where(upper, 1.0, -1.0)
    centers = summits - np.outer(up * radii, (0.0, 0.0, 1.0))
    sides = np.where(upper, ONLY_UPPER, ONLY_LOWER)
    return Clump(centers, np.array(radii, float), mass / density, np.array(inertia, float) / density, 0.0, sides)


def rows(count: int, size: tuple[float, float]) -> np.ndarray:
    """Return positions (count, 2) [m] in rows over a domain of this size: a nearly square rectangular grid."""
    columns = max(1, round(math.sqrt(count * size[0] / size[1])))
    lines = math.ceil(count / columns)
    k = np.arange(count)
    return np.column_stack(((k % columns + 0.5) * size[0] / columns, (k // columns + 0.5) * size[1] / lines))
