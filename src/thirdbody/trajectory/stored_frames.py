"""Frames as the run file holds them, in the form that `TrajectoryWriter` accepts, for copies."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from thirdbody.trajectory.plate_maps import read_maps
from thirdbody.trajectory.run_arrays import RunArrays
from thirdbody.trajectory.schema import BLOCKS, POSITION, STATIC_TEXT, Frame
from thirdbody.trajectory.validate import damage_as_fault


def static_arrays(run: RunArrays) -> dict[str, dict[str, np.ndarray]]:
    """Return, per block, the arrays that hold for all frames."""
    names: Mapping[str, list[str]] = run.header[STATIC_TEXT]
    data = {block: run.file["VTKHDF"][block]["PointData"] for block in names}
    return {block: {name: data[block][name][()] for name in names[block]} for block in names}


def _read(run: RunArrays, name: str, number: int) -> dict[str, np.ndarray]:
    return run.stored[name].read(number, run.header[STATIC_TEXT].get(name, ()))


def stored_frame(run: RunArrays, frame: int) -> Frame:
    """Return one frame. Raises IndexError outside the run."""
    number = run.frame_number(frame)
    blocks = {}
    for name in BLOCKS:
        arrays = run.steady(partial(_read, run, name, number))
        blocks[name] = {("points" if k == POSITION else k): v for k, v in arrays.items()}
    series = {name: values[number] for name, values in run.series.items()}
    profiles = {name: values[number] for name, values in run.profiles.items()}
    profiles = {name: values.reshape(len(values), 9) if values.ndim == 3 else values for name, values in profiles.items()}
    with damage_as_fault(run.path, "the maps"):
        maps = run.steady(lambda: read_maps(run.file, number))
    return Frame(time=float(run.times[number]), series=series, profiles=profiles, maps=maps, **blocks)
