"""Studies of cost as they run: budgets of time, copies of few bodies, workers, seconds and their spread, JSON, the picture."""

import json
import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from portable import drawn

from thirdbody.engine.state import orientations
from thirdbody.errors import OutputError, UsageError
from thirdbody.kernels.tables import body
from thirdbody.runner.simulate import prepare
from thirdbody.scene.model import Scene
from thirdbody.studies import cost, cost_plot, worker
from thirdbody.studies.compare import read_outcome
from thirdbody.studies.convergence import convergence, falling
from thirdbody.studies.cost_command import StudyOptions, cost_command
from thirdbody.studies.nudge import NUDGE, nudge
from thirdbody.studies.reduced_scene import FEWEST, FEWEST_THAT_MEET, reduce_scene, thin
from thirdbody.studies.stopwatch import Late, bare
from thirdbody.studies.study_setup import StudySource
from thirdbody.studies.time_budget import Budget, Costs, Overheads, fitting, repeats_of, whole
from thirdbody.studies.timing_statistics import slower, timing
from thirdbody.studies.variant_runs import LEFT_OUT, VariantRuns
from thirdbody.studies.worker_process import Overdue, Worker, request

from .test_cost import EXPLICIT, IMPLICIT, SCENE, TWO, ladder, made, outcome  # noqa: F401


@pytest.fixture
def file(tmp_path) -> Path:
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def test_cheap_variants_are_repeated_more_often_and_a_copy_is_as_large_as_the_budget_allows():
    assert [repeats_of(seconds, 3) for seconds in (0.01, 1.0, 60.0)] == [7, 3, 2]
    assert (repeats_of(1.0, 1), repeats_of(1.0, 0), repeats_of(0.01, 12)) == (1, 0, 12)
    variants, costs = ladder(), Costs(1.0, 128, 17.0, ("exact", None), 15.0, 0.1)
    report = {variant.name: costs.of(variant, EXPLICIT) for variant in variants}
    assert report["mdr 64"] == pytest.approx(9.0) and report["mindlin"] == 1.0  # linear in the springs
    assert report["mindlin, step x4"] == 0.25 and report["exact, step /4"] == 60.0 and report["mindlin, implicit"] == 0.1
    share = fitting(variants, EXPLICIT, costs, 3, 300.0)
    assert share < 1.0 and whole(variants, EXPLICIT, costs, 3, share) < 300.0
    assert fitting(variants, EXPLICIT, costs, 3, 600.0) > 1.5 * share
    assert fitting(variants, EXPLICIT, costs, 3, 0.0) == pytest.approx(0.01, rel=0.03)  # and not for ever


def test_a_thinned_copy_has_its_bodies_as_close_as_they_were_and_as_many_meet():
    """So what contact between bodies costs and changes is measured: by variants from displaced starts, and without it."""
    text = SCENE.replace("count = 2", "count = 200").replace('radius = "5 um"', 'radius = "5 um"\nplacement = "layer"')
    scene = Scene.parse(text.replace('"100 um", "100 um"', '"300 um", "200 um"').replace('debris_contact = "none"', ""))
    near, words = thin(scene, 200, 0.25)
    copy = scene.with_settings(near)
    assert copy.debris[0].count == 50 and words == ["50 of 200 bodies, as close as they were"]
    assert copy.domain.size == pytest.approx((150e-6, 100e-6), rel=1e-12)  # a quarter of the area
    assert thin(scene, 200, 1.5) == ({}, []) and thin(scene, FEWEST, 0.1) == ({}, [])
    copy, built, words = reduce_scene(scene, [], 1e-9)
    assert copy.debris[0].count == FEWEST_THAT_MEET and built.state.world.debris_meets and "as close" in words[0]
    assert np.prod(copy.domain.size) / FEWEST_THAT_MEET == pytest.approx(np.prod(scene.domain.size) / 200, rel=1e-12)
    more = [variant for variant in ladder(replace(EXPLICIT, meets=True), scene) if variant.axis in ("nudged", "meeting")]
    assert [(variant.axis, variant.nudge) for variant in more] == [("nudged", 1), ("nudged", 2), ("meeting", 0)]
    assert more[2].changes == more[0].changes | {"contact.debris_contact": "none"}


def test_displaced_starts_differ_by_a_billionth_and_can_be_repeated():
    first, again, other = (prepare(TWO).state for _ in range(3))
    start = first.B.copy()
    for state, number in ((first, 1), (again, 1), (other, 2)):
        nudge(state, number)
    assert np.array_equal(first.B, again.B) and not np.array_equal(first.B, other.B)
    moved = np.linalg.norm((first.B - start)[:, body.POSITION : body.POSITION + 3], axis=1)
    # a normal deviate of two components is above 1e-3 and below 6 but for one in a million
    assert np.all((moved > 1e-3 * NUDGE * 5e-6) & (moved < 6.0 * NUDGE * 5e-6))
    assert np.array_equal(first.S[:, :3], first.B[first.body, body.POSITION : body.POSITION + 3])  # balls: centred


