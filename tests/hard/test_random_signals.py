"""Signals are heard within seconds, also within a batch of the implicit integrator, and what
goes on after one has the bits of a run that was never stopped. `-m full`: thirty signals at random times by either
integrator."""

import itertools
import math
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from portable import PATIENCE, processor_seconds
from slow import slow
from steel import SCENES
from trajectories import contents
import thirdbody
from thirdbody.engine import implicit
from thirdbody.errors import Interrupted
from thirdbody.kernels.tables import run_totals
from thirdbody.runner.checkpoint import FILE
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.simulate import execute, prepare

SCENE = SCENES / "sheared_debris.toml"
PROGRAM = [sys.executable, "-c", "from thirdbody.cli.main import main; main()"]
CODES = {signal.SIGINT: 130, signal.SIGTERM: 143}
HEARD = 3.0
"""Seconds from a signal to the end of the process: a call of a second, a frame, a checkpoint, the summary. By the clock, or where
others hold the cores, of the processor: the smaller one counts."""
EVERY = {"explicit": ("1 pm", "10 pm", "0.1 nm", "1 nm", "4 nm", "8 nm", "20 nm", "whole"),
         "implicit": ("1 pm", "10 pm", "1 nm", "0.1 um", "1 um", "whole")}  # fmt: skip
"""A time step of these scenes is some nanometre of sliding."""
ALONE = {"contact.debris_contact": "none", "solver.integrator": "implicit"}
SETTINGS = {"explicit": {"debris.0.count": "60", "solver.settle": "1 us"}, "implicit": ALONE | {"debris.0.count": "600"}}


def command(folder, integrator, every):
    if (folder / FILE).exists():
        return [*PROGRAM, "resume", str(folder), "-q", "--threads", "1"]
    # some seconds: so many frames, or so many steps
    frames = {"1 pm": "0.1 nm", "10 pm": "1 nm", "0.1 nm": "10 nm", "1 nm": "100 nm", "0.1 um": "2 um"}
    short = "60 nm" if every in ("1 pm", "10 pm", "0.1 nm", "1 nm") else "300 nm"
    whole = frames.get(every, "6 um") if integrator == "implicit" else short
    keys = {"solver.distance": whole, "output.every": whole if every == "whole" else every} | SETTINGS[integrator]
    words = [word for key, value in keys.items() for word in ("--set", f"{key}={value}")]
    return [*PROGRAM, "run", str(SCENE), "-o", str(folder), "-q", "--threads", "1", *words]


def used():
    times = resource.getrusage(resource.RUSAGE_CHILDREN)
    return times.ru_utime + times.ru_stime


def started(folder, words, seconds):
    child = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    until = time.perf_counter() + PATIENCE
    # a run that is stopped before its first checkpoint has nothing to go on from
    while child.poll() is None and not (folder / FILE).exists() and time.perf_counter() < until:
        time.sleep(0.01)
    begun = processor_seconds(child.pid) if child.poll() is None else 0.0
    while child.poll() is None and processor_seconds(child.pid) < begun + seconds:
        time.sleep(0.01)
    return child


def signalled(folder, integrator, every, rng):
    """Start or resume a run and send it a signal at a random time; seconds until it ended, None if it had come to its end."""
    number, before = rng.choice(list(CODES)), used()
    # past the start of Python, which no handler covers: up to 2 s of processor time, more where threads share a core
    child = started(folder, command(folder, integrator, every), 4.0 if (folder / FILE).exists() else 0.0)
    try:
        child.wait(rng.uniform(0.0, 3.0))
    except subprocess.TimeoutExpired:
        pass
    requested, clock = processor_seconds(child.pid) if child.poll() is None else 0.0, time.perf_counter()
    if child.poll() is None:
        child.send_signal(number)
    report = child.communicate(timeout=PATIENCE)[1]
    wall, busy = time.perf_counter() - clock, used() - before - requested
    with thirdbody.open(folder) as run:
        if child.returncode == 0 or run.summary()["finished"]:  # it came with the last step, or as Python ended
            return None
    assert "Traceback" not in report
    assert child.returncode == CODES[number], (child.returncode, report)
    assert "thirdbody resume" in report.splitlines()[-1]
    prepare_resume(folder)
    return min(wall, busy)


def check_same(one, other):
    whole, joined = contents(one), contents(other)
    assert joined.keys() == whole.keys() and [name for name in whole if whole[name] != joined[name]] == []


def heard(tmp_path, integrator, signals, choices):
    rng, latencies = random.Random(integrator), []
    most = -(-signals // len(choices))  # for one run
    for round_ in range(10 * signals):
        every = choices[round_ % len(choices)]
        whole, folder = tmp_path / f"{every} whole", tmp_path / f"{every} cut{round_}"
        if not whole.exists():
            subprocess.run(command(whole, integrator, every), check=True, capture_output=True, timeout=PATIENCE)
        before = len(latencies)
        while (latency := signalled(folder, integrator, every, rng)) is not None:
            assert latency < HEARD
            latencies.append(latency)
            if len(latencies) - before >= most or len(latencies) >= signals:
                thirdbody.resume(folder, threads=1, progress=False).close()
                break
        check_same(whole, folder)
        if len(latencies) >= signals:
            return
    raise AssertionError(f"only {len(latencies)} of {signals} signals came before the end of a run")


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.full(kind="hard")
@pytest.mark.parametrize("integrator", EVERY)
def test_thirty_signals_are_heard(tmp_path, integrator):
    heard(tmp_path, integrator, 30, EVERY[integrator])


def scene_of(bodies, path, level="mindlin"):
    keys = {"debris.0.count": str(bodies), "solver.distance": path, "output.every": path, "contact.level": level}
    return thirdbody.Scene.load(SCENE).with_settings(ALONE | keys)


def in_short_calls(monkeypatch):
    monkeypatch.setattr(implicit, "CALL", 0.0)
    monkeypatch.setattr(implicit, "FEW", 1.0)


@pytest.mark.parametrize("level", ["mindlin", slow("mdr")])
def test_bodies_that_wait_come_to_the_same_bits(tmp_path, monkeypatch, level):
    execute(prepare(scene_of(60, "0.5 um", level)), tmp_path / "whole")
    in_short_calls(monkeypatch)
    guard = itertools.count()
    execute(prepare(scene_of(60, "0.5 um", level)), tmp_path / "often", stop=lambda: next(guard) < 0)
    assert next(guard) > 20  # else the calls were not cut
    check_same(tmp_path / "whole", tmp_path / "often")


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
    check_same(tmp_path / "whole", tmp_path / "cut")
