"""Resting poses: contacts on the plane, nothing below, every tilt raises the body; bodies laid on rough plates."""

import math
import tracemalloc

import numpy as np
import pytest
from ensembles import ROUGH, arrays, scene
from steel import scene_text
import thirdbody
from thirdbody.assembly.populate import depth_in_lower, plate_heights, populate, sphere_centres
from thirdbody.assembly.surfaces import MERGING, NARROW, NOTICED, plate_surfaces, surface_scales
from thirdbody.bodies.clump import Clump, clump
from thirdbody.bodies.irregular_clumps import irregular
from thirdbody.bodies.packing import overlaps
from thirdbody.bodies.resting_poses import resting_poses, settle_all
from thirdbody.errors import InputError, Interrupted
from thirdbody.report.scene_check import print_rough_plates
from thirdbody.rotations import matrix_from_quaternion
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.simulate import execute, prepare
from thirdbody.surfaces.grid import phases, sine_heights
from thirdbody.surfaces.surface import Surface, dilation


def height(body, u):
    return (body.radii - body.centers @ u).max()


def ups_of(quaternions):
    return np.array([matrix_from_quaternion(q)[2] for q in quaternions])


def random_directions(rng, n):
    u = rng.normal(size=(n, 3))
    return u / np.linalg.norm(u, axis=1)[:, None]


def test_bodies_of_known_poses():
    quaternions, heights = resting_poses(clump([[3.0, 0.0, 0.0]], [2.0]))  # a ball, as it is
    assert quaternions.tolist() == [[1.0, 0.0, 0.0, 0.0]] and heights.tolist() == [2.0]
    # A triangle on its three spheres, on either face. On an edge (two spheres) it stands with the third above: unstable.
    quaternions, heights = resting_poses(clump(np.sqrt(3.0) * ring(3), [0.9, 0.9, 0.9]))
    assert heights == pytest.approx([0.9, 0.9], rel=1e-12)
    assert np.abs(ups_of(quaternions)) @ [0, 0, 1] == pytest.approx([1, 1], rel=1e-12)  # the thin axis has the largest inertia
    for centers, radii, expected in (
        ([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], np.full(4, 1.1), [1.1, 1.1]),  # a square pad, on four
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], np.ones(3), [1.0]),  # a rod: rolling about its axis is one family
    ):
        assert resting_poses(clump(centers, radii))[1] == pytest.approx(expected, rel=1e-12)
    # A cone on its side: a common tangent plane touches all three, and the family is found by every pair.
    assert len(resting_poses(clump([[0, 0, 0], [1, 0, 0], [1.9, 0, 0]], [1.0, 0.9, 0.81]))[1]) == 1
    # A hemisphere-like lump: the centroid below the center of the large sphere, with no other contact near.
    body = Clump(np.array([[0.0, 0.0, 0.3], [0.0, 0.0, -0.2]]), np.array([1.0, 0.3]), 4.2, np.ones(3), 0.0)
    quaternions, heights = resting_poses(body)
    assert heights == pytest.approx([0.7], rel=1e-12) and quaternions[0] == pytest.approx([1, 0, 0, 0], abs=1e-15)
    # a stool whose centroid lies over an edge falls
    feet = np.array([[1.0, 0.0, -1.0], [-1.0, 0.0, -1.0], [0.0, 1.0, -1.0]])
    quaternions, _ = resting_poses(Clump(feet, np.full(3, 1.5), 1.0, np.ones(3), 0.0))
    ups = ups_of(quaternions)
    # Upright, the second order lets it roll over the edge; hanging below its feet the same edge holds it.
    assert max(ups[:, 2]) < 0.9 and min(ups[:, 2]) == pytest.approx(-1.0, rel=1e-12)
    # two spheres that nearly coincide rest
    for apart in (0.0, 1e-16, 1e-12, 9e-10, 1e-9, 2e-9, 5e-9, 1e-7, 1e-4):
        _, heights = resting_poses(clump([[0.0, 0.0, 0.0], [apart * 5e-6, 0.0, 0.0]], [5e-6, 5e-6]))
        assert heights[0] == pytest.approx(5e-6, rel=1e-9), apart  # spheres nearer than 1e-9 radii are one


