"""Picture of a study of effects: what each costs, in pairs of runs, beside what it changes."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody.palette import INK, LINE_COLORS, SOFT_INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CHANGES = {  # in `studies.compare.errors`: label, colour, marker
    "friction_error": ("friction (rms)", LINE_COLORS["blue"], "o"),
    "load_error": ("load or gap (rms)", LINE_COLORS["sky"], "P"),
    "label_difference": ("labels that differ", LINE_COLORS["vermilion"], "s"),
    "dissipation_error": ("dissipated energy", LINE_COLORS["green"], "D"),
}
ON, OFF = LINE_COLORS["black"], LINE_COLORS["purple"]
"""Colours of times: of what the scene names, and of what it does not."""

NOTHING = 1e-6
"""Smaller changes are drawn at this value, at the edge."""


def draw_effects(report: dict[str, Any], *paths: Path) -> None:
    """Write the picture of the result of `effects_study` (.png, .pdf or .svg). Raises OutputError when it cannot be written."""
    from thirdbody.plot.summary_page import save

    figure = picture(report)
    for path in paths:
        save(figure, path)


def with_over_without(row: dict[str, Any]) -> list[float]:
    """Return the time with the effect over that without it, pair by pair: the ratios of a row, or their inverses."""
    return [1.0 / ratio if row.get("named") else ratio for ratio in row["ratios"]]


def picture(report: dict[str, Any]) -> Figure:
    """Return the picture as a matplotlib figure: one line per effect or measure, the most expensive first."""
    from matplotlib.figure import Figure

    rows = [row for row in report["effects"] if "ratio" in row]
    rows.sort(key=lambda row: ("named" in row, _median(with_over_without(row))))  # from below; the first: starts a little apart
    figure = Figure(figsize=(8.27, 2.1 + 0.34 * len(rows)), layout="constrained")
    time, change = figure.subplots(1, 2, sharey=True)
    for axes in (time, change):
        axes.grid(True, axis="x", alpha=0.25, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
    _times(time, rows)
    _changes(change, rows)
    time.set_yticks(range(len(rows)), [f"{row['effect'].replace('_', ' ')}{_words(row)}" for row in rows])
    time.set_ylim(-0.6, len(rows) - 0.4)
    _texts(figure, time, report, rows)
    return figure


def _words(row: dict[str, Any]) -> str:
    """Return whether the scene has it."""
    if "named" not in row:
        return " (scene twice)"
    return " (in the scene)" if row["named"] else " (tried)"


def _median(values: list[float]) -> float:
    import statistics

    return statistics.median(values)


def _times(axes: Any, rows: list[dict[str, Any]]) -> None:
    axes.axvline(1.0, color=SOFT_INK, linewidth=1.0, linestyle="-.", zorder=1)
    for y, row in enumerate(rows):
        ratios = with_over_without(row)
        color = ON if row.get("named", True) else OFF
        axes.plot(ratios, [y] * len(ratios), "|", color=color, markersize=7.0, alpha=0.6, zorder=2)
        middle = _median(ratios)
        axes.plot([middle], [y], "o", color=color, markersize=5.5, zorder=3)
        axes.annotate(f"{middle:.2f}", (middle, y), xytext=(0, 6), textcoords="offset points", ha="center", fontsize=7, color=INK)
    axes.set_xscale("log")
    axes.margins(x=0.1)
    low, high = axes.get_xlim()
    ticks = [
        step * 10.0**power for power in range(-3, 4) for step in ((1, 2, 5) if high / low > 4.0 else (0.8, 1, 1.2, 1.5, 2, 3, 5))
    ]
    axes.set_xticks([tick for tick in ticks if low <= tick <= high])
    axes.xaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    axes.set_xlabel("time with it over time without, pairs", fontsize=9)


def _changes(axes: Any, rows: list[dict[str, Any]]) -> None:
    for name, (label, color, marker) in CHANGES.items():
        known = [(row["change"][name], y) for y, row in enumerate(rows) if not math.isnan(row["change"][name])]
        if known:
            values, heights = zip(*known, strict=True)
            axes.plot([max(value, NOTHING) for value in values], heights, marker, color=color, markersize=6.0, label=label,
                      markeredgecolor="white", markeredgewidth=0.6, linestyle="none", clip_on=False, zorder=3)  # fmt: skip
    axes.set_xscale("log")
    axes.set_xlim(left=NOTHING)
    axes.set_xlabel(f"relative change ({NOTHING:g} and less at the edge)", fontsize=9)


def _texts(figure: Any, axes: Any, report: dict[str, Any], rows: list[dict[str, Any]]) -> None:
    machine = report["machine"]
    seconds = _median([row["seconds"][0] for row in rows]) if rows else math.nan
    failed = [f"{row['effect']} ({row['message'].splitlines()[0]})" for row in report["effects"] if "ratio" not in row]
    lines = [
        f"Computed: {'; '.join(report['reduction']) or 'the whole scene'}; {seconds:.2g} s of one core, {machine['cpu']}.",
        *(f"Failed: {textwrap.shorten(words, 130, placeholder=' ...')}" for words in failed),
    ]
    figure.suptitle(f"What effects cost and change: {report['title'] or report['scene']}", fontsize=12, fontweight="bold", x=0.01,
                    ha="left", color=INK)  # fmt: skip
    text = "\n".join(line for one in lines for line in textwrap.wrap(one, 90))
    axes.set_title(text, loc="left", fontsize=8, color=SOFT_INK)
    figure.legend(fontsize=8, frameon=False, loc="outside lower right", ncols=4)
