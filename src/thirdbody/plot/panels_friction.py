"""Panels of friction: the coefficient over the sliding distance, and the loop of a stroke."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from thirdbody.palette import LINE_COLORS as LINES
from thirdbody.plot.run_data import RunData
from thirdbody.trajectory.friction import force_on_plate
from thirdbody.trajectory.statistics import running_mean
from thirdbody.units import quantity_text, scale_values, unit_for

WINDOW_FRACTION = 0.1
"""Fraction of the run covered by one running mean."""

MU = "friction coefficient"
FRICTION_NOTE = (
    "Friction coefficient: force of the debris on the upper plate against its motion, over the normal force; means over the"
    " output intervals. Its error counts that neighbouring intervals are correlated (autocorrelation time)."
)
LOOP_NOTE = (
    "Friction loop: the friction coefficient, signed by the first direction of motion, over the displacement of the upper plate;"
    " the area times the load is the work of one cycle. On a path along both axes each has a loop, and their areas add up."
)


def why_no_friction(data: RunData) -> str:
    """Return why there is nothing to draw over the sliding distance, empty if there is."""
    if data.stroke:
        return "the plate goes back and forth: the panel loop shows its friction"
    return _why_none(data)


def why_no_loop(data: RunData) -> str:
    """Return why there is no loop, empty if there is one."""
    return _why_none(data) if data.stroke else "the plate never turns back"


def _why_none(data: RunData) -> str:
    if not data.dragged:
        return "no drag"
    return "" if np.isfinite(data.name("friction_coefficient")[1:]).any() else "never loaded"


def friction_title(data: RunData) -> str:
    """Return the result in words."""
    result = data.run.friction
    if not np.isfinite(result.value):
        return "Friction coefficient"
    drifts = f", {result.short_verdict}" if result.stationary is False else ""
    return f"Friction coefficient: {result.short_text}{drifts}"


def draw_friction(axes: Axes, data: RunData) -> None:
    """Draw the interval means, their running mean, mean and error over the second half, and the coefficients of the pairs."""
    x, unit = scale_values(data.axis[0], data.axis[1])
    mu = data.interval_means("friction_coefficient")
    marker = "." if len(x) < 80 else ""
    axes.plot(x, mu, color=LINES["sky"], linewidth=0.8, markersize=4.0, label="each interval", marker=marker)
    width = max(int(round(WINDOW_FRACTION * len(x))), 3)
    if len(x) > 2 * width:
        mean = np.where(np.isfinite(mu), running_mean(mu, width), np.nan)
        axes.plot(x, mean, color=LINES["blue"], linewidth=1.8, label=f"running mean\n(over {window_text(data, width)})")
    _draw_mean(axes, data, x)
    _draw_pairs(axes, data)
    _shade_unloaded(axes, x, mu)
    axes.set_xlabel(f"{data.axis[2]} ({unit})")
    axes.set_ylabel(MU)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, 0.0), max(high, 0.0) * (1.05 if data.pair_friction else 1.0))


def window_text(data: RunData, width: int) -> str:
    """Return the length of `width` intervals of the axis in words."""
    x, unit, _ = data.axis
    return quantity_text(width * (x[-1] - x[0]) / (len(x) - 1), unit, 2)


def _draw_mean(axes: Axes, data: RunData, x: np.ndarray) -> None:
    """Draw the mean with its error over its intervals; where they drift, the linear fit instead."""
    result = data.run.friction
    members = np.flatnonzero(data.averaged[data.start :])
    if not len(members):
        return
    ends = x[max(members[0] - 1, 0)], x[members[-1]]
    mean = result.value
    style: dict[str, Any] = {"color": LINES["vermilion"], "linewidth": 1.2}
    if result.stationary is False:
        heights = [mean - 0.5 * result.change, mean + 0.5 * result.change]
        axes.plot(ends, heights, linestyle="-.", label="trend (second half):\nnot stationary", **style)
        return
    axes.plot(ends, [mean, mean], linestyle=(0, (5, 2)), label="mean (second half)", **style)
    if np.isfinite(result.error) and result.error > 0.0:
        low, high = mean - result.error, mean + result.error
        band = axes.fill_between(ends, low, high, color=LINES["vermilion"], alpha=0.25, label="its error")
        band.set_linewidth(0.0)


def _draw_pairs(axes: Axes, data: RunData, signs: tuple[float, ...] = (1.0,)) -> None:
    """Draw the coefficients that the scene gives: the friction of gross sliding."""
    label: str | None = "if all slid (coefficient\nof the pair)"
    for value in data.pair_friction if len(data.pair_friction) <= 3 else []:
        for sign in signs:
            axes.axhline(sign * value, color=LINES["grey"], linewidth=0.9, linestyle=":", label=label)
            label = None


def _shade_unloaded(axes: Axes, x: np.ndarray, mu: np.ndarray) -> None:
    label: str | None = "unloaded"
    for first, last in stretches(~np.isfinite(mu[1:])):
        axes.axvspan(x[first], x[last + 1], color="#DDDFE3", linewidth=0.0, zorder=0, label=label)
        label = None


def stretches(flags: np.ndarray) -> list[tuple[int, int]]:
    """Return the first and last index of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [(int(first), int(last) - 1) for first, last in zip(edges[::2], edges[1::2], strict=True)]


