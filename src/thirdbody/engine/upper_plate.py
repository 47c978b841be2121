"""Upper plate: its patches, the schedules of its motion and load, and direct contact of both plates (`kernels.plates`)."""

import math
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from itertools import pairwise, zip_longest

import numpy as np

from thirdbody.engine.candidates import Array, Ints
from thirdbody.kernels import schedule as motion
from thirdbody.kernels.tables import patch, zone

ROUNDED, WHOLE = 1e-9, 1000
"""Relative difference below which two motions count as equal; largest number of cycles after which a path closes on itself."""

JUST_BEFORE = 1.0 - 1e-9
"""Factor of a time at which a plate has the speed with which it reaches that time, also at the turn of a stroke."""


@dataclass(frozen=True)
class Segment:
    start: float
    kind: int
    a: float
    b: float = 0.0
    c: float = 0.0

    def value(self, t: float) -> float:
        tau = t - self.start
        if self.kind == motion.SINE:
            return self.a + 0.5 * self.b * (1.0 - math.cos(self.c * tau))
        if self.kind == motion.TRIANGLE:
            phase = self.c * tau % 1.0
            return self.a + self.b * (2.0 * phase if phase < 0.5 else 2.0 - 2.0 * phase)
        return self.a + tau * (self.b + 0.5 * self.c * tau)

    def rate(self, t: float) -> float:
        """Return the rate of change at time t [s]; at corners of a triangle the right-hand one."""
        tau = t - self.start
        if self.kind == motion.SINE:
            return 0.5 * self.b * self.c * math.sin(self.c * tau)
        if self.kind == motion.TRIANGLE:
            return 2.0 * self.b * self.c * (1.0 if self.c * tau % 1.0 < 0.5 else -1.0)
        return self.b + self.c * tau


Axis = tuple[Segment, ...]


