"""Picture of the robustness cases: residual of the energy balance, and largest stable time step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody.errors import InputError, UsageError
from thirdbody.palette import LINE_COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FORMATS = (".png", ".pdf", ".svg")
LEVELS = {  # colour and marker, distinguishable without colours too
    "coulomb": (LINE_COLORS["orange"], "s"),
    "mindlin": (LINE_COLORS["blue"], "o"),
    "mdr": (LINE_COLORS["green"], "^"),
    "exact": (LINE_COLORS["purple"], "D"),
}
INK, SOFT = "#222222", "#5A626C"
WIDTH, ROW, MARGIN_HEIGHT = 7.2, 0.25, 1.45
"""Of the figure [inch]: width of a page's text, height of a row, height of everything except the rows."""
NOTHING = 1e-16
"""Smaller residuals are drawn at this value: free rotation has none."""
LEVEL_DISTANCE = 0.17
"""Distance of the levels of one row, whose height is 1."""
TICKS = (1, 1.5, 2, 3, 5, 7, 10, 15)
BROKEN = LINE_COLORS["vermilion"]


def check_format(path: Path) -> None:
    """Raise UsageError for a picture whose suffix is not in FORMATS."""
    if path.suffix.lower() not in FORMATS:
        raise UsageError(f"{path}: a picture ends in {', '.join(FORMATS)}")


def draw_stability(rows: Sequence[dict[str, Any]], path: Path, range_: tuple[float, float]) -> None:
    """Write the picture; the suffix selects the format.

    `rows` as `thirdbody hard --json` prints them, `range_` of sound factors. Raises UsageError for another suffix, InputError
    without rows, OutputError if the file cannot be written.
    """
    from thirdbody.plot.summary_page import save

    check_format(path)
    save(picture(rows, range_), path)


def picture(rows: Sequence[dict[str, Any]], range_: tuple[float, float]) -> Figure:
    """Return the picture as a matplotlib figure. Raises InputError without rows."""
    from matplotlib.figure import Figure

    if not rows:
        raise InputError("nothing to draw: no case was run")
    cases = list(dict.fromkeys(row["case"] for row in rows))
    figure = Figure(figsize=(WIDTH, MARGIN_HEIGHT + ROW * max(len(cases), 3)), layout="constrained")
    energy, step = figure.subplots(1, 2, sharey=True, gridspec_kw={"width_ratios": (1.15, 1.0)})
    _frame(energy, step, cases)
    _energies(energy, rows, cases)
    _steps(step, rows, cases, range_)
    _legend(figure, rows)
    return figure


def _frame(energy: Axes, step: Axes, cases: list[str]) -> None:
    energy.set_yticks(range(len(cases)), [case.replace("_", " ") for case in cases], fontsize=8, color=INK)
    energy.set_ylim(len(cases) - 0.4, -0.6)
    for axes in (energy, step):
        axes.set_xscale("log")
        axes.tick_params(labelsize=8, length=0, axis="y")
        axes.tick_params(labelsize=8, axis="x")
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.grid(True, axis="x", which="major", color="#D5D9DE", linewidth=0.6)
        for k in range(0, len(cases), 2):
            axes.axhspan(k - 0.5, k + 0.5, color="#F3F4F6", zorder=0, linewidth=0)
        axes.set_axisbelow(True)
    energy.set_xlabel("energy residual with the automatic step", fontsize=8.5)
    step.set_xlabel("largest stable step over the automatic one", fontsize=8.5)


def _height_of(row: dict[str, Any], cases: list[str]) -> float:
    levels = list(LEVELS)
    level = levels.index(row["level"]) if row["level"] in levels else 0
    return cases.index(row["case"]) + LEVEL_DISTANCE * (level - 1.5)


def _energies(axes: Axes, rows: Sequence[dict[str, Any]], cases: list[str]) -> None:
    for row in rows:
        color, marker = LEVELS.get(row["level"], (INK, "o"))
        filled = color if row["integrator"] == "explicit" else "white"
        known = math.isfinite(row["residual"])  # cases that are only refused, or with prescribed motion, have none
        residual = max(row["residual"], NOTHING) if known else NOTHING
        axes.plot(residual, _height_of(row, cases), marker if known else "", color=color, markerfacecolor=filled, markersize=4.5,
                  markeredgewidth=1.0, clip_on=False, zorder=3)  # fmt: skip
        if not row["holds"]:
            axes.plot(residual, _height_of(row, cases), "x", color=BROKEN, markersize=9, markeredgewidth=1.6,
                      zorder=4)  # fmt: skip
    axes.set_xlim(0.5 * NOTHING, 1.0)
    axes.axvline(0.1, color=INK, linewidth=1.0, linestyle="--")
    axes.annotate("guard", (0.1, -0.6), xytext=(0, 2), textcoords="offset points", fontsize=7.5, color=INK, ha="center")


def _steps(axes: Axes, rows: Sequence[dict[str, Any]], cases: list[str], range_: tuple[float, float]) -> None:
    axes.axvspan(*range_, color=LINE_COLORS["sky"], alpha=0.18, linewidth=0, zorder=1)
    for row in rows:
        if row["factor"] is None:
            continue
        color, marker = LEVELS.get(row["level"], (INK, "o"))
        y = _height_of(row, cases)
        if row["factor"] > 1.0:
            axes.plot([1.0, row["factor"]], [y, y], color=color, linewidth=1.0, zorder=2)
        axes.plot(max(row["factor"], 1.0), y, marker, color=color, markersize=4.5, zorder=3)
    for k, case in enumerate(cases):
        if all(row["factor"] is None for row in rows if row["case"] == case):
            axes.annotate("no limit sought", (1.03, k), fontsize=7.5, color=SOFT, va="center")
    axes.set_xlim(0.95, 17.0)
    axes.set_xticks(TICKS, [f"{tick:g}" for tick in TICKS])
    axes.minorticks_off()


def _legend(figure: Figure, rows: Sequence[dict[str, Any]]) -> None:
    from matplotlib.lines import Line2D

    there = {row["level"] for row in rows}
    marks = [
        Line2D([], [], color=color, marker=marker, linestyle="", markersize=5, label=level)
        for level, (color, marker) in LEVELS.items()
        if level in there
    ]
    marks += [
        Line2D([], [], color=SOFT, marker="o", linestyle="", markersize=5, label="explicit"),
        Line2D([], [], color=SOFT, marker="o", markerfacecolor="white", linestyle="", markersize=5, label="implicit"),
    ]
    if not all(row["holds"] for row in rows):
        marks.append(Line2D([], [], color=BROKEN, marker="x", linestyle="", markersize=7, markeredgewidth=1.6, label="fails"))
    figure.legend(handles=marks, loc="outside upper center", ncols=len(marks), fontsize=8, frameon=False, handletextpad=0.2,
                  columnspacing=1.2)  # fmt: skip
