"""Reader of a run: its arrays, and what is computed, drawn and exported from them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.trajectory.open_file import FILE_NAME
from thirdbody.trajectory.plate_maps import PLATES, map_units, read_maps, refuse_other_plates
from thirdbody.trajectory.run_arrays import RunArrays
from thirdbody.trajectory.schema import SUMMARY_TEXT
from thirdbody.trajectory.validate import damage_as_fault

if TYPE_CHECKING:
    import pyvista
    from matplotlib.figure import Figure

    from thirdbody.scene.model import Scene
    from thirdbody.trajectory.bed_verdict import Bed
    from thirdbody.trajectory.friction import Friction
    from thirdbody.trajectory.plate_motion import Drag

__all__ = ["FILE_NAME", "Run", "open_run"]


class Run(RunArrays):
    """A run, read from its file on demand; a context manager. Arrays are in SI units.

    F is the number of frames, B that of bodies. Only committed frames are read.

    Parameters
    ----------
    path : str or Path
        The file `run.vtkhdf`; `thirdbody.open` takes its folder too.

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

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.frames

    def __bool__(self) -> bool:
        """Return True, also for a run without frames."""
        return True

    @cached_property
    def scene(self) -> Scene:
        """The scene that was run. Raises InputError where a plug-in file brought a kind of its debris."""
        from thirdbody.scene.model import Scene

        return Scene.parse(self.scene_text, str(self.path.with_name("scene.toml")))

    @cached_property
    def scene_bodies(self) -> int:
        """Number of bodies of the scene: more than the file holds where `output.sample` restricts it."""
        return int(self.header.get("scene_bodies", self.rows("clumps", 0) if self.frames else 0))

    @cached_property
    def drag(self) -> Drag:
        """Motion of the upper plate: displacement, turns, whole cycles of a stroke."""
        from thirdbody.trajectory.plate_motion import Drag

        return Drag(self, self._steady("", self._stored_summary))

    @cached_property
    def friction(self) -> Friction:
        """Friction coefficient of the run: `value`, `error`, `verdict` on whether it is stationary, and more."""
        from thirdbody.trajectory.friction import friction_of

        with damage_as_fault(self.path, "the series of friction"):
            return friction_of(self)

    @cached_property
    def bed(self) -> Bed | None:
        """Measures of the bed over the steady part: `means`, `errors`, `verdict` on whether shear is slow; None without one."""
        from thirdbody.trajectory.bed_verdict import bed_of

        with damage_as_fault(self.path, "the series of the bed"):
            return bed_of(self)

    @cached_property
    def cycles(self) -> dict[str, np.ndarray]:
        """Energy and extremes of the whole cycles of a stroke by name, one value per cycle (n,); n is 0 without a stroke.

        Names and units: `trajectory.friction.friction_cycles`.
        """
        from thirdbody.trajectory.friction import friction_cycles

        with damage_as_fault(self.path, "the series of friction"):
            return friction_cycles(self)

    @cached_property
    def map_units(self) -> dict[str, str]:
        """Unit of each map of the plates, by name; none without `measures.cell`."""
        return self._steady("the maps", lambda: map_units(self.file))

    def maps(self, plate: str, frame: int = -1) -> dict[str, np.ndarray]:
        """Return what measures have left on a plate since the start of the run.

        Parameters
        ----------
        plate : str
            `lower` or `upper`.
        frame : int
            Number of the frame; negative ones count from the end.

        Returns
        -------
        dict of str to ndarray
            Maps by name, each (n_y, n_x): the cell [j, i] begins at i L_x/n_x, j L_y/n_y of the plate's own coordinates, in which
            the plate was at the start. Units are in `map_units`; empty without `measures.cell`.

        Raises
        ------
        ValueError, IndexError
            There is no such plate, or no such frame.
        """
        refuse_other_plates(plate)
        number = self.frame_number(frame)
        both = self._steady("the maps", lambda: read_maps(self.file, number))
        return {name: values[PLATES.index(plate)] for name, values in both.items()}

    @cached_property
    def warnings(self) -> list[str]:
        """Warnings before the run and at its end, as the command line prints them."""
        return list(self.summary()["warnings"])

    def map_statistics(self, cycles: float | None = None, frame: int = -1) -> dict[str, np.ndarray]:
        """Return depth, area and volume of the wear of the plates in numbers, and likewise of every map.

        Parameters
        ----------
        cycles : float, optional
            Of so many cycles of a stroke, at the mean rate of the whole cycles without the first one: an extrapolation, as the
            shapes of bodies do not change. None: since the start of the run.
        frame : int
            Number of the frame, where `cycles` is None; negative ones count from the end.

        Returns
        -------
        dict of str to ndarray
            One row per plate and map: plate, map, mean, percentile_95 and largest [unit] of the cells that have any, unit,
            area_fraction of these cells, total over the plate [total_unit], such as the worn volume, total_unit. No rows in a run
            without maps.

        Raises
        ------
        InputError
            `cycles` is given, and the run has fewer than two whole ones.
        IndexError
            There is no such frame.
        """
        from thirdbody.trajectory.map_statistics import map_statistics

        return map_statistics(self, cycles, frame)

    def transitions(self) -> dict[str, np.ndarray]:
        """Return the changes of state between frames.

        Returns
        -------
        dict of str to ndarray
            One row per change: frame, time [s], distance [m], body, from, to, reason, position (n, 3) [m].

        Raises
        ------
        AttributeError
            The run recorded no states.
        """
        from thirdbody.trajectory.transitions import state_transitions

        return state_transitions(self)

    def summary(self) -> dict[str, Any]:
        """Return the summary that the run stored at its end, and figures computed from its frames.

        Returns
        -------
        dict
            Numbers, texts and lists by name; figures whose series the run lacks are absent.

        Notes
        -----
        `warnings`: those of `Run.warnings`. From the frames: `finished` (False when the run was killed, interrupted or stopped by
        a guard; then `stopped` may give the reason), `frames`, `bodies`, `duration` [s], `distance` [m],
        `friction_coefficient`, `friction_coefficient_error` and `friction_verdict` (value, error and verdict of `friction`),
        for strokes `cycles` and `energy_per_cycle` [J],
        `accommodation` (fractions of the plate's path taken up by `upper_slip`, `lower_slip`, `rolling` and `shear`, over the
        second half of the sliding or of the cycles), `fractions` (state name to fraction of the bodies, last frame), and the
        same by `populations`, `materials` and `sizes` (lists from `trajectory.state_groups.states_by_group`). Of a bed the means
        of its series over the steady part (`inertial_number`, `softness`, `solid_fraction`, ...) and their errors
        (`inertial_number_error`, ...), `quasi_static` (true or false), `bed_verdict` and `softness_verdict` (texts).

        Of a finished run also what it stored, such as `energy_residual` (relative), `energy_verdict` (likely reason, only where
        the residual or the numerical loss or gain is too large), `peak_pressure` (largest over contacts and frames [Pa]),
        `first_yield` (its `ratio` to the pressure at first yield; whether the yield strength is `assumed`),
        `energy_numerical_share` (loss by the implicit integrator, negative for a gain, divided as the residual), `load_ratio`
        (mean force on the upper plate over its load, last interval), for implicit runs `steps_limited_by` (cause to number of
        steps), and for quasi-static ones `patches_not_carried` (number at the end) and `largest_fraction_rolling` (over all
        frames).
        """
        from thirdbody.trajectory.run_summary import run_summary

        with damage_as_fault(self.path, "its summary"):
            return run_summary(self, self._steady("", self._stored_summary))

    def _stored_summary(self) -> dict[str, Any] | None:
        """Return what the run stored at its end; None where it did not get there."""
        return dict(self._text(SUMMARY_TEXT)) if SUMMARY_TEXT in self._scene else None

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
        try:
            import pandas
        except ImportError as error:
            raise ImportError("to_pandas() needs pandas: pip install pandas") from error
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
            Names of panels (`plot.summary_page`); None: all that apply to the run.
        frame : int
            Frame of the contacts.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from thirdbody.plot.summary_page import checked_path, page, save

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
        from thirdbody.export.export_run import export_run

        tables, files = (None if path is None else Path(path) for path in (csv, pvd))
        return list(export_run(self.path, tables, files, frame, overwrite))

    def to_pyvista(self, frame: int = -1) -> pyvista.MultiBlock:
        """Return one frame for pyvista.

        Parameters
        ----------
        frame : int
            Number of the frame; negative ones count from the end.

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
        from thirdbody.trajectory.pyvista_blocks import multiblock

        return multiblock(self, frame)

    def _repr_html_(self) -> str:
        """Return a table and a picture as HTML, for notebooks."""
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
    path = Path(path)
    return Run(path / FILE_NAME if os.path.isdir(path) else path)
