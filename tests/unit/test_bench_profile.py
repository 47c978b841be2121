"""The profile of the benchmark runs on a scene, so that it does not rot."""

from __future__ import annotations

import importlib
import io
from pathlib import Path

import numba
import numpy as np
import pytest
from rich.console import Console

BENCH = Path(__file__).parents[1] / "bench"

LIMITS = {"bandwidth_GB_s": {1: 300.0, 1024: 80.0}, "arithmetic_GF_s": 50.0, "sqrt_ns": 0.25, "division_ns": 0.125}


@pytest.fixture
def bench(monkeypatch):
    """Imports a module of tests/bench, which is no package."""
    monkeypatch.syspath_prepend(BENCH)
    return importlib.import_module


@pytest.mark.full(kind="slow")  # compiles every pass of the engine by itself
def test_every_pass_of_a_small_layer_is_measured(bench, monkeypatch):
    breakdown, scenes = bench("breakdown"), bench("peers_scenes")
    monkeypatch.setattr(breakdown, "SHORT", 1e-4)
    simulation = scenes.simulation_of(scenes.start_of("S", scenes.generated(200)))
    report = breakdown.profile(simulation, LIMITS, warm=130, steps=130, segments=1)
    rows = {row["pass"]: row for row in report["passes"]}
    assert list(rows) == [
        "drift", "measure", "sort", "stage, plates", "stage, pairs", "meet", "turn frames", "slide", "law", "book friction",
        "book dashpots",
        "push", "tally", "bodies, plates", "bodies, pairs", "keep", "gather",
    ]  # fmt: skip
    slots = simulation.state.slots
    assert report["contacts"] == np.sum(slots.closed == 1) > 0 and rows["sort"]["items"] == slots.count / 200
    assert rows["drift"]["calls"] == 4  # chunks of 64 of 200 bodies
    assert rows["sort"]["bytes"] == 18 * slots.count / 200  # a float of 8, two lists of 4, a mark that is read and written
    assert all(row["ns"] > 0.0 and row["GB_s"] > 0.0 for row in rows.values())
    # meet by hand: two images 8, distance 6, its inverse 2, reach and overlap 2, way back 6 and its inverse 8, normals 6, arms 4,
    # radius 2, mass 3, half a step 1
    assert rows["meet"]["operations"] == 48 and rows["sort"]["operations"] == 0
    run = report["run"]
    parts = sum(run[part]["ns"] for part in (breakdown.LOOP, *breakdown.EVENTS))
    assert run["steps"] == 130 and 0.0 < parts <= run["ns"] and run["search"]["calls"] > 0.0
    traffic = {table.name: table for table in report["traffic"]}
    assert traffic["bodies"].bytes == 200 * 2 * 160  # the row of a ball there and back
    assert traffic["histories of contacts"].bytes == report["contacts"] * 2 * 64
    assert traffic["lists: owner and partner"].bytes == 8 * slots.count and "spheres of their own" not in traffic
    page = io.StringIO()
    breakdown.print_profile("S200", report, Console(file=page, width=150))
    assert all(name in page.getvalue() for name in (*rows, *breakdown.EVENTS.values()))


def test_passes_leave_the_scene_as_it_is(bench):
    passes, scenes = bench("passes"), bench("peers_scenes")
    simulation = scenes.simulation_of(scenes.start_of("S", scenes.generated(200)))
    bench("ours").advance(simulation, 130)
    state, slots = simulation.state, simulation.state.slots
    tables = {name: getattr(state, name) for name in "SBPDA"} | {name: getattr(slots, name) for name in ("H", "F", "closed")}
    before = {name: table.copy() for name, table in tables.items()}
    for one in passes.passes_of(passes.Tables(simulation.integrator)):
        one.run(2)
    for name, table in tables.items():
        np.testing.assert_array_equal(table, before[name], err_msg=name)


def test_operations_are_counted_by_kind(bench):
    counted = bench("operations").operations

    @numba.njit
    def one(x, y, k):
        return np.sqrt(x * x + y * y) / (1.0 + x) + min(float(k + 1), y) - -x

    one(1.0, 2.0, 3)
    # products 2, sums 3, a difference, a minimum; the sum of the whole numbers, the sign and the change of type are none
    assert tuple(counted(one)) == (7.0, 1.0, 1.0)
    with pytest.raises(ValueError, match="not compiled"):
        counted(numba.njit(lambda x: x))
