"""What Python users call: `run`, `resume` and `open_run` return a `Run`, which draws and exports itself."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody.errors import UsageError
from thirdbody.system.processes import optional
from thirdbody.trajectory.open_file import FILE_NAME
from thirdbody.trajectory.run_file import RunFile

if TYPE_CHECKING:
    import pyvista
    from matplotlib.figure import Figure

    from thirdbody.runner.progress import Reporter
    from thirdbody.scene.model import Scene
    from thirdbody.studies.comparison import Comparison


class Run(RunFile):
    """A run, read from its file on demand; a context manager. Arrays are in SI units.

    F is the number of frames, B that of bodies. Only committed frames are read.

    Parameters
    ----------
    path : str or Path
        Folder of the run, or its `run.vtkhdf`.

    Raises
    ------
    InputError
        The file is missing, damaged or not a run.

    Examples
    --------
    >>> run.state_names
    ['free', 'sticking', 'sliding', 'rolling']
    >>> run.states.shape == (run.frames, len(run.bodies(-1)["position"]))
    True
    >>> run.units["friction_coefficient"], run.units["upper_force"]
    ('1', 'N')
    """

    @cached_property
    def scene(self) -> Scene:
        """The scene that was run. Raises InputError where a plug-in file brought a kind of its debris."""
        from thirdbody.scene.model import Scene

        return Scene.parse(self.scene_text, str(self.path.with_name("scene.toml")))

    def to_pandas(self, table: str = "series", frame: int | None = None) -> Any:
        """Return one table as a pandas DataFrame.

        Parameters
        ----------
        table : str
            `series`, `profiles`, `bodies`, `contacts`, `cycles`, `transitions` or `map_statistics` (of the run, and of a
            cycle where there is a rate).
        frame : int, optional
            Frame of profiles, bodies and contacts; None: all frames concatenated (column `frame`).

        Returns
        -------
        pandas.DataFrame
            Series have one row per frame, profiles one per slab, bodies and contacts one row each. Vectors are columns `_x`,
            `_y`, `_z`; states and reasons are given by code and by name. Units by column are in `.attrs["units"]`.

        Raises
        ------
        ImportError
            pandas is not installed; it is needed here only.
        ValueError, IndexError, AttributeError
            There is no such table, no such frame, no states, no profiles.
        """
        pandas = optional("pandas", "to_pandas()")
        from thirdbody.trajectory.columns import table as columns_of

        columns = columns_of(self, table, frame)
        data = pandas.DataFrame({column.name: column.values for column in columns})
        data.attrs["units"] = {column.name: column.unit or "1" for column in columns}
        return data

    def plot(self, out: str | Path | None = None, panels: Sequence[str] | None = None, frame: int = -1) -> Figure:
        """Draw the summary page.

        Parameters
        ----------
        out : str or Path, optional
            File to write besides (.png, .pdf, .svg).
        panels : sequence of str, optional
            Names of panels (`plot.summary_page.NAMES`) or of series; None: all panels that apply to the run.
        frame : int
            Frame of the contacts.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from thirdbody.plot.figures import checked_path, save
        from thirdbody.plot.summary_page import page

        path = None if out is None else checked_path(out)
        figure = page(self, panels, frame)
        if path is not None:
            save(figure, path)
        return figure

    def render(self, out: str | Path, **options: Any) -> Path:
        """Draw a picture (.png), a film (.gif, .mp4) or a page for a browser (.html).

        Parameters
        ----------
        out : str or Path
            File; its suffix says what is drawn.
        **options
            frame, color, size, zoom, view, forces, body, frames, fps, camera, plate, cycles;
            see `thirdbody.render.render.render`.

        Returns
        -------
        Path
            The file.
        """
        from thirdbody.render.render import render

        return render(self.path, out, **options)

    def export(
        self, *, csv: str | Path | None = None, pvd: str | Path | None = None, frame: int | None = None, overwrite: bool = False
    ) -> list[Path]:
        """Write the run in other formats.

        Parameters
        ----------
        csv, pvd : str or Path, optional
            Folders of tables, and of files for ParaView before 5.12.
        frame : int, optional
            One frame; None: all.
        overwrite : bool
            Replace what exists.

        Returns
        -------
        list of Path
            The files.

        Raises
        ------
        UsageError, InputError, OutputError
            No target is given; there is no such frame; a file exists or cannot be written.
        """
        from thirdbody.export.tables import export_run

        tables, files = (None if path is None else Path(path) for path in (csv, pvd))
        return list(export_run(self.path, tables, files, frame, overwrite))

    def to_pyvista(self, frame: int = -1) -> pyvista.MultiBlock:
        """Return one frame for pyvista.

        Parameters
        ----------
        frame : int, negative ones count from the end

        Returns
        -------
        pyvista.MultiBlock
            `spheres`, `clumps`, `contacts` (points) and `plates` (two rectangles), with the arrays of `block()` as point data.
            The unit of the array `force` is in the block's `field_data["force_units"]`; time, frame, and the names of states and
            reasons are in the `field_data` of the whole. Of rough plates also `lower_surface` and `upper_surface`, grids with the
            array `height`.

        Examples
        --------
        Surfaces of the debris, and arrows of the contact forces (0.1 m per N):

        >>> import pyvista
        >>> blocks = run.to_pyvista(-1)
        >>> balls = blocks["spheres"].glyph(scale="radius", geom=pyvista.Sphere(radius=1.0), orient=False)
        >>> arrows = blocks["contacts"].glyph(scale="force", orient="force", factor=0.1, geom=pyvista.Arrow())
        """
        from thirdbody.export.vtk import multiblock

        return multiblock(self, frame)

    def _repr_html_(self) -> str:
        """Return a table and the page for a browser as HTML, for notebooks."""
        from thirdbody.render.notebook import run_html

        return run_html(self)


