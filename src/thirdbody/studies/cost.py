"""What accuracy costs in time: a ladder of rungs for one scene, each in a process of its own, against the finest of them."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from thirdbody.errors import UsageError
from thirdbody.scene.model import Scene

from .budget import BUDGET, END, SHORT
from .compare import Outcome, errors, front, read_outcome
from .ladder import Rung
from .process import RUNGS, SCENE_FILE, in_process
from .stage import staged

REPEATS = 3
JSON_FILE, PICTURE = "cost.json", "cost.png"

GOOD, SAME = 0.01, 0.01
"""Friction error and share of changed labels that a recommended rung may have."""

Tell = Callable[[str], None]


@dataclass
class Row:
    """One rung as it came out. `wall`, `cpu`: seconds of its repeats; `outcome`: None for a rung that gave nothing; `place`: the
    folder of its run, beside those of the other rungs; `beside`: seconds of the scene's own rung, in turns with it."""

    rung: Rung
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    stable: bool = False
    message: str = ""
    integrator: str = ""
    step: float | None = None
    outcome: Outcome | None = None
    errors: dict[str, float] = field(default_factory=dict)
    place: str = ""
    beside: list[float] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """What the rung costs: median of the processor's seconds over the repeats, NaN without any."""
        return statistics.median(self.cpu) if self.cpu else math.nan

    @property
    def wall_seconds(self) -> float:
        """Median of the wall's seconds over the repeats, NaN without any."""
        return statistics.median(self.wall) if self.wall else math.nan


@dataclass
class Study:
    """A ladder that was climbed, with the scene that it was climbed with.

    `alone`: bodies of the scene meet, those of the copy that was climbed do not; `budget`, `took`: seconds of the whole study.
    """

    scene: str
    title: str
    reduction: list[str]
    machine: dict[str, Any]
    rows: list[Row]
    alone: bool = False
    budget: float = BUDGET
    took: float = math.nan

    @property
    def default(self) -> Row | None:
        """What the scene itself asks for."""
        return next((row for row in self.rows if row.rung.default), None)

    @property
    def reference(self) -> Row:
        """What errors are against: the finest rung that came to its end."""
        return next(row for row in reversed(self.rows) if row.rung.reference)


def study(
    path: Path, folder: Path, settings: Mapping[str, Any] | None = None, plugins: Sequence[str | Path] = (),
    repeats: int = REPEATS, tell: Tell = lambda text: None, verify: bool = False, budget: float = BUDGET,
) -> Study:  # fmt: skip
    """Climb the ladder of a scene file; runs are left in `folder`/rungs. Raises ThirdbodyError for a scene that cannot be built.

    The scene is reduced until its ladder should end within `budget` seconds; where it gets late all the same, rungs that have
    been timed once are not repeated. Errors are against the last rung, or, where that one failed, against the slowest other one
    that came to its end.
    """
    from .machine import machine

    if repeats < 2:
        raise UsageError(f"--repeats {repeats}: at least 2, or nothing tells how much times spread")
    scene = Scene.load(path)
    scene = scene.with_settings(settings) if settings else scene
    began, began_at = time.perf_counter(), time.time()
    stage = staged(scene, folder, plugins, repeats, verify, began + budget, tell)
    own = next((rung.changes for rung in stage.rungs if rung.default), None) if stage.seconds < SHORT else None
    rows = []
    for number, rung in enumerate(stage.rungs, 1):
        tell(f"rung {number} of {len(stage.rungs)}: {rung.name}")
        times = 1 if rung.axis == "verify" else repeats  # of those nothing is timed
        name = f"{number:02d}_{_slug(rung.name)}"
        rows.append(climb(folder, rung, name, plugins, times, own, began_at + budget - END))
        tell(f"  {rows[-1].seconds:.3g} s" if rows[-1].stable else f"  {rows[-1].message}")
    _one_pace(rows)
    made = Study(str(path), scene.title, stage.reduction, machine(), rows, stage.alone, budget)
    judge(made)
    return made


def _one_pace(rows: Sequence[Row]) -> None:
    """Put the seconds of rungs that took turns with the scene's own to one pace of the machine, that of its median."""
    paces = [seconds for row in rows for seconds in row.beside]
    for row in rows:
        if row.beside:
            row.cpu = [cpu * statistics.median(paces) / own for cpu, own in zip(row.cpu, row.beside, strict=True)]


def climb(
    folder: Path, rung: Rung, name: str, plugins: Sequence[str | Path], repeats: int, own: Mapping[str, Any] | None = None,
    until: float = math.inf,
) -> Row:  # fmt: skip
    """One rung, in a process of its own; a short one in turns with the scene's `own`, by these changes. `until`: as there."""
    place = folder / RUNGS / name
    found = in_process(folder / SCENE_FILE, place, [rung.changes], plugins, repeats, beside=own, until=until)[0]
    row = Row(rung, found["wall"], found["cpu"], found["stable"], found["message"], found.get("integrator") or rung.integrator,
              found.get("step"), place=name, beside=found.get("beside", []))  # fmt: skip
    if found["wall"]:
        row.outcome = read_outcome(place / "0")
    return row


