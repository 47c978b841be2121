"""Output of the commands: tables for people, JSON for scripts, from the same dictionaries; what is said of a run."""

from __future__ import annotations

import io
import json as json_module
import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from thirdbody.errors import InputError, printable
from thirdbody.system.terminal import PrintableStream, print_line, terminal_of
from thirdbody.units import duration, percent, pretty, quantity_text

if TYPE_CHECKING:
    from thirdbody.trajectory.run_file import RunFile


class Report(dict[str, Any]):
    """Result of a function by name, in SI; `print` shows what the command of that name prints."""

    def show(self) -> None:
        """Print it."""
        raise NotImplementedError

    def __str__(self) -> str:
        text = io.StringIO()
        with redirect_stdout(cast(Any, PrintableStream(text))):
            self.show()
        return text.getvalue()


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
    from thirdbody.trajectory.run_file import RunFile

    with RunFile(folder) as result:
        report = result.summary()
        files = sorted(str(path) for path in folder.iterdir())
        if json:
            print_json(report | {"files": files})
            return
        rows = [*_rows_of_run(result, report), ("files", f"{folder} ({', '.join(Path(file).name for file in files)})")]
        if report.get("stopped"):
            # the full reason ends the command, on standard error
            rows.insert(0, ("finished", f"no: {report['stopped'].split(' ')[0]} after {report['frames']} frame(s), kept"))
        table("", ("", ""), rows)
        before = result.header.get("warnings", ())  # those were printed then
        print_warnings(text for text in result.warnings if text not in before)


