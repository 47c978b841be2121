"""Data of a run for the panels of its page: series from the start of the drag on, path of the plate, contacts of a frame."""

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from thirdbody.palette import LINE_COLORS as LINES
from thirdbody.palette import state_colors
from thirdbody.trajectory.run_file import RunFile
from thirdbody.trajectory.states import fractions_text
from thirdbody.units import unit_for

BETWEEN = "between two bodies"
# Ticks of an axis from 0 to 100 %.
PERCENT: dict[str, Any] = {"ticks": [0.0, 0.25, 0.5, 0.75, 1.0], "labels": ["0", "25", "50", "75", "100"]}


class RunData:
    """Data of one run for its plots; contacts are those of `frame`. Raises IndexError for a frame outside the run."""

    def __init__(self, run: RunFile, frame: int = -1):
        self.run, self.frame = run, run.frame_number(frame)
        self.series, self.frames, self.drag = run.series, run.frames, run.drag
        self.dragged, self.stroke, self.start = self.drag.dragged, self.drag.stroke, self.drag.start
        self.summary = run.summary()
        self.colors = dict(zip(run.state_names, state_colors(run.state_names), strict=True))
        self.contacts = run.block("contacts", self.frame)
        self.bodies = run.bodies(self.frame)

    def name(self, name: str, shown: bool = True) -> np.ndarray:
        """Return one series by name, from the start of the drag if `shown`; NaN everywhere if the run has none."""
        values = self.series.get(name, np.full(self.frames, np.nan))
        return values[self.start :] if shown else values

    def interval_means(self, name: str) -> np.ndarray:
        """Return one series of means over output intervals from the start of the drag; the first was of settling, so NaN."""
        values = np.array(self.name(name), float)
        values[:1] = np.nan
        return values

    @cached_property
    def axis(self) -> tuple[np.ndarray, str, str]:
        """Abscissa of the series: values from `start` on, SI unit, and name."""
        if self.dragged and not self.stroke:
            return self.drag.distance[self.start :], "m", "sliding distance"
        times = self.run.times[self.start :]
        return times - times[0], "s", "time of the drag" if self.dragged else "time"

    @cached_property
    def x(self) -> np.ndarray:
        """Abscissa in the unit of its label (`label_axis`)."""
        return self.axis[0] / unit_for(self.axis[0], self.axis[1])[0]

    @property
    def extended(self) -> bool:
        """Whether there is something to draw over the abscissa."""
        return len(self.axis[0]) > 1 and bool(self.axis[0][-1] > self.axis[0][0])

    @cached_property
    def fractions(self) -> dict[str, np.ndarray]:
        """Fractions of the states (F,) by name, empty for a run without labels."""
        portions = {name: self.series.get(f"fraction_{name}") for name in self.run.state_names}
        return {name: values for name, values in portions.items() if values is not None}

    @property
    def final_fractions(self) -> str:
        """`59 % sliding, 41 % rolling`; for one body its state only."""
        portions = {name: float(values[-1]) for name, values in self.fractions.items() if values[-1] > 0.0}
        if len(portions) == 1:
            return f"{'' if self.summary.get('bodies') == 1 else 'all '}{next(iter(portions))}"
        return fractions_text(portions, len(portions))

    @cached_property
    def pair_friction(self) -> list[float]:
        """Friction coefficients of the debris against the plates given by the scene, unique, ascending."""
        plates = {plate.get("material") for plate in self.run.scene_tables.get("plates", {}).values()}
        debris = {part.get("material") for part in self.run.scene_tables.get("debris", ())}
        result = set()
        for pair in self.run.scene_tables.get("pairs", ()):
            first, second = pair["between"]
            if (first in plates and second in debris) or (second in plates and first in debris):
                result.add(float(pair["friction"]))
        return sorted(result)

    @cached_property
    def contact_groups(self) -> dict[str, np.ndarray]:
        """Contacts (C,), bool, of the bodies in each state; those between two bodies separately."""
        c = self.contacts
        between = c["partner"] >= 0 if "partner" in c else np.zeros(len(c["position"]), bool)
        if "body" not in c or "state" not in self.bodies:
            return {"all": np.ones(len(c["position"]), bool)}
        state = self.bodies["state"][c["body"]]
        groups = {name: ~between & (state == code) for code, name in enumerate(self.run.state_names)}
        return {name: members for name, members in (groups | {BETWEEN: between}).items() if members.any()}


class Panel(NamedTuple):
    """Panel: its name, height with title and axis [inch], why a run has no data for it (empty: it has), and its drawing.

    `draw` returns the title; `half`: it has half the width; `note` stands at the foot of the page. A panel is defined by
    `@partial(Panel, name, height, missing)` before its drawing.
    """

    name: str
    height: float
    missing: Callable[[RunData], str]
    draw: Callable[[Axes, RunData], str]
    half: bool = False
    note: str = ""


def no_labels(data: RunData) -> str:
    """Return why there is no panel of states, empty when the run has labels."""
    return "" if data.fractions else "its bodies were not labelled"


def label_axis(axes: Axes, data: RunData, ordinate: str) -> None:
    """Label a panel over the drag: its abscissa with the unit of its largest value."""
    axes.set_xlabel(f"{data.axis[2]} ({unit_for(data.axis[0], data.axis[1])[1]})")
    axes.set_ylabel(ordinate)


def draw_lines(
    axes: Axes, data: RunData, lines: Iterable[tuple[str | None, np.ndarray, str, str]], name: str, unit: str = ""
) -> None:
    """Draw lines over the drag, each with label, values (F,), colour and style; in the prefixed `unit` of the largest value."""
    lines = list(lines)
    factor, prefixed = unit_for(np.concatenate([values for _, values, _, _ in lines]), unit) if unit else (1.0, "")
    for label, values, color, style in lines:
        axes.plot(data.x, values / factor, color=LINES[color], linestyle=style, linewidth=1.4, label=label)
    label_axis(axes, data, f"{name} ({prefixed})".strip() if prefixed else name)
