"""Result files, tables, meshes, paths and folders of runs spoilt at random, and the worker that reads them or puts them through
the commands, in a process of its own: HDF5 is C code that walks a damaged file; should it ever die of one, only the worker does.

`python file_mutants.py` reads lines from standard input: the name of a file, or in JSON [folder, target folder, command]. Each
answer tells what became of it (of a command the exit code), what was told, and the seconds of the processor."""

import io
import json
import pickle
import resource
import sys
import tempfile
import time
import traceback
import zipfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from random import Random

import h5py
import numpy as np

HUGE = 10**12
HEAD = 4000  # bytes at the front in which HDF5 keeps most of what it navigates by
TRAJECTORY, CHECKPOINT, SCENE = "run.vtkhdf", "checkpoint.npz", "scene.toml"
BUG = "bug"


def flip(data: bytes, rng: Random) -> bytes:
    out = bytearray(data)
    kind = rng.choice(("one", "few", "many", "zeros", "junk", "moved"))
    if kind in ("one", "few", "many"):
        for _ in range({"one": 1, "few": 8, "many": 200}[kind]):
            out[rng.randrange(min(len(out), HEAD) if rng.random() < 0.6 else len(out))] ^= 1 << rng.randrange(8)
        return bytes(out)
    at, length = rng.randrange(len(out)), rng.choice((4, 64, 2000))
    other = rng.randrange(len(out))
    junk = bytes(rng.randrange(256) for _ in range(length))
    out[at : at + length] = {"zeros": bytes(length), "junk": junk, "moved": data[other : other + length]}[kind]
    return bytes(out)


def cut(data: bytes, rng: Random) -> bytes:
    return data[: rng.randrange(len(data))]


