"""Panels over the drag: states, gap, load, energy."""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from thirdbody.palette import LINE_COLORS as LINES
from thirdbody.plot.run_data import RunData
from thirdbody.units import percent, quantity_text, scale_values, unit_for

STATES_NOTE = (
    "States: free, carries no load; sticking, moves no further than elastic contacts give way; sliding, all its contacts with one"
    " plate slip; rolling, turns as the plate moves on."
)
ENERGY_NOTE = (
    "Energy: work of the plates since the start of the pressing, and where it went; each line is computed on its own, the"
    " residual is the rest."
)
DEBRIS_LOAD_NOTE = (
    "Load: debris and direct contact of the plates, asperity on asperity, carry it together. Active: pressed from above and from"
    " below."
)
SMALL, NOTHING = 0.01, 1e-5
"""A change below SMALL of the value is drawn as a change, one below NOTHING counts as none."""


class _Line(NamedTuple):
    """Line of the ledger: its terms, label, colour, style."""

    parts: tuple[str, ...]
    label: str
    color: str
    style: str | tuple[int, tuple[float, ...]]


LEDGER = (
    _Line(("plate_work",), "work of the plates", LINES["black"], "-"),
    _Line(("friction",), "lost in friction", LINES["vermilion"], "-"),
    _Line(("direct_friction",), "lost in friction of the plates on each other", LINES["vermilion"], "--"),
    _Line(("plastic",), "lost in plastic flow", LINES["vermilion"], "-."),
    _Line(("adhesion",), "lost in adhesion", LINES["vermilion"], "-."),
    _Line(("damping",), "lost in impacts and dashpots", LINES["orange"], "--"),
    _Line(("elastic_normal", "elastic_tangential", "foundation", "direct_elastic"), "elastic, stored", LINES["blue"], "-"),
    _Line(("kinetic",), "kinetic, stored", LINES["sky"], "--"),
    _Line(("body_effects",), "given by body effects", LINES["green"], "-."),
    _Line(("numerical",), "lost by the integrator", LINES["purple"], "-."),
    _Line(("residual",), "residual", LINES["grey"], ":"),
)


ALWAYS_DRAWN = ("lost in friction", "residual")
ROUNDING = 1e-15


def _why_short(data: RunData) -> str:
    """Return why nothing can be drawn over time, empty if it can."""
    return "" if len(data.axis[0]) > 1 and data.axis[0][-1] > data.axis[0][0] else "fewer than two frames"


def why_no_states(data: RunData) -> str:
    """Return why there is no panel, empty when the run has labels."""
    return "" if data.fractions else "its bodies were not labelled"


def states_title(data: RunData) -> str:
    """Return the final fractions in words."""
    bodies = data.summary.get("bodies", 0)
    name = "State of the body" if bodies == 1 else f"States of the {bodies} bodies"
    return f"{name}: at the end {final_fractions(data)}"


def final_fractions(data: RunData) -> str:
    """Return `59 % sliding, 41 % rolling`; for one body its state only."""
    portions = {name: float(values[-1]) for name, values in data.fractions.items() if values[-1] > 0.0}
    if len(portions) == 1:
        return f"{'' if data.summary.get('bodies') == 1 else 'all '}{next(iter(portions))}"
    return ", ".join(f"{percent(fraction)} {name}" for name, fraction in sorted(portions.items(), key=lambda entry: -entry[1]))


def draw_states(axes: Axes, data: RunData) -> None:
    """Draw the fractions stacked; those of a frame extend to the middle of the next interval."""
    x, unit = scale_values(data.axis[0], data.axis[1])
    portions = {name: values[data.start :] for name, values in data.fractions.items()}
    if len(x) == 1:  # one frame: a bar
        x, portions = np.array([0.0, 1.0]), {name: np.repeat(values, 2) for name, values in portions.items()}
    present = [name for name, values in portions.items() if values.any()]
    axes.stackplot(x, [portions[name] for name in present], colors=[data.colors[name] for name in present], labels=present,
                   step="mid",
                   linewidth=0.0)  # fmt: skip
    axes.set_ylim(0.0, 1.0)
    axes.set_yticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "25", "50", "75", "100"])
    axes.set_ylabel("bodies (%)")
    if len(data.axis[0]) > 1:
        axes.set_xlabel(f"{data.axis[2]} ({unit})")
    else:
        axes.set_xticks([0.5], ["the only frame" if data.frames == 1 else "the last frame"])


def why_no_gap(data: RunData) -> str:
    """Return why there is no panel, empty when there is an upper plate."""
    return _why_short(data) or ("" if np.isfinite(data.name("gap")).any() else "no upper plate")


def gap_title(data: RunData) -> str:
    """Return its change in words."""
    gap = data.name("gap")
    change = gap[-1] - gap[0]
    if not _changes(gap):
        return f"Gap between the plates: {quantity_text(gap[-1], 'm')}, unchanged"
    word = "opened" if change > 0.0 else "closed"
    return f"Gap between the plates: {quantity_text(gap[-1], 'm')} at the end, {word} by {quantity_text(abs(change), 'm', 2)}"


def draw_gap(axes: Axes, data: RunData) -> None:
    """Draw the gap, or its change since the start of the drag where that is small."""
    _draw_line(axes, data, data.name("gap"), "m", "gap", LINES["black"])


def why_no_load(data: RunData) -> str:
    """Return why there is no panel, empty when a plate feels a force."""
    return _why_short(data) or ("" if np.nan_to_num(load(data)).any() else "no load on a plate")


