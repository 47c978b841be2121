"""The picture of a study of cost: error over seconds, the front of the rungs that nothing beats, the scene's own one marked."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody.output.palette import LINE_COLORS

from .cost import Row, Study, efficient, figure_of_merit, recommended

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXES = {  # axis of the ladder: label, colour, marker; shapes tell them apart without colours
    "law": ("contact law and springs", LINE_COLORS["blue"], "o"),
    "step": ("step of the integrator", LINE_COLORS["vermilion"], "s"),
    "integrator": ("the other integrator", LINE_COLORS["green"], "D"),
    "fine": ("step with the finest law", LINE_COLORS["purple"], "^"),
}
INK, SOFT = "#222222", "#5A626C"
NOTHING = 1e-12
"""Errors below it are drawn there: a rung that gives the same bits has none."""


def draw_study(made: Study, path: Path) -> None:
    """Write the picture (.png, .pdf or .svg). Raises OutputError when it cannot be written."""
    from thirdbody.output.plot import save

    save(picture(made), path)


def picture(made: Study) -> Figure:
    """The picture as a figure of matplotlib."""
    from matplotlib.figure import Figure

    merit = figure_of_merit(made)
    figure = Figure(figsize=(8.27, 6.0), layout="constrained")
    axes = figure.add_subplot()
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(True, which="major", alpha=0.25, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    rows = [row for row in made.rows if row.stable and row.rung.axis in AXES and math.isfinite(row.errors[merit])]
    _points(axes, rows, merit)
    _front(axes, efficient(made), merit)
    _marks(axes, made, merit)
    axes.margins(x=0.12)  # room for names
    _names(axes, rows, merit)
    what = "friction curve" if merit == "friction_error" else "load or gap"
    axes.set_xlabel("seconds of one core for the integration, median of the repeats (bar: their range)", fontsize=9)
    axes.set_ylabel(f"error of the {what} (rms over the mean)", fontsize=9)
    axes.tick_params(labelsize=8)
    _texts(figure, axes, made)
    return figure


def _points(axes: Any, rows: list[Row], merit: str) -> None:
    for axis, (label, color, marker) in AXES.items():
        here = [row for row in rows if row.rung.axis == axis]
        if not here:
            continue
        x, y = [row.seconds for row in here], [_height(row, merit) for row in here]
        spread = [[row.seconds - min(row.cpu) for row in here], [max(row.cpu) - row.seconds for row in here]]
        axes.errorbar(x, y, xerr=spread, fmt=marker, color=color, markersize=6.5, elinewidth=1.0, capsize=2.0, label=label,
                      markeredgecolor="white", markeredgewidth=0.6, zorder=3)  # fmt: skip


def _front(axes: Any, rows: list[Row], merit: str) -> None:
    axes.plot([row.seconds for row in rows], [_height(row, merit) for row in rows], color=INK, linewidth=1.2, linestyle="--",
              zorder=2, label="efficient front")  # fmt: skip


def _marks(axes: Any, made: Study, merit: str) -> None:
    default, best = made.default, recommended(made)[0]
    for row, color, size, label in (
        (default, LINE_COLORS["black"], 15.0, "as the scene asks"), (best, LINE_COLORS["orange"], 20.0, "recommended"),
    ):  # fmt: skip
        if row is not None and row.stable and not row.rung.reference:
            axes.plot(row.seconds, _height(row, merit), "o", markersize=size, markerfacecolor="none", markeredgecolor=color,
                      markeredgewidth=1.6, label=label, zorder=4)  # fmt: skip
    reference = made.reference
    axes.axvline(reference.seconds, color=SOFT, linewidth=1.0, linestyle=":", zorder=1,
                 label=f"time of the reference ({reference.rung.name})")  # fmt: skip
    laws = [row for row in made.rows if row.rung.axis == "law" and row.stable and row is not reference]
    if laws and laws[-1].errors[merit] > 0.0:
        axes.axhline(laws[-1].errors[merit], color=SOFT, linewidth=1.0, linestyle="-.", zorder=1,
                     label=f"{laws[-1].rung.name}: what the step alone changes")  # fmt: skip


def _names(axes: Any, rows: list[Row], merit: str) -> None:
    """A name beside each point, moved up or down until it is off the names and points before it."""
    axes.figure.canvas.draw()
    boxes: list[tuple[float, float, float, float]] = []
    place = axes.transData.transform
    dots = [place((row.seconds, _height(row, merit))) for row in rows]
    scale = axes.figure.dpi / 72.0
    own = next((row.rung.name.split(",")[0] for row in rows if row.rung.axis != "law"), "")
    for row, (x, y) in sorted(zip(rows, dots, strict=True), key=lambda pair: pair[1][0]):
        text = row.rung.name.removeprefix(f"{own}, ")
        width, height = 5.2 * len(text) * scale, 9.5 * scale
        for dx, dy in _AROUND:
            left = x + dx * scale - (width if dx < 0 else 0.0)
            box = (left, y + dy * scale - 0.5 * height, left + width, y + dy * scale + 0.5 * height)
            over = any(box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in boxes)
            hidden = any(box[0] - 3 < px < box[2] + 3 and box[1] - 3 < py < box[3] + 3 for px, py in dots if (px, py) != (x, y))
            if not over and not hidden:
                break
        boxes.append(box)
        far = abs(dy) > 12.0
        axes.annotate(text, (row.seconds, _height(row, merit)), xytext=(dx, dy), textcoords="offset points", fontsize=7.0,
                      va="center", ha="left" if dx > 0 else "right", color=INK, zorder=5,
                      arrowprops={"arrowstyle": "-", "color": SOFT, "linewidth": 0.5} if far else None)  # fmt: skip


_AROUND = [(dx, sign * dy) for dy in (9, 18, 27, 36, 48, 60) for sign in (1, -1) for dx in (3, -3)]
"""Offsets of a name from its point, in points, the nearest first."""


def _texts(figure: Any, axes: Any, made: Study) -> None:
    told = made.machine
    failed = [f"{row.rung.name} ({row.message.split(':')[0][:60]})" for row in made.rows if not row.stable]
    lines = [
        f"Recommended: {recommended(made)[1].replace('`', '')}.",
        f"Computed: {'; '.join(made.reduction) or 'the whole scene'}; {told['cpu']}, one of {told['cores']} cores.",
        *([f"Not shown, failed or stopped: {', '.join(failed)}."] if failed else []),
    ]
    text = "\n".join(line for text in lines for line in textwrap.wrap(text, 118))
    figure.suptitle(f"What accuracy costs: {made.title or made.scene}", fontsize=12, fontweight="bold", x=0.01, ha="left",
                    color=INK)  # fmt: skip
    axes.set_title(text, loc="left", fontsize=8, color=SOFT)
    figure.legend(fontsize=8, frameon=False, loc="outside lower left", ncols=3, markerscale=0.6)


def _height(row: Row, merit: str) -> float:
    return max(row.errors[merit], NOTHING)
