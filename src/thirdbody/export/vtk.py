"""Frames of a run as data sets of VTK: for pyvista, with units, and as PVD + VTP, the older files of VTK.

PVD is for ParaView before 5.12 and other programs that read VTP:

spheres.pvd, clumps.pvd, contacts.pvd, plates.pvd   the times and the files of each block
spheres/0000.vtp, ...                               one file per block and frame, compressed by zlib
lower_maps.pvd, lower_maps/0000.vti, upper_...      maps of the plates, of a run that has some
open_in_paraview.py                                 sets up the view
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.atomic_files import new_folder
from thirdbody.export.paraview import SCRIPT_NAME, write_script
from thirdbody.system.processes import optional
from thirdbody.trajectory.names import ARRAY_UNITS, BLOCKS, PLATES, POSITION
from thirdbody.trajectory.run_arrays import RunArrays

if TYPE_CHECKING:
    import pyvista

BLOCKS_OF_MAPS = {f"{plate}_maps": plate for plate in PLATES}
"""Blocks of the maps of the plates: image data (VTI), cells at the place of the plate in that frame, which moves.

The VTKHDF file has no block of them: its image data have one origin for all steps, and the upper plate moves and rises.
"""

PVD_FILES = (*(f"{block}.pvd" for block in BLOCKS), SCRIPT_NAME)
PVD_PATTERNS = (
    *PVD_FILES, *(f"{block}.pvd" for block in BLOCKS_OF_MAPS), *(f"{block}/[0-9]*.vtp" for block in BLOCKS),
    *(f"{block}/[0-9]*.vti" for block in BLOCKS_OF_MAPS),
)  # fmt: skip


def export_pvd(run: RunArrays, folder: Path, frame: int | None = None, overwrite: bool = False) -> list[Path]:
    """Write all blocks of all frames, or of one, into a new folder; return the PVD files and the script.

    Raises IndexError for a frame outside the run, OutputError; then nothing is written.
    """
    # not `vtk`, which loads rendering modules and needs system libraries
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter, vtkXMLPolyDataWriter

    numbers = [run.frame_number(frame)] if frame is not None else range(run.frame_number(-1) + 1)
    width = max(4, len(str(run.frames - 1)))
    maps = list(BLOCKS_OF_MAPS) if run.map_units else []
    with new_folder(folder, overwrite, PVD_PATTERNS) as part:
        for block in (*BLOCKS, *maps):
            (part / block).mkdir()
            kind, writer = ("vti", vtkXMLImageDataWriter()) if block in maps else ("vtp", vtkXMLPolyDataWriter())
            writer.SetDataModeToAppended()  # in base64, so that the file is text
            # Python writes the file: VTK reports every error as a full disk and prints two paragraphs.
            writer.WriteToOutputStringOn()
            lines = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>"]
            for number in numbers:
                file = f"{block}/{number:0{width}d}.{kind}"
                data = _image(run, block, number) if block in maps else _polydata(run.block(block, number), block)
                writer.SetInputData(data)
                writer.Write()
                (part / file).write_text(writer.GetOutputString(), encoding="ascii")
                lines.append(f'    <DataSet timestep="{float(run.times[number])!r}" part="0" file="{file}"/>')
            lines += ["  </Collection>", "</VTKFile>", ""]
            (part / f"{block}.pvd").write_text("\n".join(lines), "utf-8")
        write_script(part / SCRIPT_NAME, run.state_names, "{name}.pvd", maps)
    return [folder / name for name in (*PVD_FILES, *(f"{block}.pvd" for block in maps))]


def _polydata(arrays: dict[str, np.ndarray], block: str) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    data, points, cells, plates = vtkPolyData(), vtkPoints(), vtkCellArray(), block == "plates"
    points.SetData(numpy_to_vtk(arrays[POSITION], deep=True))
    data.SetPoints(points)
    # cells of four consecutive points each, the corners of a plate, or of one
    cells.SetData(4 if plates else 1, numpy_to_vtkIdTypeArray(np.arange(len(arrays[POSITION])), deep=True))
    (data.SetPolys if plates else data.SetVerts)(cells)
    _add(data.GetPointData(), {name: values for name, values in arrays.items() if name != POSITION})
    return data


def _image(run: RunArrays, block: str, frame: int) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkImageData

    plate, size = BLOCKS_OF_MAPS[block], run.header["domain"]["size"]
    maps, image = run.maps(plate, frame), vtkImageData()
    n_y, n_x = next(iter(maps.values())).shape
    image.SetDimensions(n_x + 1, n_y + 1, 1)
    image.SetSpacing(size[0] / n_x, size[1] / n_y, 1.0)
    image.SetOrigin(*(float(x) for x in run.surface_position(plate, frame)))
    _add(image.GetCellData(), {name: values.ravel() for name, values in maps.items()})
    return image


def _add(attributes: Any, arrays: dict[str, np.ndarray]) -> None:
    from vtkmodules.util.numpy_support import numpy_to_vtk

    for name, values in arrays.items():
        array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
        array.SetName(name)
        attributes.AddArray(array)


def multiblock(run: RunArrays, frame: int) -> pyvista.MultiBlock:
    """Return the blocks of one frame with their units. Raises IndexError for a frame outside the run, ImportError."""
    pyvista: Any = optional("pyvista", "to_pyvista()")
    number, units, blocks = run.frame_number(frame), ARRAY_UNITS | {POSITION: "m"}, pyvista.MultiBlock()
    for name in BLOCKS:
        arrays = run.block(name, number)
        block = pyvista.wrap(_polydata(arrays, name))
        for key in arrays:
            unit = units.get(key) or run.header["units"].get(key, "1")
            block.field_data[f"{key}_units"] = [unit.replace("·", " ")]  # VTK accepts ASCII only
        blocks[name] = block
    for side, surface in run.surfaces_at(number).items():  # over the domain and one point beyond
        position, heights = run.surface_position(side, number), np.pad(surface.heights, (0, 1), mode="wrap")
        x, y = (start + step * np.arange(n) for start, step, n in zip(position, surface.spacing, heights.T.shape, strict=False))
        across, along = np.meshgrid(x, y)
        grid = pyvista.StructuredGrid(across, along, position[2] + (heights if side == "lower" else -heights))
        grid.point_data["height"] = heights.T.ravel()
        grid.field_data["height_units"] = ["m"]
        blocks[f"{side}_surface"] = grid
    for name in BLOCKS_OF_MAPS if run.map_units else ():
        image = pyvista.wrap(_image(run, name, number))
        for key, unit in run.map_units.items():
            image.field_data[f"{key}_units"] = [unit]
        blocks[name] = image
    blocks.field_data["time"] = np.array([run.times[number]])
    blocks.field_data["time_units"] = ["s"]
    blocks.field_data["frame"] = np.array([number])
    blocks.field_data["state_names"] = run.state_names
    blocks.field_data["reason_names"] = run.reason_names
    return blocks