def spoil_tree(path: Path, rng: Random) -> None:
    """One thing of an HDF5 file changed: gone, of another shape or type, of a huge claim, or out of range."""
    with h5py.File(path, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        chosen = rng.choice(names)
        kind = rng.choice(["delete"] + ["replace", "huge", "values", "empty"] * 2)
        if chosen.startswith("scene/") and rng.random() < 0.7:
            kind = "text"
        elif isinstance(file[chosen], h5py.Group):
            kind = "delete"
        if kind in ("replace", "huge", "text"):
            _other_data(file, chosen, kind, rng)
        else:
            _spoil_node(file, chosen, kind, rng)


TEXTS = (
    "", "{", "null", "[]", "{}", "3", "[" * 100_000, '"x"', '{"size": [NaN, 1]}', '{"clumps": ["no"]}', "[1, 2]",
    '{"a": {"b": []}}', '["a"]', '{"clumps": 3}', "1e999", "[null]",
)  # fmt: skip


def _other_data(file: h5py.File, name: str, kind: str, rng: Random) -> None:
    attrs, shape, dtype = dict(file[name].attrs), getattr(file[name], "shape", ()), getattr(file[name], "dtype", None)
    made = {"data": rng.choice(TEXTS)} if kind == "text" else {}
    if kind == "replace":
        made["data"] = rng.choice((
            np.float64(1.0), np.array([], float), np.zeros((2, 3, 4)), np.array([b"text"]),
            np.zeros(5, [("a", int), ("b", float)]), np.zeros(3, complex), np.full(shape, -1), np.full(shape, np.nan),
            np.zeros((*shape, 2)), np.zeros(shape, bool),
            np.full(shape, 2**62), np.full(shape, 255, np.uint8), np.zeros((1, 500)), h5py.Empty("f8"),
        ))  # fmt: skip
    if kind == "huge":
        claimed = rng.choice(((HUGE,), (HUGE, 3), (4, HUGE), (2**40, 2**20), (10**6, 10**6)))
        made = {"shape": claimed, "dtype": dtype if dtype.kind in "fiu" else np.dtype(float), "chunks": True}
        if rng.random() < 0.5:
            made |= {"compression": "gzip", "chunks": tuple(min(n, 1000) for n in claimed)}
    del file[name]
    file.create_dataset(name, **made)
    file[name].attrs.update(attrs)


def _spoil_node(file: h5py.File, name: str, kind: str, rng: Random) -> None:
    node = file[name]
    if kind == "delete":
        del file[name]
    elif kind == "empty" and node.chunks:
        node.resize(rng.choice((0, 1)), 0)
    elif kind == "values" and node.dtype.kind in "fiu" and node.shape and node.size:
        at = rng.randrange(len(node))
        bad = rng.choice((255, 127, 2**62, -1)) if node.dtype.kind != "f" else rng.choice((np.nan, np.inf, -1e300, 1e300))
        with np.errstate(all="ignore"):
            node[at] = np.full(np.shape(node[at]), bad).astype(node.dtype)


def bomb(rng: Random) -> bytes:
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
    def __reduce__(self) -> tuple:
        return (Path.touch, (Path("sprung"),))


def hostile_npz(data: bytes, rng: Random) -> bytes:
    """The archive with one array replaced by a pickle, by odd numbers or another shape, or under a name that leads elsewhere."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = dict(archive)
    name = rng.choice(list(arrays))
    array = arrays[name]
    new = (
        np.array([Trap()], object), array.astype(complex), array.astype(str), array[:1], array.T[:2], np.full_like(array, -1),
        array[()] * 0, np.zeros((0, 3)), array.astype(np.float16), np.array(None), array.astype(float) * 1e300,
        array.astype(float) * np.nan,
    )  # fmt: skip
    arrays[name] = rng.choice(new)
    if rng.random() < 0.2:
        arrays["../../" + name] = arrays.pop(name)
    out = io.BytesIO()
    with np.errstate(all="ignore"):
        np.savez(out, **arrays)
    return out.getvalue() if rng.random() < 0.9 else pickle.dumps(Trap())


def spoil_folder(folder: Path, rng: Random) -> str:
    kind = rng.choice((*[TRAJECTORY] * 4, CHECKPOINT, SCENE))
    path = folder / kind
    if rng.random() < 0.1:
        _gone(path, rng)
    elif kind != TRAJECTORY:
        path.write_bytes(rng.choice((cut, flip))(path.read_bytes(), rng))
    else:
        how = rng.choice(("bytes", "tree", "tree", "nan", "tree"))
        if how == "bytes":
            path.write_bytes(rng.choice((cut, flip))(path.read_bytes(), rng))
        elif how == "tree":
            spoil_tree(path, rng)
        else:
            _all_nan(path, rng)
    return kind


def _gone(path: Path, rng: Random) -> None:
    how = rng.choice(("missing", "empty", "folder", "dangling", "loop"))
    path.unlink()
    if how == "empty":
        path.touch()
    elif how == "folder":
        path.mkdir()
    elif how in ("dangling", "loop"):
        path.symlink_to("nowhere" if how == "dangling" else path.name)


def _all_nan(path: Path, rng: Random) -> None:
    with h5py.File(path, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        sets = [name for name in names if isinstance(file[name], h5py.Dataset)]
        found = [name for name in sets if file[name].dtype.kind == "f" and file[name].size]
        for name in found if rng.random() < 0.2 else rng.sample(found, 1):
            file[name][...] = rng.choice((np.nan, np.nan, np.inf, -np.inf, 1e308, 0.0))


# what is asked: name -> arguments after the run, with {} for the folder of results
COMMANDS: dict[str, list[str]] = {
    "states": [], "states json": ["--json"], "states frame": ["--frame", "-1"], "states picture": ["-o", "{}/forecast.png"],
    "plot": ["-o", "{}/plot.svg"], "render page": ["-o", "{}/page.html"],
    "render picture": ["-o", "{}/picture.png", "--width", "200", "--height", "200"],
    "render forces": ["-o", "{}/forces.png", "--width", "200", "--height", "200", "--forces", "--color", "utilisation"],
    "render body": ["-o", "{}/body.png", "--width", "200", "--height", "200", "--body", "1"],
    "render film": ["-o", "{}/film.gif", "--width", "200", "--height", "200", "--frames", "::2"],
    "export csv": ["--csv", "{}/csv"], "export pvd": ["--pvd", "{}/pvd"], "resume": ["--quiet"],
}  # fmt: skip


def read_run(path: Path) -> None:
    import thirdbody
    from thirdbody.export.tables import export_csv
    from thirdbody.trajectory.writer import static_arrays

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
    from thirdbody.assembly.populate import populate
    from thirdbody.assembly.schedule import schedule
    from thirdbody.scene.model import Scene

    scene = Scene.load(path)
    schedule(scene, 0.0)
    populate(scene, [])


def read_balance(path: Path) -> None:
    from thirdbody_three_spot.balance_file import BalanceFile

    BalanceFile.load(path).spots()


READERS = {".vtkhdf": read_run, ".balance": read_balance, ".toml": read_scene}


def run_command(folder: str, target: str, command: str) -> str:
    from thirdbody.cli.main import app
    from thirdbody.render import render

    # by a second process it would cost seconds; windows are chosen when the worker starts
    render.draw_elsewhere = lambda module, job, report=None: render.draw(json.loads(json.dumps(job)))
    report = io.StringIO()
    with redirect_stdout(io.StringIO()), redirect_stderr(report):
        app([command.split()[0], folder, *(word.format(target) for word in COMMANDS[command])], standalone_mode=False)
    return report.getvalue()


def answer(line: str) -> tuple[object, str]:
    from thirdbody.errors import ThirdbodyError

    asked = line.startswith("[")
    try:
        said = run_command(*json.loads(line)) if asked else READERS[Path(line).suffix](Path(line))
        return (0, said) if asked else ("accepted", "")
    except ThirdbodyError as error:
        return error.exit_code if asked else "refused", str(error)
    except BaseException as error:
        return BUG, f"{type(error).__name__}: {error} {''.join(traceback.format_tb(error.__traceback__)[-5:])}"


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (16 << 30, 16 << 30))
    answers = sys.stdout
    for line in sys.stdin:
        started = time.process_time()
        found = answer(line.rstrip("\n"))
        print(json.dumps([*found, time.process_time() - started]), flush=True, file=answers)
