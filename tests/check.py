"""The one command for every check: lint, types, tests. `python tests/check.py [pytest arguments]`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
QUICK = " and ".join(f"not {mark}" for mark in ("slow", "bem", "vtk", "paraview", "browser", "fuzz", "hard"))
STEPS = (
    ("ruff", ["-m", "ruff", "check", "."]),
    ("mypy", ["-m", "mypy"]),
    ("pytest", ["-m", "pytest", "-q", "-n", "2", "-m", QUICK]),
)


def main() -> int:
    """Run all steps, also after a failure; returns the number that failed."""
    failed = []
    for name, command in STEPS:
        extra = sys.argv[1:] if name == "pytest" else []
        print(f"== {name}", flush=True)
        if subprocess.run([sys.executable, *command, *extra], cwd=ROOT).returncode:
            failed.append(name)
    print(f"== failed: {', '.join(failed)}" if failed else "== all passed")
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
