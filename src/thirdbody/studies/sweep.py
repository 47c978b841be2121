"""Sweeps: `thirdbody.sweep`, its result, and the command `thirdbody sweep`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody.errors import Fault, GuardStop, InputError, Interrupted, UsageError
from thirdbody.runner.prepare import check_call
from thirdbody.scene.model import Scene
from thirdbody.scene.overrides import toml_value
from thirdbody.scene.read import read_text
from thirdbody.studies.folder import SCENE_FILE, is_sweep_folder, read_document, sweep_folder
from thirdbody.studies.plan import Plan, estimate, make_plan, print_estimate
from thirdbody.studies.point import DONE, FAILED
from thirdbody.studies.runner import Execution, SweepReporter, execute_sweep, reporting
from thirdbody.studies.sweep_file import is_sweep, read_sweep, saved_definition, sweep_of_options, sweep_of_python
from thirdbody.studies.sweep_table import SweepTable
from thirdbody.system.signals import stop_on_ctrl_c, stop_on_signal
from thirdbody.system.terminal import print_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOLDER = Path("sweeps")
"""Folder of sweeps that name none."""

REPORTED = 5
"""Largest number of failed points that are listed at the end; the table has all."""


class Sweep(SweepTable):
    """A sweep on the disk, finished or not; read when opened.

    Parameters
    ----------
    path : str or Path
        Its folder, or the `points.csv` in it.

    Notes
    -----
    `points` lists all points in the order of the table; each has `values` of the axes (SI), `status`, `reason`, `exit_code`,
    `seconds`, `results`, `folder` and `run`. `axes` and `results` give the units by name, "1" for pure numbers and texts.

    Raises
    ------
    InputError
        There is no sweep, or it is damaged.
    """

    def plot(
        self,
        out: str | os.PathLike[str] | None = None,
        panels: Sequence[str] | None = None,
        x: str | None = None,
        y: str | None = None,
    ) -> Figure:
        """Draw curves of the results over one axis, or maps over two; return the figure.

        Parameters
        ----------
        out : str or Path, optional
            Picture file: .png, .pdf or .svg.
        panels : sequence of str, optional
            Results to draw; None: friction, fractions of states.
        x, y : str, optional
            Axes of the picture; None: chosen by their number of values. Seeds, and axes that are not drawn, are averaged, with
            the standard error as a bar.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from thirdbody.studies.sweep_plot import draw_sweep

        return draw_sweep(self, None if out is None else Path(out), panels, x, y)


def sweep(
    scene: Scene | str | os.PathLike[str] | Mapping[str, Any],
    vary: Mapping[Any, Any] | Sequence[Mapping[str, Any]] | None = None,
    out: str | os.PathLike[str] | None = None,
    executor: Any = None,
    *,
    resume: bool | str = False,
    progress: bool | SweepReporter = True,
    plugins: Iterable[str | Path] = (),
    **options: Any,
) -> Sweep:
    """Run a scene at many points and return the opened sweep; a point that fails is a row of its table.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        As for `run`; without `vary` the path of a sweep file, or with `resume` the folder of a sweep.
    vary : dict or sequence of dict
        Values by key: a list, an array, or {"from": 0.05, "to": 0.6, "count": 12, "scale": "log"}; the keys of a tuple move
        together, and its values are tuples. Or the points themselves: a list with a dictionary for each. Numbers are in SI.
    out : str or Path, optional
        Folder of the sweep; None: `sweeps/<name of the scene or sweep file>`.
    executor : optional
        A Dask client, or anything with the `submit` of `concurrent.futures`; its workers must reach `out`. None: local processes
        with one thread each.
    resume : bool or str
        True: do what is missing in the folder, within a point from its checkpoint. "failed": run failed points again too.
    progress : bool or callable
        True: a bar, False: nothing. A callable gets a `SweepProgress`: `done`, `failed`, `total`, `elapsed` [s], `left` [s].
    plugins : iterable of str or Path
        Python files with a `PLUGIN` or `DEBRIS_KINDS`.
    **options
        Keys of a sweep file: `design` ("grid", "zip", "sobol", "latin_hypercube"), `samples`, `seed`, `results`, `keep` ("all",
        "summary"), `settings`. And `workers`, the number of local processes (default: as many as cores).

    Returns
    -------
    Sweep

    Raises
    ------
    UsageError, InputError, OutputError
        The call, a key or a value of any point is wrong, all faults at once, before anything runs; the folder exists.
    Interrupted
        Ctrl-C: what is done is kept, and `resume` goes on.

    Examples
    --------
    >>> mu = {"from": 0.1, "to": 0.3, "count": 3}
    >>> sweep = thirdbody.sweep("example.toml", {"pairs.0.friction": mu}, "sweeps/mu", progress=False)
    >>> [point.status for point in sweep.points]
    ['done', 'done', 'done']
    """
    check_call(plugins, progress)
    workers = _workers(options.pop("workers", None), executor, resume)
    plan, folder = _plan_of_python(scene, vary, None if out is None else Path(out), plugins, options)
    with reporting(progress, plan.title) as report, stop_on_ctrl_c() as stop:
        execution = Execution(executor, workers, bool(resume), resume == "failed", report, stop=stop)
        execute_sweep(plan, folder, execution)
    return Sweep(folder)


