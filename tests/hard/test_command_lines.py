"""Hundreds of absurd command lines: none ends in a traceback, hangs, steers the terminal or leaves a part of a file behind."""

import json
import subprocess
import sys
import unicodedata
from pathlib import Path

import pytest
from balls import BALLS
from hard import command_lines as played
import thirdbody

HERE = Path(__file__).parent
CODES = {0, 2, 3, 4, 5, 130}


def faults(code: int, out: str, err: str) -> list[str]:
    report = [line for line in err.splitlines() if line and not line.startswith(("Usage:", "Try ", "warning:"))]
    wrong = {
        f"exit code {code}": code not in CODES, "a traceback": "Traceback" in err, "no word about it": code != 0 and not report,
        "steers the terminal": any(c != "\n" and unicodedata.category(c) in {"Cc", "Cf", "Cs", "Zl", "Zp"} for c in out + err),
        "a forged line": any(line.startswith("forged") for line in (out + "\n" + err).splitlines()),
        "line without end": len(err) > 100_000,
    }  # fmt: skip
    return [words for words, holds in wrong.items() if holds]


@pytest.mark.full(kind="hard")
@pytest.mark.parametrize("about", [*played.FORMS, "options"])
def test_no_command_line_breaks_the_program(about, tmp_path):
    (tmp_path / "scene.toml").write_text(BALLS, encoding="utf-8")
    thirdbody.run(thirdbody.Scene.load(tmp_path / "scene.toml"), tmp_path / "run", threads=1, progress=False).close()
    played.furnish(tmp_path, BALLS, HERE.parents[1] / "scenes" / "debris_particle.stl")
    rows = played.lines(about)
    broken = []
    words = [sys.executable, str(HERE / "command_lines.py"), str(tmp_path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdin is not None and server.stdout is not None
        for row in rows:
            print(json.dumps(row), file=server.stdin, flush=True)
            found = faults(*json.loads(server.stdout.readline()))
            if found:
                broken.append((row, found))
        server.stdin.close()
    assert not broken, f"{len(broken)} of {len(rows)}: {broken[:20]}"
    assert not list(tmp_path.rglob("*.part"))
