"""The compiled forecast in numbers, against `hull_conditions`, an independent method, and where that refuses.

P is the upper side, Q the lower one.
"""

import math

import hull_conditions
import numpy as np
import pytest
from thirdbody_three_spot.forecast import forecast

# differences of places of order 1, divided by crossing angles that may be small; h is .3 or more
APPROX = {"rel": 1e-9, "abs": 1e-11}
NOTHING = (math.inf, math.inf, -math.inf)


TRIANGLE = (((1.2, 0.4),), ((-1.0, 0.0), (1.0, 0.0), (0.0, 1.2)), 2.0)
CROSSED = (((0.0, 1.0), (0.0, -1.0)), ((0.6, 0.0), (1.4, 0.0)), 1.5)
SEGMENT = (((0.0, 0.0), (0.0, 1.0)), ((1.0, 0.5),), 2.0)
PAIR = (((0.3, 0.4),), ((0.0, 0.0),), 2.0)


INTERVALS = [
    (TRIANGLE, (-1.0, 0.0), (4.0 / 15.0, 14.0 / 15.0)),  # Q at y = .4 reaches from -2/3 to 2/3
    (TRIANGLE, (0.0, 1.0), hull_conditions.NEVER),
    # (1.2 - 3 s, .4 + s) meets the sides of Q at s = .64/2.6 and 2.24/4.6; t = s sqrt(10)/2
    (TRIANGLE, (-3.0, 1.0), (0.389203404328415918, 0.769945865084474968)),
    (CROSSED, (1.0, 0.0), (0.4, 1.4 / 1.5)),
    (CROSSED, (-1.0, 0.0), (-1.4 / 1.5, -0.4)),
    (CROSSED, (2.0, 2.0), (0.6 * math.sqrt(2.0) / 1.5, math.sqrt(2.0) / 1.5)),  # {q - p} = [.6, 1.4] x [-1, 1]
    (CROSSED, (0.0, 1.0), hull_conditions.NEVER),
    (SEGMENT, (1.0, 0.0), (0.5, 0.5)),  # {q - p} is the segment x = 1, |y| <= .5: one friction only
    (SEGMENT, (2.0, 1.0), (math.sqrt(5.0) / 4.0, math.sqrt(5.0) / 4.0)),  # its end
    (SEGMENT, (2.0, 1.01), hull_conditions.NEVER),
    (SEGMENT, (0.0, 1.0), hull_conditions.NEVER),
    (PAIR, (-3.0, -4.0), (0.25, 0.25)),
    (PAIR, (-1.0, 0.0), hull_conditions.NEVER),
]


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
    # from the line 1.2 x + y = 1.2: .64/sqrt(2.44)/2; tan alpha of Eq. 16: .5/2
    required = {id(TRIANGLE): 0.204859007892633558, id(CROSSED): 0.4, id(SEGMENT): 0.5, id(PAIR): 0.25}
    for case, direction, interval in INTERVALS:
        ours = forecast_of(*case, direction)
        assert ours == pytest.approx((required[id(case)], *interval), rel=1e-13, abs=1e-14), (case, direction)
    assert forecast_of([(0.2, 0)], [(-2.0, 0), (1.5, 0)], 4.0, (-1, 0)) == pytest.approx((0.0, -0.325, 0.55), rel=1e-13)
    # turned by any angle the answer stays: the tolerance is of the size of the patch
    for angle in np.linspace(0.1, 6.2, 40):
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        case = (*(np.array(side) @ turn.T * 1e-6 for side in SEGMENT[:2]), 2e-6, turn @ (2.0, 1.0))
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
