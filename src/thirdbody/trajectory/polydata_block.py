"""Temporal PolyData block of a VTKHDF file, consisting of growing data sets."""

import zlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import h5py
import numpy as np

from thirdbody.trajectory.schema import Arrays

LEVEL = 1
"""Of deflate: higher ones take several times as long for some percent."""

CELL_GROUPS = ("Vertices", "Lines", "Polygons", "Strips")
VERSION = (2, 1)


class Storage(NamedTuple):
    """How the arrays of a block are stored: floating-point numbers in 32 bits, those of the points too, compressed."""

    single: bool = False
    single_points: bool = False
    compress: bool = False


PLAIN = Storage()


class Column:
    """Growing data set, by low-level calls: about 5 times cheaper than `dataset[n:] = rows`."""

    def __init__(self, dataset: h5py.Dataset):
        self._id = dataset.id
        self.length: int = dataset.shape[0]
        self._tail: tuple[int, ...] = dataset.shape[1:]
        self._dtype = dataset.dtype
        self._chunk = dataset.chunks[0] if dataset.compression else 0

    def deflated(self, rows: np.ndarray) -> bytes | None:
        """Return rows as the filters of the data set store them, if it is compressed and they are one chunk of it; else None."""
        if not self._chunk or len(rows) != self._chunk or self.length % self._chunk:
            return None
        data = np.ascontiguousarray(rows, self._dtype)
        # first bytes of all numbers, then second ones ("shuffle")
        return zlib.compress(data.view(np.uint8).reshape(-1, data.itemsize).T.tobytes(), LEVEL)

    def extend(self, rows: Any, chunk: bytes | None = None) -> int:
        """Append rows; return the row at which they begin. `chunk`: the rows by `deflated`, if that has been computed."""
        if chunk is not None:
            start, self.length = self.length, self.length + len(rows)
            self._id.set_extent((self.length, *self._tail))
            self._id.write_direct_chunk((start,) + (0,) * len(self._tail), chunk)
            return start
        data = np.ascontiguousarray(rows, self._dtype)
        if data.shape[1:] != self._tail:
            raise ValueError(f"rows of shape {data.shape[1:]} do not fit a data set with rows of {self._tail}")
        start = self.length
        if len(data):
            self._id.set_extent((start + len(data), *self._tail))
            space = self._id.get_space()
            space.select_hyperslab((start,) + (0,) * len(self._tail), data.shape)
            self._id.write(h5py.h5s.create_simple(data.shape), space, data)
            self.length += len(data)
        return start

    def add(self, row: Any) -> int:
        """Append one row; return its number."""
        return self.extend(np.asarray(row, self._dtype)[None])


def growing(
    group: h5py.Group, name: str, tail: tuple[int, ...], dtype: Any, rows_ahead: int = 256, compress: bool = False
) -> Column:
    """Return the growing data set of that name, created if missing; chunks hold `rows_ahead` rows."""
    if name not in group:
        kind = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        kind.set_chunk((rows_ahead, *tail))
        # Else every new chunk is first filled with zeros: twice the bytes.
        kind.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        if compress:
            kind.set_shuffle()
            kind.set_deflate(LEVEL)
        rows = h5py.h5s.create_simple((0, *tail), (h5py.h5s.UNLIMITED, *tail))
        h5py.h5d.create(group.id, name.encode(), h5py.h5t.py_create(np.dtype(dtype)), rows, kind)
    return Column(group[name])


def as_numbers(name: str, values: Any, narrow: bool = False) -> np.ndarray:
    """Return `values` as an array that VTK reads; `narrow` halves floats. TypeError for anything but numbers."""
    array = np.asarray(values)
    if array.dtype == np.bool_:
        return array.astype(np.uint8)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"array '{name}' has type {array.dtype}; only numbers can be written")
    return array.astype(np.float32) if narrow and array.dtype.kind == "f" else array


