"""Rotations by unit quaternions (w, x, y, z), body to world, of many bodies at once."""

import numpy as np


def rotation_matrices(q: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (n, 3, 3), body to world, of quaternions (n, 4)."""
    w, x, y, z = q.T
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)


def to_world(q: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return vectors (n, 3) in the axes of bodies with quaternions (n, 4) in world axes."""
    return np.einsum("nij,nj->ni", rotation_matrices(q), vectors)


def to_body(q: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return vectors (n, 3) in world axes in the axes of bodies with quaternions (n, 4)."""
    return np.einsum("nji,nj->ni", rotation_matrices(q), vectors)
