"""What the shipped scenes of other kinds promise in their first comments."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from steel import STEEL

import thirdbody

SCENES = Path(__file__).parents[2] / "scenes"
FREE, STICKING, SLIDING, ROLLING = range(4)


def shortened(name: str, folder: Path, settings: dict[str, str]) -> thirdbody.Run:
    scene = thirdbody.Scene.load(SCENES / f"{name}.toml").with_settings(settings)
    return thirdbody.run(scene, out=folder / name, progress=False)


@pytest.fixture(scope="module")
def three_spot(tmp_path_factory):
    with shortened("three_spot", tmp_path_factory.mktemp("kinds"), {"solver.distance": "40 nm"}) as run:
        yield run


def utilisation(run, frame: int) -> np.ndarray:
    """Of the three spots, in the order of the scene: the upper one, then the lower ones by x."""
    contacts = run.contacts(frame)
    order = np.lexsort((contacts["position"][:, 0], contacts["side"] == 0))
    return contacts["utilisation"][order]


def test_the_three_spot_particle_sticks_and_then_slides(three_spot):
    run = three_spot
    states = run.states[:, 0]
    assert states[1] == STICKING and np.all(states[-20:] == SLIDING)
    # pressing alone loads the spots tangentially
    assert np.all(utilisation(run, 1) > 0.1)
    slid = [next(f for f in range(run.frames) if f and utilisation(run, f)[k] > 0.999) for k in range(3)]
    assert slid[2] < slid[0] and slid[2] < slid[1], "the lower spot with the smaller load goes first"
    assert run.series["friction_coefficient"][-1] == pytest.approx(0.3, rel=1e-4)


def test_the_lower_spots_share_the_load_as_statics_says(three_spot):
    contacts = three_spot.contacts(three_spot.frames - 1)
    lower = np.flatnonzero(contacts["side"] == 0)
    left, right = contacts["normal_force"][lower[np.argsort(contacts["position"][lower, 0])]]
    # (x3 - x1 + mu h)/(x1 - x2 - mu h), x = .2, -2, 1.5 and h = 4 um; the particle has turned by 4.5e-4 rad, 1e-3 of the arms
    assert left / right == pytest.approx((1.3 + 1.2) / (2.2 - 1.2), rel=3e-3)


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    settings = {"solver.distance": "0.5 um", "output.every": "0.1 um"}
    with shortened("mixed_population", tmp_path_factory.mktemp("kinds"), settings) as run:
        yield run


def test_hard_grains_carry_more_than_their_share(mixed):
    """At the end of pressing; the foundation then carries the load within 1 %."""
    contacts, population = mixed.contacts(1), mixed.bodies(1)["population"]
    assert mixed.population_names == ["soft debris", "hard grains"] and mixed.material_names == ["steel", "bronze", "alumina"]
    upper = contacts["side"] == 1
    load = np.bincount(contacts["body"][upper], contacts["normal_force"][upper], minlength=len(population))
    # 12 relaxation times of the patches: the load is reached within the 1 % that load control promises
    assert load.sum() == pytest.approx(20e-3, rel=0.01)
    assert load[population == 1].mean() > 2.0 * load[population == 0].mean()
    assert np.any(load[population == 0] == 0.0)
    assert np.all(np.isin(mixed.states[1], (FREE, STICKING)))


def test_the_ledger_of_a_foundation_closes(mixed):
    assert mixed.summary()["energy_residual"] < 1e-3


@pytest.fixture(scope="module")
def dense(tmp_path_factory):
    settings = {"debris.0.count": "80", "domain.size": ["40 um", "40 um"], "solver.distance": "6 um", "output.every": "1 um"}
    settings["solver.inertial_number"] = "0.02"  # twenty times as fast as the scene, and so twenty times shorter
    with shortened("dense_layer", tmp_path_factory.mktemp("kinds"), settings) as run:
        yield run


def test_a_dense_bed_carries_the_plate_and_shears(dense):
    run = dense
    assert run.summary()["energy_residual"] < 1e-3
    # pressed: the plate carries its load, 2.5 MPa on 40 um by 40 um
    assert run.series["upper_force"][1, 2] == pytest.approx(4e-3, rel=0.3)
    friction = run.series["friction_coefficient"][2:]
    assert np.all((friction > 0.2) & (friction < 0.81))
    debris = run.contacts(run.frames - 1)["side"] == 2
    assert debris.sum() > 60, "the bodies meet each other"
    # a bed that shears dilates
    assert run.series["gap"][-1] > run.series["gap"][1]


SPHEROIDS = (
    STEEL
    + """\
[[debris]]
material = "steel"
kind = "spheroid"
count = 6
size = "10 um"
axial_ratio = 0.5
form = "oblate"
spheres = 61
[[debris]]
material = "steel"
kind = "spheroid"
count = 6
size = "10 um"
axial_ratio = 0.9
form = "oblate"
spheres = 37
[domain]
size = ["120 um", "90 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
motion = {x = {velocity = "0.01 m/s"}}
[contact]
debris_contact = "none"
[solver]
integrator = "implicit"
distance = "4 um"
[output]
every = "0.5 um"
"""
)


def test_flat_spheroids_slide_and_round_ones_roll(tmp_path):
    # between parallel plates a rigid ellipse rolls if its axial ratio is above sqrt(1 + mu^2) - mu: 0.744 at friction 0.3
    with thirdbody.run(thirdbody.Scene.parse(SPHEROIDS), out=tmp_path / "spheroids", progress=False) as run:
        states = run.states[-1].reshape(2, 6)
    assert np.all(states[0] == SLIDING) and np.all(states[1] == ROLLING)
