"""Groups of close spots, solved by the kernel of the engine: their equations, thousands of random closed paths, any order."""

import numpy as np
import pytest
from each import each
from slow import slow
from spot_groups import Loads, closed_path, solved

RADIUS, DEPTH, STIFFNESS, COMPLIANCE = 1.0, 0.01, 4.0 / 3.0, 0.5
"""Radius and overlap of a spot; 4/3 E* and g times distance, of unlike solids: 1/(pi E*) would be 0.32."""
CONTACT = (RADIUS * DEPTH) ** 0.5


def group(random, n, spacing):
    """Places (n, 2) some contact radii apart, overlaps, some of them small, and radii."""
    while True:
        place = spacing * CONTACT * n**0.5 * random.uniform(-1.0, 1.0, (n, 2))
        apart = np.linalg.norm(place[:, None] - place[None], axis=2) + np.eye(n)
        if apart.min() > 2.0 * CONTACT:
            return place, DEPTH * random.uniform(0.02, 1.0, n), RADIUS * random.uniform(0.5, 1.5, n)


def solve(place, depth, radius, **keys) -> Loads:
    return solved(place, depth, radius, STIFFNESS, COMPLIANCE, **keys)


def miss(place, depth, radius, loads):
    """Largest violation of N = K (d - g N)^(3/2) over the largest force, and of relief = g N over the largest overlap."""
    apart = np.linalg.norm(place[:, None] - place[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    relief = (COMPLIANCE / apart) @ loads.force
    force = STIFFNESS * np.sqrt(radius) * np.maximum(depth - relief, 0.0) ** 1.5
    return np.abs(force - loads.force).max() / force.max(), np.abs(relief - loads.relief).max() / depth.max()


@each([1, 2, 3, 7])
def test_spots_solve_their_equations(n):
    """To rounding; one in some groups is relieved wholly. The sweeps agree, with and without scratch for g."""
    random, idle = np.random.default_rng(n), 0
    for k in range(0, 100, 10):
        place, depth, radius = group(random, n, 1.0 + 0.09 * k)
        found = solve(place, depth, radius)
        assert max(miss(place, depth, radius, found)) < 1e-13
        idle += int((found.force == 0.0).any())
        swept = solve(place, depth, radius, swept=True)
        assert found.force == pytest.approx(swept.force, rel=1e-11, abs=1e-13 * swept.force.max())
        again = solve(place, depth, radius, swept=True, scratch=0)
        assert np.array_equal(swept.force, again.force)
    assert n == 1 or idle > 0


@pytest.mark.parametrize(("n", "paths"), [(3, 20), *(slow(n, 700) for n in (2, 3, 5))])
def test_no_closed_path_makes_energy(n, paths):
    """Work along thousands of random closed paths of overlaps and places, spots coming and going, by the trapezoid rule.

    Smooth periodic integrands converge fast, the corner N ~ d^(3/2) of a spot that opens as the 5/2 power of the step.
    """
    random, idle, phase = np.random.default_rng(10 + n), 0, 2.0 * np.pi * np.arange(2048) / 2048
    waves = np.array([[np.sin(phase), np.cos(phase)], [0.5 * np.sin(2.0 * phase), 0.5 * np.cos(2.0 * phase)]])
    rates = 2.0 * np.pi * np.array([[np.cos(phase), -np.sin(phase)], [np.cos(2.0 * phase), -np.sin(2.0 * phase)]])
    worst = {2048: 0.0, 256: 0.0}
    for _ in range(paths):
        place, depth, radius = group(random, n, 6.0)
        sizes = random.normal(size=(n, 3, 2, 2)) * np.array([CONTACT / 6, CONTACT / 6, DEPTH / 4])[None, :, None, None]
        path, speed = np.einsum("nchp,hpt->tnc", sizes, waves), np.einsum("nchp,hpt->tnc", sizes, rates)
        path[:, :, :2] += place
        for points in worst:
            k = 2048 // points
            work, energy, none = closed_path(path[::k].copy(), speed[::k].copy(), depth, radius, STIFFNESS, COMPLIANCE)
            worst[points], idle = max(worst[points], abs(work) / energy), idle + none
    assert idle > 0.4 * paths and worst[2048] < 2e-6 and worst[2048] < worst[256] / 50.0


def test_the_order_of_spots_does_not_matter_and_forces_along_the_plate_cancel():
    random = np.random.default_rng(5)
    for n in (2, 3, 6):
        for _ in range(60):
            place, depth, radius = group(random, n, 3.0)
            order = random.permutation(n)
            one, other = solve(place, depth, radius), solve(place[order], depth[order], radius[order])
            assert one.force[order] == pytest.approx(other.force, rel=1e-11, abs=1e-13 * one.force.max())
            assert one.pull[order] == pytest.approx(other.pull, rel=1e-9, abs=1e-12 * np.abs(one.pull).max())
    # They act along the line between two spots, so their sum and their moment about the normal vanish.
    random = np.random.default_rng(6)
    for _ in range(60):
        place, depth, radius = group(random, 3, 3.0)
        pull = solve(place, depth, radius).pull
        size = np.abs(pull).max()
        assert np.abs(pull.sum(axis=0)).max() <= 1e-13 * size
        assert abs((place[:, 0] * pull[:, 1] - place[:, 1] * pull[:, 0]).sum()) <= 1e-13 * size * np.abs(place).max()
