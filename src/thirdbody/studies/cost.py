"""Cost of accuracy: variants of one scene, each run in a separate process and compared with the finest of them."""

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from thirdbody.errors import UsageError
from thirdbody.scene.model import Scene
from thirdbody.studies.compare import errors
from thirdbody.studies.study_setup import StudySource, prepare_study
from thirdbody.studies.time_budget import BUDGET, Budget
from thirdbody.studies.timing_statistics import slower
from thirdbody.studies.variant_result import Row
from thirdbody.studies.variant_runs import VariantRuns
from thirdbody.studies.worker_process import Worker

REPEATS = 3
JSON_FILE, PICTURE = "cost.json", "cost.png"

GOOD, SAME = 0.01, 0.01
"""Friction error and fraction of changed labels that a recommended variant may have."""

Log = Callable[[str], None]


@dataclass
class Study:
    """Completed study, with the scene that was computed.

    `alone`: bodies of the scene meet, those of the computed copy do not; `budget`, `elapsed`: of the whole study [s].
    """

    scene: str
    title: str
    reduction: list[str]
    machine: dict[str, Any]
    rows: list[Row]
    alone: bool = False
    budget: float = BUDGET
    elapsed: float = math.nan

    @property
    def default(self) -> Row | None:
        """Variant with the settings of the scene itself."""
        return next((row for row in self.rows if row.variant.default), None)

    @property
    def reference(self) -> Row:
        """Reference of the errors: the finest variant that finished."""
        return next(row for row in reversed(self.rows) if row.variant.reference)


def study(
    path: Path, folder: Path, settings: Mapping[str, Any] | None = None, plugins: Sequence[str | Path] = (),
    repeats: int = REPEATS, log: Log = lambda text: None, verify: bool = False, budget: float = BUDGET,
) -> Study:  # fmt: skip
    """Compute the variants of a scene file; runs remain in `folder`/variants. Raises ThirdbodyError for an invalid scene.

    The scene is reduced until its variants should finish within `budget` seconds; variants without time are omitted and marked.
    Errors are relative to the last variant, or, where that one failed, to the slowest other one that finished. Raises UsageError
    for a budget that cannot hold the scene's own variant and the reference.
    """
    from thirdbody.studies.machine_info import machine

    if repeats < 2:
        raise UsageError(f"--repeats {repeats}: at least 2, to know the scatter of the times")
    clock = Budget(budget)
    scene = Scene.load(path, plugins)
    scene = scene.with_settings(settings) if settings else scene
    with Worker() as worker:
        setup = prepare_study(StudySource(path, settings or {}, folder, plugins), repeats, verify, clock, worker, log)
        runs = VariantRuns(worker, folder, plugins, setup.base, setup.costs, setup.overheads, clock, log)
        rows = runs.rows(setup.variants, repeats)
    _one_pace(rows)
    built = Study(str(path), scene.title, setup.reduction, machine(), rows, setup.alone, budget)
    compute_errors(built)
    return built


def _one_pace(rows: Sequence[Row]) -> None:
    """Scale the seconds of variants that alternated with the scene's own to one pace of the machine, that of its median."""
    paces = [seconds for row in rows for seconds in row.beside]
    for row in rows:
        if row.beside:
            row.cpu = [cpu * statistics.median(paces) / own for cpu, own in zip(row.cpu, row.beside, strict=True)]


def compute_errors(built: Study) -> None:
    """Compute the errors of all rows against the reference, which is replaced where the finest variant failed."""
    rows = built.rows
    if not rows[-1].stable:
        whole = [row for row in rows if row.stable and row.variant.axis == "law"]
        if not whole:
            raise UsageError(f"no variant of {built.scene} finished: {rows[0].message or rows[-1].message}")
        for row in rows:
            row.variant = replace(row.variant, reference=row is whole[-1])
    reference = built.reference.outcome
    assert reference is not None  # a stable run has frames
    for row in rows:
        if row.outcome is not None:
            row.errors = errors(row.outcome, reference)