def test_random_clumps_rest_in_minima_and_none_is_missed():
    for seed in range(3):
        rng = np.random.default_rng(seed)
        aspect = ([1, 0.8, 0.6], [1, 1, 0.2], [1, 0.3, 0.3])[seed % 3]
        body = irregular(rng, 4 + seed % 5, aspect, 1e-5)
        quaternions, heights = resting_poses(body)
        assert len(heights) >= 1 and (np.diff(heights) >= 0.0).all()
        tilts = random_directions(rng, 200)
        for u, h in zip(ups_of(quaternions), heights, strict=True):
            bottoms = np.sort(body.centers @ u + h - body.radii) / 1e-5
            # Closed forms: contacts, up to three, touch to rounding, relative to the body.
            contacts = (bottoms < 1e-9).sum()
            assert contacts >= 1 and bottoms[: min(contacts, 3)] == pytest.approx(0.0, abs=1e-12), seed
            for t in tilts - (tilts @ u)[:, None] * u:
                tilted = u + 1e-4 * t
                assert height(body, tilted / np.linalg.norm(tilted)) > h, seed
        # The lowest pose is the least height of all.
        assert min(height(body, t) for t in tilts) >= heights[0], seed
    # rolling downhill from anywhere, by small random steps, ends in a pose that was found
    rng = np.random.default_rng(0)
    body = irregular(rng, 5, [1, 0.8, 0.6], 1.0)
    ups = ups_of(resting_poses(body)[0])
    for _ in range(6):
        (u,) = random_directions(rng, 1)
        step, h = 0.05, height(body, u)
        while step > 1e-7:
            trials = u + step * rng.normal(size=(60, 3))
            trials /= np.linalg.norm(trials, axis=1)[:, None]
            lows = (body.radii - trials @ body.centers.T).max(axis=1)
            if lows.min() < h:
                u, h = trials[lows.argmin()], lows.min()
            else:
                step *= 0.5
        assert np.linalg.norm(ups - u, axis=1).min() < 1e-2  # the walk stalls in narrow valleys


def test_settling_is_reproducible_about_the_vertical_together_or_one_after_the_other():
    body = irregular(np.random.default_rng(1), 6, [1, 0.8, 0.6], 1.0)
    first, again = (settle_all([body], np.random.default_rng(5))[0] for _ in range(2))
    assert np.array_equal(first, again)
    quaternions, heights = resting_poses(body)
    ups = ups_of(quaternions)
    for seed in range(20):
        (quaternion,), (h,) = settle_all([body], np.random.default_rng(seed))
        assert np.linalg.norm(quaternion) == pytest.approx(1.0, rel=1e-14)
        k = int(np.argmax(ups @ matrix_from_quaternion(quaternion)[2]))
        assert ups[k] == pytest.approx(matrix_from_quaternion(quaternion)[2], abs=1e-12)
        assert h == heights[k]
    # bodies of several numbers of spheres, a ball and a rod among them, from one stream
    bodies = [irregular(np.random.default_rng(k), 1 + k % 6, [1, 0.8, 0.6], 1e-5) for k in range(24)]
    quaternions, heights = settle_all(bodies, np.random.default_rng(5))
    rng = np.random.default_rng(5)
    for body, q, h in zip(bodies, quaternions, heights, strict=True):
        (alone,), (level,) = settle_all([body], rng)
        assert q == pytest.approx(alone, abs=1e-13)  # the order of sums in products of matrices
        assert h == pytest.approx(level, rel=1e-13)
    assert settle_all([], rng)[0].shape == (0, 4)


def ring(n):
    a = 2.0 * math.pi * np.arange(n) / n
    return 0.5 / math.sin(math.pi / n) * np.column_stack((np.cos(a), np.sin(a), 0.0 * a))


