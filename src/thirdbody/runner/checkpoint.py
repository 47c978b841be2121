"""The checkpoint of a run: `checkpoint.npz` next to its trajectory, always replaced as a whole.

It holds plain arrays, and one JSON text with the scene and fingerprints of the inputs of the run; never a pickle. Its last bytes
are the SHA-256 of all before them, so a damaged file is recognised.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import zipfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from thirdbody.atomic_files import new_file
from thirdbody.engine.snapshot import Snapshot
from thirdbody.errors import Fault, InputError, OutputError
from thirdbody.jit import cache
from thirdbody.kernels.tables import body, body_extra, patch
from thirdbody.laws.generated import sources
from thirdbody.version import __version__

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

FILE = "checkpoint.npz"
VERSION = 14
SLICE, ROWS = 1 << 24, 1 << 16
"""Bytes of a file and rows of a table that are hashed at once."""

DIGEST = hashlib.sha256().digest_size
NOTES = "notes"
MEANS = "means_"
THE_VERSION, THE_INTEGRATOR = "the version", "the integrator"
"""Names of fingerprints: of the program; explicit or implicit."""

_DAMAGE = (OSError, EOFError, ValueError, KeyError, TypeError, RuntimeError, MemoryError, zipfile.BadZipFile)


@dataclass
class Checkpoint:
    """State of a run: frames written, targets reached (`stop`), impulses at the last frame.

    `scene` is the resolved text, `folder` that of the scene's file, `prints` the fingerprints of the inputs, `wall_time` [s] the
    time used so far, `violations` the number of successive checks in which the energy balance was off, `means` the state of the
    means over the output interval, `pressure` the largest peak pressure of the frames so far, `series` those of the last frame,
    `interval` the time [s] between it and the one before, `settling` how far settling was extended, and why.
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
    means: dict[str, np.ndarray] = field(default_factory=dict)
    pressure: dict[str, Any] = field(default_factory=dict)
    series: dict[str, Any] = field(default_factory=dict)
    interval: float = 0.0
    settling: dict[str, Any] = field(default_factory=dict)


def prints_of(simulation: Simulation) -> dict[str, str]:
    """Return fingerprints of the built scene at its start, by the names used in messages."""
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
            state.E[:, body_extra.LONGEST_ARM : body_extra.INERTIA + 3],
        ],
        "the parameters of laws and effects": [physics.pairs, physics.effect_parameters],
        "the motion of the plates": [state.schedule, state.first, *([state.drive[:3]] if state.sprung else [])],
    }
    if state.world.rough:
        tables["the surfaces of the plates"] = [state.lower_surface, state.upper_surface]
    if state.world.zone is not None:
        tables["the contact of the plates"] = [state.world.zone.row, state.P[:, patch.NOMINAL_LOAD]]
    prints = {name: _digest(arrays) for name, arrays in tables.items()}
    chain, effects, spots = simulation.choice.chain, simulation.choice.effects, simulation.choice.interactions
    labeller = simulation.labeller
    kernels = [f for law in chain.laws for f in (law.kernel, law.tangent) if f is not None]
    prints["the contact laws"] = f"{_named(chain.laws)}, sources {sources(kernels)}"
    prints["the effects"] = f"{_named(effects)}, sources {sources([effect.kernel for effect in effects])}"
    if measures := physics.measures:
        kernels = [measure.kernel for measure in simulation.choice.measures]
        cells = f"{measures.cells[0]} x {measures.cells[1]} cells"
        of = f"{_named(simulation.choice.measures)}, {_digest([measures.parameters])}, {cells}"
        prints["the measures"] = f"{of}, sources {sources(kernels)}"
    if spots:
        prints["the interaction of spots"] = f"{_named(spots)}, {_digest([physics.interaction])}"
    if labeller is not None:
        prints["the labeller"] = f"{labeller.name}, sources {sources([labeller.observe, labeller.label])}"
    return prints | {THE_INTEGRATOR: simulation.plan.kind, THE_VERSION: f"{__version__} {cache.folder().name}"}


def _named(things: Iterable[Any]) -> str:
    return " + ".join(thing.name for thing in things) or "none"


