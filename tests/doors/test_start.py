"""How the program starts, tells its progress, and ends: quickly, plainly, and in order when it is interrupted."""

import fcntl
import json
import os
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

import numpy as np
import pytest
from balls import BALLS, edited
from portable import PATIENCE
import thirdbody
from thirdbody.assembly.simulation import build
from thirdbody.engine import units
from thirdbody.render import elsewhere
from thirdbody.runner.checkpoint import FILE as CHECKPOINT
from thirdbody.runner.stops import planned_frames, targets
from thirdbody.studies.point import Point, run_point
from thirdbody.studies.workers import LocalWorkers
from thirdbody.system import processes
from thirdbody.trajectory.writer import Frame, TrajectoryWriter

SLOW = pytest.mark.full(kind="slow")
LONG = [('"0.1 um"', '"1 mm"'), ('"0.05 um"', '"0.1 um"')]  # makes an hour's run of the scene of four balls
PROGRAM = [sys.executable, "-m", "thirdbody"]
HEAVY = ("numba", "vtk", "vtkmodules", "pyvista", "matplotlib", "h5py", "pint", "scipy", "pandas")


def python(*arguments, **options):
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, **options)


def test_starting_imports_nothing_heavy_and_help_is_instant():
    calls = [["--help"], ["run", "--help"], ["new", "/nowhere/x"]]
    code = f"""import sys, thirdbody, thirdbody.scene.model
import thirdbody.errors, thirdbody.runner.progress, thirdbody.jit.cache
from thirdbody.cli.main import main
thirdbody.Scene
for words in {calls}:
    sys.argv = ["thirdbody", *words]
    try: main()
    except SystemExit: pass
print("loaded", [name for name in {HEAVY} if name in sys.modules])"""
    done = python("-c", code)
    assert done.stdout.splitlines()[-1] == "loaded []", done.stderr
    # budget of the design: 0.3 s on a free core; here the processor time, for the machine may be shared
    before = os.times()
    assert python("-m", "thirdbody.cli.main", "--help").returncode == 0
    after = os.times()
    assert after.children_user + after.children_system - before.children_user - before.children_system < 0.6


@SLOW
@pytest.mark.parametrize(("integrator", "other"), [("implicit", "explicit"), ("explicit", "implicit")])
def test_a_run_loads_its_own_integrator_alone(integrator, other, tmp_path):
    """The other one would be loaded at every start."""
    scene = tmp_path / "scene.toml"
    scene.write_text(edited(BALLS, ("[solver]", f'[contact]\ndebris_contact = "none"\n[solver]\nintegrator = "{integrator}"')))
    done = python("-c", f"import sys, thirdbody; thirdbody.run({str(scene)!r}, out='run'); print(*sys.modules)", cwd=tmp_path)
    loaded = done.stdout.split()
    assert f"thirdbody.engine.{integrator}" in loaded and f"thirdbody.engine.{other}" not in loaded, done.stderr


def test_the_first_steps_of_a_new_user(command, tmp_path):
    assert "thirdbody check scene.toml" in command("new").out
    short = ("--set", "debris.0.count=8", "--set", "solver.distance=0.1 um", "--set", "solver.settle=1 us",
             "--set", "output.every=0.05 um")  # fmt: skip
    report = command("check", "scene.toml", *short)
    assert report.code == 0 and "time step" in report.out and "estimated" in report.out
    assert command("run", "scene.toml", *short, "--threads", "1").code == 0
    assert (tmp_path / "runs" / "scene" / "run.vtkhdf").is_file()
    report = command("states", "runs/scene")
    assert report.code == 0 and report.out.split()[:3] == ["frame", "time", "distance"]
    report = command("states", "runs/scene", "--frame", "-1")
    assert report.code == 0 and len(report.out.splitlines()) == 2 + 8


def strict(text):
    return json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))


def test_json_of_every_table(balls, command):
    balls()
    report = strict(command("check", "scene.toml", "--json").out)
    assert report["bodies"] == 4 and report["frames"] == 4 and report["scene"]["title"] == "four balls"
    assert report["time_step"]["step"] < report["time_step"]["rayleigh"]
    done = command("run", "scene.toml", "-o", "run", "--json", "-q", "--threads", "1")
    assert done.code == 0 and strict(done.out)["frames"] == report["frames"] and strict(done.out)["finished"] is True
    rows = strict(command("states", "run", "--json").out)["frames"]
    assert [row["frame"] for row in rows] == [0, 1, 2, 3]
    assert all(sum(row[name] for name in ("free", "sticking", "sliding", "rolling")) == 4 for row in rows)
    assert len(strict(command("states", "run", "--frame", "0", "--json").out)) == 4
    laws = strict(command("laws", "--json").out)
    assert {family["law"] for family in laws["families"]} >= {"hertz_mindlin", "three_spot"} and laws["failures"] == {}
    # no wall time can be estimated of a time step that a guard stops: null, not NaN
    balls(('settle = "1 us"', 'settle = "1 us"\ntime_step = "500 ns"'))
    assert strict(command("check", "scene.toml", "--force", "--json").out)["estimated_wall_time"] is None


