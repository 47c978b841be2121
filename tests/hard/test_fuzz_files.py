"""Files spoilt at random: every one is read, or refused in one message that names it; no crash, no hang, nothing written."""

import io
import os
from collections import Counter
from pathlib import Path
from random import Random

import numpy as np
import pytest
import trimesh
from balls import PLATES, edited
from hard import file_mutants as M
from hard.worker import Worker
from steel import STEEL

import thirdbody

BATCH, MANY = 30, int(os.environ.get("FUZZ_FILES", "1000"))
DEBRIS = '[[debris]]\nmaterial = "steel"\n{debris}\n[domain]\nsize = ["80 um", "60 um"]\n'
END = '[solver]\n{end} = "{length}"\nsettle = "20 ns"\n[output]\nevery = "{every}"\n'
BALLS = 'kind = "spheres"\nradius = "5 um"\ncount = 3'
MOVING = 'motion = {x = {velocity = "0.5 m/s"}}'
CSV = b"clump,x [um],y [um],z [um],radius [um]\n0,10,10,5,5\n0,14,10,4,4\n7,40,30,5,5\n7,40,35,4,4\n"
TABLE = b"time (us), displacement (um)\n0, 0\n1, 0.5\n2, 0.5\n3, -0.25\n"
MESH = trimesh.creation.icosphere(subdivisions=1, radius=5.0)
MESHES = {kind: MESH.export(file_type=kind) for kind in ("stl", "stl_ascii", "ply", "obj")}
BALANCE = (Path(__file__).parents[2] / "scenes" / "balance" / "three_spot.toml").read_bytes()


def scene(debris=BALLS, motion=MOVING, end="duration", length="2 us", every="0.5 us"):
    return (
        STEEL + DEBRIS.format(debris=debris) + edited(PLATES, (MOVING, motion)) + END.format(end=end, length=length, every=every)
    )


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


def spoilt_run(path, sound, rng):
    kind = rng.choice(("cut", "flip", "flip", "tree", "tree", "tree", "tree"))
    path.write_bytes(sound if kind == "tree" else M.cut(sound, rng) if kind == "cut" else M.flip(sound, rng))
    if kind == "tree":
        M.spoil_tree(path, rng)


def spoilt_source(folder, number, rng):
    """A spoilt table, mesh, path or balance file, and the scene that names it."""
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
    """Whether every line names the file, or the key of the scene that does."""
    return all(str(path) in line and line.isprintable() for line in text.splitlines())


@pytest.mark.parametrize("count", [BATCH, pytest.param(MANY, marks=pytest.mark.full(kind="fuzz"))])
def test_spoilt_files_are_refused(worker, tmp_path, run_bytes, count):
    report, bugs = Counter(), []
    for number in range(count):
        rng = Random(number)
        if number % 2:
            path = tmp_path / f"{number}.vtkhdf"
            spoilt_run(path, run_bytes, rng)
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


def test_sound_files_are_accepted(worker, tmp_path, run_bytes):
    """Else the worker might refuse everything."""
    contents = {
        "a.vtkhdf": run_bytes,
        "a.npz": npz(),
        "a.balance": BALANCE,
        "a.toml": scene('kind = "file"\nfile = "a.npz"').encode(),
    }
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    for name in ("a.vtkhdf", "a.balance", "a.toml"):
        assert worker.request(tmp_path / name) == ("accepted", "")
