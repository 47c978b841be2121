"""Text of users and of files made by others neither steers the terminal, nor forges a line, nor stops a command; standard
streams that nobody reads, that are full or closed: no traceback, the right code, and the run is kept."""

import contextlib
import csv
import io
import json
import os
import pty
import subprocess
import sys
import tomllib
import unicodedata
from pathlib import Path

import h5py
import numpy as np
import pytest
from portable import PATIENCE
import thirdbody
from thirdbody.errors import OutputError, printable
from thirdbody.system.terminal import PrintableStream, printable_output

HOSTILE = "A\x1b[31mB\x1b]0;mine\x07C\x9b2JD\u202eE\rF\nforged: G[red]H[link=http://x]I[/link]:skull:$\\frac$"
TOML = json.dumps(HOSTILE)[1:-1]
SHOWN = "A\\x1b[31mB\\x1b]0;mine\\x07C\\x9b2JD\\u202eE\\rF\\nforged: G[red]H[link=http://x]I[/link]:skull:$\\frac$"
SLOW = pytest.mark.full(kind="slow")


def steers(text):
    """Characters of a text that do more than stand there: all that are neither letters, signs, blanks nor line breaks."""
    return {c for c in text if c != "\n" and unicodedata.category(c) in {"Cc", "Cf", "Cs", "Zl", "Zp"}}


@pytest.fixture
def hostile(balls):
    path = balls(('title = "four balls"', f'title = "{TOML}"'), ("[[debris]]", f'[[debris]]\nname = "{TOML}"'))
    text = path.read_text(encoding="utf-8").replace("[materials.steel]", f'[materials."{TOML}"]')
    path.write_text(text.replace('"steel"', f'"{TOML}"'), encoding="utf-8")
    return path


def test_names_are_printed_letter_by_letter(hostile, command):
    for words in (("run", "-o", "run", "--threads", "1"), ("shapes",), ("check",)):
        report = command(*words, "scene.toml")
        assert report.code == 0 and not steers(report.out + report.err)
        assert "".join(SHOWN.split()) in "".join(report.out.split())  # folded in columns, and else as it is: no markup, no emoji
        assert "\nforged" not in report.out
    document = tomllib.loads(report.out[report.out.index("scene = 1") :])  # what is printed can be read back
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
        assert report.code == 0 and "forged" in report.out and "\nforged" not in report.out
        assert not steers(report.out + report.err)


def test_one_line_describes_a_hostile_word_or_what_a_plug_in_says(balls, command, tmp_path):
    balls()
    (tmp_path / "law.py").write_text(f"raise RuntimeError({HOSTILE!r})\n", encoding="utf-8")
    for *words, code in (
        ("check", f"{HOSTILE}.toml", 3), ("run", "scene.toml", "--set", HOSTILE.replace("=", ":"), 2),
        ("run", "scene.toml", "--set", HOSTILE, 3), ("run", "scene.toml", "--wall-limit", HOSTILE, 2), ("states", HOSTILE, 3),
        ("plot", HOSTILE, "-o", "p.png", 3), ("map", "-o", f"nowhere/{HOSTILE}.png", 5), ("map", "-o", HOSTILE, 2),
        ("laws", "--plugin", HOSTILE, 2), (HOSTILE, 2), ("check", "\udcff\udcfe.toml", 3),
        ("check", "scene.toml", "--set", "title=\udcff", 3), ("check", "scene.toml", "--plugin", "law.py", 2),
    ):  # fmt: skip
        report = command(*words)
        assert report.code == code and report.err.count("\n") == 1 and not steers(report.err) and report.out == "", words


def test_messages_of_python_are_safe_too():
    problem = OutputError(f"{HOSTILE}: exists already", python=f"; {HOSTILE}", command=f"; {HOSTILE}")
    assert not steers(str(problem) + problem.for_command_line()) and "\n" not in str(problem)
    assert printable("a\u00a0b\u3000c \U0001f480\u0301") == "a\u00a0b\u3000c \U0001f480\u0301"  # blanks, signs, accents stay
    assert printable("\x00\x7f\x85\u200b\u2028\u2066\ufeff\ud800") == "\\x00\\x7f\\x85\\u200b\\u2028\\u2066\\ufeff\\ud800"


@SLOW
def test_on_a_terminal_only_the_bar_and_the_headings_steer(hostile, tmp_path):
    master, slave = pty.openpty()
    words = [sys.executable, "-m", "thirdbody", "run", "scene.toml", "-o", "run", "--threads", "1"]
    with subprocess.Popen(words, cwd=tmp_path, stdin=slave, stdout=slave, stderr=slave) as process:
        os.close(slave)
        said = b""
        with contextlib.suppress(OSError):  # the terminal's other side is closed
            while part := os.read(master, 1 << 16):
                said += part
        assert process.wait(timeout=PATIENCE) == 0
    os.close(master)
    text = said.decode("utf-8")
    assert "\x1b[" in text and "A\\x1b[31mB" in text
    assert "\x1b[31m" not in text and "\x1b]" not in text and not steers(text) & {"\x07", "\x9b", "\u202e"}


