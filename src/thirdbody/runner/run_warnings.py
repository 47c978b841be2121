"""Warnings before a run starts, from a short trial: long run, large output, early stop."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from thirdbody.runner.output_schedule import settling_frames
from thirdbody.units import duration, file_size, pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

LONG = 86400.0
"""Wall time of a run that gives a warning [s]: a day."""

LARGE = 10e9
"""Size of a trajectory that gives a warning [bytes]; also the size with the suggested interval."""


def run_warnings(built: Simulation, wall: float, framing: float, disk: float, stopped: str) -> Iterator[str]:
    """Yield warnings from estimates of a trial.

    wall: wall time [s]; framing: its part for frames [s]; disk: trajectory [bytes]; stopped: message of a guard that stopped the
    trial.
    """
    if stopped:
        yield f"a trial of the first steps was stopped by a guard, and so will the run be: {stopped}"
    settling, spacing = settling_frames(built)
    if settling:
        yield (
            f"settling takes {settling} output intervals: one in {spacing} of them ends with a frame, in the drag all do "
            "(all do from the start where solver.settle is a time)"
        )
    if framing > max(LONG, 0.5 * wall):
        yield (
            f"frames would take about {duration(framing)} ({framing:.2g} s) of {duration(wall)}: "
            f'output.every = "{_wider(built, framing / LONG)}" leaves {duration(LONG)} or less'
        )
    elif wall > LONG:
        yield (
            f"a run would take about {duration(wall)} ({wall:.2g} s) on one core: lower {_lengths(built)} or the number of "
            "bodies; thirdbody cost compares cheaper laws, steps and integrators"
        )
    if disk > LARGE:
        every = _wider(built, disk / LARGE)
        yield (
            f'the trajectory would take about {file_size(disk)} on disk: output.every = "{every}" leaves {file_size(LARGE)} '
            f"or less"
        )


def _wider(built: Simulation, times: float) -> str:
    """Return the output interval, with its unit, that leaves one frame out of `times` present ones."""
    output = built.scene.output
    # below a time step the interval makes no difference
    every = max(output.every, built.shortest_interval) * math.ceil(times)
    by_time = output.every_kind == "time"
    return pretty(every * built.time_scale if by_time else every, "time" if by_time else "length")


def _lengths(built: Simulation) -> str:
    """Return the key of the scene that gives the length of the run."""
    return "solver.distance" if built.scene.solver.distance is not None else "solver.duration"
