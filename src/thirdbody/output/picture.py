"""Lays out pictures of a shot and draws them with VTK, without a screen. Runs in a process of its own (`render`): VTK
may crash where it cannot draw.

Everything is drawn at twice the size and averaged.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from thirdbody.output.canvas import PAPER, SOFT_INK, new_window, paint_panel
from thirdbody.output.legend import draw_legend, legend_height
from thirdbody.output.overlay import INK, Overlay
from thirdbody.output.shot import Shot, close_up_window, slice_window
from thirdbody.output.view import ARROW, Rectangle, View

PANEL = "#F5F7F9"

# Height of title and facts in a picture 900 pixels high.
HEADING = 118.0

# Height that the words of a scale bar take up below it, in such a picture.
SCALE_LABEL = 36.0

# How the camera looks at the whole, at the whole beside a close-up, and at a close-up; all from the front left.
ALONE, BESIDE, CLOSE = (-0.42, -0.85, 0.5), (-0.42, -0.80, 0.80), (-0.40, -0.85, 0.60)

Window = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Plan:
    """What stays over all pictures of a film: size in pixels, view, the room (`low`, `high` (3,) m) that the camera
    keeps in sight, directions (k, 2) of the drag, the part to enlarge or None and the height (m) of what lies there,
    the force (N) of the thickest tube."""

    size: tuple[int, int]
    view: str
    low: np.ndarray
    high: np.ndarray
    ways: np.ndarray
    part: Window | None
    top: float
    strongest: float


def make_plan(shots: Iterable[Shot], size: tuple[int, int], view: str, zoom: float | None) -> Plan:
    """The plan for one shot, or for all shots of a film, which are taken one after the other.

    Without `zoom` the whole is shown, and of many bodies a part beside it enlarged; `zoom` is the share of the domain's
    width and depth that is shown alone.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    ways: list[np.ndarray] = []
    strongest, last = 0.0, None
    for last in shots:
        low, high = np.minimum(low, last.low), np.maximum(high, last.high)
        strongest = max(strongest, last.tubes.strongest if last.tubes else 0.0)
        add_way(ways, last.drag)
    assert last is not None
    part = None
    if zoom is not None:
        middle, half = 0.5 * (low + high), 0.5 * zoom * (high - low)
        low[:2], high[:2] = (middle - half)[:2], (middle + half)[:2]
    elif view in ("side", "front"):
        part = slice_window(last, 0 if view == "side" else 1)
    else:
        part = close_up_window(last)
    if zoom is not None:
        high[2] = last.ceiling(low, high)
    top = last.ceiling(*part) if part else high[2]
    return Plan(size, view, low, high, np.array(ways).reshape(-1, 2), part, top, strongest)


def add_way(ways: list[np.ndarray], way: np.ndarray) -> None:
    """Add a direction (2,) to those that there are; zero and those that are there already change nothing."""
    if way.any() and not any(np.allclose(way, other, atol=1e-3) for other in ways):
        ways.append(way)


def compose(shot: Shot, plan: Plan, used: Any = None) -> Any:
    """A window (the used one, if given) with the whole picture of a shot in it, not yet drawn."""
    size = plan.size
    window = new_window(size, used)
    overlay = Overlay(window, size)
    foot = legend_height(overlay, shot.legend, size, plan.strongest) / size[1]
    head = 1.0 - overlay.px(HEADING) / size[1]
    places = _places(plan, foot, head, overlay.px(SCALE_LABEL) / size[1])
    view = View(window, shot, places[0], plan.low, plan.high, PAPER, plan.view)
    if plan.part:
        view.add_frame(*plan.part)
    view.make_room(plan.ways)
    words = view.add_arrow()
    if not (plan.part and plan.view in ("side", "front")):  # a strip is too thin for tubes
        view.add_tubes(plan.strongest)
    finish_view(view, overlay, BESIDE if plan.part else ALONE, words)
    if plan.part:
        _add_close_up(window, shot, overlay, plan, places[1])
    write_words(overlay, shot.title, shot.facts, size)
    draw_legend(overlay, shot.legend, size, plan.strongest)
    return window


def _places(plan: Plan, foot: float, head: float, label: float) -> list[Rectangle]:
    """Where the whole and its close-up go: side by side in wide pictures, else one below the other.

    `label` is the room that the words below a scale bar need: a close-up below the whole begins under them.
    """
    if plan.part is None:
        return [(0.01, foot, 0.99, head)]
    if plan.view in ("side", "front"):
        cut = foot + 0.66 * (head - foot)
        return [(0.01, cut + label, 0.99, head - 0.035), (0.015, foot + 0.005, 0.985, cut - 0.01)]
    if plan.size[0] < 1.25 * plan.size[1]:
        cut = foot + 0.5 * (head - foot)
        return [(0.01, cut + label, 0.99, head), (0.015, foot + 0.005, 0.985, cut - 0.01)]
    return [(0.01, foot, 0.56, head), (0.565, foot + 0.005, 0.985, head)]


def finish_view(view: View, overlay: Overlay, iso: tuple[float, float, float], arrow: str = "") -> None:
    """Scale bar, camera, and the words that belong to places of the scene."""
    place, words = view.add_scale_bar()
    view.aim(iso)
    x, y = view.on_picture(place)
    overlay.text(words, x - overlay.px(4), y - overlay.px(22), 24, align="center")
    if arrow and view.arrow_end is not None:
        x, y = view.on_picture(view.arrow_end)
        overlay.text(arrow, x, y + overlay.px(18), 24, ARROW, align="center", bold=True)


def _add_close_up(window: Any, shot: Shot, overlay: Overlay, plan: Plan, place: Rectangle) -> None:
    assert plan.part is not None
    low, high = (np.array([*corner, z]) for corner, z in zip(plan.part, (plan.low[2], plan.top), strict=True))
    inner = add_panel(window, overlay, plan.size, place, "close-up")
    view = View(window, shot, inner, low, high, PANEL, plan.view)
    view.add_tubes(plan.strongest)
    finish_view(view, overlay, CLOSE)


def add_panel(window: Any, overlay: Overlay, size: tuple[int, int], place: Rectangle, heading: str) -> Rectangle:
    """A framed panel with a heading; returns the place inside that is free for a view."""
    paint_panel(window, place, PANEL)
    x0, y0, x1, y1 = (value * size[i % 2] for i, value in enumerate(place))
    overlay.polygon(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]), SOFT_INK, outline=True)
    overlay.text(heading, x0 + overlay.px(16), y1 - overlay.px(24), 24, SOFT_INK)
    side, head, foot = overlay.px(6) / size[0], overlay.px(42) / size[1], overlay.px(SCALE_LABEL) / size[1]
    return place[0] + side, place[1] + foot, place[2] - side, place[3] - head


def write_words(overlay: Overlay, title: str, facts: str, size: tuple[int, int]) -> None:
    """Title and facts along the upper edge, smaller if they are too long."""
    left = overlay.px(32)
    room = size[0] - 2.0 * left
    if title:
        tall = overlay.fitting(title, 36, room, bold=True)
        overlay.text(title, left, size[1] - overlay.px(40), tall, INK, bold=True)
    overlay.text(facts, left, size[1] - overlay.px(88), overlay.fitting(facts, 26, room), SOFT_INK)
