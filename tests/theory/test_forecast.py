"""The compiled forecast against `hull_conditions`, an independent method, and its answers where that refuses."""

import math

import hull_conditions
import numpy as np
import pytest
from thirdbody_three_spot.forecast import forecast

# differences of places of order 1, divided by crossing angles that may be small; h is .3 or more
APPROX = {"rel": 1e-9, "abs": 1e-11}
NOTHING = (math.inf, math.inf, -math.inf)


def forecast_of(upper, lower, h, e):
    upper, lower = np.array(upper, dtype=float).reshape(-1, 2), np.array(lower, dtype=float).reshape(-1, 2)
    return forecast(upper, len(upper), lower, len(lower), float(h), float(e[0]), float(e[1]))


def expect(upper, lower, h, e):
    return hull_conditions.required_friction(upper, lower, h), *hull_conditions.sliding_interval(upper, lower, h, e)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.full(kind="slow")) for k in range(1, 8))])
def test_random_bodies(seed):
    random = np.random.default_rng(seed)
    sliding = 0
    for _ in range(250):
        total = random.integers(3, 13)
        above = random.integers(1, total)
        places = random.uniform(-1.0, 1.0, (total, 2))
        places[:above] += random.uniform(-1.0, 1.0, 2)
        angle, h, unit = random.uniform(0.0, 2.0 * math.pi), random.uniform(0.3, 3.0), 10.0 ** random.uniform(-7.0, 0.0)
        case = (places[:above] * unit, places[above:] * unit, h * unit, (math.cos(angle), math.sin(angle)))
        ours = forecast_of(*case)
        assert ours == pytest.approx(expect(*case), **APPROX)
        sliding += ours[1] <= ours[2]
    assert 40 < sliding < 240  # both outcomes occur


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.full(kind="slow")) for k in range(1, 4))])
def test_bodies_on_a_grid_have_ties_lines_and_coincidences(seed):
    """Whole numbers: hulls share lines with the drag, corners stand exactly on it, spots coincide."""
    random = np.random.default_rng(50 + seed)
    for _ in range(250):
        upper, lower = (random.integers(0, 4, (random.integers(1, 6), 2)).astype(float) for _ in range(2))
        e = random.integers(-2, 3, 2)
        if e.any():
            assert forecast_of(upper, lower, 2.0, e) == pytest.approx(expect(upper, lower, 2.0, e), **APPROX)


def test_samples():
    assert forecast_of([(1.2, 0.4)], [(-1, 0), (1, 0), (0, 1.2)], 2.0, (-3, 1)) == pytest.approx(
        (0.204859007892633558, 0.389203404328415918, 0.769945865084474968), rel=1e-13
    )
    assert forecast_of([(0, 1), (0, -1)], [(0.6, 0), (1.4, 0)], 1.5, (1, 0)) == pytest.approx((0.4, 0.4, 1.4 / 1.5), rel=1e-13)
    # two above and one below slide at one friction or never
    upper, lower = [(0, 0), (0, 1)], [(1, 0.5)]
    assert forecast_of(upper, lower, 2.0, (1, 0)) == pytest.approx((0.5, 0.5, 0.5), rel=1e-14)
    assert forecast_of(upper, lower, 2.0, (0, 1)) == pytest.approx((0.5, math.inf, -math.inf))
    # turned by any angle the answer stays: the tolerance is of the size of the patch
    for angle in np.linspace(0.1, 6.2, 40):
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        case = (np.array(upper) @ turn.T * 1e-6, np.array(lower) @ turn.T * 1e-6, 2e-6, turn @ (2.0, 1.0))
        assert forecast_of(*case) == pytest.approx((0.5, math.sqrt(5.0) / 4.0, math.sqrt(5.0) / 4.0), rel=1e-12)


def test_what_hulls_refuse_has_an_answer():
    assert forecast_of([], [(0, 0)], 1.0, (1, 0)) == NOTHING
    assert forecast_of([(0, 0)], [], 1.0, (1, 0)) == NOTHING
    assert forecast_of([(0, 0)], [(1, 0)], 0.0, (1, 0)) == forecast_of([(0, 0)], [(1, 0)], -1.0, (1, 0)) == NOTHING
    assert forecast_of([(0, 0)], [(3, 4)], 2.0, (0, 0)) == (2.5, math.inf, -math.inf)
    assert forecast_of([(0.1, 0.1)], [(0, 0), (1, 0), (0, 1)], 2.0, (0, 0)) == (0.0, math.inf, -math.inf)
    assert forecast_of([(0.1, 0.1)], [(0.1, 0.1)], 2.0, (1, 0)) == (0.0, 0.0, 0.0)
    # rows beyond the counts and further columns are not read
    upper, lower = np.full((5, 3), np.nan), np.full((6, 3), np.nan)
    upper[0, :2] = (1.2, 0.4)
    lower[:3, :2] = [(-1, 0), (1, 0), (0, 1.2)]
    plain = forecast_of(upper[:1, :2], lower[:3, :2], 2.0, (-1, 0))
    assert forecast(upper, 1, lower, 3, 2.0, -1.0, 0.0) == plain
    assert forecast(upper, 1, lower, 3, 2.0, -7.0, 0.0) == pytest.approx(plain, rel=1e-15)  # any length of the drag
