"""Folders of runs spoilt at random, and the worker that puts them through the commands, in a process of its own.

`python run_mutants.py` reads lines of JSON, [folder, target folder, command], and answers each with [exit code, what was told,
seconds of the processor]; -1 stands for an exception that is none of ours.
"""

from __future__ import annotations

import io
import json
import shutil
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np

TRAJECTORY, CHECKPOINT, SCENE = "run.vtkhdf", "checkpoint.npz", "scene.toml"
BUG = -1


def spoil_folder(folder: Path, rng: Random, files: Any) -> str:
    """One file of a run's folder spoilt; returns which. `files` is the module of spoilt files."""
    kind = rng.choice((*[TRAJECTORY] * 4, CHECKPOINT, SCENE))
    path = folder / kind
    if rng.random() < 0.1:
        _gone(path, rng)
    elif kind != TRAJECTORY:
        path.write_bytes(rng.choice((files.cut, files.flip))(path.read_bytes(), rng))
    else:
        how = rng.choice(("bytes", "tree", "tree", "nan", "tree"))
        if how == "bytes":
            path.write_bytes(rng.choice((files.cut, files.flip))(path.read_bytes(), rng))
        elif how == "tree":
            files.spoil_tree(path, rng)
        else:
            _all_nan(path, rng)
    return kind


def _gone(path: Path, rng: Random) -> None:
    """The file is not there, empty, a folder, or leads nowhere or in circles."""
    how = rng.choice(("missing", "empty", "folder", "dangling", "loop"))
    path.unlink()
    if how == "empty":
        path.touch()
    elif how == "folder":
        path.mkdir()
    elif how in ("dangling", "loop"):
        path.symlink_to("nowhere" if how == "dangling" else path.name)


def _all_nan(path: Path, rng: Random) -> None:
    """One array, or all of them, not a number: sound in form."""
    with h5py.File(path, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        sets = [name for name in names if isinstance(file[name], h5py.Dataset)]
        found = [name for name in sets if file[name].dtype.kind == "f" and file[name].size]
        for name in found if rng.random() < 0.2 else rng.sample(found, 1):
            file[name][...] = rng.choice((np.nan, np.nan, np.inf, -np.inf, 1e308, 0.0))


# what is asked: name -> arguments after the run, with {} for the folder of results
COMMANDS: dict[str, list[str]] = {
    "states": [],
    "states json": ["--json"],
    "states frame": ["--frame", "-1"],
    "states picture": ["-o", "{}/forecast.png"],
    "plot": ["-o", "{}/plot.svg"],
    "render page": ["-o", "{}/page.html"],
    "render picture": ["-o", "{}/picture.png", "--width", "200", "--height", "200"],
    "render forces": ["-o", "{}/forces.png", "--width", "200", "--height", "200", "--forces", "--color", "utilisation"],
    "render body": ["-o", "{}/body.png", "--width", "200", "--height", "200", "--body", "1"],
    "render film": ["-o", "{}/film.gif", "--width", "200", "--height", "200", "--frames", "::2"],
    "export csv": ["--csv", "{}/csv"],
    "export pvd": ["--pvd", "{}/pvd"],
    "resume": ["--quiet"],
}


def _drawn_here(job: dict, windows: list[str | None], report: object = None) -> None:
    """What `render` has drawn by a second process, which would cost seconds; windows are chosen when the worker starts."""
    from thirdbody.render.worker import draw_run

    draw_run(json.loads(json.dumps(job)))


def answer(folder: str, target: str, command: str) -> tuple[int, str]:
    """Exit code of a command, and what it told of a fault."""
    import traceback

    from thirdbody.cli.main import app
    from thirdbody.errors import ThirdbodyError
    from thirdbody.render import render

    render.draw_elsewhere = _drawn_here
    words = [command.split()[0], folder, *(word.format(target) for word in COMMANDS[command])]
    report = io.StringIO()
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(report):
            app(words, standalone_mode=False)
    except ThirdbodyError as error:
        return error.exit_code, str(error)
    except BaseException as error:
        return BUG, f"{type(error).__name__}: {error} {''.join(traceback.format_tb(error.__traceback__)[-5:])}"
    return 0, report.getvalue()


def serve(request_from: Callable[..., tuple[int, str]] = answer) -> None:
    """Answers what standard input asks, line by line."""
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (16 << 30, 16 << 30))
    out = sys.stdout
    for line in sys.stdin:
        started = time.process_time()
        found = request_from(*json.loads(line))
        print(json.dumps([*found, time.process_time() - started]), flush=True, file=out)


def copied(sound: Path, folder: Path) -> Path:
    """A copy of a sound run's folder."""
    return Path(shutil.copytree(sound, folder))


if __name__ == "__main__":
    serve()
