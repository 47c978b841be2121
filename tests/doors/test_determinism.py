"""The same scene gives the same bits: on any number of threads, in every process, whatever is written when."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from steel import STEEL

import thirdbody
from thirdbody.assembly.simulation import build
from thirdbody.kernels.columns.sides import DEBRIS
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.explicit.step_loop import FEW
from thirdbody.kernels.rigid_body import BODIES

# Crowded, so that bodies collide; enough of them that the passes over contacts and bodies have several chunks.
SCENE = (
    STEEL
    + """\
[[debris]]
material = "steel"
kind = "irregular"
count = 1100
seed = 4
size = {distribution = "lognormal", median = "10 um", sigma = 0.2, min = "5 um", max = "20 um"}
spheres = [5, 8]
aspect = [1.0, 0.8, 0.6]
[domain]
size = ["490 um", "440 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
damping = "7e-5 kg/s"
motion = {x = {velocity = "1 m/s"}}
[solver]
distance = "1 um"
settle = "3 us"
[output]
every = "0.25 um"
"""
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("bits")
    (path / "scene.toml").write_text(SCENE, encoding="utf-8")
    return path


def simulate(folder: Path, name: str, threads: int, *more: str) -> Path:
    """A run in a process of its own, in which two threads are allowed even where there is one core."""
    command = [
        sys.executable,
        "-m",
        "thirdbody.cli.main",
        "run",
        "scene.toml",
        "-o",
        name,
        "-q",
        "--threads",
        str(threads),
        *more,
    ]
    environment = os.environ | {"NUMBA_NUM_THREADS": "2"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / name


def frame_bits(run: thirdbody.Run, frame: int) -> dict[str, bytes]:
    """A digest of every array of a frame, by block and name."""
    blocks = {
        "bodies": run.bodies(frame),
        "spheres": run.spheres(frame),
        "contacts": run.contacts(frame),
        "plates": run.plates(frame),
    }
    return {
        f"{block}.{name}": hashlib.sha256(np.ascontiguousarray(values).tobytes()).digest()
        for block, arrays in blocks.items()
        for name, values in arrays.items()
    }


def bits(path: Path) -> dict[str, object]:
    """Digests of all frames and all series of a run."""
    with thirdbody.open(path) as run:
        found: dict[str, object] = {f"frame {k}": frame_bits(run, k) for k in range(run.frames)}
        return found | {name: values.tobytes() for name, values in run.series.items()}


@pytest.fixture(scope="module")
def one_thread(folder) -> Path:
    return simulate(folder, "one", 1)


def test_the_scene_is_hard_enough(folder, one_thread):
    """Enough groups for the passes to be shared out, contacts between them, debris that collides: else the tests below would
    show nothing."""
    state = build(thirdbody.Scene.load(folder / "scene.toml")).state
    assert state.n_bodies > BODIES * GROUP * FEW
    assert len(state.slots.remote_body) > 10
    with thirdbody.open(one_thread) as run:
        assert sum(np.count_nonzero(run.contacts(k)["side"] == DEBRIS) for k in range(run.frames)) > 10
        assert run.summary()["searches"] > 1


def test_two_threads_give_the_bits_of_one(folder, one_thread):
    assert bits(simulate(folder, "two", 2)) == bits(one_thread)


def test_another_process_gives_the_same_bits(folder, one_thread):
    assert bits(simulate(folder, "again", 1)) == bits(one_thread)


def test_what_is_written_does_not_change_what_happens(folder, one_thread):
    """Four times as many frames and labels; the frames that both have agree in every array, and so do the totals."""
    often = simulate(folder, "often", 2, "--set", "output.every=62.5 nm")
    with thirdbody.open(one_thread) as few, thirdbody.open(often) as many:
        assert few.frames == 6 and many.frames == 18
        totals = [name for name in few.series if name.startswith("energy_") or name in ("time", "distance", "gap", "loaded")]
        for k in range(1, few.frames):
            other = 4 * k - 3
            assert few.times[k] == many.times[other]
            assert frame_bits(few, k) == frame_bits(many, other)
            assert all(few.series[name][k] == many.series[name][other] for name in totals)
