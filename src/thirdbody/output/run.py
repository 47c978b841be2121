"""Reads a run back: arrays per frame, series, names, texts and summary, from `run.vtkhdf`.

Only committed frames exist for the reader: a file whose run was killed, or is still running, reads to its
last one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from thirdbody.errors import InputError
from thirdbody.output.schema import BLOCKS, STATIC_TEXT, SUMMARY_TEXT, Frame

FILE_NAME = "run.vtkhdf"

# What the bodies' arrays are called in `Run.bodies`, where VTK calls the coordinates `Points`.
POSITION = "position"


class _BlockReader:
    """The arrays of one block, cut out of their growing data sets by the offsets of a frame."""

    def __init__(self, group: h5py.Group):
        self._group, self._data = group, group["PointData"]
        self._steps = group["Steps"]
        self.frames = int(self._steps.attrs["NSteps"])

    @property
    def names(self) -> list[str]:
        return list(self._data)

    def read(self, frame: int) -> dict[str, np.ndarray]:
        """All arrays of one frame, the coordinates as `position`."""
        count = self.rows(frame)
        start = int(self._steps["PointOffsets"][frame])
        arrays = {POSITION: self._group["Points"][start : start + count]}
        for name in self._data:
            start = int(self._steps["PointDataOffsets"][name][frame])
            arrays[name] = self._data[name][start : start + count]
        return arrays

    def rows(self, frame: int) -> int:
        return int(self._group["NumberOfPoints"][int(self._steps["PartOffsets"][frame])])

    def history(self, name: str, frames: int) -> np.ndarray:
        """One varying array at all frames (frames, rows, ...), for a block whose row count never changes."""
        rows = self.rows(0) if frames else 0
        data = self._data[name]
        return data[: frames * rows].reshape(frames, rows, *data.shape[1:])


class Run:
    """One run, read from its file when asked; a context manager. Arrays are in SI units.

    `open_run` makes it. Raises InputError when the file is missing, damaged or not one of ours.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self._file = _open_file(self.path)
        try:
            self._blocks = {name: _BlockReader(self._file["VTKHDF"][name]) for name in BLOCKS}
            self._series_group, self._scene = self._file["series"], self._file["scene"]
            counts = [block.frames for block in self._blocks.values()]
            # A run killed between two counts has some one higher: the lowest is what is whole.
            self.frames = min(counts + [int(self._series_group.attrs["NSteps"])])
            self.header = {name: self._text(name) for name in self._scene if name != SUMMARY_TEXT}
            self.state_names: list[str] = list(self.header["state_names"])
            self.reason_names: list[str] = list(self.header["reason_names"])
        except (KeyError, OSError, RuntimeError, ValueError) as error:
            self._file.close()
            raise InputError(f"{self.path}: not a run of thirdbody, or damaged ({error})") from error

    def _text(self, name: str) -> Any:
        dataset = self._scene[name]
        text = dataset[()].decode("utf-8")
        return json.loads(text) if dataset.attrs["json"] else text

    @property
    def scene_text(self) -> str:
        """The resolved scene as the run used it."""
        return str(self.header["scene_text"])

    @cached_property
    def times(self) -> np.ndarray:
        """Times of the frames (F,), s."""
        return self._file["VTKHDF/clumps/Steps/Values"][: self.frames]

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

    def _history(self, name: str) -> np.ndarray:
        clumps = self._blocks["clumps"]
        if name not in clumps.names:
            raise AttributeError(f"{self.path}: this run recorded no '{name}' of its bodies")
        return clumps.history(name, self.frames)

    @cached_property
    def series(self) -> dict[str, np.ndarray]:
        """Series by name, each (F,) or (F, 3); units in `units`."""
        return {name: self._series_group[name][: self.frames] for name in self._series_group}

    @cached_property
    def units(self) -> dict[str, str]:
        """Unit of each series, `1` for a pure number."""
        return {name: str(self._series_group[name].attrs["units"]) for name in self._series_group}

    def bodies(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Arrays of the bodies (clumps) by name, one row per body: `position`, `quaternion`, `state`, ..."""
        return self._block("clumps", frame)

    def spheres(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Arrays of the spheres that the bodies are made of: `position`, `radius`, `clump`, ..."""
        return self._block("spheres", frame)

    def contacts(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Arrays of the contacts, one row each, perhaps none: `position`, `vector`, `utilisation`, ..."""
        return self._block("contacts", frame)

    def plates(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Arrays of the plates' corners (8, 3): lower four, upper four; (0, 3) without plates."""
        return self._block("plates", frame)

    def _block(self, name: str, frame: int) -> dict[str, np.ndarray]:
        return self._blocks[name].read(self.frame_number(frame))

    def frame_number(self, frame: int) -> int:
        """The frame counted from 0; negative ones count from the end. Raises IndexError outside the run."""
        if not -self.frames <= frame < self.frames:
            inside = (
                f"from {-self.frames} to {self.frames - 1}"
                if self.frames
                else "none: nothing was written yet"
            )
            raise IndexError(f"{self.path}: no frame {frame}; frames are {inside}")
        return frame % self.frames

    def static_arrays(self) -> dict[str, dict[str, np.ndarray]]:
        """Per block the arrays that hold for all frames, as `TrajectoryWriter` takes them."""
        names: Mapping[str, list[str]] = self.header[STATIC_TEXT]
        data = {block: self._file["VTKHDF"][block]["PointData"] for block in names}
        return {block: {name: data[block][name][()] for name in names[block]} for block in names}

    def stored_frame(self, frame: int) -> Frame:
        """One frame as `TrajectoryWriter.append` takes it, for copies."""
        number = self.frame_number(frame)
        blocks = {}
        for name in BLOCKS:
            arrays = self._block(name, number)
            static = self.header[STATIC_TEXT].get(name, ())
            blocks[name] = {
                ("points" if k == POSITION else k): v for k, v in arrays.items() if k not in static
            }
        series = {name: values[number] for name, values in self.series.items()}
        return Frame(time=float(self.times[number]), series=series, **blocks)

    def summary(self) -> dict[str, Any]:
        """The summary that a run stored at its end, and figures computed from its frames.

        `finished` (False when it was killed, interrupted or stopped by a guard; then `stopped` may tell why),
        `frames`, `bodies`, `duration` (s), `distance` (m), `friction_coefficient` (mean over the loaded frames
        of the second half, when the start is forgotten), `fractions` (state name to share, last frame); of a run
        that came to its end also what it stored, among it `energy_residual`, relative. Figures that the run has no
        series for are absent.
        """
        stored = self._text(SUMMARY_TEXT) if SUMMARY_TEXT in self._scene else {}
        return self._figures() | {"finished": SUMMARY_TEXT in self._scene} | dict(stored)

    def _figures(self) -> dict[str, Any]:
        if not self.frames:
            return {"frames": 0}
        series = self.series
        figures: dict[str, Any] = {"frames": self.frames, "bodies": self._blocks["clumps"].rows(0)}
        figures["duration"] = float(self.times[-1] - self.times[0])
        if "distance" in series:
            figures["distance"] = float(series["distance"][-1])
        if "friction_coefficient" in series:
            late = series["friction_coefficient"][self.frames // 2 :]
            loaded = late[np.isfinite(late)]
            figures["friction_coefficient"] = float(loaded.mean()) if len(loaded) else float("nan")
        if "state" in self._blocks["clumps"].names and figures["bodies"]:
            counts = np.bincount(self.bodies(-1)["state"], minlength=len(self.state_names))
            shares = (counts / counts.sum()).tolist()
            figures["fractions"] = dict(zip(self.state_names, shares, strict=False))
        return figures

    def to_pandas(self) -> Any:
        """The series as a pandas DataFrame, one row per frame; vectors as three columns `_x`, `_y`, `_z`.

        Raises ImportError when pandas, which nothing else needs, is not installed.
        """
        try:
            import pandas
        except ImportError as error:
            raise ImportError("to_pandas() needs pandas: pip install pandas") from error
        columns: dict[str, np.ndarray] = {}
        for name, values in self.series.items():
            if values.ndim == 1:
                columns[name] = values
            else:
                columns |= {f"{name}_{axis}": values[:, i] for i, axis in enumerate("xyz"[: values.shape[1]])}
        return pandas.DataFrame(columns)

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._file.close()

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Run {self.path}: {self.frames} frames>"


def open_run(path: str | Path) -> Run:
    """The run in a folder, or in its `run.vtkhdf`. Raises InputError when missing, damaged or not a run."""
    path = Path(path)
    return Run(path / FILE_NAME if path.is_dir() else path)


def _open_file(path: Path) -> h5py.File:
    if not path.is_file():
        raise InputError(f"{path}: no such run; give the folder of a run or its {FILE_NAME}")
    if not h5py.is_hdf5(path):
        raise InputError(f"{path}: not a run of thirdbody (not an HDF5 file)")
    try:
        try:
            # Without locking a run can be looked at while another process writes it.
            return h5py.File(path, "r", locking=False)
        except OSError as error:
            if "locking flag" not in str(error):
                raise
            return h5py.File(path, "r")  # this very process writes it
    except OSError as error:
        what = "is cut short" if "truncated" in str(error) else "cannot be opened"
        raise InputError(f"{path}: the file {what} ({error})") from error
