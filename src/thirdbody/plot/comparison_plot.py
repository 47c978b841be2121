"""Picture of runs that are compared: friction, states, gap, load, and labels that differ, curves of all runs over each other."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from thirdbody.errors import InputError
from thirdbody.palette import INK, LINE_COLORS, state_colors
from thirdbody.units import quantity_text, unit_for

WIDTH, HEIGHT, LINE = 8.27, 1.9, 0.2  # of the picture, of a panel, of a line of the legend [inch]
COLORS = [LINE_COLORS[name] for name in ("blue", "vermilion", "green", "purple", "orange", "sky", "black")]
MARKERS = "osD^"
STYLES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.3)), (0, (6, 2, 1, 2)))
STATES, LABELS = "states", "labels"
PANELS = ("friction_coefficient", STATES, "gap", "load", LABELS)
UNITS = {"friction_coefficient": "", "gap": "m", "load": "N"}
SMALL = 0.05  # gaps and loads that differ by less than this part of their mean are drawn as changes
FRACTION = "fraction_"


def draw_comparison(report: Mapping[str, Any]) -> Figure:
    """Return the picture of the result of `compare`: a colour and a style for each run, with states the style alone."""
    rows, axis = report["runs"], report["axis"]
    series = [{name: np.asarray(values, float) for name, values in row["series"].items()} for row in rows]
    styles = [{"color": COLORS[k % len(COLORS)], "linestyle": STYLES[k % len(STYLES)]} for k in range(len(rows))]
    scale, unit = unit_for(np.concatenate([run[axis] for run in series]), "m" if axis == "distance" else "s")
    drawn = {name: [(run[axis] / scale, run[name], style) for run, style in zip(series, styles, strict=True) if name in run]
             for name in dict.fromkeys(name for run in series for name in run if name != axis)}  # fmt: skip
    drawn |= {LABELS: [(np.asarray(row["labels"][axis]) / scale, np.asarray(row["labels"]["difference"]), style)
                         for row, style in zip(rows, styles, strict=True) if "labels" in row]}  # fmt: skip
    drawn = {name: curves for name, curves in drawn.items() if any(np.isfinite(values).any() for _, values, _ in curves)}
    names = dict.fromkeys(name for row in rows for name in row["results"] if name.startswith(FRACTION))
    states = {name: drawn[name] for name in names if any(np.any(values > 0.0) for _, values, _ in drawn.get(name, ()))}
    panels = [name for name in PANELS if (states if name == STATES else name in drawn)]
    if not panels:
        raise InputError("nothing to draw: these runs have no friction, states, gap or load")
    figure = Figure(figsize=(WIDTH, HEIGHT * len(panels) + LINE * (len(rows) + 2)), layout="constrained")
    for axes, name in zip(figure.subplots(len(panels), squeeze=False, sharex=True)[:, 0], panels, strict=True):
        axes.set_label(name)
        if name in UNITS:
            _draw_series(axes, name, drawn[name])
        elif name == LABELS:
            _draw_fractions(axes, "Labels that differ from those of 1", {LABELS: drawn[LABELS]})
        else:
            _draw_fractions(axes, "States of the bodies", states)
        axes.grid(axis="y", alpha=0.25, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.margins(x=0.0)
        axes.set_xlabel(f"{'sliding distance' if axis == 'distance' else axis} ({unit})" if name == panels[-1] else "")
    titles = [f"{k}: {row['name']}" for k, row in enumerate(rows, 1)]
    figure.legend([Line2D([], [], **style) for style in styles], titles, loc="outside upper left", frameon=False)
    return figure


Curve = tuple[np.ndarray, np.ndarray, dict[str, Any]]


def _draw_series(axes: Axes, name: str, curves: Sequence[Curve]) -> None:
    words, values = name.replace("_", " "), np.concatenate([values for _, values, _ in curves])
    title, base, scale, unit = words.capitalize(), 0.0, 1.0, UNITS[name]
    if unit:
        known = values[np.isfinite(values)]
        if np.ptp(known) < SMALL * abs(np.mean(known)):
            base = float(known[0])
            title += f": change from {quantity_text(base, unit, 4)}"
        scale, unit = unit_for(values - base, unit)
    for x, part, style in curves:
        axes.plot(x, (part - base) / scale, linewidth=1.4, **style)
    _describe(axes, title, f"{words} ({unit})" if unit else words)
    axes.ticklabel_format(axis="y", useOffset=False)


def _draw_fractions(axes: Axes, title: str, groups: Mapping[str, Sequence[Curve]]) -> None:
    """Draw fractions of the bodies: those in a state in its colour, those of labels that differ at the common stops alone."""
    names = [name.removeprefix(FRACTION) for name in groups]
    for name, color, curves in zip(names, state_colors(names), groups.values(), strict=True):
        for x, values, style in curves:
            marks = {"linestyle": "none", "marker": MARKERS[STYLES.index(style["linestyle"])]}
            own = {"color": color} if name != LABELS else marks
            axes.plot(x, 100.0 * values, linewidth=1.4, markersize=3.5, clip_on=name != LABELS, **style | own)
        if name != LABELS:
            axes.plot([], [], color=color, label=name)
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, handlelength=1.2)
    _describe(axes, title, "bodies (%)")
    axes.set_ylim(bottom=0.0)


def _describe(axes: Axes, title: str, ordinate: str) -> None:
    axes.set_title(title, loc="left", fontsize=10.0, fontweight="bold", color=INK)
    axes.set_ylabel(ordinate)
