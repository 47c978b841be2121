"""Result files, tables, meshes and paths spoilt at random, and the worker that reads them in a process of its own.

HDF5 is C code that walks a damaged file: should it ever die of one, only the worker does, and the test tells the file.
`python file_mutants.py` reads names of files, one a line, and answers each with a line: what became of it.
"""

from __future__ import annotations

import io
import json
import pickle
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from random import Random

import h5py
import numpy as np

HUGE = 10**12
HEAD = 4000  # bytes at the front in which HDF5 keeps most of what it navigates by

Spoil = Callable[[Path, Random], None]


def flip(data: bytes, rng: Random) -> bytes:
    """Bytes flipped, mostly in the head, or a stretch of zeros, or others in its place."""
    out = bytearray(data)
    kind = rng.choice(("one", "few", "many", "zeros", "junk", "moved"))
    if kind in ("one", "few", "many"):
        for _ in range({"one": 1, "few": 8, "many": 200}[kind]):
            out[rng.randrange(min(len(out), HEAD) if rng.random() < 0.6 else len(out))] ^= 1 << rng.randrange(8)
        return bytes(out)
    at, length = rng.randrange(len(out)), rng.choice((4, 64, 2000))
    other = rng.randrange(len(out))
    new = {
        "zeros": bytes(length),
        "junk": bytes(rng.randrange(256) for _ in range(length)),
        "moved": data[other : other + length],
    }
    out[at : at + length] = new[kind]
    return bytes(out)


def cut(data: bytes, rng: Random) -> bytes:
    """The first part of it."""
    return data[: rng.randrange(len(data))]


