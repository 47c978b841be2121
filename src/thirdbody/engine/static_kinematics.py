"""Linear kinematics of one rigid particle between two plates."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from thirdbody.engine.state import Array


def rows_of(position: Array, upper: NDArray[np.bool_], arm: float, freedoms: Sequence[int], under_load: bool) -> Array:
    """Return the derivatives (3, n, m) of overlap and displacements by the coordinates.

    Coordinates: translation, arm times rotation vector, and under load the closing. `position` (n, 3) from the centre of mass
    [m]; `upper` (n,): on the upper plate.
    """
    x, y, z = position.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    sign = np.where(upper, 1.0, -1.0)
    overlap = sign * np.array([zero, zero, one, y / arm, -x / arm, zero])
    along_x = np.array([one, zero, zero, zero, z / arm, -y / arm])
    along_y = np.array([zero, one, zero, -z / arm, zero, x / arm])
    rows = np.stack([overlap, along_x, along_y]).transpose(0, 2, 1)[:, :, list(freedoms)]
    if not under_load:
        return np.ascontiguousarray(rows)
    closing = np.stack([np.where(upper, 1.0, 0.0), zero, zero])[:, :, None]
    return np.concatenate([rows, closing], axis=2)
