"""Writer of a run as PVD + VTP, the older files of VTK, for ParaView before 5.12 and other programs that read VTP.

spheres.pvd, clumps.pvd, contacts.pvd, plates.pvd   the times and the files of each block
spheres/0000.vtp, ...                               one file per block and frame, compressed by zlib
lower_maps.pvd, lower_maps/0000.vti, upper_...      maps of the plates, of a run that has some
open_in_paraview.py                                 sets up the view
"""

from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.atomic_files import new_folder
from thirdbody.export.paraview import SCRIPT_NAME, write_script
from thirdbody.trajectory.names import BLOCKS, POSITION
from thirdbody.trajectory.plates import PLATES
from thirdbody.trajectory.run_arrays import RunArrays

BLOCKS_OF_MAPS = tuple(f"{plate}_maps" for plate in PLATES)
"""Folders and PVD files of the maps of the plates: VTI (image data), cells at the place of the plate in that frame, which moves.

The VTKHDF file has no block of them: its image data have one origin for all steps, and the upper plate moves and rises.
"""

PVD_FILES = (*(f"{block}.pvd" for block in BLOCKS), SCRIPT_NAME)
PVD_PATTERNS = (
    *PVD_FILES, *(f"{block}.pvd" for block in BLOCKS_OF_MAPS), *(f"{block}/[0-9]*.vtp" for block in BLOCKS),
    *(f"{block}/[0-9]*.vti" for block in BLOCKS_OF_MAPS),
)  # fmt: skip
CORNERS = 4  # of a plate


def export_pvd(run: RunArrays, folder: Path, frame: int | None = None, overwrite: bool = False) -> list[Path]:
    """Write all blocks of all frames, or of one, into a new folder; return the PVD files and the script.

    Raises IndexError for a frame outside the run, OutputError; then nothing is written.
    """
    numbers = [run.frame_number(frame)] if frame is not None else range(run.frame_number(-1) + 1)
    width = max(4, len(str(run.frames - 1)))
    maps = BLOCKS_OF_MAPS if run.map_units else ()
    with new_folder(folder, overwrite, PVD_PATTERNS) as part:
        for block in (*BLOCKS, *maps):
            (part / block).mkdir()
            kind = "vti" if block in maps else "vtp"
            files = {number: f"{block}/{number:0{width}d}.{kind}" for number in numbers}
            for number, file in files.items():
                if block in maps:
                    _write(part / file, _image(run, PLATES[BLOCKS_OF_MAPS.index(block)], number))
                else:
                    _write(part / file, _polydata(run.block(block, number), block))
            (part / f"{block}.pvd").write_text(_collection({file: float(run.times[k]) for k, file in files.items()}), "utf-8")
        write_script(part / SCRIPT_NAME, run.state_names, "{name}.pvd", maps)
    return [folder / name for name in (*PVD_FILES, *(f"{block}.pvd" for block in maps))]


def _write(path: Path, data: Any) -> None:
    """Write image data or PolyData as an XML file. Raises OSError."""
    # not `vtk`, which loads rendering modules and needs system libraries
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter, vtkXMLPolyDataWriter

    writer = vtkXMLImageDataWriter() if path.suffix == ".vti" else vtkXMLPolyDataWriter()
    writer.SetInputData(data)
    writer.SetDataModeToAppended()  # in base64, so that the file is text
    # Python writes the file: VTK reports every error as a full disk and prints two paragraphs.
    writer.WriteToOutputStringOn()
    writer.Write()
    path.write_text(writer.GetOutputString(), encoding="ascii")


def _polydata(arrays: dict[str, np.ndarray], block: str) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    data, points = vtkPolyData(), vtkPoints()
    points.SetData(numpy_to_vtk(arrays[POSITION], deep=True))
    data.SetPoints(points)
    if block == "plates":
        data.SetPolys(_cells(len(arrays[POSITION]), CORNERS))
    else:
        data.SetVerts(_cells(len(arrays[POSITION]), 1))
    for name, values in arrays.items():
        if name != POSITION:
            array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
            array.SetName(name)
            data.GetPointData().AddArray(array)
    return data


def _cells(points: int, per_cell: int) -> Any:
    """Return cells of `per_cell` consecutive points each."""
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    cells = vtkCellArray()
    offsets, ids = np.arange(0, points + 1, per_cell, dtype=np.int64), np.arange(points, dtype=np.int64)
    cells.SetData(numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(ids, deep=True))
    return cells


def _image(run: RunArrays, plate: str, frame: int) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    maps, size = run.maps(plate, frame), run.header["domain"]["size"]
    n_y, n_x = next(iter(maps.values())).shape
    image = vtkImageData()
    image.SetDimensions(n_x + 1, n_y + 1, 1)
    image.SetSpacing(size[0] / n_x, size[1] / n_y, 1.0)
    image.SetOrigin(*(float(x) for x in run.surface_position(plate, frame)))
    for name, values in maps.items():
        array = numpy_to_vtk(np.ascontiguousarray(values).ravel(), deep=True)
        array.SetName(name)
        image.GetCellData().AddArray(array)
    return image


def _collection(times: dict[str, float]) -> str:
    """Return the PVD file: time and file of each frame."""
    lines = [f'    <DataSet timestep="{time!r}" part="0" file="{file}"/>' for file, time in times.items()]
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
    return head + "\n".join(lines) + "\n  </Collection>\n</VTKFile>\n"
