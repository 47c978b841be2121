"""Moments of unions of discs against strips, and break heights against spheres whose circles are known."""

import math

import numpy as np
import pytest

from thirdbody.bodies.union_moments import break_heights, longest_links, union_of_discs


def moments(centers, radii):
    out = np.empty(6)
    union_of_discs(centers, radii, out)
    return out


def strips(centers, radii, count=20_001):
    """Area, x, y, xx, yy, xy moments from the intervals that the discs cover on `count` lines y = const."""
    low, high = (centers[:, 1] - radii).min(), (centers[:, 1] + radii).max()
    step, total = (high - low) / count, np.zeros(6)
    for y in low + step * (np.arange(count) + 0.5):
        square = radii**2 - (y - centers[:, 1]) ** 2
        half = np.sqrt(square[square > 0.0])
        x = centers[square > 0.0, 0]
        at = -math.inf
        for a, b in sorted(zip(x - half, x + half, strict=True)):
            a, at = max(a, at), max(b, at)
            if at > a:
                w, m, q = at - a, 0.5 * (at**2 - a**2), (at**3 - a**3) / 3.0
                total += step * np.array([w, m, y * w, q, y * y * w, y * m])
    return total


@pytest.mark.parametrize("seed", range(6))
def test_discs_have_the_moments_of_their_strips(seed):
    rng = np.random.default_rng(seed)
    centers, radii = rng.uniform(-1.0, 1.0, (6, 2)), rng.uniform(0.2, 1.0, 6)
    # strips err where the outline is level: step^1.5 = 3e-7 there, some dozen times
    assert moments(centers, radii) == pytest.approx(strips(centers, radii), abs=2e-5)


def test_hidden_absent_and_equal_discs_count_once():
    big = moments(np.zeros((1, 2)), np.array([2.0]))
    centers = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.0], [1.0, 1.0]])
    # a disc inside, an equal one in the same place, and one of radius 0 that is not there
    assert moments(centers, np.array([2.0, 1.0, 2.0, 0.0])).tolist() == big.tolist()
    assert big == pytest.approx([4.0 * math.pi, 0.0, 0.0, 4.0 * math.pi, 4.0 * math.pi, 0.0], rel=1e-15, abs=1e-15)


def test_break_heights_of_a_pair_and_of_one_with_none():
    pair = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    apart = [[0.0, 0.0, 0.0], [9.0, 0.0, 0.5]]
    heights = break_heights(np.array([pair, apart]), np.ones((2, 2)))
    # equal unit spheres side by side: poles, and a ring of radius sqrt(3)/2 that stands upright
    ring = math.sqrt(0.75)
    # those poles and ends of the ring come once per sphere
    assert heights[0] == pytest.approx([-1.0, -1.0, -ring, ring, 1.0, 1.0], abs=1e-15)
    # spheres that do not meet have poles only; the row ends with NaN
    assert heights[1, :4] == pytest.approx([-1.0, -0.5, 1.0, 1.5], abs=1e-15)
    assert np.isnan(heights[1, 4:]).all()


def test_longest_link_is_that_of_each_body():
    centers = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [4.0, 0.0, 0.0]], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    longest = np.empty(2)
    longest_links(centers, np.ones((2, 3)), longest)
    assert longest.tolist() == [1.5, 0.5]
