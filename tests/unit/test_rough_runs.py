"""Explicit runs between rough plates: the same bits for threads and pieces of a run, and a closed balance of energies."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from ensembles import ROUGH, arrays, scene

import thirdbody
from thirdbody.errors import Interrupted
from thirdbody.runner.prepare import prepare
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.simulate import execute

FEW = ROUGH | {"debris.0.count": 20, "debris.0.spheres": [3, 6]}


def stop_after(watches: int) -> Callable[[], bool]:
    counter = itertools.count(1)
    return lambda: next(counter) >= watches


@pytest.mark.parametrize("debris_contact", ["none", "auto"])
def test_threads_and_pieces_change_no_bit(debris_contact: str, tmp_path: Path) -> None:
    """Independent bodies, and those that may meet, whose candidates are searched for again and again."""
    given = scene(**FEW, **{"contact.debris_contact": debris_contact})
    thirdbody.run(given, tmp_path / "whole", 1, False)
    thirdbody.run(given, tmp_path / "threads", 2, False)
    simulation, saved, pieces = prepare(given), None, 0
    while True:
        try:
            execute(simulation, tmp_path / "cut", checkpoint=saved, stop=stop_after(2 + 2 * pieces))
            break
        except Interrupted:
            simulation, saved = prepare_resume(tmp_path / "cut")
            pieces += 1
    assert pieces > 1
    assert arrays(tmp_path / "whole") == arrays(tmp_path / "threads") == arrays(tmp_path / "cut")
    energies = thirdbody.open(tmp_path / "whole").series
    worked = np.abs(energies["energy_plate_work"]).max() + energies["energy_elastic_normal"].max()
    assert np.abs(energies["energy_residual"]).max() < 1e-2 * worked
