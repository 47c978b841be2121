"""Resting poses: contacts on the plane, nothing below, and every tilt raises the body."""

import math
import tracemalloc

import numpy as np
import pytest

from thirdbody.bodies.clump import Clump, clump
from thirdbody.bodies.irregular_clumps import irregular
from thirdbody.bodies.resting_poses import resting_poses, settle_all
from thirdbody.rotations import matrix_from_quaternion


def height(body, u):
    return (body.radii - body.centers @ u).max()


def ups_of(quaternions):
    return np.array([matrix_from_quaternion(q)[2] for q in quaternions])


def random_directions(rng, n):
    u = rng.normal(size=(n, 3))
    return u / np.linalg.norm(u, axis=1)[:, None]


def test_bodies_of_known_poses():
    quaternions, heights = resting_poses(clump([[3.0, 0.0, 0.0]], [2.0]))  # a ball, as it is
    assert quaternions.tolist() == [[1.0, 0.0, 0.0, 0.0]] and heights.tolist() == [2.0]
    # A triangle on its three spheres, on either face. On an edge (two spheres) it stands with the third above: unstable.
    quaternions, heights = resting_poses(clump(np.sqrt(3.0) * ring(3), [0.9, 0.9, 0.9]))
    assert heights == pytest.approx([0.9, 0.9], rel=1e-12)
    assert np.abs(ups_of(quaternions)) @ [0, 0, 1] == pytest.approx([1, 1], rel=1e-12)  # the thin axis has the largest inertia
    for centers, radii, expected in (
        ([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], np.full(4, 1.1), [1.1, 1.1]),  # a square pad, on four
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], np.ones(3), [1.0]),  # a rod: rolling about its axis is one family
    ):
        assert resting_poses(clump(centers, radii))[1] == pytest.approx(expected, rel=1e-12)
    # A cone on its side: a common tangent plane touches all three, and the family is found by every pair.
    assert len(resting_poses(clump([[0, 0, 0], [1, 0, 0], [1.9, 0, 0]], [1.0, 0.9, 0.81]))[1]) == 1
    # A hemisphere-like lump: the centroid below the center of the large sphere, with no other contact near.
    body = Clump(np.array([[0.0, 0.0, 0.3], [0.0, 0.0, -0.2]]), np.array([1.0, 0.3]), 4.2, np.ones(3), 0.0)
    quaternions, heights = resting_poses(body)
    assert heights == pytest.approx([0.7], rel=1e-12) and quaternions[0] == pytest.approx([1, 0, 0, 0], abs=1e-15)
    # a stool whose centroid lies over an edge falls
    feet = np.array([[1.0, 0.0, -1.0], [-1.0, 0.0, -1.0], [0.0, 1.0, -1.0]])
    quaternions, _ = resting_poses(Clump(feet, np.full(3, 1.5), 1.0, np.ones(3), 0.0))
    ups = ups_of(quaternions)
    # Upright, the second order lets it roll over the edge; hanging below its feet the same edge holds it.
    assert max(ups[:, 2]) < 0.9 and min(ups[:, 2]) == pytest.approx(-1.0, rel=1e-12)
    # two spheres that nearly coincide rest
    for apart in (0.0, 1e-16, 1e-12, 9e-10, 1e-9, 2e-9, 5e-9, 1e-7, 1e-4):
        _, heights = resting_poses(clump([[0.0, 0.0, 0.0], [apart * 5e-6, 0.0, 0.0]], [5e-6, 5e-6]))
        assert heights[0] == pytest.approx(5e-6, rel=1e-9), apart  # spheres nearer than 1e-9 radii are one


