"""Legend along the lower edge of a picture: states and their colours or a colour scale, and the key of the forces."""

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from thirdbody.palette import INK, field_colors
from thirdbody.render.coloring import Legend
from thirdbody.render.overlay import Overlay, rectangle
from thirdbody.units import prefix_for, ticks, with_unit

_LOWEST, _LEFT, _SPACE = 48.0, 32.0, 48.0
_STRIPS = 128


@dataclass(frozen=True)
class _Item:
    """Item of the legend: its width, and its drawing function at a position, all in pixels."""

    wide: float
    draw: Callable[[float, float], None]


def legend_height(overlay: Overlay, legend: Legend, full_scale: float = 0.0) -> float:
    """Return the height of the legend [pixels], including its distance to the lower edge."""
    rows = len(_rows(overlay, _items(overlay, legend, full_scale)))
    return overlay.px(_LOWEST + _pitch(legend) * (rows - 1) + 44.0)


def _pitch(legend: Legend) -> float:
    """Return the distance of two rows; a colour scale has numbers below it."""
    return 44.0 if legend.limits is None else 62.0


def draw_legend(overlay: Overlay, legend: Legend, full_scale: float = 0.0) -> None:
    """Draw the legend; `full_scale` [N] is the force of the thickest tube, 0 without tubes."""
    rows = _rows(overlay, _items(overlay, legend, full_scale))
    for number, row in enumerate(reversed(rows)):
        x, y = overlay.px(_LEFT), overlay.px(_LOWEST + _pitch(legend) * number)
        for item in row:
            item.draw(x, y)
            x += item.wide + overlay.px(_SPACE)


def _rows(overlay: Overlay, items: list[_Item]) -> list[list[_Item]]:
    rows: list[list[_Item]] = [[]]
    left = width = overlay.size[0] - 2.0 * overlay.px(_LEFT)
    for item in items:
        if rows[-1] and item.wide > left:
            rows.append([])
            left = width
        rows[-1].append(item)
        left -= item.wide + overlay.px(_SPACE)
    return rows


def _items(overlay: Overlay, legend: Legend, full_scale: float) -> list[_Item]:
    items = []
    if legend.limits is not None:
        items.append(_scale(overlay, legend, 0.32 * overlay.size[0]))
    elif legend.title and legend.entries:
        items.append(_words(overlay, legend.title))
    items += [_state(overlay, words, color, legend.total) for words, color in legend.entries]
    if full_scale > 0.0:
        items.append(_force_key(overlay, full_scale))
    return items


def _words(overlay: Overlay, words: str) -> _Item:
    def draw(x: float, y: float) -> None:
        overlay.text(words, x, y, 28)

    return _Item(overlay.width_of(words, 28), draw)


def _state(overlay: Overlay, words: str, color: str, total: int) -> _Item:
    # As wide as the largest count, so that nothing moves in a film when a count gains a digit.
    widest = re.sub(r"  \d+  \(\d+ %\)$", f"  {'0' * len(str(total))}  (00 %)", words)

    def draw(x: float, y: float) -> None:
        overlay.disc(x + overlay.px(13), y, overlay.px(13), color)
        overlay.text(words, x + overlay.px(36), y, 28)

    return _Item(overlay.px(36) + overlay.width_of(widest, 28), draw)


def _scale(overlay: Overlay, legend: Legend, wide: float) -> _Item:
    """Return a colour bar with round numbers below it."""
    assert legend.limits is not None
    low, high = legend.limits
    factor, unit = prefix_for(max(abs(low), abs(high)), legend.unit)
    title = legend.title + (f", {unit}" if unit else "")
    before = overlay.width_of(title, 28) + overlay.px(36)

    def draw(x: float, y: float) -> None:
        overlay.text(title, x, y, 28)
        left, tall, middle = x + before, overlay.px(12), y + overlay.px(10)
        edges = np.linspace(left, left + wide, _STRIPS + 1)
        strips = np.array([rectangle(a, middle - tall, b, middle + tall) for a, b in zip(edges, edges[1:], strict=False)])
        overlay.polygons(strips, field_colors((np.arange(_STRIPS) + 0.5) / _STRIPS))
        for value in ticks(low * factor, high * factor):
            fraction = (value - low * factor) / ((high - low) * factor) if high > low else 0.5
            x, foot, half = left + fraction * wide, middle - tall, overlay.px(1.2)
            overlay.polygon(rectangle(x - half, foot - overlay.px(7), x + half, foot), INK)
            overlay.text(f"{value:.6g}", x, foot - overlay.px(20), 24, align="center")

    return _Item(before + wide, draw)


def _force_key(overlay: Overlay, full_scale: float) -> _Item:
    """Return a wedge from zero to the largest force: in perspective no single thickness could be shown."""
    words, largest = "contact force  0", with_unit(full_scale, "N")
    before, wedge = overlay.width_of(words, 28) + overlay.px(14), overlay.px(120)

    def draw(x: float, y: float) -> None:
        overlay.text(words, x, y, 28)
        a, b, tall = x + before, x + before + wedge, overlay.px(10)
        overlay.polygon(np.array([[a, y], [b, y - tall], [b, y + tall]]), INK)
        overlay.text(largest, b + overlay.px(14), y, 28)

    return _Item(before + wedge + overlay.px(14) + overlay.width_of(largest, 28), draw)