def figure_of_merit(built: Study) -> str:
    """Return the error on the axis of the front: friction, or the load (gap) of a scene without a drag."""
    known = [row.errors.get("friction_error", math.nan) for row in built.rows if row.stable]
    return "friction_error" if any(math.isfinite(x) for x in known) else "load_error"


def efficient(built: Study) -> list[Row]:
    """Return the Pareto front by time: variants for which no other one is both as accurate and significantly faster.

    A variant that is less accurate than one of equal time within the spread is excluded. The reference, whose error is zero by
    definition, is the last.
    """
    merit = figure_of_merit(built)
    rows = [row for row in built.rows if row.stable and is_choice(row) and math.isfinite(row.errors[merit])]
    saved = [row for row in rows if row is built.reference or not any(_beaten(row, other, merit) for other in rows)]
    return sorted(saved, key=lambda row: (row is built.reference, row.seconds))


def _beaten(row: Row, other: Row, merit: str) -> bool:
    """Return whether another variant is more accurate and not significantly slower, or as accurate and faster."""
    error, better = row.errors[merit], other.errors[merit]
    if better == error:
        return (other.seconds, id(other)) < (row.seconds, id(row))
    return better < error and not slower(other.timing, row.timing)


def is_choice(row: Row) -> bool:
    """Return whether a variant may be recommended: those that only measure an error are not."""
    return row.variant.axis != "verify" and row.variant.speed >= 1.0


def speed_error(built: Study) -> tuple[float, float]:
    """Return what the scene's own speed costs in accuracy: the lowest speed over it, and the error against that variant.

    In friction, or in the load (`figure_of_merit`), with the same law and step; NaN without such a variant.
    """
    own = built.default
    slower = min(
        (row for row in built.rows if row.stable and row.variant.speed < 1.0), key=lambda row: row.variant.speed, default=None
    )
    if own is None or slower is None or own.outcome is None or slower.outcome is None:
        return math.nan, math.nan
    return slower.variant.speed, errors(own.outcome, slower.outcome)[figure_of_merit(built)]


def possible(built: Study, row: Row) -> bool:
    """Return whether the scene itself costs as much: with the implicit integrator bodies that meet cost more."""
    return not (built.alone and row.integrator == "implicit")


def recommended(built: Study) -> tuple[Row, str]:
    """Return the recommended variant, and the reason in words.

    The fastest of those whose friction is right to 1 % and that change at most 1 % of the labels, else the most accurate one of
    the front. Times within their spread are equal: of such variants the scene's own is preferred, else the most accurate one.
    Variants with which the scene itself cannot be computed are reported separately.
    """
    merit = figure_of_merit(built)
    fit = Study(built.scene, built.title, [], {}, [row for row in built.rows if possible(built, row)])
    rows = [row for row in efficient(fit) if not row.variant.reference] or [built.reference]
    good = [row for row in fit.rows if row.stable and is_choice(row) and not row.variant.reference and _good(row, merit)]
    ties = _ties(good)
    default = built.default
    row = _best_of(ties, merit, default) if good else rows[-1]
    own = ", the variant of the scene," if row is default else ""
    what = "friction" if merit == "friction_error" else "load"
    words = [f"`{row.variant.name}`{own} gives {percent(row.errors[merit])} {what} error"]
    if default is not None and default.stable and default is not row:
        words.append(f" at {_ratio(row, default)} `{default.variant.name}` ({percent(default.errors[merit])})")
    words.append(_of_labels(row))
    others = [other.variant.name for other in ties if other is not row]
    if good and others:
        words.append(f"; {_listed(others)} take{'s' if len(others) == 1 else ''} the same time within the spread")
    if not good:
        words.append("; no variant is within 1 % in both: bodies that tip make the rest")
    faster = _best_of(_ties([other for other in built.rows if other.stable and not possible(built, other) and _good(other,
                                                                                            merit)]),
                    merit, None)  # fmt: skip
    if faster is not None and slower(row.timing, faster.timing):
        words.append(f"; if bodies need not see each other (contact.debris_contact = \"none\"), `{faster.variant.name}` gives "
                     f"{percent(faster.errors[merit])} in {faster.seconds / row.seconds:.2g} times that time"
                     f"{_of_labels(faster)}")  # fmt: skip
    return row, "".join(words)


