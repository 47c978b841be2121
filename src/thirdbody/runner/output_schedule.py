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

    A run by distance stops by distance, one by time stops by time. Stops in between only report progress.
    """
    output, settle, infinite = simulation.scene.output, simulation.settle, math.inf
    if output.every_kind == "time":
        settling, spacing = settling_frames(simulation)
        for x, write in _output_times(0.0, settling * output.every, spacing * output.every) if settling else ():
            yield x, infinite, write
        for x, write in _output_times(settling * output.every, simulation.planned_time, output.every):
            yield x, infinite if x < settle else simulation.end_distance, write
        return
    if settle > 0.0:
        for k in range(1, SUBTICKS + 1):
            yield settle * k / SUBTICKS, infinite, k == SUBTICKS
    by_time = math.isfinite(simulation.end_time)
    for x, write in _output_times(0.0, simulation.planned_distance, output.every):
        # a run by duration may end at rest: its last stop is its end time
        yield simulation.end_time, infinite if by_time and x >= simulation.planned_distance else x, write


def settling_frames(simulation: Simulation) -> tuple[int, int]:
    """Return (output intervals in a thinned settling phase, intervals per frame there); (0, 1) without thinning."""
    output, settle = simulation.scene.output, simulation.settle
    if output.every_kind != "time" or simulation.scene.solver.settle != "auto":
        return 0, 1
    whole = int(settle / output.every + 1e-9)
    return (whole, -(-whole // SETTLING)) if whole > SETTLING else (0, 1)


def _output_times(start: float, end: float, every: float) -> Iterator[tuple[float, bool]]:
    """Yield stops in (start, end]: outputs `every` apart and at the end, with reports in between."""
    for k in range(1, _number_of_outputs(start, end, every) + 1):
        low, high = start + (k - 1) * every, start + k * every
        # a stop that equals the end but for rounding is where a longer run has it too
        high = end if high > end + 1e-9 * every else high
        for part in range(1, SUBTICKS):
            yield low + (high - low) * part / SUBTICKS, False
        yield high, True


def _number_of_outputs(start: float, end: float, every: float) -> int:
    return max(1, int(np.ceil((end - start) / every - 1e-9)))


def planned_frames(simulation: Simulation) -> int:
    """Return the number of frames of a whole run: the outputs of `targets`, and the first frame."""
    output, settle = simulation.scene.output, simulation.settle
    if output.every_kind == "time":
        (settling, spacing), every = settling_frames(simulation), output.every
        thinned = _number_of_outputs(0.0, settling * every, spacing * every) if settling else 0
        return 1 + thinned + _number_of_outputs(settling * every, simulation.planned_time, every)
    settled = 1 if settle > 0.0 else 0
    return 1 + settled + _number_of_outputs(0.0, simulation.planned_distance, output.every)
