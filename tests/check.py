"""Every check by one command: lint, types, tests. `python tests/check.py [--full] [pytest arguments]`.

The default runs the tests that need minutes in all, `--full` runs every test (`.ci/full` prepares a machine for it)."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BEFORE = (
    ("ruff", ["-m", "ruff", "check", "."]),
    ("format", ["-m", "ruff", "format", "--check", "-q", "."]),
    ("style", ["tests/style.py"]),
    ("mypy", ["-m", "mypy"]),
    # the kernels that many scenes share, once: otherwise each process of the tests compiles them for itself
    ("kernels", ["-c", "from thirdbody.engine.units import UNITS, warm_up; warm_up(tuple(UNITS))"]),
)
QUICK = {"NUMBA_OPT": "1"}
"""LLVM's level for the default: the same bits (`bench/reference_runs.py`), compiled in two thirds of the time; --full has 3."""

TESTS = ["-m", "pytest", "-q", "-n", "2", "--dist", "loadfile"]


def before(env: dict[str, str]) -> list[str]:
    running = [
        (name, subprocess.Popen([sys.executable, *command], cwd=ROOT, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT))
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
    arguments, env = sys.argv[1:], QUICK | os.environ
    if "--full" in arguments:
        env = dict(os.environ)
        arguments.remove("--full")
        arguments += ["-m", ""]  # an empty expression selects all tests
    failed = before(env)
    print("== pytest", flush=True)
    if subprocess.run([sys.executable, *TESTS, *arguments], cwd=ROOT, env=env).returncode:
        failed.append("pytest")
    print(f"== failed: {', '.join(failed)}" if failed else "== all passed")
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
