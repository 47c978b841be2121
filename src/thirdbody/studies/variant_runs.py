"""Runs of all variants within a deadline: each is run once, as far as time allows, and then all are timed alternately."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from thirdbody.studies.compare import read_outcome
from thirdbody.studies.time_budget import LONG, Budget, Costs, Overheads, repeats_of
from thirdbody.studies.variant_result import Row
from thirdbody.studies.variants import UNTIMED, Base, Variant
from thirdbody.studies.worker import BATCH, ENOUGH
from thirdbody.studies.worker_process import RUNS, SCENE_FILE, Overdue, Worker, request
from thirdbody.units import duration

ROUNDS, PRECISE = 25, 0.05
"""Largest number of rounds of timings; relative uncertainty below which a variant needs no more of them."""

RESERVED_ROUNDS = 2
"""Rounds of timings for which time is reserved while variants are run: without them more variants would give no costs."""

HOPELESS = 1.5
"""A required variant is not started if it is expected to take this many times the remaining time."""

LEFT_OUT = "left out: no time in the budget"


class VariantRuns:
    """Variants of one study, a worker, and the remaining time."""

    def __init__(
        self, worker: Worker, folder: Path, plugins: Sequence[str | Path], base: Base, costs: Costs, overheads: Overheads,
        budget: Budget, log: Callable[[str], None],
    ) -> None:  # fmt: skip
        self.worker, self.folder, self.plugins, self.base = worker, folder, plugins, base
        self.costs, self.overheads, self.budget, self.log = costs, overheads, budget, log
        self.compiled: set[tuple[Any, ...]] = set()

    def rows(self, variants: Sequence[Variant], repeats: int) -> list[Row]:
        """Return all variants in their order, run and timed; one without time is marked.

        Raises UsageError where that is the scene's own, or the reference.
        """
        rows = {
            number: Row(variant, message=LEFT_OUT, integrator=variant.integrator) for number, variant in enumerate(variants, 1)
        }
        done: list[Row] = []
        for number, row in sorted(rows.items(), key=lambda entry: _rank(entry[1].variant, entry[0])):
            needed = row.variant.default or row.variant.reference
            if needed or self._predicted(row.variant) + RESERVED_ROUNDS * self._round([*done, row]) <= self._left():
                self._run(row, f"{number:02d}_{_slug(row.variant.name)}", needed)
                done.append(row)
            self.log(f"{row.variant.name}: {row.message or f'{row.cpu[0]:.3g} s'}")
        self._repeat([row for row in done if row.stable], repeats)
        return list(rows.values())

    def _run(self, row: Row, name: str, needed: bool) -> None:
        """Run one variant once."""
        variant, first = row.variant, _code(row.variant) not in self.compiled
        if needed and self._predicted(variant) > HOPELESS * self._left():
            raise self.budget.refuse(
                f"`{variant.name}` takes about {duration(self._predicted(variant))}", self._predicted(variant)
            )
        try:
            report = self.worker.request({"do": "run", **self._job(variant, name)}, self.budget.end(self.worker.pace))
        except Overdue:
            row.message = "stopped: the budget was over"
            self.compiled.clear()
            if needed:
                raise self.budget.refuse(f"no time was left for `{variant.name}`", self._predicted(variant)) from None
            return
        self.compiled.add(_code(variant))
        self.overheads = self.overheads.with_answer(report, first)
        row.stable, row.message, row.folder = report["stable"], report["message"], name
        row.integrator, row.step = report.get("integrator") or variant.integrator, report.get("step")
        if "cpu_s" not in report:
            return
        row.cpu, row.wall = [report["cpu_s"]], [report["wall_s"]]
        row.outcome = read_outcome(self.folder / RUNS / name)
        if variant.default and row.stable and (expected := self.costs.of(variant, self.base)) > 0.0:
            self.costs = replace(self.costs, scale=self.costs.scale * report["cpu_s"] / expected)

    def _repeat(self, rows: Sequence[Row], repeats: int) -> None:
        """Time variants alternately, until each is known well or no time is left. Those needed for errors only are not timed."""
        own = next((row for row in rows if row.variant.default), None)
        going = [row for row in rows if row.variant.axis not in UNTIMED and row is not own]
        again: dict[int, list[tuple[float, float, float]]] = {id(row): [] for row in [*going, *([own] if own else [])]}
        costs = {id(row): self._one_timing(row) for row in rows}
        for _ in range(ROUNDS):
            yardstick = self._timing(own, costs, again, None) if own is not None else None
            if own is not None and yardstick is None:
                break
            result = [self._timing(row, costs, again, yardstick) for row in going if not _known(again[id(row)], repeats)]
            if not any(x is not None for x in result):
                break
        for row in rows:
            self._settle(row, again.get(id(row), []), own is not None)

    def _timing(
        self, row: Row, costs: dict[int, float], again: dict[int, list[tuple[float, float, float]]], yardstick: float | None
    ) -> float | None:  # fmt: skip
        """Time one variant once more, if there is time; return its processor seconds."""
        if costs[id(row)] > self._left():
            return None
        began = time.perf_counter()
        try:
            report = self.worker.request({"do": "time", **self._job(row.variant, row.folder)}, self.budget.end(self.worker.pace))
        except Overdue:
            return None
        costs[id(row)] = time.perf_counter() - began
        if not report["stable"]:
            return None
        again[id(row)].append((report["wall_s"], report["cpu_s"], report["cpu_s"] if yardstick is None else yardstick))
        return float(report["cpu_s"])

    def _settle(self, row: Row, again: Sequence[tuple[float, float, float]], paired: bool) -> None:
        """Set the row's times from the repeats: a run that wrote its frames counts only where these do not matter."""
        if not again:
            return
        first = [] if paired or row.cpu[0] < LONG else [(row.wall[0], row.cpu[0], row.cpu[0])]
        row.wall, row.cpu, row.beside = (list(column) for column in zip(*first, *again, strict=True))
        row.beside = row.beside if paired else []

    def _job(self, variant: Variant, name: str) -> dict[str, Any]:
        folders = self.folder / SCENE_FILE, self.folder / RUNS / name
        return request(*folders, variant.changes, self.plugins, nudge=variant.nudge)

    def _left(self) -> float:
        """Return the seconds until the deadline of the last variant."""
        return self.budget.end(self.worker.pace) - time.perf_counter()

    def _predicted(self, variant: Variant) -> float:
        """Return the expected wall seconds of running a variant once."""
        beside = self.overheads.others if _code(variant) in self.compiled else self.overheads.first
        return self.worker.pace * (self.costs.of(variant, self.base) + beside)

    def _round(self, rows: Sequence[Row]) -> float:
        """Return the wall seconds of timing these variants once more."""
        return sum(self._one_timing(row) for row in rows if row.variant.axis not in UNTIMED)

    def _one_timing(self, row: Row) -> float:
        seconds = row.cpu[0] if row.cpu else self.costs.of(row.variant, self.base)
        return self.worker.pace * (max(seconds, min(BATCH * seconds, ENOUGH)) + 0.5 * self.overheads.others)


def _known(again: Sequence[tuple[float, float, float]], repeats: int) -> bool:
    """Return whether the ratio of a variant's seconds to the alternating ones is known well enough."""
    from thirdbody.studies.timing_statistics import timing

    seconds = [cpu for _, cpu, _ in again]
    if not seconds or len(seconds) < repeats_of(min(seconds), repeats):
        return False
    return timing([cpu / own for _, cpu, own in again if own > 0.0]).relative <= PRECISE


def _rank(variant: Variant, number: int) -> int:
    """Return the rank in the order of runs.

    First the scene's own variant, the reference, displaced starts, the other integrator and bodies that do not meet; then the
    others in their order.
    """
    if variant.default or variant.reference:
        return 0 if variant.default else 1
    if variant.axis == "nudged":
        return 2
    if variant.axis == "meeting" or (variant.axis == "integrator" and variant.factor == 1.0):
        return 3
    return number + 3


def _code(variant: Variant) -> tuple[Any, ...]:
    """Return a key of the code that a variant needs compiled."""
    return variant.level, variant.springs, variant.integrator


def _slug(name: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in name).replace("__", "_")
