"""Compressed copy of a run: the same file, array for array, with gzip, which every HDF5 library reads.

Only committed frames are copied, so that the copy of a killed run is a whole file. Numbers are shuffled first (bytes of equal
significance together), which helps gzip with floats.
"""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from thirdbody.atomic_files import new_file, refuse_existing_file
from thirdbody.errors import InputError, OutputError
from thirdbody.trajectory.crash_safe_file import Sink
from thirdbody.trajectory.plate_maps import MAPS
from thirdbody.trajectory.reader import Run
from thirdbody.trajectory.schema import BLOCKS, PROFILES, STATIC_TEXT
from thirdbody.trajectory.writer import FORMAT

LEVEL = 4
SMALL = 64  # bytes; for less a filter costs more than it saves
SLAB = 1 << 24  # bytes copied at once
SHORTEST = 1100  # largest compression ratio of gzip, about: a data set that claims more is damaged, and would take for ever


def refuse_target(run: Run, path: Path, overwrite: bool) -> None:
    """Raise OutputError when the copy may not be written to `path`."""
    if os.path.exists(path) and path.samefile(run.path):
        raise OutputError(f"{path}: is the run itself; name another file")
    refuse_existing_file(path, overwrite)


def pack_run(run: Run, path: Path, overwrite: bool = False) -> None:
    """Write the compressed copy. Raises OutputError (nothing is changed then), InputError when the run is damaged."""
    refuse_target(run, path, overwrite)
    with _run_faults(run):
        rows = _committed_rows(run)
    with new_file(path, overwrite) as part, Sink(part, "w+") as sink:
        with _run_faults(run), h5py.File(sink, "w", libver=FORMAT) as copy:
            _copy_group(run.file["/"], copy, rows, sink)
            for steps in [*(f"VTKHDF/{block}/Steps" for block in BLOCKS), "series"]:
                copy[steps].attrs.modify("NSteps", np.int64(run.frames))
        sink.check()


@contextmanager
def _run_faults(run: Run) -> Iterator[None]:
    """Report HDF5 errors of a damaged run as such; errors of the disk of the copy are OSError."""
    try:
        yield
    except (KeyError, IndexError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"{run.path}: is damaged and cannot be copied: {error}") from error


def _committed_rows(run: Run) -> dict[str, int]:
    """Return for the path of every growing data set the number of rows in committed frames."""
    rows: dict[str, int] = {f"/series/{name}": run.frames for name in run.series}
    rows |= {f"/{PROFILES}/{name}": run.frames * values.shape[1] for name, values in run.profiles.items()}
    rows |= {values.name: run.frames * int(values.attrs["rows"]) for values in run.file.get(MAPS, {}).values()}
    for name in BLOCKS:
        block = run.file["VTKHDF"][name]
        static = run.header[STATIC_TEXT].get(name, ())
        ends = {"Points": block["Steps/PointOffsets"]}
        ends |= {f"PointData/{n}": block["Steps/PointDataOffsets"][n] for n in block["PointData"] if n not in static}
        count = run.stored[name].rows(run.frames - 1) if run.frames else 0
        for path, offsets in ends.items():
            rows[f"{block.name}/{path}"] = int(offsets[run.frames - 1]) + count if run.frames else 0
        for cells in ("Vertices", "Lines", "Polygons", "Strips"):
            rows |= {f"{block.name}/{cells}/{n}": run.frames for n in ("NumberOfCells", "NumberOfConnectivityIds")}
        rows[f"{block.name}/NumberOfPoints"] = run.frames
        steps = block["Steps"]
        each = [*steps.values(), *(item for group in steps.values() if isinstance(group, h5py.Group) for item in group.values())]
        rows |= {item.name: run.frames for item in each if isinstance(item, h5py.Dataset)}
    return rows


def _copy_group(
    source: h5py.Group, target: h5py.Group, rows: dict[str, int], sink: Sink, above: tuple[h5py.Group, ...] = ()
) -> None:
    """Copy a group with all below it; `above`: its parent groups, for the detection of a group that contains itself."""
    _copy_attributes(source, target)
    for name in source:
        link = source.get(name, getlink=True)
        if isinstance(link, h5py.SoftLink):
            target[name] = h5py.SoftLink(link.path)
        elif isinstance(source[name], h5py.Group):
            item = source[name]
            if item == source or item in above:
                raise ValueError(f"{source.name}/{name}: a group that holds itself")
            below = target.create_group(name, track_order=_ordered(item))
            _copy_group(item, below, rows, sink, (*above, source))
        else:
            _copy_dataset(source[name], target, name, rows.get(source[name].name))
            sink.check()


def _ordered(group: h5py.Group) -> bool:
    return bool(group.id.get_create_plist().get_link_creation_order() & h5py.h5p.CRT_ORDER_TRACKED)


def _copy_attributes(source: Any, target: Any) -> None:
    for name in source.attrs:
        # the type unchanged: VTK needs `Type` as text of fixed length
        target.attrs.create(name, source.attrs[name], dtype=source.attrs.get_id(name).dtype)


def _copy_dataset(source: h5py.Dataset, target: h5py.Group, name: str, rows: int | None) -> None:
    if source.shape == ():
        target.create_dataset(name, data=source[()], dtype=source.dtype)
    else:
        count = source.shape[0] if rows is None else rows
        shape = (count, *source.shape[1:])
        size = math.prod(shape) * source.dtype.itemsize
        if size > (SHORTEST if source.compression else 1) * source.file.id.get_filesize():
            raise ValueError(f"{source.name}: it promises {size:.3g} bytes")
        filters = {"compression": "gzip", "compression_opts": LEVEL, "shuffle": True} if size > SMALL else {}
        if filters:
            filters["chunks"] = (min(count, source.chunks[0] if source.chunks else 65536), *source.shape[1:])
        copy = target.create_dataset(name, shape, source.dtype, **filters)
        step = max(1, SLAB // max(1, size // max(1, count)))
        step = max(copy.chunks[0], step - step % copy.chunks[0]) if copy.chunks else step
        for start in range(0, count, step):
            copy[start : start + step] = _read(source, start, min(count, start + step))
    _copy_attributes(source, target[name])


def _read(source: h5py.Dataset, start: int, stop: int) -> np.ndarray:
    """Read rows of the run; errors here are errors of the run, not of the copy."""
    try:
        return source[start:stop]
    except (OSError, RuntimeError) as error:
        raise ValueError(f"{source.name}: {error}") from error