def load(data: RunData) -> np.ndarray:
    """Return the normal force on the upper plate (without one: lower) from the start of the drag [N], interval means."""
    side, sign = ("upper_force", 1.0) if np.isfinite(data.name("gap")).any() else ("lower_force", -1.0)
    if side not in data.series:
        return np.full(data.frames - data.start, np.nan)
    return sign * data.interval_means(side)[:, 2]


def load_title(data: RunData) -> str:
    """Return its final value in words."""
    values = load(data)
    return f"Load: {quantity_text(values[-1], 'N')} at the end, at most {quantity_text(float(np.nanmax(values)), 'N')}"


def draw_load(axes: Axes, data: RunData) -> None:
    """Draw the normal force on the plate."""
    _draw_line(axes, data, load(data), "N", "load", LINES["black"], whole=True)


def why_no_debris_load(data: RunData) -> str:
    """Return why there is no panel, empty when the plates have direct contact."""
    return _why_short(data) or ("" if "load_share_debris" in data.series else "its plates have no contact with each other")


def debris_load_title(data: RunData) -> str:
    """Return the final shares in words."""
    debris, active = (float(data.name(name)[-1]) for name in ("load_share_debris", "active"))
    return f"Debris carries {percent(debris)} of the load at the end, on {percent(active)} of the bodies"


def draw_debris_load(axes: Axes, data: RunData) -> None:
    """Draw the part of the load that debris carries, and the fraction of bodies that do."""
    x, unit = scale_values(data.axis[0], data.axis[1])
    axes.plot(x, 100.0 * data.interval_means("load_share_debris"), color=LINES["black"], linewidth=1.4, label="load on debris")
    axes.plot(x, 100.0 * data.name("active"), color=LINES["blue"], linestyle="--", linewidth=1.4, label="active bodies")
    axes.set_ylim(0.0, 105.0)
    axes.set_ylabel("share (%)")
    axes.set_xlabel(f"{data.axis[2]} ({unit})")


def _draw_line(axes: Axes, data: RunData, values: np.ndarray, unit: str, name: str, color: str, whole: bool = False) -> None:
    x, x_unit = scale_values(data.axis[0], data.axis[1])
    whole = whole or not _changes(values)
    if not whole and np.nanmax(np.abs(values - values[0])) < SMALL * abs(values[0]):
        values, name = values - values[0], f"change of {name}"
    values, unit = scale_values(values, unit)
    axes.plot(x, values, color=color, linewidth=1.4)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.set_ylabel(f"{name} ({unit})")
    axes.set_xlabel(f"{data.axis[2]} ({x_unit})")
    if whole:
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        axes.set_ylim(min(0.0, 1.1 * low), max(0.0, 1.1 * high))


def _changes(values: np.ndarray) -> bool:
    """Return whether the values ever differ from the first by more than NOTHING of it."""
    return bool(np.nanmax(np.abs(values - values[0])) > NOTHING * abs(values[0]))


def why_no_energy(data: RunData) -> str:
    """Return why there is no panel, empty when the run has a ledger."""
    return _why_short(data) or ("" if "energy_plate_work" in data.series else "no energy ledger")


def ledger(data: RunData) -> dict[str, np.ndarray]:
    """Return the lines of the ledger by label [J] since the start of the drag; below rounding only friction and residual."""
    lines = {}
    for line in LEDGER:
        parts = [data.name(f"energy_{part}") for part in line.parts if f"energy_{part}" in data.series]
        if parts:
            lines[line.label] = np.sum(parts, axis=0)
    sizes = {label: float(np.abs(values).max()) for label, values in lines.items()}
    minimum = ROUNDING * max(sizes.values())
    return {label: values for label, values in lines.items() if sizes[label] > minimum or label in ALWAYS_DRAWN}


def energy_title(data: RunData) -> str:
    """Return the work and the fraction of friction in words, of the sliding alone; the work of pressing is given separately."""
    work, lost = (data.name(f"energy_{part}") for part in ("plate_work", "friction"))
    done, rubbed = float(work[-1] - work[0]), float(lost[-1] - lost[0])
    # the loss at a contact that never slips is a rounding error below zero
    fraction = (
        f", {percent(max(rubbed / done, 0.0))} of it lost in friction" if done > 0.0 and -1e-3 * done < rubbed <= done else ""
    )
    if not data.start:
        return f"Energy: {quantity_text(done, 'J')} of work{fraction}"
    return (
        f"Energy: {quantity_text(done, 'J')} of work while sliding{fraction}; {quantity_text(float(work[0]), 'J', 2)} of "
        f"work while pressing"
    )


def draw_energy(axes: Axes, data: RunData) -> None:
    """Draw the cumulative lines of the ledger; the legend gives their final values, where small ones are not visible."""
    lines = ledger(data)
    x, x_unit = scale_values(data.axis[0], data.axis[1])
    factor, unit = unit_for(np.concatenate(list(lines.values())), "J")
    for line in LEDGER:
        if line.label in lines:
            values = lines[line.label]
            end = values[-1] if abs(values[-1]) > ROUNDING * 1000.0 * factor else 0.0
            label = f"{line.label}: {quantity_text(end, 'J')}"
            axes.plot(x, values / factor, color=line.color, linestyle=line.style, linewidth=1.4, label=label)
    axes.set_ylabel(f"energy ({unit})")
    axes.set_xlabel(f"{data.axis[2]} ({x_unit})")