def test_planned_frames_are_those_of_the_targets(balls):
    by_time = ('distance = "0.1 um"', 'duration = "1 us"')
    for changes in (
        [], [('settle = "1 us"', 'settle = "0 s"')], [('"0.05 um"', '"0.03 um"')], [('"0.05 um"', '"7 ns"')], [by_time],
        [('"0.05 um"', '"0.1 um"')],  # one interval, the longest that is allowed
        [by_time, ('"0.05 um"', '"0.3 us"')], [('"0.05 um"', '"1 ns"'), ('"1 us"', '"auto"')],
    ):  # fmt: skip
        built = build(thirdbody.Scene.load(balls(*changes)))
        assert planned_frames(built) == 1 + sum(write for _, _, write in targets(built))


def test_progress_without_a_terminal_is_plain_lines_and_square_brackets_are_text(balls, command, monkeypatch):
    balls(("four balls", "four [bold]balls[/bold] [/]"))
    report = command("check", "scene.toml")
    assert report.code == 0 and "four [bold]balls[/bold] [/]: 4 bodies" in report.out and "[effects]" in command("laws").out
    report = command("run", "scene.toml", "-o", "run", "--threads", "1")
    lines = [line for line in report.err.splitlines() if not line.startswith("warning:")]
    assert 3 <= len(lines) <= 11 and "\x1b" not in report.err and "\r" not in report.err
    assert lines[0].startswith("  0 %") and lines[-1].startswith("100 %") and all(" t = " in line for line in lines)
    # with a terminal a bar is drawn
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    report = command("run", "scene.toml", "-o", "bar", "--threads", "1")
    assert report.code == 0 and "four [bold]balls[/bold] [/]" in report.err and "100%" in report.err


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_at_the_fourth_frame_ends_a_run_in_order(number, code, balls, command, monkeypatch, tmp_path):
    balls(('"0.1 um"', '"20 um"'), ('"0.05 um"', '"0.1 um"'))
    written, append = [], TrajectoryWriter.append

    def heard(writer, frame):
        append(writer, frame)
        written.append(frame.time)
        if len(written) == 4:
            os.kill(os.getpid(), number)

    monkeypatch.setattr(TrajectoryWriter, "append", heard)
    report = command("run", "scene.toml", "-o", "run", "--threads", "1")
    assert report.code == code and report.err.splitlines()[-1].startswith("thirdbody: interrupted at t = ")
    assert (tmp_path / "run" / CHECKPOINT).is_file() and 4 <= len(written) < 10
    assert "no: interrupted after" in report.out and "Traceback" not in report.err
    with thirdbody.open(tmp_path / "run") as run:
        assert run.frames >= 4 and len(run.times) == run.frames == len(run.series["time"])
        run.bodies(-1)
        report = run.summary()
        assert not report["finished"] and report["stopped"].startswith("interrupted") and report["frames"] == run.frames


@SLOW
def test_a_closed_terminal_ends_a_run_in_order(balls, tmp_path):
    """The bar is drawn on the terminal that goes away: writing there fails from then on, and the hangup may come twice."""
    balls(*LONG)
    ours, theirs = os.openpty()

    def in_its_own_session():
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # as a terminal gives it, also where the tests run under nohup
        os.setsid()
        fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)

    streams = {"stdin": theirs, "stdout": theirs, "stderr": theirs, "preexec_fn": in_its_own_session}
    process = subprocess.Popen([*PROGRAM, "run", "scene.toml", "-o", "run"], cwd=tmp_path, **streams)
    os.close(theirs)
    wait_for_frames(tmp_path / "run", 4)
    before = (tmp_path / "run" / CHECKPOINT).read_bytes()
    os.close(ours)
    assert process.wait(timeout=PATIENCE) == 129
    assert (tmp_path / "run" / CHECKPOINT).read_bytes() != before
    with thirdbody.open(tmp_path / "run") as run:
        assert run.summary()["stopped"].startswith("interrupted")


@SLOW
def test_a_run_under_nohup_outlives_a_hangup(balls, tmp_path):
    balls(*LONG)
    streams = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    process = subprocess.Popen(["nohup", *PROGRAM, "run", "scene.toml", "-o", "run", "-q"], cwd=tmp_path, **streams)
    wait_for_frames(tmp_path / "run", 2)
    process.send_signal(signal.SIGHUP)
    with thirdbody.open(tmp_path / "run") as run:
        frames = run.frames
    wait_for_frames(tmp_path / "run", frames + 2)
    process.terminate()
    assert process.wait(timeout=PATIENCE) == 143


