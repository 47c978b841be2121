"""Orientations of single spheres: four spins of every 16 steps stand for all; against every step, and with other stops."""

import importlib
from pathlib import Path

import numpy as np
import pytest
from numba import njit
from scipy.spatial.transform import Rotation

from thirdbody.engine.explicit import BUDGET
from thirdbody.engine.orientations import orientations
from thirdbody.kernels.columns import body
from thirdbody.kernels.sphere_rotation import STEPS, steps_behind, weight_of


@njit
def weights(steps):
    """Weights of so many steps, and by how many steps orientations are behind after each number of them."""
    return [weight_of(k) for k in range(steps)], [steps_behind(k) for k in range(steps)]


WEIGHTS, BEHIND = weights(3 * STEPS)
TAKEN = {k: weight for k, weight in enumerate(WEIGHTS[:STEPS]) if weight != 0.0}


@pytest.fixture
def layer(monkeypatch):
    """A dense layer of 300 spheres that is sheared at 5 m/s, and a function that makes so many steps."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "bench")
    scenes, ours = (importlib.import_module(name) for name in ("peers_scenes", "ours"))
    return lambda: scenes.simulation_of(scenes.start_of("S", scenes.generated(300))), ours.advance


def turns_of(q: np.ndarray) -> Rotation:
    """Rotations of quaternions (n, 4), w first."""
    return Rotation.from_quat(np.roll(q, -1, axis=1))


@pytest.mark.parametrize("power", range(5))
def test_the_sum_over_a_block_is_exact_for_cubic_polynomials(power):
    every = sum((k - 7.0) ** power for k in range(STEPS))  # not from the middle: odd powers are tested, too
    taken = sum(weight * (k - 7.0) ** power for k, weight in TAKEN.items())
    assert (taken == pytest.approx(every, rel=1e-14)) == (power < 4)
    assert len(TAKEN) == STEPS / 4


def test_the_time_step_changes_between_blocks_only():
    assert BUDGET % STEPS == 0


def test_what_a_stop_lacks_is_the_rest_of_the_block():
    for steps in range(3 * STEPS):
        assert BEHIND[steps] == pytest.approx(steps - sum(WEIGHTS[:steps]), abs=1e-13)
        assert abs(BEHIND[steps]) < 2.1


def test_rotations_agree_with_those_of_every_step(layer):
    """In collisions and under friction: the error of the quadrature, 2e-3 of the rotation at most."""
    make, advance = layer
    simulation = make()
    advance(simulation, 100)
    state, engine = simulation.state, simulation.integrator
    B, every = state.B, turns_of(orientations(state))
    start = every
    for _ in range(400):
        middle = B[:, body.SPIN3] + 0.5 * state.dt / B[:, [body.SPHERE_INERTIA]] * B[:, body.TORQUE3]
        advance(simulation, 1)
        every = Rotation.from_rotvec(state.dt * middle) * every
    assert engine.summary()["steps"] == 500
    off, turned = (turns_of(orientations(state)) * every.inv()).magnitude(), (every * start.inv()).magnitude()
    print(f"off by {np.sqrt(np.mean(off**2)):.3g}, {off.max():.3g} rad at most; turned by {np.sqrt(np.mean(turned**2)):.3g} rad")
    assert np.sqrt(np.mean(off**2)) < 2e-3 * np.sqrt(np.mean(turned**2))


def test_stops_change_no_bit(layer):
    make, advance = layer
    one, other = make(), make()
    advance(one, 150)
    for steps in (1, 2, 5, 10, 14, 30, 3, 85):
        advance(other, steps)
        orientations(other.state)
    for name in ("orientations", "B", "A"):
        assert getattr(one.state, name).tobytes() == getattr(other.state, name).tobytes()