def open_run(path: str | Path) -> Run:
    """Open a run.

    Parameters
    ----------
    path : str or Path
        Folder of the run, or its `run.vtkhdf`.

    Returns
    -------
    Run
        Its file stays open until `close`, or the end of a `with` block.

    Raises
    ------
    InputError
        The run is missing, damaged or not a run.

    Examples
    --------
    >>> with thirdbody.open("runs/example") as run:
    ...     run.friction.value < 0.3
    True
    """
    return Run(path)


def run(
    scene: Scene | str | os.PathLike[str] | Mapping[str, Any],
    out: str | Path | None = None,
    threads: int | None = None,
    progress: bool | Reporter = True,
    *,
    overwrite: bool = False,
    plugins: tuple[str | Path, ...] = (),
    force: bool = False,
) -> Run:
    """Simulate a scene and return the opened result.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        A scene, the path of a scene file, or a dictionary of tables with numbers in SI or text with units.
    out : str or Path, optional
        Folder of the run; None: `runs/<scene name>`.
    threads : int, optional
        Number of cores to use; None: all. Results have the same bits for any number.
    progress : bool or callable
        True: a bar, False: nothing. A callable gets a `Progress`: `fraction`, `simulated` and `elapsed` [s], `frame`, `series`.
    overwrite : bool
        Replace the run in the folder, once the new one has its first frame.
    plugins : tuple of str or Path
        Python files with a `PLUGIN` or `DEBRIS_KINDS`.
    force : bool
        Accept a time step above its bound.

    Returns
    -------
    Run

    Raises
    ------
    UsageError, InputError, OutputError
        The call, the scene or a file is wrong; the folder exists or cannot be written.
    GuardStop, Interrupted
        The run left its valid range; Ctrl-C in the main thread. The part computed so far can be opened, and `resume` continues
        an interrupted run. A second Ctrl-C raises KeyboardInterrupt at once, as does one before the first step.

    Examples
    --------
    >>> thirdbody.run("example.toml", out="runs/again", progress=False).summary()["finished"]
    True
    """
    from thirdbody.runner.run_folder import refuse_existing
    from thirdbody.runner.simulate import check_call, check_threads, default_folder, prepare, run_with_warnings
    from thirdbody.scene.model import Scene

    check_call(plugins, progress, overwrite=overwrite, force=force)
    notes = check_threads(threads)
    scene = Scene.of(scene, plugins)
    folder = Path(out) if out is not None else default_folder(scene)
    refuse_existing(folder, overwrite)
    run_with_warnings(prepare(scene, plugins, force), folder, threads, progress, notes, overwrite=overwrite)
    return Run(folder)


