"""Absurd command lines, and a process that plays them: `python command_lines.py FOLDER` reads one JSON list of words a line.

It imports the program once and forks for each line, so that a line takes a tenth of a second; the answer is a line of JSON.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

ESCAPE, BREAK, BYTES = "\x1b[31mx", "a\nb", os.fsdecode(b"\xff\xfe")
LONG, DEEP, HUGE = "x" * 300, "x/" * 3000, "9" * 20
ODD = (ESCAPE, BREAK, BYTES)
NUMBERS = ("0", "-1", "1e-300", "nan", "inf", "-inf", "1e300", HUGE, f"-{HUGE}", "", "1e3", "0x10")
PATIENCE = 120
"""Seconds after which a line hangs."""
MEMORY = 12 << 30
"""Address space of a line, bytes: HDF5, VTK and LLVM map some 5 GB."""

FILES = (
    "dir",
    "dir.toml",
    "empty.toml",
    "latin.toml",
    "nul.toml",
    "bom.toml",
    "utf16.toml",
    "dangling.toml",
    "loop.toml",
    "pipe.toml",
    "mesh.stl",
    "run/run.vtkhdf",
    "nowhere.toml",
    "",
    ".",
    "/",
    "~",
    "-",
    "/dev/null",
    "/dev/full",
    "/dev/zero",
    LONG,
    DEEP,
    *(f"{name}.toml" for name in ODD),
    "scene.toml/x",
    "scene.toml\n",
    "https://example.org/x.toml",
)
RUNS = (
    "dir",
    "run_empty",
    "run_hollow",
    "empty.toml",
    "scene.toml",
    "",
    ".",
    "/",
    "/dev/null",
    "/dev/zero",
    LONG,
    DEEP,
    "pipe.toml",
    *ODD,
    "dangling.toml",
    "loop.toml",
    "nowhere",
    "run/run.spheres.vtkhdf",
    "run/checkpoint.npz",
)
OUTPUTS = (
    "/dev/full",
    "/dev/null",
    "/dev/null/x.png",
    "dir",
    "dir.png",
    ".",
    "/",
    "",
    "nowhere/x.png",
    f"{LONG}.png",
    f"{DEEP}x.png",
    *(f"{name}.png" for name in ODD),
    "/proc/x.png",
    "scene.toml",
    "x.jpg",
    ".png",
    "run/run.vtkhdf",
)
PLUGINS = (
    "bad.py",
    "exit.py",
    "syntax.py",
    "none.py",
    "latin.py",
    "empty.toml",
    "dir",
    "nowhere.py",
    "",
    "/dev/null",
    LONG,
    *ODD,
)
SETTINGS = (
    "",
    "=",
    "a",
    "a=",
    "=1",
    "a=1",
    f"title={ESCAPE}",
    f"title={BREAK}",
    f"title={BYTES}",
    "title=\u4e2d",
    "title=[1",
    "solver.distance=nan um",
    "solver.distance=1e300 m",
    f"debris.0.count={HUGE}",
    "debris.0.count=-1",
    f"debris.{HUGE}.count=1",
    "debris.x.count=1",
    "a." * 5000 + "=1",
    "debris.0.count=" + "9" * 5000,
    "debris.0.count=" + "[" * 5000,
    "scene=2",
    "solver=1",
    "output.every=1e-300 m",
    f"materials.{ESCAPE}.density=1",
    "debris.-1.count=2",
    'solver.distance="""',
)
RUN = ("run", "-q", "--overwrite", "--threads", "1")
SMALL = ("--width=200", "--height=200")


def on_files() -> Iterator[list[str]]:
    """Scenes that are none."""
    for name in FILES:
        for words in (("check",), RUN, ("shapes",), ("balance",), ("cost", "--budget", "1e-9 s", "--overwrite")):
            yield [*words, name]


def on_runs() -> Iterator[list[str]]:
    """Runs that are none."""
    for name in RUNS:
        yield ["states", name]
        yield ["states", name, "--json"]
        yield ["render", name, "-o", "q.png", *SMALL]
        yield ["plot", name, "-o", "q.png"]
        yield ["export", name, "--csv", "q", "--overwrite"]
        yield ["resume", name, "--threads", "1", "-q"]


def on_outputs() -> Iterator[list[str]]:
    """Files that cannot be written, or should not."""
    for name in OUTPUTS:
        yield ["plot", "run", "-o", name]
        yield ["render", "run", *SMALL, "-o", name]
        yield ["render", "run", "-o", name.replace(".png", ".html")]
        yield ["states", "run", "-o", name]
        yield ["shapes", "scene.toml", "-o", name]
        yield ["map", "-o", name]
        yield from (["export", "run", kind, name] for kind in ("--csv", "--pvd"))
        yield ["run", "scene.toml", "-q", "--threads", "1", "-o", name]
        yield ["new", name]
        yield ["cost", "scene.toml", "--budget", "1e-9 s", "-o", name]


