"""How the program starts, tells its progress, and ends: quickly, plainly, and in order when it is interrupted."""

from __future__ import annotations

import fcntl
import json
import os
import signal
import subprocess
import sys
import termios
import time

import pytest
from balls import BALLS, edited
from portable import PATIENCE

import thirdbody
from thirdbody.runner.checkpoint import FILE as CHECKPOINT

HEAVY = ("numba", "vtk", "vtkmodules", "pyvista", "matplotlib", "h5py", "pint", "scipy", "pandas")


def python(*arguments: str, **options) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, **options)


@pytest.mark.parametrize(
    "start",
    [
        "import thirdbody",
        "import thirdbody.scene.model",
        "import thirdbody; thirdbody.Scene",
        "import thirdbody.errors, thirdbody.runner.progress, thirdbody.jit.cache_dir",
        "import sys; sys.argv = ['thirdbody', '--help']\ntry:\n from thirdbody.cli.main import main; main()\n"
        "except SystemExit: pass",
        "import sys; sys.argv = ['thirdbody', 'run', '--help']\ntry:\n from thirdbody.cli.main import main; main()\n"
        "except SystemExit: pass",
        "import sys; sys.argv = ['thirdbody', 'new', '/nowhere/x']\ntry:\n from thirdbody.cli.main import main; main()\n"
        "except SystemExit: pass",
    ],
)
def test_starting_imports_nothing_heavy(start):
    done = python("-c", f"{start}\nimport sys; print('loaded', [name for name in {HEAVY} if name in sys.modules])")
    assert done.stdout.splitlines()[-1] == "loaded []", done.stderr


@pytest.mark.parametrize(("integrator", "other"), [("explicit", "implicit"), ("implicit", "explicit")])
def test_a_run_loads_its_own_integrator_alone(integrator, other, tmp_path):
    """The other one would have to be compiled at the first start, and loaded at every start."""
    scene = tmp_path / "scene.toml"
    scene.write_text(edited(BALLS, ("[solver]", f'[contact]\ndebris_contact = "none"\n[solver]\nintegrator = "{integrator}"')))
    code = f"import sys, thirdbody; thirdbody.run({str(scene)!r}, out='run'); print(*sys.modules)"
    done = python("-c", code, cwd=tmp_path)
    loaded = done.stdout.split()
    assert f"thirdbody.engine.{integrator}" in loaded, done.stderr
    assert f"thirdbody.engine.{other}" not in loaded


def test_help_is_instant():
    """Budget of the design: 0.3 s on a free core; here the processor time, for the machine may be shared."""
    before = os.times()
    assert python("-m", "thirdbody.cli.main", "--help").returncode == 0
    after = os.times()
    assert after.children_user + after.children_system - before.children_user - before.children_system < 0.6


def test_version(command):
    report = command("--version")
    assert report.code == 0 and report.out == f"thirdbody {thirdbody.__version__}\n"


def test_the_first_steps_of_a_new_user(command, tmp_path):
    """new, check, run, states, as the messages tell one after another."""
    assert "thirdbody check scene.toml" in command("new").out
    short = ("--set", "debris.0.count=8", "--set", "solver.distance=0.1 um", "--set", "solver.settle=1 us",
             "--set", "output.every=0.05 um")  # fmt: skip
    report = command("check", "scene.toml", *short)
    assert report.code == 0 and "time step" in report.out and "estimated" in report.out
    assert command("run", "scene.toml", *short).code == 0
    assert (tmp_path / "runs" / "scene" / "run.vtkhdf").is_file()
    report = command("states", "runs/scene")
    assert report.code == 0 and report.out.split()[:3] == ["frame", "time", "distance"]
    report = command("states", "runs/scene", "--frame", "-1")
    assert report.code == 0 and len(report.out.splitlines()) == 2 + 8


# JSON ---------------------------------------------------------------------------------------------------------------------


def strict(text: str):
    """JSON as other programs read it: without NaN and Infinity."""
    return json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))