def judge(made: Study) -> None:
    """Errors of all rows against the reference. Another one takes its place where the finest rung failed."""
    rows = made.rows
    if not rows[-1].stable:
        whole = [row for row in rows if row.stable and row.rung.axis == "law"]
        if not whole:
            raise UsageError(f"no rung of {made.scene} came to its end: {rows[0].message or rows[-1].message}")
        for row in rows:
            row.rung = replace(row.rung, reference=row is whole[-1])
    reference = made.reference.outcome
    assert reference is not None  # a stable run has frames
    for row in rows:
        if row.outcome is not None:
            row.errors = errors(row.outcome, reference)


def figure_of_merit(made: Study) -> str:
    """The error that the front is drawn with: friction, or the load (gap) of a scene without a drag."""
    known = [row.errors.get("friction_error", math.nan) for row in made.rows if row.stable]
    return "friction_error" if any(math.isfinite(x) for x in known) else "load_error"


def efficient(made: Study) -> list[Row]:
    """The rungs that no other one beats in both time and error, by time; the reference, whose error is zero by definition, ends
    them."""
    rows = [row for row in made.rows if row.stable and row.rung.axis != "verify"]
    merit = figure_of_merit(made)
    return [rows[k] for k in front([(row.seconds, row.errors[merit]) for row in rows])]


def possible(made: Study, row: Row) -> bool:
    """Whether the scene itself could be computed like this: the implicit integrator has no contact between bodies."""
    return not (made.alone and row.integrator == "implicit")


def recommended(made: Study) -> tuple[Row, str]:
    """One rung, and why in words: the fastest whose friction is right to 1 % and that changes at most 1 % of the labels, else the
    most accurate one of the front. Rungs that the scene itself cannot be computed with are told beside it."""
    merit = figure_of_merit(made)
    fit = Study(made.scene, made.title, [], {}, [row for row in made.rows if possible(made, row)])
    rows = [row for row in efficient(fit) if not row.rung.reference] or [made.reference]
    good = [row for row in rows if _good(row, merit)]
    row = good[0] if good else rows[-1]
    default = made.default
    own = ", what the scene asks for," if row is default else ""
    what = "friction" if merit == "friction_error" else "load"
    words = [f"`{row.rung.name}`{own} gives {percent(row.errors[merit])} {what} error"]
    if default is not None and default.stable and default is not row:
        words.append(f" at {row.seconds / default.seconds:.2g} times the cost of `{default.rung.name}`"
                     f" ({percent(default.errors[merit])})")  # fmt: skip
    words.append(_of_labels(row))
    if not good:
        words.append("; no rung is within 1 % in both: bodies that tip make the rest")
    faster = next((other for other in efficient(made) if not possible(made, other) and _good(other, merit)), None)
    if faster is not None and faster.seconds < row.seconds:
        words.append(f"; if bodies need not see each other (contact.debris_contact = \"none\"), `{faster.rung.name}` gives "
                     f"{percent(faster.errors[merit])} in {faster.seconds / row.seconds:.2g} times that time"
                     f"{_of_labels(faster)}")  # fmt: skip
    return row, "".join(words)


def _good(row: Row, merit: str) -> bool:
    return row.errors[merit] <= GOOD and not row.errors["label_difference"] > SAME


def _of_labels(row: Row) -> str:
    labels = row.errors["label_difference"]
    if math.isnan(labels):
        return ""
    return "; no label changes" if labels == 0.0 else f"; {percent(labels)} of the labels differ"


def percent(share: float) -> str:
    """A share in per cent, two digits."""
    return f"{100.0 * share:.2g} %"


def as_json(made: Study) -> dict[str, Any]:
    """The whole study as it is written; numbers in SI or relative."""
    default, (row, words) = made.default, recommended(made)
    base = default.seconds if default is not None and default.stable else math.nan
    onfront = efficient(made)
    return {
        "scene": made.scene,
        "title": made.title,
        "machine": made.machine,
        "reduction": made.reduction,
        "apart": made.alone,
        "budget_s": made.budget,
        "took_s": made.took,
        "reference": made.reference.rung.name,
        "recommended": {"rung": row.rung.name, "words": words},
        "rungs": [
            {
                "name": entry.rung.name,
                "axis": entry.rung.axis,
                "level": entry.rung.level,
                "springs": entry.rung.springs,
                "integrator": entry.integrator,
                "step": entry.step,
                "wall_s": entry.wall_seconds,
                "wall_spread_s": [min(entry.wall), max(entry.wall)] if entry.wall else None,
                "cpu_s": entry.seconds,
                "cpu_spread_s": [min(entry.cpu), max(entry.cpu)] if entry.cpu else None,
                "yardstick_s": statistics.median(entry.beside) if entry.beside else None,
                "repeats": len(entry.wall),
                "time_ratio": entry.seconds / base,
                **{name: entry.errors.get(name, math.nan) for name in ERRORS},
                "energy_residual": None if entry.outcome is None else entry.outcome.residual,
                "stable": entry.stable,
                "message": entry.message,
                "default": entry.rung.default,
                "reference": entry.rung.reference,
                "on_front": any(entry is other for other in onfront),
            }
            for entry in made.rows
            if entry.rung.axis != "verify"
        ],
    }


ERRORS = ("friction_error", "load_error", "position_error", "rotation_error", "label_difference", "dissipation_error")


def _slug(name: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in name).replace("__", "_")
