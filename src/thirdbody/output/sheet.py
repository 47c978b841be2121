"""What the panels of a plot take from a run: series from the start of the drag on, the way of the plate, contacts of a frame."""

from __future__ import annotations

import tomllib
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .average import mean_and_error
from .palette import state_colors

if TYPE_CHECKING:
    from .run import Run

BACK = 0.05
"""A way back by this share of the range of displacement is a stroke."""


class Sheet:
    """One run, as its plots see it; contacts are those of `frame`. Raises IndexError for a frame outside the run."""

    def __init__(self, run: Run, frame: int = -1):
        self.run, self.frame = run, run.frame_number(frame)
        self.series, self.frames = run.series, run.frames
        self.summary = run.summary()
        self.colors = dict(zip(run.state_names, state_colors(run.state_names), strict=True))
        self.contacts = run.contacts(self.frame)
        self.bodies = run.bodies(self.frame)

    def name(self, name: str, shown: bool = True) -> np.ndarray:
        """One series by name, from the start of what is shown; NaN everywhere if the run has none."""
        values = self.series.get(name, np.full(self.frames, np.nan))
        return values[self.start :] if shown else values

    @cached_property
    def distance(self) -> np.ndarray:
        """Sliding distance (F,), m; zero without a drag."""
        return np.nan_to_num(self.series.get("distance", np.zeros(self.frames)))

    @property
    def dragged(self) -> bool:
        return bool(self.distance[-1] > 0.0)

    @cached_property
    def start(self) -> int:
        """The frame at which the drag starts, 0 without one: pressing stands before it."""
        if not self.dragged:
            return 0
        # settling ends within a step of the drag: the first frame well beyond that is the one after the start
        return max(int(np.argmax(self.distance > 1e-4 * self.distance[-1])) - 1, 0)

    @cached_property
    def steps(self) -> np.ndarray:
        """Change of displacement (F, 2) of the upper against the lower plate since the frame before, m; zero without plates."""
        corners = [self.run.plates(k)["position"] for k in range(self.frames)]
        if not len(corners[0]):
            return np.zeros((self.frames, 2))
        offset = np.array([points[4, :2] - points[0, :2] for points in corners])
        return np.diff(offset, axis=0, prepend=offset[:1])

    @cached_property
    def direction(self) -> np.ndarray:
        """Unit vector (2,) of the first motion, zero without one."""
        size = np.linalg.norm(self.steps, axis=1)
        moved = np.flatnonzero(size > 1e-9 * size.max(initial=0.0))
        return self.steps[moved[0]] / size[moved[0]] if len(moved) else np.zeros(2)

    @cached_property
    def displacement(self) -> np.ndarray:
        """Displacement of the upper plate along its first direction (F,), m."""
        return np.cumsum(self.steps @ self.direction)

    @cached_property
    def turns(self) -> list[int]:
        """Frames at which the plate turns back, by more than a share BACK of the range of its displacement."""
        u, turns = self.displacement, []
        back = BACK * float(np.ptp(u))
        best, sign = 0, 1.0
        for k in range(len(u)):
            if sign * (u[k] - u[best]) >= 0.0:
                best = k
            elif sign * (u[best] - u[k]) > back:
                turns.append(best)
                best, sign = k, -sign
        return turns

    @property
    def stroke(self) -> bool:
        """The plate goes back and forth."""
        return bool(self.turns)

    @cached_property
    def cycle(self) -> slice | None:
        """Frames of the last whole cycle, from one turn to the next of the same kind, both with; None before there is one."""
        return slice(self.turns[-3], self.turns[-1] + 1) if len(self.turns) >= 3 else None

    @cached_property
    def axis(self) -> tuple[np.ndarray, str, str]:
        """What the series are drawn over: values from `start` on, SI unit, and its name."""
        if self.dragged and not self.stroke:
            return self.distance[self.start :], "m", "sliding distance"
        times = self.run.times[self.start :]
        return times - times[0], "s", "time of the drag" if self.dragged else "time"

    @cached_property
    def judged(self) -> np.ndarray:
        """Frames (F,), bool, that the mean friction coefficient counts: loaded and dragged ones of the second half of the run."""
        moving = np.diff(self.distance, prepend=self.distance[:1]) > 0.0
        return moving & np.isfinite(self.name("friction_coefficient", False)) & (np.arange(self.frames) >= self.frames // 2)

    @cached_property
    def friction(self) -> tuple[float, float]:
        """Mean friction coefficient over the judged frames and the error of the mean; NaN without any."""
        return mean_and_error(self.name("friction_coefficient", False)[self.judged])

    @cached_property
    def fractions(self) -> dict[str, np.ndarray]:
        """Shares of the states (F,) by name, empty for a run without labels."""
        shares = {name: self.series.get(f"fraction_{name}") for name in self.run.state_names}
        return {name: values for name, values in shares.items() if values is not None}

    @cached_property
    def scene(self) -> dict[str, Any]:
        """The scene as tables, empty when it cannot be read."""
        try:
            return tomllib.loads(self.run.scene_text)
        except tomllib.TOMLDecodeError:
            return {}

    @cached_property
    def pair_friction(self) -> list[float]:
        """Friction coefficients of the debris against the plates, as the scene gives them, each once, from small to large."""
        plates = {plate.get("material") for plate in self.scene.get("plates", {}).values()}
        debris = {part.get("material") for part in self.scene.get("debris", ())}
        found = set()
        for pair in self.scene.get("pairs", ()):
            first, second = pair["between"]
            if (first in plates and second in debris) or (second in plates and first in debris):
                found.add(float(pair["friction"]))
        return sorted(found)

    @cached_property
    def contact_groups(self) -> dict[str, np.ndarray]:
        """Which contacts (C,), bool, belong to bodies in which state; those between two bodies stand apart."""
        c = self.contacts
        between = c["partner"] >= 0 if "partner" in c else np.zeros(len(c["position"]), bool)
        if "body" not in c or "state" not in self.bodies:
            return {"all": np.ones(len(c["position"]), bool)}
        state = self.bodies["state"][c["body"]]
        groups = {name: ~between & (state == code) for code, name in enumerate(self.run.state_names)}
        return {name: members for name, members in (groups | {BETWEEN: between}).items() if members.any()}


BETWEEN = "between two bodies"
