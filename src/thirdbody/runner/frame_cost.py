"""Cost of the frames of a run: bytes, and wall time of a few frames in a temporary folder."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from thirdbody.errors import OutputError
from thirdbody.trajectory.output_selection import CLUMPS, CONTACTS, SPHERES, Selection
from thirdbody.trajectory.polydata_block import Storage
from thirdbody.trajectory.reader import FILE_NAME
from thirdbody.trajectory.schema import Arrays, Frame

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

SECONDS, LARGEST_NUMBER = 0.3, 32
"""Seconds and largest number of frames of the measurement, without the first, which creates all arrays."""

CONTACTS_PER_BODY, SINGLE = 3, 4
"""Contacts of a body in an estimate; bytes of a number in single precision."""


class FrameCost(NamedTuple):
    """Wall time of a frame [s] (NaN if not measured), bytes of the file with one frame, and of every further frame."""

    seconds: float
    first_bytes: int
    bytes: int
    failure: str = ""  # why the time could not be measured


def frame_cost(built: Simulation) -> FrameCost:
    """Measure the cost of frames of a simulation after a trial."""
    from thirdbody.engine.guards import Ledger
    from thirdbody.runner.measurements import selection_of
    from thirdbody.runner.simulate import run_header
    from thirdbody.runner.yield_check import PeakPressure
    from thirdbody.trajectory.frame import FrameMaker
    from thirdbody.trajectory.writer import TrajectoryWriter

    integrator = built.integrator
    maker = FrameMaker(integrator.state, Ledger(integrator.state), built.labeller, integrator.drag)
    selection, maker.watch = selection_of(built.scene, maker), PeakPressure(built).update

    def frame() -> Frame:
        return maker.frame(integrator.label() if built.labeller else None)

    size = frame_bytes(frame(), selection)
    try:
        with tempfile.TemporaryDirectory(prefix="thirdbody") as folder:
            path, static = Path(folder) / FILE_NAME, selection.static(maker)
            with TrajectoryWriter(path, run_header(built), static, surfaces=built.surfaces, selection=selection) as writer:
                writer.append(frame())
                first = path.stat().st_size
                return FrameCost(_mean_seconds(lambda: writer.append(frame())), first, size)
    except (OSError, OutputError) as error:
        return FrameCost(math.nan, 0, size, str(error))


def _mean_seconds(write: Callable[[], None]) -> float:
    """Return the mean wall time of some calls [s]."""
    started, number = time.perf_counter(), 0
    while number < LARGEST_NUMBER and time.perf_counter() - started < SECONDS:
        write()
        number += 1
    return (time.perf_counter() - started) / number


def frame_bytes(frame: Frame, selection: Selection) -> int:
    """Return the bytes of such a frame, with its series, profiles and maps, and three contacts per body where contacts are
    written; before compression.
    """
    contacts = CONTACTS_PER_BODY * len(frame.clumps["points"]) if CONTACTS in selection.blocks else 0
    rows = {SPHERES: len(frame.spheres["points"]), CLUMPS: len(frame.clumps["points"]), CONTACTS: contacts}
    whole = sum(8 * np.size(values) for arrays in (frame.series, frame.profiles, frame.maps) for values in arrays.values())
    return whole + sum(
        count * width * (SINGLE if kind == "f" and _is_single(selection.storage(block), name) else size)
        for block, count in rows.items()
        for name, (kind, size, width) in _columns(frame.block(block)).items()
    )


def _columns(arrays: Arrays) -> dict[str, tuple[str, int, int]]:
    """Return kind of numbers, bytes of one, and numbers per row of each array."""
    return {name: (v.dtype.kind, v.dtype.itemsize, int(np.prod(v.shape[1:]))) for name, v in arrays.items()}


def _is_single(storage: Storage, name: str) -> bool:
    return storage.single_points if name == "points" else storage.single
