"""Which integrator a scene gets and why, what it refuses, and what a stopped run leaves."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from balls import BALLS, edited
import thirdbody
from thirdbody.assembly.simulation import build
from thirdbody.engine import meeting
from thirdbody.errors import GuardStop, InputError
from thirdbody.runner import outlook
from thirdbody.runner.simulate import execute, prepare

MEETS = ("[solver]", '[contact]\ndebris_contact = "auto"\n[solver]')
PAIR = edited(BALLS, ('title = "four balls"\n', ""), ("count = 4", "count = 2"), MEETS)
NONE = ('debris_contact = "auto"', 'debris_contact = "none"')
LOCAL = ("[solver]", "[effects.local_damping]\ncoefficient = 0.1\n[solver]")


def asks(kind, more=""):
    return ('settle = "1 us"', f'settle = "1 us"\nintegrator = "{kind}"\n{more}')


def text(*changes):
    return edited(PAIR, *changes)


def scene(*changes):
    return thirdbody.Scene.parse(text(*changes))


@pytest.fixture
def command(command, tmp_path):
    def call(changes, *arguments):
        (tmp_path / "scene.toml").write_text(text(*changes), encoding="utf-8")
        return command(arguments[0], "scene.toml", *arguments[1:])

    return call


SLOW, SLOWER, FAST, QUICK = (
    ('velocity = "0.5 m/s"', f'velocity = "{speed}"') for speed in ("1 mm/s", "1 um/s", "50 m/s", "5 m/s")
)  # explicit runs of the slow ones take a third of a second, and minutes; the inertial number of these balls is 5 at 50 m/s
ONE_PLATE = ("load_per_particle", "rigid")


def test_choice_and_reason():
    for name, (changes, kind, reason) in {
        "two that may meet": ((), "explicit", "expected to take about as long"),
        "two that meet slowly": ((SLOWER,), "implicit", "few bodies meet at a time"),
        "two that soon have slid": ((SLOW,), "explicit", "its steps are few: 2e+05"),
        "two that meet fast": ((FAST,), "explicit", "it resolves impacts"),
        "two that meet less fast": ((QUICK,), "explicit", "it resolves impacts"),
        "two under one plate": ((SLOWER, ONE_PLATE), "explicit", "carry one plate together"),
        "two whose steps have a tolerance": ((asks("auto", "tolerance = 1e-3"),), "implicit", "the scene gives solver.tolerance"),
        "two that meet, explicit by name": ((SLOWER, asks("explicit")), "explicit", "required by the scene"),
        "two that do not": ((NONE,), "implicit", "meet only the plates"),
        "a time step": ((NONE, ('settle = "1 us"', 'settle = "1 us"\ntime_step = "0.1 ns"')), "explicit", "time step"),
        "local damping": ((NONE, LOCAL), "explicit", "local_damping acts on unbalanced forces"),
        "implicit by name": ((asks("implicit"),), "implicit", "required by the scene"),
    }.items():
        simulation = build(scene(*changes))
        assert simulation.plan.kind == kind and reason in simulation.plan.reason, name
        assert type(simulation.integrator).__name__.lower().startswith(kind), name


@pytest.mark.parametrize("load", ["0.1 mN", "3 mN"])
def test_expected_explicit_steps_are_those_of_pressed_contacts(load):
    """They bound the step to 0.9 and 0.4 of what the Rayleigh time alone would allow; the estimate is right to 15 %."""
    simulation = build(scene(asks("explicit"), ('load = "0.1 mN"', f'load = "{load}"')))
    assert simulation.plan.steps.explicit / 2 == pytest.approx(simulation.planned_time / simulation.state.dt, rel=0.15)


UPPER = PAIR[PAIR.index("[plates.upper]") : PAIR.index("[contact]")]
NO_UPPER = ((UPPER, ""), ('distance = "0.1 um"', 'duration = "1 us"'), ('every = "0.05 um"', 'every = "1 us"'))


def test_what_cannot_work_is_one_clear_fault(command):
    for name, (changes, key, words) in {
        "local damping": ((asks("implicit"), LOCAL), "solver.integrator", ["local_damping", "unbalanced forces"]),
        "no upper plate": ((asks("implicit"), *NO_UPPER), "solver.integrator", ["no upper plate"]),
        "time step": ((asks("implicit", 'time_step = "1 ns"'),), "solver.time_step", ["other integrator", "implicit"]),
        "tolerance": ((asks("explicit", "tolerance = 1e-3"),), "solver.tolerance", ["other integrator", "explicit"]),
        "inertia": ((asks("explicit", "inertia = true"),), "solver.inertia", ["other integrator"]),
        "word of on_failure": ((asks("implicit", 'on_failure = "stopp"'),), "solver.on_failure", ["'stop'", "'continue'"]),
        "name": ((asks("implicitt"),), "solver.integrator", ["'implicit'", "'explicit'", "'auto'"]),
        "tolerance of zero": ((asks("implicit", "tolerance = 0"),), "solver.tolerance", ["0"]),
        "step of no length": ((asks("implicit", 'largest_step = "0 nm"'),), "solver.largest_step", ["greater than 0"]),
    }.items():
        with pytest.raises(InputError) as caught:
            build(scene(*changes))
        assert caught.value.exit_code == 3 and [fault.key for fault in caught.value.faults] == [key], name
        assert caught.value.faults[0].line is not None and all(word in caught.value.faults[0].message for word in words), name
    code, _, err = command((asks("implicit"), LOCAL), "run", "-o", "out", "-q")
    assert code == 3 and "solver.integrator" in err and "local_damping" in err and "Traceback" not in err


def test_keys_reach_the_integrator_and_friction_without_bound_is_bounded():
    for word in ("stop", "continue"):
        simulation = build(scene(NONE, asks("implicit", f'on_failure = "{word}"')))
        assert simulation.integrator.accuracy.skip_unsolved is (word == "continue")
    simulation = build(scene(NONE, asks("auto", 'tolerance = 0.002\nlargest_step = "3 nm"')))
    assert (simulation.integrator.accuracy.tolerance, simulation.integrator.accuracy.largest_step) == (0.002, 3e-9)
    # above 1e6 the friction limit of a spot that lifts off is lost in the error of its load: 1e9 counts as 1e4
    mild, wild = (build(scene(NONE, ("friction = 0.30", f"friction = {mu}"))) for mu in ("1e4", "1e9"))
    assert np.array_equal(mild.state.physics.pairs, wild.state.physics.pairs)
    assert any("count as 10000" in warning for warning in wild.warnings)
    assert not any("count as" in warning for warning in mild.warnings)


def test_check_and_run_report_integrator_reason_islands_and_the_times_of_both(command):
    code, out, _ = command((NONE,), "check", "--json")
    report = json.loads(out)
    assert code == 0 and report["integrator"] == "implicit" and "meet only the plates" in report["integrator_reason"]
    assert "time_step" not in report and report["accuracy"]["tolerance"] == 5e-4
    assert not report["common_steps"] and not report["bodies_meet"]
    code, out, _ = command((NONE,), "check")
    assert code == 0 and "integrator implicit: bodies meet only the plates" in out
    code, out, _ = command((NONE, ONE_PLATE), "check")
    assert code == 0 and "all bodies by common steps, since they carry one plate together" in " ".join(out.split())
    code, out, _ = command((), "check", "--json")
    report = json.loads(out)
    assert code == 0 and report["integrator"] == "explicit" and "expected to take" in report["integrator_reason"]
    assert report["time_step"]["step"] > 0.0
    assert report["expected_times"]["explicit"] == pytest.approx(report["estimated_step_time"])
    assert report["islands"]["largest"] == 1 and report["islands"]["fraction_of_bodies"] == 0.0
    code, out, _ = command((SLOWER,), "check")
    assert code == 0 and "integrator implicit: few bodies meet at a time" in out
    assert "bodies cover 0.03 of the area, 0 % of them could meet another within 1.25 um of sliding" in out
    assert re.search(r"steps, on one core: implicit about .*, explicit about ", out)
    code, _, err = command((SLOWER,), "run", "-o", "out")
    assert code == 0 and re.search(r"^integrator implicit: few .* times as fast as the explicit one$", err, re.MULTILINE)


@pytest.mark.parametrize("settled, tried", [(0.1, 2e-6), (100.0, 2e-6 / 32.0)])
def test_the_trial_measures_the_drag_however_long_bodies_settle(settled, tried, monkeypatch):
    """The clock moves on by 1e5 s per metre of drag: the trial ends early where it would take long, but never unmeasured."""
    path, clock = [0.0], [settled]

    def trial(_bodies, until):
        clock[0] += 1e5 * (until - path[0])
        path[0] = until

    monkeypatch.setattr(outlook.time, "perf_counter", lambda: clock[0])
    built = SimpleNamespace(planned_distance=1e-3, schedule=SimpleNamespace(time_of=lambda distance, _start: distance))
    seconds = outlook._with_drag(built, SimpleNamespace(trial=trial), 1, 0.0)
    assert path[0] == tried and seconds == pytest.approx(settled + 1e5 * 1e-3, rel=1e-9)  # rounding


def test_a_resumed_run_keeps_its_integrator(tmp_path, monkeypatch):
    monkeypatch.setattr("thirdbody.assembly.integrator.FEW", 0.0)
    short = scene(SLOW, ('distance = "0.1 um"', 'distance = "0.05 um"'))
    assert build(short).plan.kind == "implicit"
    built = prepare(short, before="explicit")
    assert built.plan.kind == "explicit"
    execute(built, tmp_path / "run", threads=1)
    with thirdbody.resume(tmp_path / "run", progress=False, settings={"solver.distance": "0.07 um"}) as run:
        assert run.summary()["integrator"] == "explicit" and run.summary()["distance"] == pytest.approx(0.07e-6, rel=1e-2)


NEAR = (
    asks("implicit"), ('distance = "0.1 um"', 'distance = "4 um"'), ('every = "0.05 um"', 'every = "0.5 um"'),
    ("count = 2\nseed = 1", 'positions = [["20 um", "30 um", "5 um"], ["31 um", "30 um", "5 um"]]'),
)  # fmt: skip

# A ball rolls at half the speed of the upper plate into a flake, whose weight keeps it on the lower one.
SPHERES = ", ".join(f'{{center = ["{x} um", "{y} um", "0 um"], radius = "4 um"}}' for x, y in ((0, -7), (0, 0), (0, 7), (6, 0)))
FLAKE = f"""[[debris]]
material = "steel"
kind = "spheres"
shape = [{SPHERES}]
positions = [["34 um", "30 um", "5 um"]]
[effects]
gravity = ["0 m/s2", "0 m/s2", "-1e5 m/s2"]
[domain]"""
MEETING = (
    asks("implicit"),
    ("count = 2\nseed = 1", 'positions = [["20 um", "30 um", "5 um"]]'),
    ("[domain]", FLAKE), ('distance = "0.1 um"', 'distance = "16 um"'), ('every = "0.05 um"', 'every = "0.5 um"'),
    ('velocity = "0.5 m/s"', 'velocity = "0.01 m/s"'),
)  # fmt: skip


def test_two_balls_that_keep_their_distance_may_run_and_strangers_pass_through_each_other(tmp_path):
    """Both roll alike: the watch on their distance lets them go."""
    with thirdbody.run(scene(*NEAR), out=tmp_path / "run", progress=False) as run:
        assert run.summary()["finished"]
        x = run.bodies(-1)["position"][:, 0]
    with thirdbody.run(scene(NONE, *MEETING), out=tmp_path / "strangers", progress=False) as run:
        report = run.summary()  # bodies told not to see each other pass through each other
    assert report["finished"] and report["integrator"] == "implicit"
    assert report["unsolved"] == {} and report["steps"] >= 2.0 * report["frames"]
    assert x[1] - x[0] == pytest.approx(11e-6, rel=1e-6)
    assert x[0] - 20e-6 == pytest.approx(2e-6, rel=0.01)


@pytest.mark.parametrize(("plate", "advice"), [((), 'on_failure = "continue"'), ((ONE_PLATE,), "solver.inertial_number")])
def test_an_island_that_does_not_pay_stops_the_run_and_frames_are_kept(tmp_path, monkeypatch, plate, advice):
    """One of two bodies, so that the run stops where they come near; or goes on, if the scene says so."""
    monkeypatch.setattr(meeting, "LARGEST", 1)
    with pytest.raises(GuardStop, match="2 bodies could meet .* more than 1 do not pay") as caught:
        thirdbody.run(scene(*MEETING, *plate), out=tmp_path / "run", progress=False)
    assert caught.value.exit_code == 4
    assert 'integrator = "explicit"' in str(caught.value) and advice in str(caught.value)
    with thirdbody.open(tmp_path / "run") as run:
        assert run.frames >= 2 and np.all(np.isfinite(run.bodies(-1)["position"]))
        report = run.summary()
    assert not report["finished"] and "could meet" in report["stopped"]
    if plate:
        return
    going = scene(*MEETING).with_settings({"solver.on_failure": "continue"})
    with thirdbody.run(going, out=tmp_path / "going", progress=False) as run:
        assert run.summary()["finished"] and run.summary()["islands"]["largest"] == 2


def test_only_the_explicit_integrator_needs_years():
    # a day of fretting, a millimetre at 10 nm/s, under one plate
    slow = (('velocity = "0.5 m/s"', 'velocity = "10 nm/s"'), ('distance = "0.1 um"', 'distance = "1 mm"'))
    with pytest.raises(InputError, match="of explicit integration.*explicit, because"):
        prepare(scene(ONE_PLATE, *slow))
    assert prepare(scene(NONE, *slow)).plan.kind == "implicit"
