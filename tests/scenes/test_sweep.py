"""Sweeps as a user runs them: the table, the folders, resume, retry, executors, lost workers."""

import csv
import itertools
import json
import signal
import threading
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from balls import BALLS
import thirdbody
from thirdbody import atomic_files
from thirdbody.errors import InputError, Interrupted, OutputError, UsageError
from thirdbody.studies import plan as plans
from thirdbody.studies.plan import make_plan
from thirdbody.studies.point import RESULT_FILE, point_name, run_point
from thirdbody.studies.results import TIMES, results_of
from thirdbody.studies.runner import Execution, execute_sweep
from thirdbody.studies.sweep_file import sweep_of_python
from thirdbody.studies.workers import LocalWorkers

MU, COUNT = "pairs.0.friction", "debris.0.count"
VARY = {MU: [0.1, 0.2], COUNT: [3, 400]}  # half of the points fails: 400 balls have no space in the domain
SCENE = thirdbody.Scene.parse(BALLS)


def table(folder):
    rows = list(csv.DictReader((folder / "points.csv").open(encoding="utf-8")))
    return [{name: cell for name, cell in row.items() if name.partition(" ")[0] not in TIMES} for row in rows]


def plan_in(folder, vary=VARY, **options):
    return make_plan(SCENE, sweep_of_python(vary, options), folder)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep") / "whole"
    return thirdbody.sweep(SCENE, VARY, folder, progress=False, workers=1)


def test_every_point_is_a_row_and_failed_ones_say_why(whole):
    rows = table(whole.path)
    assert [(float(row[MU]), int(row[COUNT])) for row in rows] == [(mu, n) for mu in (0.1, 0.2) for n in (3, 400)]
    for row, point in zip(rows, whole.points, strict=True):
        if point.values[COUNT] == 400:
            assert (point.status, row["status"], row["exit_code"]) == ("failed", "failed", "3")
            assert "debris[0]" in point.reason and row["reason"] == point.reason and row["load [N]"] == ""
        else:
            assert (row["status"], row["exit_code"], row["reason"]) == ("done", "0", "")
            assert float(row["load [N]"]) == point.results["load"]
            # each ball carries its patch of 0.1 mN; settling ends within a thousandth
            assert point.results["load"] == pytest.approx(1e-4 * point.values[COUNT], rel=1e-3)

    point = whole.points[2]  # its results are those of its run
    with point.run as run:
        assert point.folder.name in str(run.path)
        assert point.results["friction_coefficient"] == run.friction.value
        assert point.results["fraction_rolling"] == run.series["fraction_rolling"][-1]
        rolled = (run.states == run.state_names.index("rolling")).any(axis=0).mean()
        assert point.results["fraction_ever_rolling"] == rolled
        assert point.results["energy_residual"] == run.summary()["energy_residual"]
        last = {"bodies": 3.0, "frames": run.frames, "gap": run.series["gap"][-1], "steps": run.summary()["steps"]}
        assert results_of(run, run.summary(), last) == last
        scene = thirdbody.Scene.parse(run.scene_text)
    assert (scene.pairs[0].friction, scene.debris[0].count) == (0.2, 3)


def test_any_executor_will_do_and_the_summary_alone_may_stay(whole, tmp_path):
    with ThreadPoolExecutor(1) as executor:
        sweep = thirdbody.sweep(SCENE, VARY, tmp_path / "threads", executor, progress=False, keep="summary")
    assert table(sweep.path) == table(whole.path)
    assert {path.name for path in sweep.points[0].folder.iterdir()} == {RESULT_FILE}
    with pytest.raises(InputError, match="only its results were kept"):
        _ = sweep.points[0].run


class Count:
    def __init__(self) -> None:
        self.calls = 0

    def submit(self, function, /, *arguments):
        self.calls += 1
        future: Future = Future()
        future.set_result(function(*arguments))
        return future


