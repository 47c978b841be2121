"""Absurd numbers, names and files on the command line: one line, the right exit code, and nothing is made."""

from __future__ import annotations

import os

import pytest
from balls import BALLS

import thirdbody

LONG, DEEP = "x" * 300, "x/" * 3000
HUGE = "9" * 20
EMPTY = ("empty.toml", "loop.toml")
MAP, COST, RENDER = ("map", "-o", "m.png"), ("cost", "scene.toml"), ("render", "run", "-o", "p.png")

OPTIONS = [
    *((*RENDER, f"--zoom={value}", 3) for value in ("0", "-1", "1e-300", "9e-5", "1.001", "nan", "inf", "-inf", "1e300", HUGE)),
    *((*RENDER, f"--frame={value}", 3) for value in (HUGE, f"-{HUGE}", "4", "-5")),
    *((*RENDER, f"--body={value}", 3) for value in (HUGE, "4")),
    *((*RENDER, f"--fps={value}", 3) for value in ("0", "-1", "61", HUGE)),
    *((*RENDER, f"--{side}={value}", 2) for side in ("width", "height") for value in ("0", "-1", "199", "8193", HUGE, "nan")),
    *(("render", "run", "-o", "p.gif", f"--frames={value}", 3) for value in ("::0", "9:1", "a:b", "1e3:", f"{HUGE}:", ":::")),
    *((name, "run", f"--frame={value}", 3) for name in ("plot", "states") for value in (HUGE, f"-{HUGE}", "4", "-5")),
    *(("export", "run", flag, "t", f"--frame={value}", 3) for flag in ("--csv", "--pvd") for value in (HUGE, f"-{HUGE}")),
    *(("states", "run", f"--frame={value}", 2) for value in ("", "nan", "1e300", "0.5")),
    *((*MAP, f"--H={value}", 2) for value in ("nan", "inf", "-inf", "1e300", "1.1e6", "-1.1e6", "")),
    *((*MAP, f"--half-width={value}", 2) for value in ("0", "-1", "nan", "inf", "1e-300", "9e-7", "1.1e6", "1e300")),
    *((*COST, f"--repeats={value}", 2) for value in ("0", "1", "-1", "1001", HUGE, "nan")),
    *((*COST, f"--budget={value}", 2) for value in ("0 s", "-1 s", "nan s", "inf s", "1e300 s", "31 d", "1", "", "1 um")),
    *(("balance", "b.toml", f"--level={value}", 2) for value in ("", "0", "nan", LONG)),
    *(("run", "scene.toml", f"--threads={value}", 2) for value in ("0", "-1", "nan", "1e300", "")),
    *(("run", "scene.toml", f"--{name}={text}", 2) for name in ("wall-limit", "checkpoint-every") for text in ("-1 s", "nan s")),
]  # fmt: skip

NAMES = [
    *((name, word, 3) for name in ("check", "run", "shapes", "cost", "balance", "states", "resume") for word in (LONG, DEEP)),
    *(("plot", word, "-o", "p.png", 3) for word in (LONG, DEEP)),
    *(("run", "scene.toml", "-o", word, 5) for word in (LONG, DEEP)),
    *(("export", "run", flag, word, 5) for flag in ("--csv", "--pvd") for word in (LONG, DEEP)),
    *(("laws", flag, word, 2) for flag in ("--plugin", "--check") for word in (LONG, DEEP, "folder", "nowhere.py")),
    *(("new", word, 5) for word in (LONG, "folder", "nowhere/x.toml", "/dev/null/x.toml")),
    *((name, word, 3) for name in ("check", "run", "shapes") for word in ("folder", "latin.toml", "pipe.toml", *EMPTY)),
    *((name, word, 3) for name in ("states", "plot", "resume") for word in ("folder", *EMPTY)),
    ("check", "/dev/null", 3), ("check", "/dev/full", 3), ("states", "/dev/null", 3),
    ("map", "-o", "folder/no/m.png", 5), ("plot", "run", "-o", "nowhere/p.png", 5), (*RENDER[:2], "-o", "nowhere/p.html", 5),
]  # fmt: skip


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """A folder with a run of four balls, and with files that are none of what they are taken for."""
    folder = tmp_path_factory.mktemp("absurd")
    (folder / "scene.toml").write_text(BALLS, encoding="utf-8")
    with thirdbody.run(thirdbody.Scene.load(folder / "scene.toml"), folder / "run", threads=1, progress=False) as run:
        assert run.frames == 4
    (folder / "folder").mkdir()
    (folder / "empty.toml").touch()
    (folder / "b.toml").write_text("balance = 1\n")
    (folder / "latin.toml").write_bytes(b'title = "\xff"\n')
    (folder / "loop.toml").symlink_to("loop.toml")
    os.mkfifo(folder / "pipe.toml")
    return folder


@pytest.mark.parametrize("row", [*OPTIONS, *NAMES], ids=lambda row: " ".join(row[:-1])[:60])
def test_an_absurd_word_is_reported_in_one_line(row, played, command, monkeypatch):
    monkeypatch.chdir(played)
    before = sorted(os.listdir(played))
    report = command(*row[:-1])
    assert report.code == row[-1], report.err[-2000:]
    lines = [line for line in report.err.splitlines() if line and not line.startswith(("Usage:", "Try "))]
    assert len(lines) == 1 or "empty.toml" in row, report.err  # an empty scene lacks several keys
    assert "Traceback" not in report.err and not report.out
    assert sorted(os.listdir(played)) == before
