"""Every shipped scene, shortened: it runs, opens again, and does what its first comment says."""

import functools

import numpy as np
import pytest
from shared_runs import PLATES
from slow import slow
from steel import SCENES, STEEL
import thirdbody
from thirdbody.trajectory.names import ACCOMMODATION, BED

FREE, STICKING, SLIDING, ROLLING = range(4)
# Fewer bodies and a shorter way; the load, the speed and the laws are those of the file.
SHORT = {"debris.0.count": "16", "solver.distance": "1 um", "output.every": "0.1 um"}
# Scenes of one layer that is dragged, a load on every body.
NAMES = ["roller_bearing", "sheared_debris", "sliding_flakes", "scanned_debris"]
# Scenes of other kinds.
OTHERS = {
    "three_spot": {"solver.distance": "40 nm"},
    "mixed_population": {"solver.distance": "0.3 um", "output.every": "0.1 um"},
    # twenty times as fast as the scene, and so twenty times shorter
    "dense_layer": {
        "debris.0.count": "80", "domain.size": ["40 um", "40 um"], "solver.distance": "6 um", "output.every": "1 um",
        "solver.inertial_number": "0.02",
    },
}  # fmt: skip
# Scenes with tests of their own.
ELSEWHERE = {"angular_bed", "ball_on_flat", "fretting", "fretting_rig", "grooves", "million", "punch_on_flat", "rough_plates",
             "sticky_submicron", "wear_map", "worn_by_debris", "yielding_debris"}  # fmt: skip


@pytest.fixture(scope="module")
def runs(tmp_path_factory):

    @functools.cache
    def get(name):
        scene = thirdbody.Scene.load(SCENES / f"{name}.toml").with_settings(OTHERS.get(name, SHORT))
        return scene, thirdbody.run(scene, out=tmp_path_factory.mktemp("scenes") / name, progress=False)

    return get


def test_every_scene_is_tested():
    assert {path.stem for path in SCENES.glob("*.toml")} == {*NAMES, *OTHERS, *ELSEWHERE}


DRAGGED = pytest.mark.parametrize("name", [*NAMES[:3], slow(NAMES[3])])


@DRAGGED
def test_a_run_opens_again_whole_with_finite_series_and_states_counted(name, runs):
    scene, run = runs(name)
    folder = run.path.parent
    with thirdbody.open(folder) as again, thirdbody.open(folder / "run.vtkhdf") as by_file:
        # the start, the end of the settling, and ten of sliding
        assert again.frames == by_file.frames == run.frames == 12
        assert np.array_equal(again.states, run.states)
    summary = run.summary()
    assert summary["finished"] and summary["frames"] == 12
    # a run by distance ends with the first step at or after it
    step = summary["time_step"] * abs(scene.plates.upper.motion.x[-1].velocity)
    assert 1e-6 <= summary["distance"] < 1e-6 + 1.5 * step
    assert thirdbody.Scene.load(folder / "scene.toml") == thirdbody.Scene.parse(run.scene_text) == scene
    _, run = runs(name)
    for series, values in run.series.items():
        assert len(values) == run.frames and series in run.units
        # in the first frame nothing carries load yet but for rounding; a layer has no inside to shear
        loaded = series == "friction_coefficient" or series in (*ACCOMMODATION, *BED)
        inside = series.startswith("inertial_number") or series == "solid_fraction"
        assert inside or np.all(np.isfinite(values[1:] if loaded else values)), series
    assert np.all(np.diff(run.times) > 0.0) and np.all(np.diff(run.series["distance"]) >= 0.0)
    for frame in range(run.frames):
        for arrays in (run.bodies(frame), run.contacts(frame), run.spheres(frame)):
            for array, values in arrays.items():
                # margins tell a distance to a condition that some states do not have
                assert array.startswith("margin_") or np.all(np.isfinite(values)), (frame, array)
    frame = run.to_pandas()
    assert len(frame) == run.frames and np.array_equal(frame["upper_force_z"], run.series["upper_force"][:, 2])
    assert set(frame) >= {"time", "distance", "gap", "friction_coefficient", "fraction_rolling", "energy_residual"}
    scene, run = runs(name)
    assert run.state_names == ["free", "sticking", "sliding", "rolling"]
    assert run.states.shape == run.reasons.shape == (12, scene.debris[0].count)
    assert run.states.max() < 4 and run.reasons.max() < len(run.reason_names)
    for code, state in enumerate(run.state_names):
        assert np.array_equal(run.series[f"fraction_{state}"], np.mean(run.states == code, axis=1))
    # at the start bodies and surfaces touch to rounding: either label is right, and nothing moves
    assert np.all(np.isin(run.states[0], (FREE, STICKING)))
    assert np.all(run.states[1] == STICKING), "pressed and not yet dragged, all stick"


@DRAGGED
def test_forces_balance_and_energy_closes(name, runs):
    scene, run = runs(name)
    load = scene.plates.upper.load * scene.debris[0].count
    for series, sign in (("upper_force", 1.0), ("lower_force", -1.0)):
        # patches on tipping bodies rise and fall: at the drag speed V a dashpot c carries c V = 70 % of the load, with
        # slopes of about 0.3 and random sign 16 of them leave 0.7 * 0.3 / 4 = 5 % of the mean
        assert sign * run.series[series][2:, 2] == pytest.approx(load, rel=0.06)
    # the contract's definition; 1e-3 is the bound that the project promises for the explicit integrator
    assert run.summary()["energy_residual"] < 1e-3
    for line in ("friction", "damping"):
        losses = run.series[f"energy_{line}"]
        # rounding of the stored energies, where nothing slips
        least = 1e-9 * np.abs(losses).max() + 1e-14 * np.abs(run.series["energy_elastic_normal"]).max()
        assert np.all(np.diff(losses) >= -least), "dissipation never comes back"


