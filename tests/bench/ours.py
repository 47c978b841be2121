"""Our engine on one of the peers' scenes, in a process of its own.

    python tests/bench/ours.py S 16000 [--peers DIR] [--steps 300] [--warm 200] [--reps 3] [--threads 1] [--tiles 2x2] [--json]

Prints ns per sphere-step and per contact-step (the median of the timed segments, and each of them), contacts before the warm-up
and after every segment, kinetic energy at the end, steps per search, memory. DIR holds `configs/S_16000.npz`; without it
(THIRDBODY_PEERS names it too) scene S is generated. For a steady clock: taskset -c 0 python tests/bench/ours.py ...
"""

from __future__ import annotations

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
    """What the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=["S", "C", "T"])
    parser.add_argument("number", type=int)
    parser.add_argument("--peers", metavar="DIR", default=os.environ.get("THIRDBODY_PEERS"))
    parser.add_argument("--steps", type=int, help="of a timed segment (default: as the peers)")
    parser.add_argument("--warm", type=int, default=WARM, help="steps before (default %(default)s)")
    parser.add_argument("--reps", type=int, default=REPS, help="timed segments (default %(default)s)")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--tiles", type=tiles, default="1x1", help="copies along x and y (default %(default)s)")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    asked.steps = asked.steps or STEPS.get((asked.kind, asked.number), 300)
    return asked


def tiles(text: str) -> tuple[int, int]:
    """Copies along x and y in a text such as 2x2. Raises ValueError."""
    columns, rows = (int(number) for number in text.split("x"))
    if min(columns, rows) < 1:
        raise ValueError(text)
    return columns, rows


def measure(asked: argparse.Namespace) -> dict[str, Any]:
    """Build, warm up, and time the segments."""
    # imported here: what the imports take is not the scene's memory
    from peers_scenes import count_contacts, generated, kinetic_energy, read, simulation_of, spheres_of, start_of, tiled

    from thirdbody.runner.simulate import set_threads

    if asked.peers:
        start = read(Path(asked.peers) / "configs" / f"{asked.kind}_{asked.number}.npz", asked.tiles)
    elif asked.kind == "S":
        start = start_of("S", tiled(generated(asked.number), *asked.tiles))
    else:
        sys.exit(f"{asked.kind} needs its configuration: give --peers DIR")
    set_threads(asked.threads)
    advance(simulation_of(start_of("S", generated(200))), 70)  # compiled code is no memory of the scene
    at_start = count_contacts(start, start.x)  # now, since what it imports is no memory of the scene either
    base = forget_peak()
    began = time.perf_counter()
    simulation = simulation_of(start)
    built, seconds = peak(), time.perf_counter() - began
    advance(simulation, asked.warm)
    told: dict[str, list[Any]] = {"t": [], "cpu": [], "rebuild_every": [], "contacts": [], "plate": []}
    note(told, count_contacts(start, spheres_of(simulation)["points"]))
    for _ in range(asked.reps):
        time_segment(simulation, asked.steps, told)
        highest = peak()
        note(told, count_contacts(start, spheres_of(simulation)["points"]))
    energy = kinetic_energy(start, spheres_of(simulation)["velocity"])
    stepping = resident(simulation)
    touching = statistics.fmean(told["contacts"]) + statistics.fmean(told["plate"])
    return {
        "engine": "thirdbody", "scene": asked.kind, "N": asked.number, "tiles": asked.tiles, "cores": asked.threads,
        "spheres": start.spheres, "bodies": start.bodies, "steps": asked.steps, "setup_s": seconds, **told,
        "ke_end": energy, "start": at_start,
        "ns_per_sphere_step": [1e9 * t / start.spheres for t in told["t"]],
        "processor_ns_per_sphere_step": 1e9 / start.spheres * statistics.median(map(mul, told["t"], told["cpu"])),
        "ns_per_contact_step": [1e9 * t / touching for t in told["t"]],
        "bytes_per_sphere": {
            "built": (built - base) / start.spheres, "run": (highest - base) / start.spheres,
            "stepping": (stepping - base) / start.spheres,
        },
    }  # fmt: skip


def time_segment(simulation: Any, steps: int, told: dict[str, list[Any]]) -> None:
    """Seconds per step, share of the processor, and steps per search of one segment."""
    searches = simulation.integrator.summary()["searches"]
    began, busy = time.perf_counter(), time.process_time()
    taken = advance(simulation, steps)
    seconds = time.perf_counter() - began
    told["t"].append(seconds / taken)
    told["cpu"].append((time.process_time() - busy) / seconds)
    told["rebuild_every"].append(taken / max(1, simulation.integrator.summary()["searches"] - searches))


def advance(simulation: Any, steps: int) -> int:
    """Run so many steps of the fixed length; how many they were."""
    before = simulation.integrator.summary()["steps"]
    state = simulation.state
    simulation.integrator.advance_to(time=state.time + (steps - 0.5) * state.dt)
    return simulation.integrator.summary()["steps"] - before


def resident(simulation: Any) -> int:
    """Memory that a run holds between two searches, bytes: without what is there while something is built, sought or told, and
    without what has been freed but not given back to the system yet."""
    seen: list[int] = []
    state, libc = simulation.state, ctypes.CDLL(None)

    def look() -> None:
        if hasattr(libc, "malloc_trim"):
            libc.malloc_trim(0)
        seen.append(_status("VmRSS"))

    simulation.integrator.advance_to(time=state.time + 400.5 * state.dt, watch=look)
    return min(seen)


def note(told: dict[str, list[Any]], found: tuple[int, int]) -> None:
    """Keep a count of contacts."""
    told["contacts"].append(found[0])
    told["plate"].append(found[1])


def forget_peak() -> int:
    """Resident memory now, bytes; the peak is counted from here on where the system lets us."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
        return _status("VmRSS")
    except OSError:
        return peak()


def peak() -> int:
    """Peak resident memory, bytes."""
    try:
        return _status("VmHWM")
    except OSError:
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _status(key: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line.split()[1] for line in lines if line.startswith(key)))


def show(told: dict[str, Any]) -> None:
    """The result in words."""
    each = ", ".join(f"{t:.1f}" for t in told["ns_per_sphere_step"])
    touching = f"{told['contacts']} + {told['plate']} with plates (at the start {told['start'][0]} + {told['start'][1]})"
    print(f"{told['scene']} {told['N']}: {told['spheres']} spheres, {told['bodies']} bodies, {told['cores']} threads")
    print(f"ns per sphere-step   {statistics.median(told['ns_per_sphere_step']):.1f}  ({each}; CPU {min(told['cpu']):.0%})")
    print(f"  of the processor   {told['processor_ns_per_sphere_step']:.1f}  (steadier where others use the core too)")
    print(f"ns per contact-step  {statistics.median(told['ns_per_contact_step']):.1f}")
    print(f"contacts             {touching}")
    print(f"steps per search     {', '.join(f'{n:.0f}' for n in told['rebuild_every'])}")
    print(f"kinetic energy       {told['ke_end']:.5g} J")
    print(
        f"bytes per sphere     {told['bytes_per_sphere']['built']:.0f} built, {told['bytes_per_sphere']['run']:.0f} at most, "
        f"{told['bytes_per_sphere']['stepping']:.0f} between searches"
    )
    print(f"built in             {told['setup_s']:.2f} s")


if __name__ == "__main__":
    given = arguments()
    result = measure(given)
    print(json.dumps(result)) if given.json else show(result)
