"""The search against all pairs, one by one: every pair within reach and skin once, sorted, in grids of few and of many cells."""

import numpy as np
import pytest

from thirdbody.kernels.neighbour_search import Grid, Spheres, pair_candidates
from thirdbody.kernels.tables import EVERYTHING, ONLY_LOWER, sphere

SKIN = 0.1
LARGEST = 0.5
REACH = 2.0 * LARGEST + SKIN


def spheres(n, box, seed, each=1):
    rng = np.random.default_rng(seed)
    S = np.zeros((n, sphere.WIDTH))
    S[:, : sphere.RADIUS] = rng.uniform(0.0, 1.0, (n, 3)) * box
    S[:, sphere.RADIUS] = rng.uniform(0.2, 1.0, n) * LARGEST
    S[0, sphere.RADIUS] = LARGEST
    side = np.where(rng.uniform(size=n) < 0.1, ONLY_LOWER, EVERYTHING).astype(np.int8)
    return S, Spheres(np.arange(n) // each, side)


def found(S, of, box, periodic, room):
    """The pairs (k, 2) of the search in cells that are as small as they may be, behind three slots that are there already."""
    low, count = np.zeros(3), np.maximum((np.array(box) / REACH).astype(np.int64), 1)
    own, partner = np.full(room, -7, np.int32), np.full(room, -7, np.int32)
    lengths = [box[k] if periodic[k] else 0.0 for k in (0, 1)]
    n = pair_candidates(S, of, SKIN, Grid(low, np.array(box) / count, count, np.array(periodic), *lengths), 3, own, partner)
    assert np.all(own[:3] == -7) and np.all(partner[:3] == -7)
    return np.column_stack((own, partner))[3:n] if n <= room else np.full((n - 3, 2), -1)


def expected(S, of, box, periodic):
    i, j = np.triu_indices(len(S), 1)
    d = S[i, : sphere.RADIUS] - S[j, : sphere.RADIUS]
    for k in (0, 1):
        d[:, k] -= box[k] * np.rint(d[:, k] / box[k]) if periodic[k] else 0.0
    near = np.sum(d * d, axis=1) < (S[i, sphere.RADIUS] + S[j, sphere.RADIUS] + SKIN) ** 2
    both = (of.side[i] == EVERYTHING) & (of.side[j] == EVERYTHING)
    keep = near & both & (of.body[i] != of.body[j])
    return np.column_stack((i[keep], j[keep]))


@pytest.mark.parametrize("periodic", [(True, True), (True, False), (False, False)])
def test_every_pair_is_found_once_and_in_order(periodic):
    for cells in ((2, 2, 1), (2, 3, 1), (3, 2, 2), (3, 3, 3), (4, 5, 1), (5, 2, 4)):
        for seed, spheres_per_body in enumerate((1, 1, 3)):
            box = tuple(1.05 * REACH * n for n in cells)
            S, of = spheres(60, box, seed, spheres_per_body)
            pairs = found(S, of, box, periodic, 4000)
            assert np.array_equal(pairs, expected(S, of, box, periodic)) and len(pairs) > 10


def test_one_cell_is_enough_and_spheres_beyond_the_grid_are_found_in_its_outermost_cells():
    S, of = spheres(9, (1.0, 1.0, 1.0), 1)
    assert np.array_equal(found(S, of, (1.0, 1.0, 1.0), (False, False), 100), expected(S, of, (1.0,) * 3, (False, False)))
    box = (4.0, 4.0, 4.0)
    S, of = spheres(80, box, 2)
    S[:, : sphere.RADIUS] = 1.3 * S[:, : sphere.RADIUS] - 0.6
    assert np.array_equal(found(S, of, box, (False, False), 4000), expected(S, of, box, (False, False)))


def test_too_little_space_is_reported_and_no_spheres_have_no_pairs():
    box = (4.0, 4.0, 4.0)
    S, of = spheres(80, box, 3)
    for room in (3, 4, 20):
        assert len(found(S, of, box, (True, True), room)) == len(expected(S, of, box, (True, True))) > 20
    none = Spheres(np.zeros(0, np.int64), np.zeros(0, np.int8))
    assert found(np.zeros((0, sphere.WIDTH)), none, box, (True, True), 10).shape == (0, 2)