def test_a_hundred_spheres_rest_in_little_memory():
    """As the clump is made: a table of all pairs of directions would have 45 000 rows and columns."""
    tracemalloc.start()
    try:
        _, heights = resting_poses(clump(1e-6 * ring(100), np.full(100, 1e-6)))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert heights == pytest.approx([1e-6, 1e-6], rel=1e-9)
    assert peak < 500e6


SCENE = scene_text("{debris}", '["100 um", "80 um"]', 'load = "1 mN"', "surface = {surface}")
A_WAVE = '{wave = {amplitude = "1 um", wavelength = "20 um"}}'
LAYER = '[[debris]]\nmaterial = "steel"\nkind = "irregular"\ncount = 40\nsize = "8 um"\nspheres = 5\naspect = [1.0, 0.8, 0.6]\n'


def surface_of(text):
    return plate_surfaces(thirdbody.Scene.parse(SCENE.format(debris=LAYER, surface=text)))["lower"]


def test_a_sphere_touches_a_wave_where_the_closed_form_says_and_a_layer_lies_on_it():
    """The largest of cosine plus circle; 1e-5 of the amplitude is the error of the spline through 32 points of a wave."""
    surface, k = surface_of(A_WAVE), 2.0 * math.pi / 20e-6
    for x, radius in ((0.0, 3e-6), (10e-6, 3e-6), (10e-6, 2e-5), (5e-6, 1e-6)):
        t = np.linspace(-radius, radius, 200_001)
        exact = float(np.max(1e-6 * np.cos(k * (x + t)) + np.sqrt(radius**2 - t**2)))
        found = dilation(surface, np.array([[x, 3.3e-5], [x + 1e-4, -1e-6]]), np.array([radius, radius]))
        np.testing.assert_allclose(found, exact, atol=1e-11)
    scene = thirdbody.Scene.parse(SCENE.format(debris=LAYER, surface='{rms = "0.5 um", long = "20 um", short = "4 um"}'))
    surfaces = plate_surfaces(scene)
    placed = populate(scene, [], surfaces)
    centres, radii, body = sphere_centres(placed)
    depth = depth_in_lower(surfaces["lower"], centres, radii)
    nearest = np.full(40, -np.inf)
    np.maximum.at(nearest, body, depth)
    assert np.all(nearest < -5e-12) and np.all(nearest > -1e-10)  # a millionth of some 10 um, less on slopes
    assert not overlaps(centres, radii, body, scene.domain.size, True)
    flat = populate(scene, [])
    np.testing.assert_array_equal(placed.positions[:, :2], flat.positions[:, :2])
    assert np.ptp(placed.positions[:, 2] - flat.positions[:, 2]) > 0.5e-6
    # a body that starts in a crest is refused
    ball = '[[debris]]\nmaterial = "steel"\nkind = "spheres"\nradius = "2 um"\npositions = [["0 um", "9 um", "2 um"]]\n'
    scene = thirdbody.Scene.parse(SCENE.format(debris=ball, surface=A_WAVE))
    with pytest.raises(InputError, match="body 0 starts 1 um deep in the lower plate"):
        populate(scene, [], plate_surfaces(scene))
    # the upper plate starts above what it touches first
    surface, radii = surface_of(A_WAVE), np.array([2e-6, 2e-6])
    centres = np.array([[0.0, 0.0, 3e-6], [10e-6, 0.0, 3e-6]])
    crest, valley = plate_heights(surface, centres, radii)
    assert crest == pytest.approx(6e-6, abs=1e-11) and valley == pytest.approx(4e-6, abs=1e-11)
    np.testing.assert_allclose(plate_heights(None, centres, radii), 5e-6, rtol=1e-15)


WAVELENGTH, RADIUS = 20e-6, 5e-6


def scales_of(amplitude: float, overlap: float, side: str = "lower"):
    heights = sine_heights(phases((8, 128), (4, 0), 0.0), amplitude)
    return surface_scales({side: Surface(heights, (4.0 * WAVELENGTH, WAVELENGTH), WAVELENGTH)}, RADIUS, overlap)[side]


