"""Outputs as often as steps, and more often: stops are heard there too, no frame is written twice, and `check` prices frames."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from balls import BALLS, edited
from slow import slow
from trajectories import contents
import thirdbody
from thirdbody.engine import explicit
from thirdbody.errors import Interrupted
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.simulate import execute, prepare
from .test_resume import check_in_pieces

SHEARED = Path(__file__).parents[2] / "scenes" / "sheared_debris.toml"
END = 'distance = "150 nm"\nsettle = "0.1 us"\nintegrator = "explicit"'
SCENE = edited(
    BALLS, ('title = "four balls"\n', ""), ('damping = "7e-5 kg/s"\n', ""), ("0.5 m/s", "1 m/s"),
    ('distance = "0.1 um"\nsettle = "1 us"', END), ("0.05 um", "150 nm"),
)  # fmt: skip
"""A step is some 0.9 nm of sliding."""
TOGETHER = {"plates.upper.support": "rigid", "solver.integrator": "implicit", "contact.debris_contact": "none"}
"""All bodies carry one plate, so that they go step by step together."""


def scene(**settings):
    keys = {key.replace("_", ".", 1): value for key, value in settings.items()}
    return thirdbody.Scene.parse(SCENE, "balls.toml").with_settings(keys)


def differences(one, other):
    first, second = contents(one), contents(other)
    return [name for name in first if first[name] != second.get(name)]


@pytest.mark.parametrize("every, more", [
    ("4 nm", {}), slow("0.3 nm", {}), slow("10 pm", {}), slow("0.1 nm", TOGETHER | {"solver.distance": "1 nm"}),
])  # fmt: skip
def test_a_stop_is_heard_where_outputs_are_a_few_steps_apart(tmp_path, every, more):
    check_in_pieces(scene(output_every=every, solver_distance="20 nm").with_settings(more), tmp_path)


def test_calls_of_one_step_come_to_the_same_bits(tmp_path, monkeypatch):
    """As many steps as take a second are made in one compiled call, which may be one: a large scene hears a signal too."""
    execute(prepare(scene()), tmp_path / "long")
    monkeypatch.setattr(explicit, "CALL", 0.0)
    guard = itertools.count()
    execute(prepare(scene()), tmp_path / "short", stop=lambda: next(guard) < 0)
    assert next(guard) > 150
    assert differences(tmp_path / "long", tmp_path / "short") == []


def test_an_interval_below_a_step_writes_one_frame_after_every_step(tmp_path):
    simulation = prepare(scene(solver_distance="20 nm", output_every="0.1 ns"))
    assert [text for text in simulation.warnings if "output.every" in text and "one frame after every step" in text]
    execute(simulation, tmp_path / "run")
    with thirdbody.open(tmp_path / "run") as run:
        assert np.all(np.diff(run.times) > 0.0)
        steps = run.summary()["steps"]
        assert steps > 100 and run.series["distance"][-1] >= 20e-9 * (1.0 - 1e-6)
        assert run.frames == steps + 1


def test_check_prices_frames_as_the_run_has_them(tmp_path):
    """A frame of a few bodies takes far longer than the step before it, on any machine."""
    wanted = scene(output_every="10 pm", solver_distance="20 nm")
    report = thirdbody.check(wanted)
    assert report["estimated_wall_time"] == report["estimated_step_time"] + report["estimated_frame_time"]
    assert report["estimated_frame_time"] > 10.0 * report["estimated_step_time"]
    assert "they take" in str(report)
    with thirdbody.run(wanted, tmp_path / "run", progress=False) as run:
        # the time step follows the contacts, and changes on the way
        assert report["frames"] == pytest.approx(run.frames, rel=0.2)
        # contacts of a body are taken to be three; here they are two
        assert report["disk"] == pytest.approx((tmp_path / "run" / "run.vtkhdf").stat().st_size, rel=0.2)


@pytest.mark.full(kind="slow")
def test_a_stop_is_heard_while_earlier_frames_are_copied(tmp_path):
    """`resume` copies the trajectory, which takes minutes where it has a hundred thousand frames."""
    wanted, cut = scene(output_every="2 nm", solver_distance="20 nm"), tmp_path / "cut"
    execute(prepare(wanted), tmp_path / "whole")
    counter = itertools.count()
    with pytest.raises(Interrupted):
        execute(prepare(wanted), cut, stop=lambda: next(counter) > 70)
    before = {path.name: path.read_bytes() for path in cut.iterdir()}
    for guard in (1, 8):  # at the first frame that is copied, and among them
        simulation, kept = prepare_resume(cut)
        assert kept.frames > 8
        counter = itertools.count(1)
        with pytest.raises(Interrupted, match="before it went on") as stopped:
            execute(simulation, cut, checkpoint=kept, stop=lambda: next(counter) >= guard)  # noqa: B023
        assert not stopped.value.advanced
        assert {path.name: path.read_bytes() for path in cut.iterdir()} == before
    simulation, kept = prepare_resume(cut)
    execute(simulation, cut, checkpoint=kept)
    assert differences(tmp_path / "whole", cut) == []


@pytest.mark.full(kind="slow")
@pytest.mark.parametrize("speed, mean", [("1 m/s", 0.015), ("1 mm/s", 0.025)])
def test_outputs_change_labels_of_implicit_runs_as_truncation_does(speed, mean):
    """Implicit steps end at outputs: 2.0 and 3.5 of 240 labels in the mean, 8 at worst."""

    def labels(seed, every):
        built = prepare(thirdbody.Scene.load(SHEARED).with_settings({
            "debris.0.count": 240, "debris.0.seed": seed, "contact.debris_contact": "none", "solver.integrator": "implicit",
            "plates.upper.motion.x.velocity": speed,
        }))  # fmt: skip
        for k in range(round(4e-6 / every) + 1):
            built.integrator.advance_to(**({"distance": k * every} if k else {"time": built.settle}))
            if k and k % round(1e-6 / every) == 0:
                yield built.integrator.label()[:, 0].copy()

    parts = []
    for seed in range(1, 6):
        coarse = list(labels(seed, 1e-6))
        parts += [np.mean([*labels(seed, every)] != np.array(coarse), axis=1) for every in (0.5e-6, 0.1e-6, 0.02e-6)]
    assert np.mean(parts) < mean and np.max(parts) < 0.06
