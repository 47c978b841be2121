"""Reader of a run: arrays per frame, series, names, texts and summary, from `run.vtkhdf`.

Only committed frames are read: the file of a run that was killed, or is still running, ends at its last one.
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
    """A run, read from its file on demand; a context manager. Arrays are in SI units.

    Opened by `open_run`. Raises InputError when the file is missing, damaged or not a run file.
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
        """Open the file and read its headers; when an open file is reopened, its number of frames does not grow."""
        self._open.connect()
        with damage_as_fault(self.path):
            self._blocks = Named((name, BlockReader(self.file["VTKHDF"][name], self.path)) for name in BLOCKS)
            self._series_group, self._scene = self.file["series"], self.file["scene"]
            counts = [block.frames for block in self._blocks.values()]
            # A run killed between two counts has one count too high: the lowest holds for all blocks.
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
        """Return the result of `read`; report damage with its place, and read a file again while it is being written."""

        def told() -> Result:
            with damage_as_fault(self.path, where):
                return read()

        return self._open.steady(told, self._connect)

    def _text(self, name: str) -> Any:
        with damage_as_fault(self.path, f"/scene/{name}"):
            return read_text(self._scene[name])

    @property
    def scene_text(self) -> str:
        """Resolved scene as the run used it."""
        return str(self.header["scene_text"])

    @cached_property
    def times(self) -> np.ndarray:
        """Times of the frames, (F,) [s]."""
        return self._steady("the times", lambda: self.file["VTKHDF/clumps/Steps/Values"][: self.frames])

    @cached_property
    def states(self) -> np.ndarray:
        """State codes, (F, B) uint8; their names are `state_names`."""
        return self._history("state")

    @cached_property
    def reasons(self) -> np.ndarray:
        """Reason codes, (F, B); their names are `reason_names`."""
        return self._history("state_reason")

    @cached_property
    def forecast(self) -> np.ndarray:
        """Forecast state codes, (F, B) uint8; AttributeError when the run recorded none."""
        return self._history("forecast")

    @property
    def has_states(self) -> bool:
        """Whether the run recorded states."""
        return "state" in self._names("clumps")

    def _history(self, name: str) -> np.ndarray:
        if name not in self._names("clumps"):
            raise AttributeError(f"{self.path}: this run recorded no '{name}' of its bodies")
        return self._steady("", lambda: self._blocks["clumps"].history(name, self.frames))

    def _names(self, block: str) -> list[str]:
        """Return the names of the arrays of a block."""
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
        """Names of the materials, indexed by the bodies' array `material`."""
        return list(self.header.get("materials", []))

    @cached_property
    def population_names(self) -> list[str]:
        """Names of the populations, indexed by the bodies' array `population`."""
        from thirdbody.trajectory.state_groups import names_from_scene

        names = self.header.get("populations")
        return names_from_scene(self.scene_text) if names is None else list(names)

    @cached_property
    def drag(self) -> Drag:
        """Motion of the upper plate: displacement, turns, whole cycles of a stroke."""
        from thirdbody.trajectory.plate_motion import Drag

        return Drag(self)

    @cached_property
    def friction(self) -> Friction:
        """Friction coefficient of the run: `value`, `error`, `verdict` on whether it is stationary, and more."""
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
        """Return the arrays of the bodies (clumps) by name, one row per body: `position`, `quaternion`, `state`, ..."""
        return self.block("clumps", frame)

    def spheres(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Return the arrays of the spheres of all bodies: `position`, `radius`, `clump`, ..."""
        return self.block("spheres", frame)

    def contacts(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Return the arrays of the contacts, one row each (there may be none): `position`, `vector`, `utilisation`, ..."""
        return self.block("contacts", frame)

    def plates(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Return the corners of the plates (8, 3): lower four, upper four; (0, 3) without plates."""
        return self.block("plates", frame)

    def block(self, name: str, frame: int = -1) -> dict[str, np.ndarray]:
        """Return all arrays of one block of the file: `spheres`, `clumps` (the bodies), `contacts` or `plates`."""
        number = self.frame_number(frame)
        return self._open.steady(lambda: self._blocks[name].read(number), self._connect)

    def array(self, block: str, name: str, frame: int = -1) -> np.ndarray:
        """Return one array of one block without reading the others. Raises KeyError for an unknown name."""
        number = self.frame_number(frame)
        return self._open.steady(lambda: self._blocks[block].array(name, number), self._connect)

    def rows(self, block: str, frame: int = -1) -> int:
        """Return the number of rows of one block: bodies, contacts, ..."""
        number = self.frame_number(frame)
        return self._open.steady(lambda: self._blocks[block].rows(number), self._connect)

    def transitions(self) -> dict[str, np.ndarray]:
        """Return the changes of state between frames, one row each: frame, time, distance, body, from, to, reason, position.

        See `transitions.state_transitions`. Raises AttributeError when the run recorded no states.
        """
        from thirdbody.trajectory.transitions import state_transitions

        return state_transitions(self)

    def frame_number(self, frame: int) -> int:
        """Return the frame number counted from 0; negative ones count from the end.

        Raises IndexError outside the run, TypeError for a number that is not whole.
        """
        try:
            frame = operator.index(frame)
        except TypeError:
            raise TypeError(f"{self.path}: a frame is a whole number, not {frame!r}") from None
        if not -self.frames <= frame < self.frames:
            inside = f"from {-self.frames} to {self.frames - 1}" if self.frames else "none: nothing was written yet"
            raise IndexError(f"{self.path}: no frame {frame}; frames are {inside}")
        return frame % self.frames

    def static_arrays(self) -> dict[str, dict[str, np.ndarray]]:
        """Return, per block, the arrays that hold for all frames, in the form that `TrajectoryWriter` accepts."""
        names: Mapping[str, list[str]] = self.header[STATIC_TEXT]
        data = {block: self.file["VTKHDF"][block]["PointData"] for block in names}
        return {block: {name: data[block][name][()] for name in names[block]} for block in names}

    def stored_frame(self, frame: int) -> Frame:
        """Return one frame in the form that `TrajectoryWriter.append` accepts, for copies."""
        number = self.frame_number(frame)
        blocks = {}
        for name in BLOCKS:
            arrays = self.block(name, number)
            static = self.header[STATIC_TEXT].get(name, ())
            blocks[name] = {("points" if k == POSITION else k): v for k, v in arrays.items() if k not in static}
        series = {name: values[number] for name, values in self.series.items()}
        return Frame(time=float(self.times[number]), series=series, **blocks)

    def summary(self) -> dict[str, Any]:
        """Return the summary that the run stored at its end, and figures computed from its frames.

        From the frames: `finished` (False when the run was killed, interrupted or stopped by a guard; then `stopped` may give the
        reason), `frames`, `bodies`, `duration` [s], `distance` [m], `friction_coefficient`, `friction_coefficient_error` and
        `friction_verdict` (value, error and verdict of `friction`), for strokes `cycles` and `energy_per_cycle` [J], `fractions`
        (state name to fraction of the bodies, last frame), and the same by `populations`, `materials` and `sizes` (lists from
        `trajectory.state_groups.states_by_group`).

        Of a finished run also what it stored, such as `energy_residual` (relative), `energy_verdict` (likely reason, only where
        the residual or the numerical loss or gain is too large), `peak_pressure` (largest over contacts and frames [Pa]),
        `first_yield` (its `ratio` to the pressure at first yield; whether the yield strength is `assumed`),
        `energy_numerical_share` (loss by the implicit integrator, negative for a gain, divided as the residual), `load_ratio`
        (mean force on the upper plate over its load, last interval), for implicit runs `steps_limited_by` (cause to number of
        steps), and for quasi-static ones `patches_not_carried` (number at the end) and `largest_fraction_rolling` (over all
        frames). Figures whose series the run lacks are absent.
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
        """Return one table as a pandas DataFrame: `series`, `bodies`, `contacts`, `cycles` or `transitions`.

        Series have one row per frame; bodies and contacts one row each, of one frame, or of all frames concatenated (column
        `frame`). Vectors are columns `_x`, `_y`, `_z`; states and reasons are given by code and by name. Units by column are in
        `.attrs["units"]`. Raises ImportError without pandas (needed here only), ValueError for another table, IndexError for a
        frame outside the run, AttributeError when the run has no states.
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
        """Return the summary page as a matplotlib figure: the `panels` named, or all that apply to the run.

        `frame` is the frame of the contacts; with `out` (.png, .pdf, .svg) the page is also written. Panels and errors:
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

        Of one `frame`, or of all if None; a compressed copy has all. Returns the paths of the files. Raises UsageError when no
        target is given, InputError for a frame outside the run, OutputError.
        """
        from thirdbody.export.export_run import export_run

        tables, files, copy = (None if path is None else Path(path) for path in (csv, pvd, pack))
        return list(export_run(self.path, tables, files, copy, frame, overwrite))

    def to_pyvista(self, frame: int = -1) -> pyvista.MultiBlock:
        """Return one frame as a pyvista.MultiBlock: `spheres`, `clumps`, `contacts` (points) and `plates` (two rectangles).

        Each block has the arrays of `block()` as point data; the unit of the array `force` is in its `field_data["force_units"]`.
        Time, frame, and the names of states and reasons are in the `field_data` of the multiblock. Surfaces of the debris, and
        arrows of the contact forces:

            blocks = run.to_pyvista(-1)
            balls = blocks["spheres"].glyph(scale="radius", geom=pyvista.Sphere(radius=1.0), orient=False)
            arrows = blocks["contacts"].glyph(scale="force", orient="force", factor=0.1, geom=pyvista.Arrow())  # m per N

        Raises IndexError for a frame outside the run, ImportError without pyvista.
        """
        from thirdbody.trajectory.pyvista_blocks import multiblock

        return multiblock(self, frame)

    def _repr_html_(self) -> str:
        """Return a table and a picture as HTML, for notebooks."""
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
    """Open the run in a folder, or its `run.vtkhdf`. Raises InputError when missing, damaged or not a run."""
    path = Path(path)
    return Run(path / FILE_NAME if os.path.isdir(path) else path)
