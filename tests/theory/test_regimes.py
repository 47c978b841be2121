"""The regime map of theory against particles solved with full partial slip (level `exact`), pressed by a load and dragged."""

import pytest
from thirdbody_three_spot.regime_map import regime
from thirdbody_three_spot.regime_points import FRICTIONS, POSITIONS, computed_points

HALF = 0.5


@pytest.mark.full(kind="slow")
def test_every_computed_particle_does_what_the_map_says():
    points = computed_points(HALF)
    assert len(points) == len(POSITIONS) * len(FRICTIONS)
    for point in points:
        # the ends t_min = x - L, t_max = x + L and -t_max (over h): on them the answer is open
        if min(abs(point.y - (point.x + end)) for end in (-HALF, HALF)) < 1e-3 or abs(point.y + point.x + HALF) < 1e-3:
            continue
        assert point.state == regime(point.x, HALF, point.y), point
    assert {point.state for point in points} == {"rolling", "sticking", "sliding"}
