"""Layout and drawing of the picture of one frame: the whole, a close-up of a part, title, facts and legend.

Runs in a separate process (`elsewhere`): VTK may crash where it cannot draw.
"""

import math
import re
import textwrap
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from thirdbody.palette import FORCE_COLORS, INK, PANEL, SOFT_INK, field_colors, mixed, rgb
from thirdbody.render.canvas import Canvas, Overlay, Rectangle, rectangle
from thirdbody.render.coloring import Legend
from thirdbody.render.picture_data import PictureData, Window
from thirdbody.render.viewport import ARROW, Viewport
from thirdbody.units import with_unit

_HEADING = 118.0  # height of title and facts in a picture 900 pixels high
_SCALE_LABEL = 36.0  # height of the label below a scale bar in such a picture
# Of the legend: height of its lowest row, its distance to the left edge, space between its items.
_LOWEST, _LEFT, _SPACE = 48.0, 32.0, 48.0
_CAPTION = 20  # height of the letters of its caption
_STRIPS = 128

# Camera position for the whole, for the whole next to a close-up, and for a close-up; all from the front left.
_ALONE, _BESIDE, _CLOSE = (-0.42, -0.85, 0.5), (-0.42, -0.80, 0.80), (-0.40, -0.85, 0.60)
_CLOSE_UP_BODIES = 60  # number of bodies, about, that can be distinguished in a close-up
_WITHOUT_CLOSE_UP = 150  # up to this number of bodies the view of the whole is close enough, but for a thin layer from the side
_SLICE_BODIES = 15  # number of bodies, at least about, in a slice that is seen from the side
_WIDEST_SLICE = 0.8  # a slice wider than this fraction of the domain, as one of a deep bed, would show the whole again


@dataclass(frozen=True)
class Layout:
    """Properties common to all pictures of a film.

    View, the corners `low`, `high` (3,) [m] that the camera keeps in sight, `directions` (k, 2) of the drag, the force of the
    thickest tube or longest arrow [N]. Of the whole: the window to enlarge or None and the height of its content [m]. Of a
    close-up of one particle: its size [m], and whether the corners are relative to it (`follows`).
    """

    view: str
    low: np.ndarray
    high: np.ndarray
    directions: np.ndarray
    full_scale: float
    close_up: Window | None = None
    close_up_height: float = 0.0
    extent: float = 0.0
    follows: bool = False


def compute_layout(frames: Iterable[PictureData], view: str, zoom: float | None) -> Layout:
    """Return the layout for one frame, or for all frames of a film, which are processed one at a time.

    Without `zoom` the whole is shown, and for many bodies an enlarged part; `zoom` is the fraction of the domain's width and
    depth that is shown alone.
    """
    low, high, close_up = np.full(3, np.inf), np.full(3, -np.inf), None
    directions: list[np.ndarray] = []
    full_scale = 0.0
    for last in frames:
        low, high = np.minimum(low, last.low), np.maximum(high, last.high)
        full_scale = max(full_scale, last.tubes.full_scale if last.tubes else 0.0)
        add_direction(directions, last.drag)
    if zoom is not None:
        middle, half = 0.5 * (low + high), 0.5 * zoom * (high - low)
        low[:2], high[:2] = (middle - half)[:2], (middle + half)[:2]
        high[2] = last.plate_height_over(low, high)
    else:
        close_up = close_up_window(last, view)
    height = last.plate_height_over(*close_up) if close_up else high[2]
    return Layout(view, low, high, np.array(directions).reshape(-1, 2), full_scale, close_up, height)


def close_up_window(data: PictureData, view: str = "iso") -> Window | None:
    """Return the part to enlarge, where states mix most; None for few bodies.

    About 60 bodies; from the side or the front ten times as wide as high and few bodies deep, and None for a bed so high that
    this would be nearly the whole.
    """
    count, extent, flat = len(data.bodies), data.high - data.low, view in ("side", "front")
    if count <= _WITHOUT_CLOSE_UP and not flat:
        return None
    if not flat:
        side = math.sqrt(_CLOSE_UP_BODIES / count * extent[0] * extent[1])
        # Deeper than wide: seen at an angle it then fills a square panel.
        half, counts = np.minimum(0.5 * side * np.array([0.85, 1.0 / 0.85]), 0.5 * extent[:2]), (9, 7)
    else:
        along = 0 if view == "side" else 1
        half, counts = np.empty(2), (12, 12)
        half[along] = min(5.0 * extent[2], 0.5 * extent[along])
        depth = 0.25 * _SLICE_BODIES / count * extent[0] * extent[1] / half[along]
        half[1 - along] = min(max(1.2 * extent[2], depth), 0.5 * extent[1 - along])
        if 2.0 * half[along] > _WIDEST_SLICE * extent[along]:
            return None
    ends = zip(data.low[:2] + half, data.high[:2] - half, counts, strict=True)
    points = (np.array(point) for point in product(*(np.linspace(low, high, n) for low, high, n in ends)))
    middle = max(points, key=lambda point: _mixture(data, point - half, point + half))
    return middle - half, middle + half


