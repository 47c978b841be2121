"""Faulty calls and sweeps, absurd numbers and names: one line, the right exit code, nothing is made."""

import os

import pytest
from balls import BALLS
import thirdbody

LONG, DEEP, HUGE = "x" * 300, "x/" * 3000, "9" * 20
EMPTY = ("empty.toml", "loop.toml")
MAP, COST, RENDER = ("map", "-o", "m.png"), ("cost", "scene.toml"), ("render", "run", "-o", "p.png")
SET, PLUG = ("scene.toml", "--set"), ("scene.toml", "--plugin")

# what is asked; the exit code; words of the one message
OF_SCENES = [
    (("no.toml",), 3, "no.toml: no such file"), ((".",), 3, ".: is a folder, expected a scene file"),
    (("latin.toml",), 3, "latin.toml:1:10", "UTF-8"), ((*SET, "solver.distnce=1 um"), 3, "--set: solver.distnce", "'distance'"),
    ((*SET, "slover.distance=1 um"), 3, "--set: slover", "'solver'"), ((*SET, "solver.distance"), 2, "write KEY=VALUE"),
    ((*SET, "debris.1.count=3"), 3, "--set: debris.1.count", "0 to 0"),
    ((*SET, "solver.distance=1 N"), 3, "--set: solver.distance", "a force"),
    ((*PLUG, "no.py"), 2, "plug-in no.py: no such file"), ((*PLUG, "broken.py"), 2, "broken.py", "ZeroDivisionError"),
    ((*PLUG, "empty.py"), 2, "empty.py", "PLUGIN = Plugin(...)"), ((*PLUG, "."), 2, "plug-in .: no such file"),
    ((*PLUG, "kernel.py", "--set", "effects.wrong=true"), 2, "wrong: cannot be compiled", "'nothing'", "kernel.py"),
]  # fmt: skip
OTHERS = [
    (("run", "no.toml"), 3, "no.toml: no such file"), (("run", "scene.toml", "--threads", "0"), 2, "--threads"),
    (("run", "scene.toml", "--threads", "two"), 2, "--threads"),
    (("run", "scene.toml", "-o", "folder"), 5, "folder: exists already", "--overwrite"),
    (("run", "scene.toml", "-o", "folder", "--overwrite"), 5, "folder: is not the folder of a run"),
    (("run", "scene.toml", "-o", "broken.py", "--overwrite"), 5, "broken.py", "not the folder"),
    (("run", "scene.toml", "-o", "broken.py/run"), 5, "broken.py/run", "is not a folder"),
    (("chek", "scene.toml"), 2, "did you mean 'check'?"), (("--verison",), 2, "--version"), (("check",), 2, "SCENE"),
    (("check", "scene.toml", "--sett", "a=b"), 2, "--set"), ((), 2), (("states", "."), 3, "no such run"),
    (("states", "nothing"), 3, "nothing: no such run"), (("states", "scene.toml"), 3, "not a run of thirdbody"),
    (("render", "nothing", "-o", "x.png"), 3, "nothing: no such run"),
    (("laws", "--check", "nothing.py"), 2, "nothing.py: no such file"), (("new", "scene.toml"), 5, "scene.toml: exists already"),
    (("new", "no/scene.toml"), 5, "cannot be written"),
    *(((verb, "run", "--frame", "99", *more), 3, "no frame 99; frames are from -4 to 3")
      for verb, *more in (("states",), ("render", "-o", "x.png"))),
    ((*RENDER, "--color", "velocty"), 3, "did you mean 'velocity'"), (("render", "run", "-o", "x.jpg"), 3, "name it .png"),
]  # fmt: skip
KERNEL = """
from typing import NamedTuple
from thirdbody.plugin import Adhesion, Law, Plugin, kernel
class Numbers(NamedTuple):
    w: float
@kernel
def wrong(c, n, p):
    return Adhesion(-p.w * c.nothing, 0.0)
LAW = Law("wrong", "adhesion", wrong, Numbers, lambda pair, options: Numbers(1.0), "none")
PLUGIN = Plugin("wrong", effects=(LAW,))
"""
OPTIONS = [
    *((*RENDER, f"--zoom={value}", 3) for value in ("0", "-1", "9e-5", "1.001", "nan", "inf", HUGE)),
    *((*RENDER, f"--frame={value}", 3) for value in (HUGE, f"-{HUGE}", "4", "-5")),
    *((*RENDER, option, 3) for option in (f"--body={HUGE}", "--body=4", "--fps=0", "--fps=61")),
    *((*RENDER, f"--{side}={value}", 2) for side in ("width", "height") for value in ("0", "199", "8193", HUGE, "nan")),
    *(("render", "run", "-o", "p.gif", f"--frames={value}", 3) for value in ("::0", "9:1", "a:b", f"{HUGE}:", ":::")),
    *((name, "run", f"--frame={value}", 3) for name in ("plot", "states") for value in (f"-{HUGE}", "4")),
    *(("export", "run", flag, "t", f"--frame={HUGE}", 3) for flag in ("--csv", "--pvd")),
    *(("states", "run", f"--frame={value}", 2) for value in ("", "nan", "0.5")),
    *((*MAP, f"--H={value}", 2) for value in ("nan", "inf", "1.1e6", "-1.1e6", "")),
    *((*MAP, f"--half-width={value}", 2) for value in ("0", "-1", "nan", "inf", "9e-7", "1.1e6")),
    *((*COST, f"--repeats={value}", 2) for value in ("1", "-1", "1001", HUGE, "nan")),
    *((*COST, f"--budget={value}", 2) for value in ("0 s", "-1 s", "nan s", "inf s", "31 d", "1", "", "1 um")),
    *(("balance", "b.toml", f"--level={value}", 2) for value in ("", "nan", LONG)),
    *(("run", "scene.toml", f"--threads={value}", 2) for value in ("-1", "nan", "")),
    *(("run", "scene.toml", f"--{name}={text}", 2) for name in ("wall-limit", "checkpoint-every") for text in ("-1 s", "nan s")),
]  # fmt: skip
NAMES = [
    *((name, LONG, 3) for name in ("check", "run", "shapes", "cost", "balance", "states", "resume")),
    *((name, DEEP, 3) for name in ("check", "states")), *((name, LONG, "-o", "p.png", 3) for name in ("plot", "render")),
    *(("run", "scene.toml", "-o", word, 5) for word in (LONG, DEEP, f"{LONG}/run")),
    ("run", "scene.toml", "-o", LONG, "--overwrite", 5),
    *(("export", "run", flag, f"{LONG}/x", 5) for flag in ("--csv", "--pvd")), ("plot", "run", "-o", f"{LONG}.png", 5),
    *(("laws", flag, word, 2) for flag in ("--plugin", "--check") for word in (LONG, DEEP, "folder", "nowhere.py")),
    *(("new", word, 5) for word in (LONG, "folder", "nowhere/x.toml", "/dev/null/x.toml")),
    *((name, word, 3) for name in ("check", "run", "shapes") for word in ("folder", "latin.toml", "pipe.toml", *EMPTY)),
    *((name, word, 3) for name in ("states", "plot", "resume") for word in ("folder", *EMPTY)), ("check", "/dev/null", 3),
    ("check", "/dev/full", 3), ("states", "/dev/null", 3), ("map", "-o", "folder/no/m.png", 5),
    (*RENDER[:2], "-o", "nowhere/p.html", 5),
]  # fmt: skip


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """A folder with a run of four balls, and with files that are none of what they are taken for."""
    folder = tmp_path_factory.mktemp("absurd")
    (folder / "scene.toml").write_text(BALLS, encoding="utf-8")
    with thirdbody.run(thirdbody.Scene.load(folder / "scene.toml"), folder / "run", threads=1, progress=False) as run:
        assert run.frames == 4
    (folder / "folder").mkdir()
    (folder / "folder" / "precious").write_text("x")
    (folder / "empty.toml").touch()
    for name, text in (("b.toml", "balance = 1\n"), ("broken.py", "1 / 0\n"), ("empty.py", "x = 1\n"), ("kernel.py", KERNEL)):
        (folder / name).write_text(text)
    (folder / "latin.toml").write_bytes(b'title = "\xb5m"\n')
    (folder / "loop.toml").symlink_to("loop.toml")
    os.mkfifo(folder / "pipe.toml")
    return folder


