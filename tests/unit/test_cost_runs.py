"""Studies of cost as they run: budgets of time, copies of few bodies, workers, seconds and their spread, JSON, the picture."""

import json
import math
import time
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from portable import drawn
import thirdbody
from thirdbody.engine.state import orientations
from thirdbody.errors import InputError, OutputError, UsageError
from thirdbody.kernels.tables import body
from thirdbody.plot.figures import save
from thirdbody.runner.simulate import prepare
from thirdbody.studies import cost, cost_runs, pictures
from thirdbody.studies.copies import (
    FEWEST,
    FEWEST_THAT_MEET,
    Copy,
    StudySource,
    compile_law,
    make_copy,
    rate_point,
    reduce_scene,
    reductions,
    thin,
    time_point,
)
from thirdbody.studies.cost import read_outcome
from thirdbody.studies.cost_command import StudyOptions, cost_command, study
from thirdbody.studies.cost_report import LEFT_OUT, as_json, convergence, falling
from thirdbody.studies.cost_runs import Bench, Overdue, VariantRuns, repeats_of
from thirdbody.studies.point import DONE, INTERRUPTED, Point, PointResult, run_point
from thirdbody.studies.timing import NUDGE, Late, bare, lone, nudge, slower, timing
from thirdbody.studies.variants import Costs
from .test_cost import EXPLICIT, IMPLICIT, SCENE, TWO, ladder, made, outcome  # noqa: F401


@pytest.fixture
def file(tmp_path) -> Path:
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def test_the_cost_of_a_variant_is_measured_for_its_law_or_estimated():
    assert [repeats_of(seconds, 3) for seconds in (0.01, 1.0, 60.0)] == [5, 3, 2] and repeats_of(0.01, 12) == 12
    costs = Costs(EXPLICIT, 1.0, ("exact", None), 0.1, {})
    report = {variant.name: costs.of(variant) for variant in ladder()}
    assert report["mdr 64"] == 9.0 and report["mindlin"] == 1.0  # linear in the springs
    assert report["mindlin, step x4"] == 0.25 and report["exact, step /4"] == 60.0 and report["mindlin, implicit"] == 0.1
    for variant in ladder():
        if variant.name in ("exact", "mindlin, implicit", "mindlin, step x4"):
            costs.learn(variant, 3.0)
    report = {variant.name: costs.of(variant) for variant in ladder()}
    assert report["exact, step /4"] == 12.0 and report["mindlin, implicit"] == 3.0 and report["mindlin, step x4"] == 0.25