def _rows_of_run(run: RunFile, report: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    from thirdbody.runner.verdicts import step_words, yield_words
    from thirdbody.trajectory.bed import accommodation_text, bed_rows
    from thirdbody.trajectory.states import fractions_text, informative_groups

    yield "wall time", f"{report['wall_time']:.1f} s"
    yield "steps", f"{report['steps']} ({report['sphere_steps_per_second']:.3g} sphere-steps/s)"
    if words := step_words(report):
        yield "steps limited by", words
    yield "sliding distance", pretty(report["distance"], "length")
    if report.get("speed_scale"):  # computed at another speed than the scene asks for
        time, wall = report["simulated_time"], report["wall_time"]
        requested = duration(wall * report["scene_time"] / time) if time > 0.0 else "unknown"
        yield "speed", f"{report['speed_scale']['text']}; {duration(wall)} instead of about {requested}"
    yield "friction coefficient", str(run.friction)
    if "load_share_debris" in report:
        load, active = (f"{100.0 * report[name]:.3g} %" for name in ("load_share_debris", "active"))
        yield "load on debris", f"{load}, on {active} of the bodies; the rest is direct contact of the plates"
    yield from bed_rows(run.bed)
    known = [name for name in run.state_names if f"fraction_{name}" in run.series]
    yield "states", ", ".join(f"{name} {100.0 * run.series[f'fraction_{name}'][-1]:.1f} %" for name in known)
    for _, rows in informative_groups({kind: report.get(f"{kind}s", []) for kind in ("population", "material")}):
        for row in rows:
            load = f", {100.0 * row['load_share']:.0f} % of the load" if "load_share" in row else ""
            yield f"  {row['name']}", f"{fractions_text(row['fractions'])} (of {row['bodies']}{load})"
    if "accommodation" in report:
        yield "velocity accommodation", accommodation_text(report["accommodation"])
    if start := report.get("initial_overlap"):
        far, mean = start["largest_displacement"], start["mean_displacement"]
        distances = f", by {far:.2g} radii at most, {mean:.2g} in the mean" if start["bodies_moved"] else ""
        yield "start relaxed", f"{start['bodies_moved']} of {report['bodies']} bodies moved{distances}"
    yield "peak pressure", yield_words(report) or "not known"
    yield "energy residual", "not known" if report["energy_residual"] is None else f"{report['energy_residual']:.2e}"


def states_report(path: Path, frame: int | None, json: bool, cycles: float | None = None) -> None:
    """Print states over frames with the numbers of maps, also of so many cycles, or body by body for one frame.

    Raises InputError when the frame or the labels are missing, or the cycles that give a rate.
    """
    from thirdbody.trajectory.run_file import RunFile

    with RunFile(path) as run:
        if run.frames and "state" not in run.bodies(0):
            raise InputError(f"{run.path}: this run recorded no states: its bodies were not labelled")
        if frame is None:
            _states_over_frames(run, json, cycles)
        else:
            _states_of_bodies(run, frame, json)


def _states_over_frames(run: RunFile, json: bool, cycles: float | None) -> None:
    from thirdbody.report.forecast import compare_forecast
    from thirdbody.trajectory.states import informative_groups, state_counts, states_by_group

    names, groups = run.state_names, states_by_group(run)
    counts = state_counts(run) if run.frames else {}
    rows = [
        {"frame": k, "time": float(run.times[k]), "distance": float(run.series["distance"][k]),
         **{name: int(values[k]) for name, values in counts.items()}}
        for k in range(run.frames)
    ]  # fmt: skip
    last = _reasons(run.states[-1], run.reasons[-1], names, run.reason_names) if rows else {}
    maps = map_report(run, cycles) if rows else {}
    # reasons of all bodies of the scene; none where the file holds all of them
    counted = [name for name in run.reason_names if f"count_{name}" in run.series] if rows else []
    of_all = {name: count for name in counted if (count := int(run.series[f"count_{name}"][-1]))}
    if json:
        result: dict[str, Any] = {"frames": rows, "reasons": last, "forecast": compare_forecast(run)}
        result |= {f"{kind}s": rows_of_kind for kind, rows_of_kind in groups.items()}
        print_json(result | ({"reasons_of_all": of_all} if of_all else {}) | ({"maps": maps} if maps else {}))
        return
    if not rows:
        print_line(f"{run.path}: no frames yet")
        return
    if run.states.shape[1] < run.scene_bodies:
        print(f"{run.states.shape[1]} of {run.scene_bodies} bodies are in the file: groups and reasons are theirs, states over "
              "frames are those of all")  # fmt: skip
        print()
    words = {"population": "by population", "material": "by material", "size": "by size (equivalent diameter)"}
    for kind, group in informative_groups(groups):
        load = "load_share" in group[0]
        table(
            f"states at frame {run.frames - 1} {words[kind]}",
            ["", "bodies", *["load"] * load, *names],
            [[row["name"], str(row["bodies"]), *([f"{100.0 * row['load_share']:.1f} %"] if load else []),
              *(f"{100.0 * fraction:.0f} %" for fraction in row["fractions"].values())] for row in group],
        )  # fmt: skip
        print()
    lines = [[str(row["frame"]), pretty(row["time"], "time"), pretty(row["distance"], "length"),
              *(str(row[name]) for name in names)] for row in rows]  # fmt: skip
    table("", ["frame", "time", "distance", *names], lines)
    for state, by_reason in last.items():
        print_line(f"{state}: " + ", ".join(f"{reason} {count}" for reason, count in by_reason.items()))
    if of_all:
        print_line("reasons of all bodies: " + ", ".join(f"{reason} {count}" for reason, count in of_all.items()))
    print_maps(maps)
    _print_forecast(compare_forecast(run))


def _print_forecast(result: dict[str, Any]) -> None:
    if result and result["unwatched"]:
        count = result["unwatched"]
        print(f"{count} bodies have no frame within the first 40 contact radii of drag: output.every is too coarse")
    if not result or not result["forecast"]:
        return
    from thirdbody.report.forecast import WATCHED

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
    conditions = result["conditions"]  # assumptions of the forecast, evaluated for the run
    missed = sum(not condition["satisfied"] for condition in conditions)
    verdict = f"{missed} of {len(conditions)} not met here" if missed else "all met here"
    table(
        f"conditions under which the forecast holds in 97 to 99 % of cases: {verdict}",
        ["condition", "this run", "limit", ""],
        [[condition["what"], condition["shown"], condition["limit"], "" if condition["satisfied"] else "not met"]
         for condition in conditions],
    )  # fmt: skip


def _of(agree: int, report: int) -> str:
    return f"{agree} of {report}" + (f" ({100.0 * agree / report:.1f} %)" if report else "")


def _states_of_bodies(run: RunFile, frame: int, json: bool) -> None:
    try:
        bodies = run.bodies(frame)
    except IndexError as error:
        raise InputError(f"--frame {frame}: {error}") from None
    from thirdbody.trajectory.states import code_name

    if "exit_position" in bodies:
        bodies |= dict(zip(("exit_x", "exit_y"), bodies["exit_position"].T, strict=True))
    margins = [name for name in bodies if name.startswith(("margin_", "exit_x", "exit_y"))]
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
    table("margins: positive means satisfied" + ("; exit: in m" if "exit_position" in bodies else ""), headings, rows)


def _reasons(states: np.ndarray, codes: np.ndarray, names: Sequence[str], reasons: Sequence[str]) -> dict[str, dict[str, int]]:
    result: dict[str, dict[str, int]] = {}
    for code, name in enumerate(names):
        counts = np.bincount(codes[states == code], minlength=len(reasons))
        if counts.any():
            result[name] = {reasons[k]: int(n) for k, n in enumerate(counts) if n}
    return result


def map_report(run: RunFile, cycles: float | None) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of `Run.map_statistics` by what they are of: the run, and so many cycles; one where there is a rate.

    Raises InputError for cycles without a rate, or without maps.
    """
    from thirdbody.trajectory.summary import NO_MAPS

    if cycles is not None and not run.map_units:
        raise InputError(f"{run.path}: cycles: {NO_MAPS}")
    if cycles is None and len(run.cycles["cycle"]) > 1:
        cycles = 1.0
    wanted = {"run": None} if cycles is None else {"run": None, f"{cycles:g} cycle{'s' * (cycles != 1.0)}": cycles}
    tables = {name: run.map_statistics(number) for name, number in wanted.items()} if run.map_units else {}
    return {name: [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
            for name, columns in tables.items()}  # fmt: skip


def print_maps(report: dict[str, list[dict[str, Any]]]) -> None:
    """Print the result of `map_report`."""
    for name, rows in report.items():
        print()
        table(
            f"maps of the plates: {name}" + ("" if name == "run" else ", by the mean rate of whole cycles, without the first"),
            ["plate", "map", "mean where any", "95 % below", "largest", "area", "total"],
            [[row["plate"], row["map"], *(quantity_text(row[key], row["unit"]) for key in ("mean", "percentile_95", "largest")),
              percent(row["area_fraction"]), _total(row["total"], row["total_unit"])] for row in rows],
        )  # fmt: skip
    if report:
        print()


def _total(value: float, unit: str) -> str:
    return f"{1e18 * value:.3g} um3" if unit == "m3" else quantity_text(value, unit)
