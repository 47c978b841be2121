"""Hostile tables, meshes, runs, checkpoints and scenes in little memory: each is told in plain lines with the right exit code.

The limits are those of `small_memory.py`: 2 GB of address space, of which numba, HDF5 and a sound scene need 1.6, and 20 s.
"""

from __future__ import annotations

import importlib.util
import io
import json
import os
import subprocess
import sys
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from types import ModuleType

import h5py
import numpy as np
import pytest

HERE = Path(__file__).parent
MANY, BATCH = int(os.environ.get("FUZZ_HOSTILE", "500")), 10
CODES = {0, 3, 4, 5}


def loaded(name: str) -> ModuleType:
    """A module of this folder, which is no package."""
    spec = importlib.util.spec_from_file_location(f"thirdbody_test_{name}", HERE / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


SCENES, FILES, RUNS, T, R = map(loaded, ("mutants", "file_mutants", "run_mutants", "test_fuzz_files", "test_fuzz_runs"))
sound = R.sound


class Worker:
    """The process that runs the commands."""

    def __init__(self) -> None:
        command = [sys.executable, "-W", "ignore", str(HERE / "small_memory.py")]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def request(self, *words: object) -> tuple[int, str]:
        """Exit code and standard error of a command."""
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(json.dumps([str(word) for word in words]) + "\n")
        self.process.stdin.flush()
        code, text = json.loads(self.process.stdout.readline())
        return code, text


@pytest.fixture(scope="module")
def compiled(sound: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> None:
    """What sound files need is compiled, which takes more time and memory than the limits allow."""
    folder = tmp_path_factory.mktemp("compiled")
    commands = [["check", str(scene_of(folder, T.BALLS))]]
    commands += [["resume", str(RUNS.copied(run, folder / kind)), "--quiet"] for kind, run in sound.items()]
    for words in commands:
        subprocess.run([sys.executable, "-m", "thirdbody", *words], check=True, stdout=subprocess.DEVNULL, cwd=folder)


@pytest.fixture
def worker(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, compiled: None) -> Iterator[Worker]:
    """A worker whose commands find what was compiled before."""
    monkeypatch.chdir(tmp_path)
    made = Worker()
    yield made
    made.process.kill()
    made.process.wait()


Case = tuple[list[str], Path]
"""The arguments of a command, and the file that its message names."""


def scene_of(folder: Path, debris: str) -> Path:
    path = folder / "scene.toml"
    path.write_text(T.SCENE.format(debris=debris, motion=T.MOVING, end="duration", length="2 us", every="0.5 us"))
    return path


def spoilt_source(folder: Path, rng: Random) -> Case:
    path = T.spoilt_source(folder, 1, rng)
    return (["balance", str(path)] if path.suffix == ".balance" else ["check", str(path)]), path


def large_table(folder: Path, rng: Random) -> Case:
    """Rows by the million in some kilobytes, one body or as many as rows."""
    rows, file = rng.choice((1_000_000, 1_100_000, 20_000_000)), io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, tail, dtype in (("center", (3,), "<f8"), ("radius", (), "<f8"), ("clump", (), rng.choice(("<i8", "|u1")))):
            header = io.BytesIO()
            np.lib.format.write_array_header_1_0(header, {"descr": dtype, "fortran_order": False, "shape": (rows, *tail)})
            size = rows * int(np.prod(tail, initial=1)) * np.dtype(dtype).itemsize
            archive.writestr(f"{name}.npy", header.getvalue() + bytes(size if rows < 10_000_000 else 64))
    (folder / "b.npz").write_bytes(file.getvalue())
    path = scene_of(folder, 'kind = "file"\nfile = "b.npz"')
    return ["check", str(path)], path


def spoilt_mesh(folder: Path, rng: Random) -> Case:
    """Surfaces whose headers and indices claim what is not there."""
    n = rng.choice((10**9, 2**31, 2**63, 10**12))
    head = f"ply\nformat %s 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\n"
    faces = f"element face {n}\nproperty list uint int vertex_indices\nend_header\n"
    vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    name, data = rng.choice(
        (
            ("m.ply", (head % "ascii" + faces).encode() + b"0 0 0\n" * 5),
            ("m.ply", (head % "binary_little_endian" + faces).encode() + bytes(rng.randrange(200))),
            ("m.ply", (head % "binary_little_endian").replace(str(n), "4").encode()
             + faces.replace(str(n), "1").encode() + bytes(48) + b"\xff\xff\xff\xff" + bytes(12)),
            ("m.stl", bytes(80) + (n % 2**32).to_bytes(4, "little") + bytes(50 * rng.randrange(4))),
            ("m.stl", b"solid a\n" + b"facet normal 0 0 1\nouter loop\nvertex 0 0 0\n" * 50_000 + b"endsolid\n"),
            ("m.obj", (vertices + f"f 1 2 {n}\nf 1 3 4\n").encode()),
            ("m.obj", (vertices + "f " + " ".join(str(1 + k % 4) for k in range(200_000)) + "\n").encode()),
            ("m.obj", (vertices + "".join(f"o {k}\nf 1 2 3\n" for k in range(20_000))).encode()),
            ("m.obj", (vertices + f"f 1 2 -{n}\n" + "l 1 2\n" * 100).encode()),
        )
    )  # fmt: skip
    (folder / name).write_bytes(data)
    path = scene_of(folder, f'kind = "mesh"\nfile = "{name}"\nunit = "1 um"\nspheres = 4\ncount = 1')
    return ["check", str(path)], path


def spoilt_scene(folder: Path, rng: Random) -> Case:
    path = folder / "scene.toml"
    path.write_bytes(SCENES.mutant(rng)[0])
    return ["check", str(path)], path


def large_scene(folder: Path, rng: Random) -> Case:
    """Tables, lists and texts by the ten thousand."""
    material = '[materials.m{}]\nyoungs_modulus = "1 GPa"\npoisson_ratio = 0.3\ndensity = "1 kg/m3"\n'
    ball = '[[debris]]\nkind = "spheres"\nmaterial = "steel"\nradius = "1 um"\ncount = {}\n'
    shape = '[[debris]]\nkind = "spheres"\nmaterial = "steel"\ncount = 1\nshape = [' + '{radius = "1 um"},' * 30_000 + "]\n"
    text = scene_of(folder, T.BALLS).read_text()
    more = rng.choice(
        (
            "".join(material.format(k) for k in range(40_000)),
            "".join(ball.format(1) for k in range(20_000)),
            ball.format(10**18),
            shape,
            '[[pairs]]\nbetween = ["steel", "steel"]\nfriction = 0.1\nrestitution = 0.5\n' * 20_000,
            "".join(f"a{k} = 1\n" for k in range(100_000)),
            "[" * 100_000,
            "a = " + "[" * 50_000 + "]" * 50_000,
            "a = [" + "{}, " * 300_000 + "]",
            "#" * 4_100_000,
        )
    )
    path = folder / "scene.toml"
    path.write_text(text + more)
    return ["check", str(path)], path


def spoilt_trajectory(folder: Path, rng: Random, run: Path) -> Case:
    path = folder / "run.vtkhdf"
    T.spoilt_run(path, (run / "run.vtkhdf").read_bytes(), rng)
    return ["states", str(path)], path


def large_trajectory(folder: Path, rng: Random, run: Path) -> Case:
    """Texts and arrays that claim gigabytes, packed by a thousand or not there at all, and links to a pipe."""
    path = folder / "run.vtkhdf"
    path.write_bytes((run / "run.vtkhdf").read_bytes())
    pipe = folder / "pipe"
    os.mkfifo(pipe)
    with h5py.File(path, "r+") as file:
        names = [f"scene/{name}" for name in file["scene"]]
        arrays = [f"VTKHDF/clumps/PointData/{name}" for name in file["VTKHDF/clumps/PointData"]]
        kind = rng.choice(("text", "text", "packed", "link", "outside", "soft"))
        name = rng.choice(arrays if kind == "packed" else names + arrays)
        if kind == "link":
            del file[name]
            file[name] = h5py.ExternalLink(str(pipe), "/x")
        elif kind == "soft":
            file["away"] = h5py.ExternalLink(str(pipe), "/")
            del file[name]
            file[name] = h5py.SoftLink("/away/x")
        elif kind == "outside":
            FILES._keep(file, name, lambda: file.create_dataset(name, (10,), "f8", external=[(str(pipe), 0, h5py.h5f.UNLIMITED)]))
        elif kind == "packed":
            shape, dtype = (200_000_000, *file[name].shape[1:]), file[name].dtype
            FILES._keep(file, name, lambda: file.create_dataset(name, shape, dtype, compression="gzip", chunks=True))
        else:
            claim = h5py.h5t.C_S1.copy()
            claim.set_size(rng.choice((10**8, 2 * 10**9)))
            scalar = h5py.h5s.create(h5py.h5s.SCALAR)
            FILES._keep(file, name, lambda: h5py.h5d.create(file.id, name.encode(), claim, scalar))
    return ["states", str(path)], path


def spoilt_folder(folder: Path, rng: Random, run: Path) -> Case:
    copy = RUNS.copied(run, folder / "run")
    RUNS.spoil_folder(copy, rng, FILES)
    return ["resume", str(copy), "--quiet", "--threads", "1"], copy


def claimed_checkpoint(folder: Path, rng: Random, run: Path) -> Case:
    """One array, or all, that claims gigabytes, is packed, or is there many times."""
    copy = RUNS.copied(run, folder / "run")
    path = copy / "checkpoint.npz"
    kind = rng.choice(("claim", "packed", "many"))
    with zipfile.ZipFile(path) as old:
        parts = {name: old.read(name) for name in old.namelist()}
    name = rng.choice(sorted(parts))
    header = io.BytesIO()
    shape = (10**9,) if kind == "claim" else (100_000_000,)
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
    parts[name] = header.getvalue() + bytes(64 if kind == "claim" else 8 * shape[0] if kind == "packed" else 0)
    with zipfile.ZipFile(path, "w") as new:
        for key, part in parts.items():
            new.writestr(key, part, zipfile.ZIP_DEFLATED if kind == "packed" and key == name else zipfile.ZIP_STORED)
        for k in range(20_000 if kind == "many" else 0):
            new.writestr(f"{k}.npy", b"")
    return ["resume", str(copy), "--quiet", "--threads", "1"], copy


ALONE: tuple[Callable[[Path, Random], Case], ...] = (
    spoilt_source, spoilt_source, large_table, spoilt_mesh, spoilt_scene, large_scene,
)  # fmt: skip
OF_RUNS: tuple[Callable[[Path, Random, Path], Case], ...] = (
    spoilt_trajectory, spoilt_trajectory, large_trajectory, spoilt_folder, claimed_checkpoint,
)  # fmt: skip
KINDS = len(ALONE) + len(OF_RUNS)


def hostile(number: int, folder: Path, runs: dict[str, Path]) -> tuple[str, Case]:
    """The kind of a hostile file, and what is to be done with it."""
    rng, kind = Random(number), number % KINDS
    if kind < len(ALONE):
        return ALONE[kind].__name__, ALONE[kind](folder, rng)
    make = OF_RUNS[kind - len(ALONE)]
    return make.__name__, make(folder, rng, runs[rng.choice(sorted(runs))])


def wrong(code: int, text: str, path: Path) -> str:
    """What is wrong with the answer to a hostile file, or nothing."""
    if code not in CODES:
        return f"ended with {code}"
    if "Traceback" in text or "bug in thirdbody" in text:
        return "a traceback"
    lines = text.splitlines()
    if code == 3 and not (lines and len(lines) <= 210 and str(path) in lines[0] and all(map(str.isprintable, lines))):
        return "not told in plain lines with its place"
    return ""


def fuzz(worker: Worker, runs: dict[str, Path], folder: Path, numbers: range) -> Counter[tuple[str, int]]:
    report: Counter[tuple[str, int]] = Counter()
    bugs = []
    for number in numbers:
        place = folder / str(number)
        place.mkdir()
        try:
            kind, (words, path) = hostile(number, place, runs)
        except (OSError, RuntimeError, KeyError):  # HDF5 refuses what a mutation asks of it
            continue
        code, text = worker.request(*words)
        report[kind, code] += 1
        if fault := wrong(code, text, path):
            bugs.append(f"{number} {kind}: {fault}: {text[-1200:]}")
    print(dict(report))
    assert not bugs, f"{len(bugs)} of {sum(report.values())}\n" + "\n".join(bugs[:15])
    return report


def test_hostile_files_are_reported_in_little_memory(worker: Worker, sound: dict[str, Path], tmp_path: Path) -> None:
    fuzz(worker, sound, tmp_path, range(BATCH))


@pytest.mark.full(kind="fuzz")
def test_five_hundred_hostile_files_are_reported_in_little_memory(worker: Worker, sound: dict[str, Path], tmp_path: Path) -> None:
    report = fuzz(worker, sound, tmp_path, range(MANY))
    assert sum(count for (_, code), count in report.items() if code == 3) > MANY // 2  # else they are too tame


def test_a_sound_scene_passes_in_little_memory(worker: Worker, tmp_path: Path) -> None:
    """Else everything might be refused for want of memory."""
    code, text = worker.request("check", scene_of(tmp_path, T.BALLS))
    assert code == 0, text
