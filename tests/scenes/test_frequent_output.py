"""Outputs as often as steps, and more often: stops are heard there too, no frame is written twice, and `check` prices frames."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from steel import STEEL

import thirdbody
from thirdbody.engine import explicit
from thirdbody.errors import Interrupted
from thirdbody.simulate import execute, prepare
from thirdbody.take_up import prepare_resume

BALLS = STEEL + """\
[[debris]]
material = "steel"
kind = "spheres"
radius = "5 um"
count = 4
seed = 1
[domain]
size = ["80 um", "60 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
motion = {x = {velocity = "1 m/s"}}
[solver]
distance = "150 nm"
settle = "0.1 us"
integrator = "explicit"
[output]
every = "150 nm"
"""
"""A step is some .9 nm of sliding."""

TOGETHER = {"plates.upper.support": "rigid", "solver.integrator": "implicit", "contact.debris_contact": "none"}
"""All bodies carry one plate, so that they go step by step together."""


def scene(**settings: str) -> thirdbody.Scene:
    keys = {key.replace("_", ".", 1): value for key, value in settings.items()}
    return thirdbody.Scene.parse(BALLS, "balls.toml").with_settings(keys)


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


def differences(one: Path, other: Path) -> list[str]:
    first, second = contents(one), contents(other)
    return [name for name in first if first[name] != second.get(name)]


def run_in_pieces(wanted: thirdbody.Scene, folder: Path, looks: int) -> int:
    """Stop a run at the so-manieth question, take it up, stop it after three times as many, and so on; returns how often."""
    simulation, kept, pieces = prepare(wanted), None, 0
    while True:
        counter, last = itertools.count(1), looks * 3**pieces
        try:
            execute(simulation, folder, threads=1 + pieces % 2, kept=kept, stop=lambda: next(counter) >= last)  # noqa: B023
            return pieces
        except Interrupted:
            pieces += 1
            simulation, kept = prepare_resume(folder)


@pytest.mark.parametrize("every, looks", [("10 nm", 5), ("4 nm", 6), ("0.3 nm", 30), ("10 pm", 1000)])
def test_a_stop_is_heard_where_outputs_are_a_few_steps_apart(tmp_path, every, looks):
    wanted = scene(output_every=every, solver_distance="20 nm")
    execute(prepare(wanted), tmp_path / "whole")
    assert run_in_pieces(wanted, tmp_path / "cut", looks) >= 2
    assert differences(tmp_path / "whole", tmp_path / "cut") == []


def test_the_limit_of_wall_time_holds_where_outputs_are_a_few_steps_apart(tmp_path):
    with pytest.raises(Interrupted, match="limit of wall time"):
        execute(prepare(scene(output_every="4 nm")), tmp_path / "run", wall_limit=0.0)


@pytest.mark.parametrize("every", ["150 nm", "0.1 nm"])
def test_bodies_that_step_together_hear_a_stop_after_every_step(tmp_path, every):
    wanted = scene(output_every=every, solver_distance="150 nm" if every == "150 nm" else "1 nm").with_settings(TOGETHER)
    simulation = prepare(wanted)
    assert simulation.integrator.together
    execute(simulation, tmp_path / "whole")
    assert run_in_pieces(wanted, tmp_path / "cut", 7) >= 2
    assert differences(tmp_path / "whole", tmp_path / "cut") == []


def test_calls_of_one_step_come_to_the_same_bits(tmp_path, monkeypatch):
    """As many steps as take a second are made in one compiled call, which may be one: a large scene hears a signal too."""
    execute(prepare(scene()), tmp_path / "long")
    monkeypatch.setattr(explicit, "CALL", 0.0)
    looks = itertools.count()
    execute(prepare(scene()), tmp_path / "short", stop=lambda: next(looks) < 0)
    assert next(looks) > 150
    assert differences(tmp_path / "long", tmp_path / "short") == []


@pytest.mark.parametrize("settings", [{"output_every": "10 pm"}, {"output_every": "0.1 ns"}], ids=str)
def test_an_interval_below_a_step_writes_one_frame_after_every_step(tmp_path, settings):
    simulation = prepare(scene(solver_distance="20 nm", **settings))
    assert [text for text in simulation.warnings if "output.every" in text and "one frame after every step" in text]
    execute(simulation, tmp_path / "run")
    with thirdbody.open(tmp_path / "run") as run:
        assert np.all(np.diff(run.times) > 0.0)
        steps = run.summary()["steps"]
        assert steps > 100 and run.series["distance"][-1] >= 20e-9 * (1.0 - 1e-6)
        # of sliding there are frames only in the drag
        assert run.frames == steps + 1 if "ns" in settings["output_every"] else 20 < run.frames < steps
