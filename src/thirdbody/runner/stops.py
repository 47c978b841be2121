"""Stops of a run: outputs, progress reports in between, and the end of settling, which is looked for where it is automatic."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thirdbody.engine.guards import stored_energies
from thirdbody.engine.state import State
from thirdbody.kernels.tables import body, patch, run_totals

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

SUBTICKS = 8
"""Progress reports per output interval, so that a run with few frames shows progress too."""

SETTLING = 100
"""Largest number of frames of a settling phase of automatic length (`solver.settle = "auto"`).

Settling may last a million output intervals that suit the drag, and a frame costs more than the steps before it."""

LONGEST, PERIODS = 3.0, 20.0
"""Latest end of settling, in expected times, or so many periods of the plate on its bed after the expected one if that is later:
a plate with critical dashpots on springs of which one in 200 carries load needs as many."""

LEAD, TINY = 0.25, 1e-300
"""Time before the end of settling at which an explicit run is looked at, in parts of the expected time (`EXTENSIONS`); guard of
divisions."""

EVEN = 1.0 + 1e-9
"""Factor for rounding: places this near to each other are one; and in the test whether the clock has reached a stop."""


def targets(simulation: Simulation) -> Iterator[tuple[float, float, bool]]:
    """Yield (time [s], distance [m], is_output) of every stop: the end of settling, then outputs.

    A run by distance stops by distance, one by time stops by time. Stops in between only report progress, but for one at each end
    of settling, which may move on while the run is on its way there.
    """
    output, settle, infinite = simulation.scene.output, simulation.settle, math.inf
    if output.every_kind == "time":
        whole, spacing = 0, settling_frames(simulation)[1]
        for end in _ends_of_settling(simulation):
            last = _whole_intervals(end, output.every)
            for x, write in _output_times(whole, last, spacing, output.every, end):
                yield x, infinite, write
            yield end, infinite, False
            whole = last
        last = max(whole + 1, _number_of_outputs(simulation.planned_time, output.every))
        for x, write in with_wear(simulation, _output_times(whole, last, 1, output.every, simulation.planned_time)):
            yield x, simulation.end_distance, write
        return
    if settle > 0.0:
        for k in range(1, SUBTICKS):
            yield settle * k / SUBTICKS, infinite, False
        for end in _ends_of_settling(simulation):
            yield end, infinite, False
        yield simulation.settle, infinite, True
    by_time, last = math.isfinite(simulation.end_time), _number_of_outputs(simulation.planned_distance, output.every)
    for x, write in with_wear(simulation, _output_times(0, last, 1, output.every, simulation.planned_distance)):
        # a run by duration may end at rest: its last stop is its end time
        yield simulation.end_time, infinite if by_time and x >= simulation.planned_distance else x, write


def _ends_of_settling(simulation: Simulation) -> Iterator[float]:
    """Yield the end of settling [s] and, while the run extends it, the later ones; none without settling."""
    extended = 0
    while simulation.settle > 0.0 and extended <= simulation.extended:
        yield simulation.settle_after(extended)
        extended += 1


def settling_frames(simulation: Simulation) -> tuple[int, int]:
    """Return (output intervals in a thinned settling phase, intervals per frame there); (0, 1) without thinning."""
    output = simulation.scene.output
    if output.every_kind != "time" or simulation.scene.solver.settle != "auto":
        return 0, 1
    expected = _whole_intervals(simulation.settle_after(0), output.every)
    whole = _whole_intervals(simulation.settle, output.every)
    return (whole, -(-expected // SETTLING)) if expected > SETTLING else (0, 1)


def _whole_intervals(time: float, every: float) -> int:
    return int(time / every + 1e-9)


def _output_times(first: int, last: int, spacing: int, every: float, end: float) -> Iterator[tuple[float, bool]]:
    """Yield stops after interval `first` up to interval `last` and `end` [s or m]: outputs `spacing` intervals apart and at the
    last one, with reports in between."""
    while first < last:
        after = min(first + spacing, last)
        low, high = first * every, after * every
        # a stop that equals the end but for rounding is where a longer run has it too
        high = end if high > end + 1e-9 * every else high
        for part in range(1, SUBTICKS):
            yield low + (high - low) * part / SUBTICKS, False
        yield high, True
        first = after


def wear_stop(simulation: Simulation, number: int) -> float:
    """Return where wear is taken from the plates for the so-manieth time: time [s], or sliding distance [m] of a run by distance;
    infinite without such wear, and beyond the cycles that it counts."""
    if (given := simulation.scene.plates.wear) is None:
        return math.inf
    schedule, settle, by_time = simulation.schedule, simulation.settle, simulation.scene.output.every_kind == "time"
    if given.distance is not None:
        return schedule.time_of(number * given.distance, settle) if by_time else number * given.distance
    begin, until, period = schedule.closed_paths(settle)[0]
    time = begin + number * (given.cycles or 1) * period
    if time > until * EVEN:
        return math.inf
    return settle + time if by_time else schedule.path(settle, settle + time)


def with_wear(simulation: Simulation, stops: Iterator[tuple[float, bool]]) -> Iterator[tuple[float, bool]]:
    """Yield stops, and between them those at which wear is taken from the plates."""
    number = 1
    for x, write in stops:
        while (stop := wear_stop(simulation, number)) <= x * EVEN:
            if stop * EVEN < x:
                yield stop, False
            number += 1
        yield x, write


def _number_of_outputs(end: float, every: float) -> int:
    return max(1, int(np.ceil(end / every - 1e-9)))


def planned_frames(simulation: Simulation) -> int:
    """Return the number of frames of a whole run: the outputs of `targets`, and the first frame."""
    output = simulation.scene.output
    if output.every_kind == "time":
        settling, spacing = settling_frames(simulation)
        return 1 + -(-settling // spacing) + _number_of_outputs(simulation.planned_time, output.every) - settling
    return 1 + int(simulation.settle > 0.0) + _number_of_outputs(simulation.planned_distance, output.every)


class Unrest(NamedTuple):
    """What still changes, as fractions.

    `load`: load that nothing carries yet, over the load, or what debris takes of it, over the load on debris, if that is larger;
    `gap`: its change at the present speed in the expected settling time; `bounce`: change of the load by a common rise and fall
    of plate and debris at their present speed; `kinetic`: change of the kinetic energy since the last look, or all of it if that
    is less, over the elastic energy.
    """

    load: float
    gap: float
    bounce: float
    kinetic: float

    @property
    def steady(self) -> bool:
        """Whether the scene has settled."""
        return all(now <= limit for now, limit in zip(self, SETTLED, strict=True))


SETTLED = Unrest(load=0.01, gap=0.01, bounce=0.01, kinetic=0.02)
"""Largest unrest of a settled scene.

