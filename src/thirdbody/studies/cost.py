"""Cost of accuracy: variants of one scene, each run in a separate process and compared with the finest of them."""

import itertools
import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
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

    `scatter`: largest errors of runs against each other whose starts differ by 1e-9, empty where bodies do not meet: smaller
    errors mean nothing; `budget`, `elapsed`: of the whole study [s].
    """

    scene: str
    title: str
    reduction: list[str]
    machine: dict[str, Any]
    rows: list[Row]
    scatter: Mapping[str, float] = field(default_factory=dict)
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
    repeats: int = REPEATS, log: Log = lambda text: None, budget: float = BUDGET,
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
        setup = prepare_study(StudySource(path, settings or {}, folder, plugins), repeats, clock, worker, log)
        runs = VariantRuns(worker, folder, plugins, setup.base, setup.costs, setup.overheads, clock, log)
        rows = runs.rows(setup.variants, repeats)
    _one_pace(rows)
    built = Study(str(path), scene.title, setup.reduction, machine(), rows, budget=budget)
    compute_errors(built)
    return built


def _one_pace(rows: Sequence[Row]) -> None:
    """Scale the seconds of variants that alternated with the scene's own to one pace of the machine, that of its median."""
    paces = [seconds for row in rows for seconds in row.beside]
    for row in rows:
        if row.beside:
            row.cpu = [cpu * statistics.median(paces) / own for cpu, own in zip(row.cpu, row.beside, strict=True)]


def compute_errors(built: Study) -> None:
    """Compute the errors of all rows against the reference, which is replaced where the finest variant failed; the scatter."""
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
    same = [row.outcome for row in rows if (row.variant.default or row.variant.axis == "nudged") and row.stable]
    pairs = [errors(a, b) for a, b in itertools.combinations([outcome for outcome in same if outcome is not None], 2)]
    built.scatter = {name: max(pair[name] for pair in pairs) for name in ERRORS} if pairs else {}


def is_chaotic(built: Study) -> bool:
    """Return whether runs whose starts differ by 1e-9 part further than a recommended variant may be wrong."""
    return built.scatter.get("friction_error", 0.0) > GOOD or built.scatter.get("label_difference", 0.0) > SAME


def figure_of_merit(built: Study) -> str:
    """Return the error on the axis of the front: friction, or the load (gap) of a scene without a drag.

    Where runs part, that of the mean friction.
    """
    known = [row.errors.get("friction_error", math.nan) for row in built.rows if row.stable]
    if not any(math.isfinite(x) for x in known):
        return "load_error"
    return "mean_friction_error" if is_chaotic(built) else "friction_error"


def merit_in_words(built: Study) -> str:
    """Return the name of `figure_of_merit` in sentences."""
    return {"friction_error": "friction", "mean_friction_error": "mean friction", "load_error": "load"}[figure_of_merit(built)]


def significant_error(built: Study, row: Row, merit: str) -> float:
    """Return an error of a variant, at least the scatter of runs from starts 1e-9 apart: smaller ones are equal."""
    return max(row.errors[merit], built.scatter.get(merit, 0.0))


def efficient(built: Study) -> list[Row]:
    """Return the Pareto front by time: variants for which no other one is both as accurate and significantly faster.

    A variant that is less accurate than one of equal time within the spread is excluded. The reference, whose error is zero by
    definition, is the last.
    """
    merit = figure_of_merit(built)
    rows = [row for row in built.rows if row.stable and is_choice(row) and math.isfinite(row.errors[merit])]
    saved = [row for row in rows if row is built.reference or not any(_beaten(built, row, other, merit) for other in rows)]
    return sorted(saved, key=lambda row: (row is built.reference, row.seconds))


def _beaten(built: Study, row: Row, other: Row, merit: str) -> bool:
    """Return whether another variant is more accurate and not significantly slower, or as accurate and faster."""
    error, better = significant_error(built, row, merit), significant_error(built, other, merit)
    if better == error:
        return (other.seconds, id(other)) < (row.seconds, id(row))
    return better < error and not slower(other.timing, row.timing)


