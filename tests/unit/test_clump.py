"""Unions of spheres: mass properties against closed forms and counting; asperities stand out, angular bodies are sharp."""

import math

import numpy as np
import pytest

import thirdbody.bodies.clump as module
from thirdbody.bodies.asperities import Asperities, sphere_points, summit_radii, touched, with_asperities
from thirdbody.bodies.clump import Clump, clump, clump_with_frame, matrix_from_quaternion
from thirdbody.bodies.irregular_clumps import irregular, population
from thirdbody.bodies.union_moments import quadrature
from thirdbody.errors import InputError


def lumps(rng, n):
    """A connected clump: each sphere overlaps the one before."""
    radii = rng.uniform(0.5, 1.0, n)
    centers = np.zeros((n, 3))
    for i in range(1, n):
        step = rng.normal(size=3)
        j = rng.integers(i)
        centers[i] = centers[j] + step / np.linalg.norm(step) * 0.8 * (radii[i] + radii[j])
    return centers, radii


def revolved_pair(d, r1, r2):
    """Volume, axial and transverse inertia of two spheres at 0 and d on an axis: integrals of a profile, a parabola squared."""
    x = np.polynomial.Polynomial([0.0, 1.0])
    cut = (d * d + r1 * r1 - r2 * r2) / (2.0 * d)
    parts = [(r1**2 - x**2, -r1, cut), (r2**2 - (x - d) ** 2, cut, d + r2)]

    def integral(of):
        return math.pi * sum(of(p).integ()(b) - of(p).integ()(a) for p, a, b in parts)

    volume = integral(lambda p: p)
    middle = integral(lambda p: p * x) / volume
    axial = integral(lambda p: p * p / 2.0)
    return volume, axial, integral(lambda p: p * p / 4.0 + p * (x - middle) ** 2)


def test_a_sphere_and_two_that_touch_are_exact():
    body, centroid, quaternion = clump_with_frame([[1.0, 2.0, 3.0]], [0.5])
    volume = 4.0 / 3.0 * math.pi * 0.5**3
    assert body.volume == pytest.approx(volume, rel=1e-15)  # closed form: rounding only
    assert body.inertia == pytest.approx([0.4 * volume * 0.25] * 3, rel=1e-15)
    assert body.error == 0.0
    assert centroid == pytest.approx([1.0, 2.0, 3.0], rel=1e-15)
    assert quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert body.diameter == pytest.approx(1.0, rel=1e-15)
    body = clump([[0, 0, 0], [0.9, 0, 1.2]], [1.0, 0.5])
    v1, v2 = 4.0 / 3.0 * math.pi, 4.0 / 3.0 * math.pi * 0.125
    axial = 0.4 * (v1 + 0.25 * v2)
    transverse = axial + v1 * v2 / (v1 + v2) * 1.5**2
    assert body.volume == pytest.approx(v1 + v2, rel=1e-12)  # smooth slices: rounding only
    assert body.inertia == pytest.approx([axial, transverse, transverse], rel=1e-12)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.48, 0.6, 0.64)])
def test_two_overlapping_spheres(axis):
    for d, r1, r2 in ((1.0, 1.0, 1.0), (1.2, 1.0, 0.6), (0.5, 1.0, 0.51), (1.99, 1.0, 1.0)):
        body = clump([np.zeros(3), d * np.array(axis)], [r1, r2])
        volume, axial, transverse = revolved_pair(d, r1, r2)
        # lens of two spheres, e.g. Weisstein, "Sphere-Sphere Intersection", Eq. 16
        lens = math.pi * (r1 + r2 - d) ** 2 * (d * d + 2 * d * (r1 + r2) - 3 * (r1 - r2) ** 2) / (12 * d)
        assert volume == pytest.approx(4.0 / 3.0 * math.pi * (r1**3 + r2**3) - lens, rel=1e-12)
        # The stated error is that of the order before the last; the result itself is far better (1e-9).
        assert body.error < 1e-5
        assert body.volume == pytest.approx(volume, rel=min(body.error, 1e-9))
        assert body.inertia == pytest.approx([axial, transverse, transverse], rel=min(body.error, 1e-9))


