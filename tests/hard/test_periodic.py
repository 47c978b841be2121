"""A periodic box is the same world as a box of twice the length with everything in it twice."""

from __future__ import annotations

import numpy as np
import pytest

from thirdbody.assembly.simulation import build
from thirdbody.kernels.columns import body, body_extra
from thirdbody.scene.model import Domain, Effects

RADIUS, LENGTH, WIDTH, COUNT = 1e-3, 8e-3, 6e-3, 14


def balls(make, shifts):
    """Fast balls on a jittered grid, each once per shift along x."""
    rng = np.random.default_rng(5)
    cells = np.array([(i, j, k) for i in range(3) for j in range(2) for k in range(3)])[:COUNT]
    places = (cells + 0.5) * [LENGTH / 3, WIDTH / 2, 2.7e-3] + rng.uniform(-0.3e-3, 0.3e-3, (COUNT, 3)) + [0.0, 0.0, RADIUS]
    speeds, spins = rng.normal(0.0, 20.0, (COUNT, 3)), rng.normal(0.0, 1e4, (COUNT, 3))
    return [
        make.ball(RADIUS, place + [shift, 0.0, 0.0], speed, spin)
        for shift in shifts
        for place, speed, spin in zip(places, speeds, spins, strict=True)
    ]


EFFECTS = {
    "none": {},
    "pivoting": {"pivoting": {"damping": 0.3}},
    "flow": {"elastic_plastic": {}},
    "necks": {"adhesion": {"work_of_adhesion": "100 J/m2", "model": "jkr"}},  # of 1.5 um, so that a step resolves them
}


def world(make, length, shifts, effects):
    keys = {"friction": 0.4, "restitution": 0.8, "lower": "ball", "domain": Domain(size=(length, WIDTH), periodic=True)}
    named = Effects(named=effects)
    simulation = build(make.scene(balls(make, shifts), {"ball": make.STEEL}, time_step=1e-7, effects=named, **keys))
    simulation.integrator.advance_to(time=1.2e-4)
    return simulation


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.full(kind="slow")] * (name != "none")) for name in EFFECTS]
)
def test_a_doubled_box_moves_alike(make, name):
    one, two = (world(make, k * LENGTH, [LENGTH * i for i in range(k)], EFFECTS[name]) for k in (1, 2))
    if name in ("flow", "necks"):
        lost = [run.state.E[:, body_extra.NORMAL_LOSS] for run in (one, two)]
        assert (lost[0] > 0.0).any()
        # round-off of the work done, amplified as below
        assert np.abs(lost[1].reshape(2, -1) - lost[0]).max() < 1e-6 * lost[0].max()
    columns = [*range(body.VELOCITY, body.VELOCITY + 3), *range(body.SPIN, body.SPIN + 3)]
    assert np.any(one.state.bodies.friction_work > 0.0), "balls have rubbed on each other"
    crossed = (one.state.bodies.position[:, 0] < 0.0) | (one.state.bodies.position[:, 0] > LENGTH)
    assert crossed.any(), "some balls are beyond a face"
    scale = np.abs(one.state.B[:, columns]).max(axis=0)
    for copy in (slice(0, COUNT), slice(COUNT, 2 * COUNT)):
        # places differ by rounding (1e-16 of the box over 1e-3 of a radius of overlap), which collisions amplify
        assert np.all(np.abs(two.state.B[copy, columns] - one.state.B[:, columns]) < 1e-8 * scale)
