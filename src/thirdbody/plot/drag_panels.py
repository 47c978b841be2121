"""Panels over the drag: friction, states, gap, load, energy; and the loop of a stroke."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from thirdbody.palette import INK
from thirdbody.palette import LINE_COLORS as LINES
from thirdbody.plot.run_data import PERCENT, Panel, RunData, draw_lines, label_axis, no_labels
from thirdbody.trajectory.friction import force_on_plate, running_mean
from thirdbody.trajectory.names import SERIES
from thirdbody.units import percent, quantity_text, unit_for

# -- friction --

WINDOW_FRACTION = 0.1  # fraction of the run covered by one running mean
MU = "friction coefficient"


def _no_friction(data: RunData, loop: bool = False) -> str:
    if data.stroke != loop:
        return "the plate never turns back" if loop else "the plate goes back and forth: the panel loop shows its friction"
    if not data.dragged:
        return "no drag"
    return "" if np.isfinite(data.name("friction_coefficient")[1:]).any() else "never loaded"


@partial(Panel, "friction", 1.9, _no_friction,
    note="Friction coefficient: force of the debris on the upper plate against its motion, over the normal force; means over"
         " the output intervals. Its error counts that neighbouring intervals are correlated (autocorrelation"
         " time).")  # fmt: skip
def _draw_friction(axes: Axes, data: RunData) -> str:
    x, mu, result = data.x, data.interval_means("friction_coefficient"), data.run.friction
    marker = "." if len(x) < 80 else ""
    axes.plot(x, mu, color=LINES["sky"], linewidth=0.8, markersize=4.0, label="each interval", marker=marker)
    width = max(int(round(WINDOW_FRACTION * len(x))), 3)
    if len(x) > 2 * width:
        mean = np.where(np.isfinite(mu), running_mean(mu, width), np.nan)
        window = quantity_text(width * (data.axis[0][-1] - data.axis[0][0]) / (len(x) - 1), data.axis[1], 2)
        axes.plot(x, mean, color=LINES["blue"], linewidth=1.8, label=f"running mean\n(over {window})")
    _draw_mean(axes, data)
    _draw_pairs(axes, data)
    for k, (first, last) in enumerate(stretches(~np.isfinite(mu[1:]))):
        axes.axvspan(x[first], x[last + 1], color="#DDDFE3", linewidth=0.0, zorder=0, label=None if k else "unloaded")
    label_axis(axes, data, MU)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, 0.0), max(high, 0.0) * (1.05 if data.pair_friction else 1.0))
    if not np.isfinite(result.value):
        return "Friction coefficient"
    return f"Friction coefficient: {result.short_text}" + (f", {result.verdict}" if result.stationary is False else "")


def _draw_mean(axes: Axes, data: RunData) -> None:
    members, x, result = np.flatnonzero(data.drag.averaged[data.start :]), data.x, data.run.friction
    if not len(members):
        return
    ends, mean = (x[max(members[0] - 1, 0)], x[members[-1]]), result.value
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
    values = [sign * value for value in data.pair_friction for sign in signs] if len(data.pair_friction) <= 3 else []
    for k, value in enumerate(values):
        label = None if k else "if all slid (coefficient\nof the pair)"
        axes.axhline(value, color=LINES["grey"], linewidth=0.9, linestyle=":", label=label)


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
    inside = slice(data.drag.cycles[-1].start + 1, data.drag.cycles[-1].stop)
    return float(np.nansum(data.name("friction_coefficient", False)[inside] * data.drag.steps[inside]))


@partial(Panel, "loop", 2.3, partial(_no_friction, loop=True),
    note="Friction loop: the friction coefficient, signed by the first direction of motion, over the displacement of the"
         " upper plate; the area times the load is the work of one cycle. On a path along both axes each has a loop, and"
         " their areas add up.")  # fmt: skip
def _draw_loop(axes: Axes, data: RunData) -> str:
    """Draw the coefficient of every interval, the last whole cycle emphasised and closed.

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
        x, y = _path(u[data.start :] / factor, mu[data.start :])
        axes.plot(x, y, color=color if name else LINES["sky"], linewidth=0.9, label=f"{name}all of the drag")
        if data.drag.cycles:
            x, y = _path(u[data.drag.cycles[-1]] / factor, mu[data.drag.cycles[-1]])
            known = np.flatnonzero(np.isfinite(y))
            known = np.append(known, known[:1])  # closed by its first point
            axes.fill(x[known], y[known], color=color, alpha=0.12, linewidth=0.0, label=f"{name}its area")
            axes.plot(x[known], y[known], color=color, linewidth=1.8, label=f"{name}last whole cycle")
    _draw_pairs(axes, data, (1.0, -1.0))
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.set(xlabel=f"displacement of the upper plate ({unit})", ylabel=MU)
    area, work = loop_area(data), data.run.friction.energy_per_cycle
    if not np.isfinite(area):
        return "Friction loop (no whole cycle yet)"
    energy = f", {quantity_text(work, 'J')} a cycle" if np.isfinite(work) else ""
    return f"Friction loop: area {quantity_text(area, 'm')}{energy}"


