"""Killed at any moment, a run reads to its last committed frame and ends with the bits of an undisturbed one; a sweep ends with
the same table; a run that is read while it is written is never called damaged. `-m full`: a hundred kills of runs, thirty of
sweeps."""

import csv
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from balls import BALLS, edited
from hard.killed_run import go_on
from portable import PATIENCE
from steel import SCENES
from trajectories import contents
import thirdbody
from thirdbody.errors import InputError
from thirdbody.runner.checkpoint import FILE, read_checkpoint
from thirdbody.runner.simulate import execute, prepare
from thirdbody.studies.results import TIMES

PROGRAM = Path(__file__).with_name("killed_run.py")
SCENE = SCENES / "sheared_debris.toml"
SHORT = {"output.every": "0.05 um"}
CASES = {
    "short": SHORT | {"debris.0.count": "8", "solver.distance": "0.2 um", "solver.settle": "1 us"},
    "explicit": SHORT | {"debris.0.count": "100", "solver.distance": "2 um"},
    "implicit": SHORT | {"debris.0.count": "1200", "solver.distance": "6 um", "contact.debris_contact": "none"},
    "implicit, bodies that meet": SHORT | {
        "debris.0.count": "400", "domain.size": '["350 um", "262 um"]', "solver.distance": "3 um",
        "solver.integrator": "implicit", "plates.upper.motion.x.velocity": "1 mm/s",
    },
    "wear": SHORT | {
        "debris.0.count": "100", "solver.distance": "4 um", "contact.debris_contact": "none", "solver.integrator": "implicit",
        "plates.wear": {"distance": "0.2 um", "times": 10}, "measures.cell": "2 um", "measures.wear": {"plates": "1e-17 m3/J"},
    },
}  # fmt: skip
"""Some five seconds of integration each, but for the first."""


