"""Random layers without overlap, and overlaps of given starts, against all pairs with all images."""

import itertools
import re

import numpy as np
import pytest

from thirdbody.bodies.clump import clump, matrix_from_quaternion
from thirdbody.bodies.irregular_clumps import population
from thirdbody.bodies.layer_packing import overlaps, place_layer, projected_area
from thirdbody.bodies.resting_poses import settle
from thirdbody.errors import InputError

COUNT = 30


@pytest.fixture(scope="module")
def bodies():
    size = {"distribution": "lognormal", "median": 1e-5, "sigma": 0.3, "min": 4e-6, "max": 3e-5}
    clumps = population(1, 0, COUNT, (3, 5), [1.0, 0.8, 0.6], **size)
    rng = np.random.default_rng(2)
    return clumps, np.array([settle(body, rng)[0] for body in clumps])


def world(clumps, quaternions, xy):
    rows, ids = [], []
    for k, (body, quaternion) in enumerate(zip(clumps, quaternions, strict=True)):
        centers = body.centers @ matrix_from_quaternion(quaternion).T
        centers[:, 2] -= (centers[:, 2] - body.radii).min()
        centers[:, :2] += xy[k]
        rows.append(np.column_stack((centers, body.radii)))
        ids += [k] * len(body.radii)
    return np.vstack(rows), np.array(ids)


def brute_force(spheres, ids, size, periodic):
    """Least gap over the sum of radii, and the overlaps of bodies, from all pairs and all near images."""
    images = list(itertools.product((-1, 0, 1), repeat=2)) if periodic else [(0, 0)]
    closest, found = np.inf, {}
    for i in range(len(spheres)):
        for j in range(len(spheres)):
            if ids[i] >= ids[j]:
                continue
            for ix, iy in images:
                shift = (ix * size[0], iy * size[1], 0.0)
                reach = spheres[i, 3] + spheres[j, 3]
                gap = np.linalg.norm(spheres[i, :3] - spheres[j, :3] + shift) - reach
                closest = min(closest, gap / reach)
                if gap < 0.0:
                    pair = (int(ids[i]), int(ids[j]))
                    found[pair] = max(found.get(pair, 0.0), -gap)
    return closest, found


def domain(clumps, quaternions, fraction):
    spheres, ids = world(clumps, quaternions, np.zeros((len(clumps), 2)))
    area = sum(projected_area(spheres[ids == k]) for k in range(len(clumps)))
    side = np.sqrt(area / fraction)
    return 1.25 * side, side / 1.25


@pytest.mark.parametrize("periodic", [True, False])
def test_layer_keeps_clear(bodies, periodic):
    size = domain(*bodies, 0.4)
    xy = place_layer(*bodies, size, periodic, np.random.default_rng(3))
    assert xy.shape == (COUNT, 2) and (xy >= 0.0).all() and (xy < size).all()
    spheres, ids = world(*bodies, xy)
    closest, _ = brute_force(spheres, ids, size, periodic)
    assert closest >= 1e-3 * (1.0 - 1e-9)  # the clearance promised, to rounding
    if not periodic:
        assert (spheres[:, :2] - spheres[:, 3:] > 0.0).all()
        assert (spheres[:, :2] + spheres[:, 3:] < size).all()
    assert overlaps(spheres[:, :3], spheres[:, 3], ids, size, periodic) == []


def test_near_misses_keep_the_clearance():
    # Of some 250 neighbours in a crowded layer one would be nearer than 1e-3 by chance: five in four layers.
    balls, side = [clump([[0, 0, 0]], [0.5])] * 100, np.sqrt(100 * np.pi * 0.25 / 0.5)
    for seed in range(4):
        unit = np.tile([1.0, 0, 0, 0], (100, 1))
        xy = place_layer(balls, unit, (side, side), True, np.random.default_rng(seed))
        d = xy[:, None] - xy
        d -= side * np.round(d / side)
        gap = np.linalg.norm(d, axis=2)[np.triu_indices(100, 1)] - 1.0
        assert 1e-3 * (1.0 - 1e-9) < gap.min() < 1e-2


def test_layer_is_reproducible(bodies):
    size = domain(*bodies, 0.3)
    first, same, other = (place_layer(*bodies, size, True, np.random.default_rng(s)) for s in (1, 1, 2))
    assert np.array_equal(first, same) and not np.array_equal(first, other)


