"""Pictures of studies: a sweep as curves over one axis with error bars, or maps over two; of cost, error over seconds."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.errors import InputError, UsageError, nearest
from thirdbody.palette import INK, LINE_COLORS, SOFT_INK, STATE_COLORS
from thirdbody.plot.figures import check_format, save
from thirdbody.studies.cost import Row, Study, efficient, figure_of_merit, recommended
from thirdbody.studies.cost_report import advice, reference_error
from thirdbody.studies.folder import Average, SweepTable, average
from thirdbody.studies.results import EVER, FRACTION, RESULTS
from thirdbody.units import prefix_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CURVES = 6  # largest number of values of a second axis that are drawn as curves; more are a map
WIDTH, ALONE = 8.0, 6.0  # width of a picture, and of one with a single panel [inch]: 8 points are 11 of 800 pixels
HEIGHT, PER_ROW = 3.1, 2  # height of a panel [inch], and largest number of them side by side
LINE = 0.17  # height of a line of text below the panels [inch]
# Results that maps, and curves for several values of a second axis, show if none are named: the first three that there are.
ONE_BY_ONE = ("friction_coefficient", "fraction_rolling", "fraction_sliding", "fraction_sticking", "fraction_ever_rolling")

COLORS = [LINE_COLORS[name] for name in ("blue", "vermilion", "green", "purple", "orange", "sky", "black")]
Panel = tuple[str, tuple[str, ...]]  # a panel: its title and the results that it shows
AXES = {  # axis of the study: label, colour, marker; shapes distinguish them without colours
    "law": ("another law or springs", LINE_COLORS["blue"], "o"),
    "step": ("another step", LINE_COLORS["vermilion"], "s"),
    "integrator": ("the other integrator", LINE_COLORS["green"], "D"),
    "speed": ("another speed of the plate", LINE_COLORS["sky"], "P"),
    "fine": ("finest law, another step", LINE_COLORS["purple"], "^"),
    "meeting": ("bodies do not meet", LINE_COLORS["black"], "X"),
}
NOTHING = 1e-12  # smaller errors are drawn at this value: a variant with identical bits has none


def draw_sweep(
    sweep: SweepTable, out: Path | None = None, panels: Sequence[str] | None = None, x: str | None = None, y: str | None = None
) -> Figure:
    """Return the picture of a sweep, written to `out` if given. Raises UsageError, InputError and OutputError."""
    from matplotlib.figure import Figure

    if out is not None:
        check_format(out)
    x, y = _drawn_axes(sweep, x, y)
    shown = average(sweep, x, y)
    if not len(shown.x):
        raise InputError(f"{sweep.path}: nothing to draw: no point is done yet")
    is_map = y is not None and len(np.unique(shown.y)) > CURVES
    listed = _panels(sweep, shown, panels)
    columns = min(len(listed), PER_ROW)
    rows = -(-len(listed) // columns)
    width = WIDTH if columns > 1 else ALONE
    known = {name: RESULTS[name].meaning for _, names in listed for name in names if name in RESULTS}
    texts = [f"{_words(name)}: {text[:1].lower()}{text[1:]}" for name, text in known.items()]
    meanings = [line for text in texts for line in textwrap.wrap(text, int(14.0 * width))]
    figure = Figure(figsize=(width, HEIGHT * rows + 0.5 + LINE * len(meanings)), layout="constrained")
    grid = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for axes, panel in zip(grid, listed, strict=False):
        (_draw_map if is_map else _draw_curves)(axes, sweep, shown, panel)
    for axes in grid[len(listed) :]:
        axes.remove()
    bars = "" if is_map else "; bars: standard error"
    mean = f"mean over {', '.join(shown.averaged)} ({shown.largest} points{bars})" if shown.largest > 1 else ""
    figure.supxlabel("\n".join(meanings), x=0.01, ha="left", fontsize=8, color=SOFT_INK)
    title = [line for text in (sweep.title or str(sweep.path), mean) for line in textwrap.wrap(text, int(10.0 * width))]
    figure.suptitle("\n".join(title), fontsize=11, color=INK)
    if out is not None:
        save(figure, out)
    return figure


def _drawn_axes(sweep: SweepTable, x: str | None, y: str | None) -> tuple[str, str | None]:
    """Return the axes of the picture: those named, else the one or two with the largest number of values that are no seeds."""
    for option, key in (("x", x), ("y", y)):
        if key is not None and key not in sweep.axes:
            raise UsageError(f"{option} = {key}: is no axis of this sweep, {nearest(key, sweep.axes)}")
    if x is not None:
        return x, y
    first = {column.axis: column for column in reversed(sweep.columns)}  # of keys that move together the first one
    numbers = [column.key for _, column in sorted(first.items()) if not any(isinstance(value, str) for value in column.values)]
    free = [key for key in numbers if _short(key) != "seed"] or numbers or list(sweep.axes)
    counts = {key: len(set(sweep.column(key))) for key in free if key != y}
    chosen = sorted(counts, key=lambda key: -counts[key])[:2]  # stable: the first of equal ones
    return chosen[0], y if y is not None or len(chosen) < 2 else chosen[1]


def _panels(sweep: SweepTable, shown: Average, names: Sequence[str] | None) -> list[Panel]:
    """Return the panels: those named, else friction and the states."""
    known = list(sweep.results)
    for name in names or ():
        if name not in known:
            raise UsageError(f"panel {name}: is no result of this sweep, {nearest(name, known)}")
    if names or shown.y_key is not None:
        return [(_words(name), (name,)) for name in names or [name for name in ONE_BY_ONE if name in known][:3] or known[:3]]
    ever = [name for name in known if name.startswith(EVER)]
    states = [name for name in known if name.startswith(FRACTION) and name not in ever and np.nanmax(shown.values[name]) > 0.0]
    panels: list[Panel] = [(_words(name), (name,)) for name in ("friction_coefficient", *ever) if name in known]
    if states:
        panels.insert(1, ("states at the end, fraction of the bodies", tuple(states)))
    return panels or [(_words(name), (name,)) for name in known[:3]]


def _words(name: str) -> str:
    if name.startswith(EVER):
        return f"ever {name.removeprefix(EVER)}, fraction of the bodies"
    if name.startswith(FRACTION):
        return f"{name.removeprefix(FRACTION)} at the end, fraction of the bodies"
    return name.replace("_", " ")


def _draw_curves(axes: Axes, sweep: SweepTable, shown: Average, panel: Panel) -> None:
    """Draw each result over x: a curve per value of y, which has a colour; states have theirs."""
    title, results = panel
    x = _scaled(axes, "x", shown.x_key, sweep, shown.x)(shown.x)
    for name in results:
        for number, value in enumerate(np.unique(shown.y) if shown.y_key else [None]):
            here = np.flatnonzero(shown.y == value) if shown.y_key else np.arange(len(x))
            here = here[np.argsort(x[here], kind="stable")]
            axes.errorbar(x[here], shown.values[name][here], yerr=shown.errors[name][here], capsize=2.5, linewidth=1.4,
                          markersize=4.0, **_style(name, number, results, shown, sweep, value))  # fmt: skip
    axes.set_title(title, fontsize=9.5, color=INK)
    units = {sweep.results[name] for name in results} - {"1"}
    axes.set_ylabel(f"[{units.pop()}]" if len(units) == 1 else "", fontsize=9)
    if all(name.startswith(FRACTION) for name in results):
        axes.set_ylim(-0.03, 1.03)
    axes.grid(True, alpha=0.25, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
    labels = axes.get_legend_handles_labels()[1]
    if len(labels) > 1 and (shown.y_key is None or axes is axes.figure.axes[0]):  # once where all panels have the same
        axes.legend(fontsize=8, frameon=False)


def _style(name: str, number: int, results: Sequence[str], shown: Average, sweep: SweepTable, value: Any) -> dict[str, Any]:
    """Return colour, marker and label of a curve: with several results colour means the state, else the value of y."""
    markers, lines, several = "osD^vP", ("-", "--", ":", "-.", (0, (5, 1)), (0, (1, 1))), len(results) > 1
    state, color = name.removeprefix(EVER).removeprefix(FRACTION), COLORS[number % len(COLORS)]
    if several or value is None and state in STATE_COLORS:
        color = STATE_COLORS.get(state, COLORS[0])
    words = [state if name.startswith(FRACTION) else _words(name)] if several else []
    if value is not None and shown.y_key is not None:
        factor, unit = _scale(np.array(value), sweep.axes[shown.y_key])
        words.append(f"{_short(shown.y_key)} = {f'{value * factor:.3g} {unit}' if unit else f'{value:g}'}")
    return {"color": color, "marker": markers[number % len(markers)], "linestyle": lines[number % len(lines)],
            "label": ", ".join(words) or None}  # fmt: skip


def _draw_map(axes: Axes, sweep: SweepTable, shown: Average, panel: Panel) -> None:
    """Draw a result over x and y: cells of a grid, or coloured points where they form none."""
    title, [name] = panel
    limits: dict[str, Any] = {"vmin": 0.0, "vmax": 1.0} if name.startswith(FRACTION) else {}
    x, y, values = np.unique(shown.x), np.unique(shown.y), shown.values[name]
    in_x, in_y = _scaled(axes, "x", shown.x_key, sweep, x), _scaled(axes, "y", shown.y_key or "", sweep, y)
    if len(shown.x) >= 0.5 * len(x) * len(y):
        cells = np.full((len(y), len(x)), np.nan)
        cells[np.searchsorted(y, shown.y), np.searchsorted(x, shown.x)] = values
        image: Any = axes.pcolormesh(in_x(_edges(x)), in_y(_edges(y)), cells, cmap="viridis", **limits)
    else:
        image = axes.scatter(in_x(shown.x), in_y(shown.y), c=values, s=28, cmap="viridis", edgecolors="white", linewidths=0.4,
                             **limits)  # fmt: skip
    axes.figure.colorbar(image, ax=axes).ax.tick_params(labelsize=8)
    unit = sweep.results[name]
    axes.set_title(title + ("" if unit == "1" else f" [{unit}]"), fontsize=9.5, color=INK)
    axes.tick_params(labelsize=8)


def _edges(centres: np.ndarray) -> np.ndarray:
    """Return the edges of cells around sorted centres: midway, in logarithms where the centres are spaced so."""
    if len(centres) < 2:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    if _is_log(centres):
        return np.asarray(np.exp(_edges(np.log(centres))))
    middles = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[2.0 * centres[0] - middles[0]], middles, [2.0 * centres[-1] - middles[-1]]])


def _is_log(values: np.ndarray) -> bool:
    """Return whether values are spread evenly on a logarithmic axis rather than on a linear one."""
    distinct = np.unique(values)
    if len(distinct) < 3 or distinct[0] <= 0.0 or distinct[-1] < 10.0 * distinct[0]:
        return False
    ratios, steps = np.diff(np.log(distinct)), np.diff(distinct)
    return bool(np.ptp(ratios) / ratios.mean() < np.ptp(steps) / steps.mean())


def _scale(values: np.ndarray, unit: str) -> tuple[float, str]:
    return prefix_for(float(np.abs(values).max(initial=0.0)), unit)


def _scaled(axes: Axes, which: str, key: str, sweep: SweepTable, values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Label an axis of the picture, logarithmic for such values; return the function that scales values to its unit."""
    factor, unit = _scale(values, sweep.axes[key])
    getattr(axes, f"set_{which}label")(f"{key} [{unit}]" if unit else key, fontsize=9, color=SOFT_INK)
    if _is_log(values):
        from matplotlib.ticker import LogLocator, NullFormatter

        axis, few = getattr(axes, f"{which}axis"), values.max() < 3e3 * values.min()
        getattr(axes, f"set_{which}scale")("log")
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    return lambda raw: raw * factor