def test_the_json_and_the_picture_have_every_variant(made, tmp_path):  # noqa: F811
    report = json.loads(json.dumps(cost.as_json(made)))
    assert {"scene", "machine", "reduction", "reference", "recommended", "variants"} <= set(report)
    names = {"level", "springs", "integrator", "step", "wall_s", "time_ratio", "friction_error", "load_error", "position_error",
             "label_difference", "energy_residual", "stable"}  # fmt: skip
    assert all(names <= set(variant) for variant in report["variants"]) and report["reference"] == "exact, step /4"
    assert report["variants"][3]["time_ratio"] == 2.0 and report["variants"][3]["springs"] == 16
    assert report["variants"][-2]["stable"] is False
    figure = cost_plot.picture(made)
    axes, legend = figure.axes[0], {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"coulomb", "mindlin", "mdr 8", "mdr 16", "exact", "step x4"} <= {text.get_text() for text in axes.texts}
    assert {"efficient front, to the reference", "as in the scene", "recommended"} <= legend
    line = next(line for line in axes.lines if line.get_label() == "efficient front, to the reference")
    assert list(line.get_xdata()) == [0.5, 1.0, 2.0, 4.0, 9.0, 30.0]
    cost_plot.draw_study(made, tmp_path / "cost.png")
    assert drawn(tmp_path / "cost.png") > 0.02


def test_convergence_and_the_next_reference(made):  # noqa: F811
    series = next(entry for entry in convergence(made) if entry["what"] == "springs")
    assert series["sizes"] == ["8", "16"] and series["against"] == "exact"
    # friction of the made-up runs: .3 (1 + error)
    assert series["errors"] == pytest.approx([(1.06 - 1.001) / 1.001, (1.008 - 1.001) / 1.001], rel=1e-9)
    assert falling([8.0, 4.0, 2.0, 1.9, 1.8]) == 3 and falling([4.0, 1.0, math.nan, 0.1]) == 2  # then something else takes over
    made.rows[-1].stable = False
    cost.compute_errors(made)
    assert made.reference.variant.name == "exact" and made.reference.errors["friction_error"] == 0.0


def test_the_worker_reports_what_failed_and_times_the_rest(file, tmp_path):
    good = request(file, tmp_path / "runs" / "0", {}, [], 30.0)
    ran, timed = worker.answer({"do": "run", **good}), worker.answer({"do": "time", **good})
    assert ran["stable"] and timed["stable"] and ran["cpu_s"] > 0.0 and timed["cpu_s"] > 0.0
    assert ran["integrator"] == "implicit" and ran["step_kind"] == "tolerance" and ran["used_cpu"] > ran["cpu_s"]
    changes = {"solver.time_step": "1 s", "solver.integrator": "explicit"}
    bad = worker.answer({"do": "run", **request(file, tmp_path / "runs" / "1", changes, [], 30.0)})
    assert not bad["stable"] and "above the bound" in bad["message"] and "cpu_s" not in bad
    late = worker.answer({"do": "time", **request(file, tmp_path / "runs" / "0", {}, [], -1.0)})
    assert not late["stable"] and "given up" in late["message"]
    stopped = worker.timed_run(TWO, tmp_path / "run", [], 0.0)
    assert not stopped["stable"] and "given up after 0 s of one core" in stopped["message"]


@pytest.mark.full(kind="slow")  # starts other processes
def test_a_worker_that_dies_is_reported_and_one_that_is_late_is_ended():
    with Worker() as process:
        report = process.request({"do": "nothing that it knows"})
        assert not report["stable"] and "the process ended with code 1: KeyError" in report["message"]
        with pytest.raises(Overdue):
            process.request({"do": "nothing"}, until=0.0)


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_what_is_timed_is_the_run(integrator, tmp_path):
    """The same steps to the last bit, without what is done at the stops."""
    scene = TWO.with_settings({"solver.integrator": integrator})
    worker.timed_run(scene, tmp_path / "run", [], 30.0)
    built = prepare(scene)
    wall, cpu = bare(built, 30.0)
    ran = read_outcome(tmp_path / "run")
    assert np.array_equal(built.state.bodies.position, ran.position)
    assert np.array_equal(orientations(built.state), ran.quaternion) and 0.0 < wall and 0.0 < cpu
    with pytest.raises(Late):
        bare(prepare(scene), -1.0)


