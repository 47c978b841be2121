"""What spots of one body do to each other: far point loads in closed form, boundary elements, and what is told without them."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from thirdbody.scene.model import Scene
from thirdbody.studies import contact_interaction as study
from thirdbody.studies.contact_interaction import Spots, boundary_element_forces, far_field, interaction
from thirdbody.studies.worker import timed_run

SCENES = Path(__file__).parents[2] / "scenes"
E_STAR, RADIUS, OVERLAP = 1e11, 1e-6, 1e-8


def pair(apart: float, n: int = 2) -> Spots:
    """Equal spots on a circle, `apart` contact radii from one to the next."""
    a = math.sqrt(RADIUS * OVERLAP)
    turn = 2.0 * np.pi * np.arange(n) / n
    place = apart * a / (2.0 * math.sin(math.pi / n)) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    load = 4.0 / 3.0 * E_STAR * a * OVERLAP
    return Spots(0, "lower", place, np.full(n, OVERLAP), np.full(n, a), np.full(n, load))


def test_hertz_gives_the_modulus_back():
    assert pair(10.0).e_star == pytest.approx(E_STAR, rel=1e-12)


@pytest.mark.parametrize("n, neighbours", [(2, 1.0), (3, 2.0)])
def test_neighbours_press_by_four_thirds_of_a_over_pi_r(n, neighbours):
    """N/(pi E* r) over d is 4 a/(3 pi r) for each (Boussinesq): equal spots keep their loads, and sink by it together."""
    spots = pair(20.0, n)
    share = neighbours * 4.0 / (3.0 * math.pi * 20.0)
    assert spots.neighbour_fraction == pytest.approx(share, rel=1e-12)
    found = far_field(spots)
    assert found["approach"] == pytest.approx(share, rel=1e-9)
    assert found["loads"] == pytest.approx([0.0] * n, abs=1e-12)


def test_the_spot_between_two_others_carries_less():
    a = math.sqrt(RADIUS * OVERLAP)
    row = Spots(0, "upper", np.array([[-20.0 * a, 0.0], [0.0, 0.0], [20.0 * a, 0.0]]), np.full(3, OVERLAP), np.full(3, a),
                np.full(3, 4.0 / 3.0 * E_STAR * a * OVERLAP))  # fmt: skip
    loads = far_field(row)["loads"]
    assert loads[1] < 0.0 < loads[0] == pytest.approx(loads[2], rel=1e-9)
    assert sum(loads) == pytest.approx(0.0, abs=1e-12)


@pytest.fixture(scope="module")
def pressed(tmp_path_factory) -> Path:
    """The shipped three-spot particle, dragged a little."""
    folder = tmp_path_factory.mktemp("three_spot") / "run"
    timed_run(Scene.load(SCENES / "three_spot.toml").with_settings({"solver.distance": "2 nm"}), folder, [], 60.0)
    return folder


def test_the_three_spot_particle_s_lower_spots_are_the_close_ones(pressed):
    spots = study.closest(pressed)
    assert spots.plate == "lower" and len(spots.load) == 2
    # G 60 GPa, nu .35 on G 120 GPa, nu .2: 1/E* = .65/120 + .8/240 per GPa; damping at rest adds nothing
    assert spots.e_star == pytest.approx(114.2857142857e9, rel=1e-6)
    # places of the scene, but for the turn of the particle as its spots give way, 3e-4
    assert spots.apart[0, 1] == pytest.approx(3.5e-6, rel=1e-3)


def test_without_tamaas_the_closed_form_is_alone_and_says_so(pressed, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "tamaas", None)  # importing it raises ImportError
    report = interaction(pressed)
    assert report["boundary_elements"] is None and "tamaas is not installed" in report["why"]
    assert report["closed_form"]["approach"] == pytest.approx(report["neighbour_fraction"], rel=0.1)  # the loads shift a little
    study.print_interaction(report)
    printed = capsys.readouterr().out
    assert "tamaas is not installed" in printed and "closed form, far point loads: approach" in printed


def test_a_body_on_one_spot_per_plate_has_no_neighbours(tmp_path, capsys):
    text = (SCENES / "three_spot.toml").read_text().replace('{side = "lower", x = "1.5 um", z = "-2 um", radius = "1.5 um"},', "")
    scene = Scene.parse(text).with_settings({"solver.distance": "1 nm"})
    timed_run(scene, tmp_path / "run", [], 60.0)
    assert interaction(tmp_path / "run") is None
    study.print_interaction(None)
    assert "no body has two loaded spots" in capsys.readouterr().out


@pytest.mark.full(kind="bem")
@pytest.mark.parametrize("apart", [4.0, 8.0, 16.0])
def test_boundary_elements_come_near_the_far_field_with_distance(apart):
    """A Hertz pressure acts like a point load but for (a/r)^2/10 of the displacement it makes (its second moment, 2 a^2/5, times
    1/(4 r^2)), and the overlap that is refitted changes by a share of 4 a/(3 pi r) squared."""
    tamaas = pytest.importorskip("tamaas")
    spots = pair(apart)
    share = 4.0 / (3.0 * math.pi * apart)
    found, closed = boundary_element_forces(tamaas, spots)["approach"], far_field(spots)["approach"]
    # the grid, 12 cells over the radius, is taken out by a lone spot on it: what is left, 1e-4 of the approach
    assert found == pytest.approx(closed, abs=0.1 * share / apart**2 + 1e-4)
    assert found > closed


@pytest.mark.full(kind="bem")
def test_spots_that_merge_are_refused():
    tamaas = pytest.importorskip("tamaas")
    with pytest.raises(ValueError, match="overlap"):
        boundary_element_forces(tamaas, pair(1.5))
