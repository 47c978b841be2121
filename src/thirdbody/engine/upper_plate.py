"""The upper first body: its patches, and schedules of how it is driven."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from thirdbody.kernels import schedule as motion
from thirdbody.kernels.columns import patch

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Segment:
    """One piece of a schedule (kinds and meaning of a, b, c: `kernels.schedule`); it holds until the next one starts, s."""

    start: float
    kind: int
    a: float
    b: float = 0.0
    c: float = 0.0

    def value(self, t: float) -> float:
        """Value at time t."""
        tau = t - self.start
        if self.kind == motion.SINE:
            return self.a + 0.5 * self.b * (1.0 - math.cos(self.c * tau))
        if self.kind == motion.TRIANGLE:
            phase = self.c * tau % 1.0
            return self.a + self.b * (2.0 * phase if phase < 0.5 else 2.0 - 2.0 * phase)
        return self.a + tau * (self.b + 0.5 * self.c * tau)

    def rate(self, t: float) -> float:
        """Rate of change at time t (of a triangle: to the right of its corners)."""
        tau = t - self.start
        if self.kind == motion.SINE:
            return 0.5 * self.b * self.c * math.sin(self.c * tau)
        if self.kind == motion.TRIANGLE:
            return 2.0 * self.b * self.c * (1.0 if self.c * tau % 1.0 < 0.5 else -1.0)
        return self.b + self.c * tau


Axis = tuple[Segment, ...]


@dataclass(frozen=True)
class Schedule:
    """What is prescribed: the sideways motion along x and y (m), the height of the plate (m), and its load over the first one."""

    x: Axis = ()
    y: Axis = ()
    gap: Axis = ()
    load: Axis = ()

    def tables(self) -> tuple[Array, Ints]:
        """The rows and their ranges as the kernels read them."""
        axes: Sequence[Axis] = (self.x, self.y, self.gap, self.load)
        rows = [[s.start, s.kind, s.a, s.b, s.c] for axis in axes for s in axis]
        first = np.concatenate(([0], np.cumsum([len(axis) for axis in axes]))).astype(np.int64)
        return np.array(rows, float).reshape(-1, motion.COLUMNS), first

    @property
    def moves(self) -> bool:
        """Whether anything moves sideways at all."""
        return any(s.kind != motion.POLYNOMIAL or s.b or s.c for s in (*self.x, *self.y))

    def direction(self) -> tuple[float, float]:
        """Unit vector of the first sideways motion, (0, 0) if there is none."""
        rates = [_first_rate(axis) for axis in (self.x, self.y)]
        starts = [start for start, rate in rates if rate]
        if not starts:
            return 0.0, 0.0
        v_x, v_y = (rate if rate and start <= min(starts) else 0.0 for start, rate in rates)
        speed = math.hypot(v_x, v_y)
        return v_x / speed, v_y / speed

    def place(self, t: float) -> tuple[float, float]:
        """Sideways displacement at time t, m."""
        return at_time(self.x, t), at_time(self.y, t)

    def top_speed(self) -> float:
        """Largest sideways speed, m/s."""
        return math.hypot(_top_rate(self.x), _top_rate(self.y))

    def largest_load(self, start: float = 0.0, end: float = math.inf) -> float:
        """Largest load over the first one between two times; 1 if the load does not change."""
        if not self.load:
            return 1.0
        first = max(_held(self.load, start), 0)
        largest = at_time(self.load, start)
        for s, after in zip_longest(self.load[first:], self.load[first + 1 :]):
            if s.start > end:
                break
            # pieces are straight: a piece is largest at one of its ends, before a jump too
            until = min(end, math.inf if after is None else after.start)
            largest = max(largest, s.value(max(s.start, start)), s.value(until) if math.isfinite(until) else 0.0)
        return largest

    def path(self, start: float, end: float) -> float:
        """Length of the sideways path between two times, m; good to 1e-6 of a stroke."""
        total = 0.0
        for begin, until, speed in self._pieces(start, end):
            if speed is not None:
                total += speed * (until - begin) if speed > 0.0 else 0.0
                continue
            cycles, cycle = self._cycles(begin, until)
            after = begin + cycles * cycle
            total += cycles * self._chorded(begin, begin + cycle) if cycles else 0.0
            total += self._chorded(after, until)
        return total

    def time_of(self, distance: float, start: float) -> float:
        """Time at which the sideways path since `start` reaches `distance`; infinite if the motion ends before."""
        if not self.moves:
            return math.inf
        left = distance
        for begin, until, speed in self._pieces(start, math.inf):
            if speed is not None:
                path = speed * (until - begin) if speed > 0.0 else 0.0
                if path >= left:
                    return begin + left / speed
                left -= path
                continue
            cycles, cycle = self._cycles(begin, until)
            if cycles:
                length = self._chorded(begin, begin + cycle)
                whole = min(math.floor(left / length) if length > 0.0 else cycles, cycles)
                begin, left = begin + whole * cycle, left - whole * length
            for t, after, length in self._chords(begin, until):
                if length >= left:
                    return t + (left / length * (after - t) if length > 0.0 else 0.0)
                left -= length
        return math.inf

    def _pieces(self, start: float, end: float) -> Iterator[tuple[float, float, float | None]]:
        """(begin, end, speed) of the pieces between which an axis changes its kind; speed None where it is not constant."""
        breaks = sorted({s.start for s in (*self.x, *self.y) if start < s.start < end})
        t = start
        for until in [*breaks, end]:
            rates = [_constant_rate(axis, t) for axis in (self.x, self.y)]
            yield t, until, None if None in rates else math.hypot(*rates)  # type: ignore[arg-type]
            t = until

    def _cycles(self, begin: float, until: float) -> tuple[float, float]:
        """How many whole cycles fit between two times of a piece (perhaps infinitely many), and the length of one, s.

        (0, 0) where the motion does not repeat.
        """
        axes = [axis for axis in (self.x, self.y) if _constant_rate(axis, begin) is None]
        cycles = {_period([s for s in axis if s.start <= begin][-1]) for axis in axes}
        if len(cycles) != 1 or 0.0 in cycles:
            return 0.0, 0.0
        cycle = cycles.pop()
        return (math.inf if math.isinf(until) else float(math.floor((until - begin) / cycle))), cycle

    def _chorded(self, begin: float, until: float) -> float:
        """Length of the path between two times of a piece, by chords, m."""
        return sum(length for _, _, length in self._chords(begin, until))

    def _chords(self, begin: float, until: float) -> Iterator[tuple[float, float, float]]:
        """(begin, end, length) of the chords of a piece."""
        chord = self._chord(begin) if begin < until else 0.0
        while begin < until:
            after = min(begin + chord, until)
            yield begin, after, math.dist(self.place(begin), self.place(after))
            begin = after

    def _chord(self, t: float) -> float:
        """A short time: a thousandth of a stroke's period, or of what is left of a ramp."""
        periods = []
        for axis in (self.x, self.y):
            held = [s for s in axis if s.start <= t]
            after = [s.start for s in axis if s.start > t]
            if held and _period(held[-1]) > 0.0:
                periods.append(_period(held[-1]))
            elif after:
                periods.append(after[0] - t)
        return 1e-3 * min(periods)