def loop_area(data: RunData) -> float:
    """Return the area of the loop of the last whole cycle [m]: sum of mean coefficient times displacement over the intervals.

    On a path along both axes it is that of both loops, of the coefficient along the velocity times the path. An unloaded interval
    adds nothing. NaN before the first whole cycle.
    """
    if not data.drag.cycles:
        return float("nan")
    cycle = data.drag.cycles[-1]
    inside = slice(cycle.start + 1, cycle.stop)
    return float(np.nansum(data.name("friction_coefficient", False)[inside] * data.drag.steps[inside]))


def loop_title(data: RunData) -> str:
    """Return the area in words."""
    area, work = loop_area(data), data.run.friction.energy_per_cycle
    if not np.isfinite(area):
        return "Friction loop (no whole cycle yet)"
    energy = f", {quantity_text(work, 'J')} a cycle" if np.isfinite(work) else ""
    return f"Friction loop: area {quantity_text(area, 'm')}{energy}"


def draw_loop(axes: Axes, data: RunData) -> None:
    """Draw the coefficient of every interval at the middle of its displacement, the last whole cycle emphasised.

    On a path along both axes there is a loop for each of them.
    """
    if data.drag.straight:
        loops = [("", LINES["blue"], data.drag.displacement, data.name("friction_coefficient", False))]
    else:
        force, normal = force_on_plate(data.run), np.abs(force_on_plate(data.run)[:, 2])
        mu = -np.divide(force, normal[:, None], out=np.full_like(force, np.nan), where=normal[:, None] > 0.0)
        colors = LINES["blue"], LINES["vermilion"]
        loops = [(f"along {'xy'[k]}: ", colors[k], data.drag.offset[:, k], mu[:, k]) for k in (0, 1)]
    factor, unit = unit_for(np.concatenate([u for _, _, u, _ in loops]), "m")
    for name, color, u, mu in loops:
        middle = u / factor
        middle[1:] = 0.5 * (middle[1:] + middle[:-1])  # abscissa of the mean over the interval
        shown = slice(data.start + 1, None)
        axes.plot(middle[shown], mu[shown], color=color if name else LINES["sky"], linewidth=0.9, label=f"{name}all of the drag")
        if data.drag.cycles:
            inside = slice(data.drag.cycles[-1].start + 1, data.drag.cycles[-1].stop)
            # closed by its first point
            x, y = (np.append(part[inside], part[inside][0]) for part in (middle, mu))
            known = np.isfinite(y)
            axes.fill(x[known], y[known], color=color, alpha=0.12, linewidth=0.0, label=f"{name}its area")
            axes.plot(x, y, color=color, linewidth=1.8, label=f"{name}last whole cycle")
    _draw_pairs(axes, data, (1.0, -1.0))
    axes.axhline(0.0, color="#222222", linewidth=0.6)
    axes.set_xlabel(f"displacement of the upper plate ({unit})")
    axes.set_ylabel(MU)