def _workers(workers: Any, executor: Any, resume: Any) -> int | None:
    """Return the number of workers. Raises UsageError for a wrong one, and for a wrong `executor` or `resume`."""
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise UsageError(f"executor = {executor!r}: must be a Dask client, or have the `submit` of concurrent.futures")
    if workers is not None and (not isinstance(workers, int) or isinstance(workers, bool) or workers < 1):
        raise UsageError(f"workers = {workers!r}: must be a whole number of at least 1")
    if resume not in (True, False, "failed"):
        raise UsageError(f"resume = {resume!r}: must be True, False or 'failed'")
    return workers


def _plan_of_python(
    scene: Any, vary: Any, out: Path | None, plugins: Iterable[str | Path], options: Mapping[str, Any]
) -> tuple[Plan, Path]:
    """Return the plan of the arguments of `sweep`, and its folder."""
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
    path = Path(scene)
    if path.is_file() and not is_sweep_folder(path) and not is_sweep(path):
        raise UsageError(f"{path}: is a scene; give `vary`, or a sweep file")
    return plan_of_path(path, out, plugins)


def plan_of_path(path: Path, out: Path | None, plugins: Iterable[str | Path] = ()) -> tuple[Plan, Path]:
    """Return the plan of a sweep file, or that of a sweep's folder, and the folder. Raises InputError."""
    if is_sweep_folder(path):
        folder, document = sweep_folder(path), read_document(path)
        if "study" in document:
            raise InputError(f"{path}: is a study of cost; thirdbody cost SCENE -o {folder} --resume goes on with it")
        file, files = folder / SCENE_FILE, [Path(file) for file in document["plugins"]]
        scene = Scene.parse(read_text(file), str(file), document["scene_folder"], files)
        return make_plan(scene, saved_definition(document), folder, files), folder
    if path.is_dir():
        raise InputError(Fault("", "is no folder of a sweep", str(path)))
    definition, folder = read_sweep(path), out or FOLDER / path.stem
    file = definition.folder / definition.tables.scene  # relative to the sweep file
    if not file.exists():
        raise InputError(definition.fault(("scene",), f"{file}: no such file"))
    return make_plan(Scene.load(file, plugins), definition, folder, plugins), folder


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
        print_sweep(SweepTable(folder), json)
        if problem is not None:
            raise problem
    points = SweepTable(folder).points
    if not any(point.status == DONE for point in points):
        failure = GuardStop(f"{folder}: every point failed")
        failure.exit_code = points[0].exit_code or failure.exit_code
        raise failure


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


def print_sweep(sweep: SweepTable, json: bool) -> None:
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
