"""The checkpoint of a run: `checkpoint.npz` next to its trajectory, always replaced as a whole.

It holds plain arrays, and one JSON text with the scene, fingerprints of the inputs of the run and the names of the arrays; never
a pickle. Every array has a checksum (zip), so a damaged file is recognised.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import zipfile
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.engine.snapshot import LARGEST, Snapshot
from thirdbody.errors import Fault, InputError, OutputError
from thirdbody.kernels.columns import body, body_extra, run_totals

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

FILE = "checkpoint.npz"
VERSION = 6
NOTES = "notes"
THE_VERSION = "the version"


@dataclass
class Checkpoint:
    """State of a run: frames written, targets reached (`stop`), impulses at the last frame.

    `scene` is the resolved text, `folder` that of the scene's file, `prints` the fingerprints of the inputs, `wall_time` [s] the
    time used so far, `violations` the number of successive checks in which the energy balance was off.
    """

    scene: str
    folder: str
    prints: dict[str, str]
    frames: int
    stop: int
    wall_time: float
    force: bool
    violations: int
    impulses: np.ndarray
    snapshot: Snapshot


def prints_of(simulation: Simulation) -> dict[str, str]:
    """Return fingerprints of the built scene at its start, by the names used in messages."""
    from thirdbody import __version__
    from thirdbody.jit import cache_dir
    from thirdbody.laws.codegen.dependencies import sources

    state, physics = simulation.state, simulation.state.physics
    tables: dict[str, list[Any]] = {
        "the bodies at the start": [
            state.offsets,
            state.spheres.radius,
            state.body,
            state.material,
            state.bodies.position,
            state.B[:, body.VELOCITY : body.MASS + 1],
            state.bodies.quaternion,
            state.E[:, body_extra.REACH : body_extra.INERTIA + 3],
        ],
        "the parameters of laws and effects": [physics.pairs, physics.effect_parameters],
        "the motion of the plates": [state.schedule, state.first],
    }
    prints = {name: _digest(arrays) for name, arrays in tables.items()}
    chain, effects = simulation.choice.chain, simulation.choice.effects
    labeller = simulation.labeller
    kernels = [f for law in chain.laws for f in (law.kernel, law.tangent) if f is not None]
    prints["the contact laws"] = f"{_named(chain.laws)}, sources {sources(kernels)}"
    prints["the effects"] = f"{_named(effects)}, sources {sources([effect.kernel for effect in effects])}"
    if labeller is not None:
        prints["the labeller"] = f"{labeller.name}, sources {sources([labeller.observe, labeller.label])}"
    return prints | {"the integrator": simulation.plan.kind, THE_VERSION: f"{__version__} {cache_dir.folder().name}"}


def _named(things: Iterable[Any]) -> str:
    return " + ".join(thing.name for thing in things) or "none"


def _digest(arrays: list[np.ndarray]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(str((array.shape, array.dtype)).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def write_checkpoint(folder: Path, checkpoint: Checkpoint, named: Path | None = None) -> None:
    """Write the file and flush it to the disk. Raises OutputError and then leaves the previous checkpoint in place.

    `named`: the folder that a message names, if it is another one.
    """
    arrays: dict[str, Any] = {"impulses": checkpoint.impulses} | checkpoint.snapshot.arrays
    notes = {
        "version": VERSION,
        "scene": checkpoint.scene,
        "folder": checkpoint.folder,
        "prints": checkpoint.prints,
        "frames": checkpoint.frames,
        "stop": checkpoint.stop,
        "wall_time": checkpoint.wall_time,
        "force": checkpoint.force,
        "violations": checkpoint.violations,
        "snapshot": checkpoint.snapshot.notes,
        "arrays": sorted(arrays),
    }
    arrays[NOTES] = np.frombuffer(json.dumps(notes).encode(), np.uint8)
    part = folder / f"{FILE}.part"
    try:
        part.unlink(missing_ok=True)
        with open(part, "xb") as file:  # a new file: never the target of a link
            np.savez(file, **arrays)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, folder / FILE)
        _sync(folder)
    except OSError as error:
        with suppress(OSError):  # a read-only folder refuses that too
            part.unlink(missing_ok=True)
        before = "the one before is kept" if (folder / FILE).exists() else "there is none before it"
        raise OutputError(f"{(named or folder) / FILE}: cannot be written ({error.strerror or error}); {before}") from error


def _sync(folder: Path) -> None:
    """Make the new name survive a loss of power, where the system supports it."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # a system that cannot open folders
        return
    try:
        os.fsync(handle)
    except OSError:
        pass
    finally:
        os.close(handle)


