"""Python child processes that never execute a module in the current folder.

`python -m` searches the current folder first, before the standard library: a `json.py` there would be executed.
"""

import os
import sys
from collections.abc import Iterable
from pathlib import Path

# Code of a child. The folders come last in its search path, so that nothing in them hides an installed module.
_START = """\
import runpy, sys
folders, module = sys.argv[1:3]
sys.path += [folder for folder in folders.splitlines() if folder not in sys.path]
sys.argv[:3] = [module]
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""


def python_command(module: str, *arguments: str) -> list[str]:
    """Return the command that executes a module of this package as `__main__`, with the same packages available as here."""
    package = str(Path(__file__).resolve().parents[1])
    folders = [*_without_current_folder(sys.path), package]
    return [sys.executable, "-P", "-c", _START, "\n".join(folders), module, *arguments]


def python_environment() -> dict[str, str]:
    """Return the variables for a child: those of this process, with the safe search path for the child's children too."""
    environment = os.environ | {"PYTHONSAFEPATH": "1"}
    if "PYTHONPATH" in environment:
        folders = _without_current_folder(environment["PYTHONPATH"].split(os.pathsep))
        environment["PYTHONPATH"] = os.pathsep.join(folders)
    return environment


def _without_current_folder(folders: Iterable[str]) -> list[str]:
    """Return the folders as absolute paths, without the current one (also written as an empty text)."""
    current = os.path.realpath(os.curdir)
    return [os.path.abspath(folder) for folder in folders if folder and os.path.realpath(folder) != current]
