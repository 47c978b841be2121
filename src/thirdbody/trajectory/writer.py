"""Writer of `run.vtkhdf`: one HDF5 file that is the trajectory and opens in VTK 9.4 / ParaView 5.13 and later.

    /VTKHDF   MultiBlockDataSet of four temporal PolyData blocks: spheres, clumps, contacts, plates
    /scene    texts: the resolved scene, versions, names of states and reasons, units, domain, summary
    /series   one dataset per series, first axis the frame, with an attribute `units`
    /profiles one dataset per profile, the slabs of every frame after those of the last one, likewise; only if there are profiles
    /maps     one dataset per map of the plates, likewise; only if measures map
    /surfaces heights of the plates that are rough, once

Requirements of VTK's reader, each established from a file that it read as empty: `Type` is fixed-length ASCII; the assembly holds
soft links in tracked order; all four cell groups exist; arrays are plain numbers. Connectivity is 0, 1, 2, ... for every frame,
so one copy serves them all and the cell offsets stay 0.

A frame counts once `NSteps` includes it, and `NSteps` is written after the data has been flushed: the file of a killed run can be
read up to its last committed frame. Readers never read beyond `NSteps`, except for the times, which are therefore written last
(`Block.add_time`); the frames of `series` are counted with them, and our own reader relies on that count. (With `NSteps` 1 VTK
treats a file as static: of a run killed within its second frame it shows both; our reader shows the first.)

A kill may come at or within any write of HDF5. VTK refuses a file whose blocks differ in `NSteps`: the four counts lie in one
page of the file and reach it by one write. No header crosses the end of a page, where a kill may tear a write in two (a half-new
header fails its checksum, and nothing below it can be read). For the safe order of the writes of a flush see `Sink.in_order`.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import h5py
import numpy as np

from thirdbody.errors import InputError, OutputError
from thirdbody.surfaces.surface import Surface
from thirdbody.trajectory.blocks import PAGE, VERSION, Block, Column, Sink, growing
from thirdbody.trajectory.frame import EVERYTHING, Selection
from thirdbody.trajectory.names import BLOCKS, MAPS, POSITION, PROFILE_GROUP, STATIC_TEXT, SUMMARY_TEXT, SURFACES, Arrays, Frame
from thirdbody.trajectory.open_file import damage_as_fault
from thirdbody.trajectory.read_blocks import read_maps
from thirdbody.trajectory.run_arrays import RunArrays

# The lowest format that has the indices of growing data sets; `latest` leaves an open flag when a run is killed, and such a file
# does not open.
FORMAT = ("v108", "v110")

# Space that a frame may need in addition to its own bytes: some sixty data sets may each begin a new page.
SPARE_BYTES = 512 * 1024

# Length that a frame may add in addition to its own chunks: the first chunks of all data sets, and HDF5's own tables.
HOLE_BYTES = 4 * 1024 * 1024


class TrajectoryWriter:
    """Writer of the trajectory, frame by frame; a context manager.

    `header` holds texts, stored as they are, and anything JSON can hold; `scene_text`, `state_names`, `reason_names` and `units`
    (name to unit) are required, `domain` ({"size": [x, y], "periodic": bool}), `title` and `versions` are used by other programs.
    `static` gives per block ("spheres", "clumps") the arrays that never change, written once; `clump` of a sphere is the `id` of
    its clump. `surfaces`: those of the rough plates. `selection`: how arrays are stored. `copy_of`: the file, and its number of
    frames, that the written one will replace; errors name that one. Raises OutputError when the file cannot be written; committed
    frames stay readable.
    """

    def __init__(
        self, path: str | Path, header: Mapping[str, Any], static: Mapping[str, Arrays], copy_of: tuple[Path, int] | None = None,
        surfaces: Mapping[str, Surface] = MappingProxyType({}), selection: Selection = EVERYTHING,
    ):  # fmt: skip
        missing = [name for name in ("scene_text", "state_names", "reason_names", "units") if name not in header]
        if missing:
            raise ValueError(f"header lacks {', '.join(missing)}")
        self.path = Path(path)
        self._named, self._before = copy_of or (self.path, 0)
        self._units: Mapping[str, str] = header["units"]
        self.frames = 0
        rows = {name: len(next(iter(arrays.values()))) for name, arrays in static.items() if arrays}
        bodies = rows.get("clumps", 1)
        ahead = {"spheres": rows.get("spheres", 1), "clumps": bodies, "contacts": 4 * bodies, "plates": 8}
        with self._write_errors():
            # a new file of that name, not the old one truncated: processes that read the old one keep it
            self.path.unlink(missing_ok=True)
            self._sink = Sink(self.path)
            # No chunk cache: it would write every chunk whole at every flush (23 -> 10 ms per frame of 8 MB).
            self._file = h5py.File(self._sink, "w", libver=FORMAT, rdcc_nbytes=0, fs_strategy="page", fs_page_size=PAGE)
            root = self._file.create_group("VTKHDF", track_order=True)
            for name in BLOCKS:  # before anything else, so that they lie in one page
                root.create_group(f"{name}/Steps").attrs["NSteps"] = np.int64(0)
            self._blocks = {name: Block(root[name], name, ahead[name], selection.storage(name)) for name in BLOCKS}
            self._scene, series = self._file.create_group("scene"), self._file.create_group("series")
            self._columns: dict[str, dict[str, Column]] = {"series": {}, PROFILE_GROUP: {}, MAPS: {}}
            root.attrs["Version"] = np.array(VERSION, np.int64)
            root.attrs.create("Type", np.bytes_(b"MultiBlockDataSet"))
            assembly = root.create_group("Assembly", track_order=True)
            for name in BLOCKS:
                assembly[name] = h5py.SoftLink(f"/VTKHDF/{name}")
            for name, arrays in static.items():
                self._blocks[name].write_static(arrays)
            for name, value in header.items():
                _write_text(self._scene, name, value)
            for side, surface in surfaces.items():
                heights = self._file.require_group(SURFACES).create_dataset(side, data=np.asarray(surface.heights, np.float64))
                more = {"size": np.array(surface.size), "copies": np.array(surface.copies, np.int64), "units": "m"}
                more |= {"shortest": surface.shortest, "curvature": np.uint8(surface.curvature)}
                heights.attrs.update(more)
            _write_text(self._scene, STATIC_TEXT, {name: list(arrays) for name, arrays in static.items()})
            series.attrs["NSteps"] = np.int64(0)
            self._flush()

    @classmethod
    def resume(
        cls, path: str | Path, frames: int, header: Mapping[str, Any] | None = None, between: Callable[[], None] = lambda: None,
        selection: Selection = EVERYTHING,
    ) -> TrajectoryWriter:  # fmt: skip
        """Return a writer that continues after the first `frames` frames of an existing file; the others are dropped.

        The committed frames are copied to a new file that then replaces the old one: the index of a killed run's file may hold
        entries of frames that were never committed, and is not safe to write to. `header` replaces the old texts; the summary of
        a finished run is dropped. `between` is called before every frame that is copied; if it raises, the file stays unchanged.
        Raises InputError when the file is not a run or has fewer frames.
        """
        path, writer = Path(path), None
        copy = path.with_name(path.name + ".part")
        try:
            with RunArrays(path) as old:
                if frames > old.frames:
                    raise InputError(f"{path}: has {old.frames} frames, cannot go on after frame {frames}")
                writer = cls(copy, header or old.header, static_arrays(old), (path, old.frames), old.surfaces, selection)
                for number in range(frames):
                    between()
                    writer.append(_frame_of(old, number))
                writer.sync()  # the checkpoint on the disk refers to these frames
            with writer._write_errors():
                os.replace(copy, path)
        except BaseException:
            if writer is not None:
                writer.close()
            with suppress(OSError):  # a read-only folder refuses that too
                copy.unlink(missing_ok=True)
            raise
        writer.path, writer._named, writer._before = path, path, frames
        return writer

    def append(self, frame: Frame) -> None:
        """Write and commit one frame.

        Raises OutputError when the disk is full, ValueError or TypeError when the arrays do not fit the file.
        """
        arrays = {name: block.plain(frame.block(name)) for name, block in self._blocks.items()}
        groups = {"series": frame.series, PROFILE_GROUP: frame.profiles, MAPS: frame.maps}
        for group, values in groups.items():
            if self.frames and set(values) != set(self._columns[group]):
                raise ValueError(f"{group} {sorted(values)} differ from those of the first frame")
        nbytes = sum(array.nbytes for block in (*arrays.values(), frame.maps) for array in block.values())
        # A half-written index is useless. The open file is asked for space: its folder may have been moved.
        free = shutil.disk_usage(self._sink.fileno() if hasattr(os, "fstatvfs") else self.path.parent).free
        if free < nbytes + nbytes // 2 + SPARE_BYTES:
            self.close()
            raise OutputError(f"{self._named}: the disk is full ({free // 1024} KiB left); {self._saved_frames()}")
        with self._write_errors():
            # New chunks hold four frames, or some rows of small ones; a hole costs nothing.
            self._sink.reserve(8 * nbytes + HOLE_BYTES)
            self._sink.check()
            for name, block in self._blocks.items():
                block.append(arrays[name])
            for group, values in groups.items():
                for name, value in values.items():
                    self._append(group, name, np.asarray(value, np.float64))
            self._flush()
            for block in self._blocks.values():
                block.count_frames(self.frames + 1)
            self._flush()
            for block in self._blocks.values():
                block.add_time(frame.time)
            self._file["series"].attrs.modify("NSteps", np.int64(self.frames + 1))
            self._flush()
            self.frames += 1

    def _append(self, group: str, name: str, values: np.ndarray) -> None:
        rows = values[None] if group == "series" else values.reshape(-1, values.shape[-1]) if group == MAPS else values
        columns = self._columns[group]
        if name not in columns:
            parent = self._file.require_group(group)
            columns[name] = growing(parent, name, rows.shape[1:], np.float64, 256 if group == "series" else len(rows))
            parent[name].attrs["units"] = self._units.get(name, "1")
            if group == MAPS:
                parent[name].attrs["rows"] = np.int64(len(rows))
        columns[name].extend(rows)

    def _flush(self) -> None:
        # Each flush cuts the hole off again, and the counts and times may begin new chunks after the data did.
        self._sink.reserve(HOLE_BYTES)
        with self._sink.in_order():
            self._file.flush()
        self._sink.check()

    def _saved_frames(self) -> str:
        frames = max(self._before, self.frames)
        if not frames:
            return "no frame was written"
        return f"the {frames} frames written before are kept" if frames > 1 else "the frame written before is kept"

    @contextmanager
    def _write_errors(self) -> Iterator[None]:
        """Turn what HDF5 raises (OSError, RuntimeError) into one message, and close the file."""
        try:
            yield
        except (OSError, RuntimeError) as error:
            self.close()
            reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
            raise OutputError(f"{self._named}: cannot be written ({reason}); {self._saved_frames()}") from error

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Store the summary of a finished run. Raises OutputError."""
        with self._write_errors():
            _write_text(self._scene, SUMMARY_TEXT, summary)
            self._flush()

    def sync(self) -> None:
        """Flush all written data to the disk: a checkpoint must not be ahead of its frames. Raises OutputError."""
        with self._write_errors():
            os.fsync(self._sink.fileno())

    def close(self) -> None:
        """Close the file; may be called twice. Errors are ignored: every frame was flushed already."""
        for name in ("_file", "_sink"):  # which a constructor that failed may lack
            with suppress(OSError, RuntimeError, AttributeError):
                getattr(self, name).close()

    def __enter__(self) -> TrajectoryWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _write_text(group: h5py.Group, name: str, value: Any) -> None:
    # in a data set: attributes are limited to 64 KiB
    text = value if isinstance(value, str) else json.dumps(value, default=lambda other: np.asarray(other).tolist())
    data = text.encode("utf-8")
    if name in group:
        del group[name]
    dataset = group.create_dataset(name, data=data, dtype=h5py.string_dtype("utf-8", max(1, len(data))))
    dataset.attrs["json"] = np.uint8(not isinstance(value, str))


def static_arrays(run: RunArrays) -> dict[str, dict[str, np.ndarray]]:
    """Return, per block, the arrays that hold for all frames."""
    names: Mapping[str, list[str]] = run.header[STATIC_TEXT]
    data = {block: run.file["VTKHDF"][block]["PointData"] for block in names}
    return {block: {name: data[block][name][()] for name in names[block]} for block in names}


def _frame_of(run: RunArrays, number: int) -> Frame:
    blocks = {}
    for name in BLOCKS:
        arrays = run.steady(partial(run.stored[name].read, number, run.header[STATIC_TEXT].get(name, ())))
        blocks[name] = {("points" if k == POSITION else k): v for k, v in arrays.items()}
    series = {name: values[number] for name, values in run.series.items()}
    profiles = {name: v[number].reshape(v.shape[1], 9) if v.ndim == 4 else v[number] for name, v in run.profiles.items()}
    with damage_as_fault(run.path, "the maps"):
        maps = run.steady(lambda: read_maps(run.file, number))
    return Frame(time=float(run.times[number]), series=series, profiles=profiles, maps=maps, **blocks)
