"""The friction coefficient of a run: one number, its error and verdict wherever it is shown; strokes by cycle."""

import csv
import itertools
import json
import math
import tomllib
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from each import each
from layer import write_layer
from slow import slow
from steel import SCENES
import thirdbody
from thirdbody.engine.upper_plate import Schedule, Segment
from thirdbody.export.tables import export_csv
from thirdbody.kernels import schedule
from thirdbody.plot.summary_page import page
from thirdbody.render.notebook import run_html
from thirdbody.render.picture_data import read_picture_data
from thirdbody.report.tables import run_report
from thirdbody.runner.verdicts import ending_warnings, step_words
from thirdbody.trajectory.drag import Drag
from thirdbody.trajectory.friction import _verdict, change_and_error, friction_of
from thirdbody.trajectory.summary import energy_verdict, run_summary
from .test_plot import LOAD, stroke, write

FRAMES = 41


@pytest.fixture
def drifting(tmp_path) -> Path:
    """A finished run whose coefficient rises from .2 to .4, evenly: .3 to .4 over the second half."""
    path = write_layer(tmp_path / "run.vtkhdf", 3, FRAMES)
    with h5py.File(path, "r+") as file:
        file["series/friction_coefficient"][...] = np.linspace(0.2, 0.4, FRAMES)
        summary = {"finished": True, "wall_time": 1.0, "steps": 10, "sphere_steps_per_second": 1.0, "energy_residual": 1e-6}
        file["scene"].create_dataset("summary", data=np.bytes_(json.dumps(summary))).attrs["json"] = np.uint8(1)
    return path


def friction(u: np.ndarray, mu: np.ndarray, direct: float = 0.0):
    distance = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(u)))))
    force = np.column_stack((-LOAD * np.nan_to_num(mu), 0.0 * u, LOAD + 0.0 * u))
    series = {"distance": distance, "displacement": u, "friction_coefficient": mu, "upper_force": force}
    series["direct_force"] = np.outer(np.full(len(u), direct), [0.0, 0.0, 1.0])
    return friction_of(Drag(SimpleNamespace(frames=len(u), series=series, header={}, times=1e-6 * np.arange(len(u)))))


