"""Settling of automatic length ends when load on debris, gap and kinetic energy are steady; means of the drag leave it out."""

import pytest
from balls import BALLS, edited
from gallery import SCENES
from slow import slow
from steel import HOT_STEEL, STEEL
import thirdbody
from thirdbody.kernels.tables import UPPER
from thirdbody.runner.simulate import prepare
from .test_resume import check_in_pieces

NONE, WAVES = {"plates.contact": None}, {"long": "14 um", "short": "7 um"}
RIGID = {"plates.upper.support": "rigid", "plates.upper.pressure": "20 kPa"}
RIGID |= {f"plates.upper.{key}": None for key in ("stiffness", "damping")}
SUPPORTS = {
    "foundation, contact": {}, "foundation": NONE, "rigid, contact": RIGID, "rigid": RIGID | NONE,
    "held": NONE | {"plates.upper.pressure": None, "plates.upper.gap": "3.2 um"},
    "load per particle": RIGID | NONE | {
        "plates.upper.support": "load_per_particle", "plates.upper.pressure": None, "plates.upper.load": "0.05 mN",
    },
}  # fmt: skip


def rough(**changes):
    """Of the scene rough_plates, with shorter waves."""
    waves = {f"plates.{side}.surface.{end}": size for side in ("lower", "upper") for end, size in WAVES.items()}
    few = {"debris.0.count": 24, "domain.size": ["33 um", "28 um"], "solver.distance": "20 nm", "output.every": "10 nm"}
    return thirdbody.Scene.load(SCENES / "rough_plates.toml").with_settings(waves | few | changes)


def settled(run):
    """Load on debris (N) and gap (m) at the end of settling."""
    contacts = run.contacts(1)
    return contacts["normal_force"][contacts["side"] == UPPER].sum(), run.series["gap"][1]


@pytest.mark.parametrize("integrator, support", [
    ("explicit", "foundation, contact"), *(slow("implicit", support) for support in SUPPORTS), slow("explicit", "held"),
    slow("explicit", "foundation"), slow("explicit", "load per particle"),  # (under a rigid plate a body at rest tips much later)
])  # fmt: skip
def test_load_and_gap_are_those_of_a_longer_settling(integrator, support, tmp_path):
    scene = rough(**SUPPORTS[support], **{"solver.integrator": integrator})
    run = thirdbody.run(scene, tmp_path / "auto", progress=False)
    time, expected = run.summary()["settling"]["time"], prepare(scene).settle
    assert time <= 3.0 * expected and run.drag.begin == time and run.summary()["settling"]["steady"]
    longer = thirdbody.run(scene.with_settings({"solver.settle": 4.0 * time}), tmp_path / "longer", progress=False)
    assert settled(run) == pytest.approx(settled(longer), rel=0.02)


def test_a_plate_that_bounces_on_is_told_with_numbers(tmp_path):
    keys = {"support": "rigid", "damping": "1e-12 kg/s"}
    keys = {f"plates.upper.{key}": value for key, value in keys.items()} | {"solver.settle": "auto", "pairs.0.restitution": 1.0}
    run = thirdbody.run(thirdbody.Scene.parse(BALLS).with_settings(keys), tmp_path / "run", progress=False)
    found, (warning,) = run.summary()["settling"], [text for text in run.warnings if "settled" in text]
    assert not found["steady"] and f"{100.0 * found['bounce']:.2g} % as plate" in warning and "periods" in warning


def test_the_negative_energy_of_adhesion_counts_by_its_size(tmp_path):
    keys = {"effects.adhesion": {"work_of_adhesion": "1 J/m2", "model": "dmt"}, "plates.upper.load": "0.02 mN"}
    scene = thirdbody.Scene.parse(BALLS).with_settings(keys | {"solver.settle": "auto"})
    run = thirdbody.run(scene, tmp_path / "run", progress=False)
    assert run.series["energy_elastic_normal"][1] < 0.0 and run.summary()["settling"]["steady"]


@pytest.mark.parametrize("every", [slow({}), slow({"output.every": "2 ns"})])
def test_a_run_in_pieces_is_the_whole_run_where_settling_is_extended(every, tmp_path):
    whole = check_in_pieces(rough(**every), tmp_path)[0]
    assert whole.extended > 0


def test_means_are_of_the_drag_alone(tmp_path):
    """By time settling ends within an output interval, by distance with a frame: both hold the means since then."""
    scene = thirdbody.Scene.parse(edited(BALLS, (STEEL, HOT_STEEL)) + "[measures]\nflash_temperature = true\n")
    keys = [{"solver.distance": "0.25 um", "output.every": every} for every in ("0.25 um", "1.5 us")]
    runs = [thirdbody.run(scene.with_settings(more), tmp_path / str(k), progress=False) for k, more in enumerate(keys)]
    first, second = (run.bodies(-1) | {name: series[-1] for name, series in run.series.items()} for run in runs)
    for name in ("upper_force", "lower_force", "friction_coefficient", "flash_temperature_mean"):
        # sums are collected at every stop, so by distance and by time they are rounded differently
        assert first[name] == pytest.approx(second[name], rel=1e-9, abs=1e-18), name
    # both contacts of a ball are closed for half a microsecond; one step is 0.3 % of it
    assert first["measured_time"] == pytest.approx(2.0 * 0.5e-6, rel=0.01)
    assert all(run.drag.durations[-1] == pytest.approx(0.5e-6, rel=0.01) and run.drag.during[-1] for run in runs)