def _path(u: np.ndarray, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the line of frames with displacements `u` (n,): the coefficient of each interval at its middle, and at the turns.

    There the plate has the coefficient of the interval before, and turns only then.
    """
    steps = np.diff(u)
    ends = np.where(steps * np.roll(steps, -1) < 0.0, u[1:], np.nan)  # the last one, too, if the cycle turns there
    x, y = np.column_stack([0.5 * (u[1:] + u[:-1]), ends]).ravel(), np.repeat(mu[1:], 2)
    return x[np.isfinite(x)], y[np.isfinite(x)]


@partial(Panel, "states", 1.3, no_labels,
    note="States: free, carries no load; sticking, moves no further than elastic contacts give way; sliding, all its contacts "
         "with one plate slip; rolling, turns as the plate moves on.")  # fmt: skip
def _draw_states(axes: Axes, data: RunData) -> str:
    x = data.x
    portions = {name: values[data.start :] for name, values in data.fractions.items()}
    if len(x) == 1:  # one frame: a bar
        x, portions = np.array([0.0, 1.0]), {name: np.repeat(values, 2) for name, values in portions.items()}
    present = [name for name, values in portions.items() if values.any()]
    colors = [data.colors[name] for name in present]
    axes.stackplot(x, [portions[name] for name in present], colors=colors, labels=present, step="mid", linewidth=0.0)
    axes.set_ylim(0.0, 1.0)
    axes.set_yticks(**PERCENT)
    label_axis(axes, data, "bodies (%)")
    if len(data.axis[0]) == 1:
        axes.set_xlabel("")
        axes.set_xticks([0.5], ["the only frame" if data.frames == 1 else "the last frame"])
    bodies = data.summary.get("bodies", 0)
    name = "State of the body" if bodies == 1 else f"States of the {bodies} bodies"
    return f"{name}: at the end {data.final_fractions}"


# -- gap and load --

SMALL, NOTHING = 0.01, 1e-5  # a change below SMALL of the value is drawn as a change, one below NOTHING counts as none


def _needs(condition: Callable[[RunData], Any], otherwise: str) -> Callable[[RunData], str]:
    """Return the function that tells why a panel over the drag is missing: without two frames, or `otherwise`."""
    return lambda data: "fewer than two frames" if not data.extended else "" if condition(data) else otherwise


@partial(Panel, "gap", 1.4, _needs(lambda data: np.isfinite(data.name("gap")).any(), "no upper plate"))
def _draw_gap(axes: Axes, data: RunData) -> str:
    gap = data.name("gap")
    change, now = gap - gap[0], quantity_text(gap[-1], "m")
    largest = float(np.nanmax(np.abs(change)))
    if not largest > NOTHING * abs(gap[0]):
        _draw_from_zero(axes, data, gap, "gap", "m")
        return f"Gap between the plates: {now}, unchanged"
    shown, name = (change, "change of gap") if largest < SMALL * abs(gap[0]) else (gap, "gap")
    draw_lines(axes, data, [(None, shown, "black", "-")], name, "m")
    axes.ticklabel_format(axis="y", useOffset=False)
    verb = "opened" if change[-1] > 0.0 else "closed"
    return f"Gap between the plates: {now} at the end, {verb} by {quantity_text(abs(change[-1]), 'm', 2)}"


def _draw_from_zero(axes: Axes, data: RunData, values: np.ndarray, name: str, unit: str) -> None:
    draw_lines(axes, data, [(None, values, "black", "-")], name, unit)
    axes.ticklabel_format(axis="y", useOffset=False)
    drawn = axes.lines[0].get_ydata()
    axes.set_ylim(min(0.0, 1.1 * float(np.nanmin(drawn))), max(0.0, 1.1 * float(np.nanmax(drawn))))


def _load(data: RunData) -> np.ndarray:
    side, sign = ("upper_force", 1.0) if np.isfinite(data.name("gap")).any() else ("lower_force", -1.0)
    if side not in data.series:
        return np.full(data.frames - data.start, np.nan)
    return sign * data.interval_means(side)[:, 2]


@partial(Panel, "load", 1.4, _needs(lambda data: np.nan_to_num(_load(data)).any(), "no load on a plate"))
def _draw_load(axes: Axes, data: RunData) -> str:
    load = _load(data)
    _draw_from_zero(axes, data, load, "load", "N")
    return f"Load: {quantity_text(load[-1], 'N')} at the end, at most {quantity_text(float(np.nanmax(load)), 'N')}"


@partial(Panel, "debris_load", 1.7,
    _needs(lambda data: "load_share_debris" in data.series, "its plates have no contact with each other"),
    note="Load: debris and direct contact of the plates, asperity on asperity, carry it together. Active: pressed from above "
         "and from below.")  # fmt: skip
def _draw_debris_load(axes: Axes, data: RunData) -> str:
    debris, active = data.interval_means("load_share_debris"), data.name("active")
    lines = [("load on debris", 100.0 * debris, "black", "-"), ("active bodies", 100.0 * active, "blue", "--")]
    draw_lines(axes, data, lines, "share (%)")
    axes.set_ylim(0.0, 105.0)
    carried = percent(float(data.name("load_share_debris")[-1]))
    return f"Debris carries {carried} of the load at the end, on {percent(float(active[-1]))} of the bodies"


def series_panel(name: str, unit: str) -> Panel:
    """Return the panel of one series of a run; a vector has three lines."""

    def draw(axes: Axes, data: RunData) -> str:
        values = data.name(name)
        vector = zip("xyz", values.T, ("vermilion", "green", "blue"), "---", strict=False) if values.ndim > 1 else None
        draw_lines(axes, data, vector or [(None, values, "black", "-")], "", "" if unit == "1" else unit)
        return name.replace("_", " ").capitalize()

    meaning = f"{name.replace('_', ' ').capitalize()}: {SERIES[name].meaning}" if name in SERIES else ""
    return Panel(name, 1.4, lambda data: "", draw, note=meaning)


# -- energy --

# Lines of the ledger: terms, label, colour, style.
LEDGER: tuple[tuple[str, str, str, str], ...] = (
    ("plate_work", "work of the plates", "black", "-"),
    ("friction", "lost in friction", "vermilion", "-"),
    ("direct_friction", "lost in friction of the plates on each other", "vermilion", "--"),
    ("plastic", "lost in plastic flow", "vermilion", "-."),
    ("adhesion", "lost in adhesion", "vermilion", "-."),
    ("damping", "lost in impacts and dashpots", "orange", "--"),
    ("elastic_normal elastic_tangential foundation direct_elastic", "elastic, stored", "blue", "-"),
    ("kinetic", "kinetic, stored", "sky", "--"),
    ("body_effects", "given by body effects", "green", "-."),
    ("numerical", "lost by the integrator", "purple", "-."),
    ("residual", "residual", "grey", ":"),
)
ALWAYS_DRAWN = ("lost in friction", "residual")
ROUNDING = 1e-15


def ledger(data: RunData) -> dict[str, np.ndarray]:
    """Return the lines of the ledger by label [J] since the start of the drag; below rounding only friction and residual."""
    lines = {}
    for terms, label, _, _ in LEDGER:
        parts = [data.name(f"energy_{part}") for part in terms.split() if f"energy_{part}" in data.series]
        if parts:
            lines[label] = np.sum(parts, axis=0)
    sizes = {label: float(np.abs(values).max()) for label, values in lines.items()}
    minimum = ROUNDING * max(sizes.values())
    return {label: values for label, values in lines.items() if sizes[label] > minimum or label in ALWAYS_DRAWN}


@partial(Panel, "energy", 1.9, _needs(lambda data: "energy_plate_work" in data.series, "no energy ledger"),
    note="Energy: work of the plates since the start of the pressing, and where it went; each line is computed on its own,"
         " the residual is the rest.")  # fmt: skip
def _draw_energy(axes: Axes, data: RunData) -> str:
    lines = ledger(data)
    small = 1000.0 * ROUNDING * unit_for(np.concatenate(list(lines.values())), "J")[0]
    ends = {label: quantity_text(values[-1] if abs(values[-1]) > small else 0.0, "J") for label, values in lines.items()}
    styles = ((label, color, style) for _, label, color, style in LEDGER if label in lines)
    drawn = [(f"{label}: {ends[label]}", lines[label], color, style) for label, color, style in styles]
    draw_lines(axes, data, drawn, "energy", "J")
    work, lost = (data.name(f"energy_{part}") for part in ("plate_work", "friction"))
    done, rubbed = float(work[-1] - work[0]), float(lost[-1] - lost[0])
    # the loss at a contact that never slips is a rounding error below zero
    known = done > 0.0 and -1e-3 * done < rubbed <= done
    fraction = f", {percent(max(rubbed / done, 0.0))} of it lost in friction" if known else ""
    if not data.start:
        return f"Energy: {quantity_text(done, 'J')} of work{fraction}"
    pressing = f"{quantity_text(float(work[0]), 'J', 2)} of work while pressing"
    return f"Energy: {quantity_text(done, 'J')} of work while sliding{fraction}; {pressing}"
