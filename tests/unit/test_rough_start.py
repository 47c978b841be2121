"""Bodies laid on a rough plate, and the height at which a rough upper plate first touches them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from steel import STEEL

from thirdbody.assembly.populate import populate, sphere_centres
from thirdbody.assembly.rough_start import depth_in_lower, plate_heights
from thirdbody.assembly.surfaces import plate_surfaces
from thirdbody.bodies.layer_packing import overlaps
from thirdbody.errors import InputError
from thirdbody.scene.model import Scene
from thirdbody.surfaces.dilation import dilation

SCENE = (
    STEEL
    + """\
{debris}
[domain]
size = ["100 um", "80 um"]
[plates.lower]
material = "steel"
surface = {surface}
[plates.upper]
material = "steel"
load = "1 mN"
[solver]
duration = "1 us"
[output]
every = "1 us"
"""
)
WAVE = '{wave = {amplitude = "1 um", wavelength = "20 um"}}'
ROUGH = '{rms = "0.5 um", long = "20 um", short = "4 um"}'
LAYER = '[[debris]]\nmaterial = "steel"\nkind = "irregular"\ncount = 40\nsize = "8 um"\nspheres = 5\naspect = [1.0, 0.8, 0.6]\n'


def surface_of(text):
    return plate_surfaces(Scene.parse(SCENE.format(debris=LAYER, surface=text)))["lower"]


@pytest.mark.parametrize(("x", "radius"), [(0.0, 3e-6), (10e-6, 3e-6), (10e-6, 2e-5), (5e-6, 1e-6)])
def test_a_sphere_touches_a_wave_where_the_closed_form_says(x, radius):
    """The largest of cosine plus circle; 1e-5 of the amplitude is the error of the spline through 32 points of a wave."""
    surface, k = surface_of(WAVE), 2.0 * math.pi / 20e-6
    t = np.linspace(-radius, radius, 200_001)
    exact = float(np.max(1e-6 * np.cos(k * (x + t)) + np.sqrt(radius**2 - t**2)))
    found = dilation(surface, np.array([[x, 3.3e-5], [x + 1e-4, -1e-6]]), np.array([radius, radius]))
    np.testing.assert_allclose(found, exact, atol=1e-11)


def test_a_layer_lies_on_the_rough_plate_and_its_bodies_do_not_overlap():
    scene = Scene.parse(SCENE.format(debris=LAYER, surface=ROUGH))
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


def test_a_body_that_starts_in_a_crest_is_refused():
    ball = '[[debris]]\nmaterial = "steel"\nkind = "spheres"\nradius = "2 um"\npositions = [["0 um", "9 um", "2 um"]]\n'
    scene = Scene.parse(SCENE.format(debris=ball, surface=WAVE))
    with pytest.raises(InputError, match="body 0 starts 1 um deep in the lower plate"):
        populate(scene, [], plate_surfaces(scene))


def test_the_upper_plate_starts_above_what_it_touches_first():
    surface, radii = surface_of(WAVE), np.array([2e-6, 2e-6])
    centres = np.array([[0.0, 0.0, 3e-6], [10e-6, 0.0, 3e-6]])
    crest, valley = plate_heights(surface, centres, radii)
    assert crest == pytest.approx(6e-6, abs=1e-11) and valley == pytest.approx(4e-6, abs=1e-11)
    np.testing.assert_allclose(plate_heights(None, centres, radii), 5e-6, rtol=1e-15)
