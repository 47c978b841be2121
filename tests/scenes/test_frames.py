"""Every shipped scene, shortened: it runs, opens again, and does what its first comment says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import thirdbody
from thirdbody.trajectory.names import ACCOMMODATION, BED

SCENES = Path(__file__).parents[2] / "scenes"
FREE, STICKING, SLIDING, ROLLING = range(4)

# Fewer bodies and a shorter way; the load, the speed and the laws are those of the file.
SHORT = {"debris.0.count": "16", "solver.distance": "1 um", "output.every": "0.1 um"}
# Scenes of one layer that is dragged, a load on every body.
NAMES = ["roller_bearing", "scanned_debris", "sheared_debris", "sliding_flakes"]
# Scenes of other kinds, with tests of their own.
OTHERS = [
    "angular_bed", "dense_layer", "fretting", "fretting_rig", "grooves", "million", "mixed_population", "rough_plates",
    "sticky_submicron", "three_spot", "wear_map", "yielding_debris",
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("scenes")


@pytest.fixture(scope="module")
def runs(folder):
    """name -> (scene, opened run), each simulated once."""
    done: dict[str, tuple[thirdbody.Scene, thirdbody.Run]] = {}

    def get(name: str) -> tuple[thirdbody.Scene, thirdbody.Run]:
        if name not in done:
            scene = thirdbody.Scene.load(SCENES / f"{name}.toml").with_settings(SHORT)
            done[name] = scene, thirdbody.run(scene, out=folder / name, progress=False)
        return done[name]

    yield get
    for _, run in done.values():
        run.close()


def test_there_are_scenes():
    assert {path.stem for path in SCENES.glob("*.toml")} == set(NAMES) | set(OTHERS)


@pytest.mark.parametrize("name", NAMES + OTHERS)
def test_a_scene_begins_with_what_to_expect(name):
    lines = (SCENES / f"{name}.toml").read_text(encoding="utf-8").splitlines()
    comment = [line for line in lines if line.startswith("#")]
    assert lines[0].startswith("# ") and lines[0].endswith("?"), "the first line asks one physical question"
    assert any("xpect" in line for line in comment), "a comment says what to expect"


@pytest.mark.parametrize("name", NAMES)
def test_a_run_opens_again_and_is_whole(name, runs, folder):
    scene, run = runs(name)
    with thirdbody.open(folder / name) as again, thirdbody.open(folder / name / "run.vtkhdf") as by_file:
        # the start, the end of the settling, and ten of sliding
        assert again.frames == by_file.frames == run.frames == 12
        assert np.array_equal(again.states, run.states)
    summary = run.summary()
    assert summary["finished"] and summary["frames"] == 12
    # a run by distance ends with the first step at or after it
    step = summary["time_step"] * abs(scene.plates.upper.motion.x[-1].velocity)
    assert 1e-6 <= summary["distance"] < 1e-6 + 1.5 * step


@pytest.mark.parametrize("name", NAMES)
def test_series_are_finite_where_they_must_be(name, runs):
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


@pytest.mark.parametrize("name", NAMES)
def test_states_are_valid_and_counted(name, runs):
    scene, run = runs(name)
    assert run.state_names == ["free", "sticking", "sliding", "rolling"]
    assert run.states.shape == run.reasons.shape == (12, scene.debris[0].count)
    assert run.states.max() < 4 and run.reasons.max() < len(run.reason_names)
    for code, state in enumerate(run.state_names):
        assert np.array_equal(run.series[f"fraction_{state}"], np.mean(run.states == code, axis=1))
    # at the start bodies and surfaces touch to rounding: either label is right, and nothing moves
    assert np.all(np.isin(run.states[0], (FREE, STICKING)))
    assert np.all(run.states[1] == STICKING), "pressed and not yet dragged, all stick"


@pytest.mark.parametrize("name", NAMES)
def test_forces_balance_and_energy_closes(name, runs):
    scene, run = runs(name)
    load = scene.plates.upper.load * scene.debris[0].count
    for series in ("upper_force", "lower_force"):
        normal = run.series[series][2:, 2] * (1.0 if series == "upper_force" else -1.0)
        # patches on tipping bodies rise and fall: at the drag speed V a dashpot c carries c V = 70 % of the load, with
        # slopes of about 0.3 and random sign 16 of them leave 0.7 * 0.3 / 4 = 5 % of the mean
        assert normal == pytest.approx(load, rel=0.06)
    # the contract's definition; 1e-3 is the bound that the project promises for the explicit integrator
    assert run.summary()["energy_residual"] < 1e-3
    for line in ("friction", "damping"):
        losses = run.series[f"energy_{line}"]
        # rounding of the stored energies, where nothing slips
        least = 1e-9 * np.abs(losses).max() + 1e-14 * np.abs(run.series["energy_elastic_normal"]).max()
        assert np.all(np.diff(losses) >= -least), "dissipation never comes back"


@pytest.mark.parametrize("name", NAMES)
def test_the_scene_beside_the_run_is_the_scene(name, runs, folder):
    scene, run = runs(name)
    assert thirdbody.Scene.load(folder / name / "scene.toml") == scene
    assert thirdbody.Scene.parse(run.scene_text) == scene


@pytest.mark.parametrize("name", NAMES)
def test_pandas_gets_every_series(name, runs):
    pytest.importorskip("pandas")
    _, run = runs(name)
    frame = run.to_pandas()
    assert len(frame) == run.frames
    assert np.array_equal(frame["upper_force_z"], run.series["upper_force"][:, 2])
    assert set(frame) >= {"time", "distance", "gap", "friction_coefficient", "fraction_rolling", "energy_residual"}


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


def test_flakes_slide(runs):
    """All slide, and the friction coefficient is that of the pair."""
    _, run = runs("sliding_flakes")
    assert np.all(run.states[-5:] == SLIDING)
    assert run.series["friction_coefficient"][-5:] == pytest.approx(0.2, abs=1e-3)


def test_debris_lies_between(runs):
    """Irregular debris: some of every kind, and a friction coefficient between that of rolling and of sliding."""
    _, run = runs("sheared_debris")
    assert np.all(np.isin(run.states[3:], (STICKING, SLIDING, ROLLING)))
    assert np.all(run.series["friction_coefficient"][3:] < 0.3 * (1.0 + 1e-3))
    assert np.all(run.series["friction_coefficient"][3:] > 0.0)
