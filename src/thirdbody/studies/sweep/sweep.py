"""Sweeps from Python: `thirdbody.sweep`, and what the command shares with it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from thirdbody.errors import Fault, InputError, UsageError
from thirdbody.runner.simulate import check_call
from thirdbody.scene.model import Scene
from thirdbody.studies.sweep.execution import Execution, execute_sweep
from thirdbody.studies.sweep.plan import Plan, make_plan
from thirdbody.studies.sweep.progress import SweepReporter, reporting
from thirdbody.studies.sweep.reader import Sweep
from thirdbody.studies.sweep.sweep_file import Definition, is_sweep, read_sweep, saved_definition, sweep_of_python
from thirdbody.studies.sweep.sweep_folder import is_sweep_folder, read_document, saved_scene, sweep_folder
from thirdbody.system.signals import stop_on_ctrl_c

FOLDER = Path("sweeps")
"""Folder of sweeps that name none."""


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
        scene, files = saved_scene(folder, document), [Path(file) for file in document["plugins"]]
        return make_plan(scene, saved_definition(document), folder, files), folder
    if path.is_dir():
        raise InputError(Fault("", "is no folder of a sweep", str(path)))
    definition = read_sweep(path)
    folder = out or FOLDER / path.stem
    return make_plan(load_scene(definition, plugins), definition, folder, plugins), folder


def load_scene(definition: Definition, plugins: Iterable[str | Path]) -> Scene:
    """Return the scene of a sweep file, beside which it lies. Raises InputError."""
    path = definition.folder / definition.tables.scene
    if not path.exists():
        raise InputError(definition.fault(("scene",), f"{path}: no such file"))
    return Scene.load(path, plugins)