class MadeUpWorker:
    started = 1.0

    def __init__(self, monkeypatch, seconds, pace=1.0):
        self.now, self.requests, self.seconds, self.pace, self.later = 0.0, 0, seconds, 1.0, pace
        monkeypatch.setattr(time, "perf_counter", lambda: self.now)
        monkeypatch.setattr("thirdbody.studies.variant_runs.read_outcome", lambda folder: outcome())

    def request(self, request, until=math.inf):
        self.requests += 1
        self.pace = self.later if self.requests > 2 else 1.0
        used = self.seconds + (1.0 if request["do"] == "run" else 0.05)
        late = self.now + used * self.pace > until
        self.now = min(self.now + used * self.pace, until)
        if late:
            raise Overdue
        return {"stable": True, "message": "", "cpu_s": self.seconds, "wall_s": self.seconds * self.pace, "used_cpu": used}


def climbed(worker, seconds):
    costs = Costs(worker.seconds, 128, worker.seconds, ("exact", None), worker.seconds, worker.seconds)
    runs = VariantRuns(worker, Path("nowhere"), [], EXPLICIT, costs, Overheads(1.0, 1.0), Budget(seconds), lambda text: None)
    return runs.rows(ladder(), 3)


def test_a_budget_is_kept_on_a_machine_that_slows_down(monkeypatch, file, tmp_path):
    """Rungs for which no time is left are left out and say so; the scene's own and the reference come first."""
    for budget, pace in ((20.0, 1.0), (60.0, 1.0), (60.0, 4.0), (400.0, 4.0)):
        clock = MadeUpWorker(monkeypatch, 0.2, pace)
        rows = climbed(clock, budget)
        ran = [row for row in rows if row.cpu]
        assert clock.now <= budget and {"mindlin", "exact, step /4"} <= {row.variant.name for row in ran}
        assert all(row.message in (LEFT_OUT, "stopped: the budget was over") for row in rows if not row.cpu)
        assert (len(ran) < len(rows)) == (budget < 50.0 or (budget < 100.0 and pace > 1.0))
    clock = MadeUpWorker(monkeypatch, 30.0)
    with pytest.raises(UsageError, match=r"--budget 40 s: too short for the smallest ladder .* about 2\.\d min are needed"):
        climbed(clock, 40.0)
    assert clock.now <= 40.0
    with pytest.raises(UsageError, match="--budget 0.01 s: too short"):
        cost.study(file, tmp_path / "out", budget=0.01)


def test_medians_and_how_far_they_may_be_off():
    # one alone tells a factor of two, a few half their range; that two agree may be chance
    assert (timing([2.0]), timing([1.0, 2.0, 4.0]), timing([2.0, 2.0])) == ((2.0, 1.0), (2.0, 1.5), (2.0, 0.5))
    many = timing([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])
    assert many.seconds == 5.0 and many.half == pytest.approx(1.57 * 4.0 / 3.0, rel=1e-12)
    assert timing([1.0] * 9).half == 0.03  # what repeats in one process cannot tell
    assert slower(timing([2.0] * 9), timing([1.0] * 9)) and not slower(timing([1.05] * 9), timing([1.0] * 9))


def test_noise_recommends_nothing(made):  # noqa: F811
    """A variant at half the median cost, timed once, or with a spread that covers the difference, is no cheaper variant."""
    own, less, fine = made.rows[1:4]
    fine.cpu = [1.01 * x for x in less.cpu]  # mdr 16 beside mdr 8, less accurate
    names = [row.variant.name for row in cost.efficient(made)]
    assert "mdr 8" not in names and "mdr 16" in names
    for entry, error in ((own, 0.004), (fine, 0.001), (made.rows[5], 0.5)):
        entry.errors = dict.fromkeys(entry.errors, error)
    fine.cpu, own.cpu = [0.52 * own.seconds], [own.seconds]  # as "tolerance / 16 at 0.52 times the cost" was
    best, words = cost.recommended(made)
    assert best is own and "`mindlin`, the variant of the scene," in words
    assert words.endswith("`mdr 16` takes the same time within the spread")
    fine.cpu, own.cpu = fine.cpu * 9, own.cpu * 9
    best, words = cost.recommended(made)
    assert best is fine and "at 0.52 times the cost of `mindlin`" in words


def test_an_existing_folder_is_refused(tmp_path):
    (tmp_path / "kept").write_text("mine")
    for overwrite in (False, True):  # never what is no study
        with pytest.raises(OutputError):
            cost_command(StudySource(tmp_path / "s.toml", {}, tmp_path, []), StudyOptions(3), overwrite, False, print)
    assert (tmp_path / "kept").exists()


@pytest.mark.full(kind="slow")
def test_the_whole_command(file, tmp_path, capsys):
    out = tmp_path / "out"
    cost_command(StudySource(file, {}, out, []), StudyOptions(2), False, True, lambda text: None)
    report = json.loads(capsys.readouterr().out)
    assert report == json.loads((out / "cost.json").read_text())
    assert len(report["variants"]) >= 14 and all(variant["stable"] for variant in report["variants"])
    assert (out / "cost.png").exists() and (out / "cost.pdf").exists()
    by_name = {variant["name"]: variant["friction_error"] for variant in report["variants"]}
    assert by_name["mdr 64"] < by_name["coulomb"]
