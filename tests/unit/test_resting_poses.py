"""Resting poses: contacts on the plane, nothing below, and every tilt raises the body."""

import math
import tracemalloc

import numpy as np
import pytest

from thirdbody.bodies.clump import Clump, clump, matrix_from_quaternion
from thirdbody.bodies.irregular_clumps import irregular
from thirdbody.bodies.resting_poses import resting_poses, settle, settle_all


def height(body, u):
    return (body.radii - body.centers @ u).max()


def triangle():
    a = 2.0 * math.pi * np.arange(3) / 3.0
    return clump(np.column_stack((np.cos(a), np.sin(a), 0.0 * a)), [0.9, 0.9, 0.9])


def test_sphere_rests_as_it_is():
    quaternions, heights = resting_poses(clump([[3.0, 0.0, 0.0]], [2.0]))
    assert quaternions.tolist() == [[1.0, 0.0, 0.0, 0.0]] and heights.tolist() == [2.0]


def test_triangle_of_spheres_lies_flat():
    body = triangle()
    quaternions, heights = resting_poses(body)
    # On its three spheres, on either face. On an edge (two spheres) it stands with the third above: unstable.
    assert heights == pytest.approx([0.9, 0.9], rel=1e-12)
    ups = [matrix_from_quaternion(q)[2] for q in quaternions]
    assert np.abs(ups) @ [0, 0, 1] == pytest.approx([1, 1], rel=1e-12)  # the thin axis has the largest inertia


def test_square_pad_rests_on_four():
    body = clump([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], np.full(4, 1.1))
    heights = resting_poses(body)[1]
    assert heights == pytest.approx([1.1, 1.1], rel=1e-12)


