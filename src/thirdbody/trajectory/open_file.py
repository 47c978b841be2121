"""File of a run, open for reading while its run may still be writing: failed reads are repeated, and what it claims is checked.

Nothing is allocated on the claims of a damaged file, and no code is loaded that it names.
"""

import io
import json
import os
import sys
import time
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np

from thirdbody.errors import InputError
from thirdbody.trajectory.names import BLOCKS, MAPS, PLATES, PROFILE_GROUP, STATIC_TEXT, SURFACES

FILE_NAME = "run.vtkhdf"
TRIES, PAUSE = 10, 0.05
"""Number of tries to read a file that keeps changing, and the pause between two [s]: a frame is written within some ms."""

_SIGNATURE = b"\x89HDF\r\n\x1a\n"

Result = TypeVar("Result")

DENSEST = 1100
"""Largest ratio of stored numbers to bytes in the file: deflate reaches at most 1032 to 1."""

UNASKED = 1 << 26
"""Size in bytes below which storage is not checked."""

WIDEST = 64
"""Largest number of values in one row of an array: vectors and quaternions have 3 and 4."""

NUMBERED = ("id", "body", "partner", "side", "state", "state_reason", "population", "material", "sliding_side", "forecast")
"""Arrays of codes and numbers of bodies."""

_FILTERS = (h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32)

_HEADER: dict[str, type] = {
    "scene_text": str, "title": str, "state_names": list, "reason_names": list, "units": dict, "meanings": dict, "domain": dict,
    "materials": list, "populations": list,
    "laws": list, "law": dict, "effects": list, "integrator": dict, "debris_contact": str, "warnings": list, "versions": dict,
    STATIC_TEXT: dict, PROFILE_GROUP: dict, "measures": list, "blocks": list, "scene_bodies": int,
    "closed_paths": list,
}  # fmt: skip
_WORDS = ("blocks", "state_names", "reason_names", "materials", "populations", "effects", "measures", "warnings")

DAMAGE = (KeyError, IndexError, AttributeError, OSError, RuntimeError, ValueError, TypeError, OverflowError, MemoryError)
"""Errors that h5py, json and numpy raise for a damaged file."""


class ClosedRun(ValueError):
    """Error: the run was closed before this was read."""


@contextmanager
def damage_as_fault(path: Path | str, where: str = "") -> Iterator[None]:
    """Turn any error from reading a damaged file into one InputError with its place."""
    try:
        yield
    except (InputError, ClosedRun):
        raise
    except DAMAGE as error:
        reason = f"{type(error).__name__}: {error}".splitlines()[0][:200]
        at = f" at {where}" if where else ""
        raise InputError(f"{path}: not a run of thirdbody, or damaged{at} ({reason})") from error


def refuse_loaded_code(_: str, node: h5py.HLObject) -> None:
    """Raise ValueError for a filter that is not part of HDF5 itself, which it would look for as a library and run."""
    if not isinstance(node, h5py.Dataset):
        return
    plan = node.id.get_create_plist()
    for index in range(plan.get_nfilters()):
        if (number := plan.get_filter(index)[0]) not in _FILTERS:
            raise ValueError(f"{node.name} needs the filter {number}, which is not used by runs")


class OpenFile:
    """Run file, whose HDF5 `file` may be reopened. Raises InputError when there is none."""

    file: h5py.File

    def __init__(self, path: Path):
        if not os.path.isfile(path):  # False also for a name that the system refuses
            raise InputError(f"{path}: no such run; give the folder of a run or its {FILE_NAME}")
        self.path = path
        # Opened through a separate file object: for one path HDF5 gives all readers in a process the data cached by the first of
        # them, however much was written since. It locks no file either, so a run can be read while it is written.
        try:
            self._stream = io.FileIO(path)
        except OSError as error:
            raise InputError(f"{path}: the file cannot be opened ({error})") from error
        # closed at the latest at exit: later HDF5 would use the stream of an interpreter that is gone, a segmentation fault
        self._opened: list[Any] = [self._stream]
        weakref.finalize(self, _close, self._opened)

    def _connect(self) -> None:
        """Open the file, or reopen it. Raises InputError when it is not HDF5 or needs foreign code."""
        _close(self._opened[1:])
        self._stream.seek(0)
        if self._stream.read(len(_SIGNATURE)) != _SIGNATURE:
            raise InputError(f"{self.path}: not a run of thirdbody (not an HDF5 file)")
        try:
            self.file = h5py.File(self._stream, "r")
        except OSError as error:
            what = "is cut short" if "truncated" in str(error) else "cannot be opened"
            raise InputError(f"{self.path}: the file {what} ({error})") from error
        self._opened[1:] = [self.file]
        with damage_as_fault(self.path):
            self.file.visititems(refuse_loaded_code)

    def steady(self, read: Callable[[], Result]) -> Result:
        """Return the result of `read`; open the file before, or where it fails open it again and repeat it.

        Raises the errors of `read` for a file that does not change; InputError with the advice to try again for one that is being
        written.
        """
        for number in range(TRIES):
            if self._stream.closed:
                raise ClosedRun(f"{self.path}: this run was closed; open it again")
            before = self._stamp()
            try:
                if number or len(self._opened) == 1:
                    self._connect()
                return read()
            except InputError:
                time.sleep(PAUSE)
                # at least one retry: a half-written file may have been completed within one tick of the file clock
                if number and self._stamp() == before:
                    raise
        raise InputError(f"{self.path}: is being written, and changed whenever it was read; try again in a moment")

    def _stamp(self) -> tuple[int, int]:
        state = os.fstat(self._stream.fileno())
        return state.st_mtime_ns, state.st_size

    def close(self) -> None:
        """Close the file; may be called twice."""
        _close(self._opened)