@dataclass(frozen=True)
class Schedule:
    """Prescribed lateral motion x, y [m], height of the plate [m], load over the initial load.

    `through`: stiffness of springs along x and y [N/m], through which that motion drives the plate; 0: the plate follows it."""

    x: Axis = ()
    y: Axis = ()
    gap: Axis = ()
    load: Axis = ()
    through: tuple[float, float] = (0.0, 0.0)

    def tables(self) -> tuple[Array, Ints]:
        axes = self.x, self.y, self.gap, self.load
        rows = [[s.start, s.kind, s.a, s.b, s.c] for axis in axes for s in axis]
        first = np.concatenate(([0], np.cumsum([len(axis) for axis in axes]))).astype(np.int64)
        return np.array(rows, float).reshape(-1, motion.COLUMNS), first

    @property
    def moves(self) -> bool:
        return _moving((*self.x, *self.y))

    @property
    def sprung(self) -> bool:
        return any(self.through)

    def direction(self) -> tuple[float, float]:
        """Return the unit vector of the first lateral motion, (0, 0) if there is none."""
        first = []  # start [s] and a rate of the right sign of the first segment of each axis that moves
        for axis in (self.x, self.y):
            s = next((s for s in axis if _moving((s,))), Segment(math.inf, motion.POLYNOMIAL, 0.0))
            first.append((s.start, (s.b or s.c) if s.kind == motion.POLYNOMIAL else s.b * s.c))
        earliest = min((start for start, rate in first if rate), default=math.inf)
        if math.isinf(earliest):
            return 0.0, 0.0
        v_x, v_y = (rate if start <= earliest else 0.0 for start, rate in first)
        speed = math.hypot(v_x, v_y)
        return v_x / speed, v_y / speed

    @cached_property
    def straight(self) -> bool:
        """Whether the plate moves along one line: both axes are multiples of the same motion, or one of them rests."""
        if not (_moving(self.x) and _moving(self.y)):
            return True
        if len(self.x) != len(self.y):
            return False
        e = self.direction()
        for s, q in zip(self.x, self.y, strict=True):
            pairs = [(s.a, q.a), (s.b, q.b), (s.c, q.c)]
            if s.kind != motion.POLYNOMIAL:
                if not math.isclose(s.c, q.c, rel_tol=ROUNDED):
                    return False
                pairs.pop()
            off = (abs(x * e[1] - y * e[0]) > ROUNDED * math.hypot(x, y) for x, y in pairs)
            if s.start != q.start or s.kind != q.kind or any(off):
                return False
        return True

    def heading_at(self, t: float) -> tuple[float, float]:
        """Return the unit vector of the motion just before time t [s]; of a straight path, or at rest, `direction()`."""
        if self.straight:
            return self.direction()
        v_x, v_y = (rate_before(axis, t) for axis in (self.x, self.y))
        speed = math.hypot(v_x, v_y)
        return (v_x / speed, v_y / speed) if speed > 0.0 else self.direction()

    def closed_paths(self, origin: float = 0.0) -> list[tuple[float, float, float]]:
        """Return start and end (possibly infinite) after `origin`, and period [s] of the intervals in which the path closes: each
        axis goes back and forth or rests, and the ratio of the periods of both is one of whole numbers up to WHOLE."""
        intervals = []
        starts = sorted({s.start for s in (*self.x, *self.y)})
        for begin, until in pairwise([*starts, math.inf]):
            valid = [_segment_at(axis, begin) for axis in (self.x, self.y)]
            periods = [_period(s) for s in valid if s and _moving((s,))]
            if not periods or 0.0 in periods:
                continue
            ratio = Fraction(periods[-1] / periods[0]).limit_denominator(WHOLE)
            if abs(periods[-1] / periods[0] - ratio) <= ROUNDED * ratio:
                intervals.append((begin - origin, until - origin, periods[0] * ratio.numerator))
        return intervals

    def displacement_at(self, t: float) -> tuple[float, float]:
        return at_time(self.x, t), at_time(self.y, t)

    def top_speed(self) -> float:
        return math.hypot(_top_rate(self.x), _top_rate(self.y))

    def largest_load(self, start: float = 0.0, end: float = math.inf) -> float:
        """Return the largest load over the initial one between two times [s]; 1 if the load does not change."""
        if not self.load:
            return 1.0
        largest = at_time(self.load, start)
        first = max(_segments_begun(self.load, start) - 1, 0)
        for s, after in zip_longest(self.load[first:], self.load[first + 1 :]):
            if s.start > end:
                break
            # segments are linear: the maximum is at one end, or just before a jump
            until = min(end, math.inf if after is None else after.start)
            largest = max(largest, s.value(max(s.start, start)), s.value(until) if math.isfinite(until) else 0.0)
        return largest

    def path(self, start: float, end: float) -> float:
        """Return the length [m] of the lateral path between two times [s], accurate to 1e-6 of a stroke."""
        total = 0.0
        for begin, until, speed in self._pieces(start, end):
            if speed is None:
                cycles, cycle = self._cycles(begin, until)
                total += cycles * self._chorded(begin, begin + cycle) if cycles else 0.0
                total += self._chorded(begin + cycles * cycle, until)
            elif speed > 0.0:
                total += speed * (until - begin)
        return total

    def time_of(self, distance: float, start: float) -> float:
        """Return the time [s] at which the path since `start` reaches `distance` [m], or infinity."""
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
        """Yield (begin, end, speed) of intervals without a new segment; speed None if not constant."""
        breaks = sorted({s.start for s in (*self.x, *self.y) if start < s.start < end})
        for t, until in pairwise([start, *breaks, end]):
            rates = [_constant_rate(axis, t) for axis in (self.x, self.y)]
            yield t, until, None if None in rates else math.hypot(*rates)  # type: ignore[arg-type]

    def _cycles(self, begin: float, until: float) -> tuple[float, float]:
        """Return the number of whole cycles in an interval, and the period [s]; (0, 0) where the motion is not periodic."""
        valid = [_segment_at(axis, begin) for axis in (self.x, self.y) if _constant_rate(axis, begin) is None]
        cycles = {_period(s) for s in valid if s}
        if len(cycles) != 1 or 0.0 in cycles:
            return 0.0, 0.0
        cycle = cycles.pop()
        return (math.inf if math.isinf(until) else float(math.floor((until - begin) / cycle))), cycle

    def _chorded(self, begin: float, until: float) -> float:
        return sum(length for _, _, length in self._chords(begin, until))

    def _chords(self, begin: float, until: float) -> Iterator[tuple[float, float, float]]:
        """Yield (begin, end, length) of the chords of an interval: a thousandth of the period, or of the rest of a ramp."""
        periods = []
        for axis in (self.x, self.y):
            valid, starts = _segment_at(axis, begin), [s.start for s in axis if s.start > begin]
            if valid and _period(valid) > 0.0:
                periods.append(_period(valid))
            elif starts:
                periods.append(starts[0] - begin)
        while begin < until:
            after = min(begin + 1e-3 * min(periods), until)
            yield begin, after, math.dist(self.displacement_at(begin), self.displacement_at(after))
            begin = after


