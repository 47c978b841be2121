"""What the file of a run consists of: temporal PolyData blocks of growing data sets, in a file that survives kills."""

import io
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from thirdbody.trajectory.names import Arrays

LEVEL = 1
"""Of deflate: higher ones take several times as long for some percent."""

PAGE = 4096
"""Page size in bytes: a kill never tears a write within a page; a longer write may end between two pages."""

NODE = b"TREE"
"""First bytes of the nodes of a chunk index; their sixth byte is the level, 0 for the leaves (HDF5 file format 3.0, III.A.1)."""

CELL_GROUPS = ("Vertices", "Lines", "Polygons", "Strips")
VERSION = (2, 1)


class Storage(NamedTuple):
    """How the arrays of a block are stored: floating-point numbers in 32 bits, those of the points too, compressed."""

    single: bool = False
    single_points: bool = False
    compress: bool = False


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
        start, data = self.length, np.ascontiguousarray(rows, self._dtype)
        if data.shape[1:] != self._tail:
            raise ValueError(f"rows of shape {data.shape[1:]} do not fit a data set with rows of {self._tail}")
        if len(data):
            self.length += len(data)
            first = (start,) + (0,) * len(self._tail)
            self._id.set_extent((self.length, *self._tail))
            if chunk is not None:
                self._id.write_direct_chunk(first, chunk)
                return start
            space = self._id.get_space()
            space.select_hyperslab(first, data.shape)
            self._id.write(h5py.h5s.create_simple(data.shape), space, data)
        return start

    def add(self, row: Any) -> int:
        """Append one row; return its number."""
        return self.extend(np.asarray(row, self._dtype)[None])


