"""The shear zone of a bed: exact for plane Couette flow, found in a band, at least a grain thick."""

import math

import numpy as np
import pytest

from thirdbody.trajectory.bed_measures import EDGE, rising_profile, shear_zone

HEIGHT, D, SPEED = 100e-6, 10e-6, 2.0


def bodies(n=500):
    rng = np.random.default_rng(1)
    return np.sort(rng.uniform(0.0, HEIGHT, n)), rng.uniform(1.0, 3.0, n)


def flow(along, angle=0.3):
    """Velocities of that size in one direction, on a common drift."""
    return along[:, None] * [math.cos(angle), math.sin(angle), 0.0] + [0.4, -0.1, 0.05]


def test_plane_couette_flow_is_exact():
    (z, mass), rate = bodies(), SPEED / HEIGHT
    low, high = (np.average(z[end], weights=mass[end]) for end in (z <= z[0] + D, z >= z[-1] - D))
    edges = [low + fraction * (high - low) for fraction in (EDGE, 1.0 - EDGE)]
    for angle in (0.0, 0.3, math.pi, -2.0):
        zone = shear_zone(z, flow(rate * z, angle), mass, D)
        assert zone.rate == pytest.approx(rate, rel=1e-11)  # rounding of differences of velocities
        assert [zone.bottom, zone.top] == pytest.approx(edges, rel=1e-11)


def test_a_band_is_found_where_it_is():
    z, mass = bodies(5000)
    bottom, top = 30e-6, 60e-6
    along = SPEED * np.clip((z - bottom) / (top - bottom), 0.0, 1.0)
    zone = shear_zone(z, flow(along), mass, D)
    # plateaus and the band are straight lines: only the neighbours of an edge are interpolated
    assert zone.rate == pytest.approx(SPEED / (top - bottom), rel=1e-9)
    assert [zone.bottom, zone.top] == pytest.approx([33e-6, 57e-6], rel=1e-9)


def test_two_blocks_that_slide_shear_over_one_diameter():
    z, mass = bodies()
    zone = shear_zone(z, flow(np.where(z > 0.37 * HEIGHT, SPEED, 0.0)), mass, D)
    assert zone.rate == pytest.approx(SPEED / D, rel=1e-12)
    assert zone.top - zone.bottom < 0.1 * D and zone.bottom == pytest.approx(0.37 * HEIGHT, rel=0.02)
    # a bed that moves as a whole has no rate, one layer no zone
    assert shear_zone(z, flow(np.zeros(len(z))), mass, D).rate == pytest.approx(0.0, abs=1e-9)
    assert shear_zone(0.1 * z, flow(z), mass, D) is None
    # the profile never falls and is the nearest one
    values = np.array([1.0, 3.0, 2.0, 2.0, 5.0, 4.0])
    weights = np.array([1.0, 2.0, 1.0, 1.0, 3.0, 1.0])
    pooled = [1.0, 2.5, 2.5, 2.5, 4.75, 4.75]  # means of the runs that fall, by weight
    assert rising_profile(values, weights) == pytest.approx(pooled, rel=1e-14)