def rate_before(axis: Axis, time: float) -> float:
    before = [segment for segment in axis if segment.start < time]
    return before[-1].rate(max(time * JUST_BEFORE, before[-1].start)) if before else 0.0


def _moving(axis: Axis) -> bool:
    return any(s.kind != motion.POLYNOMIAL or s.b or s.c for s in axis)


def _period(segment: Segment) -> float:
    if segment.kind == motion.SINE:
        return 2.0 * math.pi / segment.c
    return 1.0 / segment.c if segment.kind == motion.TRIANGLE else 0.0


def _constant_rate(axis: Axis, t: float) -> float | None:
    """Return the rate of an axis from t to its next segment if it is constant, otherwise None."""
    s = _segment_at(axis, t)
    if s is None:
        return 0.0
    return s.b if s.kind == motion.POLYNOMIAL and s.c == 0.0 else None


def at_time(axis: Axis, t: float) -> float:
    """Return the value of an axis at time t [s]; zero before its first segment."""
    return value_before(axis, t, t)


def ends_of(axis: Axis) -> Iterator[tuple[Segment, float]]:
    """Yield each segment and its end time [s]; the last one, which does not end, with its start time."""
    for segment, after in zip_longest(axis, axis[1:]):
        yield segment, segment.start if after is None else after.start


def mean_value(axis: Axis, start: float, end: float) -> float:
    """Return the mean of an axis of linear segments (loads) between two times; its value if equal."""
    if not end > start:
        return at_time(axis, end)
    corners = [start, *(s.start for s in axis if start < s.start < end), end]
    return sum(0.5 * (at_time(axis, a) + value_before(axis, a, b)) * (b - a) for a, b in pairwise(corners)) / (end - start)


def value_before(axis: Axis, t: float, end: float) -> float:
    """Return the value at `end` [s] of the segment valid at t: the value before a jump at `end`."""
    s = _segment_at(axis, t)
    return s.value(end) if s else 0.0


def _segment_at(axis: Axis, t: float) -> Segment | None:
    begun = _segments_begun(axis, t)
    return axis[begun - 1] if begun else None


def _segments_begun(axis: Axis, t: float) -> int:
    return bisect_right(axis, t, key=lambda segment: segment.start)


def _top_rate(axis: Axis) -> float:
    top = 0.0
    for s, after in zip_longest(axis, axis[1:]):
        if s.kind == motion.POLYNOMIAL:
            top = max(top, abs(s.rate(s.start)), abs(s.rate(after.start)) if after else 0.0)
        else:
            top = max(top, (0.5 if s.kind == motion.SINE else 2.0) * abs(s.b * s.c))
    return top


@dataclass(frozen=True)
class GapLaw:
    """Force at zero gap [N], length u_0 over which it falls by a factor e [m], friction coefficient."""

    prefactor: float
    length: float
    friction: float

    def force(self, gap: float) -> float:
        return self.prefactor * math.exp(-gap / self.length)

    def gap(self, load: float) -> float:
        return self.length * math.log(self.prefactor / load)