def is_choice(row: Row) -> bool:
    """Return whether a variant may be recommended: those that only measure an error are not."""
    return row.variant.axis not in ("nudged", "meeting") and row.variant.speed >= 1.0


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


def recommended(built: Study) -> tuple[Row, str]:
    """Return the recommended variant, and the reason in words.

    The fastest of those whose friction is right to 1 % and that change at most 1 % of the labels, else the most accurate one of
    the front. Times within their spread are equal: of such variants the scene's own is preferred, else the most accurate one.
    Where runs from starts 1e-9 apart differ by more than 1 %, the mean friction and the shares of the states decide, and errors
    below that scatter are equal. A run whose bodies do not meet is reported separately.
    """
    merit = figure_of_merit(built)
    rows = [row for row in efficient(built) if not row.variant.reference] or [built.reference]
    good = [row for row in built.rows if row.stable and is_choice(row) and not row.variant.reference and _good(built, row)]
    ties = _ties(good)
    default = built.default
    row = _best_of(built, ties) if good else rows[-1]
    own = ", the variant of the scene," if row is default else ""
    words = [f"`{row.variant.name}`{own} gives {percent(row.errors[merit])} {merit_in_words(built)} error"]
    if default is not None and default.stable and default is not row:
        words.append(f" at {_ratio(row, default)} `{default.variant.name}` ({percent(default.errors[merit])})")
    words.append(_of_labels(built, row))
    others = [other.variant.name for other in ties if other is not row]
    if good and others:
        words.append(f"; {_listed(others)} take{'s' if len(others) == 1 else ''} the same time within the spread")
    if not good:
        words.append("; no variant is within 1 % in both: bodies that tip make the rest")
    alone = next((other for other in built.rows if other.variant.axis == "meeting" and other.stable), None)
    if alone is not None and default is not None and default.stable:
        words.append(f"; without contact between bodies (contact.debris_contact = \"none\") {merit_in_words(built)} is off by "
                     f"{percent(alone.errors[merit])}, in {alone.seconds / default.seconds:.2g} times the time of "
                     f"`{default.variant.name}`{_of_labels(built, alone)}")  # fmt: skip
    return row, "".join(words)


def _ties(rows: Sequence[Row]) -> list[Row]:
    """Return the fastest of these variants, and those that are not significantly slower."""
    if not rows:
        return []
    first = min(rows, key=lambda row: row.seconds + row.timing.half)
    return [row for row in rows if not slower(row.timing, first.timing)]


def _best_of(built: Study, rows: Sequence[Row]) -> Row:
    """Return, of variants of equal time, the scene's own, else the most accurate one, of equally accurate ones the fastest."""
    merit = figure_of_merit(built)
    own = next((row for row in rows if row is built.default), None)
    return own or min(rows, key=lambda row: (significant_error(built, row, merit), row.seconds))


def _ratio(row: Row, default: Row) -> str:
    """Return the cost of a variant over that of the scene's own in words; none where the spread exceeds the difference."""
    if not slower(row.timing, default.timing) and not slower(default.timing, row.timing):
        return "the same cost, within the spread, as"
    return f"{row.seconds / default.seconds:.2g} times the cost of"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _good(built: Study, row: Row) -> bool:
    merit, labels = figure_of_merit(built), "state_fraction_error" if is_chaotic(built) else "label_difference"
    limits = max(GOOD, built.scatter.get(merit, 0.0)), max(SAME, built.scatter.get(labels, 0.0))
    return row.errors[merit] <= limits[0] and not row.errors[labels] > limits[1]


def _of_labels(built: Study, row: Row) -> str:
    labels, apart = row.errors["label_difference"], built.scatter.get("label_difference", 0.0)
    if math.isnan(labels):
        return ""
    if labels == 0.0:
        return "; no label changes"
    return f"; {percent(labels)} of the labels differ" + (f" ({percent(apart)} from starts 1e-9 apart)" if apart > 0.0 else "")


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
        "scatter": dict(built.scatter),
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
        ],
    }


ERRORS = ("friction_error", "load_error", "position_error", "rotation_error", "label_difference", "dissipation_error",
          "mean_friction_error", "mean_position_error", "state_fraction_error")  # fmt: skip
