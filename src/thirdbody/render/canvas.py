"""Off-screen canvas of a picture: renderers for the background, each view, and flat shapes and text over it.

Everything is drawn at twice the size and averaged.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pyvista
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from thirdbody.atomic_files import write_output
from thirdbody.palette import INK, PAPER, rgb

Rectangle = tuple[float, float, float, float]

OVERSAMPLING = 2  # factor by which pictures are drawn larger before averaging, the only antialiasing of ray-cast spheres
GLOSSY = {"ambient": 0.30, "diffuse": 0.80, "specular": 0.22, "specular_power": 35.0}  # material of debris
WIDTH = 1600  # width of a picture for which lengths are given [pixels]
_LEGIBLE = 11  # least height of legible text [pixels]
_ALIGNED = {"left": 0.0, "center": 0.5, "right": 1.0}

_PAPER, _WORDS = 0, 1
_LAYERS = (0, 3)  # layers of the background and the text; between them those of the views and of objects seen through bodies
_LIGHTS = (((-0.6, 1.2, 1.0), 0.85), ((0.8, 0.2, 1.0), 0.35))  # position, in the camera's axes, and intensity


class Pane:
    """Renderer of a canvas; `size` is that of the picture [pixels]."""

    def __init__(self, plotter: pyvista.Plotter, number: int, size: tuple[int, int]):
        self._plotter, self._number, self.size = plotter, number, size
        self.renderer = plotter.renderers[number]

    def add(self, mesh: pyvista.DataSet, **options: Any) -> None:
        """Draw a mesh; `options` are options of `pyvista.Plotter.add_mesh`."""
        self._plotter.subplot(0, self._number)
        actor = self._plotter.add_mesh(mesh, reset_camera=False, render=False, show_scalar_bar=False, **options)
        actor.prop.interpolation = "Gouraud"  # with the existing normals of a mesh

    def add_actor(self, actor: Any) -> None:
        """Draw an actor that is not a mesh."""
        self.renderer.add_actor(actor, reset_camera=False, render=False)

    def add_spheres(self, centers: np.ndarray, radii: np.ndarray, colors: np.ndarray) -> None:
        """Draw spheres at centers (n, 3) with colors (n, 3) uint8, ray-cast: one point each, no triangles."""
        from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLSphereMapper

        if not len(centers):  # pyvista refuses arrays of no rows
            return
        points = pyvista.PolyData(np.ascontiguousarray(centers, np.float32))
        points["radius"], points["color"] = np.float32(radii), np.ascontiguousarray(colors)
        mapper = vtkOpenGLSphereMapper()
        mapper.SetInputData(points)
        mapper.SetScaleArray("radius")
        mapper.SetScalarModeToUsePointFieldData()
        mapper.SelectColorArray("color")
        mapper.SetColorModeToDirectScalars()
        self.add_actor(pyvista.Actor(mapper, pyvista.Property(color="white", **GLOSSY)))

    def show_pixels(self) -> None:
        """Set the unit of length to the pixel of the picture, counted from its lower left corner."""
        wide, tall = self.size
        camera = self.renderer.camera
        camera.parallel_projection = True
        camera.parallel_scale = 0.5 * tall
        camera.focal_point = 0.5 * wide, 0.5 * tall, 0.0
        camera.position = 0.5 * wide, 0.5 * tall, 2000.0
        camera.up = 0.0, 1.0, 0.0
        camera.clipping_range = 500.0, 3500.0

    def add_polygons(self, corners: np.ndarray, colors: np.ndarray) -> None:
        """Draw filled polygons with corners (n, k, 2) in pixels and colors (n, 3) uint8."""
        count, sides = corners.shape[:2]
        flat = np.pad(corners.reshape(-1, 2), ((0, 0), (0, 1)))
        mesh = pyvista.PolyData.from_regular_faces(flat, np.arange(count * sides).reshape(count, sides))
        mesh.cell_data["color"] = colors
        self.add(mesh, scalars="color", rgb=True, lighting=False)

    def project(self, point: np.ndarray) -> tuple[float, float]:
        """Return the position of a point in the picture [pixels]."""
        self.renderer.SetWorldPoint(*point, 1.0)
        self.renderer.WorldToDisplay()
        x, y, _ = self.renderer.GetDisplayPoint()
        return x / OVERSAMPLING, y / OVERSAMPLING


class Canvas:
    """Off-screen plotter for pictures of `size` pixels with up to `views` views; `paper` is behind and `words` before all views.

    In a film one canvas serves all pictures: in a new one every shader is compiled again, which takes longer than drawing.
    """

    def __init__(self, size: tuple[int, int], views: int = 2):
        self.size = size
        self._plotter = pyvista.Plotter(
            off_screen=True, notebook=False, shape=(1, 2 + 2 * views), border=False, lighting=None,
            window_size=[OVERSAMPLING * side for side in size],
        )  # fmt: skip
        self._plotter.disable_anti_aliasing()  # replaced by oversampling, which also smooths ray-cast spheres
        window: Any = self._plotter.render_window
        window.SetDPI(72)  # fonts are measured in pixels
        window.SetNumberOfLayers(_LAYERS[1] + 1)
        self.panes = [Pane(self._plotter, number, size) for number in range(2 + 2 * views)]
        for number, layer in zip((_PAPER, _WORDS), _LAYERS, strict=True):
            self.panes[number].renderer.viewport = (0.0, 0.0, 1.0, 1.0)
            self.panes[number].renderer.layer = layer
            self.panes[number].show_pixels()
        self.paper, self.words = self.panes[_PAPER], self.panes[_WORDS]
        self.paper.renderer.background_color = PAPER
        self._used = 2

    def __enter__(self) -> Canvas:
        return self

    def __exit__(self, *_error: object) -> None:
        self._plotter.close()

    def clear(self) -> None:
        """Remove everything that was drawn."""
        self._plotter.clear()
        self._used = 2

    def add_view(self, viewport: Rectangle) -> tuple[Pane, Pane]:
        """Add a view in a part of the picture (fractions of its size), and one for objects seen through its bodies."""
        outer, inner = self.panes[self._used : self._used + 2]
        self._used += 2
        for layer, pane in enumerate((outer, inner), start=1):
            pane.renderer.viewport = viewport
            pane.renderer.layer = layer
            for position, intensity in _LIGHTS:  # they move with the camera
                pane.renderer.add_light(pyvista.Light(position=position, intensity=intensity, light_type="camera light"))
        inner.renderer.camera = outer.renderer.camera
        return outer, inner

    def pixels(self) -> np.ndarray:
        """Return the picture, (height, width, 3) uint8, the upper row first."""
        self._plotter.render()  # draws nothing before the first screenshot, which renders by itself
        image: Any = self._plotter.screenshot(return_img=True)
        return np.asarray(Image.fromarray(image).reduce(OVERSAMPLING))


def save_png(pixels: np.ndarray, path: Path, texts: Mapping[str, str] = MappingProxyType({})) -> None:
    """Write pixels (height, width, 3) as PNG with `texts` by keyword in its text chunks. Raises OutputError."""
    chunks = PngInfo()
    for keyword, text in texts.items():
        chunks.add_text(keyword, text)
    content = io.BytesIO()
    Image.fromarray(pixels).save(content, "PNG", pnginfo=chunks)
    write_output(path, content.getvalue())


class Overlay:
    """Flat shapes and text over the whole picture; positions in pixels from its lower left corner.

    Lengths given to `px` and heights of text hold for a picture 1600 pixels wide and `reference` high, and scale with the smaller
    of both ratios: a layout that fits there fits everywhere.
    """

    def __init__(self, canvas: Canvas, reference: float = 900.0):
        self.size = canvas.size
        self.pane, self._unit = canvas.words, min(canvas.size[0] / WIDTH, canvas.size[1] / reference)

    def px(self, length: float) -> float:
        """Return the pixels of a length given for a picture of the reference height."""
        return length * self._unit

    def text(self, words: str, x: float, y: float, height: float, color: str = INK, **style: Any) -> None:
        """Write words of a given height; `align` left, center or right, `bold`; smaller if wider than `fit` pixels.

        Words that would be cut at an edge of the picture move inside.
        """
        align, fit = style.pop("align", "left"), style.pop("fit", np.inf)
        height *= min(1.0, fit / max(self.width_of(words, height, **style), 1.0)) if fit < np.inf else 1.0
        actor = self._actor(words, height, color=color, justification_horizontal=align, **style)
        actor.position = (x * OVERSAMPLING, y * OVERSAMPLING)
        self.pane.add_actor(actor)
        width, margin = self._width(actor), self.px(8)
        left = x - _ALIGNED[align] * width
        shift = max(margin - left, 0.0) or min(self.size[0] - margin - (left + width), 0.0)
        if shift and width < self.size[0] - 2 * margin:
            actor.position = ((x + shift) * OVERSAMPLING, y * OVERSAMPLING)

    def text_height(self, height: float) -> float:
        """Return the pixels of a text height given for a picture of the reference height, never below legibility."""
        return max(self.px(height), _LEGIBLE)

    def _actor(self, words: str, height: float, **style: Any) -> pyvista.Text:
        size = int(self.text_height(height) * OVERSAMPLING)
        actor = pyvista.Text(words)
        actor.prop = pyvista.TextProperty(font_family="arial", font_size=size, justification_vertical="center", **style)
        return actor

    def _width(self, actor: pyvista.Text) -> float:
        box = [0.0] * 4
        actor.GetBoundingBox(self.pane.renderer, box)
        return (box[1] - box[0]) / OVERSAMPLING

    def width_of(self, words: str, height: float, bold: bool = False) -> float:
        """Return the width of words of a given height [pixels]."""
        return self._width(self._actor(words, height, bold=bold))

    def polygon(self, corners: np.ndarray, color: str) -> None:
        """Draw a filled polygon with corners (k, 2)."""
        self.pane.add_polygons(np.asarray(corners, np.float64)[None], np.array([rgb(color)], np.uint8))

    def disc(self, x: float, y: float, radius: float, color: str) -> None:
        """Draw a filled circle."""
        angle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
        self.polygon(np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1), color)

    def outline(self, corners: np.ndarray, color: str) -> None:
        """Draw the outline of a polygon with corners (k, 2)."""
        line = pyvista.MultipleLines(np.pad([*corners, corners[0]], ((0, 0), (0, 1))))
        self.pane.add(line, color=color, lighting=False, line_width=self.px(1.5) * OVERSAMPLING)


def rectangle(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    """Return the corners (4, 2) of a rectangle."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