def everything(folder):
    return sorted(path for path in folder.rglob("*") if "__pycache__" not in path.parts)


@pytest.fixture
def refused(played, command, monkeypatch):
    monkeypatch.chdir(played)
    before = everything(played)

    def call(code, *words):
        report = command(*words)
        assert report.code == code, (words, report.err[-2000:])
        assert "Traceback" not in report.err and not report.out and everything(played) == before, (words, report)
        return report.err

    return call


def test_a_fault_of_the_call_is_reported(refused):
    for words, code, *texts in [*[(("check", *words), *rest) for words, *rest in OF_SCENES], *OTHERS]:
        error = refused(code, *words)
        assert all(text in error for text in texts), (words, error)


@pytest.mark.parametrize("rows", [OPTIONS, NAMES], ids=["options", "names"])
def test_an_absurd_word_is_reported_in_one_line(rows, refused):
    for *words, code in rows:
        error = refused(code, *words)
        lines = [line for line in error.splitlines() if line and not line.startswith(("Usage:", "Try ", "warning: "))]
        assert len(lines) == 1 or "empty.toml" in words, (words, error)  # an empty scene lacks several keys
        assert not any(LONG in word for word in words) or LONG[:200] in lines[0], words


MU = "pairs.0.friction"
SWEEP = f'sweep = 1\nscene = "balls.toml"\n[vary]\n"{MU}" = [0.1, 0.2]\n'


