"""Standard output and error that nobody reads, that are full, or closed: no traceback, the right code, and the run is kept."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from portable import PATIENCE

import thirdbody

PROGRAM = [sys.executable, "-c", "from thirdbody.cli.main import main; main()"]
FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")


def program(*arguments: object, output: object = subprocess.PIPE, error: object = subprocess.PIPE) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of `thirdbody ARGUMENTS` in a process of its own."""
    command = [*PROGRAM, *map(str, arguments)]
    done = subprocess.run(command, stdout=output, stderr=error, text=True, timeout=PATIENCE)  # type: ignore[call-overload]
    return done.returncode, done.stdout or "", done.stderr or ""


def left() -> int:
    """The writing end of a pipe whose reader has gone."""
    reading, writing = os.pipe()
    os.close(reading)
    return writing


@pytest.fixture
def whole(balls, tmp_path) -> Path:
    thirdbody.run(balls(), tmp_path / "whole", progress=False).close()
    return tmp_path / "whole"


@pytest.mark.parametrize("arguments", [["states"], ["states", "--json"]], ids=str)
def test_a_reader_that_has_read_enough_is_no_fault(whole, arguments):
    with os.fdopen(left(), "w") as pipe:
        assert program(*arguments, whole, output=pipe) == (0, "", "")


def test_help_may_be_left_too():
    with os.fdopen(left(), "w") as pipe:
        assert program("--help", output=pipe) == (0, "", "")


@needs_full
def test_a_full_standard_output_is_reported_in_one_line(whole):
    with FULL.open("w") as full:
        code, _, error = program("states", whole, output=full)
        assert code == 5
        assert error.splitlines() == ["thirdbody: standard output: cannot be written (No space left on device)"]
        assert program("states", whole / "missing", output=full)[0] == 3  # the fault of the command comes first
        assert program("states", whole, output=full, error=full)[0] == 5


@pytest.mark.parametrize("error", ["reader has left", pytest.param("full", marks=needs_full)])
def test_a_run_whose_messages_nobody_reads_goes_on(balls, tmp_path, error):
    with os.fdopen(left(), "w") if error == "reader has left" else FULL.open("w") as stream:
        code, output, _ = program("run", balls(), "-o", tmp_path / "run", error=stream)
    assert code == 0 and "friction coefficient" in output
    with thirdbody.open(tmp_path / "run") as run:
        assert run.summary()["finished"]


def test_a_run_whose_output_nobody_reads_goes_on(balls, tmp_path):
    with os.fdopen(left(), "w") as pipe:
        assert program("run", balls(), "-o", tmp_path / "run", output=pipe, error=pipe)[0] == 0
    with thirdbody.open(tmp_path / "run") as run:
        assert run.summary()["finished"]


@needs_full
def test_a_run_whose_output_is_full_is_kept(balls, tmp_path):
    with FULL.open("w") as full:
        code, _, error = program("run", balls(), "-o", tmp_path / "run", "-q", output=full)
    assert code == 5 and error.splitlines()[-1].startswith("thirdbody: standard output: cannot be written")
    with thirdbody.open(tmp_path / "run") as run:
        assert run.summary()["finished"]


@pytest.mark.skipif(os.name == "nt", reason="closes streams by the shell")
@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&- <&-"])
def test_a_run_with_closed_streams_writes_no_message_into_its_files(balls, tmp_path, closed):
    words = [*PROGRAM, "run", str(balls()), "-o", str(tmp_path / "run")]
    done = subprocess.run(["sh", "-c", f'"$@" {closed}', "sh", *words], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0 and "Traceback" not in done.stderr
    with thirdbody.open(tmp_path / "run") as run:
        assert run.summary()["finished"]


def test_a_program_whose_standard_error_has_no_reader_keeps_its_run(balls, tmp_path):
    """`progress=True` in Python, where standard error is the program's own."""
    text = f"import thirdbody; thirdbody.run({str(balls())!r}, {str(tmp_path / 'run')!r}).close(); print('done')"
    with os.fdopen(left(), "w") as pipe:
        done = subprocess.run([sys.executable, "-c", text], stdout=subprocess.PIPE, stderr=pipe, text=True, timeout=PATIENCE)
    assert done.stdout == "done\n"
    with thirdbody.open(tmp_path / "run") as run:
        assert run.summary()["finished"]
