"""Absurd command lines, and a process that plays them: `python command_lines.py FOLDER` reads one JSON list of words a line,
forks for it, so that it takes a tenth of a second, and answers with a line of JSON."""

import json
import os
import shutil
import signal
import sys
from pathlib import Path

ESCAPE, BREAK, BYTES = "\x1b[31mx", "a\nb", os.fsdecode(b"\xff\xfe")
LONG, DEEP, HUGE = "x" * 300, "x/" * 3000, "9" * 20
ODD = (ESCAPE, BREAK, BYTES)
NUMBERS = ("0", "-1", "1e-300", "nan", "inf", "-inf", "1e300", HUGE, f"-{HUGE}", "", "1e3", "0x10")
PATIENCE = 120  # seconds after which a line hangs
MEMORY = 12 << 30  # address space of a line, bytes: HDF5, VTK and LLVM map some 5 GB
FILES = (
    "dir", "dir.toml", "empty.toml", "latin.toml", "nul.toml", "bom.toml", "utf16.toml", "dangling.toml", "loop.toml",
    "pipe.toml", "mesh.stl", "run/run.vtkhdf", "nowhere.toml", "", ".", "/", "~", "-", "/dev/null", "/dev/full", "/dev/zero",
    LONG, DEEP, *(f"{name}.toml" for name in ODD), "scene.toml/x", "scene.toml\n", "https://example.org/x.toml",
)  # fmt: skip
RUNS = (
    "dir", "run_empty", "run_hollow", "empty.toml", "scene.toml", "", ".", "/", "/dev/null", "/dev/zero", LONG, DEEP,
    "pipe.toml", *ODD, "dangling.toml", "loop.toml", "nowhere", "run/run.spheres.vtkhdf", "run/checkpoint.npz",
)  # fmt: skip
OUTPUTS = (
    "/dev/full", "/dev/null", "/dev/null/x.png", "dir", "dir.png", ".", "/", "", "nowhere/x.png", f"{LONG}.png", f"{DEEP}x.png",
    *(f"{name}.png" for name in ODD), "/proc/x.png", "scene.toml", "x.jpg", ".png", "run/run.vtkhdf",
)  # fmt: skip
PLUGINS = (
    "bad.py", "exit.py", "syntax.py", "none.py", "latin.py", "empty.toml", "dir", "nowhere.py", "", "/dev/null", LONG, *ODD,
)  # fmt: skip
SETTINGS = (
    "", "=", "a", "a=", "=1", "a=1", f"title={ESCAPE}", f"title={BREAK}", f"title={BYTES}", "title=\u4e2d", "title=[1",
    "solver.distance=nan um", "solver.distance=1e300 m", f"debris.0.count={HUGE}", "debris.0.count=-1", f"debris.{HUGE}.count=1",
    "debris.x.count=1", "a." * 5000 + "=1", "debris.0.count=" + "9" * 5000, "debris.0.count=" + "[" * 5000, "scene=2", "solver=1",
    "output.every=1e-300 m", f"materials.{ESCAPE}.density=1", "debris.-1.count=2", 'solver.distance="""',
)  # fmt: skip
FORMS = {
    "files": (FILES, (
        "check {}", "run -q --overwrite --threads 1 {}", "shapes {}", "balance {}", "cost --budget 1e-9_s --overwrite {}",
    )),
    "runs": (RUNS, (
        "states {}", "states {} --json", "render {} -o q.png --width=200 --height=200", "plot {} -o q.png",
        "export {} --csv q --overwrite", "resume {} --threads 1 -q",
    )),
    "outputs": (OUTPUTS, (
        "plot run -o {}", "render run --width=200 --height=200 -o {}", "render run -o {html}", "states run -o {}",
        "shapes scene.toml -o {}", "map -o {}", "export run --csv {}", "export run --pvd {}", "new {}",
        "run scene.toml -q --threads 1 -o {}", "cost scene.toml --budget 1e-9_s -o {}",
    )),
    "plug-ins": (PLUGINS, ("laws --check {}", "laws --plugin {}", "check scene.toml --plugin {}")),
    "settings": (SETTINGS, (
        "check scene.toml --set {}", "run -q --overwrite --threads 1 scene.toml --set {}", "resume run -q --threads 1 --set {}",
        "shapes scene.toml --set {}",
    )),
}  # fmt: skip
"""Words, and the lines that each stands in; an underscore stands for a blank."""
OPTIONS = {
    "render run -o q.png --width=200 --height=200": "zoom frame body fps width height view color camera".split(),
    "render run -o q.gif --width=200 --height=200": ("frames", "fps", "body"), "plot run -o q.png": ("frame", "panel"),
    "states run": ("frame",), "export run --csv q --overwrite": ("frame",), "map --json": ("H", "half-width"),
    "balance balance.toml": ("level",), "cost scene.toml": ("repeats",),
    "run -q --overwrite scene.toml": ("threads", "wall-limit", "checkpoint-every"),
    "shapes mesh.stl --unit 1_um": ("spheres", "seed"), "shapes mesh.stl": ("unit",),
}  # fmt: skip
"""Options that take numbers and names."""


def lines(about: str) -> list[list[str]]:
    if about == "options":
        pairs = [(words, name) for words, names in OPTIONS.items() for name in names]
        return [[*split(words), f"--{name}={value}"] for words, name in pairs for value in (*NUMBERS, *ODD)]
    names, forms = FORMS[about]
    return [
        [{"{}": name, "{html}": name.replace(".png", ".html")}.get(word, word) for word in split(form)]
        for name in names for form in forms
    ]  # fmt: skip


def split(words: str) -> list[str]:
    return [word.replace("_", " ") for word in words.split()]


def furnish(folder: Path, scene: str, mesh: Path) -> None:
    for name in ("dir", "dir.toml", "dir.png", "run_empty", "run_hollow"):
        (folder / name).mkdir()
    text = scene.encode()
    contents = {
        "scene.toml": text, "bom.toml": b"\xef\xbb\xbf" + text, "utf16.toml": scene.encode("utf-16"), "empty.toml": b"",
        "latin.toml": b'title = "\xff"\n', "nul.toml": bytes(100), "run_hollow/run.vtkhdf": b"",
        "balance.toml": b"balance = 1\n", "bad.py": b'raise RuntimeError("\\x1b[31mred\\nforged: line")\n',
        "exit.py": b"import sys; sys.exit(0)\n", "syntax.py": b"def\n", "none.py": b"PLUGIN = 3\n", "latin.py": b'x = "\xff"\n',
        **{f"{name}.toml": text for name in ODD},
    }  # fmt: skip
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
    import thirdbody.export.tables
    import thirdbody.report.tables  # noqa: F401  what all lines need, without numba's threads

    answers = os.fdopen(os.dup(1), "w", encoding="ascii")
    for line in sys.stdin:
        print(json.dumps(play(json.loads(line), folder)), file=answers, flush=True)


if __name__ == "__main__":
    serve(Path(sys.argv[1]))