def resume(
    out: str | Path | Run,
    threads: int | None = None,
    progress: bool | Reporter = True,
    *,
    settings: Mapping[str, Any] | None = None,
    plugins: Iterable[str | Path] = (),
) -> Run:
    """Continue a run to its end and return the opened result, bit for bit that of an uninterrupted run.

    Parameters
    ----------
    out : str, Path or Run
        Folder of the run, its file run.vtkhdf, or a `Run`, whose open files stay readable.
    threads, progress
        As for `run`.
    settings : dict, optional
        A longer `solver.distance` or `solver.duration`, with which a finished run goes on. Its old end remains a stop, which ends
        steps of the implicit integrator: where it is an output of the longer scene, the bits are those of that scene.
    plugins : iterable of str or Path
        Python files that the run was started with.

    Returns
    -------
    Run

    Raises
    ------
    InputError
        There is no valid checkpoint, or the scene, a law or an input file has changed.
    UsageError, OutputError, GuardStop, Interrupted
        As for `run`.

    Examples
    --------
    >>> run = thirdbody.resume("runs/example", progress=False, settings={"solver.distance": "0.2 um"})
    >>> run.summary()["distance"] > 0.19e-6
    True
    """
    from thirdbody.runner.resume import prepare_resume
    from thirdbody.runner.simulate import check_call, check_threads, run_with_warnings

    check_call(plugins, progress)
    path = out.path if isinstance(out, RunFile) else Path(out)
    folder = path.parent if path.name == FILE_NAME else path
    notes = check_threads(threads)
    simulation, saved = prepare_resume(folder, settings or {}, plugins)
    run_with_warnings(simulation, folder, threads, progress, notes, checkpoint=saved)
    return Run(folder)


def compare(*runs: str | os.PathLike[str] | Run, bodies: int = 5, out: str | Path | None = None) -> Comparison:
    """Compare runs with the first one: numbers, keys of their scenes, series and, where they have the same bodies, each body.

    Parameters
    ----------
    *runs : str, Path or Run
        Folders of two or more runs, or their `run.vtkhdf`; the first is the reference. A run that was stopped will do.
    bodies : int
        Number of bodies to list, those whose places differ most.
    out : str or Path, optional
        Picture of the series over each other: .png, .pdf or .svg.

    Returns
    -------
    dict
        Printed, it is the text of `thirdbody compare`. `runs`, a list: each with its `results` in SI (`units`), their
        `difference` from the first, `over_range`, the relative differences over the common range (`studies.cost.errors` and
        those of bodies), `bodies_listed`, `labels`: `difference`, fraction by common stop, and the table `at_end` and
        `at_all_stops` of state in the first run (rows) and in this one (columns); or `not_by_body`, the reason why bodies are
        not compared. `settings`: keys that differ, with their value in each run.

    Raises
    ------
    UsageError, InputError, OutputError
        There are fewer than two runs; one is missing, damaged or has no frame; the picture cannot be written.

    Examples
    --------
    >>> report = thirdbody.compare("runs/example", "runs/example")
    >>> report["settings"], report["runs"][1]["over_range"]["friction_error"]
    ({}, 0.0)
    """
    from thirdbody.studies.comparison import compare_runs

    if len(runs) < 2:
        raise UsageError(f"{len(runs)} run{'s' * (len(runs) != 1)}: give two or more, the first is the reference")
    if bodies < 0:
        raise UsageError(f"bodies = {bodies}: must be at least 0")
    with ExitStack() as stack:
        if out is not None:
            from thirdbody.plot.figures import checked_path

            out = checked_path(out)
        opened = [run if isinstance(run, RunFile) else stack.enter_context(Run(Path(run))) for run in runs]
        report = compare_runs(opened, bodies)
    if out is not None:
        from thirdbody.plot.comparison_plot import draw_comparison
        from thirdbody.plot.figures import save

        save(draw_comparison(report), Path(out))
    return report
