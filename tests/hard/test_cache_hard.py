"""The whole cache of compiled code damaged, under the program as a user starts it."""

import os
import random
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import thirdbody

pytestmark = pytest.mark.full(kind="hard")
SCENE = Path(__file__).parents[2] / "scenes" / "sheared_debris.toml"
SHORT = ("debris.0.count=8", "solver.distance=0.02 um", "output.every=0.02 um", "solver.settle=1 us")
WRITTEN = (".nbi", ".nbc", ".py")
"""Endings of the files of compiled code and of generated modules."""


def start(command, cache, *arguments):
    settings = [word for setting in SHORT for word in ("--set", setting)]
    environment = os.environ | {"THIRDBODY_CACHE": str(cache)}
    line = [sys.executable, "-m", "thirdbody", command, str(SCENE), *settings, *arguments]
    return subprocess.run(line, env=environment, capture_output=True, text=True, timeout=600)


def files(cache):
    return sorted(path for path in cache.rglob("*") if path.suffix in WRITTEN and path.is_file())


def damage(path, way):
    content = path.read_bytes()
    altered = bytes(byte ^ 0x5A if k % 500 == 0 else byte for k, byte in enumerate(content))
    written = {"half": content[: len(content) // 2], "empty": b"", "junk": random.Random(1).randbytes(5000), "altered": altered}
    if way in written:
        path.write_bytes(written[way])
    elif way == "closed":
        path.chmod(0)
    else:
        path.unlink()
        if way == "folder":
            path.mkdir()


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A cache with all that a run needs, and what that run wrote as a table."""
    home = tmp_path_factory.mktemp("compiled")
    done = start("run", home / "cache", "-o", str(home / "run"), "--threads", "1", "-q")
    assert done.returncode == 0, done.stderr
    return home / "cache", final_state(home / "run")


def final_state(run):

    with thirdbody.open(run) as opened:
        return b"".join(array.tobytes() for _, array in sorted(opened.bodies(-1).items()))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_damaged_cache_is_rebuilt_in_silence(seed, compiled, tmp_path):
    """Each file in one of seven ways, at random; the run gives the same bits, and the next one finds all compiled again."""
    cache = Path(shutil.copytree(compiled[0], tmp_path / "cache"))
    choice, damaged = random.Random(seed), files(cache)
    assert len(damaged) > 20
    for path in damaged:
        damage(path, choice.choice(("half", "empty", "junk", "gone", "closed", "folder", "altered")))
    done = start("run", cache, "-o", str(tmp_path / "run"), "--threads", "1", "-q")
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    assert final_state(tmp_path / "run") == compiled[1]
    before = {path: path.stat().st_mtime_ns for path in files(cache)}
    assert start("check", cache).returncode == 0
    assert {path: path.stat().st_mtime_ns for path in files(cache)} == before