@dataclass(frozen=True)
class Foundation:
    """Common plate carried by springs: stiffness per patch [N/m]; height, mass, damping, load, SI."""

    stiffness: float
    height: float
    mass: float
    damping: float
    load: float
    free: bool


@dataclass(frozen=True)
class Zone:
    """Contact of the first bodies.

    Its table `row` (`kernels.contact_zone`), total load [N], half width [m], largest pressure [Pa], load of a patch under the
    reference pressure [N], gap at each patch at the start [m], largest part of the peak pressure at which a map ends within the
    domain, and friction coefficient of the first bodies. A body whose patch was outside for a path of the upper body of
    `out_after` [m] gets the codes `out` of state and reason.
    """

    row: Array
    load: float
    half_width: float
    peak: float
    nominal: float
    gaps: Array
    out_after: float
    border: float = 0.0
    friction: float = 0.0
    out: tuple[int, int] = (0, 0)

    @property
    def approach_scale(self) -> float:
        """a^2/R [m] of a ball or a cylinder, the scale of the approach of the first bodies; infinite where they are flat."""
        radius = float(self.row[zone.RADIUS])
        return self.half_width**2 / radius if radius > 0.0 else math.inf


@dataclass(frozen=True)
class PatchedPlate:
    """Upper plate: patches (one if it is rigid, otherwise one per body), which follow the schedule's gap unless `free`."""

    material: int
    heights: Array
    mass: Array
    damping: Array
    load: Array
    free: bool
    patch: Ints
    schedule: Schedule = field(default_factory=Schedule)
    foundation: Foundation | None = None
    direct: GapLaw | None = None
    zone: Zone | None = None

    def table(self) -> Array:
        P = np.zeros((len(self.heights) + (self.foundation is not None), patch.WIDTH))
        n = len(self.heights)
        P[:n, patch.HEIGHT], P[:n, patch.MASS], P[:n, patch.DAMPING] = self.heights, self.mass, self.damping
        P[:n, patch.LOAD], P[:n, patch.FREE] = self.load, float(self.free)
        if self.foundation is not None:
            f = self.foundation
            P[:n, patch.SPRING] = f.stiffness
            P[n, patch.HEIGHT], P[n, patch.MASS], P[n, patch.DAMPING] = f.height, f.mass, f.damping
            P[n, patch.LOAD], P[n, patch.FREE] = f.load, float(f.free)
        if self.direct is not None:
            P[-1, patch.DIRECT_PREFACTOR], P[-1, patch.DIRECT_LENGTH] = self.direct.prefactor, self.direct.length
            P[-1, patch.DIRECT_FRICTION] = self.direct.friction
        P[:, patch.SEARCH_HEIGHT] = P[:, patch.HEIGHT]
        # a load schedule scales the load of the common plate, or of the patches if there is none
        pressed = slice(0, n) if self.foundation is None else slice(n, n + 1)
        P[pressed, patch.NOMINAL_LOAD] = P[pressed, patch.LOAD]
        if self.zone is not None:
            P[:, patch.NOMINAL_LOAD], P[:, patch.INSIDE] = self.zone.nominal, self.load > 0.0
            P[:, patch.FIRST_LOAD] = self.load + (self.zone.load - self.load.sum()) / n
            P[:, patch.DIRECT_FRICTION], P[:, patch.OUTSIDE_HEIGHT] = self.zone.friction, self.heights - self.zone.gaps
            P[:, patch.EDGE2] = np.nan
        return P


def direct_reaction(row: Array, displacement: float) -> tuple[float, float]:
    """Return force [N] and stiffness [N/m] of direct contact of a plate that rises by a displacement [m]; row: of the patch."""
    if row[patch.DIRECT_PREFACTOR] == 0.0:
        return 0.0, 0.0
    force = float(row[patch.DIRECT_PREFACTOR] * np.exp(-(row[patch.HEIGHT] + displacement) / row[patch.DIRECT_LENGTH]))
    return force, force / float(row[patch.DIRECT_LENGTH])
