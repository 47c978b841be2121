"""Drawing process of a gallery: layout and drawing of the bodies in a file that `gallery` wrote.

Drawn in parallel projection, so that one scale bar holds for all bodies of a group. The unit of length is the pixel.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyvista

from thirdbody.palette import INK, SOFT_INK, field_colors
from thirdbody.render.canvas import GLOSSY, Canvas, Pane, save_png
from thirdbody.render.coloring import Legend
from thirdbody.render.legend import draw_legend
from thirdbody.render.overlay import Overlay, rectangle
from thirdbody.units import round_length, with_unit

# Pixels.
_WIDTH, _MARGIN, _TITLE, _HEADING, _LABEL, _GAP, _LEGEND = 1600, 40, 84, 92, 36, 34, 72
_COLUMNS, _TALLEST = 6, 400
# Fraction of its cell that the largest body fills.
_FILL = 0.9
_STEEL = "#9FB4CC"
# Principal axes on the screen (rows: right, up, towards the viewer): the long axis mostly to the right, the short one
# mostly to the viewer, turned by 30 degrees about the upright and 25 about the level axis so that all three show.
_UPRIGHT, _LEVEL = np.radians(30.0), np.radians(25.0)


@dataclass(frozen=True, eq=False)
class _Cell:
    """Cell of one body: its spheres, its mesh or both, and the text below."""

    body: int
    spheres: bool
    mesh: bool
    words: str


class _Block:
    """Layout of one group: its cells, their size and scale [pixels]; `top` is set when the picture's height is known."""

    def __init__(self, packed: Any, g: int):
        self.heading, self.facts = (str(words) for words in packed[f"{g}.words"])
        self.spheres = [packed[f"{g}.{b}"] for b in range(int(packed[f"{g}.bodies"]))]
        self.diameters = [float(packed[f"{g}.{b}.diameter"]) for b in range(len(self.spheres))]
        self.vertices = packed[f"{g}.vertices"] if f"{g}.vertices" in packed else None
        self.faces = packed[f"{g}.faces"] if f"{g}.faces" in packed else None
        self.cells = self._cells()
        self.columns = min(_COLUMNS, len(self.cells))
        self.rows = -(-len(self.cells) // self.columns)
        self.wide = (_WIDTH - 2 * _MARGIN) / self.columns
        boxes = [self.box(cell) for cell in self.cells]
        span = np.max([high - low for low, high in boxes], axis=0)
        tallest = min(self.wide, _TALLEST if len(self.cells) > 1 else 0.6 * _TALLEST)
        self.scale = _FILL * float(min(self.wide / span[0], tallest / span[1]))
        self.tall = float(span[1]) * self.scale + 0.1 * tallest
        self.top = 0.0

    def _cells(self) -> list[_Cell]:
        if self.vertices is None:
            counts = [f"{len(spheres)} sphere{'s' * (len(spheres) > 1)}" for spheres in self.spheres]
            sizes = [with_unit(diameter, "m") for diameter in self.diameters]
            return [_Cell(b, True, False, f"{sizes[b]}, {count}") for b, count in enumerate(counts)]
        count = len(self.spheres[0])
        return [
            _Cell(0, False, True, "mesh"),
            _Cell(0, True, True, "mesh over spheres"),
            _Cell(0, True, False, f"{count} spheres"),
        ]

    @property
    def height(self) -> float:
        """Height of the whole block."""
        return _HEADING + self.rows * (self.tall + _LABEL) + _GAP

    def box(self, cell: _Cell) -> tuple[np.ndarray, np.ndarray]:
        """Return the corners (2,) of a cell's content on the screen [m]; the same for all views of a mesh."""
        spheres = self.spheres[cell.body]
        flat = on_screen(spheres[:, :3])[:, :2]
        low, high = (flat - spheres[:, 3:]).min(axis=0), (flat + spheres[:, 3:]).max(axis=0)
        if self.vertices is not None:
            points = on_screen(self.vertices)[:, :2]
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        return low, high

    def middle(self, number: int) -> tuple[float, float]:
        """Return the centre of a cell [pixels]."""
        row, column = divmod(number, self.columns)
        return _MARGIN + (column + 0.5) * self.wide, self.top - _HEADING - row * (self.tall + _LABEL) - 0.5 * self.tall


def on_screen(points: np.ndarray) -> np.ndarray:
    """Return points (n, 3) of a clump's frame as right, up, towards the viewer."""
    cu, su, cl, sl = np.cos(_UPRIGHT), np.sin(_UPRIGHT), np.cos(_LEVEL), np.sin(_LEVEL)
    upright = np.array([[cu, 0.0, su], [0.0, 1.0, 0.0], [-su, 0.0, cu]])
    level = np.array([[1.0, 0.0, 0.0], [0.0, cl, -sl], [0.0, sl, cl]])
    return points @ (level @ upright).T


def draw(file: Path, png: Path) -> None:
    """Draw the bodies in a file that `draw_gallery` wrote, in the drawing process. Raises OSError like `open`."""
    with np.load(file) as packed:
        blocks = [_Block(packed, g) for g in range(int(packed["count"]))]
        title, more = str(packed["title"]), int(packed["more"])
    height = int(_TITLE + sum(block.height for block in blocks) + _LEGEND)
    with Canvas((_WIDTH, height), views=1) as canvas:
        _draw(canvas, blocks, title, more)
        save_png(canvas.pixels(), png)


def _draw(canvas: Canvas, blocks: list[_Block], title: str, more: int) -> None:
    height = canvas.size[1]
    pane, overlay = canvas.add_view((0.0, 0.0, 1.0, 1.0))[0], Overlay(canvas, reference=height)
    pane.show_pixels()
    top = float(height - _TITLE)
    ratios = np.concatenate([2.0 * s[:, 3] / d for block in blocks for s, d in zip(block.spheres, block.diameters, strict=True)])
    limits = _limits(ratios)
    for block in blocks:
        block.top = top
        _draw_block(pane, overlay, block, limits)
        top -= block.height
    overlay.text(title, _MARGIN, height - 44, 34, bold=True)
    if more:
        overlay.text(f"{more} more not drawn", _WIDTH - _MARGIN, height - 44, 24, align="right")
    draw_legend(overlay, Legend("radius of a sphere over the equivalent radius of its body", limits=limits))


def _limits(ratios: np.ndarray) -> tuple[float, float]:
    """Return the limits of the colour scale: those of the values, apart even if all are equal."""
    low, high = float(ratios.min()), float(ratios.max())
    return (low, high) if high - low > 1e-3 * high else (0.0, high)


def _draw_block(pane: Pane, overlay: Overlay, block: _Block, limits: tuple[float, float]) -> None:
    overlay.text(block.heading, _MARGIN, block.top - 22, 28, bold=True)
    overlay.text(block.facts, _MARGIN, block.top - 58, 22, SOFT_INK)
    _draw_scale_bar(overlay, block)
    for number, cell in enumerate(block.cells):
        x, y = block.middle(number)
        low, high = block.box(cell)
        shift = np.array([x, y, 0.0]) - np.array([*(0.5 * (low + high)), 0.0]) * block.scale
        if cell.spheres:
            spheres = block.spheres[cell.body]
            ratio = 2.0 * spheres[:, 3] / block.diameters[cell.body]
            colors = field_colors((ratio - limits[0]) / (limits[1] - limits[0]))
            pane.add_spheres(on_screen(spheres[:, :3]) * block.scale + shift, spheres[:, 3] * block.scale, colors)
        if cell.mesh and block.vertices is not None and block.faces is not None:
            _add_mesh(pane, on_screen(block.vertices) * block.scale + shift, block.faces, 0.45 if cell.spheres else 1.0)
        overlay.text(cell.words, x, y - 0.5 * block.tall - 0.45 * _LABEL, 20, SOFT_INK, align="center")


def _add_mesh(pane: Pane, vertices: np.ndarray, faces: np.ndarray, opacity: float) -> None:
    """Draw a mesh with its vertices (v, 3) in pixels and faces (f, 3)."""
    mesh = pyvista.PolyData.from_regular_faces(vertices, faces)
    smooth = mesh.compute_normals(feature_angle=30.0, split_vertices=True, cell_normals=False)
    pane.add(smooth, color=_STEEL, opacity=opacity, culling="back", **GLOSSY)


def _draw_scale_bar(overlay: Overlay, block: _Block) -> None:
    """Draw a bar of a round length at the right of the heading."""
    length = round_length(180.0 / block.scale)
    right, y, wide = _WIDTH - _MARGIN, block.top - 52, length * block.scale
    for x0, x1, half in ((right - wide, right, 2.5), (right - wide, right - wide + 3, 9.0), (right - 3, right, 9.0)):
        overlay.polygon(rectangle(x0, y - half, x1, y + half), INK)
    overlay.text(with_unit(length, "m"), right - 0.5 * wide, y + 28, 22, align="center")
