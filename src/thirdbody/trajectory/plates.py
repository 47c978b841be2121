"""What the file of a run holds of its plates: surfaces of rough ones, and maps of what measures have left on both.

`/surfaces/lower`, `/surfaces/upper` are written once. `/maps/NAME` holds, frame after frame, the rows of the lower plate and then
those of the upper one, (2 n_y, n_x) per frame, accumulated since the start. Cells lie in coordinates of the plate: those of the
upper plate move with it. Their sides are the domain's size over their number.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np

from thirdbody.surfaces.surface import Surface

SURFACES = "surfaces"
"""Name of the group. A data set holds heights (n_y, n_x) [m]; its attributes are the fields of `Surface`."""

MAPS, PLATES = "maps", ("lower", "upper")
"""Name of the group; the plates in their order."""


def refuse_other_plates(plate: str) -> None:
    """Raise ValueError for a name of no plate."""
    if plate not in PLATES:
        raise ValueError(f"plate: '{plate}' is not one of 'lower', 'upper'")


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


def write_surfaces(file: h5py.File, surfaces: Mapping[str, Surface]) -> None:
    """Write the surfaces by plate into a new file."""
    for side, surface in surfaces.items():
        heights = file.require_group(SURFACES).create_dataset(side, data=np.asarray(surface.heights, np.float64))
        heights.attrs["units"] = "m"
        heights.attrs["size"] = np.array(surface.size)
        heights.attrs["shortest"] = surface.shortest
        heights.attrs["curvature"] = np.uint8(surface.curvature)
        heights.attrs["copies"] = np.array(surface.copies, np.int64)


def read_surfaces(file: h5py.File) -> dict[str, Surface]:
    """Return the surfaces by plate; none of flat plates."""
    surfaces = {}
    for side, heights in file.get(SURFACES, {}).items():
        numbers: Any = heights.attrs
        size, copies = (tuple(numbers[name].tolist()) for name in ("size", "copies"))
        surfaces[side] = Surface(heights[()], size, float(numbers["shortest"]), bool(numbers["curvature"]), copies=copies)
    return surfaces


def refuse_unsound_plates(file: h5py.File, frames: int) -> None:
    """Raise ValueError, TypeError or KeyError for surfaces and maps that a run does not write."""
    for side, heights in file.get(SURFACES, {}).items():
        if side not in PLATES or heights.ndim != 2 or heights.dtype.kind != "f" or min(heights.shape) < 4:
            raise ValueError(f"{heights.name} is no surface of a plate")
        if heights.nbytes > file.id.get_filesize() and heights.compression is None:
            raise ValueError(f"{heights.name} promises {heights.nbytes:.3g} bytes")
        for name in ("size", "copies"):
            if heights.attrs[name].shape != (2,) or not np.all((heights.attrs[name] > 0) & np.isfinite(heights.attrs[name])):
                raise ValueError(f"{heights.name}: {name} {str(heights.attrs[name])[:60]}")
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
