"""Flat shapes and words laid over a picture."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista

from thirdbody.palette import INK, rgb
from thirdbody.render.canvas import OVERSAMPLING, Canvas

WIDTH = 1600
"""Width of a picture for which lengths are given, pixels."""

_LEGIBLE = 11
"""Least height of words that can be read, pixels."""

_ALIGNED = {"left": 0.0, "center": 0.5, "right": 1.0}


class Overlay:
    """Flat shapes and words over the whole picture; positions in pixels from its lower left corner.

    Lengths given to `px` and heights of words hold for a picture 1600 pixels wide and `reference` high, and grow with the
    smaller of both: what fits there fits everywhere.
    """

    def __init__(self, canvas: Canvas, reference: float = 900.0):
        self.size = canvas.size
        self._pane, self._unit = canvas.words, min(canvas.size[0] / WIDTH, canvas.size[1] / reference)

    def px(self, length: float) -> float:
        """Pixels of a length given for a picture of the reference height."""
        return length * self._unit

    def text(self, words: str, x: float, y: float, height: float, color: str = INK, **style: Any) -> float:
        """Write words of a given height; `align` left, center or right, `bold`. Returns their width in pixels.

        Words that would be cut at an edge of the picture move inside.
        """
        align = style.pop("align", "left")
        actor = self._actor(words, height, color=color, justification_horizontal=align, **style)
        actor.position = (x * OVERSAMPLING, y * OVERSAMPLING)
        self._pane.add_actor(actor)
        width, margin = self._width(actor), self.px(8)
        left = x - _ALIGNED[align] * width
        shift = max(margin - left, 0.0) or min(self.size[0] - margin - (left + width), 0.0)
        if shift and width < self.size[0] - 2 * margin:
            actor.position = ((x + shift) * OVERSAMPLING, y * OVERSAMPLING)
        return width

    def text_height(self, height: float) -> float:
        """Pixels of a height of words given for a picture of the reference height: never too small to be read."""
        return max(self.px(height), _LEGIBLE)

    def _actor(self, words: str, height: float, **style: Any) -> pyvista.Text:
        size = int(self.text_height(height) * OVERSAMPLING)
        actor = pyvista.Text(words)
        actor.prop = pyvista.TextProperty(font_family="arial", font_size=size, justification_vertical="center", **style)
        return actor

    def _width(self, actor: pyvista.Text) -> float:
        box = [0.0] * 4
        actor.GetBoundingBox(self._pane.renderer, box)
        return (box[1] - box[0]) / OVERSAMPLING

    def width_of(self, words: str, height: float, bold: bool = False) -> float:
        """Width in pixels that words of a given height take up."""
        return self._width(self._actor(words, height, bold=bold))

    def fitting(self, words: str, height: float, width: float, bold: bool = False) -> float:
        """The height, at most `height`, in which words take up at most `width` pixels."""
        return height * min(1.0, width / max(self.width_of(words, height, bold), 1.0))

    def polygon(self, corners: np.ndarray, color: str) -> None:
        """Draw a filled polygon with corners (k, 2)."""
        self.polygons(np.asarray(corners, np.float64)[None], np.array([rgb(color)], np.uint8))

    def polygons(self, corners: np.ndarray, colors: np.ndarray) -> None:
        """Draw filled polygons with corners (n, k, 2) and colors (n, 3) uint8."""
        self._pane.add_polygons(corners, colors)

    def disc(self, x: float, y: float, radius: float, color: str) -> None:
        """Draw a filled circle."""
        angle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
        self.polygon(np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1), color)

    def outline(self, corners: np.ndarray, color: str) -> None:
        """Draw the outline of a polygon with corners (k, 2)."""
        closed = np.pad([*corners, corners[0]], ((0, 0), (0, 1)))
        line = pyvista.MultipleLines(closed)
        self._pane.add(line, color=color, lighting=False, line_width=self.px(1.5) * OVERSAMPLING)


def rectangle(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    """Corners (4, 2) of a rectangle."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
