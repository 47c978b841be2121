"""Too little memory: one line and exit code 5, wherever it runs out."""

from __future__ import annotations

import errno
import os
import subprocess
import sys

import pytest

from thirdbody.cli import main
from thirdbody.system import address_space
from thirdbody.system.address_space import MIN_ADDRESS_SPACE

resource = pytest.importorskip("resource")


@pytest.mark.parametrize("megabytes", [150, 250, 350, 450])
@pytest.mark.parametrize("arguments", [["laws"], ["check", "scene.toml"], ["states", "run"]], ids=" ".join)
def test_too_small_an_address_space_is_reported_before_anything_is_loaded(arguments, megabytes, balls, tmp_path):
    """Far below what is needed the compiled libraries would end the process in ways of their own."""
    balls()

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (megabytes * 2**20,) * 2)

    done = subprocess.run(
        [sys.executable, "-m", "thirdbody", *arguments], cwd=tmp_path, preexec_fn=limited, capture_output=True, text=True
    )
    assert done.returncode == 5, done.stderr
    assert (
        done.stderr
        == f"thirdbody: `ulimit -v` leaves {megabytes} MB of address space; at least {MIN_ADDRESS_SPACE} MB are needed\n"
    )


PROBLEMS = [
    MemoryError(),
    MemoryError("Unable to allocate 8.00 GiB for an array with shape (1073741824,)"),
    ImportError("_conv.so: failed to map segment from shared object"),
    OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)),
    RuntimeError("drawing failed: Traceback\n  File x\nImportError: _io.so: failed to map segment from shared object"),
]


@pytest.mark.parametrize("problem", PROBLEMS, ids=repr)
def test_memory_that_runs_out_is_no_bug(problem, command, monkeypatch):
    def fail(**_options):
        raise problem

    monkeypatch.setattr(main, "app", fail)
    report = command("laws")
    assert report.code == 5 and report.err.startswith("thirdbody: not enough memory") and report.err.count("\n") == 1


@pytest.mark.parametrize("problem", [ImportError("no module"), OSError("strange"), ValueError("Unable to allocate")], ids=repr)
def test_other_problems_are_no_lack_of_memory(problem):
    assert address_space.memory_shortage(problem) is None