def test_json_of_every_table(balls, command):
    balls()
    report = strict(command("check", "scene.toml", "--json").out)
    assert report["bodies"] == 4 and report["frames"] == 4 and report["scene"]["title"] == "four balls"
    assert report["time_step"]["step"] < report["time_step"]["rayleigh"]
    done = command("run", "scene.toml", "-o", "run", "--json", "-q")
    assert done.code == 0 and strict(done.out)["frames"] == report["frames"] and strict(done.out)["finished"] is True
    rows = strict(command("states", "run", "--json").out)["frames"]
    assert [row["frame"] for row in rows] == [0, 1, 2, 3]
    assert all(sum(row[name] for name in ("free", "sticking", "sliding", "rolling")) == 4 for row in rows)
    assert len(strict(command("states", "run", "--frame", "0", "--json").out)) == 4
    laws = strict(command("laws", "--json").out)
    assert {family["law"] for family in laws["families"]} >= {"hertz_mindlin", "three_spot"} and laws["failures"] == {}


def test_json_of_a_time_step_that_a_guard_stops(balls, command):
    """No wall time can be estimated then: null, not NaN."""
    balls(('settle = "1 us"', 'settle = "1 us"\ntime_step = "500 ns"'))
    assert strict(command("check", "scene.toml", "--force", "--json").out)["estimated_wall_time"] is None
    assert "nan" not in command("check", "scene.toml", "--force").out


def test_planned_frames_are_those_of_the_targets(balls, command, tmp_path):
    """`check` computes the number; for a run by distance or by time it must be what `targets` yields."""
    from thirdbody.assembly.simulation import build
    from thirdbody.runner.output_schedule import planned_frames, targets

    for changes in (
        [],
        [('settle = "1 us"', 'settle = "0 s"')],
        [('"0.05 um"', '"0.1 um"')],  # one interval, the longest that is allowed
        [('"0.05 um"', '"0.03 um"')],
        [('distance = "0.1 um"', 'duration = "1 us"')],
        [('distance = "0.1 um"', 'duration = "1 us"'), ('"0.05 um"', '"0.3 us"')],
        [('"0.05 um"', '"7 ns"')],
        [('"0.05 um"', '"1 ns"'), ('"1 us"', '"auto"')],
    ):
        built = build(thirdbody.Scene.load(balls(*changes)))
        assert planned_frames(built) == 1 + sum(write for _, _, write in targets(built))


# text ---------------------------------------------------------------------------------------------------------------------


def test_square_brackets_are_text(balls, command):
    balls(("four balls", "four [bold]balls[/bold] [/]"))
    report = command("check", "scene.toml")
    assert report.code == 0 and "four [bold]balls[/bold] [/]: 4 bodies" in report.out
    assert "[effects]" in command("laws").out


def test_progress_without_a_terminal_is_plain_lines(balls, command):
    balls()
    report = command("run", "scene.toml", "-o", "run")
    lines = [line for line in report.err.splitlines() if not line.startswith("warning:")]
    assert 3 <= len(lines) <= 11 and "\x1b" not in report.err and "\r" not in report.err
    assert lines[0].startswith("  0 %") and lines[-1].startswith("100 %")
    assert all(" t = " in line for line in lines)


def test_a_bar_on_a_terminal(balls, command, monkeypatch):
    """With a terminal a bar is drawn; a title with brackets does not disturb it."""
    balls(("four balls", "four [/] balls"))
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    report = command("run", "scene.toml", "-o", "run")
    assert report.code == 0 and "four [/] balls" in report.err and "100%" in report.err


# being stopped ------------------------------------------------------------------------------------------------------------


def hear_hangups() -> None:
    """In a child: SIGHUP as a terminal gives it, also where the tests run under nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_an_interrupted_run_keeps_its_frames(number, code, balls, tmp_path):
    """An hour's run, asked to end after its first progress lines."""
    balls(('"0.1 um"', '"1 mm"'), ('"0.05 um"', '"0.1 um"'))
    process = subprocess.Popen(
        [sys.executable, "-m", "thirdbody.cli.main", "run", "scene.toml", "-o", "run"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=hear_hangups,
    )  # fmt: skip
    assert process.stderr is not None
    for line in process.stderr:
        if "t = 0 s" in line:
            break
    wait_for_frames(tmp_path / "run", 4)
    before = (tmp_path / "run" / CHECKPOINT).read_bytes()
    process.send_signal(number)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == code
    assert (tmp_path / "run" / CHECKPOINT).read_bytes() != before
    assert "Traceback" not in err and err.splitlines()[-1].startswith("thirdbody: interrupted at t = ")
    assert "no: interrupted after" in out
    with thirdbody.open(tmp_path / "run") as run:
        assert run.frames >= 4 and len(run.times) == run.frames == len(run.series["time"])
        run.bodies(-1)
        report = run.summary()
        assert not report["finished"] and report["stopped"].startswith("interrupted") and report["frames"] == run.frames


def test_a_closed_terminal_ends_a_run_in_order(balls, tmp_path):
    """The bar is drawn on the terminal that goes away: writing there fails from then on, and the hangup may come twice."""
    balls(('"0.1 um"', '"1 mm"'), ('"0.05 um"', '"0.1 um"'))
    ours, theirs = os.openpty()

    def in_its_own_session() -> None:
        hear_hangups()
        os.setsid()
        fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)

    process = subprocess.Popen(
        [sys.executable, "-m", "thirdbody", "run", "scene.toml", "-o", "run"],
        cwd=tmp_path, stdin=theirs, stdout=theirs, stderr=theirs, preexec_fn=in_its_own_session,
    )  # fmt: skip
    os.close(theirs)
    wait_for_frames(tmp_path / "run", 4)
    before = (tmp_path / "run" / CHECKPOINT).read_bytes()
    os.close(ours)
    assert process.wait(timeout=PATIENCE) == 129
    assert (tmp_path / "run" / CHECKPOINT).read_bytes() != before
    with thirdbody.open(tmp_path / "run") as run:
        assert run.summary()["stopped"].startswith("interrupted")


