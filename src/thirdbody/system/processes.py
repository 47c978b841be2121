"""Processes: cores, Python children, modules from files outside packages and optional ones, memory of freed tables."""

import ctypes
import importlib
import os
import sys
import threading
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

# Code of a child. The folders come last in its search path, so that nothing in them hides an installed module.
_START = """\
import runpy, sys
folders, module = sys.argv[1:3]
sys.path += [folder for folder in folders.splitlines() if folder not in sys.path]
sys.argv[:3] = [module]
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""

# Parameters of `mallopt` (malloc.h of the GNU C library): free memory at the end of the heap above which it is returned; largest
# number of tables outside of the heap.
_TRIM_THRESHOLD, _MMAP_MAX = -1, -4

# Held from the test for a module until its import is complete: `sys.modules` lists a module before it has been executed.
import_lock = threading.RLock()


def cores() -> int:
    """Return the cores available to this process: a scheduler or a container often allows fewer than the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def python_command(module: str, *arguments: str) -> list[str]:
    """Return the command that executes a module of this package as `__main__`, with the same packages available as here.

    It never executes a module in the current folder: `python -m` searches there first, before the standard library, and a
    `json.py` there would be executed.
    """
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


def import_file(name: str, path: Path, code: str | bytes | None = None) -> ModuleType:
    """Import the file as the module `name`, without Python's own file cache, which may be damaged; a failed one is removed.

    `code`: its content, where that is known. Raises ImportError, and what the file raises.
    """
    if path.suffix != ".py":
        raise ImportError(f"{path}: not a Python file")
    module = ModuleType(name)
    module.__file__ = str(path)
    compiled = compile(path.read_bytes() if code is None else code, str(path), "exec")
    sys.modules[name] = module
    try:
        exec(compiled, vars(module))
    except BaseException:
        del sys.modules[name]
        raise
    return module


def keep_freed_memory() -> None:
    """Keep freed tables of this process for new ones from now on; with another C library than GNU's nothing changes.

    The C library returns large freed tables to the system, which fills new ones with zeros page by page. In a run of 100 000
    bodies that is a seventh of the time of a frame.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, TypeError, AttributeError):
        return
    mallopt(_TRIM_THRESHOLD, 2**31 - 1)
    mallopt(_MMAP_MAX, 0)


def optional(package: str, user: str) -> Any:
    """Import a package that thirdbody does not depend on; `user` is what needs it. Raises ImportError with what to install."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ImportError(f"{user} needs {package}: pip install {package}") from error