def test_random_clumps_rest_in_minima():
    for seed in range(3):
        rng = np.random.default_rng(seed)
        aspect = ([1, 0.8, 0.6], [1, 1, 0.2], [1, 0.3, 0.3])[seed % 3]
        body = irregular(rng, 4 + seed % 5, aspect, 1e-5)
        quaternions, heights = resting_poses(body)
        assert len(heights) >= 1 and (np.diff(heights) >= 0.0).all()
        tilts = random_directions(rng, 200)
        for u, h in zip(ups_of(quaternions), heights, strict=True):
            bottoms = np.sort(body.centers @ u + h - body.radii) / 1e-5
            # Closed forms: contacts, up to three, touch to rounding, relative to the body.
            contacts = (bottoms < 1e-9).sum()
            assert contacts >= 1 and bottoms[: min(contacts, 3)] == pytest.approx(0.0, abs=1e-12), seed
            for t in tilts - (tilts @ u)[:, None] * u:
                tilted = u + 1e-4 * t
                assert height(body, tilted / np.linalg.norm(tilted)) > h, seed
        # The lowest pose is the least height of all.
        assert min(height(body, t) for t in tilts) >= heights[0], seed


def test_no_minimum_is_missed():
    """Rolling downhill from anywhere, by small random steps, ends in a pose that was found."""
    rng = np.random.default_rng(0)
    body = irregular(rng, 5, [1, 0.8, 0.6], 1.0)
    ups = ups_of(resting_poses(body)[0])
    for _ in range(6):
        (u,) = random_directions(rng, 1)
        step, h = 0.05, height(body, u)
        while step > 1e-7:
            trials = u + step * rng.normal(size=(60, 3))
            trials /= np.linalg.norm(trials, axis=1)[:, None]
            lows = (body.radii - trials @ body.centers.T).max(axis=1)
            if lows.min() < h:
                u, h = trials[lows.argmin()], lows.min()
            else:
                step *= 0.5
        assert np.linalg.norm(ups - u, axis=1).min() < 1e-2  # the walk stalls in narrow valleys


def test_settle_is_reproducible_and_turns_about_the_vertical():
    body = irregular(np.random.default_rng(1), 6, [1, 0.8, 0.6], 1.0)
    first, again = (settle_all([body], np.random.default_rng(5))[0] for _ in range(2))
    assert np.array_equal(first, again)
    quaternions, heights = resting_poses(body)
    ups = ups_of(quaternions)
    for seed in range(20):
        (quaternion,), (h,) = settle_all([body], np.random.default_rng(seed))
        assert np.linalg.norm(quaternion) == pytest.approx(1.0, rel=1e-14)
        k = int(np.argmax(ups @ matrix_from_quaternion(quaternion)[2]))
        assert ups[k] == pytest.approx(matrix_from_quaternion(quaternion)[2], abs=1e-12)
        assert h == heights[k]


def test_settled_together_or_one_after_the_other():
    """Bodies of several numbers of spheres, a ball and a rod among them, from one stream."""
    bodies = [irregular(np.random.default_rng(k), 1 + k % 6, [1, 0.8, 0.6], 1e-5) for k in range(24)]
    quaternions, heights = settle_all(bodies, np.random.default_rng(5))
    rng = np.random.default_rng(5)
    for body, q, h in zip(bodies, quaternions, heights, strict=True):
        (alone,), (level,) = settle_all([body], rng)
        assert q == pytest.approx(alone, abs=1e-13)  # the order of sums in products of matrices
        assert h == pytest.approx(level, rel=1e-13)
    assert settle_all([], rng)[0].shape == (0, 4)


def ring(n):
    a = 2.0 * math.pi * np.arange(n) / n
    return 0.5 / math.sin(math.pi / n) * np.column_stack((np.cos(a), np.sin(a), 0.0 * a))


def test_a_hundred_spheres_rest_in_little_memory():
    """As the clump is made: a table of all pairs of directions would have 45 000 rows and columns."""
    tracemalloc.start()
    try:
        _, heights = resting_poses(clump(1e-6 * ring(100), np.full(100, 1e-6)))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert heights == pytest.approx([1e-6, 1e-6], rel=1e-9)
    assert peak < 500e6