def test_a_thinned_copy_has_its_bodies_as_close_as_they_were_and_as_many_meet():
    """So what contact between bodies costs and changes is measured: by variants from displaced starts, and without it."""
    text = SCENE.replace("count = 2", "count = 200").replace('radius = "5 um"', 'radius = "5 um"\nplacement = "layer"')
    scene = thirdbody.Scene.parse(text.replace('"100 um", "100 um"', '"300 um", "200 um"').replace('debris_contact = "none"', ""))
    near = thin(scene, 200, 0.25)
    copy = scene.with_settings(near)
    assert copy.debris[0].count == 50
    assert copy.domain.size == pytest.approx((150e-6, 100e-6), rel=1e-12)  # a quarter of the area
    assert thin(scene, 200, 1.5) == {} == thin(scene, FEWEST, 0.1)
    first = prepare(scene)
    copy, built = reduce_scene(scene, [], 1e-9, first)
    words = reductions(scene, 200, first.settle, copy, built)
    assert copy.debris[0].count == FEWEST_THAT_MEET and built.state.world.debris_meets
    assert words[0] == "50 of 200 bodies, as close as they were"
    assert np.prod(copy.domain.size) / FEWEST_THAT_MEET == pytest.approx(np.prod(scene.domain.size) / 200, rel=1e-12)
    # no domain is shorter than the waves of its surfaces
    waves = {"rms": "0.1 um", "hurst": 0.8, "long": "100 um", "short": "20 um", "seed": 1}
    rough = thin(scene.with_settings({"plates.lower.surface": waves}), 200, 1e-3)
    assert rough["debris.0.count"] == 64 and len(rough["domain.size"]) == 2
    # a plate that all carry keeps its pressure, and its mass and dashpot for each body
    rigid = {"plates.upper.support": "rigid", "plates.upper.load": "8 mN", "plates.upper.mass": "8 ug"}
    near = thin(scene.with_settings(rigid), 200, 0.3)
    assert near["debris.0.count"] == 50 and (near["plates.upper.load"], near["plates.upper.mass"]) == ("2 mN", "2 ug")
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
    report = json.loads(json.dumps(as_json(made)))
    assert {"scene", "machine", "reduction", "reference", "recommended", "variants"} <= set(report)
    names = {"level", "springs", "integrator", "step", "wall_s", "time_ratio", "friction_error", "load_error", "position_error",
             "label_difference", "energy_residual", "stable"}  # fmt: skip
    assert all(names <= set(variant) for variant in report["variants"]) and report["reference"] == "exact, step /4"
    assert report["variants"][3]["time_ratio"] == 2.0 and report["variants"][3]["springs"] == 16
    assert report["variants"][-2]["stable"] is False
    figure = pictures.picture_of_study(made)
    axes = figure.axes[0]
    names = {text.get_text() for text in axes.texts}
    assert {"coulomb", "mindlin (as in the scene)", "exact, step /4 (reference)"} <= names
    assert "recommended" in "".join(names) and axes.get_title(loc="left").split() == report["recommended"]["advice"].split()
    assert [0.5, 1.0, 2.0, 4.0, 9.0, 30.0] in [list(line.get_xdata()) for line in axes.lines]  # the front
    save(figure, tmp_path / "cost.png")
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


def point_of(scene, folder, **keys) -> Point:
    return Point(0, folder, scene.to_toml(), folder, ("integration_time",), **keys)


def test_a_point_has_its_time_says_what_failed_and_ends_at_its_deadline(tmp_path):
    point = point_of(TWO, tmp_path / "0")
    ran = run_point(point)
    wall, cpu = time_point(point, 30.0)
    assert ran.status == DONE and ran.seconds > ran.results["integration_time"] > 0.0 and wall > 0.0 and cpu > 0.0
    bad = run_point(point_of(TWO.with_settings({"solver.time_step": "1 s", "solver.integrator": "explicit"}), tmp_path / "1"))
    assert bad.status == "failed" and "above the bound" in bad.reason
    with pytest.raises(Late):
        time_point(point, -1.0)
    stopped = run_point(replace(point, folder=tmp_path / "2", deadline=0.0))
    assert stopped.status == INTERRUPTED and not (tmp_path / "2" / "point.json").exists()


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_what_is_timed_is_the_run(integrator, tmp_path):
    """The same steps to the last bit, without what is done at the stops."""
    scene = TWO.with_settings({"solver.integrator": integrator})
    run_point(point_of(scene, tmp_path / "run"))
    built = prepare(scene)
    wall, cpu = bare(built, 30.0)
    ran = read_outcome(tmp_path / "run")
    assert np.array_equal(built.state.bodies.position, ran.position)
    assert np.array_equal(orientations(built.state), ran.quaternion) and 0.0 < wall and 0.0 < cpu
    with pytest.raises(Late):
        bare(prepare(scene), -1.0)