def test_a_sweep_goes_on_with_what_is_missing_and_retries_on_request(whole, tmp_path):
    folder = tmp_path / "part"
    execute_sweep(plan_in(folder, {MU: [0.1], COUNT: [3, 400]}), folder, Execution(Count()))
    with pytest.raises(OutputError, match="exists already; resume=True goes on"):
        thirdbody.sweep(SCENE, VARY, folder, progress=False)
    executor = Count()
    execute_sweep(plan_in(folder), folder, Execution(executor, resume=True))  # a larger plan: its new points
    assert executor.calls == 4 - 2 and table(folder) == table(whole.path)
    sweep = thirdbody.sweep(folder, resume=True, executor=Count(), progress=False)  # its folder is enough
    assert table(folder) == table(whole.path) and list(sweep.axes) == [MU, COUNT]
    executor = Count()
    thirdbody.sweep(folder, resume="failed", executor=executor, progress=False)
    assert executor.calls == 2 and table(folder) == table(whole.path)


def test_wrong_calls_are_named(tmp_path):
    (tmp_path / "balls.toml").write_text(BALLS, encoding="utf-8")
    for arguments, options, text in (
        ((tmp_path / "balls.toml",), {}, "is a scene; give `vary`"), ((SCENE,), {}, "give `vary`"),
        ((SCENE, {MU: [0.1]}), {"workers": 0}, "workers = 0: must be a whole number of at least 1"),
        ((SCENE, {MU: [0.1]}), {"resume": "all"}, "resume = 'all': must be"),
        ((SCENE, {MU: [0.1]}), {"executor": "tcp://x:1"}, "executor = 'tcp://x:1': must be a Dask client"),
        ((SCENE, f"{MU}=0.1"), {}, "vary = 'pairs.*: must be a dictionary"),
    ):  # fmt: skip
        with pytest.raises(UsageError, match=text):
            thirdbody.sweep(*arguments, out=tmp_path / "out", **options)
    with pytest.raises(InputError, match="desing: unknown key, did you mean 'design'"):
        thirdbody.sweep(SCENE, {MU: [0.1]}, tmp_path / "out", desing="zip")
    assert not (tmp_path / "out").exists()


def test_points_with_the_same_scene_have_one_run(tmp_path):
    executor = Count()
    execute_sweep(plan_in(tmp_path, {MU: [0.1, 0.2, 0.1]}), tmp_path, Execution(executor, resume=True))
    rows = table(tmp_path)
    assert executor.calls == 2 and {**rows[0], "point": "2"} == rows[2]


def test_an_interrupted_point_goes_on_from_its_checkpoint_to_the_same_row(whole, tmp_path):
    plan, folder, calls = plan_in(tmp_path / "cut"), tmp_path / "cut", itertools.count()
    stopped = run_point(plan.points[0], lambda: next(calls) >= 3)  # within the first run, some steps after its start
    assert stopped.status == "interrupted" and (plan.points[0].folder / "checkpoint.npz").is_file()
    with pytest.raises(Interrupted, match="0 of 4 points are done.*resume=True"):
        execute_sweep(plan, folder, Execution(workers=1, resume=True, stop=lambda: True))
    assert {row["status"] for row in table(folder)} <= {"waiting", "interrupted"}
    execute_sweep(plan, folder, Execution(Count(), resume=True))
    assert table(folder) == table(whole.path)


def test_two_workers_of_which_one_dies_give_the_same_table(whole, tmp_path):
    plan, folder = plan_in(tmp_path / "killed"), tmp_path / "killed"
    workers, ended = LocalWorkers(2), threading.Event()

    def kill() -> None:
        while not ended.wait(0.02):
            running = [worker.process for worker in list(workers._workers) if worker.process is not None]
            if running and any((folder / "points").glob("*/run.vtkhdf")):
                running[0].send_signal(signal.SIGKILL)
                return

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        execute_sweep(plan, folder, Execution(workers))
    finally:
        ended.set()
        killer.join()
        workers.shutdown()
    assert table(folder) == table(whole.path)


DEADLY = """\
import os, sys
if os.path.join("studies", "workers") in sys.argv[0]:
    print("no more memory", file=sys.stderr, flush=True)
    os._exit(7)
DEBRIS_KINDS = ()
"""


