"""A close-up shows the forces on one particle and what friction could hold at each of its spots."""

from __future__ import annotations

import numpy as np
import pytest
from layer import R, hue_share, skip_unless_drawable, write_layer

from thirdbody.errors import InputError
from thirdbody.palette import STATE_COLORS, rgb
from thirdbody.render.closeup_data import read_close_up
from thirdbody.render.coloring import Coloring, Legend
from thirdbody.render.force_tubes import force_tubes, nearest_image
from thirdbody.render.render import render
from thirdbody.trajectory.reader import open_run


@pytest.fixture(scope="module")
def layer(tmp_path_factory):
    return write_layer(tmp_path_factory.mktemp("layer") / "run.vtkhdf", 60)


def test_the_spots_of_a_body_and_their_cones(layer):
    with open_run(layer) as run:
        one = read_close_up(run, -1, 7, "state")
    spots = one.spots
    assert spots.against == ["lower plate", "upper plate"]
    # 7.5 uN are three quarters, 2.5 uN one quarter of the same limit: a cone with the half angle atan 0.1.
    assert spots.limit == pytest.approx([1e-5, 1e-5], rel=1e-12)
    load = np.einsum("ij,ij->i", spots.force, spots.normal)
    assert load == pytest.approx([1e-4, 1e-4], rel=1e-12)  # rounding of a product
    assert np.all(np.abs(spots.position - one.center)[:, 2] == pytest.approx(R, rel=1e-9))  # wrapped like its body


def test_the_other_body_of_a_contact_feels_the_opposite_force():
    contacts = {
        "position": np.array([[0.0, 0.0, 0.0]]),
        "body": np.array([1]),
        "partner": np.array([0]),
        "force": np.array([[3.0, 0.0, 4.0]]),
    }
    bodies = {"position": np.array([[9.9, 5.0, 0.0], [0.1, 5.0, 0.0]]), "id": np.array([0, 1])}
    contacts["position"][0] = [10.0, 5.0, 0.0]
    paint = Coloring(np.zeros(2), Legend("x", limits=(0.0, 1.0)))
    tubes = force_tubes(contacts, bodies, np.zeros((2, 3)), np.array([10.0, 10.0]), paint)
    assert tubes.force == pytest.approx([5.0, 5.0], rel=1e-12)
    # One tube from each centre to the contact between them, across the edge of the domain: 0.1 each, not 9.9.
    assert np.linalg.norm(tubes.end - tubes.start, axis=1) == pytest.approx([0.1, 0.1], rel=1e-9)
    assert tubes.full_scale == pytest.approx(5.0, rel=1e-12)


def test_the_nearest_image_is_never_farther_than_half_the_domain():
    path = np.array([[9.0, -6.0, 3.0], [4.9, 5.1, -7.0]])
    np.testing.assert_allclose(nearest_image(path, np.array([10.0, 10.0])), [[-1.0, 4.0, 3.0], [4.9, -4.9, -7.0]], atol=1e-12)
    assert nearest_image(path, None) is path


def test_contacts_bring_their_own_colours_to_the_tubes(layer):
    with open_run(layer) as run:
        from thirdbody.render.picture_data import read_picture_data

        by_state = read_picture_data(run, 0, "state", forces=True).tubes
        by_use = read_picture_data(run, 0, "utilisation", forces=True).tubes
    assert len(np.unique(by_state.colors, axis=0)) == 1
    assert len(np.unique(by_use.colors, axis=0)) == 2  # a quarter and three quarters


def test_a_close_up_is_drawn_with_spots_in_the_colour_of_sticking(layer, tmp_path):
    skip_unless_drawable()
    image = pytest.importorskip("PIL.Image")
    # Body 30 does not stick: blue are its two spots, their cones and numbers.
    with open_run(layer) as run:
        number = int(np.flatnonzero(run.states[0] == 2)[0])
    pixels = np.array(image.open(render(layer, tmp_path / "a.png", size=(800, 450), body=number)).convert("RGB"))
    assert pixels.shape == (450, 800, 3)
    scene = pixels[60:380, :540]
    # The numbers of two spots alone are 0.15 % of the scene; the light plates are no blue of 25 steps.
    assert hue_share(scene, STATE_COLORS["sticking"]) > 0.004
    assert hue_share(scene, STATE_COLORS["sliding"]) > 0.01


def test_numbers_of_spots_stay_on_their_discs_in_small_pictures(layer, tmp_path):
    """Words do not shrink below 11 pixels, their discs did: at 480 x 270 the numbers hid them."""
    skip_unless_drawable()
    image = pytest.importorskip("PIL.Image")
    with open_run(layer) as run:
        number = int(np.flatnonzero(run.states[0] == 2)[0])
    pixels = np.array(image.open(render(layer, tmp_path / "a.png", size=(480, 270), body=number)).convert("RGB")).astype(int)
    listed = pixels[40:200, 320:]
    blue = np.all(np.abs(listed - rgb(STATE_COLORS["sticking"])) < 12, axis=2).sum()
    # Two discs of 15 / 22 of 11 pixels cover 353, of which digits and edges take a third; they covered 52.
    assert blue > 150


def test_a_run_without_forces_says_so(layer, tmp_path):
    with open_run(layer) as run:
        with pytest.raises(InputError, match="no body 60; ids are 0 to 59"):
            read_close_up(run, -1, 60, "state")
        contacts = run.contacts(0)
    del contacts["force"]
    with pytest.raises(InputError, match="recorded no forces"):
        force_tubes(contacts, {"position": np.zeros((60, 3))}, np.zeros((60, 3)), None, Coloring(np.zeros(1), Legend("x")))
