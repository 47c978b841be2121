"""Ten million steps of one rolling clump, a million of a dense bed: nothing drifts. `pytest -m hard -s` prints the figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import thirdbody
from thirdbody.assembly.simulation import Simulation
from thirdbody.engine.energy import Ledger
from thirdbody.kernels.columns import body, run_totals
from thirdbody.runner.simulate import prepare
from thirdbody.scene.model import ConstantVelocity, Effects, Motion

SCENES = Path(__file__).parents[2] / "scenes"
CHECKS = 20


def drift(simulation: Simulation, steps: int) -> tuple[float, float, float]:
    """Largest energy residual, fault of a quaternion's norm, and momentum that came from nowhere, at so many looks.

    The momentum is compared with the sum of what the plates gave and took, look by look.
    """
    state, ledger = simulation.state, Ledger(simulation.state)
    start, gravity = momentum(simulation), np.array(simulation.scene.effects.gravity or (0.0, 0.0, 0.0))
    mass = float(state.bodies.mass.sum())
    worst = np.zeros(3)
    exchanged, before = 0.0, np.zeros(6)
    for check_number in range(1, CHECKS + 1):
        while state.A[run_totals.STEPS] < steps * check_number / CHECKS:
            simulation.integrator.advance_to(time=state.time + 500.0 * state.dt, watch=lambda: ledger.watch(state))
        given = state.A[run_totals.UPPER_IMPULSE : run_totals.UPPER_IMPULSE + 6].copy()
        exchanged += float(np.abs(given - before).sum())
        before = given
        gained = momentum(simulation) - start + given[:3] + given[3:] - mass * gravity * state.time
        norms = np.linalg.norm(state.bodies.quaternion, axis=1)
        residual = ledger.relative_residual(state, ledger.lines(state)["residual"])
        worst = np.maximum(worst, [residual, np.abs(norms - 1.0).max(), np.abs(gained).max() / exchanged])
        assert np.all(np.isfinite(state.B)) and np.all(np.isfinite(state.slots.H))
    residual, norm, lost = (float(x) for x in worst)
    print(f"\n{steps:.0e} steps: energy residual {residual:.1e}, |q| - 1 {norm:.1e}, momentum {lost:.1e} of what was exchanged")
    return residual, norm, lost


def momentum(simulation: Simulation) -> np.ndarray:
    B = simulation.state.B
    return np.asarray(B[:, [body.MASS]] * B[:, body.VELOCITY3]).sum(axis=0)


@pytest.mark.full(kind="hard")
def test_ten_million_steps_of_one_rolling_clump(make):
    """Near round, so that it rolls on and on over the periodic faces; dragged at 1 m/s, loaded, with weight."""
    balls = [((0.0, 0.0, 0.0), 5.0), ((0.6, 0.1, 0.0), 4.8), ((-0.5, 0.3, 0.2), 4.9)]
    shape = [{"center": tuple(1e-6 * x for x in centre), "radius": 1e-6 * r} for centre, r in balls]
    simulation = make.under_patches(
        [make.clump(shape)], {"ball": make.STEEL}, 1e-4, Motion(x=[ConstantVelocity(velocity=1.0)]), friction=0.5,
        restitution=0.5, size=2e-4, integrator="explicit", duration=1.0, effects=Effects(gravity=(0.0, 0.0, -9.81)),
    )  # fmt: skip
    residual, norm, lost = drift(simulation, 10_000_000)
    assert make.label(simulation) == "rolling"
    # truncation of the steps; rounding of a normalised product; rounding of 1e7 additions, which grows as their root
    assert residual < 1e-3 and norm < 1e-14 and lost < 1e-11


@pytest.mark.full(kind="hard")
def test_a_million_steps_of_a_dense_bed():
    scene = thirdbody.Scene.load(SCENES / "dense_layer.toml").with_settings({"solver.distance": "1 m", "output.every": "1 m"})
    residual, norm, lost = drift(prepare(scene, force=True), 1_000_000)
    assert residual < 1e-3 and norm < 1e-14 and lost < 1e-11
