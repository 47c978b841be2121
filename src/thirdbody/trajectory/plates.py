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
