"""A run that is read over and over while it is written is never called damaged."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from steel import STEEL

import thirdbody
from thirdbody.errors import InputError

SCENE = (
    STEEL
    + """\
[[debris]]
kind = "spheres"
material = "steel"
radius = "5 um"
count = 3
[domain]
size = ["80 um", "60 um"]
[plates]
lower = {material = "steel"}
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
motion = {x = {velocity = "0.5 m/s"}}
[solver]
duration = "40 us"
settle = "20 ns"
integrator = "explicit"
[output]
every = "20 ns"
"""
)
READS = 100


@pytest.mark.full(kind="hard")
def test_a_run_that_is_being_written_is_never_damaged(tmp_path: Path) -> None:
    """Two thousand frames, one every few milliseconds; before the first one there is no run, or none that can be read."""
    (tmp_path / "scene.toml").write_text(SCENE)
    command = [sys.executable, "-m", "thirdbody", "run", "scene.toml", "-o", "run", "--quiet"]
    reads, begun = 0, False
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None:
            try:
                with thirdbody.open(tmp_path / "run") as run:
                    begun = begun or run.frames > 0
                    if run.frames:
                        assert run.states.shape[0] == len(run.times) == len(run.series["time"]) == run.frames
                        run.bodies(-1), run.contacts(-1), run.spheres(0), run.summary()
                    reads += 1
            except InputError as error:
                assert not begun and ("no such run" in str(error) or "not an HDF5 file" in str(error)), error
        assert process.returncode == 0
    assert reads >= READS
