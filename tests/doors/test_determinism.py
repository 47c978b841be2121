"""The same scene gives the same bits: on any number of threads, in every process, whatever is written when."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from shared_runs import SHARED
import thirdbody

# bodies that move alone, islands under a common plate, islands; the explicit step on more threads: tests/reference
NAMES = ["stroke", "plate", pytest.param("layer", marks=pytest.mark.full(kind="slow"))]


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


@pytest.mark.parametrize("name", NAMES)
def test_two_threads_give_the_bits_of_one(name, shared_run, tmp_path):
    thirdbody.run(thirdbody.Scene.parse(SHARED[name]), tmp_path / "run", progress=False, threads=2).close()
    assert bits(tmp_path / "run") == bits(shared_run(name))


@pytest.mark.full(kind="slow")
@pytest.mark.parametrize("name", ["bed", "plate", "alone"])
def test_another_process_gives_the_same_bits(name, shared_run, tmp_path):
    (tmp_path / "scene.toml").write_text(SHARED[name], encoding="utf-8")
    command = [sys.executable, "-m", "thirdbody", "run", "scene.toml", "-o", "run", "-q", "--threads", "2"]
    done = subprocess.run(command, cwd=tmp_path, env=os.environ | {"NUMBA_NUM_THREADS": "2"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert bits(tmp_path / "run") == bits(shared_run(name))


def test_what_is_written_does_not_change_what_happens(shared_run, tmp_path):
    """Of half an explicit run four times as many frames; those that both have agree in every array, and so do the totals."""
    finer = thirdbody.Scene.parse(SHARED["bed"]).with_settings({"output.every": "0.125 um", "solver.distance": "2 um"})
    with thirdbody.open(shared_run("bed")) as few, thirdbody.run(finer, tmp_path / "many", progress=False, threads=2) as many:
        totals = [name for name in few.series if name.startswith("energy_") or name in ("time", "distance", "gap", "loaded")]
        times = many.times.tolist()
        assert len(times) > 16 and many.summary()["searches"] > 1
        for k, time in enumerate(few.times[few.times <= times[-1]]):
            other = times.index(time)
            assert k == 0 or frame_bits(few, k) == frame_bits(many, other)
            assert all(few.series[name][k] == many.series[name][other] for name in totals)
