"""Picture of a study of cost: error over seconds, the Pareto front of the variants, the scene's own one marked."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from thirdbody.palette import INK, LINE_COLORS, SOFT_INK
from thirdbody.studies.cost import Row, Study, efficient, figure_of_merit, percent, recommended
from thirdbody.studies.cost_report import reference_error, scatter_words, speed_words, stopped
from thirdbody.studies.timing import described

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXES = {  # axis of the study: label, colour, marker; shapes distinguish them without colours
    "law": ("contact law and springs", LINE_COLORS["blue"], "o"),
    "step": ("step of the integrator", LINE_COLORS["vermilion"], "s"),
    "integrator": ("the other integrator", LINE_COLORS["green"], "D"),
    "speed": ("speed of the plate", LINE_COLORS["sky"], "P"),
    "fine": ("step with the finest law", LINE_COLORS["purple"], "^"),
    "meeting": ("bodies that do not meet", LINE_COLORS["black"], "X"),
}
NOTHING = 1e-12  # smaller errors are drawn at this value: a variant with identical bits has none


def picture_of_study(built: Study) -> Figure:
    """Return the picture as a matplotlib figure."""
    from matplotlib.figure import Figure

    merit = figure_of_merit(built)
    figure = Figure(figsize=(8.27, 6.0), layout="constrained")
    axes = figure.add_subplot()
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(True, which="major", alpha=0.25, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    points = _points(built, merit)
    for axis, (label, color, marker) in AXES.items():
        here = [row for row in points if row.variant.axis == axis and row is not built.reference]
        if here:
            axes.errorbar(*zip(*(points[row] for row in here), strict=True), xerr=_error_bars(here), fmt=marker, color=color,
                          markersize=6.5, elinewidth=1.0, capsize=2.0, label=label, markeredgecolor="white", markeredgewidth=0.6,
                          zorder=3)  # fmt: skip
    front = [row for row in efficient(built) if row in points]
    # steps: between two variants more time gains nothing until it suffices for the next one
    axes.plot(*zip(*(points[row] for row in front), strict=True), color=INK, linewidth=1.2, linestyle="--",
              drawstyle="steps-post", zorder=2, label="efficient front, to the reference")  # fmt: skip
    ringed = _marks(axes, built, points, merit)
    axes.margins(x=0.15, y=0.08)  # room for names
    _names(axes, points, front, ringed)
    what = {"friction_error": "friction curve", "mean_friction_error": "mean friction", "load_error": "load or gap"}[merit]
    how = "relative" if merit == "mean_friction_error" else "rms over the mean"
    axes.set_xlabel("seconds of one core for the integration (bar: how far the median may be off; bars that overlap are ties)",
                    fontsize=9)  # fmt: skip
    axes.set_ylabel(f"error of the {what} ({how})", fontsize=9)
    axes.tick_params(which="both", labelsize=8)
    _texts(figure, axes, built)
    return figure


def _points(built: Study, merit: str) -> dict[Row, tuple[float, float]]:
    """Return seconds and error of the variants shown.

    The reference is drawn at its estimated error, never above the end of the front, or below all others.
    """
    rows = [row for row in built.rows if row.stable and row.variant.axis in AXES and row is not built.reference]
    shown = {row: (row.seconds, max(row.errors[merit], NOTHING)) for row in rows if math.isfinite(row.errors[merit])}
    own, minimum = reference_error(built), min((height for _, height in shown.values() if height > NOTHING), default=1.0)
    return shown | {built.reference: (built.reference.seconds, minimum / 3.0 if math.isnan(own) else min(own, minimum))}


def _error_bars(rows: list[Row]) -> list[list[float]]:
    halves = [min(row.timing.half, 0.9 * row.seconds) for row in rows]  # the axis is logarithmic: no zero
    return [halves, halves]


def _marks(axes: Any, built: Study, points: dict[Row, tuple[float, float]], merit: str) -> set[Row]:
    """Draw rings, the reference and the line of the steps' effect; return the rows with a ring."""
    default, best, reference = built.default, recommended(built)[0], built.reference
    ringed = set()
    for row, color, size, label in (
        (default, LINE_COLORS["black"], 15.0, "as in the scene"), (best, LINE_COLORS["orange"], 20.0, "recommended"),
    ):  # fmt: skip
        if row is not None and row.stable and not row.variant.reference:
            axes.plot(*points[row], "o", markersize=size, markerfacecolor="none", markeredgecolor=color,
                      markeredgewidth=1.6, label=label, zorder=4)  # fmt: skip
            ringed.add(row)
    apart, lowest = built.scatter.get(merit, 0.0), min(y for _, y in points.values())
    if apart > 0.1 * lowest:  # far below all errors words suffice
        label = "runs from starts 1e-9 apart differ by this"
        axes.axhspan(0.0, apart, color=SOFT_INK, alpha=0.15, linewidth=0.0, zorder=0, label=label)
    x, y = points[reference]
    own = reference_error(built)
    unknown = math.isnan(own)
    label = "reference (its error is 0 by definition)" if unknown else f"reference (its own error: about {percent(own)})"
    marker, size = ("v", 7.0) if unknown else ("*", 10.0)
    axes.errorbar([x], [y], xerr=_error_bars([reference]), fmt=marker, color=INK, markersize=size, markerfacecolor="white",
                  elinewidth=1.0, capsize=2.0, label=label, zorder=3)  # fmt: skip
    laws = [row for row in built.rows if row.variant.axis == "law" and row.stable and row is not reference]
    if laws and laws[-1].errors[merit] > 0.0:
        axes.axhline(laws[-1].errors[merit], color=SOFT_INK, linewidth=1.0, linestyle="-.", zorder=1,
                     label=f"{laws[-1].variant.name}: what the step alone changes")  # fmt: skip
    return ringed


