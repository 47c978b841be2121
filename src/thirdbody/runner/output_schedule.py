"""Where a run stops on its way: the end of settling, outputs, and looks in between that only tell how far it is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

SUBTICKS = 8
"""Reports of progress per output interval: a run with few frames still shows that it moves."""

SETTLING = 100
"""Most frames while the debris settles for a time that the program chooses (`solver.settle = "auto"`). It may be a million times
as long as an output interval that fits the drag, and a frame costs more than the steps before it."""


def targets(simulation: Simulation) -> Iterator[tuple[float, float, bool]]:
    """(time, distance, whether to write) of every stop: the end of settling, then output by output to the end.

    A run by distance stops by distance; one by time stops by time. Stops in between only report progress.
    """
    output, settle, infinite = simulation.scene.output, simulation.settle, math.inf
    if output.every_kind == "time":
        settling, spacing = settling_frames(simulation)
        for x, write in _ladder(0.0, settling * output.every, spacing * output.every) if settling else ():
            yield x, infinite, write
        for x, write in _ladder(settling * output.every, simulation.planned_time, output.every):
            yield x, infinite if x < settle else simulation.end_distance, write
        return
    if settle > 0.0:
        for k in range(1, SUBTICKS + 1):
            yield settle * k / SUBTICKS, infinite, k == SUBTICKS
    by_time = math.isfinite(simulation.end_time)
    for x, write in _ladder(0.0, simulation.planned_distance, output.every):
        # a run by duration may end with a rest: its last stop is its end
        yield simulation.end_time, infinite if by_time and x >= simulation.planned_distance else x, write


def settling_frames(simulation: Simulation) -> tuple[int, int]:
    """Output intervals of a thinned-out settling phase, and how many of them lie between two frames there; (0, 1) without one."""
    output, settle = simulation.scene.output, simulation.settle
    if output.every_kind != "time" or simulation.scene.solver.settle != "auto":
        return 0, 1
    whole = int(settle / output.every + 1e-9)
    return (whole, -(-whole // SETTLING)) if whole > SETTLING else (0, 1)


def _ladder(start: float, end: float, every: float) -> Iterator[tuple[float, bool]]:
    """Stops from start (excluded) to end: every `every` a written one, with reports between; the end is written."""
    for k in range(1, _rungs(start, end, every) + 1):
        low, high = start + (k - 1) * every, start + k * every
        # a rung that is the end but for rounding is where a longer run has it too
        high = end if high > end + 1e-9 * every else high
        for part in range(1, SUBTICKS):
            yield low + (high - low) * part / SUBTICKS, False
        yield high, True


def _rungs(start: float, end: float, every: float) -> int:
    return max(1, int(np.ceil((end - start) / every - 1e-9)))


def planned_frames(simulation: Simulation) -> int:
    """Frames that a whole run writes: what `targets` yields to write, and the first."""
    output, settle = simulation.scene.output, simulation.settle
    if output.every_kind == "time":
        (settling, spacing), every = settling_frames(simulation), output.every
        thinned = _rungs(0.0, settling * every, spacing * every) if settling else 0
        return 1 + thinned + _rungs(settling * every, simulation.planned_time, every)
    settled = 1 if settle > 0.0 else 0
    return 1 + settled + _rungs(0.0, simulation.planned_distance, output.every)