@pytest.fixture
def files(tmp_path):
    (tmp_path / "balls.toml").write_text(BALLS, encoding="utf-8")
    (tmp_path / "sweep.toml").write_text(SWEEP, encoding="utf-8")
    return tmp_path


def vary(*values):
    return ["balls.toml", *(word for value in values for word in ("--vary", value))]


def test_wrong_arguments_of_a_sweep_are_named(files, command):
    before = sorted(files.rglob("*"))
    for arguments, code, *texts in [
        (vary("pairs.0.frction=0.1,0.2"), 3, "pairs[0].frction: unknown key, did you mean 'friction'?"),
        (vary(f"{MU}=0.1:0.5"), 3, ".count: required key is missing: the number of values"),
        (vary(f"{MU}=0.1:0.5:x"), 3, ".count: expected a whole number, got 'x'"),
        (vary(f"{MU}=0.1:0.5:4:loga"), 3, ".scale: 'loga' is not one of 'linear', 'log', 'whole'"),
        (vary("plates.upper.load=1 mN:2:3"), 3, "'1 mN' and 2 are a force and a pure number"),
        (vary("plates.upper.load=1,2"), 3, "plates.upper.load: 1 has no unit, expected a unit of force"),
        (vary("plates.upper.load=1 mM:2 mM:3"), 3, "unknown unit 'mM'"),
        (vary("debris.2.count=1,2"), 3, "debris.2.count: debris has no entry '2': its entries are 0 to 0"),
        (vary(MU), 3, f"{MU}: write KEY=FROM:TO:COUNT or KEY=A,B,C"), (vary(f"{MU}=0.1,0.2", f"{MU}=0.3"), 3, "is varied twice"),
        ([*vary(f"{MU}=0.1"), "--result", "lod"], 3, "'lod' is no result, did you mean 'load'?"),
        (vary("contact.level=mindlin,mindlim"), 3, "contact.level: 'mindlim' is not a level", "did you mean 'mindlin'"),
        (["balls.toml"], 2, "balls.toml: is a scene; say what to vary"),
        (["sweep.toml", "--vary", f"{MU}=0.1"], 2, "sweep.toml: is a sweep file; --vary goes with a scene"),
        (["sweep.toml", "--design", "zip"], 2, "--design: only with --vary"), (["nothing.toml"], 3, "nothing.toml: no such file"),
        (["nothing.toml", "--vary", f"{MU}=0.1"], 3, "nothing.toml: no such file"), (["."], 3, "is no folder of a sweep"),
        (["sweep.toml", "--retry", "done"], 2, "write --retry failed"),
        ([*vary(f"{MU}=0.1"), "-o", "balls.toml"], 5, "balls.toml: exists already"),
        ([*vary(f"{MU}=0.1"), "-o", "balls.toml/inside"], 5, "balls.toml/inside: cannot be made"),
    ]:  # fmt: skip
        report = command("sweep", *arguments)
        assert report.code == code and all(text in report.err for text in texts), (arguments, report)
        assert "Traceback" not in report.err and sorted(files.rglob("*")) == before
    report = command("sweep", *vary("pairs.0.frction=0.1,0.2", "debris.0.sed=1,2"))  # they hide no others and blame no results
    assert report.code == 3 and report.err.splitlines() == [
        "pairs[0].frction: unknown key, did you mean 'friction'?", "debris[0].sed: unknown key, did you mean 'seed'?",
    ]  # fmt: skip


