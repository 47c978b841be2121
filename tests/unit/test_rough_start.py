"""Rough plates: bodies laid on one, the height of the upper one, what `check` says, pieces of runs."""

import math

import numpy as np
import pytest
from ensembles import ROUGH, arrays, scene
from steel import scene_text

import thirdbody
from thirdbody.assembly.populate import depth_in_lower, plate_heights, populate, sphere_centres
from thirdbody.assembly.surfaces import MERGING, NARROW, NOTICED, plate_surfaces, surface_scales
from thirdbody.bodies.packing import overlaps
from thirdbody.errors import InputError, Interrupted
from thirdbody.report.scene_check import print_rough_plates
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.simulate import execute, prepare
from thirdbody.surfaces.grid import phases, sine_heights
from thirdbody.surfaces.surface import Surface, dilation

SCENE = scene_text("{debris}", '["100 um", "80 um"]', 'load = "1 mN"', "surface = {surface}")
A_WAVE = '{wave = {amplitude = "1 um", wavelength = "20 um"}}'
RANDOM = '{rms = "0.5 um", long = "20 um", short = "4 um"}'
LAYER = '[[debris]]\nmaterial = "steel"\nkind = "irregular"\ncount = 40\nsize = "8 um"\nspheres = 5\naspect = [1.0, 0.8, 0.6]\n'


def surface_of(text):
    return plate_surfaces(thirdbody.Scene.parse(SCENE.format(debris=LAYER, surface=text)))["lower"]


def test_a_sphere_touches_a_wave_where_the_closed_form_says():
    """The largest of cosine plus circle; 1e-5 of the amplitude is the error of the spline through 32 points of a wave."""
    surface, k = surface_of(A_WAVE), 2.0 * math.pi / 20e-6
    for x, radius in ((0.0, 3e-6), (10e-6, 3e-6), (10e-6, 2e-5), (5e-6, 1e-6)):
        t = np.linspace(-radius, radius, 200_001)
        exact = float(np.max(1e-6 * np.cos(k * (x + t)) + np.sqrt(radius**2 - t**2)))
        found = dilation(surface, np.array([[x, 3.3e-5], [x + 1e-4, -1e-6]]), np.array([radius, radius]))
        np.testing.assert_allclose(found, exact, atol=1e-11)


def test_a_layer_lies_on_the_rough_plate_and_its_bodies_do_not_overlap():
    scene = thirdbody.Scene.parse(SCENE.format(debris=LAYER, surface=RANDOM))
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
