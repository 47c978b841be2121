"""The one command for every check: lint, types, tests. `python tests/check.py [pytest arguments]`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
QUICK = " and ".join(f"not {mark}" for mark in ("slow", "bem", "vtk", "paraview", "browser", "fuzz", "hard"))
BEFORE = (
    ("ruff", ["-m", "ruff", "check", "."]),
    ("format", ["-m", "ruff", "format", "--check", "-q", "."]),
    ("mypy", ["-m", "mypy"]),
    # the kernels that many scenes share, once: otherwise each process of the tests compiles them for itself
    ("kernels", ["-c", "from thirdbody.engine.precompile import UNITS, warm_up; warm_up(tuple(UNITS))"]),
)
TESTS = ["-m", "pytest", "-q", "-n", "2", "--dist", "loadfile", "-m", QUICK]


def before() -> list[str]:
    """Run what comes before the tests, all at once; returns the names of those that failed."""
    running = [
        (name, subprocess.Popen([sys.executable, *command], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT))
        for name, command in BEFORE
    ]
    failed = []
    for name, process in running:
        output, _ = process.communicate()
        print(f"== {name}\n{output.decode(errors='replace')}", end="", flush=True)
        if process.returncode:
            failed.append(name)
    return failed


def main() -> int:
    """Run all steps, also after a failure; returns the number that failed."""
    failed = before()
    print("== pytest", flush=True)
    if subprocess.run([sys.executable, *TESTS, *sys.argv[1:]], cwd=ROOT).returncode:
        failed.append("pytest")
    print(f"== failed: {', '.join(failed)}" if failed else "== all passed")
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