FAULTY_SWEEP = """sweep = 1
scene = "balls.toml"
results = ["load", "friktion"]
[settings]
"solver.distnce" = "1 um"
[vary]
"pairs.0.friction" = [0.1, -0.2]
debris.0.cout = [1, 2, 3]
plates.upper.load = {from = 1, to = 2, count = 40}
"""


def test_all_faults_of_all_points_are_reported_once_with_their_line(files, command):
    (files / "sweep.toml").write_text(FAULTY_SWEEP, encoding="utf-8")
    report = command("sweep", "sweep.toml")
    lines = report.err.splitlines()
    assert report.code == 3 and len(lines) <= 45, report.err
    for text in (
        "sweep.toml:3:", "'friktion' is no result", "did you mean 'distance'",
        "sweep.toml:7:1: pairs[0].friction: -0.2 must be at least 0",
        "sweep.toml:8:1: debris[0].cout: unknown key, did you mean 'count'?", "sweep.toml:9:1: plates.upper.load: 1 has no unit",
    ):  # fmt: skip
        assert sum(text in line for line in lines) == 1, (text, report.err)


def test_wrong_files_of_a_sweep_are_named(files, command):
    for old, new, text in (
        ('scene = "balls.toml"', 'scene = "ball.toml"', "sweep.toml:2:1: scene: ball.toml: no such file"),
        ("sweep = 1\n", "", "sweep: required key is missing: write sweep = 1"),
        ("sweep = 1", "sweep = 2", "sweep.toml:1:1: sweep: 2 must be 1"),
        ("[0.1, 0.2]", "[0.1, 0.2", "sweep.toml:"),
        ("[vary]", "[vry]", "sweep.toml:3:1: vry: unknown key, did you mean 'vary'?"),
        (f'[vary]\n"{MU}" = [0.1, 0.2]\n', "", "give the points: [vary], [[together]] or points"),
        ("[vary]", 'points = "points.csv"\n[vary]', "points of a CSV file are given too"),
    ):
        (files / "sweep.toml").write_text(SWEEP.replace(old, new), encoding="utf-8")
        report = command("sweep", "sweep.toml")
        assert report.code == 3 and text in report.err and not (files / "sweeps").exists(), report.err
    (files / "old").mkdir()
    (files / "old" / "sweep.json").write_text("{")
    for words in (["sweep", "old", "--resume"], ["plot", "old"]):
        report = command(*words)
        assert report.code == 3 and report.err == "thirdbody: old/sweep.json: is damaged\n"