def spoil_tree(path: Path, rng: Random) -> None:
    """One thing of an HDF5 file changed: gone, of another shape or type, of a huge claim, linked in circles, or out of range."""
    with h5py.File(path, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        chosen = rng.choice(names)
        node = file[chosen]
        kinds = ["delete", "attribute", "loop", "group", "steps"] + ["replace", "huge", "values", "empty"] * 3
        if chosen.startswith("scene/") and rng.random() < 0.7:
            kinds = ["text"]
        elif isinstance(node, h5py.Group):
            kinds = ["delete", "attribute", "loop", "steps"]
        _SPOILS[rng.choice(kinds)](file, chosen, rng)


def _delete(file: h5py.File, name: str, rng: Random) -> None:
    del file[name]


def _attribute(file: h5py.File, name: str, rng: Random) -> None:
    attrs = file[name].attrs
    given = list(attrs)
    if not given:
        attrs["json"] = HUGE
    elif rng.random() < 0.4:
        del attrs[rng.choice(given)]
    else:
        attrs[rng.choice(given)] = rng.choice((HUGE, -1, np.nan, "text", [1, 2, 3], np.zeros((3, 3)), b"\xff", 2**63, np.inf))


def _steps(file: h5py.File, name: str, rng: Random) -> None:
    bad = rng.choice((HUGE, -1, 2**62, -(2**63), 1.5, np.nan, "3", [3, 3], 0))
    for block in ("spheres", "clumps", "contacts", "plates"):
        file[f"VTKHDF/{block}/Steps"].attrs["NSteps"] = bad
    file["series"].attrs["NSteps"] = bad


def _loop(file: h5py.File, name: str, rng: Random) -> None:
    del file[name]
    file[name] = rng.choice(
        (h5py.SoftLink("/"), h5py.SoftLink(f"/{name}"), h5py.SoftLink("/nowhere"), file["/"], h5py.SoftLink("/scene"))
    )


def _group(file: h5py.File, name: str, rng: Random) -> None:
    del file[name]
    file.create_group(name)


def _keep(file: h5py.File, name: str, make: Callable[[], object]) -> None:
    """Another data set in place of this one, with the same attributes."""
    attrs = dict(file[name].attrs)
    del file[name]
    make()
    file[name].attrs.update(attrs)


def _replace(file: h5py.File, name: str, rng: Random) -> None:
    old = file[name]
    new = rng.choice(
        (
            np.float64(1.0),
            np.array([], float),
            np.zeros((2, 3, 4)),
            np.array([b"text"]),
            np.zeros(5, [("a", int), ("b", float)]),
            np.zeros(3, complex),
            np.full(old.shape, -1),
            np.full(old.shape, np.nan),
            np.zeros((*old.shape, 2)),
            np.zeros(old.shape, bool),
            np.full(old.shape, 2**62),
            np.full(old.shape, 255, np.uint8),
            np.zeros((1, 500)),
            h5py.Empty("f8"),
        )
    )
    _keep(file, name, lambda: file.create_dataset(name, data=new))


def _huge(file: h5py.File, name: str, rng: Random) -> None:
    dtype = file[name].dtype if file[name].dtype.kind in "fiu" else np.dtype(float)
    shape = rng.choice(((HUGE,), (HUGE, 3), (4, HUGE), (2**40, 2**20), (10**6, 10**6)))
    packed = {"compression": "gzip", "chunks": tuple(min(n, 1000) for n in shape)} if rng.random() < 0.5 else {"chunks": True}
    _keep(file, name, lambda: file.create_dataset(name, shape, dtype, **packed))


def _empty(file: h5py.File, name: str, rng: Random) -> None:
    if file[name].chunks:
        file[name].resize(rng.choice((0, 1)), 0)


def _values(file: h5py.File, name: str, rng: Random) -> None:
    node = file[name]
    if node.dtype.kind in "fiu" and node.shape and node.size:
        at = rng.randrange(len(node))
        row = node[at]
        bad = rng.choice((255, 127, 2**62, -1)) if node.dtype.kind != "f" else rng.choice((np.nan, np.inf, -1e300, 1e300))
        with np.errstate(all="ignore"):
            node[at] = np.full(np.shape(row), bad).astype(node.dtype)


def _text(file: h5py.File, name: str, rng: Random) -> None:
    text = rng.choice(
        (
            "",
            "{",
            "null",
            "[]",
            "{}",
            "3",
            "[" * 100_000,
            '"x"',
            '{"size": [NaN, 1]}',
            '{"clumps": ["no"]}',
            "[1, 2]",
            '{"a": {"b": []}}',
            '["a"]',
            '{"clumps": 3}',
            "1e999",
            "[null]",
        )
    )
    _keep(file, name, lambda: file.create_dataset(name, data=text))


_SPOILS = {
    "delete": _delete,
    "attribute": _attribute,
    "steps": _steps,
    "loop": _loop,
    "group": _group,
    "replace": _replace,
    "huge": _huge,
    "empty": _empty,
    "values": _values,
    "text": _text,
}


def bomb(rng: Random) -> bytes:
    """An archive whose arrays claim, or unpack to, far more than it holds."""
    out = io.BytesIO()
    shape = rng.choice(((HUGE,), (HUGE, 3), (2**40, 2**40), (-1,), (3, 10**9), (30_000_000,)))
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("center", "radius", "clump"):
            array = io.BytesIO()
            descr = rng.choice(("<f8", "<i8", "|O", "|V1000000000", "<U100000000"))
            np.lib.format.write_array_header_1_0(array, {"descr": descr, "fortran_order": False, "shape": shape})
            archive.writestr(f"{name}.npy", array.getvalue() + bytes(rng.choice((0, 64, 240_000_000))))
    return out.getvalue()


class Trap:
    """What a pickle would call when it is loaded."""

    def __reduce__(self) -> tuple:
        return (Path.touch, (Path("sprung"),))


def hostile_npz(data: bytes, rng: Random) -> bytes:
    """The archive with one array replaced by a pickle, by odd numbers or another shape, or under a name that leads elsewhere."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = dict(archive)
    name = rng.choice(list(arrays))
    array = arrays[name]
    new = (
        np.array([Trap()], object),
        array.astype(complex),
        array.astype(str),
        array[:1],
        array.T[:2],
        np.full_like(array, -1),
        array[()] * 0,
        np.zeros((0, 3)),
        array.astype(np.float16),
        np.array(None),
        array.astype(float) * 1e300,
        array.astype(float) * np.nan,
    )
    arrays[name] = rng.choice(new)
    if rng.random() < 0.2:
        arrays["../../" + name] = arrays.pop(name)
    out = io.BytesIO()
    with np.errstate(all="ignore"):
        np.savez(out, **arrays)
    return out.getvalue() if rng.random() < 0.9 else pickle.dumps(Trap())


def read_run(path: Path) -> None:
    """Everything that the reader of a run gives."""
    import thirdbody
    from thirdbody.export.csv_tables import export_csv
    from thirdbody.trajectory.stored_frames import static_arrays

    with thirdbody.open(path) as run:
        repr(run), run.scene_text, run.summary(), run.times, run.series, run.units, static_arrays(run)
        for frame in range(run.frames):
            for block in ("spheres", "clumps", "contacts", "plates"):
                run.block(block, frame)
        if run.frames and run.has_states:
            run.states, run.reasons, run.transitions()
        with tempfile.TemporaryDirectory() as folder:
            if run.frames:
                export_csv(run, Path(folder) / "csv")


def read_scene(path: Path) -> None:
    """The bodies, or the motion, that a scene has from the file."""
    from thirdbody.assembly.populate import populate
    from thirdbody.assembly.schedule import schedule
    from thirdbody.scene.model import Scene

    scene = Scene.load(path)
    schedule(scene, 0.0)
    populate(scene, [])


def read_balance(path: Path) -> None:
    """The spots of a balance file."""
    from thirdbody_three_spot.balance_file import BalanceFile

    BalanceFile.load(path).spots()


READERS = {".vtkhdf": read_run, ".balance": read_balance, ".toml": read_scene}


def serve() -> None:
    """Reads the files named on standard input, a line each; answers [kind, text, seconds]."""
    import resource
    import traceback

    from thirdbody.errors import ThirdbodyError

    resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
    for line in sys.stdin:
        path, started = Path(line.rstrip("\n")), time.process_time()
        try:
            READERS[path.suffix](path)
            report = ["accepted", ""]
        except ThirdbodyError as error:
            report = ["refused", str(error)]
        except BaseException as error:
            report = ["bug", f"{type(error).__name__}: {error} {''.join(traceback.format_tb(error.__traceback__)[-4:])}"]
        print(json.dumps([*report, time.process_time() - started]), flush=True)


if __name__ == "__main__":
    serve()
