"""Runs in parts at the size that users cut: the bits of the whole, also after up to thirty kills of their processes.

`pytest -m hard tests/hard/test_kills_of_parts.py`: `kill -9` at random moments, of the run that joins the parts or of a part.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from ensembles import EXPLICIT, arrays, scene

import thirdbody
from thirdbody.runner.checkpoint import FILE

pytestmark = pytest.mark.full(kind="hard")

LARGE = {"debris.0.count": 2000, "debris.0.spheres": [3, 3], "domain.size": ["5 mm", "4 mm"]}
CASES = {"implicit": LARGE | {"solver.distance": "0.3 um", "output.every": "0.1 um"}, "explicit": EXPLICIT | LARGE}
LONGER = {
    "implicit": LARGE | {"solver.distance": "240 um", "output.every": "4 um"},
    "explicit": EXPLICIT
    | {"debris.0.count": 1100, "domain.size": ["4 mm", "3 mm"], "solver.distance": "240 um", "output.every": "5 um"},
}  # fmt: skip
"""Some ten seconds of a core."""

PAUSE = 6.0
"""Longest time between two kills [s]: a start takes two on an idle machine."""


@pytest.mark.parametrize("level", ["coulomb", "mindlin"])
@pytest.mark.parametrize("integrator", CASES)
def test_two_thousand_bodies_in_one_two_and_five_parts(integrator: str, level: str, tmp_path: Path) -> None:
    """Five parts of an explicit run are four: it is cut between groups of 512 bodies."""
    given = scene(**CASES[integrator] | {"contact.level": level})
    thirdbody.run(given, tmp_path / "whole", progress=False)
    for parts in (1, 2, 5):
        thirdbody.run(given, tmp_path / str(parts), progress=False, parts=parts)
        assert arrays(tmp_path / "whole") == arrays(tmp_path / str(parts))


def start(path: Path, folder: Path) -> subprocess.Popen[bytes]:
    """Start the run, or go on with it where it has a checkpoint."""
    wanted = ["resume", folder] if (folder / FILE).exists() else ["run", path, "-o", folder, "--overwrite", "--parts", "3"]
    command = [sys.executable, "-m", "thirdbody", *map(str, wanted), "-q"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def children(process: subprocess.Popen[bytes]) -> list[int]:
    try:
        return [int(pid) for pid in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]
    except OSError:
        return []


def kill_one(process: subprocess.Popen[bytes], rng: random.Random) -> None:
    """Kill the run that joins the parts, or one of them."""
    try:
        os.kill(rng.choice([process.pid, *children(process)]), signal.SIGKILL)
    except ProcessLookupError:
        pass


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="children are listed in /proc")
@pytest.mark.parametrize("integrator", LONGER)
def test_up_to_thirty_kills_change_no_bit(integrator: str, tmp_path: Path) -> None:
    """A run that gives up after three deaths without progress (exit code 5) is taken up too."""
    path, folder, rng = tmp_path / "scene.toml", tmp_path / "run", random.Random(integrator)
    given = scene(**LONGER[integrator])
    given.save(path)
    thirdbody.run(given, tmp_path / "whole", progress=False)
    kills, process = 0, start(path, folder)
    while True:
        end = time.monotonic() + (rng.uniform(0.0, PAUSE) if kills < int(os.environ.get("KILLS", "30")) else 600.0)
        while process.poll() is None and time.monotonic() < end:
            time.sleep(0.05)
        if process.poll() is None:
            kills += 1
            kill_one(process, rng)
            time.sleep(0.2)
            if process.poll() is None:
                continue
        message = process.communicate()[1].decode()
        assert process.returncode in (0, 5, -signal.SIGKILL), message
        if process.returncode == 0:
            break
        process = start(path, folder)
    whole, cut = arrays(tmp_path / "whole"), arrays(folder)
    for content in (whole, cut):
        content.pop("summary")  # of the last process: without a last interval where the one before it wrote the last frame
    print(f"{kills} kills")
    assert kills > 0 and whole == cut
    assert not (folder / "parts").exists()