def test_a_run_under_nohup_outlives_a_hangup(balls, tmp_path):
    balls(('"0.1 um"', '"1 mm"'), ('"0.05 um"', '"0.1 um"'))
    process = subprocess.Popen(
        ["nohup", sys.executable, "-m", "thirdbody", "run", "scene.toml", "-o", "run", "-q"],
        cwd=tmp_path, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    wait_for_frames(tmp_path / "run", 2)
    process.send_signal(signal.SIGHUP)
    with thirdbody.open(tmp_path / "run") as run:
        frames = run.frames
    wait_for_frames(tmp_path / "run", frames + 2)
    process.terminate()
    assert process.wait(timeout=PATIENCE) == 143


def test_a_killed_run_keeps_its_frames(balls, tmp_path):
    balls(('"0.1 um"', '"1 mm"'), ('"0.05 um"', '"0.1 um"'))
    process = subprocess.Popen(
        [sys.executable, "-m", "thirdbody.cli.main", "run", "scene.toml", "-o", "run", "-q"],
        cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    wait_for_frames(tmp_path / "run", 4)
    process.kill()
    process.wait()
    with thirdbody.open(tmp_path / "run") as run:
        assert run.frames >= 4 and not run.summary()["finished"]
        run.bodies(-1)
    done = python("-m", "thirdbody.cli.main", "states", "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def wait_for_frames(folder, count: int) -> None:
    """Until a run that is still going on has written some frames."""
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


def test_a_reader_that_goes_away_is_no_fault(balls, tmp_path):
    """`thirdbody laws | head -1`."""
    done = subprocess.run(
        f"{sys.executable} -m thirdbody.cli.main laws | head -1", shell=True, cwd=tmp_path, capture_output=True, text=True
    )
    assert "Traceback" not in done.stderr and "rror" not in done.stderr


def test_runs_that_are_empty_or_unlabelled(tmp_path, command):
    """A run killed before its first frame, and one without labels: told, not a crash."""
    import numpy as np

    from thirdbody.trajectory.writer import Frame, TrajectoryWriter

    header = {"scene_text": "", "state_names": ["unlabelled"], "reason_names": ["none"], "units": {}}
    static = {"spheres": {"radius": np.ones(1), "clump": np.zeros(1, int)}, "clumps": {"id": np.zeros(1, int)}}
    for name, frames in (("empty", 0), ("plain", 1)):
        (tmp_path / name).mkdir()
        with TrajectoryWriter(tmp_path / name / "run.vtkhdf", header, static) as writer:
            for _ in range(frames):
                point = {"points": np.zeros((1, 3))}
                series = {"time": 0.0, "distance": 0.0}
                writer.append(Frame(0.0, {**point}, {**point}, {"points": np.zeros((0, 3))}, None, series))
    report = command("states", "empty")
    assert report.code == 0 and "no frame" in report.out
    assert command("states", "empty", "--json").code == 0
    assert command("states", "empty", "--frame", "0").code == 3
    assert command("render", "empty", "-o", "x.png").code == 3
    for arguments in (["states", "plain"], ["states", "plain", "--frame", "0"], ["render", "plain", "-o", "x.png"]):
        report = command(*arguments)
        assert report.code == 3 and "state" in report.err and "Traceback" not in report.err, report