def _ties(rows: Sequence[Row]) -> list[Row]:
    """Return the fastest of these variants, and those that are not significantly slower."""
    if not rows:
        return []
    first = min(rows, key=lambda row: row.seconds + row.timing.half)
    return [row for row in rows if not slower(row.timing, first.timing)]


def _best_of(rows: Sequence[Row], merit: str, default: Row | None) -> Any:
    """Return, of variants of equal time, the scene's own, else the most accurate one; None for none."""
    return next((row for row in rows if row is default), min(rows, key=lambda row: row.errors[merit], default=None))


def _ratio(row: Row, default: Row) -> str:
    """Return the cost of a variant over that of the scene's own in words; none where the spread exceeds the difference."""
    if not slower(row.timing, default.timing) and not slower(default.timing, row.timing):
        return "the same cost, within the spread, as"
    return f"{row.seconds / default.seconds:.2g} times the cost of"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _good(row: Row, merit: str) -> bool:
    return row.errors[merit] <= GOOD and not row.errors["label_difference"] > SAME


def _of_labels(row: Row) -> str:
    labels = row.errors["label_difference"]
    if math.isnan(labels):
        return ""
    return "; no label changes" if labels == 0.0 else f"; {percent(labels)} of the labels differ"


def percent(fraction: float) -> str:
    """Return a fraction in per cent, two digits."""
    return f"{100.0 * fraction:.2g} %"


def as_json(built: Study) -> dict[str, Any]:
    """Return the whole study for JSON; numbers in SI or relative."""
    default, (row, words) = built.default, recommended(built)
    base = default.seconds if default is not None and default.stable else math.nan
    onfront = efficient(built)
    return {
        "scene": built.scene,
        "title": built.title,
        "machine": built.machine,
        "reduction": built.reduction,
        "apart": built.alone,
        "budget_s": built.budget,
        "took_s": built.elapsed,
        "reference": built.reference.variant.name,
        "recommended": {"variant": row.variant.name, "words": words},
        "speed_error": speed_error(built)[1],
        "variants": [
            {
                "name": entry.variant.name,
                "axis": entry.variant.axis,
                "level": entry.variant.level,
                "springs": entry.variant.springs,
                "integrator": entry.integrator,
                "speed": entry.variant.speed,
                "step": entry.step,
                "wall_s": entry.wall_seconds,
                "wall_spread_s": [min(entry.wall), max(entry.wall)] if entry.wall else None,
                "cpu_s": entry.seconds,
                "cpu_spread_s": [min(entry.cpu), max(entry.cpu)] if entry.cpu else None,
                "yardstick_s": statistics.median(entry.beside) if entry.beside else None,
                "cpu_uncertainty_s": entry.timing.half if entry.cpu else None,
                "repeats": len(entry.wall),
                "time_ratio": entry.seconds / base,
                **{name: entry.errors.get(name, math.nan) for name in ERRORS},
                "energy_residual": None if entry.outcome is None else entry.outcome.residual,
                "stable": entry.stable,
                "message": entry.message,
                "default": entry.variant.default,
                "reference": entry.variant.reference,
                "on_front": any(entry is other for other in onfront),
            }
            for entry in built.rows
            if entry.variant.axis != "verify"
        ],
    }


ERRORS = ("friction_error", "load_error", "position_error", "rotation_error", "label_difference", "dissipation_error")
