"""The rate test: the last third of a run once more with a slower plate, in pieces too, and the scenes that cannot have one."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from trajectories import contents

import thirdbody
from thirdbody.assembly.schedule import slowed
from thirdbody.engine.upper_plate import Schedule, Segment
from thirdbody.errors import GuardStop, InputError, Interrupted
from thirdbody.kernels.schedule import POLYNOMIAL, SINE, TRIANGLE
from thirdbody.plot.summary_page import page
from thirdbody.report.tables import run_report
from thirdbody.runner.prepare import prepare
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.run_folder import refuse_existing
from thirdbody.runner.simulate import execute
from thirdbody.trajectory.rate_test import matched_frames

SCENES = Path(__file__).parents[2] / "scenes"
SMALL: dict[str, object] = {
    "debris.0.count": "40", "domain.size": ["30 um", "24 um"], "solver.settle": "0.5 us", "solver.inertial_number": None,
    "plates.upper.motion.x.velocity": "2 m/s", "solver.distance": "0.45 um", "output.every": "0.01 um",
}  # fmt: skip
FACTOR = 3.0


def bed(**changes: str | None) -> thirdbody.Scene:
    """Return a small bed of clumps that is sheared a little; keys of the solver may be changed."""
    settings = SMALL | {"solver.rate_test": FACTOR} | {f"solver.{key}": value for key, value in changes.items()}
    return thirdbody.Scene.load(SCENES / "dense_layer.toml").with_settings(settings)


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("rate") / "run"
    execute(prepare(bed()), folder)
    return folder


@pytest.mark.parametrize("segment", [
    Segment(1.0, POLYNOMIAL, 2.0, 3.0, 4.0), Segment(1.0, SINE, 2.0, 3.0, 40.0), Segment(1.0, TRIANGLE, 2.0, 3.0, 5.0),
])  # fmt: skip
def test_a_slowed_schedule_takes_the_same_path(segment):
    whole = Schedule(x=(segment, Segment(3.0, POLYNOMIAL, segment.value(3.0), 0.5)), load=(Segment(0.0, POLYNOMIAL, 1.0, 0.25),))
    later = slowed(whole, 2.0, FACTOR)
    times = np.linspace(2.0, 4.0, 41)
    for t in times:
        after = 2.0 + (t - 2.0) * FACTOR
        # rounding of the phase of a stroke
        assert later.displacement_at(after) == pytest.approx(whole.displacement_at(t), rel=1e-12, abs=1e-12)
        assert later.load[-1].value(after) == pytest.approx(whole.load[-1].value(t), rel=1e-14)
    assert later.path(2.0, 2.0 + 2.0 * FACTOR) == pytest.approx(whole.path(2.0, 4.0), rel=1e-5)  # chords of strokes: 1e-6
    speed = (later.displacement_at(2.0 + 1e-6)[0] - later.displacement_at(2.0)[0]) / 1e-6
    assert speed == pytest.approx(segment.rate(2.0 + 1e-9) / FACTOR, rel=1e-4)


def test_the_run_itself_is_the_same_without_its_rate_test(finished, tmp_path):
    execute(prepare(bed(rate_test=None)), tmp_path / "alone")
    alone, tested = contents(tmp_path / "alone"), contents(finished)
    assert [key for key in alone if alone[key] != tested[key]] == [] and alone.keys() == tested.keys()


def test_the_rate_test_goes_on_from_two_thirds_along_the_same_path(finished):
    with thirdbody.open(finished) as run, thirdbody.open(finished / "rate_test") as test:
        fast, slow = matched_frames(run, test, FACTOR)
        first = fast[0] - 1
        assert test.header["rate_test"]["changeover"] == test.times[0] == run.times[first]
        assert run.series["distance"][first] == pytest.approx(0.3e-6, rel=1e-2)  # an output ends within a step: 1 nm
        assert len(fast) == 15 == test.frames - 1
        for name in ("position", "quaternion", "velocity", "friction_work"):
            assert np.array_equal(test.bodies(0)[name], run.bodies(int(first))[name])
        step = 2.0 * 1e-9  # of sliding: at 2 m/s the time step is below 1 ns
        assert np.abs(test.series["displacement"][slow] - run.series["displacement"][fast]).max() < step
        assert np.abs(test.series["distance"][slow] - run.series["distance"][fast]).max() < step
        taken = np.diff(test.times[slow]).sum() / np.diff(run.times[fast]).sum()
        assert taken == pytest.approx(FACTOR, rel=2e-2)  # both end within a step of 14 intervals of some steps each
        assert np.all(np.diff(test.series["energy_friction"]) > 0.0)
        # cumulative quantities go on from those of the run
        assert test.series["energy_plate_work"][0] == run.series["energy_plate_work"][first]


def test_every_output_has_the_verdict(finished, capsys):
    with thirdbody.open(finished) as run:
        result = run.rate_test
        assert result is not None and result.finished and result.factor == FACTOR
        assert result.intervals == 12 and result.quantities[0].name == "friction_coefficient"
        assert {entry.name for entry in result.quantities} >= {"fraction_sticking", "fraction_rolling"}
        friction = result.quantities[0]
        extrapolated = friction.slow - (friction.fast - friction.slow) / (FACTOR - 1.0)
        assert result.quasi_static_friction == pytest.approx(extrapolated, rel=1e-12)
        assert run.summary()["rate_test"]["verdict"] == result.verdict
        assert set(run.summary()["rate_test"]["quantities"]) == {entry.name for entry in result.quantities}
        figure = page(run)
        words = " ".join(" ".join(text.get_text() for text in figure.texts).split())
        assert result.verdict.split(";")[0] in words.replace("\N{NO-BREAK SPACE}", " ")
        assert "rate_test" in [axes.get_label() for axes in figure.axes]
    run_report(finished, json=True)
    assert json.loads(capsys.readouterr().out)["rate_test"]["verdict"] == result.verdict
    run_report(finished, json=False)
    assert "rate test" in capsys.readouterr().out
    with thirdbody.open(finished / "rate_test") as test:
        assert test.rate_test is None and "rate_test" not in test.summary()


def after(number: int, begun):
    """Return a function that says stop from that many calls on, counted from when part of the run has begun."""
    left = iter(range(number))
    return lambda: begun() and next(left, None) is None


def test_run_and_rate_test_in_pieces_are_the_whole(finished, tmp_path):
    folder, simulation, saved = tmp_path / "cut", prepare(bed()), None
    inside = folder / "rate_test" / "run.vtkhdf"
    for piece, begun in enumerate((lambda: True, inside.is_file)):
        with pytest.raises(Interrupted) as caught:
            execute(simulation, folder, 1 + piece % 2, checkpoint=saved, stop=after(50, begun))
        assert str(caught.value).endswith(f"thirdbody.resume({str(folder)!r})")  # never the folder inside
        with thirdbody.open(folder) as run:
            assert not run.rate_test.finished and run.summary()["finished"] == (piece > 0)
        simulation, saved = prepare_resume(folder)
    execute(simulation, folder, checkpoint=saved)
    for part in (".", "rate_test"):
        whole, joined = contents(finished / part), contents(folder / part)
        assert [key for key in whole if whole[key] != joined[key]] == [] and whole.keys() == joined.keys()


def test_resume_of_the_folder_inside_and_of_a_run_past_two_thirds_is_refused(finished):
    with pytest.raises(InputError, match="is the rate test of a run"):
        prepare_resume(finished / "rate_test")
    with pytest.raises(InputError, match="rate test would begin at two thirds of the longer run, which it has passed"):
        prepare_resume(finished, {"solver.distance": "0.6 um"})
    prepare_resume(finished, {"solver.distance": "0.7 um"})


def test_a_foreign_rate_test_is_refused_and_a_copy_of_the_file_alone_has_none(finished, tmp_path):
    folder = Path(shutil.copytree(finished, tmp_path / "run"))
    simulation, saved = prepare_resume(folder)
    simulation.requested = simulation.requested.with_settings({"title": "another"})
    with pytest.raises(InputError, match="the rate test of another run"):
        execute(simulation, folder, checkpoint=saved)
    shutil.rmtree(folder / "rate_test")
    with thirdbody.open(folder) as run:
        assert run.rate_test.effect is None and "no rate test beside this run" in run.rate_test.verdict


def test_a_new_run_replaces_the_rate_test_of_the_old_one(finished, tmp_path):
    folder = Path(shutil.copytree(finished, tmp_path / "run"))
    refuse_existing(folder, overwrite=True)
    count = iter(range(3))
    with pytest.raises(Interrupted):
        execute(prepare(bed()), folder, overwrite=True, stop=lambda: next(count, None) is None)
    assert not (folder / "rate_test").exists() and (folder / "run.vtkhdf").exists()


def test_a_guard_in_the_rate_test_leaves_the_run(finished, tmp_path, monkeypatch):
    from thirdbody.runner import simulate

    folder = Path(shutil.copytree(finished, tmp_path / "run"))

    def stopped(simulation, loop, checkpoint):
        raise GuardStop("stopped at t = 1 s: too deep")

    simulation, saved = prepare_resume(folder)
    monkeypatch.setattr(simulate, "_execute", stopped)
    with pytest.raises(GuardStop, match="the rate test: stopped at t = 1 s: too deep"):
        execute(simulation, folder, checkpoint=saved)
    with thirdbody.open(folder) as run:
        assert run.summary()["finished"]


@pytest.mark.full(kind="slow")
def test_strokes_are_compared_by_the_size_of_their_friction(tmp_path):
    """A run of one and a half cycles, whose last third begins at a turn and has none inside."""
    strokes = {
        "plates.upper.motion": {"x": {"stroke": "0.2 um", "frequency": "2 MHz", "shape": "triangle"}},
        "solver.duration": "0.75 us", "output.every": "0.0125 us",
    }  # fmt: skip
    execute(prepare(bed().with_settings(strokes)), tmp_path / "run")
    with thirdbody.open(tmp_path / "run") as run, thirdbody.open(tmp_path / "run" / "rate_test") as test:
        assert run.drag.stroke and run.rate_test.finished and run.rate_test.intervals == 16
        friction = run.rate_test.quantities[0]
        assert friction.fast > 0.1 and friction.slow > 0.1  # the plate moves against its first direction there, or along it
        fast, slow = matched_frames(run, test, FACTOR)
        taken = test.times[slow][-1] - test.times[0]
        assert taken == pytest.approx(FACTOR * (run.times[fast][-1] - test.times[0]), rel=1e-2)  # ends within a step
        # the same place at the speed of 0.8 m/s: both end within a step below 1 ns
        assert np.abs(test.series["displacement"][slow] - run.series["displacement"][fast]).max() < 2e-9


@pytest.mark.parametrize(("changes", "message"), [
    ({"solver.rate_test": 1.0}, "solver.rate_test: 1.0 must be greater than 1 and at most 100"),
    ({"solver.rate_test": 101}, "must be greater than 1 and at most 100"),
    ({"solver.rate_test": "3 m"}, "solver.rate_test"),
    ({"contact.debris_contact": "none"}, "is for a bed, whose bodies meet each other, and contact.debris_contact"),
    ({"solver.integrator": "implicit"}, "which needs the explicit integrator"),
    (
        {"plates.upper.motion": None, "solver.duration": "1 us", "output.every": "0.01 us"},
        "here it rests: add plates.upper.motion",
    ),
])  # fmt: skip
def test_a_scene_that_can_have_no_rate_test_is_refused_when_it_is_read(changes, message):
    with pytest.raises(InputError) as caught:
        bed().with_settings(changes)
    assert message in str(caught.value)


@pytest.mark.parametrize(("changes", "message"), [
    ({"output.every": "0.02 um"}, "needs at least 15 outputs in the last third of the run, here 7: .* at most 10 nm"),
    (
        {"debris.0.count": "1", "debris.0.solid_fraction": None, "debris.0.placement": "layer", "solver.integrator": "explicit"},
        "is for a bed, whose bodies meet each other, and here none do",
    ),
    (
        {"plates.upper.motion": {"x": [{"velocity": "2 m/s", "duration": "0.2 us"}, {"pause": "1 us"}]},
         "solver.duration": "0.6 us", "output.every": "0.01 us"},
        "rests in the last third of this run",
    ),
])  # fmt: skip
def test_a_scene_that_turns_out_to_have_no_rate_test_is_refused_when_it_is_built(changes, message):
    with pytest.raises(InputError, match=message):
        prepare(bed().with_settings(changes))