def test_flat_bodies_may_lie_under_round_ones():
    # The overhang of a large sphere has room for a small one: no disc packing finds this place.
    large, small = clump([[0, 0, 0]], [1.0]), clump([[0, 0, 0]], [0.1])
    unit = np.array([[1.0, 0, 0, 0]] * 2)
    size = (2.01, 2.01)
    for seed in range(20):
        xy = place_layer([small, large], unit, size, True, np.random.default_rng(seed))
        d = xy[0] - xy[1]
        d -= np.array(size) * np.round(d / size)
        if np.linalg.norm(d) < 1.0:
            break
    assert np.hypot(np.linalg.norm(d), 0.9) >= 1.1 * 1.001
    assert np.linalg.norm(d) < 1.0


def test_a_full_domain_is_refused():
    # Random addition of discs jams at a fraction of 0.547 (Feder 1980): 0.7 is out of reach.
    balls = [clump([[0, 0, 0]], [0.5])] * 40
    side = np.sqrt(40 * np.pi * 0.25 / 0.7)
    with pytest.raises(InputError) as caught:
        place_layer(balls, np.tile([1.0, 0, 0, 0], (40, 1)), (side, side), True, np.random.default_rng(0))
    text = str(caught.value)
    placed, reached = re.search(r"(\d+) of 40 bodies placed, area fraction ([0-9.]+) reached", text).groups()
    placed = int(placed)
    assert 20 <= placed < 40
    assert float(reached) == pytest.approx(placed / 40 * 0.7, abs=6e-4)  # printed with three digits
    assert "domain.size" in text and "count" in text


def test_a_body_wider_than_the_domain_is_refused_and_none_needs_no_place():
    with pytest.raises(InputError, match="does not fit"):
        place_layer([clump([[0, 0, 0]], [1.0])], np.array([[1.0, 0, 0, 0]]), (5.0, 1.9), True, np.random.default_rng(0))
    assert place_layer([], np.zeros((0, 4)), (1.0, 1.0), True, np.random.default_rng(0)).shape == (0, 2)


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("size", [(3.0, 2.5), (20.0, 15.0)])
def test_overlaps_of_a_random_start(periodic, size):
    rng = np.random.default_rng(6)
    n = 60
    # Positions outside the domain count by their images when periodic.
    centers = rng.uniform(-0.5, 1.5, (n, 3)) * (*size, 2.0)
    radii = rng.uniform(0.1, 0.6, n)
    ids = rng.integers(0, 20, n)
    folded = centers - np.floor(centers / (*size, np.inf)) * (*size, 0.0) if periodic else centers
    found = overlaps(centers, radii, ids, size, periodic)
    _, expected = brute_force(np.column_stack((folded, radii)), ids, size, periodic)
    assert {row[:2] for row in found} == set(expected)
    for a, b, overlap in found:
        assert overlap == pytest.approx(expected[a, b], rel=1e-9, abs=1e-12)  # rounding of the images
    assert [row[2] for row in found] == sorted((row[2] for row in found), reverse=True)


def test_all_overlaps_are_reported_but_touching_is_none_and_one_body_has_none():
    n = 60  # 1770 pairs, more than the first table holds
    found = overlaps(np.zeros((n, 3)), np.ones(n), np.arange(n), (9.0, 9.0), False)
    assert len(found) == n * (n - 1) // 2 and all(row[2] == 2.0 for row in found)
    touching = np.array([[0.0, 0, 0], [2.0, 0, 0]])
    assert overlaps(touching, np.ones(2), np.array([0, 1]), (9.0, 9.0), True) == []
    assert overlaps(0.5 * touching, np.ones(2), np.array([0, 0]), (9.0, 9.0), True) == []
    assert overlaps(np.zeros((0, 3)), np.zeros(0), np.zeros(0), (9.0, 9.0), True) == []


def test_projected_area_counts_once():
    assert projected_area(np.array([[3.0, 2, 1, 2], [3, 2, 9, 1]])) == pytest.approx(4.0 * np.pi, rel=1e-14)
    pair = projected_area(np.array([[0, 0, 0, 1.0], [1, 0, 5, 1.0]]))
    # two unit discs one radius apart: 2 pi less the lens 2 pi/3 - sqrt(3)/2
    assert pair == pytest.approx(4.0 * np.pi / 3.0 + np.sqrt(3.0) / 2.0, rel=1e-14)
