"""Processes that the program starts execute nothing that lies in the current folder under the name of a library."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import thirdbody
from thirdbody.engine import precompile
from thirdbody.render import render
from thirdbody.studies.worker_process import Worker
from thirdbody.system import child_process

SOURCE = Path(thirdbody.__file__).parent
SHADOWED = ("json", "shutil", "selectors", "numpy", "numba", "h5py", "vtkmodules", "thirdbody")
FAKE = """\
import pathlib
pathlib.Path(__file__).with_suffix(".executed").touch()
raise ImportError("from the current folder")
"""


@pytest.fixture
def planted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A current folder with files that bear the names of libraries, each of which marks that it was executed."""
    for name in SHADOWED:
        (tmp_path / f"{name}.py").write_text(FAKE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def executed(folder: Path) -> list[str]:
    return sorted(path.stem for path in folder.glob("*.executed"))


def test_the_processes_that_compile_first(planted):
    queue, end = os.pipe()
    os.close(end)  # nothing to compile: it starts, imports numba and ends
    assert precompile._helper((), queue).wait() == 0
    os.close(queue)
    assert executed(planted) == []


def test_the_worker_of_a_study(planted):
    with Worker() as worker:
        answer = worker.request({"do": "run", "scene": "none.toml", "folder": "x", "changes": {}, "plugins": [], "limit": 1.0})
    assert "none.toml: no such file" in answer["message"]
    assert executed(planted) == []


def test_the_process_that_draws(planted):
    job = {"run": "none", "file": "x.png"}
    done = render._start(job, None)
    assert executed(planted) == []
    assert "KeyError" in done.stderr or "no such run" in done.stderr, done.stderr  # it came as far as to read its job


@pytest.mark.parametrize("path", ["", ".", os.pathsep, "HERE"])
def test_an_entry_of_the_search_path_that_is_the_current_folder(planted, monkeypatch, path):
    """`PYTHONPATH=$PYTHONPATH:...` with nothing before the colon, as it stands in many shells' start files."""
    monkeypatch.setenv("PYTHONPATH", str(planted) if path == "HERE" else path)
    monkeypatch.setattr(sys, "path", ["", str(planted), *sys.path])
    command = child_process.python_command("this_is_no_module")
    done = subprocess.run(command, env=child_process.python_environment(), capture_output=True, text=True)
    assert "No module named this_is_no_module" in done.stderr and executed(planted) == []
    inner = "import json, subprocess, sys; print(json.dumps(sys.path)); subprocess.run([sys.executable, '-c', 'import json'])"
    start = [sys.executable, "-P", "-c", inner]
    done = subprocess.run(start, env=child_process.python_environment(), capture_output=True, text=True)
    assert str(planted) not in json.loads(done.stdout) and executed(planted) == [], done.stderr


def test_a_child_has_the_packages_of_its_parent(tmp_path, monkeypatch):
    """Folders that a program added to its search path, after all others: they hide nothing."""
    (tmp_path / "only_here.py").write_text("import sys, json\nprint(sys.argv[1:], __name__, json.__file__)")
    (tmp_path / "json.py").write_text("raise ImportError('hides the standard library')")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    command = child_process.python_command("only_here", "a", "b c")
    done = subprocess.run(command, env=child_process.python_environment(), capture_output=True, text=True)
    assert done.stdout.startswith(f"['a', 'b c'] __main__ {json.__file__}"), done.stderr


def test_python_is_started_in_one_place_only():
    """Whatever starts a process takes its command from `child_process`."""
    users = {path.name for path in SOURCE.rglob("*.py") if "sys.executable" in path.read_text(encoding="utf-8")}
    users |= {path.name for path in (SOURCE.parents[1] / "plugins").rglob("*.py") if "sys.executable" in path.read_text()}
    assert users == {"child_process.py"}
