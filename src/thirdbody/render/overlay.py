"""Flat shapes and text over a picture."""

from typing import Any

import numpy as np
import pyvista

from thirdbody.palette import INK, rgb
from thirdbody.render.canvas import OVERSAMPLING, Canvas

WIDTH = 1600
"""Width of a picture for which lengths are given [pixels]."""

_LEGIBLE = 11
"""Least height of legible text [pixels]."""

_ALIGNED = {"left": 0.0, "center": 0.5, "right": 1.0}


class Overlay:
    """Flat shapes and text over the whole picture; positions in pixels from its lower left corner.

    Lengths given to `px` and heights of text hold for a picture 1600 pixels wide and `reference` high, and scale with the smaller
    of both ratios: a layout that fits there fits everywhere.
    """

    def __init__(self, canvas: Canvas, reference: float = 900.0):
        self.size = canvas.size
        self._pane, self._unit = canvas.words, min(canvas.size[0] / WIDTH, canvas.size[1] / reference)

    def px(self, length: float) -> float:
        """Return the pixels of a length given for a picture of the reference height."""
        return length * self._unit

    def text(self, words: str, x: float, y: float, height: float, color: str = INK, **style: Any) -> float:
        """Write words of a given height; `align` left, center or right, `bold`. Return their width [pixels].

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
        """Return the pixels of a text height given for a picture of the reference height, never below legibility."""
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
        """Return the width of words of a given height [pixels]."""
        return self._width(self._actor(words, height, bold=bold))

    def fitting(self, words: str, height: float, width: float, bold: bool = False) -> float:
        """Return the height, at most `height`, at which words are at most `width` pixels wide."""
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
    """Return the corners (4, 2) of a rectangle."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
