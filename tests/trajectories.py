"""What a run computed, bit by bit, for tests that compare two runs."""

from __future__ import annotations

import json
from pathlib import Path

import h5py


def contents(folder: Path) -> dict[str, bytes]:
    """Every array of a trajectory, and what its summary tells of the physics."""
    found: dict[str, bytes] = {}

    def keep(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("scene/"):
            found[name] = item[()].tobytes()

    with h5py.File(folder / "run.vtkhdf") as file:
        file.visititems(keep)
        summary = json.loads(file["scene/summary"][()])
    for clock in ("wall_time", "sphere_steps_per_second"):
        del summary[clock]
    return found | {"summary": json.dumps(summary, sort_keys=True).encode()}
