"""One frame of a run as data sets of pyvista, with units."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from thirdbody.trajectory.names import ARRAY_UNITS, BLOCKS, POSITION
from thirdbody.trajectory.plates import PLATES
from thirdbody.trajectory.run_arrays import RunArrays

if TYPE_CHECKING:
    import pyvista

CORNERS = np.array([4, 0, 1, 2, 3, 4, 4, 5, 6, 7])
"""Faces of the lower and the upper plate, each with its number of corners first."""


def multiblock(run: RunArrays, frame: int) -> pyvista.MultiBlock:
    """Return the blocks of one frame. Raises IndexError for a frame outside the run, ImportError without pyvista."""
    try:
        import pyvista
    except ImportError as error:
        raise ImportError("to_pyvista() needs pyvista: pip install pyvista") from error

    number = run.frame_number(frame)
    blocks = pyvista.MultiBlock({name: _block(name, run.block(name, number), run.header["units"]) for name in BLOCKS})
    for side in run.surfaces:
        blocks[f"{side}_surface"] = _surface(run, side, number)
    for side in PLATES if run.map_units else ():
        blocks[f"{side}_maps"] = _maps(run, side, number)
    blocks.field_data["time"] = np.array([run.times[number]])
    blocks.field_data["time_units"] = ["s"]
    blocks.field_data["frame"] = np.array([number])
    blocks.field_data["state_names"] = run.state_names
    blocks.field_data["reason_names"] = run.reason_names
    return blocks


def _surface(run: RunArrays, side: str, frame: int) -> pyvista.StructuredGrid:
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


def _maps(run: RunArrays, side: str, frame: int) -> pyvista.ImageData:
    """Return the maps of a plate at its place in a frame, as data of its cells (`Run.maps`)."""
    import pyvista

    maps, position, size = run.maps(side, frame), run.surface_position(side, frame), run.header["domain"]["size"]
    n_y, n_x = next(iter(maps.values())).shape
    grid = pyvista.ImageData(dimensions=(n_x + 1, n_y + 1, 1), spacing=(size[0] / n_x, size[1] / n_y, 1.0), origin=position)
    for name, values in maps.items():
        grid.cell_data[name] = values.ravel()
        grid.field_data[f"{name}_units"] = [run.map_units[name]]
    return grid


def _block(name: str, arrays: dict[str, np.ndarray], units: dict[str, str]) -> pyvista.PolyData:
    """Return the points of one block with their arrays and units; the plates are two rectangles. `units`: those of the run."""
    import pyvista

    points = arrays.pop(POSITION)
    block = pyvista.PolyData()
    if len(points):
        block = pyvista.PolyData(points, faces=CORNERS[: 5 * len(points) // 4]) if name == "plates" else pyvista.PolyData(points)
    block.field_data["position_units"] = ["m"]
    for key, values in arrays.items():
        # not by `block[key] = values`, which refuses arrays of no rows
        block.point_data.VTKObject.AddArray(pyvista.convert_array(np.ascontiguousarray(values), name=key))
        unit = ARRAY_UNITS.get(key) or units.get(key, "1")
        block.field_data[f"{key}_units"] = [unit.replace("·", " ")]  # VTK accepts ASCII only
    return block
