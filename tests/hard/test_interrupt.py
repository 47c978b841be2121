"""A stop is heard within a batch of the implicit integrator, and what was cut there goes on with the same bits."""

from __future__ import annotations

import itertools
import math
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from portable import PATIENCE, processor_seconds
from trajectories import contents

import thirdbody
from thirdbody.engine import implicit
from thirdbody.errors import Interrupted
from thirdbody.kernels.columns import run_totals
from thirdbody.runner.checkpoint import FILE
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.simulate import execute, prepare

SCENE = Path(__file__).parents[2] / "scenes" / "sheared_debris.toml"
ALONE = {"contact.debris_contact": "none", "solver.integrator": "implicit"}
SECONDS = 15.0
"""Processor time from the signal to the end: a call of a second on all threads, a checkpoint, a summary, the end of Python."""


def scene_of(bodies: int, path: str, level: str = "mindlin") -> thirdbody.Scene:
    """Bodies between two outputs that lie `path` apart."""
    keys = {"debris.0.count": str(bodies), "solver.distance": path, "output.every": path, "contact.level": level}
    return thirdbody.Scene.load(SCENE).with_settings(ALONE | keys)


def children_seconds() -> float:
    """Time that all processes that have ended had of the processor, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def in_short_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    """One try of a step per body and call, whatever the clock says."""
    monkeypatch.setattr(implicit, "CALL", 0.0)
    monkeypatch.setattr(implicit, "FEW", 1.0)


@pytest.mark.parametrize("level", ["mindlin", "mdr"])
def test_bodies_that_wait_come_to_the_same_bits(tmp_path, monkeypatch, level):
    execute(prepare(scene_of(60, "0.5 um", level)), tmp_path / "whole")
    in_short_calls(monkeypatch)
    guard = itertools.count()
    execute(prepare(scene_of(60, "0.5 um", level)), tmp_path / "often", stop=lambda: next(guard) < 0)
    assert next(guard) > 20  # else the calls were not cut
    whole, often = contents(tmp_path / "whole"), contents(tmp_path / "often")
    assert [name for name in whole if whole[name] != often[name]] == []


def test_a_run_cut_within_a_batch_goes_on_to_the_same_bits(tmp_path, monkeypatch):
    execute(prepare(scene_of(60, "2 um")), tmp_path / "whole")
    in_short_calls(monkeypatch)
    simulation, guard = prepare(scene_of(60, "2 um")), itertools.count()
    with pytest.raises(Interrupted, match=r"thirdbody\.resume\("):
        execute(simulation, tmp_path / "cut", stop=lambda: next(guard) > 20)
    times = simulation.integrator.totals[:, run_totals.TIME]
    assert len(set(times)) > 10  # bodies stopped on their way, each at a time of its own
    monkeypatch.setattr(implicit, "CALL", math.inf)
    simulation, kept = prepare_resume(tmp_path / "cut")
    execute(simulation, tmp_path / "cut", checkpoint=kept, threads=1)
    whole, joined = contents(tmp_path / "whole"), contents(tmp_path / "cut")
    assert [name for name in whole if whole[name] != joined[name]] == []


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize("number, code", [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_batch_of_many_bodies_hears_a_signal(tmp_path, number, code):
    """512 bodies that all have a millimetre to go: most of a minute of work between two outputs."""
    folder = tmp_path / "run"
    settings = {"debris.0.count": "512", "solver.distance": "1 mm", "output.every": "1 mm"} | ALONE
    command = [sys.executable, "-c", "from thirdbody.cli.main import main; main()", "run", str(SCENE), "-o", str(folder), "-q"]
    command += [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    before = children_seconds()
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=os.environ)
    begun = time.perf_counter()
    while not (folder / FILE).exists() and child.poll() is None and time.perf_counter() - begun < PATIENCE:
        time.sleep(0.05)
    started = processor_seconds(child.pid)
    while child.poll() is None and processor_seconds(child.pid) < started + 2.0:  # past settling, into the drag
        time.sleep(0.05)
    first = (folder / FILE).read_bytes()
    requested = processor_seconds(child.pid)
    child.send_signal(number)
    report = child.communicate(timeout=PATIENCE)[1]
    assert child.returncode == code, report
    assert children_seconds() - before - requested < SECONDS
    *warnings, last = report.splitlines()
    assert "thirdbody resume" in last and all(line.startswith("warning: ") for line in warnings)
    assert (folder / FILE).read_bytes() != first  # one was written where it stopped
    prepare_resume(folder)