@pytest.mark.parametrize("encoding", ["cp1252", pytest.param("ascii", marks=SLOW)])
def test_letters_outside_the_locale_become_escapes(encoding, balls, command, monkeypatch):
    balls(('title = "four balls"', 'title = "\u4e2d\u6587 \u2212"'))
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", stream)
    assert command("check", "scene.toml").code == 0
    stream.flush()
    assert "# \\u4e2d\\u6587 -: 4 bodies" in stream.buffer.getvalue().decode(encoding)
    assert stream.errors == "strict"  # as it was


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


@pytest.mark.parametrize("name", ["=1+1", *(pytest.param(name, marks=SLOW) for name in ("-,\\n=1", "@x"))])
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


PROGRAM = [sys.executable, "-c", "from thirdbody.cli.main import main; main()"]
FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")


def program(*arguments, output=subprocess.PIPE, error=subprocess.PIPE):
    done = subprocess.run([*PROGRAM, *map(str, arguments)], stdout=output, stderr=error, text=True, timeout=PATIENCE)
    return done.returncode, done.stdout or "", done.stderr or ""


def left():
    reading, writing = os.pipe()
    os.close(reading)
    return os.fdopen(writing, "w")


def is_whole(folder):
    with thirdbody.open(folder) as run:
        return run.summary()["finished"]


def test_a_reader_that_has_read_enough_is_no_fault():
    with left() as pipe:
        assert program("--help", output=pipe) == (0, "", "")


@needs_full
def test_a_full_standard_output_is_reported_in_one_line(tmp_path):
    with FULL.open("w") as full:
        code, _, error = program("--help", output=full)
        assert code == 5 and error == "thirdbody: standard output: cannot be written (No space left on device)\n"
        assert program("check", tmp_path / "missing.toml", output=full, error=full)[0] == 3  # that of the command comes first


def test_a_file_that_is_opened_never_takes_the_place_of_a_closed_stream(tmp_path):
    code = "from thirdbody.system.terminal import guarded_streams\nwith guarded_streams():\n    print('lost', flush=True)\n"
    code += "    open('y', 'w').write(str(open('x', 'w').fileno()))"
    done = subprocess.run(["sh", "-c", '"$@" >&- 2>&- <&-', "sh", sys.executable, "-c", code], cwd=tmp_path)
    assert done.returncode == 0 and int((tmp_path / "y").read_text()) > 2 and not (tmp_path / "x").read_text()


@SLOW
@pytest.mark.parametrize(("output", "error"), [("left", "left"), ("", "left"), pytest.param("", "full", marks=needs_full)])
def test_a_run_whose_messages_nobody_reads_goes_on(balls, tmp_path, output, error):
    with left() as pipe, FULL.open("w") if error == "full" else left() as stream:
        code, said, _ = program("run", balls(), "-o", tmp_path / "run", output=pipe if output else subprocess.PIPE, error=stream)
    assert code == 0 and is_whole(tmp_path / "run") and (output or "friction coefficient" in said)


@SLOW
@needs_full
def test_a_run_whose_output_is_full_is_kept(balls, tmp_path):
    with FULL.open("w") as full:
        code, _, error = program("run", balls(), "-o", tmp_path / "run", "-q", output=full)
        assert program("states", tmp_path / "run", output=full, error=full)[0] == 5
    assert code == 5 and error.splitlines()[-1].startswith("thirdbody: standard output: cannot be written")
    assert is_whole(tmp_path / "run")


@SLOW
@pytest.mark.parametrize("closed", [">&- 2>&- <&-", "2>&-"])
def test_a_run_with_closed_streams_writes_no_message_into_its_files(balls, tmp_path, closed):
    words = [*PROGRAM, "run", str(balls()), "-o", str(tmp_path / "run")]
    done = subprocess.run(["sh", "-c", f'"$@" {closed}', "sh", *words], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0 and "Traceback" not in done.stderr and is_whole(tmp_path / "run")


@SLOW
def test_a_program_whose_standard_error_has_no_reader_keeps_its_run(balls, tmp_path):
    """`progress=True` in Python, where standard error is the program's own."""
    text = f"import thirdbody; thirdbody.run({str(balls())!r}, {str(tmp_path / 'run')!r}).close(); print('done')"
    with left() as pipe:
        done = subprocess.run([sys.executable, "-c", text], stdout=subprocess.PIPE, stderr=pipe, text=True, timeout=PATIENCE)
    assert done.stdout == "done\n" and is_whole(tmp_path / "run")