Box = tuple[float, float, float, float]  # left, bottom, right and top of an item of the picture, in its pixels


def _names(axes: Any, points: dict[Row, tuple[float, float]], front: list[Row], ringed: set[Row]) -> None:
    """Draw a name near each point, where it covers the least: other names and points first, then the front."""
    from matplotlib.patheffects import withStroke

    axes.figure.canvas.draw()
    scale = axes.figure.dpi / 72.0
    dots = {row: axes.transData.transform(point) for row, point in points.items()}
    occupied: list[Box] = []
    steps, inside = _steps([dots[row] for row in front]), axes.bbox.extents
    own = next((row.variant.name.split(",")[0] for row in points if row.variant.axis != "law"), "")
    for row in sorted(points, key=lambda row: dots[row][0]):
        text, (x, y) = row.variant.name.removeprefix(f"{own}, "), dots[row]
        width, height = 3.9 * len(text) * scale, 9.5 * scale
        off = 9.0 if row in ringed else 0.0  # outside the ring
        others = [(px - r, py - r, px + r, py + r) for key, (px, py) in dots.items() if key != row
                  for r in (scale * (10.5 if key in ringed else 1.5),)]  # fmt: skip
        result: list[tuple[float, Box, tuple[float, float]]] = []
        for dx, dy in ((dx + math.copysign(off, dx), dy + math.copysign(0.5 * off, dy)) for dx, dy in _AROUND):
            left, middle = x + dx * scale - (width if dx < 0 else 0.0), y + dy * scale
            box = (left, middle - 0.5 * height, left + width, middle + 0.5 * height)
            out = box[0] < inside[0] or box[2] > inside[2] or box[1] < inside[1] or box[3] > inside[3]
            hidden = sum(_boxes_overlap(box, other) for other in [*occupied, *others]) + out
            crossed = any(_boxes_overlap(box, step) for step in steps)
            away = 0.1 * math.hypot(dx, dy) + 0.8 * (dx < 0) + 0.4 * (dy < 0)  # prefer above and to the right
            result.append((10.0 * hidden + 1.5 * crossed + away, box, (dx, dy)))
        _, box, shift = min(result)
        occupied.append(box)
        distant = max(abs(shift[0]) - 6.0, abs(shift[1])) > 12.0 + off
        axes.annotate(text, points[row], xytext=shift, textcoords="offset points", fontsize=7.0, va="center",
                      ha="left" if shift[0] > 0 else "right", color=INK, zorder=5,
                      path_effects=[withStroke(linewidth=2.0, foreground="white")],
                      arrowprops={"arrowstyle": "-", "color": SOFT_INK, "linewidth": 0.5} if distant else None)  # fmt: skip


def _steps(points: list[Any]) -> list[Box]:
    pairs = list(zip(points, points[1:], strict=False))
    level = [(a[0], a[1], b[0], a[1]) for a, b in pairs]
    return level + [(b[0], min(a[1], b[1]), b[0], max(a[1], b[1])) for a, b in pairs]


def _boxes_overlap(a: Box, b: Box) -> bool:
    return a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3]


_AROUND = [
    (dx, side * dy) for distant in (3, 45, 90) for dy in (9, 18, 27, 36, 48) for side in (1, -1) for dx in (distant, -distant)
]
"""Offsets of a name from its point [points]."""


def _texts(figure: Any, axes: Any, built: Study) -> None:
    report, failed = built.machine, []
    for message, names in stopped(built).items():  # without the time at which a run stopped
        reason = message.partition(": ")[2] if message.startswith("stopped at") and ": " in message else message
        failed.append(f"{'; '.join(names)} ({textwrap.shorten(reason.split(',')[0], 80, placeholder=' ...')})")
    lines = [
        f"Recommended: {recommended(built)[1].replace('`', '')}.",
        f"Computed: {'; '.join(built.reduction) or 'the whole scene'}; {described(report)}, one of {report['cores']} cores.",
        *(words[0].upper() + words[1:] + "." for words in (scatter_words(built), speed_words(built)) if words),
        *([f"Not shown: {'. '.join(failed)}."] if failed else []),
    ]
    add_texts(figure, axes, f"What accuracy costs: {built.title or built.scene}", lines, 118)
    figure.legend(fontsize=8, frameon=False, loc="outside lower left", ncols=3, markerscale=0.6)


def add_texts(figure: Any, axes: Any, title: str, lines: Iterable[str], width: int) -> None:
    """Write the title of a picture, and lines below it, each wrapped to so many letters."""
    figure.suptitle(title, fontsize=12, fontweight="bold", x=0.01, ha="left", color=INK)
    text = "\n".join(line for text in lines for line in textwrap.wrap(text, width))
    axes.set_title(text, loc="left", fontsize=8, color=SOFT_INK)
