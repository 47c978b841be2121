"""Size of the copy of a scene whose variants all finish within a time budget, from measured times."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from thirdbody.errors import UsageError
from thirdbody.studies.variants import Base, Law, Variant
from thirdbody.studies.worker_process import LIMIT, RUNS, SCENE_FILE, Worker, request
from thirdbody.units import duration

BUDGET = 420.0
"""Limit of the wall time of a whole study, from its first line to its last [s]."""

PROBE = 2.0
"""Duration of the trial of a variant on one core [s]."""

FINISH = 3.0
"""Time on one core after the last variant: reading the runs, the table, the picture and the JSON [s]."""

SHORT, LONG, ONLY_TWO = 0.3, 2.0, 5.0
"""Limits of run times [s] for many repeats, for timing runs that write frames, and for two repeats.

Shorter runs than the first have many repeats; from the second on a run is timed while it also writes its frames, which do not
matter there; from the third on two runs give the spread.
"""

MANY = 7
"""Least number of repeats of short variants: it averages out disturbances, and they are cheap."""


def repeats_of(seconds: float, wished: int) -> int:
    """Return the number of timings of a variant of this duration; 0 and 1 stay."""
    if wished < 2:
        return wished
    if seconds > ONLY_TWO:
        return 2
    return max(wished, MANY) if seconds < SHORT else wished


@dataclass(frozen=True)
class Costs:
    """Measured seconds of one run of a copy.

    `own`: with the scene's settings; `springs`: with `max_springs` springs, the largest number (None without such a level);
    `finest`: with the finest law, `best`; `other`: with the other integrator.
    """

    own: float
    max_springs: int
    springs: float | None
    best: Law
    finest: float
    other: float
    scale: float = 1.0

    def of(self, variant: Variant, base: Base) -> float:
        """Return the expected seconds of a run of a variant: linear in the springs and in the number of steps."""
        law: Law = (variant.level, variant.springs)
        if variant.integrator != base.kind:
            seconds = self.other
        elif law == self.best:
            seconds = self.finest
        elif self.springs is None or variant.springs is None or law == (base.level, base.springs):
            seconds = self.own
        else:
            first = base.springs or 0
            each = (self.springs - self.own) / (self.max_springs - first) if self.max_springs > first else 0.0
            seconds = max(self.own + each * (variant.springs - first), 0.1 * self.own)
        seconds /= min(variant.speed, 1.0)  # a faster plate saves nothing while the debris settles
        return min(LIMIT, self.scale * seconds / (variant.factor if variant.integrator == "explicit" else variant.factor**0.5))


OPTIONAL, DEAR = ("springs", "other"), 0.1
"""Variants that are not tried where that would exceed this fraction of the remaining time."""


@dataclass(frozen=True)
class Overheads:
    """Mean seconds of one core that variants need in addition to their integration.

    `first`: where the law was not yet compiled in the process; `others`: all others.
    """

    first: float = 0.0
    others: float = 0.0
    counts: tuple[int, int] = (0, 0)

    def with_answer(self, answer: Mapping[str, Any], first: bool) -> Overheads:
        """Return the means including those of one more variant."""
        seconds = max(0.0, answer.get("used_cpu", 0.0) - answer.get("cpu_s", 0.0))
        compiled = answer.get("compile_s", 0.0) if first else 0.0
        n, m = self.counts
        others = (m * self.others + seconds - compiled) / (m + 1)
        if not first:
            return replace(self, others=others, counts=(n, m + 1))
        return Overheads((n * self.first + seconds) / (n + 1), others, (n + 1, m + 1))


def measure_costs(
    worker: Worker,
    variants: Sequence[Variant],
    base: Base,
    folder: Path,
    plugins: Sequence[str | Path],
    maximum: float,
    until: float,
) -> tuple[Costs, Overheads]:
    """Return the costs of the saved copy: the costliest variants are tried, `maximum` seconds of one core each.

    Raises Overdue at `until`.
    """
    plain = [variant for variant in variants if variant.factor == 1.0 and variant.axis in ("law", "integrator")]
    laws = [variant for variant in plain if variant.axis == "law"]
    springs = [variant for variant in laws if variant.springs is not None]
    tried = {
        "own": next((variant for variant in laws if variant.default), laws[0]),
        "finest": laws[-1],
        "other": next((variant for variant in plain if variant.axis == "integrator"), laws[0]),
    } | ({"springs": springs[-1]} if springs else {})
    seconds: dict[str, float] = {}
    overheads = Overheads()
    for name, variant in tried.items():
        left = (until - time.perf_counter()) / worker.pace
        if name in OPTIONAL and overheads.first + maximum > DEAR * left:
            continue
        job = request(folder / SCENE_FILE, folder / RUNS / "costliest" / name, variant.changes, plugins, maximum)
        report = worker.request({"do": "run", **job}, until)
        overheads = overheads.with_answer(report, True)
        # one that stops early, or cannot run, costs little
        seconds[name] = report["cpu_s"] / report["done"] if report.get("done") else 0.0
    seconds.setdefault("other", seconds["own"])
    finest = springs[-1].springs or 0 if springs else 0
    costs = Costs(
        seconds["own"], finest, seconds.get("springs"), (laws[-1].level, laws[-1].springs), seconds["finest"], seconds["other"]
    )
    return costs, overheads


def whole(variants: Sequence[Variant], base: Base, costs: Costs, repeats: int, fraction: float = 1.0) -> float:
    """Return the seconds of all variants together when each run takes a fraction of its time in the probed copy."""
    total = 0.0
    for variant in variants:
        seconds = fraction * costs.of(variant, base)
        times = repeats_of(seconds, 1 if variant.axis == "nudged" else repeats)
        total += seconds * (times + (seconds <= LONG))  # a short run's first one is not timed
    return total


def fitting(variants: Sequence[Variant], base: Base, costs: Costs, repeats: int, margin: float) -> float:
    """Return the fraction of the copy whose variants take `margin` seconds of one core, at most 4 and at least 1 %."""
    fraction = 4.0
    while fraction > 0.01 and whole(variants, base, costs, repeats, fraction) > margin:
        fraction *= 0.97
    return fraction


class Budget:
    """Wall time of a study, from its first line to its last."""

    def __init__(self, seconds: float) -> None:
        self.seconds, self.began = seconds, time.perf_counter()

    def spent(self) -> float:
        """Return the seconds since the study began."""
        return time.perf_counter() - self.began

    def end(self, pace: float) -> float:
        """Return the deadline of the last variant ([s] of `time.perf_counter`), on a machine of this pace."""
        return self.began + self.seconds - FINISH * pace

    def refuse(self, what: str, more: float) -> UsageError:
        """Return the error of a budget too small for the smallest set of variants; `more`: missing seconds."""
        needed = 1.2 * (self.spent() + more)
        return UsageError(
            f"--budget {duration(self.seconds)}: too short for the smallest ladder of this scene (its own settings and the "
            f"reference): {what}; about {duration(needed)} are needed on this machine at its present load"
        )
