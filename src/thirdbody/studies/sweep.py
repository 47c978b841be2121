"""The plans of sweeps, and the command `thirdbody sweep`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from thirdbody.errors import Fault, GuardStop, InputError, Interrupted, UsageError
from thirdbody.runner.simulate import check_call
from thirdbody.scene.model import Scene
from thirdbody.schema.read import read_text
from thirdbody.studies.folder import SCENE_FILE, TABLE, SweepTable, is_sweep_folder, read_document, sweep_folder
from thirdbody.studies.plan import Plan, estimate, make_plan, print_estimate
from thirdbody.studies.point import DONE, FAILED
from thirdbody.studies.runner import Execution, execute_sweep, reporting
from thirdbody.studies.sweep_file import is_sweep, read_sweep, saved_definition, sweep_of_options, sweep_of_python
from thirdbody.system.signals import stop_on_ctrl_c, stop_on_signal
from thirdbody.system.terminal import print_line

FOLDER = Path("sweeps")  # folder of sweeps that name none
REPORTED = 5  # largest number of failed points that are listed at the end; the table has all


def execution_of_python(executor: Any, workers: Any, resume: Any, progress: Any, plugins: Iterable[str | Path]) -> Execution:
    """Return how a sweep is carried out. Raises UsageError for a wrong argument."""
    check_call(plugins, progress)
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise UsageError(f"executor = {executor!r}: must be a Dask client, or have the `submit` of concurrent.futures")
    if workers is not None and (not isinstance(workers, int) or isinstance(workers, bool) or workers < 1):
        raise UsageError(f"workers = {workers!r}: must be a whole number of at least 1")
    if resume not in (True, False, "failed"):
        raise UsageError(f"resume = {resume!r}: must be True, False or 'failed'")
    return Execution(executor, workers, bool(resume), resume == "failed")


def plan_of_python(
    scene: Any, vary: Any, out: Path | None, plugins: Iterable[str | Path], options: Mapping[str, Any]
) -> tuple[Plan, Path]:
    """Return the plan of the arguments of `thirdbody.sweep`, and its folder. Raises UsageError and InputError."""
    if vary is not None:
        points = isinstance(vary, Sequence) and not isinstance(vary, str) and all(isinstance(point, Mapping) for point in vary)
        if not isinstance(vary, Mapping) and not points:
            raise UsageError(f"vary = {vary!r}: must be a dictionary of values by key, or a list of dictionaries")
        base = Scene.of(scene, plugins)
        folder = out or FOLDER / (base.name or "sweep")
        return make_plan(base, sweep_of_python(vary, options), folder, plugins), folder
    if options:
        raise UsageError(f"{', '.join(options)}: options of a sweep go with `vary`; in a sweep file they are keys")
    if isinstance(scene, Scene | Mapping):
        raise UsageError("give `vary`, or a sweep file instead of a scene")
    return plan_of_path(Path(scene), out, plugins)


def run_sweep(plan: Plan, folder: Path, execution: Execution, progress: Any) -> None:
    """Run a sweep until it is done, or Ctrl-C. Raises OutputError and Interrupted."""
    with reporting(progress, plan.title) as report, stop_on_ctrl_c() as stop:
        execute_sweep(plan, folder, replace(execution, report=report, stop=stop))


def plan_of_path(path: Path, out: Path | None, plugins: Iterable[str | Path] = ()) -> tuple[Plan, Path]:
    """Return the plan of a sweep file, or that of a sweep's folder, and the folder. Raises InputError, UsageError for a scene."""
    if is_sweep_folder(path):
        folder, document = sweep_folder(path), read_document(path)
        if "study" in document:
            raise InputError(f"{path}: is a study of cost; thirdbody cost SCENE -o {folder} --resume goes on with it")
        file, files = folder / SCENE_FILE, [Path(file) for file in document["plugins"]]
        scene = Scene.parse(read_text(file), str(file), document["scene_folder"], files)
        return make_plan(scene, saved_definition(document), folder, files), folder
    if os.path.isdir(path):
        raise InputError(Fault("", "is no folder of a sweep", str(path)))
    if path.is_file() and not is_sweep(path):
        raise UsageError(f"{path}: is a scene", python="; give `vary`, or a sweep file",
                         command="; say what to vary: --vary KEY=FROM:TO:COUNT, or give a sweep file")  # fmt: skip
    definition, folder = read_sweep(path), out or FOLDER / path.stem
    file = definition.folder / definition.tables.scene  # relative to the sweep file
    if not os.path.exists(file):
        raise InputError(definition.source.fault(("scene",), f"{file}: no such file"))
    return make_plan(Scene.load(file, plugins), definition, folder, plugins), folder