def _close(opened: list[Any]) -> None:
    for file in reversed(opened):
        file.close()


def refuse_false_texts(group: h5py.Group) -> None:
    """Raise ValueError for a text that claims more than its file has, TypeError for what is none."""
    for dataset in group.values():
        kind = dataset.id.get_type() if isinstance(dataset, h5py.Dataset) and dataset.shape == () else None
        if kind is None or kind.get_class() != h5py.h5t.STRING or kind.is_variable_str():
            raise TypeError(f"{dataset.name} is no text of fixed length")
        size, there = kind.get_size(), dataset.file.id.get_filesize()
        if size > there:
            raise ValueError(f"{dataset.name} claims {size:.3g} bytes, and the whole file has {there:.3g}")


def read_text(dataset: h5py.Dataset) -> Any:
    """Return the text, or its content if it is JSON."""
    text = dataset[()].decode("utf-8")
    return json.loads(text) if dataset.attrs["json"] else text


def refuse_unsound(file: h5py.File, header: Mapping[str, Any], frames: int) -> None:
    """Raise ValueError, TypeError or KeyError for a file that does not have the form `TrajectoryWriter` writes."""
    if frames < 0:
        raise ValueError(f"{frames} frames")
    _refuse_header(header)
    for name in BLOCKS:
        _refuse_block(file["VTKHDF"][name], tuple(header[STATIC_TEXT].get(name, ())), frames)
    for side, heights in file.get(SURFACES, {}).items():
        if side not in PLATES or min(_sound(heights, len(heights), "f", 2, sys.maxsize).shape) < 4:
            raise ValueError(f"{heights.name} is no surface of a plate")
        for name in ("size", "copies"):
            if heights.attrs[name].shape != (2,) or not np.all((heights.attrs[name] > 0) & np.isfinite(heights.attrs[name])):
                raise ValueError(f"{heights.name}: {name} {str(heights.attrs[name])[:60]}")
    rows_of = {"series": 1, PROFILE_GROUP: header.get(PROFILE_GROUP, {"bins": 0})["bins"], MAPS: 2}
    for group, rows in rows_of.items():
        for values in file.get(group, {}).values():
            if group == MAPS:
                rows = int(values.attrs["rows"])
                if rows < 2 or rows % 2 or not _sound(values, frames * rows, "f", 2, sys.maxsize).shape[1]:
                    raise ValueError(f"{values.name} is no map of plates")
            else:
                _sound(values, frames * rows)
            if not isinstance(values.attrs["units"], str):
                raise TypeError(f"{values.name} has no units")


def _refuse_header(header: Mapping[str, Any]) -> None:
    for name, kind in _HEADER.items():
        if name in header and not isinstance(header[name], kind):
            raise TypeError(f"/scene/{name} is no {kind.__name__}")
    for name in _WORDS:
        if not all(isinstance(word, str) for word in header.get(name, ())):
            raise TypeError(f"/scene/{name} holds other than texts")
    for name, words in header[STATIC_TEXT].items():
        if name not in BLOCKS or not isinstance(words, list) or not all(isinstance(word, str) for word in words):
            raise TypeError(f"/scene/{STATIC_TEXT} names no arrays of {name}")
    if not all(isinstance(unit, str) for unit in header["units"].values()):
        raise TypeError("/scene/units holds other than texts")
    slabs = header.get(PROFILE_GROUP, {"bins": 1, "axis": "z"})
    if not isinstance(slabs["bins"], int) or slabs["bins"] < 1 or slabs["axis"] not in ("x", "y", "z"):
        raise ValueError(f"/scene/{PROFILE_GROUP}: {str(slabs)[:60]}")
    for begin, until, period in header.get("closed_paths", ()):
        if not (0.0 <= begin < until and 0.0 < period < np.inf):
            raise ValueError(f"/scene/closed_paths: {begin}, {until}, {period}")
    size = (header.get("domain") or {"size": [1.0, 1.0]})["size"]
    if len(size) != 2 or not all(isinstance(x, int | float) and 0.0 < x < np.inf for x in size):
        raise ValueError(f"/scene/domain: size {str(size)[:60]}")