def read_checkpoint(folder: Path) -> Checkpoint:
    """Return the checkpoint of a run. Raises InputError if it is missing, damaged or of another format."""
    path = folder / FILE
    if not path.is_file():
        raise InputError(f"{path}: no checkpoint, so this run cannot go on; run the scene again")
    try:
        arrays = _arrays(path)
        notes = json.loads(arrays.pop(NOTES).tobytes(), parse_constant=_constant)
        if notes["version"] != VERSION:
            raise InputError(f"{path}: format {notes['version']}, this version reads {VERSION}")
        if set(notes["arrays"]) != set(arrays):  # zip's own list of contents has no checksum
            raise ValueError("arrays are missing, or too many")
        impulses = arrays.pop("impulses")
        if impulses.shape != (7,) or impulses.dtype != np.float64:
            raise ValueError("the impulses are no seven numbers")
        _refuse_lies(notes, arrays)
        prints = {str(key): str(value) for key, value in notes["prints"].items()}
        return Checkpoint(
            str(notes["scene"]), str(notes["folder"]), prints, int(notes["frames"]), int(notes["stop"]),
            float(notes["wall_time"]), bool(notes["force"]), int(notes["violations"]), impulses,
            Snapshot(arrays, dict(notes["snapshot"])),
        )  # fmt: skip
    except InputError:
        raise
    # damage can cause any exception of zip, the header parser or JSON
    except (OSError, ValueError, EOFError, KeyError, TypeError, AttributeError, NotImplementedError, RuntimeError, SyntaxError,
            MemoryError, OverflowError, RecursionError, zipfile.BadZipFile) as error:  # fmt: skip
        what = f"{type(error).__name__}: {error}".splitlines()[0][:120]
        raise InputError(Fault("", f"is damaged ({what}); this run cannot go on", str(path))) from None


def _constant(word: str) -> float:
    """Accept Infinity, the stable step where nothing touches; no other constant that is not a number."""
    if word != "Infinity":
        raise ValueError(f"holds {word}")
    return math.inf


def _refuse_lies(notes: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    """Raise KeyError, ValueError or TypeError for counts and times that no run can have."""
    inner = notes["snapshot"]
    counts = {name: notes[name] for name in ("frames", "stop", "violations")} | {
        name: inner[name] for name in ("searches", "plates")
    }
    for name, count in counts.items():
        if type(count) is not int or not 0 <= count < 2**31:
            raise ValueError(f"{name}: {str(count)[:40]}")
    A = arrays["A"]
    # a run at a negative time would take forever to reach its start
    if A.shape != (run_totals.WIDTH,) or not A[[run_totals.TIME, run_totals.DISTANCE, run_totals.STEPS]].min() >= 0.0:
        raise ValueError("its clock stands before the start")
    times = {"wall_time": notes["wall_time"], "dt": inner["dt"], "energy_start": inner["energy_start"]}
    for name, value in (times | {"energy_peak": inner["energy_peak"]}).items():
        if type(value) not in (int, float) or not 0.0 <= value <= LARGEST:
            raise ValueError(f"{name}: {str(value)[:40]}")


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of the file, none larger than its data in the file. Raises what zip and numpy raise."""
    arrays = {}
    with zipfile.ZipFile(path) as archive:
        claimed, there = sum(item.file_size for item in archive.infolist()), path.stat().st_size
        if claimed > there:  # entries that share their bytes
            raise ValueError(f"its arrays claim {claimed} bytes, the file has {there}")
        for item in archive.infolist():
            if item.compress_type != zipfile.ZIP_STORED or item.file_size != item.compress_size:
                raise ValueError(f"{item.filename} is packed")
            arrays[item.filename.removesuffix(".npy")] = _array(archive.read(item))
    return arrays


def _array(data: bytes) -> np.ndarray:
    """Return an array of plain numbers from the bytes of an .npy file whose header matches the data."""
    import io

    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    reader = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}.get(version)
    if reader is None:
        raise ValueError(f"format {version} of arrays is unknown")
    shape, fortran, dtype = reader(stream)
    if dtype.kind not in "fiu" or fortran:
        raise ValueError(f"holds {dtype}, expected plain numbers")
    size = int(np.prod(shape, dtype=object)) * dtype.itemsize
    if size != len(data) - stream.tell():
        raise ValueError("an array is longer or shorter than its header says")
    array = np.frombuffer(data, dtype, offset=stream.tell()).reshape(shape).copy()
    with np.errstate(over="ignore"):  # extended precision may exceed the range of a double
        if dtype.kind == "f" and not np.all(np.abs(array) <= LARGEST):
            raise ValueError("an array holds what is no number of a run")
    return array