@pytest.mark.full(kind="slow")
def test_a_point_that_kills_its_process_every_time_has_failed(tmp_path):
    plugin = tmp_path / "deadly.py"
    plugin.write_text(DEADLY)
    plan = make_plan(SCENE, sweep_of_python({MU: [0.1]}, {}), tmp_path / "dead", [plugin])
    execute_sweep(plan, tmp_path / "dead", Execution())
    [row] = table(tmp_path / "dead")
    assert (row["status"], row["exit_code"]) == ("failed", "7")
    assert row["reason"] == "no answer: its process ended 3 times (exit code 7: no more memory)"
    executor = Count()
    execute_sweep(plan, tmp_path / "dead", Execution(executor, resume=True))
    assert executor.calls == 0  # a failed row stays one


def test_a_full_disk_ends_the_sweep_with_one_message(tmp_path, monkeypatch):
    def full_for_points(path, content):
        if path.name == RESULT_FILE:
            raise OSError(28, "No space left on device")
        write(path, content)

    write = atomic_files.write_whole
    folder = tmp_path / "full"
    plan = plan_in(folder, {MU: [0.1], COUNT: [3, 400]})
    with monkeypatch.context() as patch:
        patch.setattr(atomic_files, "write_whole", full_for_points)
        with pytest.raises(OutputError, match="point.json: cannot be written .No space left on device"):
            execute_sweep(plan, folder, Execution(Count()))
    assert not [row for row in table(folder) if row["status"] in ("done", "failed")]
    execute_sweep(plan, folder, Execution(Count(), resume=True))  # there is space again
    assert {row["status"] for row in table(folder)} == {"done", "failed"}


def test_another_version_of_the_source_computes_its_own_points(tmp_path, monkeypatch):
    names = [point.folder for point in plan_in(tmp_path).points]
    assert names == [point.folder for point in plan_in(tmp_path).points] and len(set(names)) == 4
    # so does another content of a file that the scene names
    scene, contents = thirdbody.Scene.parse(BALLS, "scene.toml", tmp_path), set()
    for key, load in (("table", 1), ("table", 2), ("file", 3)):
        (tmp_path / "load.csv").write_text(f"time [us],load [mN]\n1,{load}\n")
        contents.add(point_name("", {"plates": [{key: "load.csv"}]}, scene, ""))
    assert len(contents) == 3
    monkeypatch.setattr(plans, "code_version", lambda files: "another")
    assert not set(names) & {point.folder for point in plan_in(tmp_path).points}


def test_the_command_prints_the_table_and_its_dry_run_writes_nothing(command, tmp_path):
    (tmp_path / "balls.toml").write_text(BALLS, encoding="utf-8")
    vary = ("--vary", f"{MU}=0.1:0.2:2", "-o", "out")
    report = command("sweep", "balls.toml", *vary, "--dry-run", "--json")
    cost = json.loads(report.out)
    assert report.code == 0 and cost["points"] == 2 and cost["core_seconds"] > 0.0 and cost["disk"] > 1000
    assert cost["axes"] == [{"key": MU, "unit": "1", "values": [0.1, 0.2]}] and not (tmp_path / "out").exists()
    report = command("sweep", "balls.toml", *vary, "--json", "--quiet", "--workers", 1)
    points = json.loads(report.out)["points"]
    assert report.code == 0 and [point["status"] for point in points] == ["done", "done"]
    report = command("sweep", "out", "--resume")
    assert report.code == 0 and report.out == "2 of 2 points done: out/points.csv\n"
    assert command("plot", "out", "-o", "curve.svg").code == 0 and (tmp_path / "curve.svg").stat().st_size > 5000
    costs = []
    for values in ("0.1,0.2", "0.1,0.2,0.3", "0.1,0.2,0.3,0.4"):
        report = command("sweep", "balls.toml", "--vary", f"{MU}={values}", *"-o out --dry-run --json --workers 2".split())
        costs.append(json.loads(report.out))
    assert [cost["measured"] for cost in costs] == [cost["done"] for cost in costs] == [2, 2, 2]
    none, one, two = (cost["core_seconds"] for cost in costs)  # of those that are missing
    assert none == 0.0 < one and two == pytest.approx(2.0 * one)
    assert [cost["wall_time"] for cost in costs] == [0.0, one, two / 2.0]
    assert command("sweep", "out", "--retry", "failed").code == 0  # goes on, as with --resume
