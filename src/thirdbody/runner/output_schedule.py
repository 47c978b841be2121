"""Stops of a run: the end of settling, outputs, and stops in between for progress reports only."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

SUBTICKS = 8
"""Progress reports per output interval, so that a run with few frames shows progress too."""

SETTLING = 100
"""Largest number of frames of a settling phase of automatic length (`solver.settle = "auto"`).

Settling may last a million output intervals that suit the drag, and a frame costs more than the steps before it."""


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
        for x, write in _output_times(whole, last, 1, output.every, simulation.planned_time):
            yield x, simulation.end_distance, write
        return
    if settle > 0.0:
        for k in range(1, SUBTICKS):
            yield settle * k / SUBTICKS, infinite, False
        for end in _ends_of_settling(simulation):
            yield end, infinite, False
        yield simulation.settle, infinite, True
    by_time, last = math.isfinite(simulation.end_time), _number_of_outputs(simulation.planned_distance, output.every)
    for x, write in _output_times(0, last, 1, output.every, simulation.planned_distance):
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


def _number_of_outputs(end: float, every: float) -> int:
    return max(1, int(np.ceil(end / every - 1e-9)))


def planned_frames(simulation: Simulation) -> int:
    """Return the number of frames of a whole run: the outputs of `targets`, and the first frame."""
    output = simulation.scene.output
    if output.every_kind == "time":
        settling, spacing = settling_frames(simulation)
        return 1 + -(-settling // spacing) + _number_of_outputs(simulation.planned_time, output.every) - settling
    return 1 + int(simulation.settle > 0.0) + _number_of_outputs(simulation.planned_distance, output.every)
