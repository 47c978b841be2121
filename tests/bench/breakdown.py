"""Where the time of the explicit step goes: every pass alone against the limits of the machine, and a run of the same process.

A pass is timed again and again; the least of many short timings counts, since whoever disturbs only adds. Its bytes (passes.py)
are judged by the triad with the smallest working set that holds all tables, or fields of a tile, that the pass touches. Its
operations are counted in the compiled source (operations.py); their limit is the longer of products and sums at the peak, and of
roots and divisions one after the other. More than 100 % of a triad: part of the tables is in a nearer cache.

Parts of the run: those of its quickest segment; undisturbed: as a quarter of the calls were, or quicker.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

import numpy as np
from operations import Operations, operations
from ours import advance
from passes import Pass, Tables, passes_of
from rich.console import Console
from rich.table import Table
from traffic import moved, print_traffic

from thirdbody.engine import explicit
from thirdbody.kernels.columns import run_totals

TRIES, SHORT = 30, 2e-3
"""Timings of a pass, and how long each takes, s: shorter than what the system leaves a process undisturbed."""

LOOP, PYTHON = "advance", "python"
EVENTS = {"bound": "bound of the time step", "search": "search", "refresh_spheres": "all spheres placed",
          PYTHON: "python between calls"}  # fmt: skip
"""What happens between two calls of the step loop."""

Reported = dict[str, Any]


def profile(simulation: Any, limits: Reported, warm: int, steps: int, segments: int) -> Reported:
    """The passes and the run of a simulation, on one thread: lists of rows, times in ns per sphere and step."""
    advance(simulation, warm)
    run = min((measured_run(simulation, steps) for _ in range(segments)), key=lambda report: report["ns"])
    tables = Tables(simulation.integrator)
    rows: list[Reported] = []
    passes = passes_of(tables)
    for number, one in enumerate(passes):
        for before in passes[:number]:  # what it finds in a tile is what they leave there
            before.run(1)
        rows.append(row_of(one, shortest(one.run), len(tables.S), limits))
    total = sum(row["ns"] for row in rows)
    return {
        "spheres": len(tables.S), "bodies": len(tables.B), "contacts": int(tables.tiles[:, 1].sum()),
        "candidates": tables.slots.count, "passes": rows, "run": run, "sum_ns": total,
        "total_ns": total + sum(run[event]["quiet_ns"] for event in EVENTS),
        "traffic": moved(simulation.state), "far_GB_s": limits["bandwidth_GB_s"][max(limits["bandwidth_GB_s"])],
    }  # fmt: skip


def shortest(run: Callable[[int], Any]) -> float:
    """Seconds of one round at the best of many short timings."""
    run(1)  # compiles
    many, least = 1, float("inf")
    for k in range(TRIES):
        started = time.perf_counter()
        run(many)
        least = min(least, (time.perf_counter() - started) / many)
        many = many if k else max(1, int(SHORT / least))
    return least


def row_of(one: Pass, seconds: float, spheres: int, limits: Reported) -> Reported:
    """What a pass takes and what it could take."""
    counted = Operations()
    for kernel, times in one.kernels:
        counted = counted.plus(operations(kernel).times(times) if times else Operations())
    fits, rate = level(one.tables, limits["bandwidth_GB_s"])
    arithmetic = max(
        counted.simple / limits["arithmetic_GF_s"], counted.roots * limits["sqrt_ns"] + counted.divisions * limits["division_ns"]
    )
    return {
        "pass": one.name, "ns": 1e9 * seconds / spheres, "calls": one.calls, "items": one.items / spheres, "things": one.things,
        "bytes": one.touched / spheres, "tables_KiB": one.tables / 1024, "level_KiB": fits, "GB_s": 1e-9 * one.touched / seconds,
        "of_bandwidth": 1e-9 * one.touched / seconds / rate, "operations": sum(counted) / one.items,
        "of_arithmetic": 1e-9 * arithmetic / seconds,
    }  # fmt: skip


def level(tables: float, bandwidth: dict[int, float]) -> tuple[int, float]:
    """The smallest working set of the triad, KiB, that holds so many bytes, or the largest; and its GB/s."""
    size = min((size for size in bandwidth if 1024 * size >= tables), default=max(bandwidth))
    return size, bandwidth[size]


def measured_run(simulation: Any, steps: int) -> Reported:
    """ns per sphere and step of a run, and of its parts; of those also what they take when nobody disturbs, and calls a step."""
    clock = Clock(simulation.state.A)
    with ExitStack() as stack:
        for name in clock.spent:
            place: Any = explicit.step_loop if name == LOOP else explicit
            if name != PYTHON:
                stack.enter_context(patch.object(place, name, clock.timed(name, getattr(place, name))))
        started = time.perf_counter()
        taken = advance(simulation, steps)
        seconds = time.perf_counter() - started
    each = 1e9 / simulation.state.n_spheres
    report: Reported = {"steps": taken, "ns": each / taken * seconds}
    for name, calls in clock.spent.items():
        spent, steps_of = np.array(calls or [(0.0, 0.0)]).T
        # a quarter of the calls were quicker, by the step where a call makes steps
        quiet = np.quantile(spent / np.maximum(steps_of, 1.0), 0.25) * (1.0 if name == LOOP else len(calls) / taken)
        report[name] = {"ns": each / taken * spent.sum(), "quiet_ns": each * quiet, "calls": len(calls) / taken}
    return report


class Clock:
    """Seconds of every call, with the steps that it made, and of Python from one call of the step loop to the next."""

    def __init__(self, A: np.ndarray) -> None:
        self.A = A
        self.spent: dict[str, list[tuple[float, float]]] = {name: [] for name in (LOOP, *EVENTS)}
        self.ended, self.between = 0.0, 0.0

    def timed(self, name: str, function: Callable) -> Callable:
        """The same function, timed."""

        def call(*given: Any, **named: Any) -> Any:
            before, started = self.A[run_totals.STEPS], time.perf_counter()
            self.between += started - self.ended if self.ended else 0.0
            if name == LOOP and self.ended:
                self.spent[PYTHON].append((self.between, 0.0))
                self.between = 0.0
            answer = function(*given, **named)
            self.ended = time.perf_counter()
            self.spent[name].append((self.ended - started, self.A[run_totals.STEPS] - before))
            return answer

        return call


def print_profile(name: str, report: Reported, console: Console) -> None:
    """A scene: a pass a line, then the run."""
    title = (
        f"{name}: {report['spheres']} spheres, {report['bodies']} bodies, {report['contacts']} contacts of "
        f"{report['candidates']} "
        f"candidates; one thread"
    )
    table = Table("pass", "ns/sphere-step", "calls/step", "works on, per sphere", "bytes/sphere", "tables", "GB/s",
                  "of the triad", "operations each", "of the peak", title=title)  # fmt: skip
    for row in report["passes"]:
        table.add_row(
            row["pass"], f"{row['ns']:.2f}", str(row["calls"]), f"{row['items']:.3g} {row['things']}", f"{row['bytes']:.0f}",
            size(row["tables_KiB"]), f"{row['GB_s']:.1f}", f"{row['of_bandwidth']:.0%} of {size(row['level_KiB'])}",
            f"{row['operations']:.0f}", f"{row['of_arithmetic']:.0%}",
        )  # fmt: skip
    console.print(table)
    print_traffic(name, report["traffic"], report["spheres"], report["far_GB_s"], report["run"][LOOP]["quiet_ns"], console)
    print_run(name, report, console)


def size(kibibytes: float) -> str:
    """So many KiB in words."""
    return f"{kibibytes:.0f} KiB" if kibibytes < 1024 else f"{kibibytes / 1024:.3g} MiB"


def print_run(name: str, report: Reported, console: Console) -> None:
    """The run of a scene, with what the passes explain of it."""
    run = report["run"]
    quiet = sum(run[part]["quiet_ns"] for part in (LOOP, *EVENTS))
    table = Table("", "ns/sphere-step undisturbed", "in the run", "calls/step", title=f"{name}: a run of {run['steps']} steps")
    table.add_row("sum of the passes", f"{report['sum_ns']:.2f}")
    for part, words in ({LOOP: "step loop, which makes them"} | EVENTS).items():
        row = run[part]
        table.add_row(words, f"{row['quiet_ns']:.2f}", f"{row['ns']:.2f}", f"{row['calls']:.2g}")
        if part == LOOP:
            table.add_section()
    table.add_section()
    table.add_row("passes and all that is between", f"{report['total_ns']:.2f}")
    table.add_row("the whole run", f"{quiet:.2f}", f"{run['ns']:.2f}")
    console.print(table)
    console.print(
        f"{name}: the rows explain {report['total_ns'] / quiet:.0%} of the undisturbed run; the rest is in the step loop: "
        f"sums over groups, guards, records, patches, calls, less what passes find in a nearer cache there"
    )