def growing(
    group: h5py.Group, name: str, tail: tuple[int, ...], dtype: Any, rows_ahead: int = 256, compress: bool = False
) -> Column:
    """Return a new growing data set of that name; chunks hold `rows_ahead` rows."""
    kind = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    kind.set_chunk((rows_ahead, *tail))
    # Else every new chunk is first filled with zeros: twice the bytes.
    kind.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    if compress:
        kind.set_shuffle()
        kind.set_deflate(LEVEL)
    rows = h5py.h5s.create_simple((0, *tail), (h5py.h5s.UNLIMITED, *tail))
    return Column(h5py.Dataset(h5py.h5d.create(group.id, name.encode(), h5py.h5t.py_create(np.dtype(dtype)), rows, kind)))


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

    def __init__(self, group: h5py.Group, name: str, rows: int, storage: Storage):
        self._group, self._storage = group, storage
        self._kind, self._per_cell = ("Polygons", 4) if name == "plates" else ("Vertices", 1)
        # A few frames per chunk: small files for small runs and few chunks for large ones.
        ahead = int(np.clip(4 * rows, 64, 65536))
        # A compressed chunk is a whole frame and written once: one that were written again would move, and a kill within that
        # could damage frames that are committed.
        self._chunk = max(1, rows) if storage.compress else ahead
        group.attrs["Version"] = np.array(VERSION, np.int64)
        group.attrs.create("Type", np.bytes_(b"PolyData"))
        self._data, self._steps = group.create_group("PointData"), group["Steps"]
        self._offsets = self._steps.create_group("PointDataOffsets")
        for empty in ("CellData", "FieldData", "Steps/CellDataOffsets", "Steps/FieldDataOffsets"):
            group.create_group(empty)
        self._points = growing(
            group, "Points", (3,), np.float32 if storage.single_points else np.float64, self._chunk, storage.compress
        )
        lengths = {"Connectivity": ahead, "Offsets": ahead, "NumberOfCells": 256, "NumberOfConnectivityIds": 256}
        self._point_count = growing(group, "NumberOfPoints", (), np.int64)
        self._cells = {
            cells: {name: growing(group.require_group(cells), name, (), np.int64, rows) for name, rows in lengths.items()}
            for cells in CELL_GROUPS
        }
        steps = self._steps
        self._values = growing(steps, "Values", (), np.float64)
        self._step = {name: growing(steps, name, (), np.int64) for name in ("PartOffsets", "NumberOfParts", "PointOffsets")}
        self._zeros = [growing(steps, n, (4,), np.int64) for n in ("CellOffsets", "ConnectivityIdOffsets")]
        for columns in self._cells.values():
            columns["Offsets"].extend([0])
        self._static: dict[str, Column] = {}
        self._varying: dict[str, tuple[Column, Column]] = {}

    def write_static(self, arrays: Arrays) -> None:
        """Write arrays that hold for every frame."""
        for name, values in arrays.items():
            self._data.create_dataset(name, data=as_numbers(name, values))
            self._static[name] = growing(self._offsets, name, (), np.int64)

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
        for cells, kinds in self._cells.items():
            ids = count if cells == self._kind else 0
            if ids > (have := kinds["Connectivity"].length):
                kinds["Connectivity"].extend(np.arange(have, ids))
                kinds["Offsets"].extend(np.arange(kinds["Offsets"].length, ids // self._per_cell + 1) * self._per_cell)
            kinds["NumberOfCells"].add(ids // self._per_cell)
            kinds["NumberOfConnectivityIds"].add(ids)
        self._step["PartOffsets"].add(self._point_count.add(count))
        self._step["NumberOfParts"].add(1)
        for zeros in self._zeros:
            zeros.add(np.zeros(4))
        for offsets in self._static.values():
            offsets.add(0)
        columns = [self._columns_of(name, array) for name, array in arrays.items()]
        chunks: Sequence[bytes | None] = [None] * len(columns)
        if self._storage.compress:
            from thirdbody.jit.threads import allowed_threads

            # on the threads of the run; HDF5 itself would use one
            with ThreadPoolExecutor(allowed_threads()) as pool:
                chunks = list(pool.map(Column.deflated, [data for data, _ in columns], arrays.values()))
        for (data, offsets), array, chunk in zip(columns, arrays.values(), chunks, strict=True):
            offsets.add(data.extend(array, chunk))

    def _columns_of(self, name: str, array: np.ndarray) -> tuple[Column, Column]:
        if name == "points":
            return self._points, self._step["PointOffsets"]
        if name not in self._varying:
            data = growing(self._data, name, array.shape[1:], array.dtype, self._chunk, self._storage.compress)
            self._varying[name] = (data, growing(self._offsets, name, (), np.int64))
        return self._varying[name]

    def count_frames(self, frames: int) -> None:
        """Publish `frames` frames to readers; the file must be flushed before and after."""
        self._steps.attrs.modify("NSteps", np.int64(frames))

    def add_time(self, time: float) -> None:
        """Write the time of the frame counted last.

        VTK reads all of `Values` into a buffer of `NSteps` numbers: one value more overruns it and the reader crashes. So the
        count must be on disk before the time.
        """
        self._values.add(time)


class Sink(io.FileIO):
    """New file that withholds the first system error until `check` is called, and writes nothing after it.

    After a full disk HDF5 goes on to write a header that refers to missing data (the file opens no more), or ends in a
    segmentation fault when it cannot close. With this class the file stays as a kill at that moment would leave it.

    HDF5's own means do not do: a file written in SWMR mode opens no more after a kill, neither by h5py nor by VTK ("already open
    for write"), and with plain flushes VTK refuses what some kills leave: its blocks differ in their number of steps.
    """

    def __init__(self, path: str | Path):
        # not the target of a link of that name
        super().__init__(path, "w+", opener=lambda name, flags: os.open(name, flags | getattr(os, "O_NOFOLLOW", 0), 0o666))
        self._fault: OSError | None = None
        self._queue: list[tuple[int, bytes]] | None = None
        self._written: set[int] = set()

    def write(self, data: Any) -> int:
        """Write all data, or nothing after an error; within `in_order` buffer it."""
        if self._queue is not None:
            self._queue.append((self.tell(), bytes(data)))
        else:
            self.put(self.tell(), memoryview(data).cast("B"))
        return len(data)

    def put(self, offset: int, data: bytes | memoryview) -> None:
        """Write to the file itself."""
        done = 0
        while done < len(data) and self._fault is None:
            try:
                self.seek(offset + done)
                done += super().write(data[done:]) or 0  # the system may write only a part
            except OSError as error:
                self._fault = error

    @contextmanager
    def in_order(self) -> Iterator[None]:
        """Order the writes of one flush of HDF5 such that a kill may end them at any point; nothing is written after an error.

        HDF5 writes by address and the length of the file last. A reader then may find an index whose nodes are missing, or lie
        beyond the length. Here pointers are written after their targets: the length, new data, the indices from their roots down
        (a split node keeps its second half until its parent refers to the new neighbour), all else by address, one write per
        page. HDF5 reads nothing back while it flushes.
        """
        self._queue = []
        try:
            yield
            queued, self._queue = sorted(self._queue, key=self._rank), None
            for rank, parts in groupby(queued, self._rank):
                self._put_parts(list(parts), together=rank[0] == 3)
            self._written |= {offset for offset, _ in queued}
        finally:
            self._queue = None

    def _rank(self, part: tuple[int, bytes]) -> tuple[int, int]:
        offset, data = part
        if offset == 0:
            return 0, 0
        if offset not in self._written:
            return 1, offset
        return (2, -data[5]) if data[:4] == NODE else (3, offset // PAGE)

    def _put_parts(self, parts: list[tuple[int, bytes]], together: bool) -> None:
        if together:
            start, end = min(offset for offset, _ in parts), max(offset + len(data) for offset, data in parts)
            self.seek(start)
            whole = bytearray(self.read(end - start) or b"")  # bytes between the parts stay unchanged
            for offset, data in parts:
                whole[offset - start : offset - start + len(data)] = data
            parts = [(start, bytes(whole))]
        for offset, data in parts:
            self.put(offset, data)

    def truncate(self, size: int | None = None) -> int:
        """Set the size; may fail as a write may."""
        try:
            return size or 0 if self._fault else super().truncate(size)
        except OSError as error:
            self._fault = error
            return size or 0

    def reserve(self, nbytes: int) -> None:
        """Extend the file by a hole, which uses no disk space; HDF5 cuts off the unused part when it flushes.

        HDF5 writes the coming length into its header first: a shorter file opens no more.
        """
        self.truncate(self.seek(0, io.SEEK_END) + nbytes)

    def check(self) -> None:
        """Raise the error (OSError) that occurred while writing."""
        if self._fault is not None:
            raise self._fault
