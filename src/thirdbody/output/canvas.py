"""What all pictures share: the window, its light, spheres, and the file that is written."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from thirdbody.output.overlay import LAYERS, OVERSAMPLING, unit_rgb
from thirdbody.output.target import write_whole

PAPER = "#FFFFFF"
SOFT_INK = "#5A626C"


def new_window(size: tuple[int, int], used: Any = None) -> Any:
    """An off-screen window for a picture of `size` pixels, blank; a used one of that size is cleared.

    In a film one window serves all pictures: in a new one every shader is compiled again, which takes longer than to draw.
    """
    import vtk

    window = used or vtk.vtkRenderWindow()
    for renderer in list(window.GetRenderers()):
        window.RemoveRenderer(renderer)
    if used is None:
        window.SetOffScreenRendering(True)
        window.SetMultiSamples(0)
        window.SetDPI(72)
        window.SetNumberOfLayers(LAYERS)
        window.SetSize(size[0] * OVERSAMPLING, size[1] * OVERSAMPLING)
    blank = vtk.vtkRenderer()
    blank.SetBackground(*unit_rgb(PAPER))
    window.AddRenderer(blank)
    return window


def paint_panel(window: Any, place: tuple[float, float, float, float], color: str) -> None:
    """Fill a part of a window (fractions of its size) with a colour."""
    import vtk

    panel = vtk.vtkRenderer()
    panel.SetViewport(*place)
    panel.SetBackground(*unit_rgb(color))
    window.AddRenderer(panel)


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


def pixels_of(window: Any, size: tuple[int, int]) -> np.ndarray:
    """What a window shows, averaged to `size` pixels: (height, width, 3) uint8, the upper row first."""
    import vtk
    from vtkmodules.util.numpy_support import vtk_to_numpy

    window.Render()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    grab.ShouldRerenderOff()
    grab.Update()
    pixels = vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars())
    # Pairs of pixels added in 16 bits: four times as fast as a mean over two axes.
    fine = pixels.reshape(size[1] * OVERSAMPLING, size[0] * OVERSAMPLING, 3)
    total = np.zeros((size[1], size[0], 3), np.uint16)
    for i in range(OVERSAMPLING):
        for j in range(OVERSAMPLING):
            total += fine[i::OVERSAMPLING, j::OVERSAMPLING]
    count = OVERSAMPLING**2
    return ((total + count // 2) // count).astype(np.uint8)[::-1]


def save(window: Any, path: Path, size: tuple[int, int], texts: Mapping[str, str] = MappingProxyType({})) -> None:
    """Write what a window shows as PNG of `size` pixels, with `texts` by keyword in its text chunks.

    Raises OSError when the file cannot be written.
    """
    import vtk
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    flat = np.ascontiguousarray(pixels_of(window, size)[::-1]).reshape(-1, 3)
    image = vtk.vtkImageData()
    image.SetDimensions(size[0], size[1], 1)
    image.GetPointData().SetScalars(numpy_to_vtk(flat, deep=True))
    writer = vtk.vtkPNGWriter()
    writer.WriteToMemoryOn()
    writer.SetInputData(image)
    for keyword, text in texts.items():
        writer.AddText(keyword, text)
    writer.Write()
    # Written by Python: VTK tells a full disk or a missing folder on the screen only.
    write_whole(path, vtk_to_numpy(writer.GetResult()).tobytes())