def _mixture(data: PictureData, low: np.ndarray, high: np.ndarray) -> float:
    """Return the entropy of the states in a window, Shannon (1948); of equal windows the one with more bodies ranks higher."""
    counts = np.bincount(data.codes[data.bodies_inside(low, high)]).astype(np.float64)
    if not counts.sum():
        return -1.0
    fractions = counts[counts > 0] / counts.sum()
    return float(-(fractions * np.log(fractions)).sum()) + 1e-3 * min(1.0, counts.sum() / _CLOSE_UP_BODIES)


def add_direction(directions: list[np.ndarray], direction: np.ndarray) -> None:
    """Add a direction (2,) to a list unless it is zero or already there."""
    if direction.any() and not any(np.allclose(direction, other, atol=1e-3) for other in directions):
        directions.append(direction)


def draw_picture(canvas: Canvas, layout: Layout, data: PictureData) -> None:
    """Draw the whole picture of a frame."""
    overlay = Overlay(canvas)
    areas = _viewports(layout, canvas.size, *draw_frame(overlay, data, data.legend, layout.full_scale), overlay.px(_SCALE_LABEL))
    view = Viewport(canvas, data, areas[0], (layout.low, layout.high), layout.view)
    view.add_contact()
    if layout.close_up:
        view.add_outline(*layout.close_up)
    if not (layout.close_up and layout.view in ("side", "front")):  # a strip is too thin for tubes
        view.add_tubes(layout.full_scale)
    finish_view(view, overlay, _BESIDE if layout.close_up else _ALONE, layout.directions)
    if layout.close_up:
        heights = (layout.low[2], layout.close_up_height)
        low, high = (np.array([*corner, z]) for corner, z in zip(layout.close_up, heights, strict=True))
        close = Viewport(canvas, data, _add_panel(canvas, overlay, areas[1], "close-up"), (low, high), layout.view)
        close.add_tubes(layout.full_scale)
        finish_view(close, overlay, _CLOSE)


def draw_frame(overlay: Overlay, data: PictureData, legend: Legend, full_scale: float = 0.0) -> tuple[float, float]:
    """Draw title, facts and legend; return the fractions of the picture's height between which there is room for views."""
    by_force = data.tubes is None or data.tubes.colors is None
    foot = draw_legend(overlay, legend, full_scale, FORCE_COLORS if by_force else (INK, INK))
    left, (wide, tall) = overlay.px(32), overlay.size
    if data.title:
        overlay.text(data.title, left, tall - overlay.px(40), 36, bold=True, fit=wide - 2.0 * left)
    overlay.text(data.facts, left, tall - overlay.px(88), 26, SOFT_INK, fit=wide - 2.0 * left)
    return foot / tall, 1.0 - overlay.px(_HEADING) / tall


def _viewports(layout: Layout, size: tuple[int, int], foot: float, head: float, label: float) -> list[Rectangle]:
    # The whole and its close-up: side by side in wide pictures, else one below the other; the close-up then begins under the
    # label, of this height [pixels], of the scale bar.
    flat = layout.view in ("side", "front")
    if layout.close_up is None:
        return [(0.01, foot, 0.99, head)]
    if not flat and size[0] >= 1.25 * size[1]:
        return [(0.01, foot, 0.56, head), (0.565, foot + 0.005, 0.985, head)]
    part, margin = (0.56, 0.035) if flat else (0.5, 0.0)
    cut = foot + part * (head - foot)
    return [(0.01, cut + label / size[1], 0.99, head - margin), (0.015, foot + 0.005, 0.985, cut - 0.01)]


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


def _add_panel(canvas: Canvas, overlay: Overlay, area: Rectangle, heading: str) -> Rectangle:
    size = canvas.size
    x0, y0, x1, y1 = (value * size[i % 2] for i, value in enumerate(area))
    canvas.paper.add_polygons(rectangle(x0, y0, x1, y1)[None], np.array([rgb(PANEL)], np.uint8))
    overlay.outline(rectangle(x0, y0, x1, y1), SOFT_INK)
    overlay.text(heading, x0 + overlay.px(16), y1 - overlay.px(24), 24, SOFT_INK)
    side, head, foot = overlay.px(6) / size[0], overlay.px(42) / size[1], overlay.px(_SCALE_LABEL) / size[1]
    return area[0] + side, area[1] + foot, area[2] - side, area[3] - head


_Item = tuple[float, Callable[[float, float], None]]  # width of an item of the legend, and its drawing at a position


