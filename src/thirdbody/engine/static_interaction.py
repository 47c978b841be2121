"""Elastic interaction of the spots of one particle in statics, as `kernels.close_spots` has it in runs.

Kinematics is linear there, so distances of spots stay as they are and no force along the plate arises.
"""

import numpy as np
from numpy.typing import NDArray

from thirdbody.engine.state import Array
from thirdbody.kernels.spot_loads import NEAR

ITERATIONS = 60
"""Most steps of Newton's method; four to six are enough."""


class SpotBending:
    """Spots of a particle that lower the plate under each other: `bend` (n, n) [m/N], `stiffness` (n,) [N/m^(3/2)]."""

    def __init__(self, position: Array, upper: NDArray[np.bool_], radius: Array, compliance: Array, stiffness: Array) -> None:
        """`compliance` (n,): of the plate of each spot [m2/N]; `stiffness` (n,): force over (R d^3)^(1/2) [Pa]."""
        apart = np.hypot(*(position[:, None, :2] - position[None, :, :2]).transpose(2, 0, 1))
        apart = np.maximum(apart, NEAR * np.minimum(radius[:, None], radius[None]))
        self.bend = np.where(upper[:, None] == upper[None], compliance[:, None] / apart, 0.0)
        np.fill_diagonal(self.bend, 0.0)
        self.stiffness = stiffness * np.sqrt(radius)

    def relieved(self, overlap: Array) -> Array:
        """Return what presses on each spot itself (n,) [m], x = d - sum_j g_ij N_j(x); negative where nothing does."""
        x = overlap.copy()
        for _ in range(ITERATIONS):
            root = np.sqrt(np.maximum(x, 0.0))
            force, slope = self.stiffness * root**3, 1.5 * self.stiffness * root
            step = np.linalg.solve(np.eye(len(x)) + self.bend * slope, x + self.bend @ force - overlap)
            x = x - step
            if np.abs(step).max() <= 1e-15 * np.abs(overlap).max():
                break
        return x

    def rates(self, relieved: Array) -> Array:
        """Return the change (n, n) of what presses on each spot itself with the overlaps of all."""
        slope = 1.5 * self.stiffness * np.sqrt(np.maximum(relieved, 0.0))
        return np.asarray(np.linalg.inv(np.eye(len(relieved)) + self.bend * slope))
