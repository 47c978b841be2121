"""Random valid scenes end well, or with a word that says why: no raw exception, no NaN, no residual or label left unexplained."""

import math
import os
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hard.random_scenes import random_layer, random_scene
from trajectories import contents

import thirdbody
from thirdbody.errors import GuardStop, InputError, Interrupted
from thirdbody.runner.run_loop import WallTimes
from thirdbody.runner.simulate import execute, prepare
from thirdbody.schema.write import toml_text
from thirdbody.trajectory.names import ACCOMMODATION, BED

SCENES = int(os.environ.get("RANDOM_SCENES", "60"))
WALL_LIMIT = 20.0  # s; a scene takes about one on an idle core; what is cut off must say what limits its steps
LARGEST_RESIDUAL = 1e-3  # of the work: the project's promise for every run without a word
FORCES = ("normal_force", "tangential_force", "overlap", "contact_radius")


def run_scene(document: dict[str, Any], folder: Path, threads: int = 1, wall_limit: float = math.inf) -> str:
    try:
        scene = thirdbody.Scene.parse(toml_text(document))
        simulation = prepare(scene)
    except InputError as error:
        assert all(fault.key for fault in error.faults), error
        return "refused"
    end = "finished"
    try:
        execute(simulation, folder, threads, times=WallTimes(limit=wall_limit))
    except GuardStop as stop:
        assert " t = " in str(stop), stop  # says when
        end = "guard"
    except Interrupted:
        end = "cut off"
    with thirdbody.open(folder) as run:
        check_numbers(run)
        check_labels(run)
        if end == "finished":
            check_residual(run)
        if end == "cut off" and scene.solver.integrator == "implicit":
            assert run.summary()["steps_limited_by"], "a crawl without a word"
    return end


def check_numbers(run: thirdbody.Run) -> None:
    for name, values in run.series.items():
        assert np.isfinite(values).all() or name in ("friction_coefficient", *ACCOMMODATION, *BED), name
    for frame in range(run.frames):
        bodies, contacts = run.bodies(frame), run.contacts(frame)
        for name in ("position", "velocity", "force", "torque", "friction_work"):
            assert np.isfinite(bodies[name]).all(), (frame, name)
        for name in FORCES:
            assert np.isfinite(contacts[name]).all(), (frame, name)
        assert (contacts["utilisation"] <= 1.0 + 1e-9).all(), frame  # round-off of the return to the limit


def check_labels(run: thirdbody.Run) -> None:
    free = run.state_names.index("free")
    for frame in range(run.frames):
        contacts, state = run.contacts(frame), run.bodies(frame)["state"]
        touched, loaded = np.zeros((2, len(state)), dtype=bool)
        for name in ("body", "partner"):
            bodies = contacts[name] >= 0
            touched[contacts[name][bodies]] = True
            loaded[contacts[name][bodies & (contacts["normal_force"] > 0.0)]] = True
        assert (state[~touched] == free).all(), f"frame {frame}: a label without a contact"
        assert (state[loaded] != free).all(), f"frame {frame}: free under load"


def check_residual(run: thirdbody.Run) -> None:
    summary = run.summary()
    if abs(summary["energy_residual"]) > LARGEST_RESIDUAL:
        assert summary["energy_verdict"], f"a residual of {summary['energy_residual']:.2g} without a word"


@pytest.mark.full(kind="fuzz")
@pytest.mark.parametrize("random", [random_scene, random_layer])
def test_random_scenes_end_well_or_say_why(tmp_path, random):
    """Single bodies and layers that do not meet, by both integrators; layers whose bodies meet, by the implicit one."""
    ends, faults = Counter(), []
    for seed in range(SCENES):
        try:
            end = run_scene(random(seed), tmp_path / f"{seed}", wall_limit=WALL_LIMIT)
            if end == "finished" and seed % 4 == 0:
                run_scene(random(seed), tmp_path / f"{seed}_two", threads=2)
                assert contents(tmp_path / f"{seed}") == contents(tmp_path / f"{seed}_two")
        except Exception as error:  # every one is a fault; all of them are listed
            faults.append(f"{seed}: {type(error).__name__}: {error}")
            end = "fault"
        ends[end] += 1
    print(dict(ends))
    assert not faults, "\n".join(faults)
    assert ends["refused"] + ends["guard"] < 0.2 * SCENES  # else the scenes say little