def test_coincident_and_swallowed_spheres_count_once():
    centers, radii = lumps(np.random.default_rng(4), 4)
    plain = clump(centers, radii)
    extra = clump(np.vstack([centers, centers[2], centers[1]]), [*radii, radii[2], 0.5 * radii[1]])
    assert extra.volume == pytest.approx(plain.volume, rel=1e-13)  # the same sum over the same slices
    assert extra.inertia == pytest.approx(plain.inertia, rel=1e-13)
    assert len(extra.radii) == 6
    nearly = clump(np.vstack([centers, centers[2] + 1e-10]), [*radii, radii[2]])
    assert nearly.volume == pytest.approx(plain.volume, rel=1e-9)  # the shift times the surface


def test_against_counting_points():
    centers, radii = lumps(np.random.default_rng(7), 6)
    body = clump(centers, radii)
    low, high = (body.centers - body.radii[:, None]).min(0), (body.centers + body.radii[:, None]).max(0)
    n = 120
    axes = [np.linspace(a, b, 2 * n + 1)[1::2] for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = np.zeros(grid.shape[:3], bool)
    for c, r in zip(body.centers, body.radii, strict=True):
        inside |= ((grid - c) ** 2).sum(axis=-1) < r * r
    points = grid[inside]
    cell = ((high - low) / n).prod()
    # About n^2 cells are cut, each counted wrong by half at random: n / n^3 of the box, 3 sigma and edges.
    tolerance = 10.0 / n**2
    assert body.volume == pytest.approx(len(points) * cell, rel=tolerance)
    assert points.mean(axis=0) == pytest.approx([0.0, 0.0, 0.0], abs=tolerance)
    second = np.einsum("pi,pj->ij", points, points) * cell
    tensor = np.trace(second) * np.eye(3) - second
    assert tensor == pytest.approx(np.diag(body.inertia), rel=tolerance, abs=tolerance * body.inertia[0])


def test_the_frame_does_not_matter():
    for seed in range(4):
        rng = np.random.default_rng(seed)
        centers, radii = lumps(rng, 5)
        body, q = clump(centers, radii), rng.normal(size=4)
        turned = clump(centers @ matrix_from_quaternion(q / np.linalg.norm(q)).T + rng.normal(size=3), radii)
        assert max(body.error, turned.error) < 1e-5
        assert turned.volume == pytest.approx(body.volume, rel=body.error + turned.error)
        assert turned.inertia == pytest.approx(body.inertia, rel=body.error + turned.error)


def test_the_error_estimate_is_honest(monkeypatch):
    rng = np.random.default_rng(11)
    for _ in range(5):
        centers, radii = lumps(rng, int(rng.integers(4, 9)))
        body = clump(centers, radii)
        with monkeypatch.context() as patch:
            patch.setattr(module, "_QUADRATURE", quadrature((40, 80)))
            best = clump(centers, radii)
        assert body.error < 1e-5
        assert abs(body.volume / best.volume - 1.0) <= body.error
        assert np.abs(body.inertia / best.inertia - 1.0).max() <= body.error


def test_the_frame_brings_the_spheres_back():
    rng = np.random.default_rng(3)
    for _ in range(5):
        centers, radii = lumps(rng, 4)
        body, centroid, quaternion = clump_with_frame(centers, radii)
        rotation = matrix_from_quaternion(quaternion)
        assert np.linalg.det(rotation) == pytest.approx(1.0, rel=1e-14)  # right-handed, to rounding
        assert centroid + body.centers @ rotation.T == pytest.approx(centers, abs=1e-14)
        assert (np.diff(body.inertia) >= 0.0).all()
        again, shift, same = clump_with_frame(body.centers, body.radii)
        # A body given in its own principal frame keeps it, to the quadrature's true error.
        assert shift == pytest.approx([0, 0, 0], abs=1e-8)
        assert same == pytest.approx([1, 0, 0, 0], abs=1e-6)


def test_size_scales_out():
    centers, radii = lumps(np.random.default_rng(5), 5)
    large, small = clump(centers, radii), clump(1e-6 * centers, 1e-6 * radii)
    # The same numbers once divided by the largest radius, but for rounding of the division.
    assert small.volume * 1e18 == pytest.approx(large.volume, rel=1e-12)
    assert small.inertia * 1e30 == pytest.approx(large.inertia, rel=1e-12)
    assert small.error == pytest.approx(large.error, rel=1e-3)
    assert large.scaled(1e-6).inertia == pytest.approx(small.inertia, rel=1e-12)
    assert small.centers * 1e6 == pytest.approx(large.centers, abs=1e-9)


def test_parts_and_wrong_spheres_are_refused_by_name():
    apart, wrong = [[0, 0, 0], [5, 0, 0], [1.5, 0, 0], [6.5, 0, 0]], [[0, 0, 0], [0, math.nan, 0]]
    rows = (apart, [1.0] * 4, ["spheres[1]", "spheres[3]"]), (wrong, [1.0, 1.0], ["spheres[1].center"])
    rows += ([[0, 0, 0]], [0.0], ["spheres[0].radius"]), ([[0, 0, 0]], [1.0, 1.0], [""]), (np.zeros((0, 3)), [], [""])
    for centers, radii, keys in rows:
        with pytest.raises(InputError) as caught:
            clump(centers, radii)
        assert [fault.key for fault in caught.value.faults][: len(keys)] == keys
        assert centers is not apart or "not connected" in str(caught.value)
    centers = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]])
    with pytest.raises(InputError, match=r"spheres\[1\]"):  # among many
        module.clumps(centers, np.ones((2, 2)))


