"""Maps of the plates as VTI (image data) per frame: cells at the place of the plate in that frame, which moves.

The VTKHDF file has no block of them: its image data have one origin for all steps, and the upper plate moves and rises.
"""

from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.trajectory.plate_maps import PLATES
from thirdbody.trajectory.reader import Run

BLOCKS_OF_MAPS = tuple(f"{plate}_maps" for plate in PLATES)
"""Names of their folders and PVD files."""


def write_vti(path: Path, run: Run, block: str, frame: int) -> None:
    """Write the maps of a plate in one frame as data of the cells of an image. Raises OSError."""
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    writer = vtkXMLImageDataWriter()
    writer.SetInputData(_image(run, PLATES[BLOCKS_OF_MAPS.index(block)], frame))
    writer.SetDataModeToAppended()
    # Python writes the file, as in `pvd.write_vtp`
    writer.WriteToOutputStringOn()
    writer.Write()
    path.write_text(writer.GetOutputString(), encoding="ascii")


def _image(run: Run, plate: str, frame: int) -> Any:
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
