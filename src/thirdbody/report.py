"""What the commands print: as tables for people, as JSON for scripts, from the same dictionaries."""

from __future__ import annotations

import copy
import json as json_module
import math
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import InputError
from .scene.units import pretty

if TYPE_CHECKING:
    from .laws.registry import Registry
    from .output.run import Run
    from .scene.build import Simulation

TRIAL_SECONDS = 0.5
"""How long `check` integrates a throw-away copy to estimate the wall time."""


def table(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table on standard output."""
    from rich.console import Console
    from rich.table import Table

    shown = any(headings)
    grid = Table(title=title or None, title_justify="left", header_style="bold", box=None, pad_edge=False, show_header=shown)
    for heading in headings:
        grid.add_column(heading, overflow="fold")
    for row in rows:
        grid.add_row(*row)
    # without a terminal rich would assume 80 columns and fold every line; square brackets are text, not markup
    Console(width=None if sys.stdout.isatty() else 140, highlight=False, markup=False).print(grid)


def print_json(value: Any) -> None:
    """Print JSON; numbers that JSON has no word for (NaN) become null."""
    print(json_module.dumps(_plain(value), indent=1))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_warnings(warnings: Iterable[str]) -> None:
    """Print warnings on standard error."""
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)


def check_report(built: Simulation) -> dict[str, Any]:
    """The resolved scene as a dictionary: everything that `thirdbody check` tells, SI."""
    choice, state, bound = built.choice, built.state, built.integrator.bound
    assert bound is not None
    from .laws.contract import STIFF
    from .simulate import planned_frames

    seconds_per_step = _seconds_per_step(built)
    steps = built.planned_time / state.dt
    frames = planned_frames(built)
    return {
        "title": built.scene.title,
        "scene": built.scene.document(),
        "bodies": state.n_bodies,
        "spheres": state.n_spheres,
        "law": {
            "family": choice.family.name,
            "level": choice.level,
            "chain": [{"stage": law.stage, "law": law.name, "source": law.source} for law in choice.chain.laws],
            "not_needed": list(choice.off),
            "explicit_only": [law.name for law in choice.chain.laws if law.tangent is None and law.stage in STIFF],
        },
        "pairs": [
            {
                "between": [pair.a.name, pair.b.name],
                "friction": pair.friction,
                "restitution": pair.restitution,
                **{
                    f"{law.name}.{name}": value
                    for law, values in zip(choice.chain.laws, row, strict=True)
                    for name, value in zip(type(values)._fields, values, strict=True)
                },
            }
            for pair, row in zip(choice.pairs, choice.rows, strict=True)
        ],
        "effects": {
            "on": [{"effect": effect.name, "source": effect.source} for effect in choice.effects],
            "debris_contact": "searched" if state.world.debris_meets else "none",
            "labels": built.labeller.name if built.labeller else "none",
        },
        "upper_plate": _plate_report(built),
        "integrator": "explicit",
        "time_step": {
            "step": state.dt,
            "limited_by": "the scene" if built.integrator.fixed is not None else bound.mechanism,
            "body": bound.body,
            "rayleigh": bound.rayleigh,
            "stability_limit": bound.stability,
        },
        "settle": built.settle,
        "simulated_time": built.planned_time,
        "expected_overlap_over_radius": built.upper.overlap,
        "steps": steps,
        "estimated_wall_time": steps * seconds_per_step,
        "memory": _memory(built),
        "frames": frames,
        "disk": frames * _frame_bytes(built),
        "warnings": built.warnings,
    }


def _plate_report(built: Simulation) -> dict[str, Any] | None:
    upper = built.state.world.upper
    if upper is None:
        return None
    return {
        "patches": len(upper.heights),
        "load": float(upper.load.max()) if upper.foundation is None else upper.foundation.load,
        "support": built.scene.plates.upper.support if built.scene.plates.upper else "none",
        "free": upper.free if upper.foundation is None else upper.foundation.free,
        "mass": float(upper.mass.mean()),
        "damping": float(upper.damping.mean()),
        "gap": float(upper.heights.mean()),
        "moves": upper.schedule.moves,
        "loaded_at_once": built.upper.loaded,
        "foundation": None if upper.foundation is None else upper.foundation.stiffness,
    }


def _seconds_per_step(built: Simulation) -> float:
    """Measured on a copy of the simulation, which is thrown away; the first call is not counted."""
    from .errors import GuardStop

    trial = copy.deepcopy(built.integrator.state)
    integrator = copy.copy(built.integrator)
    integrator.state = trial
    integrator._tables()
    try:
        integrator.advance_to(trial.time + 3.0 * trial.dt)
        started, steps, before = time.perf_counter(), 0, trial.A.copy()
        while time.perf_counter() - started < TRIAL_SECONDS:
            integrator.advance_to(trial.time + 100.0 * trial.dt)
        from .kernels.layout import A_STEPS

        steps = int(trial.A[A_STEPS] - before[A_STEPS])
        return (time.perf_counter() - started) / max(steps, 1)
    except GuardStop:
        return math.nan


def _memory(built: Simulation) -> int:
    state, slots = built.state, built.state.slots
    arrays = (state.B, state.S, state.P, state.M, state.offsets, state.X0, slots.H, slots.F, slots.R, slots.own, slots.incidence)
    return int(sum(array.nbytes for array in arrays))


def _frame_bytes(built: Simulation) -> int:
    state = built.state
    margins = 0 if built.labeller is None else len(built.labeller.margins) + len(built.labeller.extras)
    return state.n_bodies * (8 * (24 + margins) + 2 + 3 * 150) + state.n_spheres * (24 + 12 + 2)


def print_check(told: dict[str, Any]) -> None:
    """Print what `check_report` found."""
    law = told["law"]
    from .scene.write import toml_text

    print(toml_text(told["scene"]))
    print(f"# {told['title'] or 'scene'}: {told['bodies']} bodies, {told['spheres']} spheres")
    table(f"law {law['family']}, level {law['level']}", ("stage", "law", "source"),
          [(entry["stage"], entry["law"], entry["source"]) for entry in law["chain"]])  # fmt: skip
    if law["not_needed"]:
        print(f"absent, because no pair asks for it: {', '.join(law['not_needed'])}")
    for pair in told["pairs"]:
        values = ", ".join(f"{name} {value:.6g}" for name, value in pair.items() if name != "between")
        print(f"pair {pair['between'][0]}/{pair['between'][1]}: {values}")
    on = ", ".join(effect["effect"] for effect in told["effects"]["on"]) or "none"
    if law["explicit_only"]:
        print(f"without a tangent, explicit integrator only: {', '.join(law['explicit_only'])}")
    contact, labels = told["effects"]["debris_contact"], told["effects"]["labels"]
    print(f"body effects: {on} (all others are absent); debris contact: {contact}; labels: {labels}")
    plate = told["upper_plate"]
    if plate is not None:
        load = f"load {pretty(plate['load'], 'force')}" if plate["free"] else "height prescribed"
        carried = f", carried by {plate['loaded_at_once']} of {told['bodies']} bodies at once" if plate["loaded_at_once"] else ""
        each = " on each" if plate["support"] == "load_per_particle" else ""
        print(
            f"upper plate: {plate['support']}, {plate['patches']} patch(es), {load}{each}{carried}, "
            f"mass {plate['mass']:.3g} kg, damping {plate['damping']:.3g} kg/s, mean gap {pretty(plate['gap'], 'length')}"
        )
    step = told["time_step"]
    print(
        f"time step {pretty(step['step'], 'time')}, {_limit(step)} "
        f"(Rayleigh time {pretty(step['rayleigh'], 'time')}); integrator {told['integrator']}"
    )
    settling, whole = pretty(told["settle"], "time"), pretty(told["simulated_time"], "time")
    print(f"settling {settling}, simulated {whole}, {told['steps']:.3g} steps")
    print(f"expected overlap {told['expected_overlap_over_radius']:.2g} of the radius")
    wall = told["estimated_wall_time"]
    duration = "the trial steps were stopped by a guard" if math.isnan(wall) else f"{wall:.3g} s"
    print(
        f"estimated: {duration}, {told['memory'] / 1e6:.3g} MB of memory, "
        f"{told['frames']} frames, {told['disk'] / 1e6:.3g} MB on disk"
    )
    for warning in told["warnings"]:
        print(f"warning: {warning}")


def _limit(step: dict[str, Any]) -> str:
    if step["limited_by"] == "the scene":
        return "given by the scene"
    return f"limited by {step['limited_by']} of body {step['body']}"


def run_report(folder: Path, json: bool) -> None:
    """Print the short table that ends a run."""
    from .output.run import open_run

    with open_run(folder) as result:
        told = result.summary()
        files = sorted(str(path) for path in folder.iterdir())
        if json:
            print_json(told | {"files": files})
            return
        fractions = [
            f"{name} {100.0 * result.series[f'fraction_{name}'][-1]:.1f} %"
            for name in result.state_names
            if f"fraction_{name}" in result.series
        ]
        mu = result.series["friction_coefficient"]
        rows = [
            ("wall time", f"{told['wall_time']:.1f} s"),
            ("steps", f"{told['steps']} ({told['sphere_steps_per_second']:.3g} sphere-steps/s)"),
            ("sliding distance", pretty(told["distance"], "length")),
            ("friction coefficient", f"{mu[-1]:z.4f} (last interval)" if len(mu) and not math.isnan(mu[-1]) else "unloaded"),
            ("states", ", ".join(fractions)),
            ("energy residual", "not known" if told["energy_residual"] is None else f"{told['energy_residual']:.2e}"),
            ("files", f"{folder} ({', '.join(Path(file).name for file in files)})"),
        ]
        if told.get("stopped"):
            # the full reason ends the command, on standard error
            rows.insert(0, ("finished", f"no: {told['stopped'].split(' ')[0]} after {told['frames']} frame(s), kept"))
        table("", ("", ""), rows)


def states_report(path: Path, frame: int | None, json: bool) -> None:
    """Print states over frames, or body by body for one frame. Raises InputError for a frame or labels that are not there."""
    from .output.run import open_run

    with open_run(path) as run:
        if run.frames and "state" not in run.bodies(0):
            raise InputError(f"{run.path}: this run recorded no states: its bodies were not labelled")
        if frame is None:
            _states_over_frames(run, json)
        else:
            _states_of_bodies(run, frame, json)


def _states_over_frames(run: Run, json: bool) -> None:
    from .foretold import forecast_against_fact

    names = run.state_names
    rows = []
    for k in range(run.frames):
        counts = {name: int(np.count_nonzero(run.states[k] == code)) for code, name in enumerate(names)}
        rows.append({"frame": k, "time": float(run.times[k]), "distance": float(run.series["distance"][k]), **counts})
    last = _reasons(run.states[-1], run.reasons[-1], names, run.reason_names) if rows else {}
    if json:
        print_json({"frames": rows, "reasons": last, "forecast": forecast_against_fact(run)})
        return
    if not rows:
        print(f"{run.path}: no frames yet")
        return
    headings = ["frame", "time", "distance", *names]
    table("", headings, [[str(row["frame"]), pretty(row["time"], "time"), pretty(row["distance"], "length"),
                          *(str(row[name]) for name in names)] for row in rows])  # fmt: skip
    for state, counts in last.items():
        print(f"{state}: " + ", ".join(f"{reason} {count}" for reason, count in counts.items()))
    _tell_forecast(forecast_against_fact(run))


def _tell_forecast(found: dict[str, Any]) -> None:
    """Print the table, and the bodies in which forecast and fact differ."""
    if not found or not found["told"]:
        return
    from .foretold import WATCHED

    table(
        f"forecast at frame {found['frame']} against the first {WATCHED:g} contact radii of drag",
        ["", "was rolling", "never rolled"],
        [
            ["can only roll", str(len(found["rolls_as_told"])), str(len(found["slides_instead"]))],
            ["can slide", str(len(found["rolls_instead"])), str(len(found["slides_as_told"]))],
        ],
    )
    print(f"agreement {found['agree']} of {found['told']} ({100.0 * found['agree'] / found['told']:.1f} %)")
    for name, text in (("rolls_instead", "rolled although they can slide"), ("slides_instead", "never rolled although told to")):
        if found[name]:
            shown = ", ".join(map(str, found[name][:20]))
            print(f"{text}: bodies {shown}" + (f" and {len(found[name]) - 20} more" if len(found[name]) > 20 else ""))


def _states_of_bodies(run: Run, frame: int, json: bool) -> None:
    try:
        bodies = run.bodies(frame)
    except IndexError as error:
        raise InputError(f"--frame {frame}: {error}") from None
    margins = [name for name in bodies if name.startswith("margin_")]
    per_body = [
        {
            "body": b,
            "state": run.state_names[bodies["state"][b]],
            "reason": run.reason_names[bodies["state_reason"][b]],
            **{name: float(bodies[name][b]) for name in margins},
        }
        for b in range(len(bodies["state"]))
    ]
    if json:
        print_json(per_body)
        return
    headings = ["body", "state", "reason", *(name.removeprefix("margin_") for name in margins)]
    rows = [[str(row["body"]), row["state"], row["reason"], *(f"{row[name]:.3g}" for name in margins)] for row in per_body]
    table("margins: positive means satisfied", headings, rows)


def _reasons(states: np.ndarray, codes: np.ndarray, names: Sequence[str], reasons: Sequence[str]) -> dict[str, dict[str, int]]:
    found: dict[str, dict[str, int]] = {}
    for code, name in enumerate(names):
        counts = np.bincount(codes[states == code], minlength=len(reasons))
        if counts.any():
            found[name] = {reasons[k]: int(n) for k, n in enumerate(counts) if n}
    return found


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
    if json:
        print_json({"families": families, "laws": laws, "effects": effects, "failures": dict(registry.failures)})
        return
    for title, rows in (("law families", families), ("laws", laws), ("effects (named in [effects], else absent)", effects)):
        if rows:
            table(title, tuple(rows[0]), [[str(value) for value in row.values()] for row in rows])
            print()
    for name, why in registry.failures.items():
        print(f"plug-in {name} did not load: {why}")


def conformance_report(files: Sequence[Path], json: bool) -> None:
    """Put the contact laws of plug-in files through the conformance suite. Raises UsageError if one fails."""
    from .errors import UsageError
    from .laws.conformance import check, report
    from .laws.contract import Law
    from .laws.registry import load_file

    findings = []
    for file in files:
        plugin = load_file(file)
        laws = {law.name: law for family in plugin.families for level in family.levels.values() for law in level}
        laws |= {effect.name: effect for effect in plugin.effects if isinstance(effect, Law)}
        findings += check(laws.values())
    if json:
        print_json([finding.__dict__ for finding in findings])
    else:
        print(report(findings))
    failed = [finding for finding in findings if not finding.passed]
    if failed:
        raise UsageError(f"{len(failed)} of {len(findings)} conformance tests failed")
