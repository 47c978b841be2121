"""The benchmark's scenes build and step, so that the benchmark does not rot."""

from __future__ import annotations

import importlib.util
import json
import math
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

BENCH = Path(__file__).parents[1] / "bench"


@pytest.fixture(scope="module")
def scenes() -> ModuleType:
    """tests/bench/peers_scenes.py, which is no part of a package."""
    spec = importlib.util.spec_from_file_location("peers_scenes", BENCH / "peers_scenes.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def layer(scenes) -> dict[str, np.ndarray]:
    """A thin S, in the layout of its files."""
    return scenes.generated(200)


def steps_of(simulation, number: int) -> int:
    """Run so many steps of the fixed length; how many they were."""
    state, before = simulation.state, simulation.integrator.summary()["steps"]
    simulation.integrator.advance_to(time=state.time + (number - 0.5) * state.dt)
    return simulation.integrator.summary()["steps"] - before


def dumbbells(layer: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Bodies of two spheres of unlike size in any direction in the layout of C and T: um, pg, us, inertia in space axes."""
    rng = np.random.default_rng(4)
    n = 20
    columns, rows = np.divmod(np.arange(n), 5)
    centre = np.column_stack((14.0 * columns + 7.0, 14.0 * rows + 7.0, np.full(n, 6.0)))
    along = rng.normal(size=(n, 3))
    along /= np.linalg.norm(along, axis=1)[:, None]
    x = (centre[:, None] + along[:, None] * np.array([-1.5, 2.5])[:, None]).reshape(-1, 3)
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    return {
        "x": x, "rad": np.tile([2.0, 1.5], n), "mol": np.repeat(np.arange(n), 2), "bx": centre, "bm": np.full(n, 300.0),
        "bI": 500.0 * np.eye(3) + 1500.0 * across, "bv": rng.normal(size=(n, 3)), "bw": rng.normal(size=(n, 3)),
        "L": np.array([70.0, 70.0]), "H": np.array(12.0), "dt": np.array(3e-4),
    }  # fmt: skip


def test_spheres_start_where_the_file_says_and_flow(scenes, layer):
    start = scenes.start_of("S", layer)
    simulation = scenes.simulation_of(start)
    assert simulation.labeller is None and simulation.state.dt == start.step
    spheres = scenes.spheres_of(simulation)
    np.testing.assert_allclose(spheres["points"], 1e-6 * layer["x"], rtol=1e-12)  # rounding of the change of unit
    before, energy = scenes.count_contacts(start, spheres["points"]), scenes.kinetic_energy(start, spheres["velocity"])
    assert steps_of(simulation, 300) == 300
    spheres = scenes.spheres_of(simulation)
    after = scenes.count_contacts(start, spheres["points"])
    # .5 us: spheres that come nearer at .3 m/s cross the gaps of .1 um that the layer has at the start
    assert after[0] > 2 * before[0] and after[0] > 100
    # collisions take of the motion between neighbours, .5 m/s by the shear and .3 at random: 4 % of the energy of the flow, whose
    # mean square is 8.3 m2/s2; and the lower plate brakes the lowest layer, which has no energy to speak of
    assert 0.92 * energy < scenes.kinetic_energy(start, spheres["velocity"]) < energy


def test_contacts_that_are_counted_are_those_of_the_engine(scenes, layer):
    simulation = scenes.simulation_of(scenes.start_of("S", layer))
    steps_of(simulation, 100)
    frame = scenes.FrameMaker(simulation.state, scenes.Ledger(simulation.state), None, (1.0, 0.0)).frame(None)
    side = frame.contacts["side"]
    debris, plates = scenes.count_contacts(scenes.start_of("S", layer), frame.spheres["points"])
    assert (debris, plates) == (np.sum(side == 2), np.sum(side != 2)) and debris > 0 and plates > 0


def test_copies_side_by_side_have_the_same_contacts_each(scenes, layer):
    one = scenes.start_of("S", layer)
    four = scenes.start_of("S", scenes.tiled(layer, 2, 2))
    assert four.size == tuple(2.0 * length for length in one.size) and four.bodies == 4 * one.bodies
    # periodic: neighbours across a border are those that were across the domain
    assert scenes.count_contacts(four, four.x) == tuple(4 * n for n in scenes.count_contacts(one, one.x))


@pytest.mark.parametrize("kind", ["C", "T"])
def test_clumps_have_the_places_motion_and_inertia_of_the_file(scenes, layer, kind):
    given = scenes.tiled(dumbbells(layer), 1, 2)
    start = scenes.start_of(kind, given)
    simulation = scenes.simulation_of(start)
    assert simulation.state.world.debris_meets == (kind == "C")
    spheres = scenes.spheres_of(simulation)
    # rounding of the change of unit and of the turn into the principal frame and back
    np.testing.assert_allclose(spheres["points"], 1e-6 * given["x"], rtol=1e-12)
    arms = given["x"] - given["bx"][given["mol"]]
    velocity = given["bv"][given["mol"]] + np.cross(given["bw"][given["mol"]], arms)  # um/us = m/s
    np.testing.assert_allclose(spheres["velocity"], velocity, rtol=1e-9, atol=1e-12)
    # kinetic energy of the bodies with the mass and inertia of the file, pg um2/us2 = 1e-15 J
    turning = np.einsum("ni,nij,nj->", given["bw"], given["bI"], given["bw"])
    energy = 0.5e-15 * (np.sum(given["bm"] * np.sum(given["bv"] ** 2, axis=1)) + turning)
    assert scenes.Ledger(simulation.state).lines(simulation.state)["kinetic"] == pytest.approx(energy, rel=1e-9)
    assert steps_of(simulation, 70) == 70


def test_a_file_is_read(scenes, layer, tmp_path):
    np.savez(tmp_path / "S_200.npz", **layer)
    start = scenes.read(tmp_path / "S_200.npz", (2, 1))
    assert start.kind == "S" and start.spheres == 400
    mass = 2e-15 * 7.85 * 4.0 / 3.0 * math.pi * np.sum(layer["rad"] ** 3)
    assert start.mass.sum() == pytest.approx(mass, rel=1e-12)  # rounding


def test_the_benchmark_runs_alone_where_no_peer_is_given(tmp_path):
    report = tmp_path / "told.json"
    command = [sys.executable, str(BENCH / "peers.py"), "--scenes", "S200@2x1,C2000", "--rounds", "2", "--steps", "70"]
    command += ["--warm", "0", "--reps", "1", "-o", str(report)]
    environment = {key: value for key, value in os.environ.items() if key != "THIRDBODY_PEERS"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "LIGGGHTS: not asked for" in done.stdout and "C2000: left out" in done.stdout
    only = json.loads(report.read_text(encoding="utf-8"))["scenes"]
    assert [row["scene"] for row in only] == ["S200@2x1"] and only[0]["best"] is None
    runs = only[0]["runs"]["thirdbody"]
    assert len(runs) == 2 and all(run["spheres"] == 400 and run["t"][0] > 0.0 for run in runs)
    assert runs[0]["contacts"] == runs[1]["contacts"] and runs[0]["ke_end"] == runs[1]["ke_end"]  # the same run, bit for bit


def test_ratios_are_of_the_same_round(monkeypatch):
    monkeypatch.syspath_prepend(BENCH)
    peers = importlib.import_module("peers")
    runs = {
        "thirdbody": [{"t": [1.0]}, {"t": [2.0]}, {"t": [4.0]}],
        "slow": [{"t": [9.0]}, {"t": [18.0]}, {"t": [36.0]}],
        "fast": [{"t": [3.0, 1.0, 2.0]}, {"failed": "why"}, {"t": [12.0]}],
    }
    report = peers.summed_up(runs)
    assert report["ratios"]["slow"]["rounds"] == [9.0, 9.0, 9.0] and report["ratios"]["fast"]["rounds"] == [2.0, 3.0]
    assert report["best"] == "fast" and report["ratio"]["median"] == 2.5 and report["ratio"]["max"] == 3.0
