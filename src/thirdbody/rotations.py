"""Vectors (..., 3) and unit quaternions (w, x, y, z; body to world) of many bodies at once.

Products by components: numpy's own `cross` and sums over an axis of three take several times as long.
"""

import math

import numpy as np


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return scalar products (...) of vectors (..., 3)."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return vector products (..., 3) of vectors (..., 3)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def matrix_from_quaternion(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (..., 3, 3), body to world, of unit quaternions (..., 4): w, x, y, z."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion), -1, 0)
    matrix = np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
    return np.moveaxis(matrix, (0, 1), (-2, -1))


def to_world(q: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return vectors (n, 3) in the axes of bodies with quaternions (n, 4) in world axes."""
    return np.einsum("nij,nj->ni", matrix_from_quaternion(q), vectors)


def to_body(q: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return vectors (n, 3) in world axes in the axes of bodies with quaternions (n, 4)."""
    return np.einsum("nji,nj->ni", matrix_from_quaternion(q), vectors)


def quaternion_from_matrix(rotation: np.ndarray) -> np.ndarray:
    """Return the unit quaternion (4,), w >= 0, of a rotation matrix (3, 3) (Shepperd 1978)."""
    m = rotation
    k = int(np.argmax([m.trace(), m[0, 0], m[1, 1], m[2, 2]]))
    q = np.empty(4)
    if k == 0:
        q[:] = 1.0 + m.trace(), m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    else:
        i, j, n = k - 1, k % 3, (k + 1) % 3
        q[0] = m[n, j] - m[j, n]
        q[1 + i] = 1.0 + m[i, i] - m[j, j] - m[n, n]
        q[1 + j] = m[i, j] + m[j, i]
        q[1 + n] = m[i, n] + m[n, i]
    return q / math.copysign(np.linalg.norm(q), q[0])


def quaternion_product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the quaternion (4,) of the rotation q followed by the rotation p."""
    vector = p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *vector])
