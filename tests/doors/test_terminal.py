"""Text of users and of files made by others: it neither steers the terminal, nor forges a line, nor stops a command."""

import csv
import io
import json
import os
import pty
import subprocess
import sys
import tomllib
import unicodedata

import h5py
import numpy as np
import pytest
from portable import PATIENCE

from thirdbody.errors import OutputError, printable
from thirdbody.system.terminal import PrintableStream, printable_output

HOSTILE = "A\x1b[31mB\x1b]0;mine\x07C\x9b2JD\u202eE\rF\nforged: G[red]H[link=http://x]I[/link]:skull:$\\frac$"
TOML = json.dumps(HOSTILE)[1:-1]
SHOWN = "A\\x1b[31mB\\x1b]0;mine\\x07C\\x9b2JD\\u202eE\\rF\\nforged: G[red]H[link=http://x]I[/link]:skull:$\\frac$"


def steers(text: str) -> set[str]:
    """Characters of a text that do more than stand there: all that are neither letters, signs, blanks nor line breaks."""
    return {c for c in text if c != "\n" and unicodedata.category(c) in {"Cc", "Cf", "Cs", "Zl", "Zp"}}


@pytest.fixture
def hostile(balls):
    """The scene of four balls whose title, material and population bear a hostile name; it is scene.toml."""
    path = balls(('title = "four balls"', f'title = "{TOML}"'), ("[[debris]]", f'[[debris]]\nname = "{TOML}"'))
    text = path.read_text(encoding="utf-8").replace("[materials.steel]", f'[materials."{TOML}"]')
    path.write_text(text.replace('"steel"', f'"{TOML}"'), encoding="utf-8")
    return path


def test_names_are_printed_letter_by_letter(hostile, command):
    for words in (("check",), ("run", "-o", "run", "--threads", "1"), ("shapes",)):
        report = command(*words, "scene.toml")
        assert report.code == 0 and not steers(report.out + report.err)
        assert "".join(SHOWN.split()) in "".join(report.out.split())  # folded in columns, and else as it is: no markup, no emoji
        assert "\nforged" not in report.out


def test_the_scene_that_check_prints_can_be_read_back(hostile, command):
    report = command("check", "scene.toml")
    document = tomllib.loads(report.out[report.out.index("scene = 1") :])
    assert document["title"] == HOSTILE and list(document["materials"]) == [HOSTILE]


def test_a_run_made_by_others(balls, command, tmp_path):
    balls()
    assert command("run", "scene.toml", "-o", "run", "-q", "--threads", "1").code == 0
    with h5py.File(tmp_path / "run" / "run.vtkhdf", "r+") as file:
        for name in ("state_names", "reason_names", "population_names", "material_names"):
            values = np.bytes_(json.dumps([f"{HOSTILE}{k}" for k in range(99)]).encode())
            if name in file["scene"]:
                del file["scene"][name]
            file["scene"][name] = values
            file["scene"][name].attrs["json"] = True
    for words in (("states", "run"), ("states", "run", "--frame", "0"), ("states", "run", "--json")):
        report = command(*words)
        assert (
            report.code == 0 and "forged" in report.out and not steers(report.out + report.err) and "\nforged" not in report.out
        )


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("check", f"{HOSTILE}.toml"), 3),
        (("run", "scene.toml", "--set", HOSTILE.replace("=", ":")), 2),
        (("run", "scene.toml", "--set", HOSTILE), 3),
        (("run", "scene.toml", "--wall-limit", HOSTILE), 2),
        (("states", HOSTILE), 3),
        (("plot", HOSTILE, "-o", "p.png"), 3),
        (("map", "-o", f"nowhere/{HOSTILE}.png"), 5),
        (("map", "-o", HOSTILE), 2),
        (("laws", "--plugin", HOSTILE), 2),
        ((HOSTILE,), 2),
        (("check", "\udcff\udcfe.toml"), 3),
        (("check", "scene.toml", "--set", "title=\udcff"), 3),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_one_line_describes_a_hostile_word(words, code, balls, command):
    balls()
    report = command(*words)
    assert report.code == code and report.err.count("\n") == 1 and not steers(report.err) and report.out == ""


def test_a_plug_in_may_not_steer_either(balls, command, tmp_path):
    balls()
    (tmp_path / "law.py").write_text(f"raise RuntimeError({HOSTILE!r})\n", encoding="utf-8")
    report = command("check", "scene.toml", "--plugin", "law.py")
    assert report.code == 2 and report.err.count("\n") == 1 and not steers(report.err)