def sweep_command(plan: Plan, folder: Path, execution: Execution, dry_run: bool, quiet: bool, json: bool) -> None:
    """Run `thirdbody sweep`. Raises ThirdbodyError; GuardStop where every point failed."""
    if dry_run:
        print_estimate(plan, estimate(plan, execution.workers), json)
        return

    def log(text: str) -> None:
        if not quiet:
            print_line(text, err=True)

    with stop_on_signal() as stop:
        try:
            with reporting(not quiet, plan.title) as report:
                execute_sweep(plan, folder, replace(execution, report=report, log=log, stop=stop))
        except Interrupted:
            print_sweep(SweepTable(folder), json)
            raise
        table = SweepTable(folder)
        print_sweep(table, json)
    if not any(point.status == DONE for point in table.points):
        failure = GuardStop(f"{folder}: every point failed")
        failure.exit_code = table.points[0].exit_code or failure.exit_code
        raise failure


def plan_of_options(
    path: Path, out: Path | None, vary: Sequence[str], options: Mapping[str, Any], plugins: Sequence[Path]
) -> tuple[Plan, Path]:
    """Return the plan of a sweep file, of a scene with `--vary`, or of the folder of a sweep, and its folder.

    Raises UsageError and InputError.
    """
    if not vary:
        flags = {"settings": "--set", "results": "--result"}
        if options:
            named = ", ".join(flags.get(name, f"--{name}") for name in options)
            raise UsageError(f"{named}: only with --vary; in a sweep file these are keys")
        if is_sweep_folder(path) and out is not None:
            raise UsageError(f"-o {out}: a sweep goes on in its own folder, {path}")
        return plan_of_path(path, out, plugins)
    if path.is_file() and is_sweep(path):
        raise UsageError(f"{path}: is a sweep file; --vary goes with a scene")
    definition, folder = sweep_of_options(os.fspath(path), vary, options), out or FOLDER / path.stem
    return make_plan(Scene.load(path, plugins), definition, folder, plugins), folder


def print_sweep(sweep: SweepTable, json: bool) -> None:
    """Print how many points are done, the failed ones, and where the table is; or the whole table as JSON."""
    if json:
        from thirdbody.report.tables import print_json

        names = ("number", "values", "status", "reason", "exit_code", "seconds", "results")
        rows = [{name: getattr(point, name) for name in names} | {"folder": str(point.folder)} for point in sweep.points]
        print_json({"title": sweep.title, "axes": sweep.axes, "units": sweep.results, "points": rows})
        return
    failed = [point for point in sweep.points if point.status == FAILED]
    for point in failed[:REPORTED]:
        values = ", ".join(f"{key} = {value}" for key, value in point.values.items())
        print_line(f"point {point.number} ({values}) failed: {point.reason}", err=True)
    if len(failed) > REPORTED:
        print_line(f"and {len(failed) - REPORTED} more failed points", err=True)
    done, more = sum(point.status == DONE for point in sweep.points), f", {len(failed)} failed" if failed else ""
    print_line(f"{done} of {len(sweep.points)} points done{more}: {sweep.path / TABLE}")