def draw_legend(overlay: Overlay, legend: Legend, full_scale: float = 0.0, tubes: tuple[str, str] = FORCE_COLORS) -> float:
    """Draw along the lower edge states and their colours or a colour scale, the key of the forces, and the caption.

    `full_scale` [N] is the force of the thickest tube, 0 without tubes, `tubes` their colours from 0 to it. Return the height,
    including the distance to the edge [pixels].
    """
    rows, width = _rows(overlay, legend, full_scale, tubes), overlay.size[0] - 2.0 * overlay.px(_LEFT)
    letters = int(width / max(overlay.width_of(legend.caption or " ", _CAPTION), 1.0) * len(legend.caption))
    lines = textwrap.wrap(legend.caption, max(letters, 20))[::-1]
    line = 1.3 * overlay.text_height(_CAPTION)
    for number, words in enumerate(lines):
        overlay.text(words, overlay.px(_LEFT), overlay.px(12) + (number + 0.5) * line, _CAPTION, SOFT_INK)
    pitch = 44.0 if legend.limits is None else 62.0  # a colour scale has numbers below it
    lowest = overlay.px(_LOWEST + (pitch - 44.0) * bool(lines)) + len(lines) * line
    for number, row in enumerate(reversed(rows)):
        x, y = overlay.px(_LEFT), lowest + overlay.px(pitch * number)
        for wide, draw in row:
            draw(x, y)
            x += wide + overlay.px(_SPACE)
    return lowest + overlay.px(pitch * (len(rows) - 1) + 44.0)


def _rows(overlay: Overlay, legend: Legend, full_scale: float, tubes: tuple[str, str]) -> list[list[_Item]]:
    items: list[_Item] = []
    if legend.limits is not None:
        items.append(_scale(overlay, legend, 0.32 * overlay.size[0]))
    elif legend.title and legend.entries:
        items.append((overlay.width_of(legend.title, 28), lambda x, y: overlay.text(legend.title, x, y, 28)))
    items += [_state(overlay, words, color, legend.total) for words, color in legend.entries]
    if full_scale > 0.0:
        items.append(_force_key(overlay, full_scale, tubes))
    rows: list[list[_Item]] = [[]]
    left = width = overlay.size[0] - 2.0 * overlay.px(_LEFT)
    for item in items:
        if rows[-1] and item[0] > left:
            rows.append([])
            left = width
        rows[-1].append(item)
        left -= item[0] + overlay.px(_SPACE)
    return rows


def _state(overlay: Overlay, words: str, color: str, total: int) -> _Item:
    # As wide as the largest count, so that nothing moves in a film when a count gains a digit.
    widest = re.sub(r"  \d+  \(\d+ %\)$", f"  {'0' * len(str(total))}  (00 %)", words)

    def draw(x: float, y: float) -> None:
        overlay.disc(x + overlay.px(13), y, overlay.px(13), color)
        overlay.text(words, x + overlay.px(36), y, 28)

    return overlay.px(36) + overlay.width_of(widest, 28), draw


def _scale(overlay: Overlay, legend: Legend, wide: float) -> _Item:
    title, marks = legend.scale()
    before = overlay.width_of(title, 28) + overlay.px(36)

    def draw(x: float, y: float) -> None:
        overlay.text(title, x, y, 28)
        left, tall, middle = x + before, overlay.px(12), y + overlay.px(10)
        edges = np.linspace(left, left + wide, _STRIPS + 1)
        strips = np.array([rectangle(a, middle - tall, b, middle + tall) for a, b in zip(edges, edges[1:], strict=False)])
        overlay.pane.add_polygons(strips, field_colors((np.arange(_STRIPS) + 0.5) / _STRIPS))
        for fraction, number in marks:
            x, foot, half = left + fraction * wide, middle - tall, overlay.px(1.2)
            overlay.polygon(rectangle(x - half, foot - overlay.px(7), x + half, foot), INK)
            overlay.text(number, x, foot - overlay.px(20), 24, align="center")

    return before + wide, draw


def _force_key(overlay: Overlay, full_scale: float, colors: tuple[str, str]) -> _Item:
    """Return a wedge from zero to the force of the thickest tube: in perspective no single thickness could be shown."""
    words, largest = "contact force  0", f"{with_unit(full_scale, 'N')} or more"
    before, wedge = overlay.width_of(words, 28) + overlay.px(14), overlay.px(120)

    def draw(x: float, y: float) -> None:
        overlay.text(words, x, y, 28)
        edges, tall = np.linspace(0.0, 1.0, 25), overlay.px(10)
        corners = [[(x + before + f * wedge, y + f * side * tall) for f, side in ((a, -1), (b, -1), (b, 1), (a, 1))]
                   for a, b in zip(edges, edges[1:], strict=False)]  # fmt: skip
        overlay.pane.add_polygons(np.array(corners), mixed(colors, edges[1:]))
        overlay.text(largest, x + before + wedge + overlay.px(14), y, 28)

    return before + wedge + overlay.px(14) + overlay.width_of(largest, 28), draw
