"""Files spoilt at random: every one is read, or refused in one message that names it; no crash, no hang, nothing written."""

from __future__ import annotations

import importlib.util
import io
import json
import os
import select
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from random import Random
from types import ModuleType

import numpy as np
import pytest
import trimesh
from portable import PATIENCE
from steel import STEEL

import thirdbody

HERE = Path(__file__).parent
SECONDS = 30.0  # of the processor
BATCH = 30  # of CI
MANY = int(os.environ.get("FUZZ_FILES", "1000"))

SCENE = (
    STEEL
    + """\
[[debris]]
material = "steel"
{debris}
[domain]
size = ["80 um", "60 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
damping = "7e-5 kg/s"
{motion}
[solver]
{end} = "{length}"
settle = "20 ns"
[output]
every = "{every}"
"""
)
BALLS = 'kind = "spheres"\nradius = "5 um"\ncount = 3'
MOVING = 'motion = {x = {velocity = "0.5 m/s"}}'


def loaded(name: str) -> ModuleType:
    """A module of this folder, which is no package."""
    spec = importlib.util.spec_from_file_location(f"thirdbody_test_{name}", HERE / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


M = loaded("file_mutants")


class Worker:
    """The reading process, started again after it died."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.process: subprocess.Popen[str] | None = None

    def request(self, path: Path) -> tuple[str, str]:
        """What became of the file: accepted, refused, bug, crash or hang; and what was said."""
        if self.process is None:
            command = [sys.executable, "-W", "ignore", str(HERE / "file_mutants.py")]
            quiet = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
            self.process = subprocess.Popen(command, cwd=self.folder, text=True, **quiet)  # type: ignore[call-overload]
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(f"{path}\n")
        self.process.stdin.flush()
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE)
        line = self.process.stdout.readline() if ready else ""
        if line:
            kind, text, seconds = json.loads(line)
            return (kind, text) if seconds < SECONDS else ("hang", f"{seconds:.0f} s")
        self.close()
        return ("crash", "the reader died") if ready else ("hang", f"more than {PATIENCE:g} s")

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None


@pytest.fixture
def worker(tmp_path: Path) -> Iterator[Worker]:
    """A worker whose folder shows whether anything was written."""
    folder = tmp_path / "cwd"
    folder.mkdir()
    made = Worker(folder)
    yield made
    made.close()
    assert not list(folder.iterdir())


@pytest.fixture(scope="module")
def run_bytes(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A small run with states and contacts, five frames."""
    folder = tmp_path_factory.mktemp("sound")
    text = SCENE.format(debris=BALLS, motion=MOVING, end="distance", length="0.04 um", every="0.01 um")
    run = thirdbody.run(thirdbody.Scene.parse(text), out=folder / "run", progress=False)
    assert run.frames >= 5 and run.has_states
    run.close()
    return run.path.read_bytes()


def npz() -> bytes:
    """Two bodies of two spheres."""
    out = io.BytesIO()
    center = np.array([[10, 10, 5], [14, 10, 4], [40, 30, 5], [40, 35, 4]]) * 1e-6
    np.savez(out, center=center, radius=np.array([5, 4, 5, 4]) * 1e-6, clump=np.array([0, 0, 7, 7]))
    return out.getvalue()


CSV = b"clump,x [um],y [um],z [um],radius [um]\n0,10,10,5,5\n0,14,10,4,4\n7,40,30,5,5\n7,40,35,4,4\n"
TABLE = b"time (us), displacement (um)\n0, 0\n1, 0.5\n2, 0.5\n3, -0.25\n"
MESH = trimesh.creation.icosphere(subdivisions=1, radius=5.0)
MESHES = {kind: MESH.export(file_type=kind) for kind in ("stl", "stl_ascii", "ply", "obj")}
BALANCE = (HERE.parents[1] / "scenes" / "balance" / "three_spot.toml").read_bytes()


def spoilt_run(path: Path, sound: bytes, rng: Random) -> None:
    """A spoilt run in the file."""
    kind = rng.choice(("cut", "flip", "flip", "tree", "tree", "tree", "tree"))
    path.write_bytes(sound if kind == "tree" else M.cut(sound, rng) if kind == "cut" else M.flip(sound, rng))
    if kind == "tree":
        M.spoil_tree(path, rng)


def spoilt_source(folder: Path, number: int, rng: Random) -> Path:
    """A spoilt table, mesh, path or balance file, and the scene that names it."""
    kind = rng.choice(("npz", "npz", "csv", "stl", "stl_ascii", "ply", "obj", "table", "balance"))
    data = {"npz": npz(), "csv": CSV, "table": TABLE, "balance": BALANCE}.get(kind) or MESHES[kind]
    data = data if isinstance(data, bytes) else data.encode()
    if kind == "npz" and rng.random() < 0.6:
        data = M.bomb(rng) if rng.random() < 0.25 else M.hostile_npz(data, rng)
    else:
        data = rng.choice((M.cut, M.flip, M.flip))(data, rng)
    if kind == "balance":
        path = folder / f"{number}.balance"
        path.write_bytes(data)
        return path
    name = f"{number}.{ {'stl_ascii': 'stl', 'table': 'csv'}.get(kind, kind) }"
    (folder / name).write_bytes(data)
    debris, motion = BALLS, MOVING
    if kind == "table":
        motion = f'motion = {{x = {{table = "{name}"}}}}'
    elif kind in ("npz", "csv"):
        debris = f'kind = "file"\nfile = "{name}"'
    else:
        debris = f'kind = "mesh"\nfile = "{name}"\nunit = "1 um"\nspheres = 4\ncount = 1'
    path = folder / f"{number}.toml"
    path.write_text(SCENE.format(debris=debris, motion=motion, end="duration", length="2 us", every="0.5 us"), encoding="utf-8")
    return path


def fuzz(worker: Worker, tmp_path: Path, sound: bytes, numbers: range) -> Counter[str]:
    """Every spoilt file is read or refused by its name; returns how often."""
    report: Counter[str] = Counter()
    bugs = []
    for number in numbers:
        rng = Random(number)
        if number % 2:
            path = tmp_path / f"{number}.vtkhdf"
            spoilt_run(path, sound, rng)
        else:
            path = spoilt_source(tmp_path, number, rng)
        kind, text = worker.request(path)
        report[kind] += 1
        if kind not in ("accepted", "refused") or (kind == "refused" and not names(text, path)):
            bugs.append(f"{number} {path.suffix} {kind}: {text[-1500:]}")
        for file in tmp_path.glob(f"{number}.*"):
            file.unlink()
    assert not bugs, f"{len(bugs)} of {dict(report)}\n" + "\n".join(bugs[:20])
    return report


def names(text: str, path: Path) -> bool:
    """Whether every line names the file, or the key of the scene that does."""
    return all(str(path) in line and line.isprintable() for line in text.splitlines())


def test_spoilt_files_are_refused(worker: Worker, tmp_path: Path, run_bytes: bytes) -> None:
    report = fuzz(worker, tmp_path, run_bytes, range(BATCH))
    assert report["refused"] > BATCH // 3  # else the mutations are too tame to mean anything


@pytest.mark.full(kind="fuzz")
def test_a_thousand_spoilt_files_are_refused(worker: Worker, tmp_path: Path, run_bytes: bytes) -> None:
    report = fuzz(worker, tmp_path, run_bytes, range(MANY))
    print(dict(report))
    assert report["refused"] > MANY // 3


def test_sound_files_are_accepted(worker: Worker, tmp_path: Path, run_bytes: bytes) -> None:
    """Else the worker might refuse everything."""
    (tmp_path / "a.vtkhdf").write_bytes(run_bytes)
    (tmp_path / "a.npz").write_bytes(npz())
    (tmp_path / "a.balance").write_bytes(BALANCE)
    text = SCENE.format(debris='kind = "file"\nfile = "a.npz"', motion=MOVING, end="duration", length="2 us", every="0.5 us")
    (tmp_path / "a.toml").write_text(text)
    for name in ("a.vtkhdf", "a.balance", "a.toml"):
        assert worker.request(tmp_path / name) == ("accepted", "")
