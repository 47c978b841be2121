"""Unions of spheres against closed forms and counting, asperities, angular bodies; particles given by spots."""

import math

import numpy as np
import pytest
from each import each
from steel import scene_text
import thirdbody.bodies.clump as module
from thirdbody.assembly.populate import population_context
from thirdbody.assembly.simulation import build
from thirdbody.bodies.clump import Clump, clump, clump_with_frame, sphere_points, summit_radii, touched
from thirdbody.bodies.irregular_clumps import irregular, population, with_asperities
from thirdbody.errors import InputError
from thirdbody.kernels.plates import BASINS
from thirdbody.rotations import matrix_from_quaternion
from thirdbody.scene.model import Scene
from thirdbody.schema.write import toml_text


def lumps(rng, n):
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
    return volume, integral(lambda p: p * p / 2.0), integral(lambda p: p * p / 4.0 + p * (x - middle) ** 2)


def test_a_sphere_and_two_that_touch_are_exact():
    body, centroid, quaternion = clump_with_frame([[1.0, 2.0, 3.0]], [0.5])
    volume = 4.0 / 3.0 * math.pi * 0.5**3
    assert body.volume == pytest.approx(volume, rel=1e-15)  # closed form: rounding only
    assert body.inertia == pytest.approx([0.4 * volume * 0.25] * 3, rel=1e-15)
    assert body.error == 0.0 and body.diameter == pytest.approx(1.0, rel=1e-15)
    assert centroid == pytest.approx([1.0, 2.0, 3.0], rel=1e-15) and quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
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


def test_overlapping_spheres_against_counting_points_and_swallowed_ones():
    centers, radii = lumps(np.random.default_rng(4), 4)
    plain = clump(centers, radii)
    extra = clump(np.vstack([centers, centers[2], centers[1]]), [*radii, radii[2], 0.5 * radii[1]])
    assert extra.volume == pytest.approx(plain.volume, rel=1e-13)  # the same sum over the same slices
    assert extra.inertia == pytest.approx(plain.inertia, rel=1e-13)
    assert len(extra.radii) == 6
    centers, radii = lumps(np.random.default_rng(7), 6)
    body = clump(centers, radii)
    low, high = (body.centers - body.radii[:, None]).min(0), (body.centers + body.radii[:, None]).max(0)
    n = 80
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


def body(seed: int, n: int = 6) -> Clump:
    return irregular(np.random.default_rng(seed), n, [1.0, 0.8, 0.6], 1e-5)


def test_a_plane_touches_every_asperity_and_the_body_below_is_the_one_without():
    for n, count, fraction in ((1, 3, 0.1), (6, 3, 0.1), (8, 12, 0.05), (4, 1, 0.5)):
        bare = body(1, n)
        rough = with_asperities(np.random.default_rng(2), bare, count, fraction)
        assert rough.diameter == pytest.approx(bare.diameter, rel=1e-12, abs=0.0)  # scaled to it: rounding of a cube root
        assert rough.radii[n:] == pytest.approx(0.5 * fraction * bare.diameter, rel=1e-12, abs=0.0)  # the iteration's end, 1e-14
        assert set(range(n, n + count)) <= set(touched(rough, sphere_points(20000)).tolist())
        # centres on the surface of the union: none inside another sphere, one sphere's surface at each
        gaps = np.linalg.norm(rough.centers[n:, None] - rough.centers[:n], axis=2) - rough.radii[:n]
        assert gaps.min(axis=1) == pytest.approx(np.zeros(count), abs=1e-12 * bare.diameter)  # rounding of coordinates
    bare = population(1, 0, 4, (4, 6), [1, 0.8, 0.6], **SIZE)
    rough = population(1, 0, 4, (4, 6), [1, 0.8, 0.6], asperities=(3, lambda diameter: 1e-6 / diameter), **SIZE)
    for a, b in zip(bare, rough, strict=True):
        n = len(a.radii)
        assert len(b.radii) == n + 3 and b.diameter == pytest.approx(a.diameter, rel=1e-12, abs=0.0)
        assert b.radii[n:] == pytest.approx(5e-7, rel=1e-12, abs=0.0)  # a length stays that length
        assert b.radii[:n] / b.radii[0] == pytest.approx(a.radii / a.radii[0], rel=1e-14)  # one factor for all
    few = population(1, 0, 2, (4, 6), [1, 0.8, 0.6], asperities=(3, lambda diameter: 1e-6 / diameter), **SIZE)
    for a, b in zip(few, rough, strict=False):
        assert np.array_equal(a.centers, b.centers)


def test_no_angularity_is_the_body_as_ever():
    """Shapes of seeds that people have published: radii of the first version, over the diameter, to its printed digits."""
    radii = population(1, 0, 1, (5, 5), [1, 0.8, 0.6], distribution="constant", value=1e-5)[0].radii / 1e-5
    assert radii == pytest.approx([0.29637645, 0.36562493, 0.30504432, 0.24325043, 0.27823506], abs=5e-9)


def sharpness(angularity):
    """Mean radius where a plane touches over the equivalent radius, and shortest over longest extent."""
    made = [irregular(np.random.default_rng(k), 8, [1, 0.8, 0.6], 2.0, angularity) for k in range(20)]
    spans = [np.sort(np.ptp(np.stack([b.centers + s * b.radii[:, None] for s in (1, -1)]), axis=(0, 1))) for b in made]
    return float(np.mean([summit_radii(b).mean() for b in made])), float(np.mean([s[0] / s[2] for s in spans]))


