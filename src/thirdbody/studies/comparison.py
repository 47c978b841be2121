"""Comparison of runs with the first of them: results, keys that differ, series over the common range, bodies one by one."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.errors import InputError
from thirdbody.report.tables import Report, table
from thirdbody.runner.checkpoint import read_prints
from thirdbody.schema.parts import differences
from thirdbody.studies.cost import Outcome, displacements, errors, outcome_at, percent
from thirdbody.studies.cost_report import COLUMNS_OF_MEETING
from thirdbody.studies.results import FRACTION, result, results_of
from thirdbody.trajectory.names import CLUMPS
from thirdbody.trajectory.open_file import FILE_NAME, damage_as_fault
from thirdbody.units import duration, pretty, quantity_text, with_error

if TYPE_CHECKING:
    from thirdbody.trajectory.run_file import RunFile

Array = np.ndarray

STOP = 0.05  # frames of two runs are at one stop if their distances differ by less than this part of the output intervals there
SAME_END = 0.01  # relative difference of the distances of two runs up to which their sums and ends are compared
SAME_BODY, SAME_START = 1e-5, 0.01  # least differences that count: of mass and diameter, relative; of the start, in diameters
ROUNDING = 1e-4  # smaller differences [%] are not printed
LISTED = 5  # number of bodies that are listed

QUANTITIES = {
    "distance": "sliding distance", "friction_coefficient": "friction coefficient", "friction_coefficient_error": "",
    "gap": "gap at the end", "load": "load", "energy_plate_work": "work of the plates", "energy_friction": "lost in friction",
    "energy_numerical": "lost by the integrator", "energy_residual": "energy residual", "peak_pressure": "peak pressure",
    "wall_time": "wall time", "steps": "steps",
}  # fmt: skip
"""Results (`studies.results`) in the order of the table, and what it calls them."""

OVER_RANGE = COLUMNS_OF_MEETING | {
    "labels at the end": "labels_at_end", "place of a body, mean": "place_mean", "place of a body, largest": "place_largest",
    "friction work, mean": "friction_work_mean", "friction work, largest": "friction_work_largest",
}  # fmt: skip
"""Differences over the common range, all relative: those of a study of cost, and those of bodies one by one."""


class Comparison(Report):
    """Result of `compare`, by name, in SI; `print` shows it as `thirdbody compare` does."""

    def show(self) -> None:
        """Print it."""
        print_comparison(self)

    def __repr__(self) -> str:
        return f"<Comparison of {', '.join(row['run'] for row in self['runs'])}>"


def compare_runs(runs: Sequence[RunFile], listed: int = LISTED) -> Comparison:
    """Return the comparison of opened runs with the first one (`thirdbody.compare`). Raises InputError."""
    for run in runs:
        if not run.frames:
            raise InputError(f"{run.path}: nothing to compare: no frame was written yet")
    rows, units, settings = list[dict[str, Any]](), dict[str, str](), []
    axis = "distance" if all(run.drag.dragged for run in runs) else "time"
    for run in runs:
        with damage_as_fault(run.path, "what is compared"):
            rows.append(_row(run, units) | {"series": _series(run, axis)})
            settings.append(_settings(run))
            if len(rows) > 1:
                rows[-1] |= {"difference": _difference(rows[-1]["results"], rows[0]["results"])}
                rows[-1] |= _against(runs[0], run, axis, listed)
    common = os.path.commonpath([os.path.dirname(os.path.abspath(row["run"])) for row in rows])
    for row in rows:
        row["name"] = os.path.relpath(row["run"], common)
    return Comparison({"runs": rows, "units": units, "axis": axis, "settings": differences(*settings)})


def _row(run: RunFile, units: dict[str, str]) -> dict[str, Any]:
    """Return what one run tells; `units` gets those of its results."""
    summary, bodies = run.summary(), run.bodies(-1)
    names = [name for name in QUANTITIES if name != "load" or "upper_force" in run.series]
    names[3:3] = [f"{FRACTION}{state}" for state in run.state_names if f"{FRACTION}{state}" in run.series]
    values = results_of(run, summary, names)
    units |= {name: result(name).unit for name in names}
    for name in bodies if len(bodies["position"]) == run.scene_bodies else ():
        if name not in CLUMPS and run.header["units"].get(name) == "m3":  # of measures: worn volumes
            values[name], units[name] = float(bodies[name].sum()), "m3"
    folder = run.path.parent if run.path.name == FILE_NAME else run.path
    ended = "yes" if summary["finished"] else f"no: {summary.get('stopped') or 'killed, or still running'}"
    return {"run": str(folder), "finished": ended, "bodies": run.scene_bodies, "frames": run.frames, "results": values,
            "friction_verdict": run.friction.verdict}  # fmt: skip


def _settings(run: RunFile) -> dict[str, Any]:
    """Return the scene of a run, and what else its numbers depend on: law, time step, versions, sources of laws and effects."""
    step, prints = run.drag.stored.get("time_step"), read_prints(run.path.parent)
    other = {name: run.header[name] for name in ("law", "versions") if name in run.header}
    other |= {"integrator": run.header.get("integrator", {}).get("name")} | ({"time_step": pretty(step, "time")} if step else {})
    code = {name.removeprefix("the ").replace(" ", "_"): text for name, text in prints.items() if "sources" in text}
    return run.scene_tables | other | ({"code": code} if code else {})


def _series(run: RunFile, axis: str) -> dict[str, Array]:
    """Return what is drawn, from the start of the drag on, over its first entry."""
    start, series = run.drag.start, dict(run.series)
    if "upper_force" in series:
        series["load"] = np.abs(series["upper_force"][:, 2])
    names = [name for name in series if name in ("friction_coefficient", "gap", "load") or name.startswith(FRACTION)]
    curves = {name: np.array(series[name][start:], float) for name in names}
    for name in curves.keys() & {"friction_coefficient", "load"}:
        curves[name][:1] = np.nan  # the mean over an interval before the drag
    return {axis: _abscissa(run, axis)[start:]} | curves


def _abscissa(run: RunFile, axis: str) -> Array:
    return run.drag.distance if axis == "distance" else run.times - run.drag.begin


def _difference(values: Mapping[str, float], first: Mapping[str, float]) -> dict[str, float]:
    """Return the differences that mean something, in SI; `friction_errors`: that of friction, over the error of a difference.

    Sums and what is at the end are not compared where runs end at other distances.
    """
    same_end = abs(values["distance"] - first["distance"]) <= SAME_END * first["distance"]
    names = [name for name in first if same_end or name in ("friction_coefficient", "load", "peak_pressure")]
    unlike = ("distance", "friction_coefficient_error", "energy_residual")
    changes = {name: values.get(name, math.nan) - first[name] for name in names if name not in unlike}
    error = math.hypot(values["friction_coefficient_error"], first["friction_coefficient_error"])
    changes["friction_errors"] = changes["friction_coefficient"] / error if error > 0.0 else math.nan
    return {name: change for name, change in changes.items() if math.isfinite(change)}


# -- over the common range --


def _against(first: RunFile, run: RunFile, axis: str, listed: int) -> dict[str, Any]:
    """Return the differences of a run from the first over the range that both have, and of their bodies at the common stops."""
    x, y = _abscissa(first, axis), _abscissa(run, axis)
    a, b = np.flatnonzero(first.drag.during), np.flatnonzero(run.drag.during)
    near_x, near_y, end = _near(x), _near(y), max(min(x[-1], y[-1]), 0.0)
    a, b = a[x[a] <= end + near_x[a]], b[y[b] <= end + near_y[b]]
    same_a, same_b = _common_stops(x[a], y[b], near_x[a], near_y[b])
    reference, outcome = outcome_at(first, a[same_a]), outcome_at(run, b[same_b])
    if not len(a) == len(b) == len(same_a):
        reference, outcome = _resampled(reference, first, x, x[a]), _resampled(outcome, run, y, x[a])
    if first.state_names != run.state_names:
        outcome = replace(outcome, states=None)
    why = _other_bodies(first, run) or ("" if len(same_a) else f"no frames at the same {axis}")
    changes = errors(outcome, reference, not why)
    if not len(same_a):
        changes["dissipation_error"] = math.nan  # until other distances
    report: dict[str, Any] = {"common": float(end), "common_stops": len(same_a), "over_range": changes}
    if why:
        return report | {"not_by_body": why}
    bodies = first.bodies(int(a[same_a[-1]])), run.bodies(int(b[same_b[-1]]))
    figures, report["bodies_listed"] = _by_body(bodies, reference, outcome, listed)
    changes |= figures
    if reference.states is not None and outcome.states is not None:
        report["labels"] = {axis: x[a[same_a]]} | _labels(reference.states, outcome.states, first.state_names)
        changes["labels_at_end"] = float(report["labels"]["difference"][-1])
    return report


def _near(x: Array) -> Array:
    """Return how near to each frame (F,) another is at the same stop: a part of the longer of the intervals around it."""
    intervals = np.concatenate([[0.0], np.diff(x), [0.0]])
    return STOP * np.maximum(intervals[1:], intervals[:-1])


def _common_stops(x: Array, y: Array, near_x: Array, near_y: Array) -> tuple[Array, Array]:
    """Return the numbers (k,) of the stops of two runs that lie near each other, each used once."""
    if not len(x) or not len(y):
        return (np.zeros(0, int),) * 2
    closest = np.searchsorted(0.5 * (y[1:] + y[:-1]), x)
    same = np.flatnonzero(np.abs(y[closest] - x) <= np.minimum(near_x, near_y[closest]))
    others, once = np.unique(closest[same], return_index=True)
    return same[once], others


def _resampled(outcome: Outcome, run: RunFile, x: Array, stops: Array) -> Outcome:
    """Return an outcome whose series are those of the run at `stops`, also between its frames; bodies and labels stay."""
    start = max(int(np.argmax(run.drag.during)) - 1, 0)
    whole, x, edges = outcome_at(run, np.arange(start, run.frames)), x[start:], np.concatenate([x[start : start + 1], stops])

    def means(values: Array) -> Array:
        """Return the means between stops of what is given as means between frames."""
        known = np.isfinite(values[1:])
        parts = np.where(known, values[1:], 0.0) * np.diff(x), known * np.diff(x)
        sums, lengths = (np.diff(np.interp(edges, x, np.concatenate([[0.0], np.cumsum(part)]))) for part in parts)
        return np.divide(sums, lengths, out=np.full(len(stops), np.nan), where=lengths > 0.0)

    return replace(outcome, friction=means(whole.friction), normal=means(whole.normal), gap=np.interp(stops, x, whole.gap))


def _other_bodies(first: RunFile, run: RunFile) -> str:
    """Return why the bodies of two runs are not the same ones; empty where they are."""
    a, b, spheres = first.bodies(0), run.bodies(0), (first.rows("spheres", 0), run.rows("spheres", 0))
    count, other = len(a["position"]), len(b["position"])
    if count != other or not count:
        return f"{count} bodies against {other}"
    names = {"scene_id": "other bodies are in the file", "material": "other materials", "mass": "other shapes"}
    for name, words in (names | {"diameter": "other shapes"}).items():
        one, two = (bodies.get(name, np.zeros(count)) for bodies in (a, b))
        if differ := int(np.count_nonzero(~(np.abs(two - one) <= SAME_BODY * np.abs(one)))):
            return f"{words}: {name} of {differ} of {count} bodies differs"
    if spheres[0] != spheres[1] and 0 not in spheres:  # 0: not written
        return f"other shapes: {spheres[0]} spheres against {spheres[1]}"
    apart = np.linalg.norm(b["position"] - a["position"], axis=1)
    differ = int(np.count_nonzero(apart > SAME_START * a.get("diameter", np.full(count, np.inf))))
    return f"other places at the start: {differ} of {count} bodies" if differ else ""


def _by_body(
    bodies: Sequence[Mapping[str, Array]], reference: Outcome, outcome: Outcome, listed: int
) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """Return differences of place over the drag, and of friction work over its mean, and the bodies whose places differ most."""
    parts = {"place": np.linalg.norm(displacements(outcome.position, reference.position, reference.period), axis=1)}
    parts["place"] /= reference.path
    work = [one["friction_work"] for one in bodies if "friction_work" in one]
    if len(work) == 2 and (scale := float(np.mean(work[0]))) > 0.0:
        parts["friction_work"] = np.abs(work[1] - work[0]) / scale
    figures = {f"{name}_mean": float(np.mean(part)) for name, part in parts.items()}
    figures |= {f"{name}_largest": float(np.max(part)) for name, part in parts.items()}
    if reference.states is not None and outcome.states is not None:
        parts["labels"] = np.count_nonzero(outcome.states != reference.states, axis=0)
        parts |= {"state": reference.states[-1], "other_state": outcome.states[-1]}
    parts["body"] = bodies[0].get("scene_id", bodies[0].get("id", np.arange(len(parts["place"]))))
    largest = np.argsort(-parts["place"], kind="stable")[:listed]
    return figures, [{name: part[k].item() for name, part in parts.items()} for k in largest]


def _labels(first: Array, second: Array, names: Sequence[str]) -> dict[str, Any]:
    """Return the fraction of labels (F, B) that differ, by stop, and how many are what (rows) and what (columns)."""
    size = len(names)
    counts = [np.bincount((size * a.astype(int) + b).ravel(), minlength=size * size).reshape(size, size)
              for a, b in ((first[-1], second[-1]), (first, second))]  # fmt: skip
    return {"difference": np.mean(first != second, axis=1), "names": names, "at_end": counts[0], "at_all_stops": counts[1]}


# -- printing --


def print_comparison(report: Mapping[str, Any]) -> None:
    """Print the result of `compare_runs`."""
    rows, unit = report["runs"], "m" if report["axis"] == "distance" else "s"
    numbers = [str(k) for k in range(1, len(rows) + 1)]
    lines = [[name, *(str(row[name]) for row in rows)] for name in ("name", "finished", "bodies", "frames")]
    for name in dict.fromkeys(name for row in rows for name in row["results"]):
        words = f"{name.removeprefix(FRACTION)} at the end" if name.startswith(FRACTION) else name.replace("_", " ")
        if any(row["results"].get(name, 0.0) != 0.0 for row in rows) and name != "friction_coefficient_error":
            lines.append([QUANTITIES.get(name, words), *(_cell(name, row, rows[0], report["units"][name]) for row in rows)])
        if name == "friction_coefficient":
            lines.append(["", *(row["friction_verdict"] for row in rows)])
    table("", ["", *numbers], (line for line in lines if any(line[1:])))
    changes = [[key, *map(_brief, values)] for key, values in report["settings"].items()]
    print("\nwhat differs in scenes, laws and versions" + ("" if changes else ": nothing"))
    if changes:
        table("", ["", *numbers], changes)
    others = rows[1:]
    lines = [[f"common {report['axis']}", *(quantity_text(row["common"], unit) for row in others)],
             ["common stops", *(str(row["common_stops"]) for row in others)],
             ["body by body", *(f"no: {row['not_by_body']}" if "not_by_body" in row else "yes" for row in others)]]  # fmt: skip
    for words, name in OVER_RANGE.items():
        values = [row["over_range"].get(name, math.nan) for row in others]
        lines.append([words, *("" if math.isnan(value) else percent(value) for value in values)])
    print("\ndifferences from 1 over the common range")
    table("", ["", *numbers[1:]], (line for line in lines if any(line[1:])))
    for number, row in zip(numbers[1:], others, strict=True):
        _print_bodies(number, row)


def _print_bodies(number: str, row: Mapping[str, Any]) -> None:
    labels = row.get("labels", {"difference": [0.0]})
    if max(labels["difference"]) > 0.0:
        names, counts = labels["names"], [np.asarray(labels[name]) for name in ("at_end", "at_all_stops")]
        used = [k for k in range(len(names)) if counts[1][k].any() or counts[1][:, k].any()]
        lines = [[names[k], *(f"{counts[0][k, m]} / {counts[1][k, m]}" for m in used)] for k in used]
        print(f"\nlabels in 1 (rows) and in {number} (columns), at the end / at all common stops")
        table("", ["", *(names[k] for k in used)], lines)
    words = {"body": "body", "place": "place", "friction_work": "friction work", "state": "state in 1",
             "other_state": f"in {number}", "labels": "labels that differ"}  # fmt: skip
    listed = [{name: body[name] for name in words if name in body} for body in row.get("bodies_listed", ())]
    if listed:
        print(f"\nbodies of 1 and {number} whose places differ most")
        for body in listed:
            body |= {name: percent(body[name]) for name in ("place", "friction_work") if name in body}
            body |= {name: labels["names"][body[name]] for name in ("state", "other_state") if name in body}
        table("", [words[name] for name in listed[0]], [[str(value) for value in body.values()] for body in listed])


def _brief(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:28]} ... {text[-27:]}"


def _cell(name: str, row: Mapping[str, Any], first: Mapping[str, Any], unit: str) -> str:
    """Return a value, and its difference from the first run where that means something."""
    value, changes = row["results"].get(name, math.nan), row.get("difference", {})
    if not math.isfinite(value):
        return ""
    text, of, base = quantity_text(value, "" if unit == "1" else unit), "", first["results"].get(name, math.nan)
    if name.startswith(FRACTION):
        text, of, base = f"{100.0 * value:.1f} %", " of the bodies", 1.0
    elif name == "friction_coefficient":
        text = with_error(value, row["results"]["friction_coefficient_error"])
        of = f", {abs(changes['friction_errors']):.1f} errors" if "friction_errors" in changes else ""
    elif name == "energy_residual":
        text = f"{value:.1e}"
    elif name.startswith("energy_"):
        of, base = " of work", first["results"]["energy_plate_work"]
    elif name in ("wall_time", "steps"):
        text = duration(value) if name == "wall_time" else f"{value:.0f}"
    change = 100.0 * changes.get(name, 0.0) / abs(base) if base else 0.0
    size = f"{change:+.2g}" if abs(change) < 99.5 else f"{change:+.0f}"
    return f"{text} ({size} %{of})" if abs(change) > ROUNDING else text
