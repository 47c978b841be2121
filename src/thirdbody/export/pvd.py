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
from thirdbody.export.map_files import BLOCKS_OF_MAPS, write_vti
from thirdbody.export.paraview import SCRIPT_NAME, write_script
from thirdbody.trajectory.reader import Run
from thirdbody.trajectory.schema import BLOCKS, POSITION

PVD_FILES = (*(f"{block}.pvd" for block in BLOCKS), SCRIPT_NAME)
PVD_PATTERNS = (
    *PVD_FILES, *(f"{block}.pvd" for block in BLOCKS_OF_MAPS), *(f"{block}/[0-9]*.vtp" for block in BLOCKS),
    *(f"{block}/[0-9]*.vti" for block in BLOCKS_OF_MAPS),
)  # fmt: skip
CORNERS = 4  # of a plate


def export_pvd(run: Run, folder: Path, frame: int | None = None, overwrite: bool = False) -> list[Path]:
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
                    write_vti(part / file, run, block, number)
                else:
                    write_vtp(part / file, run.block(block, number), block)
            entries = [(float(run.times[number]), file) for number, file in files.items()]
            (part / f"{block}.pvd").write_text(_collection(entries), encoding="utf-8")
        write_script(part / SCRIPT_NAME, run.state_names, "{name}.pvd", maps)
    return [folder / name for name in (*PVD_FILES, *(f"{block}.pvd" for block in maps))]


def write_vtp(path: Path, arrays: dict[str, np.ndarray], block: str) -> None:
    """Write the arrays of one frame of a block as PolyData. Raises OSError."""
    # not `vtk`, which loads rendering modules and needs system libraries
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    writer = vtkXMLPolyDataWriter()
    writer.SetInputData(_polydata(arrays, block))
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


def _collection(entries: list[tuple[float, str]]) -> str:
    """Return the PVD file: time and file of each frame."""
    lines = [f'    <DataSet timestep="{time!r}" part="0" file="{file}"/>' for time, file in entries]
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
    return head + "\n".join(lines) + "\n  </Collection>\n</VTKFile>\n"
