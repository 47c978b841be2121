"""The same scene gives the same bits: on any number of threads, in every process, whatever is written when."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from shared_runs import SHARED

import thirdbody
from thirdbody.assembly.simulation import build
from thirdbody.kernels.columns.sides import DEBRIS
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.explicit.step_loop import FEW
from thirdbody.kernels.rigid_body import BODIES

# Crowded, so that bodies collide; enough of them that the passes over contacts and bodies have several chunks.
SCENE = """\
scene = 1
materials.steel = {youngs_modulus = "210 GPa", poisson_ratio = 0.30, density = "7850 kg/m3"}
pairs = [{between = ["steel", "steel"], friction = 0.30, restitution = 0.60}]
domain = {size = ["490 um", "440 um"]}
solver = {distance = "1 um", settle = "3 us"}
output = {every = "0.25 um"}
[[debris]]
material = "steel"
kind = "irregular"
count = 1100
seed = 4
size = {distribution = "lognormal", median = "10 um", sigma = 0.2, min = "5 um", max = "20 um"}
spheres = [5, 8]
aspect = [1.0, 0.8, 0.6]
[plates]
lower = {material = "steel"}
upper = {material = "steel", support = "load_per_particle", load = "0.1 mN", damping = "7e-5 kg/s", motion.x.velocity = "1 m/s"}
"""
SLOW = pytest.mark.full(kind="slow")


def simulate(folder, name, threads, *more):
    """A run in a process of its own, in which two threads are allowed even where there is one core."""
    command = [sys.executable, "-m", "thirdbody", "run", "scene.toml", "-o", name, "-q", "--threads", str(threads), *more]
    environment = os.environ | {"NUMBA_NUM_THREADS": "2"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / name


@pytest.fixture(scope="module")
def one_thread(tmp_path_factory):
    path = tmp_path_factory.mktemp("bits")
    (path / "scene.toml").write_text(SCENE, encoding="utf-8")
    return simulate(path, "one", 1)


def frame_bits(run, frame):
    blocks = {name: getattr(run, name)(frame) for name in ("bodies", "spheres", "contacts", "plates")}
    return {
        f"{block}.{name}": hashlib.sha256(np.ascontiguousarray(values).tobytes()).digest()
        for block, arrays in blocks.items() for name, values in arrays.items()
    }  # fmt: skip


def bits(path):
    with thirdbody.open(path) as run:
        found = {f"frame {k}": frame_bits(run, k) for k in range(run.frames)}
        return found | {name: values.tobytes() for name, values in run.series.items()}


@SLOW
def test_the_scene_is_hard_enough(one_thread):
    """Enough groups for the passes to be shared out, contacts between them, debris that collides: else the tests below would
    show nothing."""
    state = build(thirdbody.Scene.load(one_thread.parent / "scene.toml")).state
    assert state.n_bodies > BODIES * GROUP * FEW and len(state.slots.remote_body) > 10
    with thirdbody.open(one_thread) as run:
        assert sum(np.count_nonzero(run.contacts(k)["side"] == DEBRIS) for k in range(run.frames)) > 10
        assert run.summary()["searches"] > 1


@SLOW
def test_what_is_written_does_not_change_what_happens(one_thread):
    """Four times as many frames and labels, on two threads of another process; the frames that both have agree in every array,
    and so do the totals."""
    often = simulate(one_thread.parent, "often", 2, "--set", "output.every=62.5 nm")
    with thirdbody.open(one_thread) as few, thirdbody.open(often) as many:
        totals = [name for name in few.series if name.startswith("energy_") or name in ("time", "distance", "gap", "loaded")]
        assert few.frames == 6 and many.frames == 18
        for k in range(1, few.frames):
            other = 4 * k - 3
            assert few.times[k] == many.times[other] and frame_bits(few, k) == frame_bits(many, other)
            assert all(few.series[name][k] == many.series[name][other] for name in totals)


@SLOW
@pytest.mark.parametrize("threads", [1, 2])
def test_another_process_and_two_threads_give_the_same_bits(one_thread, threads):
    assert bits(simulate(one_thread.parent, f"again{threads}", threads)) == bits(one_thread)


@pytest.mark.parametrize("name", ["stroke", "plate"])
def test_implicit_runs_have_the_same_bits_on_two_threads(name, shared_run, tmp_path):
    """Bodies that move alone, and islands under a common plate. The explicit step: tests/reference."""
    thirdbody.run(thirdbody.Scene.parse(SHARED[name]), tmp_path / "run", progress=False, threads=2).close()
    assert bits(tmp_path / "run") == bits(shared_run(name))