def _period(segment: Segment) -> float:
    """Time after which a segment repeats, s: 0 if it moves and never does, or rests."""
    if segment.kind == motion.SINE:
        return 2.0 * math.pi / segment.c
    return 1.0 / segment.c if segment.kind == motion.TRIANGLE else 0.0


def _constant_rate(axis: Axis, t: float) -> float | None:
    """The rate of an axis from t to its next segment if it is constant, else None."""
    held = [s for s in axis if s.start <= t]
    if not held:
        return 0.0
    return held[-1].b if held[-1].kind == motion.POLYNOMIAL and held[-1].c == 0.0 else None


def at_time(axis: Axis, t: float) -> float:
    """Value of an axis at time t; zero before its first segment."""
    row = _held(axis, t)
    return axis[row].value(t) if row >= 0 else 0.0


def ends_of(axis: Axis) -> Iterator[tuple[Segment, float]]:
    """Every segment with the time at which it ends, s; the last one with that of its start, for it goes on for ever."""
    for segment, after in zip_longest(axis, axis[1:]):
        yield segment, segment.start if after is None else after.start


def mean_value(axis: Axis, start: float, end: float) -> float:
    """Mean value between two times of an axis of straight pieces (loads); the present value where they are one."""
    if not end > start:
        return at_time(axis, end)
    corners = [start, *(s.start for s in axis if start < s.start < end), end]
    pieces = zip(corners, corners[1:], strict=False)
    return sum(0.5 * (at_time(axis, a) + value_before(axis, a, b)) * (b - a) for a, b in pieces) / (end - start)


