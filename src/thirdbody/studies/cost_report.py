"""Report of a study of cost: order of convergence of its errors, JSON, and the table for the terminal."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping
from typing import Any

from thirdbody.report.tables import table
from thirdbody.studies.cost import (
    ERRORS,
    GOOD,
    SAME,
    Row,
    Study,
    efficient,
    errors,
    figure_of_merit,
    is_chaotic,
    merit_in_words,
    order,
    percent,
    recommended,
    speed_error,
)
from thirdbody.studies.timing import described
from thirdbody.system.terminal import print_line

LEFT_OUT = "left out"  # beginning of the message of a variant that was not run
FLOOR = 1e-9  # smaller errors are rounding and define no order
FALLS = 0.7  # largest ratio of successive errors that still defines an order: half the step or the springs at order 1/2
SLOWEST = 1.0 + math.sqrt(2.0)  # least ratio of successive errors for which the error of the reference is extrapolated: order 1/2

COLUMNS = {"friction": "friction_error", "load|gap": "load_error", "position": "position_error", "turn, rad": "rotation_error",
           "labels": "label_difference", "dissipated": "dissipation_error"}  # fmt: skip
COLUMNS_OF_MEETING = {"friction": "friction_error", "its mean": "mean_friction_error", "load|gap": "load_error",
                      "mean place": "mean_position_error", "labels": "label_difference", "shares": "state_fraction_error",
                      "dissipated": "dissipation_error"}  # fmt: skip
"""Headings of the errors, and the same where bodies meet: means can be compared even where runs part."""


def convergence(built: Study) -> list[dict[str, Any]]:
    """Return series of errors with their order: `what`, `against`, `sizes` (falling), `errors`, `order` (None if unknown).

    Springs are compared with the finest law at the same step, steps with the shortest step and the same law: each with the limit
    to which it converges, which is not the reference of the study, finer in both.
    """
    result = []
    laws = [row for row in built.rows if row.variant.axis == "law"]
    stable = [row for row in laws if row.stable]
    springs = [row for row in stable if row.variant.springs is not None]
    if springs and stable[-1] in springs:  # no law without springs: the largest number of springs is the reference
        springs = springs[:-1]
    if springs:
        names = [str(row.variant.springs) for row in springs]
        sizes = [1.0 / int(name) for name in names]
        result.append(_series(built, "springs", names, sizes, [*springs, stable[-1]]))
    extra = {"step": built.default, "fine": laws[-1] if laws else None}
    for what, axis in (("step", "step"), ("other integrator's step", "integrator"), ("step of the finest law", "fine")):
        rows = [row for row in built.rows if row.variant.axis == axis and row is not built.reference]
        rows += [row for row in (extra.get(axis), built.reference if axis == "fine" else None) if row is not None]
        rows = sorted((row for row in rows if row.stable and row.step), key=lambda row: -float(row.step or 0.0))
        if len({row.integrator for row in rows}) != 1 or len(rows) < 3:
            continue
        explicit = rows[0].integrator == "explicit"
        names = [f"{row.step:.2g}{' s' if explicit else ''}" for row in rows[:-1]]
        kind = "time step" if explicit else "tolerance"
        result.append(_series(built, f"{what} ({kind})", names, [_size(row) for row in rows[:-1]], rows))
    return result


def _size(row: Row) -> float:
    """Return the step length of a variant; an implicit one goes as the square root of its error tolerance."""
    return float(row.step or 0.0) ** (1.0 if row.integrator == "explicit" else 0.5)


def _series(built: Study, what: str, names: list[str], sizes: list[float], rows: list[Row]) -> dict[str, Any]:
    merit, limit = figure_of_merit(built), rows[-1]
    assert limit.outcome is not None
    result = [errors(row.outcome, limit.outcome)[merit] if row.outcome is not None else math.nan for row in rows[:-1]]
    fitted = falling(result)
    slope = order(sizes[:fitted], [e if e > _floor(built) else math.nan for e in result[:fitted]])
    return {"what": what, "against": limit.variant.name, "sizes": names, "errors": result, "order": slope, "fitted": fitted}


def _floor(built: Study) -> float:
    """Return the largest error that defines no order: rounding, which grows where bodies meet."""
    return max(FLOOR, built.scatter.get(figure_of_merit(built), 0.0))


def falling(result: list[float]) -> int:
    """Return the number of errors from the first on that define an order.

    All before the first that is more than `FALLS` times its predecessor, where another error dominates; all where that leaves
    only one.
    """
    for k in range(1, len(result)):
        if not result[k] <= FALLS * result[k - 1]:
            return k if k > 1 else len(result)
    return len(result)


def reference_error(built: Study) -> float:
    """Return the estimated relative error of the reference itself; NaN when its steps do not allow an estimate.

    Errors C h^p against a limit of step h_L, of steps r h_L and r^2 h_L, are C h_L^p times (r^p - 1) and (r^2p - 1): their ratio
    is r^p + 1, and the error at h_L is the first one over r^p - 1 (L.F. Richardson, Phil. Trans. A 210, 1911).
    """
    merit, last = figure_of_merit(built), built.reference
    rows = [row for row in built.rows if row.stable and row.integrator == last.integrator and row.step
            and row.variant.law == last.variant.law and row is not last]  # fmt: skip
    sizes = {_size(row) / _size(last): row.errors[merit] for row in rows}
    r = min((size for size in sizes if size > 1.0), default=math.nan)
    second = next((error for size, error in sizes.items() if math.isclose(size, r * r, rel_tol=0.01)), math.nan)
    first = sizes.get(r, math.nan)
    growth = second / first if first > _floor(built) else math.nan
    return first / (growth - 2.0) if growth > SLOWEST else math.nan


def as_json(built: Study) -> dict[str, Any]:
    """Return the whole study for JSON; numbers in SI or relative."""
    default, (row, words), front = built.default, recommended(built), efficient(built)
    base = default.seconds if default is not None and default.stable else math.nan
    return {
        "scene": built.scene, "title": built.title, "machine": built.machine, "reduction": built.reduction,
        "scatter": dict(built.scatter), "budget_s": built.budget, "took_s": built.elapsed,
        "reference": built.reference.variant.name,
        "recommended": {"variant": row.variant.name, "advice": advice(built), "words": words},
        "speed_error": speed_error(built)[1],
        "variants": [_row_as_json(entry, base, entry in front) for entry in built.rows],
        "convergence": convergence(built),
        "reference_error": reference_error(built),
    }  # fmt: skip


def _row_as_json(row: Row, base: float, on_front: bool) -> dict[str, Any]:
    result = {name: getattr(row.variant, name) for name in ("name", "axis", "level", "springs", "speed", "default", "reference")}
    result |= {name: getattr(row, name) for name in ("integrator", "step", "stable", "message")}
    return result | {name: row.errors.get(name, math.nan) for name in ERRORS} | {
        "wall_s": statistics.median(row.wall) if row.wall else math.nan,
        "wall_spread_s": [min(row.wall), max(row.wall)] if row.wall else None,
        "cpu_s": row.seconds,
        "cpu_spread_s": [min(row.cpu), max(row.cpu)] if row.cpu else None,
        "yardstick_s": statistics.median(row.beside) if row.beside else None,
        "cpu_uncertainty_s": row.timing.half if row.cpu else None,
        "repeats": len(row.wall),
        "time_ratio": row.seconds / base,
        "energy_residual": None if row.outcome is None else row.outcome.residual,
        "on_front": on_front,
    }  # fmt: skip


def print_study(built: Study) -> None:
    """Print a study: its conditions, all variants, the recommended one, the convergence and the error of the reference."""
    machine, report = built.machine, as_json(built)
    print_line(f"{built.title or built.scene}: errors against {built.reference.variant.name}")
    print_line(f"reduced: {'; '.join(built.reduction) or 'nothing'}")
    print(f"budget {built.budget:.3g} s, took {built.elapsed:.3g} s")
    print(f"on {described(machine)}, {machine['cores']} cores, one used; load before: {machine['load']}")
    columns = COLUMNS_OF_MEETING if built.scatter else COLUMNS
    cells = [_cells(row, columns) for row in report["variants"]]
    if built.scatter:
        scatter = (_percent(built.scatter[name]) for name in columns.values())
        cells.append(("", "starts 1e-9 apart", *[""] * 4, *scatter, ""))
    table("", ("", "variant", "step", "seconds", "runs", "ratio", *columns, "residual"), cells)
    print("* on the front: no variant is closer in friction in the same or less time; d: as in the scene; r: reference, the end "
          "of the front; ~: how far the median may be off, below which times are ties; runs: how many are timed")  # fmt: skip
    print("seconds: of one core, for the integration from output to output; without start, compiling, building and outputs")
    if any(row.beside for row in built.rows):
        print("variants alternated with the scene's own, which refers their seconds to one speed of the machine")
    for words in filter(None, (scatter_words(built), speed_words(built))):
        print_line(words)
    for message, names in stopped(built).items():
        print_line(f"{'; '.join(names)}: {message}")
    print_line(f"recommended: {report['recommended']['words']}")
    for entry in report["convergence"]:
        values = ", ".join(f"{name}: {percent(error)}" for name, error in zip(entry["sizes"], entry["errors"], strict=True))
        slope = "not known" if math.isnan(entry["order"]) else f"{entry['order']:.2f}"
        first = f" of the first {entry['fitted']}" if entry["fitted"] < len(entry["sizes"]) else ""
        print(f"convergence with the {entry['what']} against {entry['against']}: {values}; order{first} {slope}")
    own = report["reference_error"]
    words = "not known, its steps show no order" if math.isnan(own) else f"about {percent(own)}, extrapolated from its steps"
    print(f"error of the reference itself: {words}; smaller differences are not significant")


def advice(built: Study) -> str:
    """Return in one sentence what to do: which settings to change, and what that gains and costs."""
    row, default, merit = recommended(built)[0], built.default, figure_of_merit(built)
    what, own = merit_in_words(built), None if default is None or not default.stable else default
    if own is None or row is own:
        return f"Keep {row.variant.name}: its error in {what} is {percent(row.errors[merit])}."
    keys = {key: value for key, value in row.variant.changes.items() if own.variant.changes.get(key, "auto") != value}
    settings = ", ".join(f"{key} = {value}" if value is not None else f"no {key}" for key, value in keys.items())
    gain = f"{percent(row.errors[merit])} error in {what} instead of {percent(own.errors[merit])}"
    name, of = ("state_fraction_error", "shares of states") if is_chaotic(built) else ("label_difference", "labels")
    if own.errors[merit] <= GOOD and own.errors[name] > max(SAME, row.errors[name]):  # its labels are why it is not recommended
        gain = f"{percent(row.errors[name])} of the {of} differ instead of {percent(own.errors[name])}"
    return f"Set {settings}: {gain}, in {row.seconds / own.seconds:.2g} times the time."


def scatter_words(built: Study) -> str:
    """Return in words how far runs from almost equal starts part, empty where bodies do not meet."""
    if not built.scatter:
        return ""
    names = {"friction_error": "of the friction curve", "mean_friction_error": "of its mean", "label_difference": "of the labels"}
    listed = ", ".join(f"{percent(built.scatter[name])} {words}" for name, words in names.items() if name in built.scatter)
    means = (
        "; these runs part, so mean friction and the shares of the states decide what is recommended, not curves and labels"
        if is_chaotic(built)
        else ""
    )
    return f"bodies meet: runs from starts 1e-9 apart differ by up to {listed}; smaller differences mean nothing{means}"


def speed_words(built: Study) -> str:
    """Return in words what the scene's own speed costs in accuracy, empty where it is not known."""
    speed, error = speed_error(built)
    if math.isnan(error):
        return ""
    return (
        f"speed: that of the scene costs {percent(error)} in {merit_in_words(built)}, against the same law and step at "
        f"1/{1.0 / speed:g} of it; the error of the slower variant is that difference, so it is never recommended"
    )