def test_rod_rests_on_its_side_once():
    heights = resting_poses(clump([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [1.0, 1.0, 1.0]))[1]
    assert heights == pytest.approx([1.0], rel=1e-12)  # rolling about its axis is one family


def test_a_cone_of_spheres_rests_on_its_side_once():
    # A common tangent plane touches all three: the family is found by every pair.
    body = clump([[0, 0, 0], [1, 0, 0], [1.9, 0, 0]], [1.0, 0.9, 0.81])
    assert len(resting_poses(body)[1]) == 1


def test_a_weighted_ball_rights_itself():
    # A hemisphere-like lump: the centroid below the center of the large sphere, with no other contact near.
    body = Clump(np.array([[0.0, 0.0, 0.3], [0.0, 0.0, -0.2]]), np.array([1.0, 0.3]), 4.2, np.ones(3), 0.0)
    quaternions, heights = resting_poses(body)
    assert heights == pytest.approx([0.7], rel=1e-12)
    assert quaternions[0] == pytest.approx([1, 0, 0, 0], abs=1e-15)


def test_a_stool_whose_centroid_lies_over_an_edge_falls():
    feet = np.array([[1.0, 0.0, -1.0], [-1.0, 0.0, -1.0], [0.0, 1.0, -1.0]])
    quaternions, _ = resting_poses(Clump(feet, np.full(3, 1.5), 1.0, np.ones(3), 0.0))
    ups = [matrix_from_quaternion(q)[2] for q in quaternions]
    # Upright, the second order lets it roll over the edge; hanging below its feet the same edge holds it.
    assert max(u[2] for u in ups) < 0.9
    assert min(u[2] for u in ups) == pytest.approx(-1.0, rel=1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_random_clumps_rest_in_minima(seed):
    rng = np.random.default_rng(seed)
    aspect = ([1, 0.8, 0.6], [1, 1, 0.2], [1, 0.3, 0.3])[seed % 3]
    body = irregular(rng, 4 + seed % 5, aspect, 1e-5)
    quaternions, heights = resting_poses(body)
    assert len(heights) >= 1 and (np.diff(heights) >= 0.0).all()
    tilts = rng.normal(size=(200, 3))
    tilts /= np.linalg.norm(tilts, axis=1)[:, None]
    for quaternion, h in zip(quaternions, heights, strict=True):
        bottoms = body.centers @ matrix_from_quaternion(quaternion).T[:, 2] + h - body.radii
        # Closed forms: contacts touch to rounding, relative to the body.
        assert bottoms.min() == pytest.approx(0.0, abs=1e-12 * 1e-5)
        u = matrix_from_quaternion(quaternion)[2]
        across = tilts - (tilts @ u)[:, None] * u
        for t in across:
            tilted = u + 1e-4 * t
            assert height(body, tilted / np.linalg.norm(tilted)) > h
    # The lowest pose is the least height of all.
    assert min(height(body, t) for t in tilts) >= heights[0]


@pytest.mark.parametrize("seed", range(4))
def test_no_minimum_is_missed(seed):
    """Rolling downhill from anywhere, by small random steps, ends in a pose that was found."""
    rng = np.random.default_rng(seed)
    body = irregular(rng, 5, [1, 0.8, 0.6], 1.0)
    quaternions, _ = resting_poses(body)
    ups = np.array([matrix_from_quaternion(q)[2] for q in quaternions])
    for _ in range(6):
        u = rng.normal(size=3)
        u /= np.linalg.norm(u)
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


def test_many_contacts_in_triples_touch_all():
    body = irregular(np.random.default_rng(9), 7, [1, 1, 0.3], 1.0)
    scale = body.radii.max()
    for quaternion, h in zip(*resting_poses(body), strict=True):
        bottoms = np.sort(body.centers @ matrix_from_quaternion(quaternion)[2] + h - body.radii) / scale
        contacts = (bottoms < 1e-9).sum()
        assert contacts >= 1 and bottoms[: min(contacts, 3)] == pytest.approx(0.0, abs=1e-12)


def test_settle_is_reproducible_and_turns_about_the_vertical():
    body = irregular(np.random.default_rng(1), 6, [1, 0.8, 0.6], 1.0)
    first, h = settle(body, np.random.default_rng(5))
    again, _ = settle(body, np.random.default_rng(5))
    assert np.array_equal(first, again)
    quaternions, heights = resting_poses(body)
    ups = np.array([matrix_from_quaternion(q)[2] for q in quaternions])
    for seed in range(20):
        quaternion, h = settle(body, np.random.default_rng(seed))
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
        alone, level = settle(body, rng)
        assert q == pytest.approx(alone, abs=1e-13)  # the order of sums in products of matrices
        assert h == pytest.approx(level, rel=1e-13)
    assert settle_all([], rng)[0].shape == (0, 4)


@pytest.mark.parametrize("apart", [0.0, 1e-16, 1e-12, 9e-10, 1e-9, 2e-9, 5e-9, 1e-7, 1e-4])
def test_two_spheres_that_nearly_coincide_rest(apart):
    body = clump([[0.0, 0.0, 0.0], [apart * 5e-6, 0.0, 0.0]], [5e-6, 5e-6])
    _, heights = resting_poses(body)
    assert heights[0] == pytest.approx(5e-6, rel=1e-9)  # spheres nearer than 1e-9 radii are one


@pytest.mark.parametrize("seed", range(40))
def test_every_small_cluster_rests(seed):
    """Two to five spheres within a tiny part of their radius, in any place, on a line or in a plane."""
    rng = np.random.default_rng(seed)
    centers = rng.normal(size=(2 + seed % 4, 3)) * [1.0, seed % 3 > 0, seed % 3 > 1] * 10.0 ** rng.uniform(-16.0, -4.0)
    body = Clump(centers + rng.normal(size=3) * (seed % 2) * 1e-3, np.ones(len(centers)), 1.0, np.ones(3), 0.0)
    quaternions, heights = resting_poses(body)
    tilts = rng.normal(size=(500, 3))
    tilts /= np.linalg.norm(tilts, axis=1)[:, None]
    assert heights[0] <= min(height(body, t) for t in tilts) + 3e-9  # what is nearer than 1e-9 radii is not told apart
    for quaternion, h in zip(quaternions, heights, strict=True):
        assert h == pytest.approx(height(body, matrix_from_quaternion(quaternion)[2]), rel=1e-14)


def ring(n):
    a = 2.0 * math.pi * np.arange(n) / n
    return 0.5 / math.sin(math.pi / n) * np.column_stack((np.cos(a), np.sin(a), 0.0 * a))


def grid(*shape):
    return np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)


HUNDRED = {
    "row": (grid(100, 1, 1), [1.0]),
    "sheet": (grid(10, 10, 1), [1.0, 1.0]),
    "ring": (ring(100), [1.0, 1.0]),
    "block": (grid(4, 5, 5), [2.5, 2.5, 3.0, 3.0, 3.0, 3.0]),
}
"""Bodies of a hundred spheres of radius 1, and the heights of their poses: on every face."""


@pytest.mark.parametrize("name", HUNDRED)
def test_a_hundred_spheres_rest_in_little_memory(name):
    """As the clump is made: a table of all pairs of directions would have 45 000 rows and columns."""
    centers, expected = HUNDRED[name]
    tracemalloc.start()
    try:
        _, heights = resting_poses(clump(1e-6 * centers, np.full(100, 1e-6)))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert heights == pytest.approx(1e-6 * np.array(expected), rel=1e-9)
    assert peak < 500e6
