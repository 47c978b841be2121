"""Files and folders of runs spoilt at random: every one is read, or refused in one message that names it, with the exit code of
the contract; no crash, no hang, nothing written or half-written, and a run that is refused stays as it was."""

import io
import json
import os
import select
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from random import Random

import numpy as np
import pytest
import trimesh
from balls import BALLS as FOUR_BALLS
from balls import PLATES, edited
from hard import file_mutants as M
from portable import PATIENCE
from steel import STEEL
import thirdbody
from thirdbody.errors import Interrupted
from thirdbody.runner.simulate import execute, prepare

BATCH, MANY = 12, int(os.environ.get("FUZZ_FILES", "300"))
DEBRIS = '[[debris]]\nmaterial = "steel"\n{debris}\n[domain]\nsize = ["80 um", "60 um"]\n'
END = '[solver]\n{end} = "{length}"\nsettle = "20 ns"\n[output]\nevery = "{every}"\n'
BALLS = 'kind = "spheres"\nradius = "5 um"\ncount = 3'
MOVING = 'motion = {x = {velocity = "0.5 m/s"}}'
CSV = b"clump,x [um],y [um],z [um],radius [um]\n0,10,10,5,5\n0,14,10,4,4\n7,40,30,5,5\n7,40,35,4,4\n"
TABLE = b"time (us), displacement (um)\n0, 0\n1, 0.5\n2, 0.5\n3, -0.25\n"
MESH = trimesh.creation.icosphere(subdivisions=1, radius=5.0)
MESHES = {kind: MESH.export(file_type=kind) for kind in ("stl", "stl_ascii", "ply", "obj")}
BALANCE = (Path(__file__).parents[2] / "scenes" / "balance" / "three_spot.toml").read_bytes()
SECONDS = 30.0  # of the processor


class Worker:
    """Runs `file_mutants.py` in a folder that shows whether anything was written."""

    def __init__(self, folder: Path):
        self.command = [sys.executable, "-W", "ignore", str(Path(__file__).with_name("file_mutants.py"))]
        self.folder, self.process = folder, None

    def request(self, line: str) -> tuple:
        """The answer to a line and what was said; "crash" or "hang" where there was none."""
        if self.process is None:
            quiet = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
            self.process = subprocess.Popen(self.command, cwd=self.folder, text=True, **quiet)
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE)
        answer = self.process.stdout.readline() if ready else ""
        if answer:
            report, text, seconds = json.loads(answer)
            return (report, text) if seconds < SECONDS else ("hang", f"{seconds:.0f} s")
        self.close()
        return ("crash", "the worker died") if ready else ("hang", f"more than {PATIENCE:g} s")

    def close(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None
        assert not list(self.folder.iterdir())


def scene(debris=BALLS, motion=MOVING, end="duration", length="2 us", every="0.5 us"):
    end = END.format(end=end, length=length, every=every)
    return STEEL + DEBRIS.format(debris=debris) + edited(PLATES, (MOVING, motion)) + end


@pytest.fixture
def worker(tmp_path):
    (tmp_path / "cwd").mkdir()
    made = Worker(tmp_path / "cwd")
    yield made
    made.close()


@pytest.fixture(scope="module")
def run_bytes(tmp_path_factory):
    given = thirdbody.Scene.parse(scene(end="distance", length="0.04 um", every="0.01 um"))
    with thirdbody.run(given, out=tmp_path_factory.mktemp("sound") / "run", progress=False) as run:
        assert run.frames >= 5 and run.has_states
    return run.path.read_bytes()


def npz():
    out = io.BytesIO()
    center = np.array([[10, 10, 5], [14, 10, 4], [40, 30, 5], [40, 35, 4]]) * 1e-6
    np.savez(out, center=center, radius=np.array([5, 4, 5, 4]) * 1e-6, clump=np.array([0, 0, 7, 7]))
    return out.getvalue()


def spoilt_source(folder, number, rng):
    kind = rng.choice(("npz", "npz", "csv", "stl", "stl_ascii", "ply", "obj", "table", "balance"))
    data = {"npz": npz(), "csv": CSV, "table": TABLE, "balance": BALANCE}.get(kind) or MESHES[kind]
    data = data if isinstance(data, bytes) else data.encode()
    if kind == "npz" and rng.random() < 0.6:
        data = M.bomb(rng) if rng.random() < 0.25 else M.hostile_npz(data, rng)
    else:
        data = rng.choice((M.cut, M.flip, M.flip))(data, rng)
    name = f"{number}.{ {'stl_ascii': 'stl', 'table': 'csv'}.get(kind, kind) }"
    (folder / name).write_bytes(data)
    if kind == "balance":
        return folder / name
    debris, motion = BALLS, MOVING
    if kind == "table":
        motion = f'motion = {{x = {{table = "{name}"}}}}'
    elif kind in ("npz", "csv"):
        debris = f'kind = "file"\nfile = "{name}"'
    else:
        debris = f'kind = "mesh"\nfile = "{name}"\nunit = "1 um"\nspheres = 4\ncount = 1'
    path = folder / f"{number}.toml"
    path.write_text(scene(debris, motion), encoding="utf-8")
    return path


def names(text, path):
    return all(str(path) in line and line.isprintable() for line in text.splitlines())


@pytest.mark.parametrize("count", [BATCH, pytest.param(MANY, marks=pytest.mark.full(kind="fuzz"))])
def test_spoilt_files_are_refused(worker, tmp_path, run_bytes, count):
    sound = {"a.vtkhdf": run_bytes, "a.balance": BALANCE, "a.toml": scene('kind = "file"\nfile = "a.npz"').encode()}
    for name, content in {"a.npz": npz(), **sound}.items():
        (tmp_path / name).write_bytes(content)
    for name in sound:  # else the worker might refuse everything
        assert worker.request(tmp_path / name) == ("accepted", "")
    report, bugs = Counter(), []
    for number in range(count):
        rng = Random(number)
        if number % 2:
            path = tmp_path / f"{number}.vtkhdf"
            kind = rng.choice(("cut", "flip", "flip", "tree", "tree", "tree", "tree"))
            path.write_bytes(run_bytes if kind == "tree" else M.cut(run_bytes, rng) if kind == "cut" else M.flip(run_bytes, rng))
            if kind == "tree":
                M.spoil_tree(path, rng)
        else:
            path = spoilt_source(tmp_path, number, rng)
        kind, text = worker.request(path)
        report[kind] += 1
        if kind not in ("accepted", "refused") or (kind == "refused" and not names(text, path)):
            bugs.append(f"{number} {path.suffix} {kind}: {text[-1500:]}")
        for file in tmp_path.glob(f"{number}.*"):
            file.unlink()
    assert not bugs, f"{len(bugs)} of {dict(report)}\n" + "\n".join(bugs[:20])
    assert report["refused"] > count // 3  # else the mutations are too tame to mean anything


FEW_RUNS, MANY_RUNS = 4, int(os.environ.get("FUZZ_RUNS", "150"))
CODES = {0, 2, 3, 4, 5}  # done, usage, input, guard, output; anything else is no answer to a spoilt file
RUN = edited(
    FOUR_BALLS, ("count = 4", "count = 3"), ('"0.1 um"\nsettle = "1 us"', '"0.06 um"\nsettle = "20 ns"'), ("0.05 um", "0.01 um")
)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder, frames = tmp_path_factory.mktemp("sound") / "run", [0]
    with pytest.raises(Interrupted):
        told = {"report": lambda progress: frames.append(progress.frame), "stop": lambda: frames[-1] > 3}
        execute(prepare(thirdbody.Scene.parse(RUN).with_settings({"contact.debris_contact": "none"})), folder, **told)
    with thirdbody.open(folder) as run:
        assert run.frames > 2 and run.has_states
    return folder


def draws():
    from thirdbody.render.elsewhere import LIBRARIES, _loads

    return not sys.platform.startswith("linux") or any(_loads(name) for names in LIBRARIES.values() for name in names)


def asked(worker, *words):
    return worker.request(json.dumps([str(word) for word in words]))


@pytest.fixture(scope="module")
def commands(tmp_path_factory, sound):
    home, made = tmp_path_factory.mktemp("first"), Worker(tmp_path_factory.mktemp("cwd"))
    asked(made, shutil.copytree(sound, home / "run"), home, "resume")
    yield made
    made.close()


def requested(kind, rng):
    if kind != M.TRAJECTORY:
        return ["resume"]
    drawn = [name for name in M.COMMANDS if name.startswith("render") and "page" not in name] if draws() else []
    found = rng.sample([name for name in M.COMMANDS if name not in drawn and name != "resume"], 3)
    return [*found, *(rng.sample(drawn, 1) if drawn and rng.random() < 0.3 else ()), "resume"]


def bytes_of(folder):
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in sorted(folder.rglob("*"))}


