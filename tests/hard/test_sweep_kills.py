"""A sweep whose processes are killed at random moments, main process or workers: resumed, it ends with the same table.

`pytest -m hard tests/hard/test_sweep_kills.py`: thirty kills; one of a main process runs always.
"""

from __future__ import annotations

import csv
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from balls import BALLS

from thirdbody.studies.sweep.results import TIMES

COMMAND = [sys.executable, "-m", "thirdbody", "sweep"]
VARY = ["--vary", "pairs.0.friction=0.05:0.6:3", "--vary", "debris.0.count=3,4000", "--workers", "2", "-q"]
"""Half of the points fails: 4000 balls have no space in the domain."""

LONG = ["--set", "solver.distance=0.2 um"]

PATIENCE = 300.0
"""Time [s] for a sweep that is not killed, on a busy machine too."""


def start(folder: Path, *words: str) -> subprocess.Popen:
    return subprocess.Popen(
        [*COMMAND, *words], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    )


def first(folder: Path, out: str) -> list[str]:
    """Arguments that start the sweep, or go on with it."""
    return [out, "--resume", "-q"] if (folder / out / "sweep.json").exists() else ["balls.toml", *VARY, *LONG, "-o", out]


def children(process: int) -> list[int]:
    """The child processes of a process, started by any of its threads."""
    try:
        texts = [path.read_text() for path in Path(f"/proc/{process}/task").glob("*/children")]
    except OSError:
        return []
    return [int(word) for text in texts for word in text.split()]


def table(folder: Path) -> list[dict[str, str]]:
    rows = list(csv.DictReader((folder / "points.csv").open(encoding="utf-8")))
    return [{name: cell for name, cell in row.items() if name.partition(" ")[0] not in TIMES} for row in rows]


def finish(folder: Path, out: str) -> None:
    process = start(folder, *first(folder, out))
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, errors.decode()


def kill(folder: Path, out: str, which: str, rng: random.Random) -> bool:
    """Start or resume the sweep, and kill the main process or one worker some time after points run."""
    process = start(folder, *first(folder, out))
    until = time.monotonic() + PATIENCE
    while process.poll() is None and not children(process.pid) and time.monotonic() < until:
        time.sleep(0.02)
    time.sleep(rng.uniform(0.0, 2.0))
    victims = [process.pid] if which == "main" else children(process.pid)
    if process.poll() is not None or not victims:
        process.communicate()
        return False
    os.kill(rng.choice(victims), signal.SIGKILL)
    if which == "main":
        process.communicate(timeout=PATIENCE)
    else:
        _, errors = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, errors.decode()
    return True


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the scene and a sweep that nobody disturbed."""
    folder = tmp_path_factory.mktemp("kills")
    (folder / "balls.toml").write_text(BALLS, encoding="utf-8")
    finish(folder, "whole")
    return folder


def kill_until(folder: Path, number: int, seed: int) -> None:
    """Kill that many times, main processes and workers in turn, up to two main processes of one sweep."""
    rng, kills = random.Random(seed), 0
    for turn in range(4 * number):
        out = f"killed_{seed}_{turn}"
        for _ in range(rng.choice([1, 2]) if turn % 2 == 0 else 1):
            kills += kill(folder, out, ("main", "worker")[turn % 2], rng)
        finish(folder, out)
        assert table(folder / out) == table(folder / "whole"), out
        if kills >= number:
            return
    raise AssertionError(f"only {kills} kills came before the end of a sweep")


def test_a_kill(whole):
    kill_until(whole, 1, 0)
    assert [row["status"] for row in table(whole / "whole")] == 3 * ["done", "failed"]


@pytest.mark.full(kind="hard")
def test_thirty_kills(whole):
    kill_until(whole, 30, 1)


def test_ctrl_c_keeps_what_is_done(whole):
    """The terminal sends SIGINT to all processes of its group; workers, in sessions of their own, get none."""
    process = start(whole, *first(whole, "stopped"))
    points = whole / "stopped" / "points"
    while process.poll() is None and not any(points.glob("*/run.vtkhdf")):
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130 and b"points are done; to go on: thirdbody sweep stopped --resume" in errors, errors
    assert {row["status"] for row in table(whole / "stopped")} & {"waiting", "interrupted"}
    finish(whole, "stopped")
    assert table(whole / "stopped") == table(whole / "whole")
