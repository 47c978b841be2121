"""Signals at random times in runs with outputs from 1 pm to the whole distance: every one is heard within seconds, and what goes
on after it has the bits of a run that was never stopped.

`pytest -m hard tests/hard/test_random_signals.py`: thirty signals to runs by either integrator; a few always.
"""

from __future__ import annotations

import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import pytest
from portable import PATIENCE, processor_seconds

import thirdbody
from thirdbody.runner.checkpoint import FILE
from thirdbody.runner.resume import prepare_resume

SCENE = Path(__file__).parents[2] / "scenes" / "sheared_debris.toml"
PROGRAM = [sys.executable, "-c", "from thirdbody.cli.main import main; main()"]
CODES = {signal.SIGINT: 130, signal.SIGTERM: 143}
HEARD = 3.0
"""Seconds from a signal to the end of the process: a call of a second, a frame, a checkpoint, the summary. By the clock, or where
others hold the cores, of the processor: the smaller one counts."""

EVERY = {"explicit": ("1 pm", "10 pm", "0.1 nm", "1 nm", "4 nm", "8 nm", "20 nm", "whole"),
         "implicit": ("1 pm", "10 pm", "1 nm", "0.1 um", "1 um", "whole")}  # fmt: skip
"""A time step of these scenes is some nanometre of sliding."""

SETTINGS = {
    "explicit": {"debris.0.count": "60", "solver.settle": "1 us"},
    "implicit": {"debris.0.count": "600", "contact.debris_contact": "none", "solver.integrator": "implicit"},
}


def distance_of(integrator: str, every: str) -> str:
    """A run of some seconds: so many frames, or so many steps."""
    frames = {"1 pm": "0.1 nm", "10 pm": "1 nm", "0.1 nm": "10 nm", "1 nm": "100 nm", "0.1 um": "2 um"}
    if integrator == "explicit":
        return {"1 pm": "60 nm", "10 pm": "60 nm", "0.1 nm": "60 nm", "1 nm": "60 nm"}.get(every, "300 nm")
    return frames.get(every, "6 um")


def command(folder: Path, integrator: str, every: str) -> list[str]:
    """A run of the scene, or, where there is one already, its resumption."""
    if (folder / FILE).exists():
        return [*PROGRAM, "resume", str(folder), "-q", "--threads", "1"]
    whole = distance_of(integrator, every)
    keys = SETTINGS[integrator] | {"solver.distance": whole, "output.every": whole if every == "whole" else every}
    words = [word for key, value in keys.items() for word in ("--set", f"{key}={value}")]
    return [*PROGRAM, "run", str(SCENE), "-o", str(folder), "-q", "--threads", "1", *words]


def used() -> float:
    """Time that all processes that have ended had of the processor, s."""
    times = resource.getrusage(resource.RUSAGE_CHILDREN)
    return times.ru_utime + times.ru_stime


def signalled(folder: Path, integrator: str, every: str, rng: random.Random) -> float | None:
    """Start or resume a run and send it a signal at a random time; seconds until it ended, None if it had come to its end."""
    number, before = rng.choice(list(CODES)), used()
    first = (folder / FILE).stat().st_mtime_ns if (folder / FILE).exists() else 0
    child = subprocess.Popen(command(folder, integrator, every), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    begun = time.perf_counter()
    # a run that is stopped before its first checkpoint has nothing to go on from
    while child.poll() is None and not first and not (folder / FILE).exists() and time.perf_counter() - begun < PATIENCE:
        time.sleep(0.01)
    if first:
        while child.poll() is None and processor_seconds(child.pid) < 2.0:  # past the start of Python, which no handler covers
            time.sleep(0.01)
    try:
        child.wait(rng.uniform(0.0, 3.0))
    except subprocess.TimeoutExpired:
        pass
    requested, clock = processor_seconds(child.pid) if child.poll() is None else 0.0, time.perf_counter()
    if child.poll() is None:
        child.send_signal(number)
    report = child.communicate(timeout=PATIENCE)[1]
    wall, busy = time.perf_counter() - clock, used() - before - requested
    if child.returncode == 0 or finished(folder):  # it came with the last step, or as Python ended
        return None
    assert "Traceback" not in report
    assert child.returncode == CODES[number], (child.returncode, report)
    assert "thirdbody resume" in report.splitlines()[-1]
    prepare_resume(folder)
    return min(wall, busy)


def finished(folder: Path) -> bool:
    with thirdbody.open(folder) as run:
        return run.summary()["finished"]


def arrays(folder: Path) -> dict[str, bytes]:
    """Every array of a trajectory."""
    found: dict[str, bytes] = {}
    with h5py.File(folder / "run.vtkhdf") as file:
        file.visititems(
            lambda name, item: (
                found.update({name: item[()].tobytes()})
                if isinstance(item, h5py.Dataset) and not name.startswith("scene/")
                else None
            )
        )
    return found


def heard(tmp_path: Path, integrator: str, signals: int, choices: tuple[str, ...]) -> None:
    """Send so many signals to runs with outputs of these intervals, and compare each run with one that was left alone."""
    rng, latencies = random.Random(integrator), []
    most = -(-signals // len(choices))  # for one run
    for round_ in range(10 * signals):
        every = choices[round_ % len(choices)]
        whole, folder = tmp_path / f"{every} whole", tmp_path / f"{every} cut{round_}"
        if not whole.exists():
            subprocess.run(command(whole, integrator, every), check=True, capture_output=True, timeout=PATIENCE)
        before = len(latencies)
        while (latency := signalled(folder, integrator, every, rng)) is not None:
            print(f"{integrator}, every {every}: heard after {latency:.2f} s")
            assert latency < HEARD
            latencies.append(latency)
            if len(latencies) - before >= most or len(latencies) >= signals:
                subprocess.run(command(folder, integrator, every), check=True, capture_output=True, timeout=PATIENCE)
                break
        wanted, found = arrays(whole), arrays(folder)
        assert found.keys() == wanted.keys()
        assert [name for name in wanted if found[name] != wanted[name]] == []
        if len(latencies) >= signals:
            print(f"{integrator}: {len(latencies)} signals, the slowest {max(latencies):.2f} s")
            return
    raise AssertionError(f"only {len(latencies)} of {signals} signals came before the end of a run")


needs_proc = pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="needs /proc")


@needs_proc
@pytest.mark.full(kind="hard")
@pytest.mark.parametrize("integrator", EVERY)
def test_thirty_signals_are_heard(tmp_path, integrator):
    heard(tmp_path, integrator, 30, EVERY[integrator])


@needs_proc
def test_signals_are_heard_where_outputs_are_a_few_steps_apart(tmp_path):
    heard(tmp_path, "explicit", 1, ("4 nm",))
