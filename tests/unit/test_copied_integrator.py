"""A copy of an integrator advances its own tables, even after the original has run."""

import copy
from pathlib import Path

import numpy as np
import pytest

import thirdbody
from thirdbody.runner.simulate import prepare

SCENE = Path(__file__).parents[2] / "scenes" / "three_spot.toml"


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_copy_does_not_move_the_original(integrator):
    """The kernels get addresses of tables: those of the original would move its bodies, and the copy would never arrive."""
    scene = thirdbody.Scene.load(SCENE).with_settings({"solver.integrator": integrator})
    original = prepare(scene).integrator
    original.advance_to(time=1e-9)
    before = original.state.B.copy()
    double = copy.deepcopy(original)
    double.advance_to(time=2e-9)
    assert np.array_equal(original.state.B, before)
    original.advance_to(time=2e-9)
    assert np.array_equal(original.state.B, double.state.B) and not np.array_equal(original.state.B, before)