def _digest(arrays: list[np.ndarray]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(str((array.shape, array.dtype)).encode())
        for row in range(0, len(array), ROWS):
            digest.update(np.ascontiguousarray(array[row : row + ROWS]).tobytes())
    return digest.hexdigest()[:16]


def _digest_of(file: BinaryIO, size: float = math.inf) -> bytes:
    """Return the SHA-256 of the first `size` bytes of a file, read in slices: a checkpoint may be larger than free memory."""
    digest = hashlib.sha256()
    file.seek(0)
    while piece := file.read(int(min(size, SLICE))):
        digest.update(piece)
        size -= len(piece)
    return digest.digest()


def write_checkpoint(folder: Path, checkpoint: Checkpoint, named: Path | None = None) -> None:
    """Write the file and flush it to the disk. Raises OutputError and then leaves the previous checkpoint in place.

    `named`: the folder that a message names, if it is another one.
    """
    notes = vars(checkpoint) | {"version": VERSION, "snapshot": checkpoint.snapshot.notes}
    arrays = checkpoint.snapshot.arrays | {"impulses": notes.pop("impulses")}
    arrays |= {f"{MEANS}{name}": array for name, array in notes.pop("means").items()}
    arrays[NOTES] = np.frombuffer(json.dumps(notes).encode(), np.uint8)
    try:
        with new_file(folder / FILE) as file:
            _write_npz(file, arrays, checkpoint.snapshot.pieces)
            file.write(_digest_of(file))  # taken from the file: sizes in it are known, and filled in, last
            file.flush()
            os.fsync(file.fileno())
        _sync(folder)
    except OSError as error:
        before = "the one before is kept" if (folder / FILE).exists() else "there is none before it"
        raise OutputError(f"{(named or folder) / FILE}: cannot be written ({error.strerror or error}); {before}") from error


def _write_npz(file: BinaryIO, arrays: Mapping[str, np.ndarray], pieces: Mapping[str, list[np.ndarray]]) -> None:
    """Write arrays as `numpy.savez` does; further ones are written piece by piece, so none is held twice."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
        for name, parts in [*((name, [array]) for name, array in arrays.items()), *pieces.items()]:
            shape = (sum(len(part) for part in parts), *parts[0].shape[1:]) if parts[0].ndim else ()
            header = {"descr": parts[0].dtype.str, "fortran_order": False, "shape": shape}
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array_header_2_0(entry, header)
                for part in map(np.atleast_1d, parts):
                    for row in range(0, len(part), ROWS):
                        entry.write(np.ascontiguousarray(part[row : row + ROWS]).tobytes())


def _sync(folder: Path) -> None:
    """Make the new name survive a loss of power, where the system supports it."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def read_checkpoint(folder: Path) -> Checkpoint:
    """Return the checkpoint of a run. Raises InputError if it is missing, damaged or of another format."""
    path = folder / FILE
    if not path.is_file():
        raise InputError(f"{path}: no checkpoint, so this run cannot go on; run the scene again")
    try:
        with open(path, "rb") as file:
            size = max(file.seek(0, os.SEEK_END) - DIGEST, 0)
            whole = _digest_of(file, size) == file.read()
        if not whole:
            raise InputError(Fault("", "is damaged (its checksum is wrong); this run cannot go on", str(path)))
        with np.load(path) as archive:
            if sum(entry.file_size for entry in archive.zip.infolist()) > size:
                raise ValueError("its arrays claim more bytes than it has")
            arrays = dict(archive)
        notes = json.loads(arrays.pop(NOTES).tobytes())
        if (version := notes.pop("version")) != VERSION:
            raise InputError(f"{path}: format {version}, this version reads {VERSION}")
        for name in ("frames", "stop", "violations"):
            if not (isinstance(notes[name], int) and notes[name] >= 0):
                raise ValueError(f"notes: {name} is {notes[name]!r}, expected a whole number of at least 0")
        impulses = arrays.pop("impulses")
        means = {name.removeprefix(MEANS): arrays.pop(name) for name in list(arrays) if name.startswith(MEANS)}
        return Checkpoint(**notes | {"impulses": impulses, "means": means, "snapshot": Snapshot(arrays, notes["snapshot"])})
    except InputError:
        raise
    except _DAMAGE as error:
        raise InputError(f"{path}: cannot be read ({error or 'too large'})") from error


def read_prints(folder: Path) -> dict[str, str]:
    """Return the fingerprints of a run (`prints_of`) by name; none without a checkpoint that can be read."""
    with suppress(*_DAMAGE, AttributeError), np.load(folder / FILE) as archive:
        return {str(name): str(text) for name, text in json.loads(archive[NOTES].tobytes())["prints"].items()}
    return {}
