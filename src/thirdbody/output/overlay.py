"""Flat shapes and words laid over a picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from thirdbody.output.palette import rgb

INK = "#20242A"

# Layers of a window: the scene, what is seen through it (forces), words.
INNER_LAYER, WORDS_LAYER, LAYERS = 1, 2, 3

# Width of a picture for which lengths are given, and the least height of words that can be read, pixels.
WIDTH = 1600
LEGIBLE = 11

# Pictures are drawn larger by this and averaged: the edges of ray-cast spheres know no other smoothing.
OVERSAMPLING = 2


def unit_rgb(text: str) -> tuple[float, float, float]:
    """Red, green and blue (0 to 1) of a colour written as `#RRGGBB`, as VTK takes them."""
    red, green, blue = rgb(text)
    return red / 255.0, green / 255.0, blue / 255.0


class Overlay:
    """Flat shapes and words over the whole picture; places in pixels from its lower left corner.

    Lengths given to `px` and heights of words hold for a picture 1600 pixels wide and `reference` high, and grow with the
    smaller of both: what fits there fits everywhere.
    """

    def __init__(self, window: Any, size: tuple[int, int], reference: float = 900.0):
        import vtk

        self._vtk, self._size, self._unit = vtk, size, min(size[0] / WIDTH, size[1] / reference)
        self._renderer = vtk.vtkRenderer()
        self._renderer.SetLayer(WORDS_LAYER)
        self._renderer.InteractiveOff()
        window.AddRenderer(self._renderer)

    def px(self, length: float) -> float:
        """Pixels of a length given for a picture of the reference height."""
        return length * self._unit

    def text(self, words: str, x: float, y: float, height: float, color: str = INK, **style: Any) -> float:
        """Words of a given height; `align` left, center or right, `bold`. Returns their width in pixels.

        Words that would be cut at an edge of the picture move inside.
        """
        actor = self._vtk.vtkTextActor()
        actor.SetInput(words)
        # Fonts are measured in pixels only at 72 dpi, which the window is set to.
        look = actor.GetTextProperty()
        look.SetFontFamilyToArial()
        look.SetFontSize(self._font_size(height))
        look.SetColor(*unit_rgb(color))
        look.SetBold(style.get("bold", False))
        align = {"left": look.SetJustificationToLeft, "center": look.SetJustificationToCentered}
        align.get(style.get("align", "left"), look.SetJustificationToRight)()
        look.SetVerticalJustificationToCentered()
        actor.SetPosition(x * OVERSAMPLING, y * OVERSAMPLING)
        self._renderer.AddViewProp(actor)
        box = [0.0] * 4
        actor.GetBoundingBox(self._renderer, box)
        wide = (box[1] - box[0]) / OVERSAMPLING
        align_left = {"left": 0.0, "center": 0.5}.get(style.get("align", "left"), 1.0)
        left, room = x - align_left * wide, self.px(8)
        shift = max(room - left, 0.0) or min(self._size[0] - room - (left + wide), 0.0)
        if shift and wide < self._size[0] - 2 * room:
            actor.SetPosition((x + shift) * OVERSAMPLING, y * OVERSAMPLING)
        return wide

    def width_of(self, words: str, height: float, bold: bool = False) -> float:
        """Width in pixels that words of a given height take up."""
        actor = self._vtk.vtkTextActor()
        actor.SetInput(words)
        look = actor.GetTextProperty()
        look.SetFontFamilyToArial()
        look.SetBold(bold)
        look.SetFontSize(self._font_size(height))
        box = [0.0] * 4
        actor.GetBoundingBox(self._renderer, box)
        return (box[1] - box[0]) / OVERSAMPLING

    def fitting(self, words: str, height: float, room: float, bold: bool = False) -> float:
        """The height, at most `height`, in which words take up at most `room` pixels of width."""
        return height * min(1.0, room / max(self.width_of(words, height, bold), 1.0))

    def _font_size(self, height: float) -> int:
        return int(max(self.px(height), LEGIBLE) * OVERSAMPLING)

    def polygon(self, corners: np.ndarray, color: str, outline: bool = False) -> None:
        """A filled polygon, or its outline."""
        vtk = self._vtk
        points, cells = vtk.vtkPoints(), vtk.vtkCellArray()
        numbers = [points.InsertNextPoint(x * OVERSAMPLING, y * OVERSAMPLING, 0.0) for x, y in corners]
        if outline:
            numbers.append(numbers[0])
        cells.InsertNextCell(len(numbers), numbers)
        data = vtk.vtkPolyData()
        data.SetPoints(points)
        (data.SetLines if outline else data.SetPolys)(cells)
        mapper = vtk.vtkPolyDataMapper2D()
        mapper.SetInputData(data)
        actor = vtk.vtkActor2D()
        actor.SetMapper(mapper)
        actor.GetProperty().SetColor(*unit_rgb(color))
        actor.GetProperty().SetLineWidth(self.px(1.5) * OVERSAMPLING)
        self._renderer.AddViewProp(actor)

    def disc(self, x: float, y: float, radius: float, color: str) -> None:
        angle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
        self.polygon(np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1), color)