class Block:
    """Temporal PolyData block; its cells are runs of `per_cell` consecutive points, all of one kind."""

    def __init__(self, group: h5py.Group, kind: str, per_cell: int, rows: int, storage: Storage = PLAIN):
        self._group, self._kind, self._per_cell, self._storage = group, kind, per_cell, storage
        # A few frames per chunk: small files for small runs and few chunks for large ones.
        self._ahead = int(np.clip(4 * rows, 64, 65536))
        # A compressed chunk is a whole frame and written once: one that were written again would move, and a kill within that
        # could damage frames that are committed.
        self._chunk = max(1, rows) if storage.compress else self._ahead
        if "Type" not in group:
            group.attrs["Version"] = np.array(VERSION, np.int64)
            group.attrs.create("Type", np.bytes_(b"PolyData"))
        self._data = group.require_group("PointData")
        self._steps = group["Steps"]
        self._offsets = self._steps.require_group("PointDataOffsets")
        for name in ("CellData", "FieldData", "Steps/CellDataOffsets", "Steps/FieldDataOffsets"):
            group.require_group(name)
        self._make_topology()
        self._static = {name: self._offset_column(name) for name in self._data}
        self._varying: dict[str, tuple[Column, Column]] = {}

    def _make_topology(self) -> None:
        group, steps = self._group, self._steps
        number = np.float32 if self._storage.single_points else np.float64
        self._points = growing(group, "Points", (3,), number, self._chunk, self._storage.compress)
        self._point_count = growing(group, "NumberOfPoints", (), np.int64)
        self._cells = {
            cells: {
                "Connectivity": growing(group.require_group(cells), "Connectivity", (), np.int64, self._ahead),
                "Offsets": growing(group[cells], "Offsets", (), np.int64, self._ahead),
                "NumberOfCells": growing(group[cells], "NumberOfCells", (), np.int64),
                "NumberOfConnectivityIds": growing(group[cells], "NumberOfConnectivityIds", (), np.int64),
            }
            for cells in CELL_GROUPS
        }
        self._values = growing(steps, "Values", (), np.float64)
        self._step = {name: growing(steps, name, (), np.int64) for name in ("PartOffsets", "NumberOfParts", "PointOffsets")}
        self._zeros = [growing(steps, n, (4,), np.int64) for n in ("CellOffsets", "ConnectivityIdOffsets")]
        for columns in self._cells.values():
            if columns["Offsets"].length == 0:
                columns["Offsets"].extend([0])

    def _offset_column(self, name: str) -> Column:
        return growing(self._offsets, name, (), np.int64)

    def write_static(self, arrays: Arrays) -> None:
        """Write arrays that hold for every frame."""
        for name, values in arrays.items():
            array = as_numbers(name, values)
            self._group["PointData"].create_dataset(name, data=array)
            self._static[name] = self._offset_column(name)

    def restrict_static(self, names: Sequence[str]) -> None:
        """After reopening: only `names` are static, the others go on growing."""
        for name in list(self._static):
            if name not in names:
                offsets = self._static.pop(name)
                self._varying[name] = (Column(self._data[name]), offsets)

    def plain(self, arrays: Arrays) -> dict[str, np.ndarray]:
        """Return the arrays of a frame in the stored types; ValueError when they do not fit the block."""
        plain = {k: as_numbers(k, v, self._storage.single and k != "points") for k, v in arrays.items()}
        count = len(plain["points"])
        wrong = [name for name, array in plain.items() if len(array) != count]
        if wrong or count % self._per_cell:
            raise ValueError(f"{self._group.name}: {count} points, but another number of rows in {wrong}")
        if self._point_count.length and set(plain) - {"points"} != set(self._varying):
            raise ValueError(f"{self._group.name}: arrays {sorted(plain)} differ from those of the first frame")
        return plain

    def append(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Write one frame of arrays from `plain`; invisible to readers before `count_frames`."""
        count = len(arrays["points"])
        self._append_cells(count)
        self._step["PartOffsets"].add(self._point_count.add(count))
        self._step["NumberOfParts"].add(1)
        for zeros in self._zeros:
            zeros.add(np.zeros(4))
        for offsets in self._static.values():
            offsets.add(0)
        columns = [self._columns_of(name, array) for name, array in arrays.items()]
        chunks = self._deflated([data for data, _ in columns], list(arrays.values()))
        for (data, offsets), array, chunk in zip(columns, arrays.values(), chunks, strict=True):
            offsets.add(data.extend(array, chunk))

    def _columns_of(self, name: str, array: np.ndarray) -> tuple[Column, Column]:
        """Return the data set of an array that varies, and that of the rows at which its frames begin."""
        if name == "points":
            return self._points, self._step["PointOffsets"]
        if name not in self._varying:
            data = growing(self._data, name, array.shape[1:], array.dtype, self._chunk, self._storage.compress)
            self._varying[name] = (data, self._offset_column(name))
        return self._varying[name]

    def _deflated(self, columns: list[Column], arrays: list[np.ndarray]) -> Sequence[bytes | None]:
        """Return the chunks of a frame, deflated on the threads of the run; HDF5 itself would use one."""
        if not self._storage.compress:
            return [None] * len(columns)
        from thirdbody.jit.threads import allowed_threads

        with ThreadPoolExecutor(allowed_threads()) as pool:
            return list(pool.map(Column.deflated, columns, arrays))

    def _append_cells(self, count: int) -> None:
        for cells, columns in self._cells.items():
            ids = count if cells == self._kind else 0
            number = ids // self._per_cell
            have = columns["Connectivity"].length
            if ids > have:
                columns["Connectivity"].extend(np.arange(have, ids))
                columns["Offsets"].extend(np.arange(columns["Offsets"].length, number + 1) * self._per_cell)
            columns["NumberOfCells"].add(number)
            columns["NumberOfConnectivityIds"].add(ids)

    def count_frames(self, frames: int) -> None:
        """Publish `frames` frames to readers; the file must be flushed before and after."""
        self._steps.attrs.modify("NSteps", np.int64(frames))

    def add_time(self, time: float) -> None:
        """Write the time of the frame counted last.

        VTK reads all of `Values` into a buffer of `NSteps` numbers: one value more overruns it and the reader crashes. So the
        count must be on disk before the time.
        """
        self._values.add(time)