def _short(key: str) -> str:
    return key.rpartition(".")[2]


def picture_of_study(built: Study) -> Figure:
    """Return the picture as a matplotlib figure: error over processor time with its spread, and the front as a line."""
    from matplotlib.figure import Figure

    merit = figure_of_merit(built)
    figure = Figure(figsize=(7.0, 4.7), layout="constrained")
    axes = figure.add_subplot()
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(True, which="major", alpha=0.25, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(which="both", labelsize=9)
    points, front = _points(built, merit), efficient(built)
    for axis, (label, color, marker) in AXES.items():
        here = [row for row in points if row.variant.axis == axis and row is not built.reference]
        if here:
            x, y = zip(*(points[row] for row in here), strict=True)
            axes.errorbar(x, y, xerr=_error_bars(here), fmt=marker, color=color,
                          markersize=6.0, elinewidth=0.9, capsize=0.0, label=label, markeredgecolor="white", markeredgewidth=0.6,
                          zorder=3)  # fmt: skip
    axes.plot(*zip(*(points[row] for row in front if row in points), strict=True), color=INK, linewidth=1.4, alpha=0.6, zorder=2)
    _marks(axes, built, points, merit)
    axes.margins(x=0.17, y=0.1)  # room for names
    _percents(axes, merit)
    sizes = [words.partition(",")[0] for words in built.reduction if " of " in words]
    axes.set_xlabel(", ".join(["processor time [s]", *sizes]), fontsize=9.5, color=INK)
    title = "\n".join(textwrap.wrap(f"What accuracy costs: {built.title or built.scene}", 58))
    figure.suptitle(title, fontsize=12, fontweight="bold", x=0.01, ha="left", color=INK)
    axes.set_title("\n".join(textwrap.wrap(advice(built).replace(" %", "\u00a0%"), 90)), loc="left", fontsize=9.5, color=INK)
    figure.legend(fontsize=8.5, frameon=False, loc="outside lower left", ncols=3, handletextpad=0.3, columnspacing=1.2)
    _names(axes, points, _named(built, points), front)
    return figure


def _percents(axes: Axes, merit: str) -> None:
    """Label both axes of errors and seconds in plain numbers."""
    from matplotlib.ticker import FuncFormatter

    what = {"friction_error": "friction", "mean_friction_error": "mean friction", "load_error": "load or gap"}[merit]
    axes.set_ylabel(f"error in {what}", fontsize=9.5, color=INK)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100.0 * value:.3g} %"))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    low, high = axes.get_xlim()
    if high < 30.0 * low:  # a decade alone would leave one number
        axes.xaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else ""))


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


