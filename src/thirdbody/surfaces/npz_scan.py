"""Height maps in NPZ files: `heights` (n_y, n_x), `spacing` (one, or along x and y), `unit` (a text, such as "um")."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from thirdbody import units
from thirdbody.errors import Fault, InputError, nearest
from thirdbody.surfaces.grid import MAX_POINTS
from thirdbody.surfaces.height_map import HeightMap, checked_map
from thirdbody.surfaces.zip_members import damage_reported, member, opened_archive

NAMES = ("heights", "spacing", "unit", "height_unit")
"""Arrays of a file; `height_unit` is that of the heights where it differs from `unit`."""


def npz_map(file: str, data: bytes) -> HeightMap:
    """Return the height map in the bytes of an NPZ file; `file` is its name in messages. Pickles are never loaded.

    Raises InputError with all faults of the names, else of sizes, types and units, else of the values.
    """
    with damage_reported(file), opened_archive(file, data) as archive:
        names = [name.removesuffix(".npy") for name in archive.namelist()]
        faults = [Fault(name, f"unknown array, {nearest(name, NAMES)}", file) for name in names if name not in NAMES]
        faults += [Fault(name, "is missing; a map has heights, spacing and unit", file)
                   for name in NAMES[:3] if name not in names and not faults]  # fmt: skip
        if faults:
            raise InputError(faults[:10])
        arrays = {name: _array(file, name, member(file, archive, f"{name}.npy")) for name in names}
    faults = [Fault(name, text, file) for name, text in _wrong(arrays)]
    if faults:
        raise InputError(faults)
    unit = _unit(file, "unit", arrays)
    height_unit = _unit(file, "height_unit", arrays) if "height_unit" in arrays else unit
    step_x, step_y = np.broadcast_to(arrays["spacing"].astype(np.float64), 2) * unit
    heights = arrays["heights"].astype(np.float64) * height_unit
    return checked_map(heights, (float(step_x), float(step_y)), file)


def _array(file: str, name: str, data: bytes) -> np.ndarray:
    """Return one array; its size is checked before it is allocated. Raises InputError."""
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    points = 1
    for side in shape:
        points *= side
    if dtype.hasobject:
        raise InputError(Fault(name, "holds Python objects (a pickle), expected plain numbers or a text", file))
    if points > MAX_POINTS:
        raise InputError(Fault(name, f"has {points:.3g} points, at most {MAX_POINTS:.3g} are read: crop or thin the map", file))
    if points * dtype.itemsize != len(data) - stream.tell():
        raise InputError(Fault(name, f"is cut short: {points} values were announced", file))
    stream.seek(0)
    return np.lib.format.read_array(stream, allow_pickle=False)


def _wrong(arrays: dict[str, np.ndarray]) -> list[tuple[str, str]]:
    """Return the faults of shapes and types, with the name of the array."""
    faults = []
    for name, array in arrays.items():
        text = name.endswith("unit")
        if array.dtype.kind not in ("US" if text else "fiu"):
            faults.append((name, f"holds {array.dtype}, expected {'a text' if text else 'real numbers'}"))
        elif text and array.size != 1:
            faults.append((name, f"has shape {array.shape}, expected one text"))
    if arrays["heights"].ndim != 2:
        faults.append(("heights", f"has shape {arrays['heights'].shape}, expected (n_y, n_x)"))
    if arrays["spacing"].shape not in ((), (1,), (2,)):
        faults.append(("spacing", f"has shape {arrays['spacing'].shape}, expected one number, or those along x and y"))
    return faults


def _unit(file: str, name: str, arrays: dict[str, Any]) -> float:
    """Return the length of a unit [m]. Raises InputError."""
    value = arrays[name].reshape(-1)[0]
    text = value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)
    try:
        return units.parse(f"1 {text}", "length")
    except ValueError as error:
        raise InputError(Fault(name, str(error), file)) from None


def npz_bytes(scan: HeightMap) -> bytes:
    """Return a height map as the content of an NPZ file, lengths in metres."""
    stream = io.BytesIO()
    np.savez_compressed(stream, heights=scan.heights, spacing=np.array(scan.spacing), unit=np.array("m"))
    return stream.getvalue()