The first three are a half of the 2 % by which load on debris and gap may still change: what is left of a decay is less than its
rate times the expected settling time. Loose bodies hop between rough plates for ever: their energy is steady."""


def unrest(state: State, time: float, before: float) -> tuple[Unrest, float]:
    """Return what still changes under an upper plate, and the period of the plate on its bed [s], at a synchronised instant.

    `time`: expected settling time [s]; `before`: kinetic energy at the last look, 0 at the first [J].
    """
    P, A, B = state.P, state.A, state.B
    free, plate = P[:, patch.FREE], P[-1]
    load = float(free @ P[:, patch.LOAD])
    if not plate[patch.FREE]:  # springs below a held plate press the patches
        load += float(np.sum(P[:, patch.SPRING] * (plate[patch.HEIGHT] - P[:, patch.HEIGHT])))
    debris, direct = float(A[run_totals.UPPER_FORCE + 2]), float(A[run_totals.DIRECT_FORCE + 2])
    if state.world.zone is not None:  # direct contact carries what is left to it at any height
        load, direct = float(P[:, patch.LOAD] @ (P[:, patch.INSIDE] > 0.0)), 0.0
    kinetic, *stored, shared, _ = stored_energies(state)
    springs = max(sum(map(abs, stored)), TINY)  # that of adhesion is negative
    load, elastic, mass = max(abs(load), TINY), springs + shared, float(free @ P[:, patch.MASS])
    left = abs(debris + direct - load)
    # what debris takes of it, by the stiffness of springs that hold the energies; that of Hertz's contacts is 1.2 times as large
    own, other = debris * debris / (2.0 * springs), direct * direct / max(shared, TINY)
    on_debris = left * own / max(own + other, TINY) / debris if debris > 0.0 else 0.0
    own_loads = state.world.upper is not None and state.world.upper.foundation is None and len(state.world.upper.heights) > 1
    height, speed = P[:, (patch.HEIGHT, patch.VELOCITY)].mean(axis=0) if own_loads else plate[[patch.HEIGHT, patch.VELOCITY]]
    common = 0.0
    if state.inertial:
        momentum = float(free @ (P[:, patch.MASS] * P[:, patch.VELOCITY])) + float(B[:, body.MASS] @ B[:, body.VELOCITY + 2])
        common = 0.5 * momentum**2 / (mass + float(B[:, body.MASS].sum()))
    change = min(kinetic, abs(kinetic - before))
    gap_change = abs(speed) * time / max(abs(height), TINY)
    now = Unrest(max(left / load, on_debris), gap_change, math.sqrt(common / elastic), change / elastic)
    return now, 2.0 * math.pi * math.sqrt(2.0 * elastic * mass) / load


class Settling:
    """Looks at a scene that settles, and lets settling last longer until it is steady.

    The expected time is the shortest. The explicit integrator passes a stop by part of a step, so it is looked at `LEAD` before
    the end; steps of the implicit one end there. `begin_drag` is called at the end of settling, once.
    """

    def __init__(self, simulation: Simulation, begin_drag: Callable[[], None]) -> None:
        self.simulation, self.begin_drag, self.dragged = simulation, begin_drag, False
        upper, self.expected = simulation.scene.plates.upper, simulation.upper.settle
        self.sought = simulation.scene.solver.settle == "auto" and self.expected > 0.0 and upper is not None and not upper.closing
        self.last: Unrest | None = None
        self.period, self.kinetic = math.nan, 0.0

    def advance(self, target: tuple[float, float, bool], advance_to: Callable[[float, float], None]) -> None:
        """Advance to a stop of `targets`, with looks on the way there."""
        (time, distance, is_output), integrator = target, self.simulation.integrator
        for instant in self._instants(time):
            advance_to(instant, math.inf)
        if is_output or integrator.divisible or time == self.simulation.settle or self.wears(target):
            advance_to(time, distance)

    def wears(self, target: tuple[float, float, bool]) -> bool:
        """Return whether wear is due to be taken from the plates at a stop."""
        simulation, wear = self.simulation, self.simulation.state.wear
        if wear is None or not self.dragged:
            return False
        by_time = simulation.scene.output.every_kind == "time"
        now = target[0] if by_time else min(target[1], simulation.planned_distance)
        return now * EVEN >= wear_stop(simulation, int(wear.totals[0]) + 1)

    def _instants(self, until: float) -> Iterator[float]:
        """Yield the instants up to `until` [s] at which the scene is judged."""
        simulation = self.simulation
        while self.sought:
            instant = simulation.settle_after(simulation.extended - (LEAD if simulation.integrator.divisible else 0.0))
            if instant > until:
                return
            yield instant
            self.last, self.period = unrest(simulation.state, self.expected, self.kinetic)
            self.kinetic = stored_energies(simulation.state)[0]
            longest = max(LONGEST * self.expected, self.expected + PERIODS * self.period)
            in_time = simulation.state.time <= simulation.settle and simulation.settle_after(simulation.extended + 1) <= longest
            self.sought = not self.last.steady and in_time
            if self.sought:
                simulation.extend_settling(simulation.extended + 1)
        if until > simulation.settle and not self.dragged:
            self.dragged = True
            self.begin_drag()

    def export_state(self) -> dict[str, Any]:
        """Return what goes on with a run, as plain numbers."""
        names = ("sought", "dragged", "last", "period", "kinetic")
        return {"extended": self.simulation.extended, **{name: getattr(self, name) for name in names}}

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore the result of `export_state`."""
        if saved["extended"]:
            self.simulation.extend_settling(saved["extended"])
        self.sought, self.dragged, self.period, self.kinetic = (saved[k] for k in ("sought", "dragged", "period", "kinetic"))
        self.last = None if saved["last"] is None else Unrest(*saved["last"])

    def summary(self) -> dict[str, Any]:
        """Return the entry of the summary of a run; empty without settling of automatic length, or before its end."""
        if self.last is None or self.sought:
            return {}
        time = self.simulation.settle
        return {"settling": {"time": time, "steady": self.last.steady, "periods": time / self.period, **self.last._asdict()}}
