"""Panel of the states by group: population, material and size."""

from typing import Any

from matplotlib.axes import Axes

from thirdbody.plot.run_data import RunData
from thirdbody.trajectory.state_groups import POPULATION, fractions_text, informative_groups, states_by_group
from thirdbody.units import percent

GROUPS_NOTE = (
    "Groups: states of the bodies at the last frame by population, by material where populations share one, and in size classes"
    " of equal number (volume-equivalent diameter); on the right the number of bodies and their share of the normal force."
)
MAX_ROWS, LETTERS, MIN_TEXT_FRACTION = 12, 26, 0.14
"""Largest number of rows; letters of a name; fraction of a row that a text in it needs."""


def why_no_groups(data: RunData) -> str:
    """Return why there is no panel, empty when the bodies have labels and differ in population, material or size."""
    if not data.fractions:
        return "its bodies were not labelled"
    return "" if _rows(data) else "its bodies are of one population and size"


def groups_title(data: RunData) -> str:
    """Return the most frequent state of each population in words."""
    populations = [row for kind, row in _rows(data) if kind == POPULATION][:3]
    if not populations:
        return "States by size at the last frame"
    return "At the last frame: " + "; ".join(
        f"{_short(row['name'])} {fractions_text(row['fractions'], 1)}" for row in populations
    )


def draw_groups(axes: Axes, data: RunData) -> None:
    """Draw a stacked bar for each group, the states written in it, with its name and load on the right."""
    rows = _rows(data)
    for y, (_, row) in enumerate(rows):
        left = 0.0
        for name, fraction in row["fractions"].items():
            axes.barh(y, fraction, left=left, height=0.82, color=data.colors[name], linewidth=0.0)
            if fraction >= MIN_TEXT_FRACTION:
                text = f"{name} {percent(fraction)}"
                axes.text(left + 0.5 * fraction, y, text, ha="center", va="center", fontsize=6.5, color="white", clip_on=True)
            left += fraction
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.yaxis.tick_right()
    axes.set_yticks(range(len(rows)), [_label(row) for _, row in rows])
    axes.tick_params(axis="y", length=0)
    axes.set_xlim(0.0, 1.0)
    axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "25", "50", "75", "100"])
    axes.set_xlabel("bodies of the group (%)")


def _rows(data: RunData) -> list[tuple[str, dict[str, Any]]]:
    rows = [(kind, row) for kind, rows in informative_groups(states_by_group(data.run)) for row in rows]
    return rows[:MAX_ROWS]


def _short(name: str) -> str:
    return name if len(name) <= LETTERS else f"{name[: LETTERS - 1]}\N{HORIZONTAL ELLIPSIS}"


def _label(row: dict[str, Any]) -> str:
    load = f", {percent(row['load_share'])} of load" if "load_share" in row else ""
    return f"{_short(row['name'])}: {row['bodies']}{load}"
