"""What a run computed, bit by bit, for tests that compare two runs."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
import thirdbody
from thirdbody.errors import Interrupted
from thirdbody.runner.simulate import execute, prepare


def contents(folder: Path, scene: bool = False) -> dict[str, bytes]:
    """Every array of a trajectory, those of its scene if wanted, and what its summary tells of the physics."""
    found: dict[str, bytes] = {}

    def keep(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and (scene or not name.startswith("scene/")):
            found[name] = item[()] if item.dtype == object else np.asarray(item[()]).tobytes()

    with h5py.File(folder / "run.vtkhdf") as file:
        file.visititems(keep)
        summary = json.loads(file["scene/summary"][()])
    for clock in ("wall_time", "sphere_steps_per_second"):
        del summary[clock]
    return found | {"scene/summary": json.dumps(summary, sort_keys=True).encode()}


def whole_and_resumed(scene, folder):
    """Run a scene into `whole`, interrupted and resumed into `cut`, and check that both files hold the same bits."""
    execute(prepare(scene), folder / "whole")
    numbers = iter(range(10**9))
    with pytest.raises(Interrupted):
        execute(prepare(scene), folder / "cut", stop=lambda: next(numbers) >= 3)
    thirdbody.resume(folder / "cut", progress=False).close()
    assert contents(folder / "cut") == contents(folder / "whole")
