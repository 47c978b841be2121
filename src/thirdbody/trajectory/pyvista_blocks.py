"""One frame of a run as data sets of pyvista, with units."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from thirdbody.trajectory.names import ARRAY_UNITS
from thirdbody.trajectory.schema import BLOCKS, POSITION

if TYPE_CHECKING:
    import pyvista

    from thirdbody.trajectory.reader import Run

PLATES = np.array([4, 0, 1, 2, 3, 4, 4, 5, 6, 7])
"""Faces of the lower and the upper plate, each with its number of corners first."""


def multiblock(run: Run, frame: int) -> pyvista.MultiBlock:
    """Return the blocks of one frame. Raises IndexError for a frame outside the run, ImportError without pyvista."""
    try:
        import pyvista
    except ImportError as error:
        raise ImportError("to_pyvista() needs pyvista: pip install pyvista") from error

    number = run.frame_number(frame)
    blocks = pyvista.MultiBlock({name: _block(name, run.block(name, number)) for name in BLOCKS})
    for side in run.surfaces:
        blocks[f"{side}_surface"] = _surface(run, side, number)
    blocks.field_data["time"] = np.array([run.times[number]])
    blocks.field_data["time_units"] = ["s"]
    blocks.field_data["frame"] = np.array([number])
    blocks.field_data["state_names"] = run.state_names
    blocks.field_data["reason_names"] = run.reason_names
    return blocks


def _surface(run: Run, side: str, frame: int) -> pyvista.StructuredGrid:
    """Return the surface of a plate at its place in a frame, over the domain and one point beyond, with the array `height`."""
    import pyvista

    surface = run.surfaces[side]
    position = run.surface_position(side, frame)
    heights = np.pad(surface.heights, (0, 1), mode="wrap")
    n_y, n_x = heights.shape
    x, y = np.meshgrid(position[0] + surface.spacing[0] * np.arange(n_x), position[1] + surface.spacing[1] * np.arange(n_y))
    grid = pyvista.StructuredGrid(x, y, position[2] + (heights if side == "lower" else -heights))
    grid.point_data["height"] = heights.T.ravel()
    grid.field_data["height_units"] = ["m"]
    return grid


def _block(name: str, arrays: dict[str, np.ndarray]) -> pyvista.PolyData:
    """Return the points of one block with their arrays and units; the plates are two rectangles."""
    import pyvista

    points = arrays.pop(POSITION)
    block = pyvista.PolyData()
    if len(points):
        block = pyvista.PolyData(points, faces=PLATES) if name == "plates" else pyvista.PolyData(points)
    block.field_data["position_units"] = ["m"]
    for key, values in arrays.items():
        # not by `block[key] = values`, which refuses arrays of no rows
        block.point_data.VTKObject.AddArray(pyvista.convert_array(np.ascontiguousarray(values), name=key))
        block.field_data[f"{key}_units"] = [ARRAY_UNITS.get(key, "1").replace("·", " ")]  # VTK accepts ASCII only
    return block
