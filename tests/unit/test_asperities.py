"""Asperities stand out where planes touch; angular bodies are sharp there."""

import math

import numpy as np
import pytest

from thirdbody.bodies.asperities import Asperities, sphere_points, summit_radii, touched, with_asperities
from thirdbody.bodies.clump import Clump, clump
from thirdbody.bodies.irregular_clumps import irregular, population
from thirdbody.errors import InputError

SIZE = {"distribution": "lognormal", "median": 1e-5, "sigma": 0.2, "min": 5e-6, "max": 2e-5}
BALL = clump(np.zeros((1, 3)), [2.0])


def body(seed: int, n: int = 6) -> Clump:
    return irregular(np.random.default_rng(seed), n, [1.0, 0.8, 0.6], 1e-5)


@pytest.mark.parametrize("n, count, fraction", [(1, 3, 0.1), (6, 3, 0.1), (8, 12, 0.05), (4, 1, 0.5)])
def test_a_plane_touches_every_asperity_and_each_protrudes_by_its_radius(n, count, fraction):
    bare = body(1, n)
    rough = with_asperities(np.random.default_rng(2), bare, count, fraction)
    assert rough.diameter == pytest.approx(bare.diameter, rel=1e-12, abs=0.0)  # scaled to it: rounding of a cube root
    assert rough.radii[n:] == pytest.approx(0.5 * fraction * bare.diameter, rel=1e-12, abs=0.0)  # the iteration's end, 1e-14
    assert set(range(n, n + count)) <= set(touched(rough, sphere_points(20000)).tolist())
    # centres on the surface of the union: none inside another sphere, one sphere's surface at each
    gaps = np.linalg.norm(rough.centers[n:, None] - rough.centers[:n], axis=2) - rough.radii[:n]
    assert gaps.min(axis=1) == pytest.approx(np.zeros(count), abs=1e-12 * bare.diameter)  # rounding of coordinates


def test_mass_properties_are_those_of_the_union():
    """One small ball on a large one, against the closed forms of the lens (two caps) and its moments about the axis."""
    rough = with_asperities(np.random.default_rng(0), BALL, 1, 0.3)
    big, small = rough.radii
    x = big - small**2 / (2.0 * big)  # plane where they meet: the small centre lies on the large surface

    def solid(radius: float, low: float, high: float) -> tuple[float, float]:
        """Volume and axial moment of the part of a ball between two heights from its centre."""
        disc = np.polynomial.Polynomial([radius**2, 0.0, -1.0])
        volume, axial = (math.pi * disc).integ(), (0.5 * math.pi * disc**2).integ()
        return volume(high) - volume(low), axial(high) - axial(low)

    parts = solid(big, -big, x), solid(small, x - big, small)
    volume, axial = (a + b for a, b in zip(*parts, strict=True))
    assert rough.volume == pytest.approx(volume, rel=10.0 * rough.error + 1e-12)  # its own bound; rounding
    assert rough.inertia[0] == pytest.approx(axial, rel=10.0 * rough.error + 1e-12)


def test_places_are_spread():
    """Best of 12 candidates: three places on a ball lie farther apart than three by chance."""
    nearest = []
    for seed in range(40):
        rough = with_asperities(np.random.default_rng(seed), BALL, 3, 0.1)
        places = rough.centers[1:] - rough.centers[0]
        places /= np.linalg.norm(places, axis=1)[:, None]
        nearest.append(np.degrees(np.arccos((places @ places.T)[np.triu_indices(3, 1)])).min())
    # uniform chance gives 51 degrees on average, the best possible is 120; the least of 40 by chance falls below 10
    assert np.mean(nearest) > 75.0 and min(nearest) > 40.0


def test_the_body_below_is_the_one_without_and_no_body_depends_on_others():
    bare = population(1, 0, 4, (4, 6), [1, 0.8, 0.6], **SIZE)
    rough = population(1, 0, 4, (4, 6), [1, 0.8, 0.6], asperities=Asperities(3, radius=5e-7), **SIZE)
    for a, b in zip(bare, rough, strict=True):
        n = len(a.radii)
        assert len(b.radii) == n + 3 and b.diameter == pytest.approx(a.diameter, rel=1e-12, abs=0.0)
        assert b.radii[n:] == pytest.approx(5e-7, rel=1e-12, abs=0.0)  # a length stays that length
        assert b.radii[:n] / b.radii[0] == pytest.approx(a.radii / a.radii[0], rel=1e-14)  # one factor for all
    few = population(1, 0, 2, (4, 6), [1, 0.8, 0.6], asperities=Asperities(3, radius=5e-7), **SIZE)
    for a, b in zip(few, rough, strict=False):
        assert np.array_equal(a.centers, b.centers)


@pytest.mark.parametrize("wrong", [Asperities(3), Asperities(0, 1e-7), Asperities(3, 1e-5), Asperities(3, None, 0.6)])
def test_impossible_asperities_are_refused(wrong):
    with pytest.raises(InputError, match="asperities"):
        population(1, 0, 1, (4, 6), [1, 1, 1], asperities=wrong, **SIZE)


def test_no_angularity_is_the_body_as_ever():
    """Shapes of seeds that people have published: radii of the first version, over the diameter, to its printed digits."""
    radii = population(1, 0, 1, (5, 5), [1, 0.8, 0.6], distribution="constant", value=1e-5)[0].radii / 1e-5
    assert radii == pytest.approx([0.29637645, 0.36562493, 0.30504432, 0.24325043, 0.27823506], abs=5e-9)
    plain, none = body(3), irregular(np.random.default_rng(3), 6, [1.0, 0.8, 0.6], 1e-5, angularity=0.0)
    assert np.array_equal(plain.centers, none.centers) and np.array_equal(plain.radii, none.radii)


def sharpness(angularity: float, n: int, aspect) -> tuple[float, float]:
    """Mean radius where a plane touches over the equivalent radius, and shortest over longest extent."""
    made = [irregular(np.random.default_rng(k), n, aspect, 2.0, angularity) for k in range(20)]
    spans = [np.sort(np.ptp(np.stack([b.centers + s * b.radii[:, None] for s in (1, -1)]), axis=(0, 1))) for b in made]
    return float(np.mean([summit_radii(b).mean() for b in made])), float(np.mean([s[0] / s[2] for s in spans]))


@pytest.mark.parametrize("n, aspect, last", [(8, [1, 1, 1], 0.65), (8, [1, 0.8, 0.6], 0.8), (12, [1, 1, 1], 0.6)])
def test_summits_get_sharper_with_angularity_and_the_aspect_stays(n, aspect, last):
    values, spans = zip(*(sharpness(a, n, aspect) for a in (0.0, 0.5, 1.0)), strict=True)
    assert values[0] > values[1] > values[2]
    # Corners that planes touch alone would be about (1 - c)/(1 + c) < 0.4 of the core; some planes still meet the core.
    assert values[2] < last * values[0]
    assert spans[2] == pytest.approx(spans[0], abs=0.15)  # the blur of the aspect, as in test_aspect_shows


def test_few_spheres_draw_apart_only():
    plain, sharp = (sharpness(a, 3, [1, 1, 1])[0] for a in (0.0, 1.0))
    assert 0.85 * plain < sharp < plain


@pytest.mark.parametrize("angularity", [-0.1, 1.1, math.nan])
def test_angularity_out_of_range_is_refused(angularity):
    with pytest.raises(InputError, match="angularity"):
        irregular(np.random.default_rng(0), 6, [1, 1, 1], 1.0, angularity)
