"""Maps of the plates in the file of a run, `/maps/NAME`: what measures have left on the cells of both plates since the start.

A data set holds, frame after frame, the rows of the lower plate and then those of the upper one, (2 n_y, n_x) per frame. Cells
lie in coordinates of the plate: those of the upper plate move with it. Their sides are the domain's size over their number.
"""

from __future__ import annotations

from collections.abc import Mapping

import h5py
import numpy as np

from thirdbody.trajectory.polydata_block import Column, growing

MAPS, PLATES = "maps", ("lower", "upper")
"""Name of the group; the plates in their order."""


def refuse_other_plates(plate: str) -> None:
    """Raise ValueError for a name of no plate."""
    if plate not in PLATES:
        raise ValueError(f"plate: '{plate}' is not one of 'lower', 'upper'")


class MapsWriter:
    """Writer of the maps into an open file; `units` by name."""

    def __init__(self, file: h5py.File) -> None:
        self._file = file
        self._columns = {name: Column(values) for name, values in file.get(MAPS, {}).items()}

    @property
    def names(self) -> set[str]:
        """Names of the maps so far."""
        return set(self._columns)

    def append(self, maps: Mapping[str, np.ndarray], units: Mapping[str, str]) -> None:
        """Append the maps of a frame."""
        for name, values in maps.items():
            rows = np.asarray(values, np.float64).reshape(-1, values.shape[-1])
            if name not in self._columns:
                group = self._file.require_group(MAPS)
                self._columns[name] = growing(group, name, rows.shape[1:], np.float64, len(rows))
                group[name].attrs["units"] = units.get(name, "1")
                group[name].attrs["rows"] = np.int64(len(rows))
            self._columns[name].extend(rows)


def read_maps(file: h5py.File, frame: int) -> dict[str, np.ndarray]:
    """Return the maps of one frame by name, (2, n_y, n_x); none in a run without."""
    result = {}
    for name, values in file.get(MAPS, {}).items():
        rows = int(values.attrs["rows"])
        result[name] = values[frame * rows : (frame + 1) * rows].reshape(2, rows // 2, values.shape[1])
    return result


def map_units(file: h5py.File) -> dict[str, str]:
    """Return the unit of each map by name."""
    return {name: str(values.attrs["units"]) for name, values in file.get(MAPS, {}).items()}


def refuse_unsound_maps(file: h5py.File, frames: int) -> None:
    """Raise ValueError, TypeError or KeyError for maps that `MapsWriter` does not write."""
    for values in file.get(MAPS, {}).values():
        if not isinstance(values, h5py.Dataset) or values.ndim != 2 or values.dtype != np.float64 or not values.shape[1]:
            raise TypeError(f"{values.name} is no map of plates")
        rows = int(values.attrs["rows"])
        if rows < 2 or rows % 2 or len(values) < frames * rows:
            raise ValueError(f"{values.name} has {len(values)} rows, {frames} frames of {rows} are needed")
        if values.nbytes > file.id.get_filesize() + 8 * rows * values.shape[1] and values.compression is None:
            raise ValueError(f"{values.name} promises {values.nbytes:.3g} bytes")
        if not isinstance(values.attrs["units"], str):
            raise TypeError(f"{values.name} has no units")