def test_summits_get_sharper_with_angularity_and_the_aspect_stays():
    values, spans = zip(*(sharpness(a) for a in (0.0, 0.5, 1.0)), strict=True)
    assert values[0] > values[1] > values[2]
    # Corners that planes touch alone would be about (1 - c)/(1 + c) < 0.4 of the core; some planes still meet the core.
    assert values[2] < 0.8 * values[0]
    assert spans[2] == pytest.approx(spans[0], abs=0.15)  # the blur of the aspect, as in test_irregular_clumps


UPPER = 'support = "load_per_particle"\nload = "0.1 mN"\nmotion = {{x = {{velocity = "-0.01 m/s"}}{motion}}}\n{more}'
DEBRIS = '[[debris]]\nmaterial = "steel"\nkind = "spots"\n{keys}'
SCENE = scene_text(DEBRIS, '["20 um", "20 um"]', UPPER, solver='distance = "20 nm"', every="1 nm")
SPOTS = """spots = [
  {side = "upper", x = "0.2 um", z = "2 um", radius = "2 um"},
  {side = "lower", x = "-2 um", z = "-2 um", radius = "1 um"},
  {side = "lower", x = "1.5 um", z = "-2 um", radius = "1.5 um"},
]
"""
MASS = 'mass = "1e-13 kg"\ninertia = "2e-25 kg m2"\n'
PLANAR = SPOTS + MASS + "planar = true\n"


def scene(keys=SPOTS + MASS, motion="", more=""):
    return Scene.parse(SCENE.format(keys=keys, motion=motion, more=more), "s.toml")


def test_summits_stand_on_the_plates_and_meet_their_own_side_only():
    state = build(scene()).state
    # the clearance at the start is 1e-9 of the height
    assert state.S[:, 2] + np.array([1.0, -1.0, -1.0]) * state.spheres.radius == pytest.approx([4e-6, 0.0, 0.0], abs=1e-14)
    low = SPOTS.replace('radius = "1.5 um"', 'radius = "3 um"')  # a sphere of the lower side that reaches above the upper summit
    assert build(scene(low + MASS)).upper.plate.heights == pytest.approx(4e-6, rel=1e-6)
    # all three spheres are close to both plates, yet each is a candidate of one plate only
    candidates = sorted(zip(state.slots.own.tolist(), state.slots.partner.tolist(), strict=True))
    assert candidates == [(0, -1 - BASINS), (1, -1), (2, -1)]
    assert state.bodies.mass[0] == pytest.approx(1e-13, rel=1e-15)
    assert state.bodies.inertia[0] == pytest.approx([2e-25] * 3, rel=1e-15)
    # spots do not meet other bodies
    built = build(scene(SPOTS + MASS + 'positions = [["10 um", "10 um"], ["11 um", "10 um"]]\n'))
    built.integrator.advance_to(time=0.5 * built.settle)
    assert np.all(built.state.slots.partner < 0) and built.state.slots.count == 6


FAULTS = [
    ({"keys": SPOTS}, "debris[0].mass: required key is missing"),
    ({"keys": SPOTS.replace('side = "lower"', 'side = "upper"') + MASS}, "no spot on the lower side"),
    ({"keys": SPOTS.replace('z = "2 um"', 'z = "-3 um"') + MASS}, "the upper spots are not above the lower ones"),
    ({"keys": SPOTS + MASS.replace("2e-25 kg m2", "2e-25 kg")}, "moment of inertia"),
    ({"keys": SPOTS + MASS.replace('"2e-25 kg m2"', '["1e-25 kg m2", "5e-25 kg m2", "1e-25 kg m2"]')},
     "debris[0].inertia: 5e-25 is above 1e-25 + 1e-25, the sum of the other moments of inertia"),
    ({"keys": PLANAR.replace('x = "0.2 um"', 'x = "0.2 um", y = "1 um"')}, "spots[0].y: must be 0 in a planar particle"),
    ({"keys": PLANAR, "motion": ', y = {velocity = "1 m/s"}'}, "motion.y: drives planar particles"),
    ({"keys": PLANAR, "more": '[effects]\ngravity = ["0 m/s2", "1 m/s2", "0 m/s2"]'}, "gravity[1]: drives planar particles"),
    ({"keys": PLANAR + 'velocity = ["0 m/s", "1 m/s", "0 m/s"]\n'}, "velocity[1]: must be 0 in a"),
]  # fmt: skip


@each(FAULTS, name_of=lambda row: row[1])
def test_faults(row):
    with pytest.raises(InputError) as caught:
        scene(**row[0])
    assert row[1] in str(caught.value)


def test_bodies_of_spots():
    made = scene(PLANAR)
    assert Scene.parse(toml_text(made.document())) == made
    # rows fill the domain
    crowd = scene(SPOTS + MASS.replace('"2e-25 kg m2"', '["1e-25 kg m2", "2e-25 kg m2", "3e-25 kg m2"]') + "count = 7\n")
    made = crowd.debris[0].bodies(population_context(crowd, 0, []))
    places = made.positions[:, :2]
    assert places.shape == (7, 2) and np.all(places > 0.0) and np.all(places < 20e-6)
    assert len(np.unique(places.round(12), axis=0)) == 7
    # the mass and inertia given
    body, density = made.clumps[0], crowd.materials["steel"].density
    assert body.volume * density == pytest.approx(1e-13) and body.inertia * density == pytest.approx([1e-25, 2e-25, 3e-25])
    assert body.centers[0] == pytest.approx([0.2e-6, 0.0, 0.0])
