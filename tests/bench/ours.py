"""Our engine on one of the peers' scenes, in a process of its own.

    python tests/bench/ours.py S 16000 [--peers DIR] [--threads 1]

Prints as JSON seconds per step and the share of the processor of the timed segments, ns per sphere and step of the processor,
contacts before the warm-up and after every segment, kinetic energy at the end, steps per search, memory. DIR holds
`configs/S_16000.npz`; without it (THIRDBODY_PEERS names it too) scene S is generated. For a steady clock: taskset -c 0."""

import argparse
import ctypes
import json
import os
import statistics
import sys
import time
from operator import mul
from pathlib import Path
from typing import Any

STEPS = {("S", 2000): 3000, ("S", 16000): 1000, ("S", 64000): 500, ("S", 128000): 300, ("C", 2000): 1500, ("C", 10000): 600,
         ("T", 2000): 2000, ("T", 20000): 400}  # fmt: skip
"""Steps of a timed segment, those of the peers' protocol."""

WARM, REPS = 200, 3


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=["S", "C", "T"])
    parser.add_argument("number", type=int)
    parser.add_argument("--peers", metavar="DIR", default=os.environ.get("THIRDBODY_PEERS"))
    parser.add_argument("--threads", type=int, default=1)
    return parser.parse_args()


def measure(requested: argparse.Namespace) -> dict[str, Any]:
    # imported here: what the imports take is not the scene's memory
    from peers_scenes import count_contacts, generated, kinetic_energy, read, simulation_of, spheres_of, start_of
    from thirdbody.runner.simulate import set_threads

    if requested.peers:
        start = read(Path(requested.peers) / "configs" / f"{requested.kind}_{requested.number}.npz")
    elif requested.kind == "S":
        start = start_of("S", generated(requested.number))
    else:
        sys.exit(f"{requested.kind} needs its configuration: give --peers DIR")
    set_threads(requested.threads)
    advance(simulation_of(start_of("S", generated(200))), 70)  # compiled code is no memory of the scene
    at_start = count_contacts(start, start.x)  # now, since what it imports is no memory of the scene either
    base = reset_peak()
    began = time.perf_counter()
    simulation = simulation_of(start)
    built, seconds = peak(), time.perf_counter() - began
    advance(simulation, WARM)
    report: dict[str, list[Any]] = {"t": [], "cpu": [], "rebuild_every": [], "contacts": [], "plate": []}
    for k in range(REPS + 1):
        if k:
            time_segment(simulation, STEPS.get((requested.kind, requested.number), 300), report)
            highest = peak()
        found = count_contacts(start, spheres_of(simulation)["points"])
        report["contacts"].append(found[0])
        report["plate"].append(found[1])
    energy = kinetic_energy(start, spheres_of(simulation)["velocity"])
    marks = {"built": built, "run": highest, "stepping": resident(simulation)}
    return {
        "spheres": start.spheres, "bodies": start.bodies, "setup_s": seconds, **report, "ke_end": energy, "start": at_start,
        "processor_ns_per_sphere_step": 1e9 / start.spheres * statistics.median(map(mul, report["t"], report["cpu"])),
        "bytes_per_sphere": {name: (mark - base) / start.spheres for name, mark in marks.items()},
    }  # fmt: skip


def time_segment(simulation: Any, steps: int, report: dict[str, list[Any]]) -> None:
    searches = simulation.integrator.summary()["searches"]
    began, busy = time.perf_counter(), time.process_time()
    taken = advance(simulation, steps)
    seconds = time.perf_counter() - began
    report["t"].append(seconds / taken)
    report["cpu"].append((time.process_time() - busy) / seconds)
    report["rebuild_every"].append(taken / max(1, simulation.integrator.summary()["searches"] - searches))


def advance(simulation: Any, steps: int) -> int:
    before = simulation.integrator.summary()["steps"]
    state = simulation.state
    simulation.integrator.advance_to(time=state.time + (steps - 0.5) * state.dt)
    return simulation.integrator.summary()["steps"] - before


def resident(simulation: Any) -> int:
    """Memory that a run holds between two searches, bytes: without what is there while something is built, sought or told, and
    without what has been freed but not given back to the system yet."""
    seen: list[int] = []
    state, libc = simulation.state, ctypes.CDLL(None)

    def check_number() -> None:
        if hasattr(libc, "malloc_trim"):
            libc.malloc_trim(0)
        seen.append(_status("VmRSS"))

    simulation.integrator.advance_to(time=state.time + 400.5 * state.dt, watch=check_number)
    return min(seen)


def reset_peak() -> int:
    """Resident memory now, bytes; the peak is counted from here on where the system lets us."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
        return _status("VmRSS")
    except OSError:
        return peak()


def peak() -> int:
    try:
        return _status("VmHWM")
    except OSError:
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _status(key: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line.split()[1] for line in lines if line.startswith(key)))


if __name__ == "__main__":
    print(json.dumps(measure(arguments())))
