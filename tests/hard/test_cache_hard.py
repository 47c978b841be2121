"""The whole cache of compiled code damaged, or on a disk without room, under the program as a user starts it."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.full(kind="hard")

SCENE = Path(__file__).parents[2] / "scenes" / "sheared_debris.toml"
SHORT = ("debris.0.count=8", "solver.distance=0.02 um", "output.every=0.02 um", "solver.settle=1 us")
WRITTEN = (".nbi", ".nbc", ".py")
"""Endings of the files of compiled code and of generated modules."""


def start(command: str, cache: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    settings = [word for setting in SHORT for word in ("--set", setting)]
    environment = os.environ | {"THIRDBODY_CACHE": str(cache)}
    line = [sys.executable, "-m", "thirdbody", command, str(SCENE), *settings, *arguments]
    return subprocess.run(line, env=environment, capture_output=True, text=True, timeout=600)


def files(cache: Path) -> list[Path]:
    return sorted(path for path in cache.rglob("*") if path.suffix in WRITTEN and path.is_file())


def alter(path: Path) -> None:
    content = bytearray(path.read_bytes())
    for k in range(0, len(content), 500):
        content[k] ^= 0x5A
    path.write_bytes(content)


def replace_by_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


DAMAGE: tuple[Callable[[Path], object], ...] = (
    lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    lambda path: path.write_bytes(b""),
    lambda path: path.write_bytes(random.Random(1).randbytes(5000)),
    lambda path: path.unlink(),
    lambda path: path.chmod(0),
    replace_by_folder,
    alter,
)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory) -> tuple[Path, bytes]:
    """A cache with all that a run needs, and what that run wrote as a table."""
    home = tmp_path_factory.mktemp("compiled")
    done = start("run", home / "cache", "-o", str(home / "run"), "--threads", "1", "-q")
    assert done.returncode == 0, done.stderr
    return home / "cache", final_state(home / "run")


def final_state(run: Path) -> bytes:
    import thirdbody

    with thirdbody.open(run) as opened:
        return b"".join(array.tobytes() for _, array in sorted(opened.bodies(-1).items()))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_damaged_cache_is_rebuilt_in_silence(seed, compiled, tmp_path):
    """Each file in one of seven ways, at random; the run gives the same bits, and the next one finds all compiled again."""
    cache = Path(shutil.copytree(compiled[0], tmp_path / "cache"))
    choice, damaged = random.Random(seed), files(cache)
    assert len(damaged) > 20
    for path in damaged:
        choice.choice(DAMAGE)(path)
    done = start("run", cache, "-o", str(tmp_path / "run"), "--threads", "1", "-q")
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    assert final_state(tmp_path / "run") == compiled[1]
    before = {path: path.stat().st_mtime_ns for path in files(cache)}
    assert start("check", cache).returncode == 0
    assert {path: path.stat().st_mtime_ns for path in files(cache)} == before


@pytest.fixture
def mount(tmp_path) -> Iterator[Callable[[int], Path]]:
    """Mounts a file system of so many bytes; skips the test where none can be mounted."""
    folder = tmp_path / "small"
    folder.mkdir()

    def call(size: int) -> Path:
        line = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
        if not shutil.which("mount") or subprocess.run(line, capture_output=True).returncode:
            pytest.skip("no file system can be mounted here")
        return folder

    yield call
    if os.path.ismount(folder):
        subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize("room", [8192, 65_536, 400_000, 1_200_000])
def test_a_full_disk_under_the_cache_is_one_line(room, mount):
    small = mount(room)
    done = start("check", small / "cache")
    assert done.returncode == 5, done.stderr
    assert done.stderr.count("\n") == 1 and str(small) in done.stderr and "No space left" in done.stderr


@pytest.mark.skipif(shutil.which("setpriv") is None or not hasattr(os, "geteuid") or os.geteuid() != 0, reason="needs root")
def test_a_folder_that_another_user_has_planted_is_not_used(tmp_path):
    """The real thing: root without a usable home, and a folder of its name among temporary files that `nobody` has made."""
    with tempfile.TemporaryDirectory() as name:  # others cannot reach pytest's folders
        temporary = Path(name)
        temporary.chmod(0o1777)
        refuse_planted(temporary, tmp_path)


def refuse_planted(temporary: Path, tmp_path: Path) -> None:
    planted = temporary / "thirdbody-0"
    subprocess.run(["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", "mkdir", "-m", "777", planted], check=True)
    (tmp_path / "file").write_text("")
    environment = os.environ | {"HOME": str(tmp_path / "file"), "TMPDIR": str(temporary), "THIRDBODY_CACHE": "",
                                "XDG_CACHE_HOME": ""}  # fmt: skip
    place = "from thirdbody.jit import cache_dir as cache; print(cache.cache_folder())"
    done = subprocess.run([sys.executable, "-c", place], env=environment, capture_output=True, text=True, check=True)
    used = Path(done.stdout.strip())
    assert used.parent != planted and used.parent.parent == temporary
    assert list(temporary.iterdir()) == [planted] and list(planted.iterdir()) == []