def faults_of(worker, folder, target, command):
    before = bytes_of(folder)
    target.mkdir()
    code, text = asked(worker, folder, target, command)
    after, wrong = bytes_of(folder), []
    if code not in CODES:
        wrong.append(f"ended with {code}: {text[-1500:]}")
    lines = text.splitlines()
    # what differs from the scene or the laws is told line by line below the folder's name
    places = lines[:1] if lines and "cannot go on" in lines[0] else lines
    if code in (2, 3, 5) and not (lines and all(map(str.isprintable, lines)) and all(str(folder) in line for line in places)):
        wrong.append(f"told without its place: {text[:1500]}")
    if (command != "resume" or code in (2, 3)) and after != before:
        changed = [name for name in before.keys() | after.keys() if before.get(name, 0) != after.get(name, 0)]
        wrong.append(f"refused ({text[:300]}), but changed {changed}")
    if command == "resume" and code in (0, 4):
        try:
            thirdbody.open(folder).close()
        except Exception as error:
            wrong.append(f"left no sound run: {error}")
    here = sorted(path.name for path in target.iterdir())
    if (code and here) or any(name.startswith(".") or name.endswith(".part") for name in here):
        wrong.append(f"left {here}")
    if any(".part" in name for name in after.keys() - before.keys()):
        wrong.append(f"left {sorted(after.keys() - before.keys())}")
    shutil.rmtree(target)
    return code, [f"{command}: {line}" for line in wrong]


@pytest.mark.full(kind="fuzz")
@pytest.mark.parametrize("count", [FEW_RUNS, MANY_RUNS])
def test_spoilt_runs_are_reported(commands, sound, tmp_path, count):
    report, bugs = Counter(), []
    for number in range(count):
        rng = Random(number)
        folder = shutil.copytree(sound, tmp_path / str(number))
        try:
            kind = M.spoil_folder(folder, rng)
        except (OSError, RuntimeError, KeyError):  # HDF5 refuses what a mutation asks of it
            shutil.rmtree(folder)
            continue
        for command in requested(kind, rng):
            code, wrong = faults_of(commands, folder, tmp_path / "out", command)
            report[code] += 1
            bugs += [f"{number} {kind} {line}" for line in wrong]
        shutil.rmtree(folder)
    assert not bugs, f"{len(bugs)} of {dict(report)}\n" + "\n".join(bugs[:25])
    assert report[3] > count // 3  # else the mutations are too tame to mean anything
