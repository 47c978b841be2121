"""What all pictures share: the window, its light, spheres, and the file that is written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.output.overlay import OVERSAMPLING, unit_rgb

PAPER = "#FFFFFF"
SOFT_INK = "#5A626C"


def new_window(size: tuple[int, int]) -> Any:
    """An off-screen window for a picture of `size` pixels, blank."""
    import vtk

    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(0)
    window.SetDPI(72)
    window.SetNumberOfLayers(2)
    window.SetSize(size[0] * OVERSAMPLING, size[1] * OVERSAMPLING)
    blank = vtk.vtkRenderer()
    blank.SetBackground(*unit_rgb(PAPER))
    window.AddRenderer(blank)
    return window


def add_lights(renderer: Any) -> None:
    """Two lights that stay with the camera."""
    import vtk

    renderer.AutomaticLightCreationOff()
    for place, strength in (((-0.6, 1.2, 1.0), 0.85), ((0.8, 0.2, 1.0), 0.35)):
        light = vtk.vtkLight()
        light.SetLightTypeToCameraLight()
        light.SetPosition(*place)
        light.SetFocalPoint(0.0, 0.0, 0.0)
        light.SetIntensity(strength)
        renderer.AddLight(light)


def sphere_mapper(centers: np.ndarray, radii: np.ndarray, colors: np.ndarray) -> tuple[Any, Any]:
    """Mapper that casts spheres at centers (n, 3) with colors (n, 3) uint8, and the points that it draws."""
    import vtk
    from vtkmodules.util.numpy_support import numpy_to_vtk

    points, data = vtk.vtkPoints(), vtk.vtkPolyData()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(centers, np.float32), deep=True))
    data.SetPoints(points)
    for name, values in (("radius", np.float32(radii)), ("color", np.ascontiguousarray(colors))):
        array = numpy_to_vtk(values, deep=True)
        array.SetName(name)
        data.GetPointData().AddArray(array)
    cells = vtk.vtkVertexGlyphFilter()  # points without cells are not drawn
    cells.SetInputData(data)
    mapper = vtk.vtkOpenGLSphereMapper()
    mapper.SetInputConnection(cells.GetOutputPort())
    mapper.SetScaleArray("radius")
    mapper.SetScalarModeToUsePointFieldData()
    mapper.SelectColorArray("color")
    mapper.SetColorModeToDirectScalars()
    return mapper, data


def make_glossy(actor: Any) -> None:
    """The look of debris."""
    look = actor.GetProperty()
    look.SetAmbient(0.30)
    look.SetDiffuse(0.80)
    look.SetSpecular(0.22)
    look.SetSpecularPower(35.0)


def save(window: Any, path: Path, size: tuple[int, int]) -> None:
    """Write what a window shows, averaged, as PNG of `size` pixels. Raises OSError when the file cannot be written."""
    import vtk
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    window.Render()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    grab.Update()
    pixels = vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars())
    fine = pixels.reshape(size[1], OVERSAMPLING, size[0], OVERSAMPLING, 3)
    coarse = np.rint(fine.mean(axis=(1, 3))).astype(np.uint8).reshape(-1, 3)
    image = vtk.vtkImageData()
    image.SetDimensions(size[0], size[1], 1)
    image.GetPointData().SetScalars(numpy_to_vtk(coarse, deep=True))
    writer = vtk.vtkPNGWriter()
    writer.WriteToMemoryOn()
    writer.SetInputData(image)
    writer.Write()
    # Written by Python: VTK tells a full disk or a missing folder on the screen only.
    path.write_bytes(vtk_to_numpy(writer.GetResult()).tobytes())
