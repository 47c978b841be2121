"""Small turns of balls: the length stays 1, on both sides of where a series stands for the root."""

import numpy as np
from numba import njit

from thirdbody.jit.simd import load, set4, store
from thirdbody.kernels.rotation import NEARLY_UNIT, rotate_small


@njit(error_model="numpy")
def turned_all(Q, R, out):
    for k in range(Q.shape[0]):
        store(out, k, 0, rotate_small(load(Q, k, 0), set4(R[k, 0], R[k, 1], R[k, 2], 0.0)))


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Products of quaternions (n, 4)."""
    u, v = p[:, 1:], q[:, 1:]
    real = p[:, 0] * q[:, 0] - np.sum(u * v, axis=1)
    return np.column_stack((real, p[:, [0]] * v + q[:, [0]] * u + np.cross(u, v)))


def test_a_turn_is_by_twice_the_angle_whose_tangent_is_half_of_it():
    rng = np.random.default_rng(3)
    sizes = np.concatenate((np.logspace(-12, 0.5, 2000), 2.0 * np.sqrt(NEARLY_UNIT) * np.linspace(0.99, 1.01, 2001)))
    Q, axes = rng.normal(size=(len(sizes), 4)), rng.normal(size=(len(sizes), 3))
    Q /= np.linalg.norm(Q, axis=1)[:, None]
    R = sizes[:, None] * axes / np.linalg.norm(axes, axis=1)[:, None]
    out = np.empty_like(Q)
    turned_all(Q, R, out)
    turn = np.column_stack((np.ones(len(R)), 0.5 * R))
    expected = product(turn / np.linalg.norm(turn, axis=1)[:, None], Q)
    # a dozen roundings of numbers up to 1
    assert np.abs(out - expected).max() < 1e-15
    assert np.abs(np.sum(out * out, axis=1) - 1.0).max() < 1e-15


def test_the_length_does_not_wander_in_many_turns():
    """What rounding leaves of a length is put right by the next turn, and does not add up."""
    Q, R, rng = np.array([[1.0, 0.0, 0.0, 0.0]]), np.empty((1, 3)), np.random.default_rng(4)
    for _ in range(20_000):
        R[0] = rng.normal(size=3) * 1e-3
        turned_all(Q, R, Q)
    assert abs(np.sum(Q * Q) - 1.0) < 1e-15
