"""Reads a run back: arrays per frame, series, names, texts and summary, from `run.vtkhdf`.

Only committed frames exist for the reader: a file whose run was killed, or is still running, reads to its
last one.
"""

from __future__ import annotations

import operator
import os
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import h5py
import numpy as np

from thirdbody.trajectory.block_reader import BlockReader
from thirdbody.trajectory.energy_check import energy_verdict
from thirdbody.trajectory.named_arrays import Named
from thirdbody.trajectory.open_file import FILE_NAME, OpenFile
from thirdbody.trajectory.schema import BLOCKS, POSITION, STATIC_TEXT, SUMMARY_TEXT, Frame
from thirdbody.trajectory.texts import read_text, refuse_large_texts
from thirdbody.trajectory.validate import damage_as_fault, refuse_unsound

if TYPE_CHECKING:
    import pyvista
    from matplotlib.figure import Figure

    from thirdbody.trajectory.friction import Friction
    from thirdbody.trajectory.plate_motion import Drag

__all__ = ["FILE_NAME", "Run", "open_run"]

Result = TypeVar("Result")


class Run:
    """One run, read from its file when asked; a context manager. Arrays are in SI units.

    `open_run` makes it. Raises InputError when the file is missing, damaged or not one of ours.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self._open = OpenFile(self.path)
        try:
            self._open.steady(self._connect)
        except BaseException:
            self.close()
            raise

    def _connect(self) -> None:
        """Open the file and look at all that is needed to read it; of an open one the frames stay those that it had."""
        self._open.connect()
        with damage_as_fault(self.path):
            self._blocks = Named((name, BlockReader(self.file["VTKHDF"][name], self.path)) for name in BLOCKS)
            self._series_group, self._scene = self.file["series"], self.file["scene"]
            counts = [block.frames for block in self._blocks.values()]
            # A run killed between two counts has some one higher: the lowest is what is whole.
            frames = min(counts + [int(self._series_group.attrs["NSteps"])])
            refuse_large_texts(self._scene)
            self.header = {name: self._text(name) for name in self._scene if name != SUMMARY_TEXT}
            self.state_names: list[str] = list(self.header["state_names"])
            self.reason_names: list[str] = list(self.header["reason_names"])
            refuse_unsound(self.file, self.header, frames)
            codes = {"state": len(self.state_names), "state_reason": len(self.reason_names)}
            self._blocks["clumps"].names_of = codes
            self.frames: int = min(getattr(self, "frames", frames), frames)

    @property
    def file(self) -> h5py.File:
        """The HDF5 file."""
        return self._open.file

    def _steady(self, where: str, read: Callable[[], Result]) -> Result:
        """What `read` gives; damage is told with its place, and a file that is being written is read again."""

        def told() -> Result:
            with damage_as_fault(self.path, where):
                return read()

        return self._open.steady(told, self._connect)

    def _text(self, name: str) -> Any:
        with damage_as_fault(self.path, f"/scene/{name}"):
            return read_text(self._scene[name])

    @property
    def scene_text(self) -> str:
        """The resolved scene as the run used it."""
        return str(self.header["scene_text"])

    @cached_property
    def times(self) -> np.ndarray:
        """Times of the frames (F,), s."""
        return self._steady("the times", lambda: self.file["VTKHDF/clumps/Steps/Values"][: self.frames])

    @cached_property
    def states(self) -> np.ndarray:
        """State codes (F, B) uint8; their names are `state_names`."""
        return self._history("state")

    @cached_property
    def reasons(self) -> np.ndarray:
        """Reason codes (F, B); their names are `reason_names`."""
        return self._history("state_reason")

    @cached_property
    def forecast(self) -> np.ndarray:
        """Forecast state codes (F, B) uint8; AttributeError when the run recorded none."""
        return self._history("forecast")

    @property
    def has_states(self) -> bool:
        """Whether the run's laws tell states."""
        return "state" in self._names("clumps")

    def _history(self, name: str) -> np.ndarray:
        if name not in self._names("clumps"):
            raise AttributeError(f"{self.path}: this run recorded no '{name}' of its bodies")
        return self._steady("", lambda: self._blocks["clumps"].history(name, self.frames))

    def _names(self, block: str) -> list[str]:
        """Names of the arrays of a block."""
        return self._steady("", lambda: self._blocks[block].names)

    @cached_property
    def series(self) -> dict[str, np.ndarray]:
        """Series by name, each (F,) or (F, 3); units in `units`."""
        return self._steady(
            "the series", lambda: Named((name, self._series_group[name][: self.frames]) for name in self._series_group)
        )

    @cached_property
    def units(self) -> dict[str, str]:
        """Unit of each series, `1` for a pure number."""
        return self._steady(
            "the units", lambda: Named((name, str(self._series_group[name].attrs["units"])) for name in self._series_group)
        )

    @cached_property
    def material_names(self) -> list[str]:
        """Names of the materials, by the codes of the bodies' array `material`."""
        return list(self.header.get("materials", []))

    @cached_property
    def population_names(self) -> list[str]:
        """Names of the populations, by the codes of the bodies' array `population`."""
        from thirdbody.trajectory.state_groups import names_from_scene

        names = self.header.get("populations")
        return names_from_scene(self.scene_text) if names is None else list(names)

    @cached_property
    def drag(self) -> Drag:
        """How the upper plate moved: displacement, turns, whole cycles of a stroke."""
        from thirdbody.trajectory.plate_motion import Drag

        return Drag(self)

    @cached_property
    def friction(self) -> Friction:
        """The friction coefficient of the run: `value`, `error`, `verdict` on whether it is stationary, and more."""
        from thirdbody.trajectory.friction import friction_of

        with damage_as_fault(self.path, "the series of friction"):
            return friction_of(self)

    @cached_property
    def cycles(self) -> dict[str, np.ndarray]:
        """Energy and extremes of the whole cycles of a stroke by name, one value per cycle (n,); n is 0 without a stroke.

        Names and units: `trajectory.friction.friction_cycles`.
        """
        from thirdbody.trajectory.friction import friction_cycles

        with damage_as_fault(self.path, "the series of friction"):
            return friction_cycles(self)

    def bodies(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Arrays of the bodies (clumps) by name, one row per body: `position`, `quaternion`, `state`, ..."""
        return self.block("clumps", frame)

    def spheres(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Arrays of the spheres that the bodies are made of: `position`, `radius`, `clump`, ..."""
        return self.block("spheres", frame)

    def contacts(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Arrays of the contacts, one row each, perhaps none: `position`, `vector`, `utilisation`, ..."""
        return self.block("contacts", frame)

    def plates(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Arrays of the plates' corners (8, 3): lower four, upper four; (0, 3) without plates."""
        return self.block("plates", frame)

    def block(self, name: str, frame: int = -1) -> dict[str, np.ndarray]:
        """All arrays of one block of the file: `spheres`, `clumps` (the bodies), `contacts` or `plates`."""
        number = self.frame_number(frame)
        return self._open.steady(lambda: self._blocks[name].read(number), self._connect)

    def array(self, block: str, name: str, frame: int = -1) -> np.ndarray:
        """One array of one block, without reading the others. Raises KeyError for a name that the run has not."""
        number = self.frame_number(frame)
        return self._open.steady(lambda: self._blocks[block].array(name, number), self._connect)

    def rows(self, block: str, frame: int = -1) -> int:
        """Number of rows of one block: bodies, contacts, ..."""
        number = self.frame_number(frame)
        return self._open.steady(lambda: self._blocks[block].rows(number), self._connect)

    def transitions(self) -> dict[str, np.ndarray]:
        """Changes of state between successive frames, one row each: frame, time, distance, body, from, to, reason, position.

        See `transitions.state_transitions`. Raises AttributeError when the run recorded no states.
        """
        from thirdbody.trajectory.transitions import state_transitions

        return state_transitions(self)

    def frame_number(self, frame: int) -> int:
        """The frame counted from 0; negative ones count from the end. Raises IndexError outside the run, TypeError for 1.5."""
        try:
            frame = operator.index(frame)
        except TypeError:
            raise TypeError(f"{self.path}: a frame is a whole number, not {frame!r}") from None
        if not -self.frames <= frame < self.frames:
            inside = f"from {-self.frames} to {self.frames - 1}" if self.frames else "none: nothing was written yet"
            raise IndexError(f"{self.path}: no frame {frame}; frames are {inside}")
        return frame % self.frames

    def static_arrays(self) -> dict[str, dict[str, np.ndarray]]:
        """Per block the arrays that hold for all frames, as `TrajectoryWriter` takes them."""
        names: Mapping[str, list[str]] = self.header[STATIC_TEXT]
        data = {block: self.file["VTKHDF"][block]["PointData"] for block in names}
        return {block: {name: data[block][name][()] for name in names[block]} for block in names}

    def stored_frame(self, frame: int) -> Frame:
        """One frame as `TrajectoryWriter.append` takes it, for copies."""
        number = self.frame_number(frame)
        blocks = {}
        for name in BLOCKS:
            arrays = self.block(name, number)
            static = self.header[STATIC_TEXT].get(name, ())
            blocks[name] = {("points" if k == POSITION else k): v for k, v in arrays.items() if k not in static}
        series = {name: values[number] for name, values in self.series.items()}
        return Frame(time=float(self.times[number]), series=series, **blocks)

    def summary(self) -> dict[str, Any]:
        """The summary that a run stored at its end, and figures computed from its frames.

        `finished` (False when it was killed, interrupted or stopped by a guard; then `stopped` may tell why),
        `frames`, `bodies`, `duration` (s), `distance` (m), `friction_coefficient` with `friction_coefficient_error` and
        `friction_verdict` (value, error and verdict of `friction`), of strokes `cycles` and `energy_per_cycle` (J),
        `fractions` (state name to share, last frame), the same by `populations`, `materials` and `sizes` (lists as
        `trajectory.state_groups.states_by_group` gives them); of a run that came to its end also what it stored, among it
        `energy_residual`, relative, with `energy_verdict` where it, or what the integrator loses or makes, is too large (the
        likely reason, else absent), `peak_pressure` (Pa, largest over contacts and frames) and `first_yield` (its `ratio` to the
        pressure at first yield, `assumed` yield strength or not), `energy_numerical_share` (what the implicit integrator itself
        lost, below zero: made, divided as the residual), `load_ratio` (mean force on the upper plate over its load, last
        interval), of implicit runs `steps_limited_by` (cause to steps), and of quasi-static ones `patches_not_carried` (how many
        at the end) and `largest_fraction_rolling` (of all frames). Figures that the run has no series for are absent.
        """
        stored = self._steady("", lambda: dict(self._text(SUMMARY_TEXT)) if SUMMARY_TEXT in self._scene else None)
        report = self._figures() | {"finished": stored is not None} | (stored or {})
        rolling = self.series.get("fraction_rolling", ())
        if report.get("patches_not_carried") is not None and len(rolling):
            report["largest_fraction_rolling"] = float(np.max(rolling))
        verdict = energy_verdict(report, str(self.header.get("scene_text", "")))
        return report if verdict is None else report | {"energy_verdict": verdict}

    def _figures(self) -> dict[str, Any]:
        from thirdbody.trajectory.state_groups import states_by_group

        if not self.frames:
            return {"frames": 0}
        series = self.series
        figures: dict[str, Any] = {"frames": self.frames, "bodies": self._blocks["clumps"].rows(0)}
        figures["duration"] = float(self.times[-1] - self.times[0])
        if "distance" in series:
            figures["distance"] = float(series["distance"][-1])
        if "friction_coefficient" in series:
            friction = self.friction
            figures["friction_coefficient"] = friction.value
            figures["friction_coefficient_error"] = friction.error
            figures["friction_verdict"] = friction.verdict
            if self.drag.stroke:
                figures |= {"cycles": friction.cycles, "energy_per_cycle": friction.energy_per_cycle}
        if self.has_states and figures["bodies"]:
            counts = np.bincount(self.bodies(-1)["state"], minlength=len(self.state_names))
            fractions = (counts / counts.sum()).tolist()
            figures["fractions"] = dict(zip(self.state_names, fractions, strict=False))
            figures |= {f"{kind}s": rows for kind, rows in states_by_group(self).items()}
        return figures

    def to_pandas(self, table: str = "series", frame: int | None = None) -> Any:
        """One table of the run as a pandas DataFrame: `series`, `bodies`, `contacts`, `cycles` or `transitions`.

        Series have one row per frame, bodies and contacts one row each of one frame, or of all frames one below the other
        (column `frame`). Vectors are columns `_x`, `_y`, `_z`; states and reasons come by code and by name. Units by column
        are in `.attrs["units"]`. Raises ImportError when pandas, which nothing else needs, is not installed; ValueError for
        another table; IndexError for a frame that the run has not; AttributeError when it has no states.
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
        """The page that tells what happened, as a figure of matplotlib: the `panels` named, or all that fit the run.

        `frame` is that of the contacts; with `out` (.png, .pdf, .svg) the page is written too. Panels and errors:
        `plot.summary_page`.
        """
        from thirdbody.plot.summary_page import checked_path, page, save

        path = None if out is None else checked_path(out)
        figure = page(self, panels, frame)
        if path is not None:
            save(figure, path)
        return figure

    def render(self, out: str | Path, **options: Any) -> Path:
        """Draw a picture (.png), a film (.gif, .mp4) or a page (.html), and return its path.

        Options: frame, color, size, zoom, view, forces, body, frames, fps, camera; see `thirdbody.render.render.render`.
        """
        from thirdbody.render.render import render

        return render(self.path, out, **options)

    def export(
        self, *, csv: str | Path | None = None, pvd: str | Path | None = None, pack: str | Path | None = None,
        frame: int | None = None, overwrite: bool = False,
    ) -> list[Path]:  # fmt: skip
        """Write tables into the folder `csv`, PVD files into the folder `pvd`, a compressed copy to the file `pack`.

        Of one `frame`, or of all if None; a compressed copy has all. Returns the paths of the files. Raises UsageError when
        nothing is asked for, InputError for a frame that the run has not, OutputError.
        """
        from thirdbody.export.export_run import export_run

        tables, files, copy = (None if path is None else Path(path) for path in (csv, pvd, pack))
        return list(export_run(self.path, tables, files, copy, frame, overwrite))

    def to_pyvista(self, frame: int = -1) -> pyvista.MultiBlock:
        """One frame as a pyvista.MultiBlock: `spheres`, `clumps`, `contacts` (points) and `plates` (two rectangles).

        Each block has the arrays of `block()` as point data; the unit of the array `force` is in its
        `field_data["force_units"]`. Time, frame, and the names of states and reasons are in the `field_data` of the whole.
        Surfaces of the debris, and arrows of the contact forces:

            blocks = run.to_pyvista(-1)
            balls = blocks["spheres"].glyph(scale="radius", geom=pyvista.Sphere(radius=1.0), orient=False)
            arrows = blocks["contacts"].glyph(scale="force", orient="force", factor=0.1, geom=pyvista.Arrow())  # m per N

        Raises IndexError for a frame that the run has not, ImportError without pyvista.
        """
        from thirdbody.trajectory.pyvista_blocks import multiblock

        return multiblock(self, frame)

    def _repr_html_(self) -> str:
        """A table and a picture, for notebooks."""
        from thirdbody.render.notebook import run_html

        return run_html(self)

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._open.close()

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Run {self.path}: {self.frames} frames>"


def open_run(path: str | Path) -> Run:
    """The run in a folder, or in its `run.vtkhdf`. Raises InputError when missing, damaged or not a run."""
    path = Path(path)
    return Run(path / FILE_NAME if os.path.isdir(path) else path)