def value_before(axis: Axis, t: float, end: float) -> float:
    """Value of an axis at `end` by the segment that holds at t: the one before a jump at `end`."""
    row = _held(axis, t)
    return axis[row].value(end) if row >= 0 else 0.0


def _held(axis: Axis, t: float) -> int:
    """Number of the segment that holds at time t, -1 before the first."""
    return bisect_right(axis, t, key=lambda segment: segment.start) - 1


def _first_rate(axis: Iterable[Segment]) -> tuple[float, float]:
    """Start and sign-giving rate of the first segment that moves."""
    for s in axis:
        if s.kind == motion.POLYNOMIAL:
            if s.b or s.c:
                return s.start, s.b or s.c
        else:
            return s.start, s.b * s.c
    return math.inf, 0.0


def _top_rate(axis: Axis) -> float:
    top = 0.0
    for s, after in zip_longest(axis, axis[1:]):
        if s.kind == motion.SINE:
            top = max(top, 0.5 * abs(s.b * s.c))
        elif s.kind == motion.TRIANGLE:
            top = max(top, 2.0 * abs(s.b * s.c))
        else:
            ends = [s.rate(s.start)] + ([s.rate(after.start)] if after else [])
            top = max(top, *(abs(rate) for rate in ends))
    return top


@dataclass(frozen=True)
class Foundation:
    """Every patch sprung to a common plate: stiffness per patch N/m, and the plate's own height, mass, damping and load."""

    stiffness: float
    height: float
    mass: float
    damping: float
    load: float
    free: bool


@dataclass(frozen=True)
class UpperPlate:
    """The upper first body as the engine needs it.

    Patches (one if rigid, one per body else) have heights, masses, dashpots and loads; those that are not `free` follow
    the schedule's gap. Time zero of the run is that of the schedule.
    """

    material: int
    heights: Array
    mass: Array
    damping: Array
    load: Array
    free: bool
    patch: Ints
    schedule: Schedule = field(default_factory=Schedule)
    foundation: Foundation | None = None

    def table(self) -> Array:
        """Rows of the patches, then that of the common plate if there is a foundation."""
        P = np.zeros((len(self.heights) + (self.foundation is not None), patch.WIDTH))
        n = len(self.heights)
        P[:n, patch.HEIGHT], P[:n, patch.MASS], P[:n, patch.DAMPING] = self.heights, self.mass, self.damping
        P[:n, patch.LOAD], P[:n, patch.FREE] = self.load, float(self.free)
        if self.foundation is not None:
            f = self.foundation
            P[:n, patch.SPRING] = f.stiffness
            P[n, patch.HEIGHT], P[n, patch.MASS], P[n, patch.DAMPING] = f.height, f.mass, f.damping
            P[n, patch.LOAD], P[n, patch.FREE] = f.load, float(f.free)
        P[:, patch.SEARCH_HEIGHT] = P[:, patch.HEIGHT]
        # what a changing load changes: that of the plate, or of patches that have no common one
        pressed = slice(0, n) if self.foundation is None else slice(n, n + 1)
        P[pressed, patch.NOMINAL_LOAD] = P[pressed, patch.LOAD]
        return P