CRITICAL = 1.0 / (RADIUS * (2.0 * math.pi / WAVELENGTH) ** 2)  # amplitude at which 1/curvature is the radius


def test_a_sphere_touches_at_several_points_where_a_valley_is_sharper(capsys):
    for factor, several in ((0.9, False), (1.1, True)):
        scales = scales_of(factor * CRITICAL, 1e-4)
        assert scales.valley == pytest.approx(factor, rel=0.005)  # the spline of 32 points: 0.32 %
        assert scales.document()["several_contacts"] is several and not scales.warnings("lower")
    # energy of contacts that become one
    limit = NOTICED * WAVELENGTH / (MERGING * RADIUS)  # overlap over radius
    for overlap, count in ((0.9 * limit, 0), (1.1 * limit, 1)):
        scales = scales_of(1.1 * CRITICAL, overlap)
        assert scales.document()["energy_of_merging_contacts_over_load"] == pytest.approx(MERGING * overlap * RADIUS)
        assert sum("become one, energy is made or lost" in text for text in scales.warnings("lower")) == count
    print_rough_plates({"lower": scales.document()})
    assert "at most that of the load along 66 nm" in capsys.readouterr().out.replace("\N{NO-BREAK SPACE}", " ")
    assert scales_of(1e-9, limit).merging == 0.0


def test_contacts_that_are_wide_against_the_waves_give_a_warning(capsys):
    for factor, count in ((0.9, 0), (1.1, 1)):
        scales = scales_of(1e-9, (factor * NARROW * WAVELENGTH / RADIUS) ** 2)
        assert scales.width == pytest.approx(factor * NARROW) and len(scales.warnings("lower")) == count
    assert "11 % of the shortest wavelength (20 um)" in scales.warnings("lower")[0].replace("\N{NO-BREAK SPACE}", " ")
    # on a crest it is narrower by the third root
    scales = scales_of(3e-6, 1e-2, "upper")
    ratio = 1.0 + RADIUS * scales.statistics.crest_curvature
    assert scales.crest_contact_radius == pytest.approx(0.1 * RADIUS / ratio ** (1.0 / 3.0), rel=1e-12)
    assert "of that of the sharpest crest" in scales.warnings("upper")[0]
    # steps are noticed and nothing is said of an unknown load
    step = np.where(np.arange(128) < 64, 1e-6, -1e-6)[None, :] * np.ones((8, 1))
    scales = surface_scales({"lower": Surface(step, (40e-6, 20e-6), 20e-6)}, RADIUS, 0.0)["lower"]
    assert "does the file hold steps?" in scales.warnings("lower")[0]
    assert scales.document()["contact_radius"] is None and scales.document()["lowest"] == -1e-6
    print_rough_plates({"lower": scales.document()})
    text = capsys.readouterr().out
    assert surface_scales({}, RADIUS, 1e-4) == {}  # flat plates
    assert "lower plate: rms height 1 um" in text and "contact radius" not in text and "several points" in text


FEW = ROUGH | {"debris.0.count": 12, "debris.0.spheres": [3, 6]}


def test_threads_and_pieces_change_no_bit(tmp_path):
    given = scene(**FEW, **{"contact.debris_contact": "none"})
    thirdbody.run(given, tmp_path / "whole", 1, False)
    thirdbody.run(given, tmp_path / "threads", 2, False)
    simulation, saved, pieces = prepare(given), None, 0
    while True:
        watches = iter(range(1 + 8 * pieces))
        try:
            execute(simulation, tmp_path / "cut", checkpoint=saved, stop=lambda left=watches: next(left, None) is None)
            break
        except Interrupted:
            simulation, saved = prepare_resume(tmp_path / "cut")
            pieces += 1
    assert pieces > 1
    assert arrays(tmp_path / "whole") == arrays(tmp_path / "threads") == arrays(tmp_path / "cut")
    energies = thirdbody.open(tmp_path / "whole").series
    worked = np.abs(energies["energy_plate_work"]).max() + energies["energy_elastic_normal"].max()
    assert np.abs(energies["energy_residual"]).max() < 1e-2 * worked
