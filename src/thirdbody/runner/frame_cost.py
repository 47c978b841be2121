"""Cost of the frames of a run: bytes, and wall time of a few frames in a temporary folder."""

from __future__ import annotations

import math
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from thirdbody.errors import OutputError
from thirdbody.trajectory.reader import FILE_NAME

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation
    from thirdbody.engine.explicit import Explicit
    from thirdbody.engine.implicit import Implicit

SECONDS, LARGEST_NUMBER = 0.3, 32
"""Seconds and largest number of frames of the measurement, without the first, which creates all arrays."""


class FrameCost(NamedTuple):
    """Wall time of a frame [s] (NaN if not measured), bytes of the file with one frame, and of every further frame."""

    seconds: float
    first_bytes: int
    bytes: int
    failure: str = ""  # why the time could not be measured


def frame_cost(built: Simulation, integrator: Explicit | Implicit) -> FrameCost:
    """Measure the cost of frames of `integrator`, a trial copy of that of `built`."""
    try:
        with tempfile.TemporaryDirectory(prefix="thirdbody") as folder:
            seconds, first = _write_frames(built, integrator, Path(folder) / FILE_NAME)
        return FrameCost(seconds, first, frame_bytes(built))
    except (OSError, OutputError) as error:
        return FrameCost(math.nan, 0, frame_bytes(built), str(error))


def _write_frames(built: Simulation, integrator: Explicit | Implicit, path: Path) -> tuple[float, int]:
    """Return the seconds of a frame after the first one, and the bytes of the file with the first one."""
    from thirdbody.engine.energy import Ledger
    from thirdbody.runner.measurements import selection_of
    from thirdbody.runner.simulate import run_header
    from thirdbody.runner.yield_check import PeakPressure
    from thirdbody.trajectory.frame import FrameMaker
    from thirdbody.trajectory.writer import TrajectoryWriter

    state, pressure = integrator.state, PeakPressure(built)
    maker = FrameMaker(state, Ledger(state), built.labeller, integrator.drag)
    selection = selection_of(built.scene, maker)

    def write(writer: TrajectoryWriter) -> None:
        frame = maker.frame(integrator.label() if built.labeller else None)
        writer.append(selection.frame(frame))
        pressure.update(frame.contacts)

    static = selection.static(maker.static(), state)
    with TrajectoryWriter(path, run_header(built), static, surfaces=built.surfaces, selection=selection) as writer:
        write(writer)
        first, started, number = path.stat().st_size, time.perf_counter(), 0
        while number < LARGEST_NUMBER and time.perf_counter() - started < SECONDS:
            write(writer)
            number += 1
        return (time.perf_counter() - started) / number, first


def frame_bytes(built: Simulation) -> int:
    """Return the bytes of a frame, with three contacts per body."""
    state = built.state
    margins = 0 if built.labeller is None else len(built.labeller.margins) + len(built.labeller.extras)
    return state.n_bodies * (8 * (24 + margins) + 2 + 3 * 150) + state.n_spheres * (24 + 12 + 2)
