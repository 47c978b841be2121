"""Killed at any moment, a run reads to its last committed frame, and taken up it ends with the bits of an undisturbed one.

`pytest -m hard tests/hard/test_kills.py`: fifty kills at random times and fifty between data, flush, commit, fsync and replace,
by either integrator; a few of them run always.
"""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import pytest

import thirdbody
from thirdbody.errors import InputError
from thirdbody.runner.checkpoint import FILE

PROGRAM = Path(__file__).with_name("killed_run.py")
SCENE = Path(__file__).parents[2] / "scenes" / "sheared_debris.toml"
SHORT = {"output.every": "0.05 um"}
CASES = {
    "explicit": SHORT | {"debris.0.count": "100", "solver.distance": "2 um"},
    "implicit": SHORT | {"debris.0.count": "1200", "solver.distance": "6 um", "contact.debris_contact": "none"},
    "implicit, bodies that meet": SHORT | {
        "debris.0.count": "400", "domain.size": '["350 um", "262 um"]', "solver.distance": "3 um",
        "solver.integrator": "implicit", "plates.upper.motion.x.velocity": "1 mm/s",
    },
}  # fmt: skip
"""Some five seconds of integration each."""


def start(folder: Path, settings: dict[str, str], last: int = 0) -> subprocess.Popen:
    command = [sys.executable, str(PROGRAM), str(folder), str(SCENE), json.dumps(settings), str(last)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def arrays(folder: Path) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    with h5py.File(folder / "run.vtkhdf") as file:
        file.visititems(
            lambda name, item: (
                found.update({name: item[()].tobytes()})
                if isinstance(item, h5py.Dataset) and not name.startswith("scene/")
                else None
            )
        )
    return found


def killed_at_random(folder: Path, settings: dict[str, str], rng: random.Random) -> int:
    """One process that is killed some time after it began to write; what it returned."""
    child = start(folder, settings)
    while child.poll() is None and not (folder / FILE).exists():
        time.sleep(0.01)
    try:
        child.wait(rng.uniform(0.0, 5.0))
    except subprocess.TimeoutExpired:
        child.send_signal(signal.SIGKILL)
    return report(child)


def killed_between(folder: Path, settings: dict[str, str], rng: random.Random) -> int:
    """One process that dies between two calls which touch the disk; what it returned."""
    return report(start(folder, settings, rng.randint(1, 400)))


def report(child: subprocess.Popen) -> int:
    message = child.communicate()[1].decode()
    assert child.returncode in (0, -signal.SIGKILL), message
    return child.returncode


def opens(folder: Path) -> None:
    """The trajectory of a killed run reads, every frame that was committed."""
    try:
        with thirdbody.open(folder) as run:
            for frame in range(run.frames):
                assert len(run.bodies(frame)["state"]) and len(run.spheres(frame)["position"])
    except InputError:
        # killed before its first frame: then there is nothing to read, and the checkpoint says so
        from thirdbody.runner.checkpoint import read_checkpoint

        assert not (folder / FILE).exists() or read_checkpoint(folder).frames == 0


def survives(tmp_path: Path, integrator: str, kill, kills: int) -> None:
    settings, rng = CASES[integrator], random.Random(f"{integrator} {kill.__name__}")
    whole = tmp_path / "whole"
    assert report(start(whole, settings)) == 0
    wanted, done, round_ = arrays(whole), 0, 0
    while done < kills:
        folder, code = tmp_path / f"cut{round_}", -1
        round_ += 1
        while code != 0:
            code = kill(folder, settings, rng) if done < kills else report(start(folder, settings))
            done += code != 0
            if folder.exists():
                opens(folder)
        found = arrays(folder)
        assert found.keys() == wanted.keys()
        assert [name for name in wanted if found[name] != wanted[name]] == []


@pytest.mark.full(kind="hard")
@pytest.mark.parametrize("kill", [killed_at_random, killed_between])
@pytest.mark.parametrize("integrator", CASES)
def test_fifty_kills(tmp_path, integrator, kill):
    survives(tmp_path, integrator, kill, 50)


def test_a_few_kills(tmp_path):
    survives(tmp_path, "explicit", killed_between, 3)
