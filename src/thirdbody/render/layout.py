"""Layout and drawing of the picture of one frame: the whole, a close-up of a part, title, facts and legend.

Runs in a separate process (`render`): VTK may crash where it cannot draw.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from thirdbody.palette import INK, PANEL, SOFT_INK, rgb
from thirdbody.render.canvas import Canvas, Rectangle
from thirdbody.render.legend import draw_legend, legend_height
from thirdbody.render.overlay import Overlay, rectangle
from thirdbody.render.picture_data import PictureData, Window, close_up_window, slice_window
from thirdbody.render.viewport import ARROW, Viewport

HEADING = 118.0
"""Height of title and facts in a picture 900 pixels high."""

_SCALE_LABEL = 36.0
"""Height of the label below a scale bar in such a picture."""

_ALONE, _BESIDE, _CLOSE = (-0.42, -0.85, 0.5), (-0.42, -0.80, 0.80), (-0.40, -0.85, 0.60)
"""Camera position for the whole, for the whole next to a close-up, and for a close-up; all from the front left."""


@dataclass(frozen=True)
class Layout:
    """Properties common to all pictures of a film.

    Size [pixels], view, the corners `low`, `high` (3,) [m] that the camera keeps in sight, `directions` (k, 2) of the drag, the
    window to enlarge or None and the height of its content [m], the force of the thickest tube [N].
    """

    size: tuple[int, int]
    view: str
    low: np.ndarray
    high: np.ndarray
    directions: np.ndarray
    close_up: Window | None
    close_up_height: float
    full_scale: float


def compute_layout(frames: Iterable[PictureData], size: tuple[int, int], view: str, zoom: float | None) -> Layout:
    """Return the layout for one frame, or for all frames of a film, which are processed one at a time.

    Without `zoom` the whole is shown, and for many bodies an enlarged part; `zoom` is the fraction of the domain's width and
    depth that is shown alone.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    directions: list[np.ndarray] = []
    full_scale, last = 0.0, None
    for last in frames:
        low, high = np.minimum(low, last.low), np.maximum(high, last.high)
        full_scale = max(full_scale, last.tubes.full_scale if last.tubes else 0.0)
        add_direction(directions, last.drag)
    assert last is not None
    close_up = None
    if zoom is not None:
        middle, half = 0.5 * (low + high), 0.5 * zoom * (high - low)
        low[:2], high[:2] = (middle - half)[:2], (middle + half)[:2]
        high[2] = last.plate_height_over(low, high)
    elif view in ("side", "front"):
        close_up = slice_window(last, 0 if view == "side" else 1)
    else:
        close_up = close_up_window(last)
    height = last.plate_height_over(*close_up) if close_up else high[2]
    return Layout(size, view, low, high, np.array(directions).reshape(-1, 2), close_up, height, full_scale)


def add_direction(directions: list[np.ndarray], direction: np.ndarray) -> None:
    """Add a direction (2,) to a list unless it is zero or already there."""
    if direction.any() and not any(np.allclose(direction, other, atol=1e-3) for other in directions):
        directions.append(direction)


def draw_picture(canvas: Canvas, layout: Layout, data: PictureData) -> None:
    """Draw the whole picture of a frame."""
    size, overlay = layout.size, Overlay(canvas)
    foot = legend_height(overlay, data.legend, layout.full_scale) / size[1]
    head = 1.0 - overlay.px(HEADING) / size[1]
    areas = _viewports(layout, foot, head, overlay.px(_SCALE_LABEL) / size[1])
    view = Viewport(canvas, data, areas[0], (layout.low, layout.high), layout.view)
    if layout.close_up:
        view.add_outline(*layout.close_up)
    if not (layout.close_up and layout.view in ("side", "front")):  # a strip is too thin for tubes
        view.add_tubes(layout.full_scale)
    finish_view(view, overlay, _BESIDE if layout.close_up else _ALONE, layout.directions)
    if layout.close_up:
        _add_close_up(canvas, data, overlay, layout, areas[1])
    write_title(overlay, data.title, data.facts)
    draw_legend(overlay, data.legend, layout.full_scale)


def _viewports(layout: Layout, foot: float, head: float, label: float) -> list[Rectangle]:
    """Return the areas of the whole and its close-up: side by side in wide pictures, else one below the other.

    `label` is the height that the label of a scale bar needs: a close-up below the whole begins under it.
    """
    if layout.close_up is None:
        return [(0.01, foot, 0.99, head)]
    if layout.view in ("side", "front"):
        cut = foot + 0.66 * (head - foot)
        return [(0.01, cut + label, 0.99, head - 0.035), (0.015, foot + 0.005, 0.985, cut - 0.01)]
    if layout.size[0] < 1.25 * layout.size[1]:
        cut = foot + 0.5 * (head - foot)
        return [(0.01, cut + label, 0.99, head), (0.015, foot + 0.005, 0.985, cut - 0.01)]
    return [(0.01, foot, 0.56, head), (0.565, foot + 0.005, 0.985, head)]


def finish_view(view: Viewport, overlay: Overlay, iso: tuple[float, float, float], directions: np.ndarray | None = None) -> None:
    """Draw the scale bar and, if the drag has `directions` (k, 2), its arrow; set the camera, then the labels."""
    arrow = None
    if directions is not None:
        view.fit_arrows(directions)
        arrow = view.add_arrow()
    position, words = view.add_scale_bar()
    view.aim_camera(iso)
    x, y = view.project(position)
    half = 0.5 * overlay.text_height(24)
    overlay.text(words, x - overlay.px(4), y - overlay.px(10) - half, 24, align="center")
    if arrow is not None:
        x, y = view.project(arrow[0])
        overlay.text(arrow[1], x, y + overlay.px(6) + half, 24, ARROW, align="center", bold=True)


def _add_close_up(canvas: Canvas, data: PictureData, overlay: Overlay, layout: Layout, area: Rectangle) -> None:
    assert layout.close_up is not None
    heights = (layout.low[2], layout.close_up_height)
    low, high = (np.array([*corner, z]) for corner, z in zip(layout.close_up, heights, strict=True))
    view = Viewport(canvas, data, _add_panel(canvas, overlay, area, "close-up"), (low, high), layout.view)
    view.add_tubes(layout.full_scale)
    finish_view(view, overlay, _CLOSE)


def _add_panel(canvas: Canvas, overlay: Overlay, area: Rectangle, heading: str) -> Rectangle:
    """Draw a framed panel with a heading; return the area inside that is free for a view."""
    size = canvas.size
    x0, y0, x1, y1 = (value * size[i % 2] for i, value in enumerate(area))
    canvas.paper.add_polygons(rectangle(x0, y0, x1, y1)[None], np.array([rgb(PANEL)], np.uint8))
    overlay.outline(rectangle(x0, y0, x1, y1), SOFT_INK)
    overlay.text(heading, x0 + overlay.px(16), y1 - overlay.px(24), 24, SOFT_INK)
    side, head, foot = overlay.px(6) / size[0], overlay.px(42) / size[1], overlay.px(_SCALE_LABEL) / size[1]
    return area[0] + side, area[1] + foot, area[2] - side, area[3] - head


def write_title(overlay: Overlay, title: str, facts: str) -> None:
    """Write title and facts along the upper edge, smaller if they are too long."""
    left, (wide, tall) = overlay.px(32), overlay.size
    width = wide - 2.0 * left
    if title:
        overlay.text(title, left, tall - overlay.px(40), overlay.fitting(title, 36, width, bold=True), INK, bold=True)
    overlay.text(facts, left, tall - overlay.px(88), overlay.fitting(facts, 26, width), SOFT_INK)