def _refuse_block(block: h5py.Group, static: tuple[str, ...], frames: int) -> None:
    steps, data = block["Steps"], block["PointData"]
    times = _sound(steps["Values"], frames, "f", 1)[:frames]
    if not (np.diff(times) > 0.0).all():
        raise ValueError(f"{steps.name}/Values: its times do not grow")
    parts = _whole(steps["PartOffsets"], frames)
    counts = _sound(block["NumberOfPoints"], 0, "iu", 1)
    if frames and not parts.max() < len(counts):
        raise ValueError(f"{block.name} names frames that are not there")
    rows = counts[: int(parts.max()) + 1][parts] if frames else parts
    if frames and rows.min() < 0:
        raise ValueError(f"{block.name} has frames of {rows.min()} points")
    if block.name.endswith("clumps") and frames and rows.min() != rows.max():
        raise ValueError(f"{block.name} has another number of bodies in some frames")
    ends = _whole(steps["PointOffsets"], frames) + rows
    points = _sound(block["Points"], int(ends.max(initial=0)), "f", 2)
    if points.shape[1] != 3:
        raise ValueError(f"{points.name} has rows of {points.shape[1]}")
    for name in data:
        starts = _whole(steps["PointDataOffsets"][name], frames)
        if name not in static and frames and block.name.endswith("clumps") and (starts != np.arange(frames) * rows).any():
            raise ValueError(f"{block.name}/PointData/{name}: its frames do not follow each other")
        kinds, axes = ("iu", 1) if name in NUMBERED else ("fiu", 0)
        _sound(data[name], int((starts + rows).max(initial=0)), kinds, axes)
    missing = set(static) - set(data)
    if missing:
        raise KeyError(f"{block.name} has no {', '.join(sorted(missing))}")


def _whole(dataset: h5py.Dataset, frames: int) -> np.ndarray:
    """Return the counts of the frames, each at least 0 and small enough to be added."""
    values = _sound(dataset, frames, "iu", 1)[:frames].astype(np.int64)
    if frames and not 0 <= values.min() <= values.max() < 2**62:
        raise ValueError(f"{dataset.name} holds {values.min()} to {values.max()}")
    return values


def _sound(dataset: h5py.Dataset, rows: int, kinds: str = "fiu", axes: int = 0, widest: int = WIDEST) -> h5py.Dataset:
    """Return the data set if it holds that many rows of numbers. Raises ValueError, TypeError."""
    if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in kinds or not dataset.shape:
        raise TypeError(f"{dataset.name} is no array of numbers")
    width = int(np.prod(dataset.shape[1:], dtype=object))
    if dataset.ndim > 2 or (axes and dataset.ndim != axes) or width > widest:
        raise ValueError(f"{dataset.name} has the shape {dataset.shape}")
    if len(dataset) < rows:
        raise ValueError(f"{dataset.name} has {len(dataset)} rows, {rows} are needed")
    size, whole = rows * width * dataset.dtype.itemsize, len(dataset) * width * dataset.dtype.itemsize
    if whole > UNASKED and whole > DENSEST * (there := dataset.file.id.get_filesize()):
        raise ValueError(f"{dataset.name} claims {whole:.3g} bytes, and the whole file has {there}")
    # checked only for large data sets: for a run killed within a write the storage size is not always known
    if size > UNASKED and size > DENSEST * (there := dataset.id.get_storage_size()):
        raise ValueError(f"{dataset.name} claims {size:.3g} bytes and has {there}")
    # of a data set without rows no chunk is read; a compressed one is as large as a whole frame
    if rows and dataset.chunks and int(np.prod(dataset.chunks, dtype=object)) * dataset.dtype.itemsize > max(UNASKED, size):
        raise ValueError(f"{dataset.name} has chunks of {dataset.chunks}")
    return dataset
