"""`check` tells the memory of a run: what Python itself counts, for both integrators."""

import gc
import tracemalloc
from pathlib import Path

import pytest

import thirdbody
from thirdbody.report.scene_check import memory_of
from thirdbody.runner.prepare import prepare

SCENE = Path(__file__).resolve().parents[2] / "scenes" / "sheared_debris.toml"


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_memory_per_body_is_what_a_larger_scene_takes_more(integrator):
    scene = thirdbody.Scene.load(SCENE).with_settings({"solver.integrator": integrator, "contact.debris_contact": "none"})
    kept, taken, counted = [], [], []
    prepare(scene.with_settings({"debris.0.count": 50}), force=True)  # caches and compiled code
    tracemalloc.start()
    try:
        for count in (100, 400):
            gc.collect()
            before = tracemalloc.get_traced_memory()[0]
            kept.append(prepare(scene.with_settings({"debris.0.count": count}), force=True))
            gc.collect()
            taken.append(tracemalloc.get_traced_memory()[0] - before)
            counted.append(memory_of(kept[-1]))
    finally:
        tracemalloc.stop()
    # 3 %: the scene itself and Python's own objects; a table of one number per sphere would be .7 %
    assert counted[1] - counted[0] == pytest.approx(taken[1] - taken[0], rel=0.03)
    # issue 29 asks for 4 kB: three eighths are records, of all candidates although few of them touch
    assert counted[1] - counted[0] < 300 * (8000 if integrator == "implicit" else 9000)
