"""Pictures of a sweep: curves over one axis with error bars, or maps over two."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.errors import InputError, UsageError, nearest
from thirdbody.palette import INK, LINE_COLORS, SOFT_INK, STATE_COLORS
from thirdbody.plot.figures import check_format
from thirdbody.studies.folder import Average, SweepTable, average
from thirdbody.studies.results import EVER, FRACTION
from thirdbody.units import prefix_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CURVES = 6  # largest number of values of a second axis that are drawn as curves; more are a map
PANEL = (4.3, 3.3)  # width and height of a panel [inch]
PER_ROW = 3  # largest number of panels side by side
# Results that maps, and curves for several values of a second axis, show if none are named: the first three that there are.
ONE_BY_ONE = ("friction_coefficient", "fraction_rolling", "fraction_sliding", "fraction_sticking", "fraction_ever_rolling")

COLORS = [LINE_COLORS[name] for name in ("blue", "vermilion", "green", "purple", "orange", "sky", "black")]


Panel = tuple[str, tuple[str, ...]]  # a panel: its title and the results that it shows


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
    figure = Figure(figsize=(PANEL[0] * columns, PANEL[1] * rows + 0.5), layout="constrained")
    grid = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for axes, panel in zip(grid, listed, strict=False):
        (_draw_map if is_map else _draw_curves)(axes, sweep, shown, panel)
    for axes in grid[len(listed) :]:
        axes.set_visible(False)
    bars = "" if is_map else "; bars: standard error"
    mean = f"\nmean over {', '.join(shown.averaged)} ({shown.largest} points{bars})" if shown.largest > 1 else ""
    figure.suptitle((sweep.title or str(sweep.path)) + mean, fontsize=11, color=INK)
    if out is not None:
        from thirdbody.plot.figures import save

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
    panels = [(_words(name), (name,)) for name in ("friction_coefficient", *ever) if name in known]
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
    if len(axes.get_legend_handles_labels()[1]) > 1:
        axes.legend(fontsize=7.5, frameon=False)


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
    return (1.0, "") if unit == "1" else prefix_for(float(np.abs(values).max(initial=0.0)), unit)


def _scaled(axes: Axes, which: str, key: str, sweep: SweepTable, values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Label an axis of the picture, logarithmic for such values; return the function that scales values to its unit."""
    factor, unit = _scale(values, sweep.axes[key])
    getattr(axes, f"set_{which}label")(f"{key} [{unit}]" if unit else key, fontsize=9, color=SOFT_INK)
    if _is_log(values):
        getattr(axes, f"set_{which}scale")("log")
    return lambda raw: raw * factor


def _short(key: str) -> str:
    return key.rpartition(".")[2]
