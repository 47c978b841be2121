"""The order in which a run keeps its bodies: nothing is lost, it depends on the bodies alone, and neighbours stay together."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from thirdbody.engine.spatial_order import FEWEST, WIDTH, in_columns
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.rigid_body import BODIES

DIAMETER = 2e-5


def layer(count: int, seed: int = 1) -> np.ndarray:
    """Places (count, 3) of bodies in a layer four diameters thick and as dense as debris, anywhere in the plane, m."""
    side = DIAMETER * np.sqrt(count / (4.0 * 1.1))
    return np.random.default_rng(seed).uniform(0.0, 1.0, (count, 3)) * (side, side, 4.0 * DIAMETER) - (3e-4, 1e-5, 0.0)


def share_within_groups(positions: np.ndarray, order: np.ndarray) -> float:
    """Share of the pairs of near bodies that are of one group."""
    pairs = cKDTree(positions).query_pairs(DIAMETER, output_type="ndarray")
    group = np.empty(len(order), int)
    group[order] = np.arange(len(order)) // (GROUP * BODIES)
    return float(np.mean(group[pairs[:, 0]] == group[pairs[:, 1]]))


@pytest.mark.parametrize("count", [0, 1, FEWEST, FEWEST + 1, 3000])
def test_every_body_has_one_place(count):
    order = in_columns(layer(count), DIAMETER)
    assert np.array_equal(np.sort(order), np.arange(count))
    assert (count > FEWEST) != np.array_equal(order, np.arange(count))  # the bodies of one group stay as they are


def test_the_same_for_the_same_bodies_however_they_are_reported():
    bodies = layer(3000)
    order = in_columns(bodies, DIAMETER)
    assert np.array_equal(order, in_columns(bodies.copy(), DIAMETER))
    mixed = np.random.default_rng(2).permutation(len(bodies))
    assert np.array_equal(bodies[order], bodies[mixed][in_columns(bodies[mixed], DIAMETER)])


def test_bodies_at_the_same_place_keep_their_order():
    twice = np.repeat(layer(600), 2, axis=0)
    order = in_columns(twice, DIAMETER)
    assert np.array_equal(order[1::2], order[::2] + 1) and np.all(order[::2] % 2 == 0)


@pytest.mark.parametrize("count", [2000, 20_000])
def test_neighbours_are_of_one_group(count):
    bodies = layer(count)
    scattered = share_within_groups(bodies, np.random.default_rng(3).permutation(count))
    found = share_within_groups(bodies, in_columns(bodies, DIAMETER))
    assert scattered == pytest.approx(GROUP * BODIES / count, rel=0.15)  # chance, of some thousand pairs
    # 512 of these bodies fill a square of 11 diameters; near pairs are 3/8 of a diameter apart along an axis, so its sides part
    # one in fifteen of them; a stretch of the curve has a border of less than twice that of the square
    assert found > 0.8


def test_columns_go_along_the_curve_and_from_below():
    """On a lattice of columns: the place of a column has the bits of its two numbers in turn."""
    width, side = WIDTH * DIAMETER, 16
    i, j, k = (axis.ravel() for axis in np.meshgrid(np.arange(side), np.arange(side), np.arange(3), indexing="ij"))
    bodies = np.column_stack(((i + 0.5) * width, (j + 0.5) * width, k * DIAMETER))
    bodies[0, :2] = 0.0  # the corner from which columns are counted
    curve = [int("".join(b + a for a, b in zip(f"{x:05b}", f"{y:05b}", strict=True)), 2) for x, y in zip(i, j, strict=True)]
    expected = sorted(range(len(bodies)), key=lambda body: (curve[body], k[body]))
    assert in_columns(bodies, DIAMETER).tolist() == expected


def test_a_body_very_far_away_is_the_last():
    bodies = layer(2 * FEWEST)
    bodies[7] = 1e6, 1e6, 0.0
    order = in_columns(bodies, DIAMETER)
    assert np.array_equal(np.sort(order), np.arange(2 * FEWEST)) and order[-1] == 7
