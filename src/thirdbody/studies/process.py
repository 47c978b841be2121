"""A rung, or several in turns, in a process of its own, so that nothing of one is left for the next."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

LIMIT = 90.0
"""Seconds of one core after which one run of a rung is given up, and shown as such."""

SCENE_FILE, RUNGS = "scene.toml", "rungs"
"""In the folder of a study: the scene as it is climbed, and the runs of its rungs."""


def in_process(
    scene: Path, place: Path, variants: Sequence[Mapping[str, Any]], plugins: Sequence[str | Path], repeats: int,
    limit: float = LIMIT, beside: Mapping[str, Any] | None = None, until: float = math.inf,
) -> list[dict[str, Any]]:  # fmt: skip
    """What `worker` tells of these variants of a scene; one that crashed is told like one that failed.

    `until`: seconds since the epoch after which nothing is repeated that has been timed once.
    """
    place.mkdir(parents=True, exist_ok=True)
    job, patience = place / "job.json", 600.0 + 4.0 * limit * len(variants) * (repeats + 1)
    job.write_text(json.dumps({
        "scene": str(scene), "variants": [dict(changes) for changes in variants], "plugins": [str(p) for p in plugins],
        "folder": str(place), "repeats": repeats, "limit": limit, "beside": None if beside is None else dict(beside),
        "until": until if math.isfinite(until) else None,
    }), encoding="utf-8")  # fmt: skip
    command = [sys.executable, "-m", "thirdbody.studies.worker", str(job)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=patience, check=False)
        if done.returncode == 0:
            return json.loads(done.stdout.splitlines()[-1])
        why = (done.stderr.strip().splitlines() or ["no message"])[-1]
        message = f"the process ended with code {done.returncode}: {why}"
    except subprocess.TimeoutExpired:
        message = f"given up after {patience:.0f} s"
    finally:
        job.unlink(missing_ok=True)
    return [{"wall": [], "cpu": [], "stable": False, "message": message} for _ in variants]