def _marks(axes: Any, built: Study, points: dict[Row, tuple[float, float]], merit: str) -> None:
    """Draw the reference, a ring around the recommended variant, and how far runs from almost equal starts part."""
    best, reference = recommended(built)[0], built.reference
    axes.errorbar([points[reference][0]], [points[reference][1]], xerr=_error_bars([reference]), fmt="*", color=INK,
                  markersize=10.0, markerfacecolor="white", elinewidth=0.9, zorder=3)  # fmt: skip
    if best in points:
        axes.plot(*points[best], "o", markersize=14.0, markerfacecolor="none", markeredgecolor=LINE_COLORS["orange"],
                  markeredgewidth=2.0, zorder=4)  # fmt: skip
    apart = built.scatter.get(merit, 0.0)
    if apart > 0.1 * min(y for _, y in points.values()):
        axes.axhspan(0.0, apart, color=SOFT_INK, alpha=0.15, linewidth=0.0, zorder=0, label="scatter of runs from equal starts")


def _named(built: Study, points: Iterable[Row]) -> dict[Row, str]:
    """Return the names of the points, those that a reader searches for with what they are."""
    own = next((row.variant.name.split(",")[0] for row in points if row.variant.axis != "law"), "")
    parts = {built.default: "as in the scene", recommended(built)[0]: "recommended", built.reference: "reference"}
    roles = {row: [role for other, role in parts.items() if other is row] for row in points}
    if built.default is recommended(built)[0] and built.default in roles:
        roles[built.default] = ["as in the scene, recommended"]
    short = {row: row.variant.name.removeprefix(f"{own}, ") for row in points}
    return {row: f"{name} ({roles[row][0]})" if roles[row] else name for row, name in short.items()}


