"""The command `thirdbody sweep`: reads its arguments, runs, and reports."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from thirdbody.errors import GuardStop, Interrupted, UsageError
from thirdbody.scene.model import Scene
from thirdbody.scene.settings import toml_value
from thirdbody.studies.sweep.execution import Execution, execute_sweep
from thirdbody.studies.sweep.plan import Plan, make_plan
from thirdbody.studies.sweep.point import DONE, FAILED
from thirdbody.studies.sweep.progress import reporting
from thirdbody.studies.sweep.reader import Sweep
from thirdbody.studies.sweep.sweep import FOLDER, plan_of_path
from thirdbody.studies.sweep.sweep_file import is_sweep, sweep_of_options
from thirdbody.studies.sweep.sweep_folder import is_sweep_folder
from thirdbody.system.signals import stop_on_signal
from thirdbody.system.terminal import print_line

REPORTED = 5
"""Largest number of failed points that are listed at the end; the table has all."""


@dataclass(frozen=True)
class SweepArguments:
    """Arguments of the command: `path` of a sweep file, a scene with `vary`, or the folder of a sweep."""

    path: Path
    out: Path | None
    vary: Sequence[str]
    settings: dict[str, str]
    options: dict[str, Any]
    plugins: Sequence[Path]


def sweep_command(arguments: SweepArguments, execution: Execution, dry_run: bool, quiet: bool, json: bool) -> None:
    """Run `thirdbody sweep`. Raises ThirdbodyError; GuardStop where every point failed."""
    plan, folder = plan_of_arguments(arguments)
    if dry_run:
        from thirdbody.studies.sweep.estimate import estimate, print_estimate

        print_estimate(plan, estimate(plan, execution.workers), json)
        return

    def log(text: str) -> None:
        if not quiet:
            print_line(text, err=True)

    problem: Interrupted | None = None
    with stop_on_signal() as stop:
        try:
            with reporting(not quiet, plan.title) as report:
                execute_sweep(plan, folder, replace(execution, report=report, log=log, stop=stop))
        except Interrupted as error:
            problem = error
        print_sweep(Sweep(folder), json)
        if problem is not None:
            raise problem
    _refuse_only_failures(Sweep(folder))


def plan_of_arguments(arguments: SweepArguments) -> tuple[Plan, Path]:
    """Return the plan that the arguments describe, and its folder. Raises UsageError and InputError."""
    path, vary = arguments.path, arguments.vary
    if not vary:
        named = [*(["--set"] if arguments.settings else []), *(f"--{name.rstrip('s')}" for name in arguments.options)]
        if named:
            raise UsageError(f"{', '.join(named)}: only with --vary; in a sweep file these are keys")
        if not is_sweep_folder(path) and path.is_file() and not is_sweep(path):
            raise UsageError(f"{path}: is a scene; say what to vary: --vary KEY=FROM:TO:COUNT, or give a sweep file")
        if is_sweep_folder(path) and arguments.out is not None:
            raise UsageError(f"-o {arguments.out}: a sweep goes on in its own folder, {path}")
        return plan_of_path(path, arguments.out, arguments.plugins)
    if path.is_file() and is_sweep(path):
        raise UsageError(f"{path}: is a sweep file; --vary goes with a scene")
    settings = {key: toml_value(value) for key, value in arguments.settings.items()}
    options = arguments.options | ({"settings": settings} if settings else {})
    definition = sweep_of_options(os.fspath(path), vary, options)
    scene = Scene.load(path, arguments.plugins)
    folder = arguments.out or FOLDER / path.stem
    return make_plan(scene, definition, folder, arguments.plugins), folder


def print_sweep(sweep: Sweep, json: bool) -> None:
    """Print how many points are done, the failed ones, and where the table is; or the whole table as JSON."""
    if json:
        from thirdbody.report.tables import print_json

        rows = [vars(point) | {"folder": str(point.folder)} for point in sweep.points]
        print_json({"title": sweep.title, "axes": sweep.axes, "units": sweep.results, "points": rows})
        return
    done = sum(point.status == DONE for point in sweep.points)
    failed = [point for point in sweep.points if point.status == FAILED]
    for point in failed[:REPORTED]:
        values = ", ".join(f"{key} = {value}" for key, value in point.values.items())
        print_line(f"point {point.number} ({values}) failed: {point.reason}", err=True)
    if len(failed) > REPORTED:
        print_line(f"and {len(failed) - REPORTED} more failed points", err=True)
    print_line(
        f"{done} of {len(sweep.points)} points done{f', {len(failed)} failed' if failed else ''}: {sweep.path / 'points.csv'}"
    )


def _refuse_only_failures(sweep: Sweep) -> None:
    """Raise GuardStop, with the exit code of the first point, where no point is done."""
    if not any(point.status == DONE for point in sweep.points):
        error = GuardStop(f"{sweep.path}: every point failed")
        error.exit_code = sweep.points[0].exit_code or error.exit_code
        raise error