def start(folder, settings, last=0):
    command = [sys.executable, str(PROGRAM), str(folder), str(SCENE), json.dumps(settings), str(last)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def report(child):
    message = child.communicate()[1].decode()
    assert child.returncode in (0, -signal.SIGKILL), message
    return child.returncode


def killed_at_random(folder, settings, rng):
    child = start(folder, settings)
    while child.poll() is None and not (folder / FILE).exists():
        time.sleep(0.01)
    try:
        child.wait(rng.uniform(0.0, 5.0))
    except subprocess.TimeoutExpired:
        child.send_signal(signal.SIGKILL)
    return report(child)


def opens(folder):
    try:
        with thirdbody.open(folder) as run:
            for frame in range(run.frames):
                assert len(run.bodies(frame)["state"]) and len(run.spheres(frame)["position"])
    except InputError:
        # killed before its first frame: then there is nothing to read, and the checkpoint says so
        assert not (folder / FILE).exists() or read_checkpoint(folder).frames == 0


def survives(tmp_path, case, kill, kills):
    settings, rng = CASES[case], random.Random(f"{case} {kill.__name__}")
    execute(prepare(thirdbody.Scene.load(SCENE).with_settings(settings)), tmp_path / "whole")
    wanted, done, round_ = contents(tmp_path / "whole"), 0, 0
    while done < kills:
        folder, code = tmp_path / f"cut{round_}", -1
        round_ += 1
        while code != 0 and done < kills:
            code = kill(folder, settings, rng)
            done += code != 0
            if folder.exists():
                opens(folder)
        if code != 0:
            go_on(folder, SCENE, settings)
        found = contents(folder)
        assert found.keys() == wanted.keys() and [name for name in wanted if found[name] != wanted[name]] == []


@pytest.mark.full(kind="hard")
@pytest.mark.parametrize("kill", [
    killed_at_random, lambda folder, settings, rng: report(start(folder, settings, rng.randint(1, 400))),
], ids=["at random", "between writes"])  # fmt: skip
@pytest.mark.parametrize("case", [name for name in CASES if name != "short"])
def test_twenty_kills(tmp_path, case, kill):
    survives(tmp_path, case, kill, 20)


def test_a_kill(tmp_path):
    # within the second frame of a short run: the first has some 20 calls
    survives(tmp_path, "short", lambda folder, settings, rng: report(start(folder, settings, rng.randint(25, 40))), 1)


@pytest.mark.full(kind="hard")
def test_a_run_that_is_being_written_is_never_damaged(tmp_path):
    """Two thousand frames, one every few milliseconds; before the first one there is no run, or none that can be read."""
    end = ('distance = "0.1 um"\nsettle = "1 us"', 'duration = "40 us"\nsettle = "20 ns"\nintegrator = "explicit"')
    (tmp_path / "scene.toml").write_text(edited(BALLS, end, ("0.05 um", "20 ns")))
    command = [sys.executable, "-m", "thirdbody", "run", "scene.toml", "-o", "run", "--quiet"]
    reads, begun = 0, False
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None:
            try:
                with thirdbody.open(tmp_path / "run") as run:
                    begun = begun or run.frames > 0
                    if run.frames:
                        assert run.states.shape[0] == len(run.times) == len(run.series["time"]) == run.frames
                        run.bodies(-1), run.contacts(-1), run.spheres(0), run.summary()
                    reads += 1
            except InputError as error:
                assert not begun and ("no such run" in str(error) or "not an HDF5 file" in str(error)), error
        assert process.returncode == 0
    assert reads >= 100


VARY = ["--vary", "pairs.0.friction=0.05:0.6:3", "--vary", "debris.0.count=3,4000", "--workers", "2", "-q"]
"""Half of the points fails: 4000 balls have no space in the domain."""
LONG = ["--set", "solver.distance=0.2 um"]


def start_sweep(folder, out):
    words = [out, "--resume", "-q"] if (folder / out / "sweep.json").exists() else ["balls.toml", *VARY, *LONG, "-o", out]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    return subprocess.Popen([sys.executable, "-m", "thirdbody", "sweep", *words], cwd=folder, start_new_session=True, **quiet)


def children(process):
    try:
        texts = [path.read_text() for path in Path(f"/proc/{process}/task").glob("*/children")]
    except OSError:
        return []
    return [int(word) for text in texts for word in text.split()]


def table(folder):
    rows = list(csv.DictReader((folder / "points.csv").open(encoding="utf-8")))
    return [{name: cell for name, cell in row.items() if name.partition(" ")[0] not in TIMES} for row in rows]


def finish(process):
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, errors.decode()


def kill_sweep(folder, out, which, rng):
    process, until = start_sweep(folder, out), time.monotonic() + PATIENCE
    while process.poll() is None and not children(process.pid) and time.monotonic() < until:
        time.sleep(0.02)
    time.sleep(rng.uniform(0.0, 2.0))
    victims = [process.pid] if which == "main" else children(process.pid)
    if process.poll() is not None or not victims:
        process.communicate()
        return False
    os.kill(rng.choice(victims), signal.SIGKILL)
    process.communicate(timeout=PATIENCE) if which == "main" else finish(process)
    return True


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kills")
    (folder / "balls.toml").write_text(BALLS, encoding="utf-8")
    finish(start_sweep(folder, "whole"))
    return folder


@pytest.mark.full(kind="hard")
def test_thirty_kills_of_a_sweep(whole):
    """Main processes and workers in turn, up to two main processes of one sweep."""
    rng, kills = random.Random(1), 0
    for turn in range(120):
        out = f"killed_{turn}"
        for _ in range(rng.choice([1, 2]) if turn % 2 == 0 else 1):
            kills += kill_sweep(whole, out, ("main", "worker")[turn % 2], rng)
        finish(start_sweep(whole, out))
        assert table(whole / out) == table(whole / "whole"), out
        if kills >= 30:
            return
    raise AssertionError(f"only {kills} kills came before the end of a sweep")


@pytest.mark.full(kind="hard")
def test_ctrl_c_keeps_what_is_done_and_a_kill_too(whole):
    """The terminal sends SIGINT to all processes of its group; workers, in sessions of their own, get none."""
    process = start_sweep(whole, "stopped")
    while process.poll() is None and not any((whole / "stopped" / "points").glob("*/run.vtkhdf")):
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130 and b"points are done; to go on: thirdbody sweep stopped --resume" in errors, errors
    assert {row["status"] for row in table(whole / "stopped")} & {"waiting", "interrupted"}
    kill_sweep(whole, "stopped", "main", random.Random(0))
    finish(start_sweep(whole, "stopped"))
    assert table(whole / "stopped") == table(whole / "whole")
    assert [row["status"] for row in table(whole / "whole")] == 3 * ["done", "failed"]