class MadeUpBench(Bench):
    """A clock of its own: each run takes so many seconds, and one more to start, on a machine of this pace. Laws take `compiling`
    seconds in another process: 6, `exact` 14 and `coulomb` 3 times that."""

    pace = end = 0.0

    def __init__(self, monkeypatch, seconds, budget, pace=1.0, compiling=0.0):
        self.now, self.end, self.seconds, self.pace, self.each, self.laws = 0.0, budget, seconds, pace, compiling, {}
        self.runner, self.compilers, self.count, self.compiled = self, self, 1, 0.0
        self.budget, self.wall, self.cpu, self.calls = budget, 0.0, 0.0, 0
        monkeypatch.setattr(time, "time", lambda: self.now)
        monkeypatch.setattr(time, "sleep", self.advance)
        monkeypatch.setattr(cost_runs, "read_outcome", lambda folder: outcome())
        monkeypatch.setattr(cost_runs, "run_points", self.run_points)
        monkeypatch.setattr(cost_runs, "units_are_compiled", lambda units: True)  # whatever this machine has in its cache

    def advance(self, seconds):
        self.now += seconds

    def submit(self, function, one, arguments):
        level = arguments[1]["contact.level"] if one is compile_law else None
        cpu = self.each * {"exact": 14.0, "coulomb": 3.0}.get(level, 6.0)
        self.compiled = max(self.now, self.compiled) + cpu * self.pace
        return SimpleNamespace(done=lambda at=self.compiled: self.now >= at, result=lambda: (None, cpu), exception=lambda: None)

    def left(self):
        return self.end - self.now

    def run_points(self, points, executor, record, stop, grace):
        spent = (self.costs(points[0]) + 1.0) * self.pace
        late = self.now + spent > points[0].deadline
        self.now = min(self.now + spent, points[0].deadline)
        status, seconds = INTERRUPTED if late else DONE, {"integration_time": self.costs(points[0])}
        record(PointResult(points[0].number, status, "", 0, spent, seconds))

    def costs(self, point):
        return self.seconds * (15.0 if "exact" in point.scene else 1.0)

    def call(self, function, point, limit):
        if function is rate_point:
            return self.costs(point)
        self.now += self.costs(point) * self.pace
        if self.left() < 0.0:
            raise Overdue
        return self.costs(point) * self.pace, self.costs(point)


def studied(bench, tmp_path):
    copy, source = Copy(TWO.to_toml(), EXPLICIT, ["1 of 2 bodies"], 1.0), StudySource(Path("s.toml"), {}, tmp_path, [])
    runs = VariantRuns(bench, copy, source, lambda text: None)
    runs.run(runs.own, 1e9)
    runs.compile_beside()
    runs.run_all(3)
    runs.time_all(3)
    return runs.rows


@pytest.mark.parametrize(
    ("budget", "pace", "compiling", "whole"),
    [(30.0, 1.0, 0.0, False), (300.0, 1.0, 0.0, True), (90.0, 3.0, 0.0, False), (900.0, 3.0, 0.0, True), (60.0, 1.0, 1.0, True),
     (45.0, 1.0, 1.0, False), (300.0, 1.0, 1.0, True)],
)  # fmt: skip
def test_a_budget_is_kept_and_no_cheap_variant_is_left_out_for_a_dear_one(budget, pace, compiling, whole, monkeypatch, tmp_path):
    bench = MadeUpBench(monkeypatch, 0.15 if compiling else 0.2, budget, pace, compiling)
    rows = studied(bench, tmp_path)
    ran, omitted = [row for row in rows if row.cpu], [row for row in rows if not row.cpu]
    assert bench.now <= budget and all(row.message.startswith(LEFT_OUT) for row in omitted) and (not omitted) == whole
    assert all("a budget of about " in row.message for row in omitted)
    names = {row.variant.name for row in ran}
    assert {"mindlin", "exact", "coulomb", "mdr 8", "mindlin, step x4", "mindlin, step x2"} <= names
    costs = Costs(EXPLICIT, 0.2, ("exact", None), 0.2, {})

    def price(row):
        compiled = (row.variant.level, row.variant.integrator) in (("mindlin", "explicit"), ("exact", "explicit"))
        return costs.of(row.variant) + (0.0 if compiled else 6.0 * compiling)

    first = ("exact", "exact, step /4", "exact, step /2", "mdr 8", "coulomb")  # what every study has
    cheap = [price(row) for row in ran if row.variant.name not in first]
    assert all(price(row) >= max(cheap) for row in omitted if row.variant.name != "exact, step /4")
    assert all(len(row.cpu) >= 3 for row in ran if row.variant.axis == "step") or not whole


