"""Bodies scattered in a volume, against all pairs with all images."""

import itertools

import numpy as np
import pytest

from thirdbody.bodies.clump import clump
from thirdbody.bodies.irregular_clumps import population
from thirdbody.bodies.packing import scatter
from thirdbody.errors import InputError
from thirdbody.rotations import matrix_from_quaternion

SIZE, HEIGHT = (60e-6, 50e-6), 70e-6


@pytest.fixture(scope="module")
def bodies():
    size = {"distribution": "lognormal", "median": 1e-5, "sigma": 0.3, "min": 4e-6, "max": 2e-5}
    return population(1, 0, 30, (3, 5), (1.0, 0.8, 0.6), **size)


def world(clumps, x, q):
    rows = [np.column_stack((b.centers @ matrix_from_quaternion(t).T + p, b.radii)) for b, p, t in zip(clumps, x, q, strict=True)]
    return np.vstack(rows), np.repeat(np.arange(len(clumps)), [len(b.radii) for b in clumps])


def least_gap(spheres, ids, periodic):
    """Least gap over the sum of radii between spheres of different bodies, or of a body and its own image."""
    closest = np.inf
    for image in itertools.product((-1, 0, 1), repeat=2) if periodic else [(0, 0)]:
        d = spheres[:, None, :3] - spheres[:, :3] + (image[0] * SIZE[0], image[1] * SIZE[1], 0.0)
        reach = spheres[:, None, 3] + spheres[:, 3]
        other = (ids[:, None] != ids) if image == (0, 0) else np.ones_like(reach, bool)
        closest = min(closest, ((np.linalg.norm(d, axis=2) - reach) / reach)[other].min())
    return closest


def test_scattered_bodies_keep_clear_and_are_reproducible(bodies):
    for periodic in (True, False):
        x, q = scatter(bodies, HEIGHT, SIZE, periodic, np.random.default_rng(3))
        spheres, ids = world(bodies, x, q)
        assert least_gap(spheres, ids, periodic) >= 1e-3 * (1.0 - 1e-9)  # the clearance promised, to rounding
        low, high = spheres[:, :3] - spheres[:, 3:], spheres[:, :3] + spheres[:, 3:]
        for axis, most in enumerate((*SIZE, HEIGHT)):
            if axis == 2 or not periodic:
                assert low[:, axis].min() > 0.0 and high[:, axis].max() < most
        assert (x[:, :2] >= 0.0).all() and (x[:, :2] < SIZE).all()
        assert np.linalg.norm(q, axis=1) == pytest.approx(1.0, rel=1e-14)
    first, same, other = (scatter(bodies, HEIGHT, SIZE, True, np.random.default_rng(s)) for s in (1, 1, 2))
    assert np.array_equal(first[0], same[0]) and np.array_equal(first[1], same[1])
    assert not np.array_equal(first[0], other[0])


def test_the_whole_volume_is_used_in_every_turn():
    # 400 small balls with a mark: means of uniform numbers scatter by sqrt(1/12/400) = 0.014, four times that is allowed.
    rod = [clump([[0.0, 0, 0], [0.01, 0, 0]], [0.01, 0.01])] * 400
    x, q = scatter(rod, 3.0, (2.0, 2.0), True, np.random.default_rng(0))
    assert (x / (2.0, 2.0, 3.0)).mean(axis=0) == pytest.approx(0.5, abs=0.06)
    axes = np.array([matrix_from_quaternion(turn)[:, 0] for turn in q])
    # along each direction the mean square of a random unit vector is 1/3, its scatter sqrt(4/45/400) = 0.015
    assert (axes**2).mean(axis=0) == pytest.approx(1.0 / 3.0, abs=0.06)
    # Random addition of balls jams at 0.384 (Torquato, Uche and Stillinger 2006): 0.6 is out of reach.
    height = 30 * np.pi / 6.0 / 0.6 / 9.0
    with pytest.raises(InputError, match=r"\d+ of 30 bodies placed, solid fraction 0\.[1-4]\d* reached of 0\.600 wanted"):
        scatter([clump([[0, 0, 0]], [0.5])] * 30, height, (3.0, 3.0), True, np.random.default_rng(0))
    rod = clump([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]], [0.6] * 3)
    with pytest.raises(InputError, match="own image"):
        scatter([rod], 10.0, (10.0, 3.0), True, np.random.default_rng(0))
    scatter([rod], 10.0, (10.0, 3.3), True, np.random.default_rng(0))


def test_what_is_there_already_stays_free(bodies):
    # a ball that fills the middle of the volume; without it some body would lie there: it takes a sixth of the volume
    standing = np.array([[30e-6, 25e-6, 35e-6, 20e-6]])
    for given, low, high in (((standing,), 1e-3 * (1.0 - 1e-9), np.inf), ((), -np.inf, 0.0)):
        spheres, ids = world(bodies, *scatter(bodies, HEIGHT, SIZE, True, np.random.default_rng(4), *given))
        assert low <= least_gap(np.vstack((spheres, standing)), np.append(ids, len(bodies)), True) < high
