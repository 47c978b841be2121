"""How large a copy of a scene may be for its whole ladder to end within a budget of time: from measured times of rungs."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from thirdbody.errors import UsageError
from thirdbody.quantity import duration
from thirdbody.studies.variants import Base, Law, Variant
from thirdbody.studies.worker_process import LIMIT, RUNGS, SCENE_FILE, Worker, request

BUDGET = 420.0
"""Seconds that a whole study may take, from its first line to its last."""

PROBE = 2.0
"""Seconds of one core that a rung is tried for."""

FINISH = 3.0
"""Seconds of one core for what comes after the last rung: reading the runs, the table, the picture and the JSON."""

SHORT, LONG, TWICE = 0.3, 2.0, 5.0
"""Of runs shorter than the first repeats are many; from the second on a run is timed while it writes its frames too, for they do
not matter there; from the third on two runs tell the spread."""

MANY = 7
"""Repeats of short rungs, at least: what disturbs them is not theirs, and they are cheap."""


def repeats_of(seconds: float, wished: int) -> int:
    """How often a rung is timed that takes so long; 0 and 1 stay."""
    if wished < 2:
        return wished
    if seconds > TWICE:
        return 2
    return max(wished, MANY) if seconds < SHORT else wished


@dataclass(frozen=True)
class Costs:
    """Measured seconds of one run of a copy: `own`, as the scene asks; `springs`, with as many springs as the ladder has (None
    without such a level), `maximum` of them; with the finest law, `best`; with the `other` integrator."""

    own: float
    most: int
    springs: float | None
    best: Law
    finest: float
    other: float
    scale: float = 1.0

    def of(self, variant: Variant, base: Base) -> float:
        """Seconds that a run of a rung will take: linear in the springs and in the number of steps."""
        law: Law = (variant.level, variant.springs)
        if variant.integrator != base.kind:
            seconds = self.other
        elif law == self.best:
            seconds = self.finest
        elif self.springs is None or variant.springs is None or law == (base.level, base.springs):
            seconds = self.own
        else:
            first = base.springs or 0
            each = (self.springs - self.own) / (self.most - first) if self.most > first else 0.0
            seconds = max(self.own + each * (variant.springs - first), 0.1 * self.own)
        return min(LIMIT, self.scale * seconds / (variant.factor if variant.integrator == "explicit" else variant.factor**0.5))


OPTIONAL, DEAR = ("springs", "other"), 0.1
"""Rungs that are not tried where that would take more than this share of the time that is left."""


@dataclass(frozen=True)
class Overheads:
    """Seconds of one core that rungs take beside their integration, in the mean: `fresh` of those whose law the process had not
    compiled, `known` of all others."""

    fresh: float = 0.0
    known: float = 0.0
    counts: tuple[int, int] = (0, 0)

    def with_answer(self, answer: Mapping[str, Any], fresh: bool) -> Overheads:
        """The means with those of one more rung."""
        took = max(0.0, answer.get("used_cpu", 0.0) - answer.get("cpu_s", 0.0))
        compiled = answer.get("compile_s", 0.0) if fresh else 0.0
        n, m = self.counts
        known = (m * self.known + took - compiled) / (m + 1)
        if not fresh:
            return replace(self, known=known, counts=(n, m + 1))
        return Overheads((n * self.fresh + took) / (n + 1), known, (n + 1, m + 1))


def measure_costs(
    worker: Worker,
    variants: Sequence[Variant],
    base: Base,
    folder: Path,
    plugins: Sequence[str | Path],
    maximum: float,
    until: float,
) -> tuple[Costs, Overheads]:
    """The costs of the copy that is saved in a study's folder: the costliest rungs are tried, `maximum` seconds of one core each.

    Raises Overdue at `until`.
    """
    plain = [rung for rung in variants if rung.factor == 1.0 and rung.axis in ("law", "integrator")]
    laws = [rung for rung in plain if rung.axis == "law"]
    springs = [rung for rung in laws if rung.springs is not None]
    tried = {
        "own": next((rung for rung in laws if rung.default), laws[0]),
        "finest": laws[-1],
        "other": next((rung for rung in plain if rung.axis == "integrator"), laws[0]),
    } | ({"springs": springs[-1]} if springs else {})
    took: dict[str, float] = {}
    overheads = Overheads()
    for name, variant in tried.items():
        left = (until - time.perf_counter()) / worker.pace
        if name in OPTIONAL and overheads.fresh + maximum > DEAR * left:
            continue
        job = request(folder / SCENE_FILE, folder / RUNGS / "costliest" / name, variant.changes, plugins, maximum)
        report = worker.ask({"do": "run", **job}, until)
        overheads = overheads.with_answer(report, True)
        # one that stops early, or cannot run, costs little
        took[name] = report["cpu_s"] / report["done"] if report.get("done") else 0.0
    took.setdefault("other", took["own"])
    finest = springs[-1].springs or 0 if springs else 0
    costs = Costs(took["own"], finest, took.get("springs"), (laws[-1].level, laws[-1].springs), took["finest"], took["other"])
    return costs, overheads


def whole(variants: Sequence[Variant], base: Base, costs: Costs, repeats: int, share: float = 1.0) -> float:
    """Seconds that all rungs take together when each run takes a share of what it took in the copy that was probed."""
    total = 0.0
    for variant in variants:
        seconds = share * costs.of(variant, base)
        times = repeats_of(seconds, 1 if variant.axis == "verify" else repeats)
        total += seconds * (times + (seconds <= LONG))  # a short run's first one is not timed
    return total


def fitting(variants: Sequence[Variant], base: Base, costs: Costs, repeats: int, margin: float) -> float:
    """The share of the copy whose ladder takes `margin` seconds of one core, at most 4 and at least 1 %."""
    fraction = 4.0
    while fraction > 0.01 and whole(variants, base, costs, repeats, fraction) > margin:
        fraction *= 0.97
    return fraction


class Budget:
    """The wall time of a study, from its first line to its last."""

    def __init__(self, seconds: float) -> None:
        self.seconds, self.began = seconds, time.perf_counter()

    def spent(self) -> float:
        """Seconds since the study began."""
        return time.perf_counter() - self.began

    def end(self, pace: float) -> float:
        """When the last rung must have ended (s of `time.perf_counter`), on a machine of this pace."""
        return self.began + self.seconds - FINISH * pace

    def refuse(self, what: str, more: float) -> UsageError:
        """The error of a budget that cannot hold the smallest ladder; `more`: seconds that what is missing takes."""
        needed = 1.2 * (self.spent() + more)
        return UsageError(
            f"--budget {duration(self.seconds)}: too short for the smallest ladder of this scene (its own settings and the "
            f"reference): {what}; about {duration(needed)} are needed on this machine at its present load"
        )
