"""Motion of the upper plate over a run: distance, displacement, reversals, whole cycles of a stroke, the steady part.

A path along one line is signed by its first direction. One that is no straight line goes forward everywhere: its steps are
lengths of the path, and its cycles are those after which it closes on itself.
"""

from collections.abc import Mapping
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from thirdbody.trajectory.run_arrays import RunArrays
from thirdbody.units import parse

BACK = 0.05
"""A return by this fraction of the range of displacement is a stroke."""

CLOSED = 1e-3
"""A cycle is whole if it ends where it began, to this fraction of the range of displacement, or of its period."""


class Drag:
    """Motion of the upper plate relative to the lower one, by frame; `stored`: summary that the run stored at its end."""

    def __init__(self, run: RunArrays, stored: Mapping[str, Any] | None = None):
        self.run, self.frames, self.stored = run, run.frames, stored or {}

    @cached_property
    def distance(self) -> np.ndarray:
        """Sliding distance (F,) [m]; zero without drag."""
        return np.nan_to_num(self.run.series.get("distance", np.zeros(self.frames)))

    @cached_property
    def dragged(self) -> bool:
        """Whether the plate moved sideways at all."""
        return bool(self.frames and self.distance[-1] > 0.0)

    @cached_property
    def start(self) -> int:
        """Frame at which the drag starts, after pressing; 0 without drag."""
        if not self.dragged:
            return 0
        # settling ends within a step of the drag: the first frame well beyond that is the one after the start
        return max(int(np.argmax(self.distance > 1e-4 * self.distance[-1])) - 1, 0)

    @cached_property
    def begin(self) -> float:
        """Time at which settling ended [s]: of the scene or of the summary; else that of the frame `start`."""
        if "settling" in self.stored:
            return float(self.stored["settling"]["time"])
        try:
            return parse(str(self.run.scene_tables["solver"]["settle"]), "time")
        except (KeyError, TypeError, AttributeError, ValueError):
            return float(self.run.times[self.start]) if self.frames else 0.0

    @cached_property
    def during(self) -> np.ndarray:
        """Frames (F,), bool, of the drag: what tells its samples from those of settling, for all means over frames.

        Where settling ends within an output interval, the frame at the end of that interval holds means since then.
        """
        number = np.arange(self.frames)
        if self.dragged:
            return number > self.start
        # without sliding, what follows settling is what the loads do
        return (number > 0) & (np.roll(self.run.times, 1) >= self.begin * (1.0 - 1e-9))

    @cached_property
    def durations(self) -> np.ndarray:
        """Times over which the frames of the drag hold means (F,) [s]: since the previous frame, or since settling ended."""
        times = np.maximum(self.run.times, self.begin)
        return np.diff(times, prepend=times[:1])

    @cached_property
    def displacement(self) -> np.ndarray:
        """Displacement of the upper plate along its first direction of motion (F,) [m]; zero without plates."""
        recorded = self.run.series.get("displacement")
        if recorded is not None:
            return np.nan_to_num(recorded)
        # of the corners of the plates: runs of earlier versions lack the series
        steps = np.diff(self.offset, axis=0, prepend=self.offset[:1])
        size = np.linalg.norm(steps, axis=1)
        moved = np.flatnonzero(size > 1e-9 * size.max(initial=0.0))
        if not len(moved):
            return np.zeros(self.frames)
        return np.cumsum(steps @ (steps[moved[0]] / size[moved[0]]))

    @cached_property
    def straight(self) -> bool:
        """Whether the path is along one line."""
        return "closed_paths" not in self.run.header

    @cached_property
    def offset(self) -> np.ndarray:
        """Displacement of the upper plate along x and y (F, 2) [m]; zero without it."""
        corners = [self.run.plates(k)["position"] for k in range(self.frames)]
        if not corners or len(corners[0]) < 8:
            return np.zeros((self.frames, 2))
        return np.array([points[4, :2] - points[0, :2] for points in corners])

    @cached_property
    def headings(self) -> np.ndarray:
        """Unit vectors of the motion since the previous frame (F, 3), zero at rest; of a straight path its first direction,
        with the sign of the step."""
        moved = np.zeros((self.frames, 3))
        moved[1:, :2] = np.diff(self.offset, axis=0)
        if self.straight:
            moved = np.outer(np.sign(self.steps), moved[min(self.start + 1, self.frames - 1)])
        size = np.linalg.norm(moved, axis=1, keepdims=True)
        return np.divide(moved, size, out=np.zeros_like(moved), where=size > 0.0)

    @cached_property
    def steps(self) -> np.ndarray:
        """Change of displacement since the previous frame (F,) [m]; the length of a path that is no straight line."""
        position = self.displacement if self.straight else self.distance
        return np.diff(position, prepend=position[:1])

    @cached_property
    def reversals(self) -> list[int]:
        """Frames at which the plate reverses, by more than the fraction BACK of the range of its displacement."""
        u, reversals = self.displacement, []
        back = BACK * float(np.ptp(u)) if len(u) else 0.0
        best, sign = 0, 1.0
        for k in range(len(u)):
            if sign * (u[k] - u[best]) >= 0.0:
                best = k
            elif sign * (u[best] - u[k]) > back:
                reversals.append(best)
                best, sign = k, -sign
        return reversals

    @cached_property
    def stroke(self) -> bool:
        """Whether the plate moves back and forth; on a path that is no straight line, whether it closes on itself."""
        return bool(self.reversals if self.straight else self.run.header["closed_paths"])

    @cached_property
    def cycles(self) -> list[slice]:
        """Frames of the whole cycles, both ends included, in order; counted back from the last turn.

        Start and end of the drag count as turns where the plate is at the position of the nearest turn of the same kind. On a
        path that is no straight line cycles are counted from its start, and end at the nearest frames.
        """
        if not self.stroke:
            return []
        if not self.straight:
            times, cycles = self.run.times, []
            for begin, until, period in self.run.header["closed_paths"]:
                first = self.begin + begin
                number = int((min(self.begin + until, times[-1]) - first) / period + CLOSED)
                near_ends = [int(np.argmin(np.abs(times - first - k * period))) for k in range(max(number, 0) + 1)]
                cycles += [slice(low, high + 1) for low, high in pairwise(near_ends) if low < high]
            return cycles
        u, ends = self.displacement, [self.start, *self.reversals, self.frames - 1]
        near = CLOSED * float(np.ptp(u))
        whole_first, whole_last = abs(u[ends[0]] - u[ends[2]]) <= near, abs(u[ends[-1]] - u[ends[-3]]) <= near
        ends = ends[0 if whole_first else 1 : None if whole_last else -1]
        return [slice(ends[k - 2], ends[k] + 1) for k in range(len(ends) - 1, 1, -2)][::-1]

    @cached_property
    def second_half(self) -> np.ndarray:
        """Frames (F,), bool, whose output interval lies in the second half of the sliding distance, and in which the plate moved.

        Where the run is too short for one, the last interval.
        """
        before = np.concatenate([self.distance[:1], self.distance[:-1]])
        # with a margin for rounding: an output by distance ends within a step of it
        moved = self.distance > before
        inside = moved & (before >= 0.499 * self.distance[-1])
        if not inside.any():
            inside[np.flatnonzero(moved)[-1:]] = True
        return inside

    @cached_property
    def averaged(self) -> np.ndarray:
        """Frames (F,), bool, whose intervals enter the mean of one-way sliding: loaded ones of the second half."""
        mu = self.run.series.get("friction_coefficient", np.full(self.frames, np.nan))
        return self.second_half & np.isfinite(mu)

    @cached_property
    def steady(self) -> np.ndarray:
        """Frames (F,), bool, of the steady part: those that friction averages, without drag the later half of the rest."""
        if not self.dragged:
            late = np.flatnonzero(self.during)
            return np.arange(self.frames) >= (late[(len(late) - 1) // 2] if len(late) else self.frames - 1)
        frames = np.zeros(self.frames, bool)
        for cycle in self.cycles[len(self.cycles) // 2 :]:
            frames[cycle.start + 1 : cycle.stop] = True
        return frames if frames.any() else self.averaged