def test_messages_of_python_are_safe_too():
    problem = OutputError(f"{HOSTILE}: exists already", python=f"; {HOSTILE}", command=f"; {HOSTILE}")
    assert not steers(str(problem) + problem.for_command_line()) and "\n" not in str(problem)


def test_on_a_terminal_only_the_bar_and_the_headings_steer(hostile, tmp_path):
    """Rich draws there, with sequences of its own."""
    master, slave = pty.openpty()
    words = [sys.executable, "-m", "thirdbody", "run", "scene.toml", "-o", "run", "--threads", "1"]
    with subprocess.Popen(words, cwd=tmp_path, stdin=slave, stdout=slave, stderr=slave) as process:
        os.close(slave)
        said = b""
        while True:
            try:
                part = os.read(master, 1 << 16)
            except OSError:  # the terminal's other side is closed
                break
            if not part:
                break
            said += part
        assert process.wait(timeout=PATIENCE) == 0
    os.close(master)
    text = said.decode("utf-8")
    assert "\x1b[" in text and "A\\x1b[31mB" in text
    assert "\x1b[31m" not in text and "\x1b]" not in text and not steers(text) & {"\x07", "\x9b", "\u202e"}


def test_the_characters_that_are_written_out():
    assert printable("a\u00a0b\u3000c \U0001f480\u0301") == "a\u00a0b\u3000c \U0001f480\u0301"  # blanks, signs, accents stay
    assert printable("\x00\x7f\x85\u200b\u2028\u2066\ufeff\ud800") == "\\x00\\x7f\\x85\\u200b\\u2028\\u2066\\ufeff\\ud800"


# the letters of the locale ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252"])
def test_letters_outside_the_locale_become_escapes(encoding, balls, command, monkeypatch):
    balls(('title = "four balls"', 'title = "\u4e2d\u6587 \u2212"'))
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", stream)
    assert command("check", "scene.toml").code == 0 and command("run", "scene.toml", "-q", "--threads", "1").code == 0
    stream.flush()
    said = stream.buffer.getvalue().decode(encoding)
    assert "# \\u4e2d\\u6587 -: 4 bodies" in said and "friction coefficient" in said
    assert stream.errors == "strict"  # as it was


def test_letters_that_the_font_of_pictures_lacks_are_one_warning(balls, command):
    balls(('title = "four balls"', 'title = "\u4e2d\u6587\\u001b[31m"'))
    assert command("run", "scene.toml", "-o", "run", "-q", "--threads", "1").code == 0
    report = command("plot", "run", "-o", "p.png")
    assert report.code == 0 and report.out == "p.png\n" and report.err.count("\n") == 1
    assert report.err.startswith("warning: p.png: the font has no sign")


def test_a_closed_stream_swallows_what_is_printed(balls, command, monkeypatch):
    balls()
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    assert command("run", "scene.toml", "--threads", "1").code == 0 and command("states", "runs/scene").code == 0
    assert command("check", "nowhere.toml").code == 3


def test_nothing_writes_round_the_stream(monkeypatch):
    import typer

    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", stream)
    with printable_output():
        typer.echo("\u202e\x07")  # it looks for a stream of bytes below one of ASCII
        print("\x1b", end="")
        sys.stdout.writelines(["\r", "\n"])
        assert isinstance(sys.stdout, PrintableStream) and not hasattr(sys.stdout, "buffer")
    stream.flush()
    assert stream.buffer.getvalue() == b"\\u202e\\x07\n\\x1b\\r\n"


# tables for spreadsheets --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@x", "=\\r=1", "-,\\n=1"])
def test_no_name_is_a_formula(name, balls, command, tmp_path):
    path = balls(("[[debris]]", f'[[debris]]\nname = "{name}"'))
    path.write_text(path.read_text().replace("materials.steel", f'materials."{name}"').replace('"steel"', f'"{name}"'))
    assert command("run", "scene.toml", "-o", "run", "-q", "--threads", "1").code == 0
    assert command("export", "run", "--csv", "tables").code == 0
    with open(tmp_path / "tables" / "bodies.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 * len({row["frame"] for row in rows})
    assert {row["population_name"] for row in rows} == {row["material_name"] for row in rows} == {f"'{name}"}
    numbers = [value for row in rows for key, value in row.items() if not key.endswith("_name")]
    assert any(value.startswith("-") for value in numbers)
    assert all(np.isfinite(float(value)) or value == "nan" for value in numbers)  # numbers stay numbers