def test_every_output_reports_the_same_number(drifting, capsys):
    mean = np.linspace(0.2, 0.4, FRAMES)[FRAMES // 2 + 1 :].mean()
    with thirdbody.open(drifting) as run:
        assert run.friction.value == pytest.approx(mean, rel=1e-14) == run.summary()["friction_coefficient"]
        assert run.summary()["friction_verdict"] == run.friction.verdict
        seen = [text.replace("\N{NO-BREAK SPACE}", " ") for text in (
            read_picture_data(run, 0, "state").facts, read_picture_data(run, -1, "state").facts,
            " ".join(text.get_text() for text in page(run).texts), page(run).axes[0].get_title(loc="left"), run_html(run),
        )]  # fmt: skip
    run_report(drifting.parent, json=True)
    assert json.loads(capsys.readouterr().out)["friction_coefficient"] == pytest.approx(mean, rel=1e-14)
    run_report(drifting.parent, json=False)
    seen.append(capsys.readouterr().out)
    assert [text for text in seen if f"{mean:.3f}" not in text] == []


def test_a_drift_is_reported_but_neither_noise_nor_few_frames_or_cycles():
    noise = np.random.default_rng(4).normal(size=400)
    for k in range(1, 400):  # AR(1): correlated over some ten intervals
        noise[k] += 0.8 * noise[k - 1]
    u = 1e-7 * np.arange(400)
    cases = {
        "steady": (0.3 + 0.0005 * noise, True, "stationary"),  # its trend by chance is .2 % of the mean, told as none below 1 %
        "rising": (0.3 + 0.005 * noise + np.linspace(0.0, 0.1, 400), False, "still rising by"),
        "falling": (0.3 + 0.2 * np.exp(-np.arange(400) / 150.0), False, "still falling by"),
        "wild": (0.3 + 0.3 * noise, None, "stationary or not: its scatter hides"),
        "nothing": (1e-5 * noise, True, "stationary: changes by less than 0.001 over"),
        "constant": (np.full(400, 0.3), True, "stationary: changes by less than 0.1 % over"),
    }
    for name, (mu, stationary, verdict) in cases.items():
        found = friction(u, mu)
        assert (found.stationary, found.verdict[: len(verdict)]) == (stationary, verdict), name
        assert stationary is not True or found.error > 0.0 or name == "constant", name
    # by hand: a straight line of .1 over 400 intervals rises by .05 over their second half, 13 % of its mean there, .375
    line = friction(u, np.linspace(0.3, 0.4, 400))
    assert (line.verdict, line.high) == ("still rising by 13 % over the second half", 0.4) and 0.35 < line.low < 0.351
    # without scatter: a rise by 0.95 and by 1.05 % of the mean over the second half
    assert [friction(u, np.linspace(0.3, 0.3 + 2.0 * d, 400)).stationary for d in (0.0029, 0.0032)] == [True, False]
    assert [_verdict(0.3, 0.0, margin, "")[0] for margin in (0.029, 0.031)] == [True, None]  # scatter of a tenth
    assert _verdict(0.4, 0.0068, 0.025, "now") == (True, "stationary within its scatter: changes by 2 % now")
    u = 1e-7 * np.arange(5)
    few = friction(u, np.full(5, 0.3))
    assert few.value == pytest.approx(0.3) and few.stationary is None
    assert few.verdict.startswith("too few") and math.isnan(few.error)
    assert str(friction(0.0 * u, np.full(5, np.nan))) == "no sliding"
    assert str(friction(u, np.full(5, np.nan))) == "unloaded"
    two, one, none = (friction(*square_loop(cycles)) for cycles in (2.0, 1.0, 0.75))
    assert two.value == pytest.approx(0.2)  # the last cycle's, not the mean of both
    assert two.stationary is False and two.verdict == "still rising by 67 % over the last 2 cycles"
    assert one.value == pytest.approx(0.1) and one.stationary is None
    assert math.isnan(none.value) and none.verdict == "no whole cycle yet"
    # a return by 5 % is a stroke; an end within a thousandth of the last turn closes a cycle
    for x in (0.96, 0.94):
        assert (friction(np.array([0.0, 1.0, x]), np.full(3, 0.3)).verdict == none.verdict) == (x < 0.95)
    assert [friction(np.array([0.0, 1.0, 0.0, 1.0, x]), np.full(5, 0.3)).cycles for x in (9e-4, 11e-4)] == [2, 1]


def test_a_creep_of_five_cycles_is_seen_and_the_error_of_a_change_covers_noise():
    """Autocorrelation cannot be estimated from five values: they count as independent, with Student's t of three."""
    creep = np.array([0.31, 0.323, 0.331, 0.342, 0.35])
    change, margin = change_and_error(creep)
    assert change == pytest.approx(4 * 0.0099, rel=1e-12)  # slope by hand: (2 (.35 - .31) + .342 - .323)/10 a cycle
    deviations = creep - creep.mean() - 0.0099 * np.arange(-2, 3)
    error = 4 * np.sqrt(deviations @ deviations / 3 / 10)
    assert margin == pytest.approx(5.8409 * error, rel=1e-4)  # t of three degrees at 99 %, from tables
    assert change > margin
    # the half width at 99 % contains the true change, zero, in about that share of 400 series of noise
    rng = np.random.default_rng(8)
    for correlation, least in ((0.0, 0.97), (0.8, 0.9)):  # an estimated correlation time is short of the true one in short series
        inside = 0
        for _ in range(400):
            noise = rng.normal(size=100)
            for k in range(1, 100):
                noise[k] += correlation * noise[k - 1]
            change, margin = change_and_error(noise)
            inside += abs(change) <= margin
        assert least <= inside / 400


def square_loop(cycles: float) -> tuple[np.ndarray, np.ndarray]:
    """A stroke of 80 nm that grows: friction .1 in the first cycle, .2 in all later ones, against the motion."""
    u = stroke(cycles, per_cycle=20)
    size = np.where(np.arange(len(u)) <= 20, 0.1, 0.2)
    mu = size * np.sign(np.diff(u, prepend=-u[1]))
    mu[0] = np.nan
    return u, mu


def test_strokes_have_a_mean_size_and_an_energy_per_cycle(tmp_path):
    assert friction(*square_loop(3.0)).energy_per_cycle == pytest.approx(0.2 * LOAD * 160e-9, rel=1e-9)
    # what the plates carry on each other rubs as well
    assert friction(*square_loop(3.0), LOAD).energy_per_cycle == pytest.approx(0.4 * LOAD * 160e-9, rel=1e-9)
    u, mu = square_loop(16.0)
    ramp = friction(u, np.sign(mu) * (0.1 + 0.01 * ((np.arange(len(u)) - 1) // 20)))
    assert (ramp.low, ramp.high, ramp.error, ramp.change) == pytest.approx((0.18, 0.25, 0.01 * 6**0.5, 0.07))  # of eight cycles
    u, mu = square_loop(3.25)
    with thirdbody.open(write(tmp_path / "run", u=u, mu=mu)) as run:
        assert run.friction.value == pytest.approx(0.2, rel=1e-12)  # a mean of the signed loop is zero
        work = 0.2 * LOAD * 160e-9  # back and forth over 80 nm
        assert run.summary()["energy_per_cycle"] == pytest.approx(work, rel=1e-9) and run.summary()["cycles"] == 3
        assert run.friction.stationary and "over the last 2 cycles" in run.friction.verdict
        assert run.cycles["cycle"].tolist() == [1, 2, 3]
        assert run.cycles["energy"] == pytest.approx([0.5 * work, work, work], rel=1e-9)
        assert run.cycles["friction_coefficient_max"] == pytest.approx([0.1, 0.2, 0.2])
        assert run.cycles["tangential_force_min"] == pytest.approx(-LOAD * run.cycles["friction_coefficient_max"])
        assert run.cycles["displacement_max"] == pytest.approx(80e-9) and run.cycles["end_time"][0] == pytest.approx(20e-6)
        assert run.cycles["start_time"] == pytest.approx([0.0, 20e-6, 40e-6])
        assert "32 pJ per cycle" not in str(run.friction) and "6.4 pJ per cycle" in str(run.friction)
        export_csv(run, tmp_path / "csv")
        rows = list(csv.DictReader((tmp_path / "csv" / "cycles.csv").open()))
        assert [float(row["energy [J]"]) for row in rows] == run.cycles["energy"].tolist()
        pytest.importorskip("pandas")
        assert run.to_pandas("cycles").attrs["units"]["displacement_min"] == "m"


SINE = {"stroke": "80 nm", "frequency": "1 MHz"}
MOTIONS = {  # motion; duration; ends of the last cycle, us
    "x alone": ({"x": SINE}, "1.25 us", (1.0, 2.0)),
    "one line": ({"x": SINE, "y": SINE}, "2 us", (2.0, 3.0)),
    "a circle": ({"x": SINE, "y": [{"pause": "0.25 us"}, SINE]}, "2.25 us", (2.25, 3.25)),
    "2 to 3": ({"x": SINE | {"shape": "triangle"}, "y": {"stroke": "50 nm", "frequency": "1.5 MHz"}}, "4 us", (3.0, 5.0)),
    "drift": ({"x": SINE, "y": {"velocity": "0.5 m/s"}}, "2 us", None),
}


QUICK = [("explicit", "2 to 3"), ("implicit", "a circle"), ("explicit", "x alone"), ("implicit", "x alone")]
REST = [slow(*row) for row in itertools.product(("explicit", "implicit"), MOTIONS) if row not in QUICK]


@pytest.mark.parametrize(("integrator", "name"), QUICK + REST)
def test_the_work_of_strokes_is_what_is_lost(tmp_path, integrator, name):
    motion, duration, ends = MOTIONS[name]
    scene = thirdbody.Scene.load(SCENES / "fretting.toml").with_settings({
        "debris.0.count": "1", "contact.debris_contact": "none", "solver.integrator": integrator, "plates.upper.motion": motion,
        "solver.duration": duration, "solver.settle": "1 us", "output.every": "0.05 us", "output.profiles": 1,
    })  # fmt: skip
    with thirdbody.run(scene, tmp_path / "run", threads=1, progress=False) as run:
        parts = ("friction", "damping", "numerical", "kinetic", "elastic_normal", "elastic_tangential")
        lost = sum(run.series[f"energy_{part}"] for part in parts)
        cycles, mu = run.cycles, run.series["friction_coefficient"]
        assert sum(run.summary()["accommodation"].values()) == pytest.approx(1.0)
        if name == "x alone":  # to rounding of the corners' places, up to 60 um
            corners = np.array([run.plates(k)["position"] for k in range(run.frames)])
            u = run.series["displacement"]
            assert u == pytest.approx(corners[:, 4, 0] - corners[:, 0, 0], abs=1e-19)
            assert u.max() == pytest.approx(80e-9, rel=1e-3) and len(cycles["cycle"]) == 1
            assert np.abs(np.diff(u)).sum() == pytest.approx(run.series["distance"][-1], rel=0.02)  # turns
        if ends is None:  # a path that does not close is slid one way, at each moment against its velocity
            assert run.friction.cycles == 0 and 0.19 < run.friction.low < run.friction.high < 0.201
            return
        first, last = (int(np.argmin(np.abs(run.times - 1e-6 * end))) for end in ends)
        assert [cycles["start_time"][-1], cycles["end_time"][-1]] == [run.times[first], run.times[last]]
        # the plate does not rise over a cycle; twenty means a cycle, along the first axis, missed 1 to 60 %
        assert run.friction.energy_per_cycle == pytest.approx(lost[last] - lost[first], rel=1e-3)
        work = (np.abs(run.series["upper_force"][:, 2]) * mu * run.drag.steps)[first + 1 : last + 1].sum()
        # along the velocity of a curved path; of a line the sum of mean force times displacement, with few means
        assert run.friction.energy_per_cycle == pytest.approx(work, rel=0.02 if run.drag.straight else 1e-9)
        if name == "a circle" and integrator == "explicit":  # implicit steps are chords of it: 0.8 % less
            assert run.friction.energy_per_cycle == pytest.approx(0.2 * 0.2e-3 * math.pi * 80e-9, rel=2e-3)
        if name == "2 to 3" and integrator == "explicit":
            assert [axes.get_title(loc="left")[:14] for axes in run.plot(panels=["loop"]).axes] == ["Friction loop:"]


def test_paths_that_close_and_lines():
    def axis(start, b, c, kind=schedule.SINE):
        return (Segment(start, kind, 0.0, b, 2.0 * math.pi * c if kind == schedule.SINE else c),)

    one, other = axis(1.0, 2.0, 3.0), axis(1.0, -1.0, 3.0)
    assert Schedule(one, other).straight and Schedule(one).straight and Schedule((), one).heading_at(1.1) == (0.0, 1.0)
    assert not any(Schedule(one, axis(*row)).straight for row in ((1.5, 2.0, 3.0), (1.0, 2.0, 2.0)))
    assert Schedule(one, axis(1.0, 1.0, 2.0)).closed_paths(0.5) == [(0.5, math.inf, pytest.approx(1.0))]  # 3, 2 cycles a second
    assert not Schedule(one, axis(1.0, 1.0, 3.0 * 2**0.5)).closed_paths()
    drift = Schedule(one, axis(0.0, 5.0, 0.0, schedule.POLYNOMIAL))
    assert not drift.straight and not drift.closed_paths() and drift.heading_at(0.5) == (0.0, 1.0)


SOUND = {
    "integrator": "explicit", "time_step": 2e-9, "time_step_limit": {"smallest": 1e-9}, "energy_residual": 4e-3,
    "energy": {"damping": 0.0, "friction": 1.0},
}  # fmt: skip
ALONE = {"integrator": "implicit", "energy_residual": 1e-9, "energy_numerical_share": None}
BALANCES = [
    *[(SOUND | {"energy_residual": residual}, "", ()) for residual in (None, 0.0, 9.9e-4)],
    (SOUND, '[solver]\ntime_step = "2 ns"\n', ("the time step is 2 times the automatic one", 'solver.time_step = "5e-10 s"')),
    (SOUND, "", ("4.0e-03 of the largest energy", "too long for some impact or contact", 'solver.time_step = "5e-10 s"')),
    (SOUND | {"energy": {"damping": 0.06, "friction": 0.94}}, "", ("dashpots take 6 % of what is lost", "5e-10 s")),
    (SOUND | {"energy": {"damping": 0.04, "friction": 0.96}, "energy_residual": 1.1e-3}, "", ("1.1e-03", "some impact")),
    (SOUND | {"integrator": "implicit"}, "", ("solver.tolerance",)),
    (SOUND | {"time_step": None, "time_step_limit": None, "energy": None}, "", ("smaller solver.time_step",)),
    # what the integrator itself loses or makes
    (ALONE | {"energy_numerical_share": 0.011}, "", ("itself lost 1.1 %", "solver.tolerance", "explicit")),
    (ALONE | {"energy_numerical_share": 0.068}, "[solver]\ninertia = false\n", ("lost 6.8 %", "tips", "solver.inertia = true")),
    (ALONE | {"energy_numerical_share": -0.26}, "", ("itself made 26.0 %", "solver.tolerance")),
    *[(ALONE | {"energy_numerical_share": share}, "", ()) for share in (0.009, -0.009, None)],
]


@each(BALANCES)
def test_the_reason_of_a_balance_that_does_not_close_follows_from_the_facts(row):
    facts, scene, words = row
    report = energy_verdict(facts, tomllib.loads(scene).get("solver", {}))
    assert bool(report) == bool(words) and all(word in (report or "") for word in words), report


ENDINGS = [
    ({"load_ratio": 2.61, "finished": True}, ["2.61 times the load", "bounces"]), ({"load_ratio": 1.02, "finished": True}, []),
    ({"load_ratio": 0.2, "finished": True}, ["0.20 times the load"]),
    ({"load_ratio": None, "patches_not_carried": None, "damping_share": None}, []),
    ({"load_ratio": 1.0, "patches_not_carried": 0, "bodies": 40}, []),
    ({"load_ratio": 1.0, "patches_not_carried": 1, "bodies": 40}, ["1 of 40 patches", "solver.inertia"]),
    ({"patches_not_carried": None, "histories_shortened": 3}, ["3 contacts", "contact.nodes"]),
    ({"patches_not_carried": None, "histories_shortened": 0}, []),
    ({"damping_share": 0.41, "energy": {"friction": 5.1, "plate_work": 10.0}}, ["took 41 %", "friction 51 %"]),
    ({"damping_share": 0.08, "energy": {"friction": 9.1, "plate_work": 10.0}}, []),
]  # fmt: skip


@each(ENDINGS)
def test_what_a_run_says_at_its_end_about_its_accuracy(row):
    message, words = row
    said = " ".join(ending_warnings(message))
    assert all(word in said for word in words) and bool(said) == bool(words), said


def test_words_for_what_limited_the_steps():
    steps = {"output": 60, "largest_step": 30, "error": 10}
    assert step_words({"steps_limited_by": steps}) == "output 60 %, largest step 30 %, error 10 %"
    assert step_words({"time_step": 1e-9}) == ""
    run = SimpleNamespace(
        frames=0, header={"warnings": ["before"]}, series={"fraction_rolling": [0.1, 0.5, 0.2]}, scene_tables={}
    )
    summary = run_summary(Drag(run), friction_of(Drag(run)), None, {"patches_not_carried": 0, "warnings": ["at the end"]})
    assert summary["largest_fraction_rolling"] == 0.5  # over all frames
    before, at_end, rolled = summary["warnings"]
    assert (before, at_end) == ("before", "at the end") and "50 % of the bodies rolled" in rolled and "momentum" in rolled
    summary = run_summary(Drag(run), friction_of(Drag(run)), None, {"patches_not_carried": None})
    assert summary["warnings"] == ["before"]  # with inertia
