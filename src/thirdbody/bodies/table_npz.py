"""Bodies from an NPZ file: arrays in SI, plain numbers only."""

from __future__ import annotations

import io
import zipfile
import zlib

import numpy as np

from thirdbody.bodies.sheet import PER_BODY, Sheet, refuse
from thirdbody.errors import Fault, InputError, nearest

_NEEDED = ("center", "radius", "clump")


def read_npz(file: str, data: bytes) -> Sheet:
    """The sheet in the bytes of an NPZ file; `file` is its name in messages. No pickle is ever loaded.

    InputError with all faults of the names, else of types and shapes, else of the values.
    """
    arrays = _arrays(file, data)
    refuse(_type_faults(file, arrays))
    refuse(_shape_faults(file, arrays))
    refuse(_value_faults(file, arrays))
    floats = {name: array.astype(np.float64) for name, array in arrays.items() if name != "clump"}
    per_body = {name: floats.get(name) for name in PER_BODY}
    return Sheet(file, floats["center"], floats["radius"], arrays["clump"], np.unique(arrays["clump"]), **per_body)


def _arrays(file: str, data: bytes) -> dict[str, np.ndarray]:
    """The arrays by name. Raises InputError for a damaged file, unknown or missing names, and pickles."""
    known = (*_NEEDED, *PER_BODY)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            names = list(archive.files)
            strange = [name for name in names if name not in known]
            faults = [Fault(name, f"unknown array, {nearest(name, known)}", file) for name in strange]
            if not faults:
                lacking = [name for name in _NEEDED if name not in names]
                faults = [Fault(", ".join(lacking), f"missing, expected {', '.join(_NEEDED)}", file)] if lacking else []
            refuse(faults)
            return {name: _loaded(file, archive, name) for name in names}
    except InputError:
        raise
    # damage shows as whatever it leads zip, deflate and the header's parser into
    except (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, SyntaxError,
            zipfile.BadZipFile, zlib.error) as error:  # fmt: skip
        raise InputError(Fault("", f"is damaged or cut short ({_reason(error)}); write it again", file)) from None


def _loaded(file: str, archive: np.lib.npyio.NpzFile, name: str) -> np.ndarray:
    try:
        array = archive[name]
    except MemoryError:
        raise InputError(Fault(name, "does not fit into memory, or its header is damaged; write it again", file)) from None
    except ValueError as error:
        if "allow_pickle" not in str(error):
            raise InputError(Fault(name, f"is damaged ({_reason(error)}); write the file again", file)) from None
        raise InputError(Fault(name, "holds Python objects (a pickle), expected plain numbers", file)) from None
    if not isinstance(array, np.ndarray):
        raise InputError(Fault(name, "is no array of numbers", file))
    return array


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".strip().splitlines()[0][:120]


def _type_faults(file: str, arrays: dict[str, np.ndarray]) -> list[Fault]:
    faults = []
    for name, array in arrays.items():
        kinds, wanted = ("iu", "whole numbers, the ids of bodies") if name == "clump" else ("fiu", "real numbers")
        if array.dtype.kind not in kinds:
            faults.append(Fault(name, f"holds {array.dtype}, expected {wanted}", file))
    return faults


def _shape_faults(file: str, arrays: dict[str, np.ndarray]) -> list[Fault]:
    """Arrays that are not (n, 3), (n,), (n,) for n spheres or (m, 4), (m, 3), (m, 3) for m bodies."""
    clump = arrays["clump"]
    if clump.ndim != 1:
        return [Fault("clump", f"has shape {clump.shape}, expected (n,): one id for each sphere", file)]
    if not clump.size:
        return [Fault("clump", "holds no spheres", file)]
    n, m = clump.size, np.unique(clump).size
    wanted = {"center": ((n, 3), "spheres"), "radius": ((n,), "spheres")}
    wanted |= {name: ((m, width), "bodies, in the order of rising ids") for name, width in PER_BODY.items()}
    return [
        Fault(name, f"has shape {arrays[name].shape}, expected {shape}: clump names {shape[0]} {what}", file)
        for name, (shape, what) in wanted.items()
        if name in arrays and arrays[name].shape != shape
    ]


def _value_faults(file: str, arrays: dict[str, np.ndarray]) -> list[Fault]:
    faults = []
    for name, array in arrays.items():
        for place in np.argwhere(~np.isfinite(array)):
            spot = ", ".join(str(k) for k in place)
            faults.append(Fault(f"{name}[{spot}]", f"{array[tuple(place)]} is not a finite number", file))
    for k in np.flatnonzero(arrays["radius"] <= 0):
        faults.append(Fault(f"radius[{k}]", f"{arrays['radius'][k]:g} m must be greater than 0", file))
    for k in np.flatnonzero(arrays["clump"] < 0):
        faults.append(Fault(f"clump[{k}]", f"{arrays['clump'][k]} must be at least 0", file))
    return faults
