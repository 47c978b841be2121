"""Islands and times that are expected before a run: what they depend on, and that no clock decides."""

from __future__ import annotations

import math

import pytest
from balls import BALLS, edited

from thirdbody.assembly.simulation import build
from thirdbody.scene.model import Scene

GAPS = (0.5, 1.2, 3.0, 1.0)
"""Of five balls in a row, um; bodies could meet within a quarter of the radius, 1.25 um."""

CENTRES = [10.0 + 10.0 * k + sum(GAPS[:k]) for k in range(5)]
ROW = ", ".join(f'["{x} um", "30 um", "5 um"]' for x in CENTRES)
SCENE = edited(BALLS, ("count = 4\nseed = 1", f"positions = [{ROW}]"), ('velocity = "0.5 m/s"', 'velocity = "10 mm/s"'))

ONE_PLATE, NONE = ("load_per_particle", "rigid"), ("[solver]", '[contact]\ndebris_contact = "none"\n[solver]')


def plan(*changes):
    return build(Scene.parse(edited(SCENE, *changes))).plan


def test_islands_are_the_bodies_that_could_meet():
    """Three in a row and two: a fifth of 9 + 4 is 2.6 bodies on average at the start; they grow by 1.3 and, the largest, by 2."""
    islands = plan().islands
    assert islands.stride == pytest.approx(1.25e-6)
    assert islands.area_fraction == pytest.approx(5.0 * math.pi * 25.0 / (80.0 * 60.0))
    assert islands.fraction_of_bodies == 1.0
    assert islands.mean == pytest.approx(1.0 + 1.3 * 1.6) and islands.largest == 5


def test_bodies_that_do_not_meet_are_alone():
    islands = plan(NONE).islands
    assert (islands.fraction_of_bodies, islands.mean, islands.largest, islands.stride) == (0.0, 1.0, 1, math.inf)


def test_only_the_explicit_time_grows_with_the_time_of_the_drag():
    """Ten times as slow: ten times as many explicit steps of the drag, of 10 us after 1 us of settling; as many implicit ones."""
    fast, slow = plan().times, plan(("10 mm/s", "1 mm/s")).times
    assert slow.explicit / fast.explicit == pytest.approx(101.0 / 11.0, rel=1e-9)
    assert slow.implicit == pytest.approx(fast.implicit, rel=0.05)  # inertia counts a little


def test_larger_islands_and_smaller_tolerances_cost_more():
    here = plan().times.implicit
    assert plan(('"5 um"]]', '"5 um"], ["10 um", "40.5 um", "5 um"]]')).times.implicit > 1.2 * here
    assert plan(("[solver]", "[solver]\ntolerance = 1e-5")).times.implicit > 1.5 * here


def test_bodies_that_carry_one_plate_take_the_steps_of_the_most_restless():
    """More of them cost more than with loads of their own; explicit steps, and who could meet, do not depend on the plate."""
    more = ('"5 um"]]', '"5 um"], ["10 um", "10 um", "5 um"], ["70 um", "10 um", "5 um"], ["10 um", "50 um", "5 um"]]')
    own, one, apart = plan(), plan(ONE_PLATE), plan(ONE_PLATE, NONE)
    assert one.times.implicit > own.times.implicit and one.times.explicit == pytest.approx(own.times.explicit, rel=0.1)
    assert one.islands == own.islands
    assert apart.times.implicit < one.times.implicit
    eight = plan(ONE_PLATE, NONE, more).times.implicit / plan(NONE, more).times.implicit
    assert eight > apart.times.implicit / plan(NONE).times.implicit


def test_the_choice_is_made_of_the_scene_alone():
    assert plan() == plan()