def test_balls_are_a_roller_bearing(runs):
    """All roll, with a friction coefficient far below the 0.3 of the surfaces, at half the speed of the upper one."""
    scene, run = runs("roller_bearing")
    assert np.all(run.states[-5:] == ROLLING)
    # free rolling of equal balls between parallel plates takes no force at all
    assert np.abs(run.series["friction_coefficient"][-5:]).max() < 1e-3
    last, speed, radius = run.bodies(-1), 0.5, 5e-6
    # the flattened contact makes the lever R - d/2 instead of R: below 1e-3
    assert last["velocity"][:, 0] == pytest.approx(speed / 2.0, rel=1e-3)
    assert last["angular_velocity"][:, 1] == pytest.approx(speed / (2.0 * radius), rel=2e-3)


def test_flakes_slide_and_debris_lies_between(runs):
    _, run = runs("sliding_flakes")
    assert np.all(run.states[-5:] == SLIDING)
    assert run.series["friction_coefficient"][-5:] == pytest.approx(0.2, abs=1e-3)  # that of the pair
    _, run = runs("sheared_debris")
    friction = run.series["friction_coefficient"][3:]
    assert np.all(np.isin(run.states[3:], (STICKING, SLIDING, ROLLING)))
    assert np.all((friction > 0.0) & (friction < 0.3 * (1.0 + 1e-3)))


def utilisation(run, frame):
    """Of the three spots, in the order of the scene: the upper one, then the lower ones by x."""
    contacts = run.contacts(frame)
    return contacts["utilisation"][np.lexsort((contacts["position"][:, 0], contacts["side"] == 0))]


def test_the_three_spot_particle_sticks_and_then_slides(runs):
    _, run = runs("three_spot")
    states = run.states[:, 0]
    assert states[1] == STICKING and np.all(states[-20:] == SLIDING)
    assert np.all(utilisation(run, 1) > 0.1)  # pressing alone loads the spots tangentially
    slid = [next(f for f in range(run.frames) if f and utilisation(run, f)[k] > 0.999) for k in range(3)]
    assert slid[2] < slid[0] and slid[2] < slid[1], "the lower spot with the smaller load goes first"
    assert run.series["friction_coefficient"][-1] == pytest.approx(0.3, rel=1e-4)
    contacts = run.contacts(-1)
    lower = np.flatnonzero(contacts["side"] == 0)
    left, right = contacts["normal_force"][lower[np.argsort(contacts["position"][lower, 0])]]
    # (x3 - x1 + mu h)/(x1 - x2 - mu h), x = .2, -2, 1.5 and h = 4 um; the particle has turned by 4.5e-4 rad, 1e-3 of the arms
    assert left / right == pytest.approx((1.3 + 1.2) / (2.2 - 1.2), rel=3e-3)


@pytest.mark.full(kind="slow")
def test_hard_grains_carry_more_than_their_share(runs):
    """At the end of pressing; the foundation then carries the load within 1 %."""
    _, run = runs("mixed_population")
    contacts, population = run.contacts(1), run.bodies(1)["population"]
    assert run.population_names == ["soft debris", "hard grains"] and run.material_names == ["steel", "bronze", "alumina"]
    upper = contacts["side"] == 1
    load = np.bincount(contacts["body"][upper], contacts["normal_force"][upper], minlength=len(population))
    # 12 relaxation times of the patches: the load is reached within the 1 % that load control promises
    assert load.sum() == pytest.approx(20e-3, rel=0.01)
    assert load[population == 1].mean() > 2.0 * load[population == 0].mean()
    assert np.any(load[population == 0] == 0.0)
    assert np.all(np.isin(run.states[1], (FREE, STICKING))) and run.summary()["energy_residual"] < 1e-3


@pytest.mark.full(kind="slow")
def test_a_dense_bed_carries_the_plate_and_shears(runs):
    _, run = runs("dense_layer")
    assert run.summary()["energy_residual"] < 1e-3
    # pressed: the plate carries its load, 2.5 MPa on 40 um by 40 um
    assert run.series["upper_force"][1, 2] == pytest.approx(4e-3, rel=0.3)
    friction = run.series["friction_coefficient"][2:]
    assert np.all((friction > 0.2) & (friction < 0.81))
    assert (run.contacts(run.frames - 1)["side"] == 2).sum() > 60, "the bodies meet each other"
    assert run.series["gap"][-1] > run.series["gap"][1], "a bed that shears dilates"


OBLATE = (
    '[[debris]]\nmaterial = "steel"\nkind = "spheroid"\nform = "oblate"\ncount = 3\nsize = "10 um"\n'
    "axial_ratio = {}\nspheres = {}\n"
)
DRAG = 'size = ["120 um", "90 um"]\n', '"implicit"\ndistance = "4 um"\n[output]\nevery = "0.5 um"\n'


def test_flat_spheroids_slide_and_round_ones_roll(tmp_path):
    # between parallel plates a rigid ellipse rolls if its axial ratio is above sqrt(1 + mu^2) - mu: 0.744 at friction 0.3
    bodies = STEEL + OBLATE.format(0.5, 61) + OBLATE.format(0.9, 37)
    scene = bodies + "[domain]\n" + DRAG[0] + PLATES + '[contact]\ndebris_contact = "none"\n[solver]\nintegrator = ' + DRAG[1]
    with thirdbody.run(thirdbody.Scene.parse(scene), out=tmp_path / "spheroids", progress=False) as run:
        states = run.states[-1].reshape(2, 3)
    assert np.all(states[0] == SLIDING) and np.all(states[1] == ROLLING)
