"""Description of the machine and software of a measurement."""

import os
import platform
from pathlib import Path
from typing import Any

from thirdbody.system.cpu_count import cores


def machine() -> dict[str, Any]:
    """Return processor, cores usable by this process, current load of the last minute, system and versions."""
    import numba
    import numpy as np

    import thirdbody

    return {
        "cpu": processor(),
        "cores": cores(),
        "threads": 1,
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.machine()}",
        "versions": {
            "thirdbody": thirdbody.__version__, "python": platform.python_version(),
            "numba": numba.__version__, "numpy": np.__version__,
        },
    }  # fmt: skip


def processor() -> str:
    """Return the model name of the processor, `unknown` if the system does not give it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown")
