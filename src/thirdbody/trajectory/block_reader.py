"""Reader of one block of a run: arrays of single frames from data sets that hold all frames in sequence."""

from collections.abc import Collection
from pathlib import Path

import h5py
import numpy as np

from thirdbody.trajectory.named_arrays import Named, unknown_name
from thirdbody.trajectory.schema import POSITION
from thirdbody.trajectory.validate import damage_as_fault


class BlockReader:
    """Arrays of one block, cut out of their growing data sets by the offsets of a frame."""

    def __init__(self, group: h5py.Group, path: Path):
        self._group, self._data = group, group["PointData"]
        self._steps = group["Steps"]
        self.frames = int(self._steps.attrs["NSteps"])
        self._path = path
        self.names_of: dict[str, int] = {}  # number of names, for arrays of codes

    @property
    def names(self) -> list[str]:
        return list(self._data)

    def whole(self) -> dict[str, np.ndarray]:
        """Return all arrays with all rows, of a block whose arrays never change."""
        with damage_as_fault(self._path, self._group.name):
            return {name: values[()] for name, values in self._data.items()}

    def read(self, frame: int, without: Collection[str] = ()) -> dict[str, np.ndarray]:
        """Return all arrays of one frame but some, the coordinates as `position`."""
        rows = self.rows(frame)  # once: each look into the file costs as much as an array
        return Named((name, self._cut(name, frame, rows)) for name in (POSITION, *self._data) if name not in without)

    def array(self, name: str, frame: int) -> np.ndarray:
        """Return one array of one frame."""
        if name != POSITION and name not in self._data:
            raise unknown_name(name, (POSITION, *self._data))
        return self._cut(name, frame, self.rows(frame))

    def _cut(self, name: str, frame: int, rows: int) -> np.ndarray:
        """Return the rows of one frame of an array."""
        with damage_as_fault(self._path, f"{self._group.name}/{name}"):
            if name == POSITION:
                data, offsets = self._group["Points"], self._steps["PointOffsets"]
            else:
                data, offsets = self._data[name], self._steps["PointDataOffsets"][name]
            start = int(offsets[frame])
            return self._known(name, data[start : start + rows])

    def rows(self, frame: int) -> int:
        with damage_as_fault(self._path, f"{self._group.name}/NumberOfPoints"):
            return int(self._group["NumberOfPoints"][int(self._steps["PartOffsets"][frame])])

    def history(self, name: str, frames: int) -> np.ndarray:
        """Return one varying array at all frames (frames, rows, ...), for a block with a constant number of rows."""
        rows = self.rows(0) if frames else 0
        with damage_as_fault(self._path, f"{self._group.name}/{name}"):
            data = self._data[name]
            return self._known(name, data[: frames * rows].reshape(frames, rows, *data.shape[1:]))

    def _known(self, name: str, codes: np.ndarray) -> np.ndarray:
        """Return the array; if it holds codes, check that all have a name."""
        maximum = self.names_of.get(name)
        if maximum is not None and codes.size and not 0 <= codes.min() <= codes.max() < maximum:
            raise ValueError(f"codes {codes.min()} to {codes.max()}, of which {maximum} have names")
        return codes