def test_a_budget_that_holds_nothing_is_refused_and_leaves_no_folder(monkeypatch, file, tmp_path):
    def overdue(*_arguments):
        raise Overdue

    monkeypatch.setattr("thirdbody.studies.cost_command._begin", overdue)
    with pytest.raises(UsageError, match=r"--budget 20 s: too short to build the scene"):
        cost_command(StudySource(file, {}, tmp_path / "new" / "out", []), StudyOptions(3, budget=20.0), False, False, print)
    assert not (tmp_path / "new").exists()


def test_a_copy_takes_the_time_that_it_is_made_for(file, tmp_path):
    """And the explicit step of all its variants is the smallest that `auto` takes."""
    changes = {"solver.integrator": "explicit", "solver.distance": "4 mm", "output.every": "0.1 mm"}
    copy = make_copy(StudySource(file, changes, tmp_path, []), 0.02, True)
    scene = thirdbody.Scene.parse(copy.scene)
    assert scene.solver.distance < 4e-3 and "4 mm" in copy.reduction[0] and "the smallest that `auto` takes" in copy.reduction[-1]
    assert copy.base.kind == "explicit" and 0.0 < copy.base.step <= prepare(scene).state.dt
    assert Copy.of(json.loads(json.dumps(asdict(copy)))) == copy


def test_medians_how_far_they_may_be_off_and_that_noise_recommends_nothing(made):  # noqa: F811
    # one alone tells a factor of two, a few half their range; that two agree may be chance
    assert (timing([2.0]), timing([1.0, 2.0, 4.0]), timing([2.0, 2.0])) == ((2.0, 1.0), (2.0, 1.5), (2.0, 0.5))
    assert timing([2.0], 0.1) == (2.0, pytest.approx(0.2, rel=1e-12))
    # how far the others vary tells it of a single one: half of 21 even values lie within 0.2; few samples or values tell nothing
    assert lone([np.linspace(0.8, 1.2, 21)]) == pytest.approx(1.57 * 0.2, rel=1e-12) and lone([np.ones(21)]) == 0.1
    assert lone([np.ones(4)] * 9) == lone([np.ones(19)]) == 0.5
    many = timing([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])
    assert many.seconds == 5.0 and many.half == pytest.approx(1.57 * 4.0 / 3.0, rel=1e-12)
    assert timing([1.0] * 9).half == 0.03  # what repeats in one process cannot tell
    assert slower(timing([2.0] * 9), timing([1.0] * 9)) and not slower(timing([1.05] * 9), timing([1.0] * 9))
    # a variant at half the median cost, timed once, or with a spread that covers the difference, is no cheaper variant
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
    table = thirdbody.Sweep(out)  # has the table of a sweep
    assert [point.values["variant"] for point in table.points] == [variant["name"] for variant in report["variants"]]
    assert all(point.results["integration_time"] > 0.0 and point.run.frames > 1 for point in table.points)
    log: list[str] = []
    cost_command(StudySource(file, {}, out, []), StudyOptions(2, resume=True), False, True, log.append)
    again = json.loads(capsys.readouterr().out)  # goes on: no run is repeated, and it recommends the same
    assert again["recommended"]["variant"] == report["recommended"]["variant"] and len(log) == 1
    with pytest.raises(InputError, match="is a study of another scene or version"):
        study(StudySource(file, {"solver.distance": "21 nm"}, out, []), resume=True)
    picture = tmp_path / "x.svg"
    cost_command(StudySource(file, {}, picture, []), StudyOptions(2, budget=60.0, picture=picture), False, False, log.append)
    assert picture.stat().st_size > 5000 and capsys.readouterr().out.splitlines()[-1] == str(picture)
    assert len(report["variants"]) >= 14 and all(variant["stable"] for variant in report["variants"])
    assert (out / "cost.png").exists() and (out / "cost.pdf").exists()
    by_name = {variant["name"]: variant["friction_error"] for variant in report["variants"]}
    assert by_name["mdr 64"] < by_name["coulomb"]
