"""Output of the commands: tables for people, JSON for scripts, from the same dictionaries."""

from __future__ import annotations

import json as json_module
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.errors import InputError, printable
from thirdbody.system.terminal import print_line, terminal_of
from thirdbody.units import duration, pretty

if TYPE_CHECKING:
    from thirdbody.laws.registry import Registry
    from thirdbody.trajectory.reader import Run


def table(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table on standard output."""
    from rich.console import Console
    from rich.table import Table

    shown = any(headings)
    heading_of_all = printable(title) or None
    grid = Table(title=heading_of_all, title_justify="left", header_style="bold", box=None, pad_edge=False, show_header=shown)
    for heading in headings:
        grid.add_column(printable(heading), overflow="fold")
    for row in rows:
        grid.add_row(*map(printable, row))
    # without a terminal rich would assume 80 columns and fold every line; square brackets are text, not markup
    terminal = terminal_of(sys.stdout)  # below the layer that escapes rich's own sequences
    Console(file=terminal, width=None if terminal.isatty() else 140, highlight=False, markup=False, emoji=False).print(grid)


def print_json(value: Any) -> None:
    """Print JSON; numbers without a JSON equivalent (NaN) become null."""
    print(json_module.dumps(as_plain(value), indent=1))


def as_plain(value: Any) -> Any:
    """Return a value that JSON can hold: arrays as lists, NaN and infinities as null."""
    if isinstance(value, dict):
        return {str(key): as_plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [as_plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return as_plain(value.tolist())
    if isinstance(value, np.generic):
        return as_plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_warnings(warnings: Iterable[str]) -> None:
    """Print warnings on standard error."""
    for warning in warnings:
        print_line(f"warning: {warning}", err=True)


def run_report(folder: Path, json: bool) -> None:
    """Print the short table that ends a run."""
    from thirdbody.runner.accuracy_warnings import step_words
    from thirdbody.runner.yield_check import yield_words
    from thirdbody.trajectory.accommodation_fractions import accommodation_text
    from thirdbody.trajectory.bed_verdict import bed_rows
    from thirdbody.trajectory.reader import open_run

    with open_run(folder) as result:
        report = result.summary()
        files = sorted(str(path) for path in folder.iterdir())
        if json:
            print_json(report | {"files": files})
            return
        fractions = [
            f"{name} {100.0 * result.series[f'fraction_{name}'][-1]:.1f} %"
            for name in result.state_names
            if f"fraction_{name}" in result.series
        ]
        rows = [
            ("wall time", f"{report['wall_time']:.1f} s"),
            ("steps", f"{report['steps']} ({report['sphere_steps_per_second']:.3g} sphere-steps/s)"),
            *([("steps limited by", step_words(report))] if step_words(report) else []),
            ("sliding distance", pretty(report["distance"], "length")),
            *([("speed", speed_words(report))] if report.get("speed_scale") else []),
            ("friction coefficient", str(result.friction)),
            *_direct_rows(report),
            *bed_rows(result.bed),
            ("states", ", ".join(fractions)),
            *_group_rows(report),
            *([("velocity accommodation", accommodation_text(report["accommodation"]))] if "accommodation" in report else []),
            *_relaxed_rows(report),
            ("peak pressure", yield_words(report) or "not known"),
            ("energy residual", "not known" if report["energy_residual"] is None else f"{report['energy_residual']:.2e}"),
            ("files", f"{folder} ({', '.join(Path(file).name for file in files)})"),
        ]
        if report.get("stopped"):
            # the full reason ends the command, on standard error
            rows.insert(0, ("finished", f"no: {report['stopped'].split(' ')[0]} after {report['frames']} frame(s), kept"))
        table("", ("", ""), rows)
        before = result.header.get("warnings", ())  # those were printed then
        print_warnings(text for text in result.warnings if text not in before)


def _direct_rows(report: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return how debris and direct contact of the plates carried the load together."""
    if "load_share_debris" not in report:
        return []
    load, active = (f"{100.0 * report[name]:.3g} %" for name in ("load_share_debris", "active"))
    return [("load on debris", f"{load}, on {active} of the bodies; the rest is direct contact of the plates")]


def _relaxed_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return how far bodies that overlapped at the start were pushed apart."""
    start = summary.get("initial_overlap")
    if not start:
        return []
    far, mean = start["largest_displacement"], start["mean_displacement"]
    distances = f", by {far:.2g} radii at most, {mean:.2g} in the mean" if start["bodies_moved"] else ""
    return [("start relaxed", f"{start['bodies_moved']} of {summary['bodies']} bodies moved{distances}")]


def speed_words(report: Mapping[str, Any]) -> str:
    """Describe the two speeds of a run that was computed at another speed than its scene asks for, from its summary."""
    time, wall = report["simulated_time"], report["wall_time"]
    requested = duration(wall * report["scene_time"] / time) if time > 0.0 else "unknown"
    return f"{report['speed_scale']['text']}; {duration(wall)} instead of about {requested}"


def _group_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the final states of every population, and of every material where populations share one: name and fractions."""
    from thirdbody.trajectory.state_groups import fractions_text, informative_groups

    kinds = {kind: summary.get(f"{kind}s", []) for kind in ("population", "material")}
    return [
        (f"  {row['name']}", f"{fractions_text(row['fractions'])} (of {row['bodies']}{_load(row)})")
        for _, rows in informative_groups(kinds)
        for row in rows
    ]


def _load(row: Mapping[str, Any]) -> str:
    return f", {100.0 * row['load_share']:.0f} % of the load" if "load_share" in row else ""


def _print_groups(run: Run, frame: int) -> None:
    """Print the states of one frame by population, material and size."""
    from thirdbody.trajectory.state_groups import informative_groups, states_by_group

    headings = {"population": "by population", "material": "by material", "size": "by size (equivalent diameter)"}
    for kind, rows in informative_groups(states_by_group(run, frame)):
        load = ["load"] if "load_share" in rows[0] else []
        table(
            f"states at frame {frame} {headings[kind]}",
            ["", "bodies", *load, *run.state_names],
            [[row["name"], str(row["bodies"]), *([f"{100.0 * row['load_share']:.1f} %"] if load else []),
              *(f"{100.0 * fraction:.0f} %" for fraction in row["fractions"].values())] for row in rows],
        )  # fmt: skip
        print()


def states_report(path: Path, frame: int | None, json: bool, cycles: float | None = None) -> None:
    """Print states over frames with the numbers of maps, also of so many cycles, or body by body for one frame.

    Raises InputError when the frame or the labels are missing, or the cycles that give a rate.
    """
    from thirdbody.trajectory.reader import open_run

    with open_run(path) as run:
        if run.frames and "state" not in run.bodies(0):
            raise InputError(f"{run.path}: this run recorded no states: its bodies were not labelled")
        if frame is None:
            _states_over_frames(run, json, cycles)
        else:
            _states_of_bodies(run, frame, json)


def _states_over_frames(run: Run, json: bool, cycles: float | None) -> None:
    from thirdbody.report.forecast_check import compare_forecast
    from thirdbody.report.map_report import map_report, print_maps
    from thirdbody.trajectory.run_summary import state_counts
    from thirdbody.trajectory.state_groups import states_by_group

    names = run.state_names
    counts = state_counts(run) if run.frames else {}
    rows = [
        {"frame": k, "time": float(run.times[k]), "distance": float(run.series["distance"][k]),
         **{name: int(values[k]) for name, values in counts.items()}}
        for k in range(run.frames)
    ]  # fmt: skip
    last = _reasons(run.states[-1], run.reasons[-1], names, run.reason_names) if rows else {}
    maps = map_report(run, cycles) if rows else {}
    if json:
        groups = {f"{kind}s": rows_of_kind for kind, rows_of_kind in states_by_group(run).items()}
        whole = {"reasons_of_all": of_all} if rows and (of_all := _reasons_of_all(run)) else {}
        print_json(
            {"frames": rows, "reasons": last, "forecast": compare_forecast(run)}
            | groups
            | whole
            | ({"maps": maps} if maps else {})
        )
        return
    if not rows:
        print_line(f"{run.path}: no frames yet")
        return
    if run.states.shape[1] < run.scene_bodies:
        print(f"{run.states.shape[1]} of {run.scene_bodies} bodies are in the file: groups and reasons are theirs, states over "
              "frames are those of all")  # fmt: skip
        print()
    _print_groups(run, run.frames - 1)
    headings = ["frame", "time", "distance", *names]
    table("", headings, [[str(row["frame"]), pretty(row["time"], "time"), pretty(row["distance"], "length"),
                          *(str(row[name]) for name in names)] for row in rows])  # fmt: skip
    for state, by_reason in last.items():
        print_line(f"{state}: " + ", ".join(f"{reason} {count}" for reason, count in by_reason.items()))
    if of_all := _reasons_of_all(run):
        print_line("reasons of all bodies: " + ", ".join(f"{reason} {count}" for reason, count in of_all.items()))
    print_maps(maps)
    _print_forecast(compare_forecast(run))


def _reasons_of_all(run: Run) -> dict[str, int]:
    """Return the number of bodies of the scene with each reason at the last frame; none where the file holds all bodies."""
    counts = {name: int(run.series[f"count_{name}"][-1]) for name in run.reason_names if f"count_{name}" in run.series}
    return {name: count for name, count in counts.items() if count}


def _print_forecast(result: dict[str, Any]) -> None:
    """Print the table, and the bodies for which forecast and observation differ."""
    if result and result["unwatched"]:
        count = result["unwatched"]
        print(f"{count} bodies have no frame within the first 40 contact radii of drag: output.every is too coarse")
    if not result or not result["forecast"]:
        return
    from thirdbody.report.forecast_check import WATCHED

    table(
        f"forecast at frame {result['frame']} against the first {WATCHED:g} contact radii of drag",
        ["", "was rolling", "never rolled"],
        [
            ["can only roll", str(len(result["rolls_as_forecast"])), str(len(result["slides_instead"]))],
            ["can slide", str(len(result["rolls_instead"])), str(len(result["slides_as_forecast"]))],
        ],
    )
    print(f"agreement {_of(result['agree'], result['forecast'])}")
    print(f"  with friction more than 2 % from t_min and t_max: {_of(*result['clear'])}; of these, touching no other body: "
          f"{_of(*result['alone'])}")  # fmt: skip
    if result["by_rotation"] is not None:
        print(f"  by whether they turned by more than a/R in that drag, instead of by labels: {_of(*result['by_rotation'])}")
    for name, text in (
        ("rolls_instead", "rolled although they can slide"),
        ("slides_instead", "never rolled although forecast to roll"),
    ):
        if result[name]:
            shown = ", ".join(map(str, result[name][:20]))
            print(f"{text}: bodies {shown}" + (f" and {len(result[name]) - 20} more" if len(result[name]) > 20 else ""))
    _print_conditions(result["conditions"])


def _of(agree: int, report: int) -> str:
    """Return `97 of 100 (97.0 %)`."""
    return f"{agree} of {report}" + (f" ({100.0 * agree / report:.1f} %)" if report else "")


def _print_conditions(conditions: Sequence[dict[str, Any]]) -> None:
    """Print the assumptions of the forecast, evaluated for the run."""
    missed = sum(not condition["satisfied"] for condition in conditions)
    verdict = f"{missed} of {len(conditions)} not met here" if missed else "all met here"
    table(
        f"conditions under which the forecast holds in 97 to 99 % of cases: {verdict}",
        ["condition", "this run", "limit", ""],
        [[condition["what"], condition["shown"], condition["limit"], "" if condition["satisfied"] else "not met"]
         for condition in conditions],
    )  # fmt: skip


def _states_of_bodies(run: Run, frame: int, json: bool) -> None:
    try:
        bodies = run.bodies(frame)
    except IndexError as error:
        raise InputError(f"--frame {frame}: {error}") from None
    from thirdbody.trajectory.state_groups import code_name

    margins = [name for name in bodies if name.startswith("margin_")]
    several = "population" in bodies and len(np.unique(bodies["population"])) > 1
    per_body = [
        {
            "body": b,
            **({"population": code_name(run.population_names, int(bodies["population"][b]))} if several else {}),
            "state": run.state_names[bodies["state"][b]],
            "reason": run.reason_names[bodies["state_reason"][b]],
            **{name: float(bodies[name][b]) for name in margins},
        }
        for b in range(len(bodies["state"]))
    ]
    if json:
        print_json(per_body)
        return
    first = ["body", "population", "state", "reason"] if several else ["body", "state", "reason"]
    headings = [*first, *(name.removeprefix("margin_") for name in margins)]
    rows = [[*(str(row[name]) for name in first), *(f"{row[name]:.3g}" for name in margins)] for row in per_body]
    table("margins: positive means satisfied", headings, rows)


def _reasons(states: np.ndarray, codes: np.ndarray, names: Sequence[str], reasons: Sequence[str]) -> dict[str, dict[str, int]]:
    result: dict[str, dict[str, int]] = {}
    for code, name in enumerate(names):
        counts = np.bincount(codes[states == code], minlength=len(reasons))
        if counts.any():
            result[name] = {reasons[k]: int(n) for k, n in enumerate(counts) if n}
    return result


def laws_report(registry: Registry, json: bool) -> None:
    """Print every law family with its levels, every effect, and what failed to load."""
    owners = {family.name: plugin.name for plugin in registry.plugins for family in plugin.families}
    families = [
        {
            "law": family.name,
            "plugin": owners[family.name],
            "level": level + (" (default)" if level == family.default_level else ""),
            "chain": " > ".join(law.name for law in laws),
        }
        for family in registry.families.values()
        for level, laws in family.levels.items()
    ]
    laws = [{"law": law.name, "stage": law.stage, "source": law.source} for law in registry.laws.values()]
    effects = [
        {"effect": name, "options": ", ".join(f"{o.name} ({o.dimension})" for o in effect.options), "source": effect.source}
        for name, effect in registry.effects.items()
    ]
    measures = [
        {"measure": name, "options": ", ".join(f"{o.name} ({o.dimension})" for o in measure.options), "source": measure.source}
        for name, measure in registry.measures.items()
    ]
    if json:
        all_failures = dict(registry.failures)
        print_json({"families": families, "laws": laws, "effects": effects, "measures": measures, "failures": all_failures})
        return
    named = (("effects (named in [effects], else absent)", effects), ("measures (named in [measures], else absent)", measures))
    for title, rows in (("law families", families), ("laws", laws), *named):
        if rows:
            table(title, tuple(rows[0]), [[str(value) for value in row.values()] for row in rows])
            print()
    for name, why in registry.failures.items():
        print_line(f"plug-in {name} did not load: {why}")


def conformance_report(files: Sequence[Path], json: bool) -> None:
    """Run the conformance suite on all that plug-in files bring. Raises UsageError if a test fails."""
    from thirdbody.errors import UsageError
    from thirdbody.laws.conformance.suite import check, report
    from thirdbody.laws.registry import load_file

    findings = []
    for file in files:
        plugin = load_file(file)
        laws = {law.name: law for family in plugin.families for level in family.levels.values() for law in level}
        others = {effect.name: effect for effect in plugin.effects}
        labellers = {family.labeller.name: family.labeller for family in plugin.families if family.labeller}
        findings += check([*(laws | others).values(), *plugin.measures, *labellers.values()])
    if json:
        print_json([finding.__dict__ for finding in findings])
    else:
        print(report(findings))
    failed = [finding for finding in findings if not finding.passed]
    if failed:
        raise UsageError(f"{len(failed)} of {len(findings)} conformance tests failed")