def stopped(built: Study) -> dict[str, list[str]]:
    """Return the names of the variants that did not finish, by their messages."""
    result: dict[str, list[str]] = {}
    for row in built.rows:
        if not row.stable:
            result.setdefault(row.message, []).append(row.variant.name)
    return result


def _cells(row: Mapping[str, Any], columns: Mapping[str, str]) -> tuple[str, ...]:
    """Return the cells of a variant as JSON has it."""
    mark = "".join(letter for letter, name in {"*": "on_front", "d": "default", "r": "reference"}.items() if row[name])
    step, unit = row["step"], " s" if row["integrator"] == "explicit" else ""
    first = mark, row["name"], "" if step is None or math.isnan(step) else f"{step:.2g}{unit}"
    if not row["stable"]:  # its partial result is not compared
        what = "left out" if row["message"].startswith(LEFT_OUT) else "stopped" if row["repeats"] else "failed"
        return (*first, what, *[""] * (len(columns) + 3))
    relative = row["cpu_uncertainty_s"] / row["cpu_s"] if row["cpu_s"] > 0.0 else math.inf
    values = ((_plain if name == "rotation_error" else _percent)(row[name]) for name in columns.values())
    return (*first, f"{row['cpu_s']:.3g} ~{100.0 * relative:.0f} %", str(row["repeats"]), f"{row['time_ratio']:.3g}", *values,
            _plain(row["energy_residual"]))  # fmt: skip


def _percent(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else "0" if value == 0.0 else f"{100.0 * value:.2g} %"


def _plain(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else "0" if value == 0.0 else f"{value:.1e}"