def wait_for_frames(folder, count):
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            with thirdbody.open(folder) as run:
                if run.frames >= count:
                    return
        except (thirdbody.errors.InputError, OSError):
            pass
        time.sleep(0.05)
    pytest.fail("no frames were written")


def test_runs_that_are_empty_or_unlabelled(tmp_path, command):
    header = {"scene_text": "", "state_names": ["unlabelled"], "reason_names": ["none"], "units": {}}
    static = {"spheres": {"radius": np.ones(1), "clump": np.zeros(1, int)}, "clumps": {"id": np.zeros(1, int)}}
    point, none = {"points": np.zeros((1, 3))}, {"points": np.zeros((0, 3))}
    for name in ("empty", "plain"):
        (tmp_path / name).mkdir()
        with TrajectoryWriter(tmp_path / name / "run.vtkhdf", header, static) as writer:
            if name == "plain":
                writer.append(Frame(0.0, {**point}, {**point}, none, None, {"time": 0.0, "distance": 0.0}))
    report = command("states", "empty")
    assert report.code == 0 and "no frame" in report.out and command("states", "empty", "--json").code == 0
    assert command("states", "empty", "--frame", "0").code == command("render", "empty", "-o", "x.png").code == 3
    for arguments in (["states", "plain"], ["states", "plain", "--frame", "0"], ["render", "plain", "-o", "x.png"]):
        report = command(*arguments)
        assert report.code == 3 and "state" in report.err and "Traceback" not in report.err, report


SOURCE = Path(thirdbody.__file__).parent
FAKE = "import pathlib\npathlib.Path(__file__).with_suffix('.executed').touch()\nraise ImportError('from the current folder')\n"


@pytest.fixture
def planted(tmp_path, monkeypatch):
    for name in ("json", "shutil", "selectors", "numpy", "numba", "h5py", "vtkmodules", "thirdbody"):
        (tmp_path / f"{name}.py").write_text(FAKE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def executed(folder):
    return sorted(path.stem for path in folder.glob("*.executed"))


@SLOW
def test_processes_that_compile_first_work_for_a_study_or_draw_execute_none(planted):
    queue, end = os.pipe()
    os.close(end)  # nothing to compile: it starts, imports numba and ends
    assert units._helper((), queue).wait() == 0
    os.close(queue)
    assert executed(planted) == []
    with LocalWorkers(1) as workers:
        answer = workers.submit(run_point, Point(0, planted / "point", "none", planted, ())).result()
    assert "scene.toml" in answer.reason and executed(planted) == []
    errors = elsewhere._start("thirdbody.render.render", {"run": "none", "file": "x.png"}, None)[1]
    assert executed(planted) == []
    assert "KeyError" in errors or "no such run" in errors, errors  # it came as far as to read its job


@pytest.mark.parametrize("path", [os.pathsep, "HERE", *(pytest.param(path, marks=SLOW) for path in ("", "."))])
def test_an_entry_of_the_search_path_that_is_the_current_folder(planted, monkeypatch, path):
    """`PYTHONPATH=$PYTHONPATH:...` with nothing before the colon, as it stands in many shells' start files."""
    monkeypatch.setenv("PYTHONPATH", str(planted) if path == "HERE" else path)
    monkeypatch.setattr(sys, "path", ["", str(planted), *sys.path])
    command = processes.python_command("this_is_no_module")
    done = subprocess.run(command, env=processes.python_environment(), capture_output=True, text=True)
    assert "No module named this_is_no_module" in done.stderr and executed(planted) == []
    inner = "import json, subprocess, sys; print(json.dumps(sys.path)); subprocess.run([sys.executable, '-c', 'import json'])"
    start = [sys.executable, "-P", "-c", inner]
    done = subprocess.run(start, env=processes.python_environment(), capture_output=True, text=True)
    assert str(planted) not in json.loads(done.stdout) and executed(planted) == [], done.stderr


def test_a_child_has_the_packages_of_its_parent(tmp_path, monkeypatch):
    """Folders that a program added to its search path, after all others: they hide nothing."""
    (tmp_path / "only_here.py").write_text("import sys, json\nprint(sys.argv[1:], __name__, json.__file__)")
    (tmp_path / "json.py").write_text("raise ImportError('hides the standard library')")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    command = processes.python_command("only_here", "a", "b c")
    done = subprocess.run(command, env=processes.python_environment(), capture_output=True, text=True)
    assert done.stdout.startswith(f"['a', 'b c'] __main__ {json.__file__}"), done.stderr


def test_python_is_started_in_one_place_only():
    users = {path.name for path in SOURCE.rglob("*.py") if "sys.executable" in path.read_text(encoding="utf-8")}
    users |= {path.name for path in (SOURCE.parents[1] / "plugins").rglob("*.py") if "sys.executable" in path.read_text()}
    assert users == {"processes.py"}