def test_many_at_once_are_each_as_one_alone():
    bodies = [lumps(np.random.default_rng(seed), 5) for seed in range(7)]
    # one with a swallowed sphere has fewer that count than the rest of its stack
    bodies[3][0][4], bodies[3][1][4] = bodies[3][0][0], 0.5 * bodies[3][1][0]
    stack = module.clumps(np.array([c for c, _ in bodies]), np.array([r for _, r in bodies]))
    for body, (centers, radii) in zip(stack, bodies, strict=True):
        alone = clump(centers, radii)
        # the same arithmetic; products of matrices may be summed in another order
        assert body.volume == pytest.approx(alone.volume, rel=1e-14)
        assert body.inertia == pytest.approx(alone.inertia, rel=1e-13)
        assert body.centers == pytest.approx(alone.centers, abs=1e-12)
        assert body.error == pytest.approx(alone.error, rel=1e-6)  # a difference of close numbers


SIZE = {"distribution": "lognormal", "median": 1e-5, "sigma": 0.2, "min": 5e-6, "max": 2e-5}
BALL = clump(np.zeros((1, 3)), [2.0])


def body(seed: int, n: int = 6) -> Clump:
    return irregular(np.random.default_rng(seed), n, [1.0, 0.8, 0.6], 1e-5)


def test_a_plane_touches_every_asperity_and_each_protrudes_by_its_radius():
    for n, count, fraction in ((1, 3, 0.1), (6, 3, 0.1), (8, 12, 0.05), (4, 1, 0.5)):
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


def test_impossible_asperities_and_angularity_are_refused():
    for wrong in (Asperities(3), Asperities(0, 1e-7), Asperities(3, 1e-5), Asperities(3, None, 0.6)):
        with pytest.raises(InputError, match="asperities"):
            population(1, 0, 1, (4, 6), [1, 1, 1], asperities=wrong, **SIZE)
    for angularity in (-0.1, 1.1, math.nan):
        with pytest.raises(InputError, match="angularity"):
            irregular(np.random.default_rng(0), 6, [1, 1, 1], 1.0, angularity)


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


SLOW = pytest.mark.full(kind="slow")
EQUAL = [pytest.param(8, [1, 1, 1], 0.65, marks=SLOW), pytest.param(12, [1, 1, 1], 0.6, marks=SLOW)]


@pytest.mark.parametrize("n, aspect, last", [(8, [1, 0.8, 0.6], 0.8), *EQUAL])
def test_summits_get_sharper_with_angularity_and_the_aspect_stays(n, aspect, last):
    values, spans = zip(*(sharpness(a, n, aspect) for a in (0.0, 0.5, 1.0)), strict=True)
    assert values[0] > values[1] > values[2]
    # Corners that planes touch alone would be about (1 - c)/(1 + c) < 0.4 of the core; some planes still meet the core.
    assert values[2] < last * values[0]
    assert spans[2] == pytest.approx(spans[0], abs=0.15)  # the blur of the aspect, as in test_aspect_shows


def test_few_spheres_draw_apart_only():
    plain, sharp = (sharpness(a, 3, [1, 1, 1])[0] for a in (0.0, 1.0))
    assert 0.85 * plain < sharp < plain
