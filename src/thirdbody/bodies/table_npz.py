"""Bodies from an NPZ file: arrays in SI, plain numbers only."""

import io
import math
import zipfile
import zlib
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from thirdbody.bodies.bounded_read import MAX_ROWS
from thirdbody.bodies.sphere_table import PER_BODY, SHOWN, SphereTable, refuse
from thirdbody.errors import Fault, InputError, nearest

_NEEDED = ("center", "radius", "clump")


class _Header(NamedTuple):
    """What an array in the file claims to be."""

    shape: tuple[int, ...]
    dtype: np.dtype


Tables = Mapping[str, np.ndarray] | Mapping[str, _Header]


def read_npz(file: str, data: bytes) -> SphereTable:
    """Return the table in the bytes of an NPZ file; `file` is its name in messages. Pickles are never loaded.

    InputError with all faults of the names, else of the sizes, else of types, else of shapes, else of the values.
    """
    try:
        arrays = _arrays(file, data)
    except InputError:
        raise
    # damage can cause any exception of zip, deflate or the header parser
    except (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, SyntaxError, OverflowError,
            zipfile.BadZipFile, zlib.error) as error:  # fmt: skip
        raise InputError(Fault("", f"is damaged or cut short ({_reason(error)}); write it again", file)) from None
    _refuse_values(file, arrays)
    floats = {name: array.astype(np.float64) for name, array in arrays.items() if name != "clump"}
    per_body = {name: floats.get(name) for name in PER_BODY}
    return SphereTable(file, floats["center"], floats["radius"], arrays["clump"], np.unique(arrays["clump"]), **per_body)


def _arrays(file: str, data: bytes) -> dict[str, np.ndarray]:
    """Return the arrays by name. Raises InputError for wrong names, sizes, types and shapes, and for pickles."""
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        refuse(_name_faults(file, archive.files))
        headers = {name: _header(file, name, archive) for name in archive.files}
        for faults in (_size_faults, _type_faults, _shape_faults):
            refuse(faults(file, headers))
        arrays = {name: _loaded(file, name, archive) for name in archive.files}
    refuse(_body_shape_faults(file, arrays, np.unique(arrays["clump"]).size))
    return arrays


def _name_faults(file: str, entries: Collection[str]) -> list[Fault]:
    known = (*_NEEDED, *PER_BODY)
    faults = [Fault(name, f"unknown array, {nearest(name, known)}", file) for name in entries if name not in known]
    lacking = [name for name in _NEEDED if name not in entries]
    if lacking and not faults:  # an unknown name may be the one that is missing
        faults = [Fault(", ".join(lacking), f"missing, expected {', '.join(_NEEDED)}", file)]
    return faults


def _header(file: str, name: str, archive: Any) -> _Header:
    """Return the header of an array, of which nothing else is read. Raises InputError where it is none of plain numbers."""
    with archive.zip.open(f"{name}.npy" if f"{name}.npy" in archive.zip.namelist() else name) as stream:
        try:
            version = np.lib.format.read_magic(stream)
        except ValueError:
            raise InputError(Fault(name, "is no array of numbers", file)) from None
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(stream)
    if dtype.hasobject:
        raise InputError(Fault(name, "holds Python objects (a pickle), expected plain numbers", file))
    return _Header(shape, dtype)


def _loaded(file: str, name: str, archive: Any) -> np.ndarray:
    """Return one array. Raises InputError for one that is damaged."""
    try:
        return archive[name]
    except ValueError as error:
        raise InputError(Fault(name, f"is damaged ({_reason(error)}); write the file again", file)) from None


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".strip().splitlines()[0][:120]


def _size_faults(file: str, arrays: Tables) -> list[Fault]:
    """Return a fault for the first array with more rows than one file may have spheres, or more columns than any array has."""
    wide = [Fault(name, f"has shape {array.shape}, expected at most 4 columns", file)
            for name, array in arrays.items() if math.prod(array.shape[1:]) > 4]  # fmt: skip
    large = [(name, max(array.shape)) for name, array in arrays.items() if array.shape and max(array.shape) > MAX_ROWS]
    return wide[:1] or [
        Fault(name, f"has {rows} rows, at most {MAX_ROWS} spheres are read from one file", file) for name, rows in large[:1]
    ]


def _type_faults(file: str, arrays: Tables) -> list[Fault]:
    faults = []
    for name, array in arrays.items():
        kinds, wanted = ("iu", "whole numbers, the ids of bodies") if name == "clump" else ("fiu", "real numbers")
        if array.dtype.kind not in kinds:
            faults.append(Fault(name, f"holds {array.dtype}, expected {wanted}", file))
    return faults


def _shape_faults(file: str, arrays: Tables) -> list[Fault]:
    """Return faults of arrays of n spheres that are not (n, 3), (n,), (n,)."""
    shape = arrays["clump"].shape
    if len(shape) != 1:
        return [Fault("clump", f"has shape {shape}, expected (n,): one id for each sphere", file)]
    if not shape[0]:
        return [Fault("clump", "holds no spheres", file)]
    n = shape[0]
    return _unlike(file, arrays, {"center": (n, 3), "radius": (n,)}, f"clump names {n} spheres")


def _body_shape_faults(file: str, arrays: Mapping[str, np.ndarray], m: int) -> list[Fault]:
    """Return faults of arrays of m bodies that are not (m, 4), (m, 3), (m, 3)."""
    wanted = {name: (m, width) for name, width in PER_BODY.items()}
    return _unlike(file, arrays, wanted, f"clump names {m} bodies, in the order of rising ids")


def _unlike(file: str, arrays: Tables, wanted: Mapping[str, tuple[int, ...]], why: str) -> list[Fault]:
    return [
        Fault(name, f"has shape {arrays[name].shape}, expected {shape}: {why}", file)
        for name, shape in wanted.items()
        if name in arrays and arrays[name].shape != shape
    ]


def _refuse_values(file: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Raise InputError for the first numbers that are not finite, or negative, with the number of the others."""
    faults, total = [], 0
    for name, array in arrays.items():
        indices = np.argwhere(~np.isfinite(array))
        total += len(indices)
        for index in indices[:SHOWN]:
            spot = ", ".join(str(k) for k in index)
            faults.append(Fault(f"{name}[{spot}]", f"{array[tuple(index)]} is not a finite number", file))
    rules = (("radius", np.less_equal, "{:g} m must be greater than 0"), ("clump", np.less, "{} must be at least 0"))
    for name, beyond, message in rules:
        rows = np.flatnonzero(beyond(arrays[name], 0))
        total += len(rows)
        faults += [Fault(f"{name}[{k}]", message.format(arrays[name][k]), file) for k in rows[:SHOWN]]
    refuse(faults, total)
