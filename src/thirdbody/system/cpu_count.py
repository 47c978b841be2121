"""Number of available cores."""

import os


def cores() -> int:
    """Return the cores available to this process: a scheduler or a container often allows fewer than the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
