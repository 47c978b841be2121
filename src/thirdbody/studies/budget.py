"""How large a copy of a scene may be for its whole ladder to end within a budget of time: from measured times of rungs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .ladder import Base, Law, Rung
from .process import LIMIT, RUNGS, SCENE_FILE, in_process

BUDGET = 420.0
"""Seconds that a whole study may take, from its first line to its last."""

PROBE = 2.0
"""Seconds of one core that a rung is tried for."""

EACH, END = 3.5, 20.0
"""Seconds for the start of a rung's process with what it compiles; for building the copy again and all after the last rung."""

SHORT, LONG, TWICE = 0.3, 2.0, 5.0
"""Of runs shorter than the first a repeat is a batch, and repeats are many; from the second on a run is timed while it writes its
frames too, for they do not matter there; from the third on two runs tell the spread."""

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
    without such a level), `most` of them; with the finest law, `best`; with the `other` integrator."""

    own: float
    most: int
    springs: float | None
    best: Law
    finest: float
    other: float

    def of(self, rung: Rung, base: Base) -> float:
        """Seconds that a run of a rung will take: linear in the springs and in the number of steps."""
        law: Law = (rung.level, rung.springs)
        if rung.integrator != base.kind:
            seconds = self.other
        elif law == self.best:
            seconds = self.finest
        elif self.springs is None or rung.springs is None or law == (base.level, base.springs):
            seconds = self.own
        else:
            first = base.springs or 0
            each = (self.springs - self.own) / (self.most - first) if self.most > first else 0.0
            seconds = max(self.own + each * (rung.springs - first), 0.1 * self.own)
        return min(LIMIT, seconds / rung.factor if rung.integrator == "explicit" else seconds / rung.factor**0.5)


def probed(rungs: Sequence[Rung], base: Base, folder: Path, plugins: Sequence[str | Path]) -> Costs:
    """The costs of the copy that is saved in a study's folder: the costliest rungs are tried, and compiled, in one process."""
    plain = [rung for rung in rungs if rung.factor == 1.0 and rung.axis in ("law", "integrator")]
    laws = [rung for rung in plain if rung.axis == "law"]
    springs = [rung for rung in laws if rung.springs is not None]
    tried = {
        "own": next((rung for rung in laws if rung.default), laws[0]),
        "finest": laws[-1],
        "other": next((rung for rung in plain if rung.axis == "integrator"), laws[0]),
    } | ({"springs": springs[-1]} if springs else {})
    variants = [rung.changes for rung in tried.values()]
    found = in_process(folder / SCENE_FILE, folder / RUNGS / "costliest", variants, plugins, 0, PROBE)
    # one that stops early, or cannot run, costs little
    took = {name: told["cpu_s"] / told["done"] if told.get("done") else 0.0 for name, told in zip(tried, found, strict=True)}
    most = springs[-1].springs or 0 if springs else 0
    return Costs(took["own"], most, took.get("springs"), (laws[-1].level, laws[-1].springs), took["finest"], took["other"])


def whole(rungs: Sequence[Rung], base: Base, costs: Costs, repeats: int, share: float = 1.0) -> float:
    """Seconds that all rungs take together when each run takes a share of what it took in the copy that was probed."""
    total = 0.0
    for rung in rungs:
        seconds = share * costs.of(rung, base)
        times = repeats_of(seconds, 1 if rung.axis == "verify" else repeats)
        total += seconds * (times + (seconds <= LONG))  # a short run's first one is not timed
    return total


def fitting(rungs: Sequence[Rung], base: Base, costs: Costs, repeats: int, left: float) -> float:
    """The share of the copy whose ladder takes `left` seconds, at most 4 and at least 1 %."""
    share, room = 4.0, left - EACH * len(rungs) - END
    while share > 0.01 and whole(rungs, base, costs, repeats, share) > room:
        share *= 0.97
    return share
