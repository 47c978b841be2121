"""What Python users call for sweeps: `sweep` returns a `Sweep`, which draws itself and whose points open their runs."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody.api import Run
from thirdbody.studies.folder import SweepTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from thirdbody.scene.model import Scene
    from thirdbody.studies.runner import SweepReporter


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

    opened = Run

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
        from thirdbody.studies.pictures import draw_sweep

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
    from thirdbody.studies.sweep import execution_of_python, plan_of_python, run_sweep

    execution = execution_of_python(executor, options.pop("workers", None), resume, progress, plugins)
    plan, folder = plan_of_python(scene, vary, None if out is None else Path(out), plugins, options)
    run_sweep(plan, folder, execution, progress)
    return Sweep(folder)