Box = tuple[float, float, float, float]  # left, bottom, right and top of an item of the picture, in its pixels


def _names(axes: Any, points: dict[Row, tuple[float, float]], names: dict[Row, str], front: list[Row]) -> None:
    """Draw a name near each point, where it covers the least: those of the front first, others pale and where there is room."""
    from matplotlib.patheffects import withStroke

    axes.figure.draw_without_rendering()  # layout and limits
    scale = axes.figure.dpi / 72.0
    dots = {row: axes.transData.transform(point) for row, point in points.items()}
    occupied: list[Box] = []
    inside = axes.bbox.extents
    for row in sorted(points, key=lambda row: ("(" not in names[row], row not in front, dots[row][0])):
        text, (x, y), chosen = names[row], dots[row], row in front or "(" in names[row]
        size = 9.0 if chosen else 8.0
        width, height, off = 0.54 * size * len(text) * scale, 1.25 * size * scale, 6.0 if "recommended" in text else 0.0
        others = [(px - r, py - r, px + r, py + r) for key, (px, py) in dots.items() if key != row for r in (4.0 * scale,)]
        result: list[tuple[float, Box, tuple[float, float], bool]] = []
        for dx, dy in ((dx + math.copysign(off, dx), dy + math.copysign(0.5 * off, dy)) for dx, dy in _AROUND):
            left, middle = x + dx * scale - (width if dx < 0 else 0.0), y + dy * scale
            box = (left, middle - 0.5 * height, left + width, middle + 0.5 * height)
            out = box[0] < inside[0] or box[2] > inside[2] or box[1] < inside[1] or box[3] > inside[3]
            hidden = sum(_boxes_overlap(box, other) for other in [*occupied, *others]) + out
            of_another = any(_distance(box, dots[other]) < _distance(box, dots[row]) for other in dots if other != row)
            away = 0.1 * math.hypot(dx, dy) + 0.8 * (dx < 0) + 0.4 * (dy < 0) + 3.0 * of_another  # above and to the right
            result.append((HIDES * hidden + away, box, (dx, dy), of_another))
        worth, box, shift, of_another = min(result)
        if worth > HIDES and not chosen:
            continue
        occupied.append(box)
        distant = of_another or max(abs(shift[0]) - 6.0, abs(shift[1])) > 12.0 + off
        axes.annotate(text, points[row], xytext=shift, textcoords="offset points", fontsize=size, va="center",
                      ha="left" if shift[0] > 0 else "right", color=INK if chosen else SOFT_INK, zorder=5,
                      path_effects=[withStroke(linewidth=2.0, foreground="white")],
                      arrowprops={"arrowstyle": "-", "color": SOFT_INK, "linewidth": 0.5} if distant else None)  # fmt: skip


def _distance(box: Box, point: Sequence[float]) -> float:
    x, y = point
    return math.hypot(max(box[0] - x, 0.0, x - box[2]), max(box[1] - y, 0.0, y - box[3]))


def _boxes_overlap(a: Box, b: Box) -> bool:
    return a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3]


HIDES = 15.0  # penalty of a name on another name or point; more than that of the farthest offset
_AROUND = [
    (dx, side * dy) for distant in (3, 45, 90) for dy in (9, 18, 27, 36, 48) for side in (1, -1) for dx in (distant, -distant)
]
"""Offsets of a name from its point [points]."""