def on_plugins() -> Iterator[list[str]]:
    """Plug-ins that are none."""
    for name in PLUGINS:
        for words in (("laws", "--check"), ("laws", "--plugin"), ("check", "scene.toml", "--plugin")):
            yield [*words, name]


def on_settings() -> Iterator[list[str]]:
    """Values of --set."""
    resume = ("resume", "run", "-q", "--threads", "1")
    for text in SETTINGS:
        for words in (("check", "scene.toml"), (*RUN, "scene.toml"), resume, ("shapes", "scene.toml")):
            yield [*words, "--set", text]


def on_options() -> Iterator[list[str]]:
    """Values of options that take numbers and names."""
    options = {
        ("render", "run", "-o", "q.png", *SMALL): ("zoom", "frame", "body", "fps", "width", "height", "view", "color", "camera"),
        ("render", "run", "-o", "q.gif", *SMALL): ("frames", "fps", "body"),
        ("plot", "run", "-o", "q.png"): ("frame", "panel"),
        ("states", "run"): ("frame",),
        ("export", "run", "--csv", "q", "--overwrite"): ("frame",),
        ("map", "--json"): ("H", "half-width"),
        ("balance", "balance.toml"): ("level",),
        ("cost", "scene.toml"): ("repeats",),
        (*RUN[:-2], "scene.toml"): ("threads", "wall-limit", "checkpoint-every"),
        ("shapes", "mesh.stl", "--unit", "1 um"): ("spheres", "seed"),
        ("shapes", "mesh.stl"): ("unit",),
    }
    for words, names in options.items():
        for name in names:
            yield from ([*words, f"--{name}={value}"] for value in (*NUMBERS, *ODD))


LINES = {
    "files": on_files,
    "runs": on_runs,
    "outputs": on_outputs,
    "plug-ins": on_plugins,
    "settings": on_settings,
    "options": on_options,
}


def furnish(folder: Path, scene: str, mesh: Path) -> None:
    """Write what the command lines name; `run` has to be there."""
    for name in ("dir", "dir.toml", "dir.png", "run_empty", "run_hollow"):
        (folder / name).mkdir()
    text = scene.encode()
    contents = {
        "scene.toml": text,
        "bom.toml": b"\xef\xbb\xbf" + text,
        "utf16.toml": scene.encode("utf-16"),
        "empty.toml": b"",
        "latin.toml": b'title = "\xff"\n',
        "nul.toml": bytes(100),
        "run_hollow/run.vtkhdf": b"",
        "balance.toml": b"balance = 1\n",
        "bad.py": b'raise RuntimeError("\\x1b[31mred\\nforged: line")\n',
        "exit.py": b"import sys; sys.exit(0)\n",
        "syntax.py": b"def\n",
        "none.py": b"PLUGIN = 3\n",
        "latin.py": b'x = "\xff"\n',
        **{f"{name}.toml": text for name in ODD},
    }
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    shutil.copy(mesh, folder / "mesh.stl")
    (folder / "dangling.toml").symlink_to("nowhere")
    (folder / "loop.toml").symlink_to("loop.toml")
    os.mkfifo(folder / "pipe.toml")
    for name in ODD:
        shutil.copytree(folder / "run", folder / name)


def play(words: list[str], folder: Path) -> tuple[int, str, str]:
    """Exit code (negative: killed by that signal), standard output and standard error of one line, played in a child."""
    out, err = folder / ".out", folder / ".err"
    child = os.fork()
    if not child:
        _become(words, folder, out, err)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status), *(path.read_bytes().decode("utf-8", "backslashreplace") for path in (out, err))


def _become(words: list[str], folder: Path, out: Path, err: Path) -> None:
    import resource

    code = 99
    try:
        signal.alarm(PATIENCE)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        os.chdir(folder)
        for number, path in ((1, out), (2, err)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for name, number in (("stdout", 1), ("stderr", 2)):
            setattr(sys, name, open(number, "w", encoding="utf-8", closefd=False))
        sys.argv = ["thirdbody", *words]
        from thirdbody.cli.main import main

        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
        sys.stdout.flush()
    finally:
        os._exit(code)


def serve(folder: Path) -> None:
    """Answer each line of standard input."""
    import thirdbody.export.export_run
    import thirdbody.report.tables  # noqa: F401  what all lines need, without numba's threads

    answers = os.fdopen(os.dup(1), "w", encoding="ascii")
    for line in sys.stdin:
        print(json.dumps(play(json.loads(line), folder)), file=answers, flush=True)


if __name__ == "__main__":
    serve(Path(sys.argv[1]))
