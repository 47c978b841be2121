"""What a step costs that has hardly anything to do: spheres in a shear flow as in S, but few of them."""

import statistics
import sys
import time
from typing import Any

from ours import advance
from peers_scenes import count_contacts, generated, simulation_of, spheres_of, start_of
from rich.console import Console
from rich.table import Table
from screen import screen

from thirdbody.runner.simulate import set_threads

NUMBERS = (1, 10, 100, 1000)

STEPS, COUNTED = 20_000, 1_280
"""Most steps of a timing, which has ten times as many sphere-steps at most; and of the count of what Python does."""


def measure_small(rounds: int) -> list[dict[str, Any]]:
    """For each number of bodies: ns per step on one thread, and how often Python is at work in between, per step."""
    set_threads(1)
    return [_measure(number, rounds) for number in NUMBERS]


def _measure(bodies: int, rounds: int) -> dict[str, Any]:
    start = start_of("S", generated(bodies))
    simulation = simulation_of(start)
    steps = max(200, min(STEPS, 10 * STEPS // bodies))
    advance(simulation, min(steps, 2000))
    searches = simulation.integrator.summary()["searches"]
    seconds = []
    for _ in range(rounds):
        began = time.perf_counter()
        taken = advance(simulation, steps)
        seconds.append((time.perf_counter() - began) / taken)
    searches = simulation.integrator.summary()["searches"] - searches
    calls, events = _python(simulation, min(steps, COUNTED))
    return {
        "bodies": bodies, "steps": steps, "ns_per_step": [1e9 * t for t in seconds],
        "contacts": sum(count_contacts(start, spheres_of(simulation)["points"])),
        "steps_per_search": rounds * steps / max(1, searches), "python_calls_per_step": calls, "events_per_step": events,
    }  # fmt: skip


def _python(simulation: Any, steps: int) -> tuple[float, float]:
    """Calls of Python functions, and of `watch`, per step: both in a run of its own, which the counting makes slow."""
    calls, events = [0], [0]

    def count(frame: Any, event: str, argument: Any) -> None:
        calls[0] += event == "call"  # those inside numba too: it looks for the version to call

    def watch() -> None:
        events[0] += 1

    state = simulation.state
    sys.setprofile(count)
    try:
        simulation.integrator.advance_to(time=state.time + (steps - 0.5) * state.dt, watch=watch)
    finally:
        sys.setprofile(None)
    return (calls[0] - events[0]) / steps, events[0] / steps


def print_small(rows: list[dict[str, Any]], console: Console) -> None:
    """A number of bodies a line."""
    table = Table("bodies", "contacts", "ns/step", "ns/sphere-step", "steps/search", "Python calls/step", "events/step",
                  title="few bodies: a step and what Python adds to it")  # fmt: skip
    for row in rows:
        ns = row["ns_per_step"]
        middle = statistics.median(ns)
        table.add_row(f"{row['bodies']}", f"{row['contacts']}", f"{middle:.0f}  ({min(ns):.0f} .. {max(ns):.0f})",
                      f"{middle / row['bodies']:.0f}", f"{row['steps_per_search']:.0f}", f"{row['python_calls_per_step']:.3f}",
                      f"{row['events_per_step']:.4f}")  # fmt: skip
    console.print(table)


if __name__ == "__main__":
    print_small(measure_small(5), screen())
