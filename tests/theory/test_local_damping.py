"""Local damping: its closed decay whatever the force law, and that it ends with the settling."""

import math

import numpy as np
import pytest
import three_spot_theory as theory

from thirdbody.assembly.simulation import build
from thirdbody.engine.guards import Ledger
from thirdbody.errors import InputError
from thirdbody.kernels.tables import body, body_extra
from thirdbody.scene.model import Effects, Solver

RADIUS, GRAVITY, DROP = 1e-3, 1e4, 1e-3  # such a strong gravity makes short falls: two thousand steps each


def dropped(make, alpha, settle, drop=DROP, step="auto", **more):
    """A ball at a height over a plane, without any other damping; every body of the scene settles for `settle` seconds."""
    effects = {"gravity": (0.0, 0.0, -GRAVITY), "named": {"local_damping": {"coefficient": alpha}} | more}
    solver = Solver(duration=1.0, settle=settle, time_step=step)
    one = [make.ball(RADIUS, (5.0, 5.0, RADIUS + drop))]
    return build(make.scene(one, {"ball": make.STEEL}, lower="ball", effects=Effects(**effects), solver=solver))


def height(simulation):
    return simulation.state.spheres.position[0, 2] - RADIUS


def test_a_dropped_ball_bounces_lower(make):
    """Between turning points (1 + alpha) U_2 = (1 - alpha) U_1, U from the equilibrium: two of them make a bounce."""
    alpha = 0.6
    # a quarter of the automatic step: the force turns at a step, not at the turning point
    simulation = dropped(make, alpha, 1.0, step=5e-8)
    ledger, scale = Ledger(simulation.state), GRAVITY * DROP * make.ball_mass(make.STEEL, RADIUS)
    fall, ratio = math.sqrt(2.0 * DROP / (GRAVITY * (1.0 - alpha))), ((1.0 - alpha) / (1.0 + alpha)) ** 2
    simulation.integrator.advance_to(time=0.9 * fall)
    # the first half step, from rest, is not damped yet: alpha/(1 - alpha) of it
    assert DROP - height(simulation) == pytest.approx(DROP * (simulation.state.time / fall) ** 2, rel=1e-3)
    simulation.integrator.advance_to(time=1.1 * fall)
    while make.velocity(simulation)[2] > 0.0:
        make.advance(simulation)
    g, nu = make.STEEL.shear(), make.STEEL.poisson_ratio
    weight = GRAVITY * make.ball_mass(make.STEEL, RADIUS)
    # potential of the equilibrium below first touch: m g d - (2/5) m g d, an equivalent height
    sunk = 0.6 * theory.hertz_overlap(theory.e_star(g, nu, g, nu), RADIUS, weight)
    # that turn is late by some 1/120 of the impact's depth, squared
    assert height(simulation) + sunk == pytest.approx(ratio * (DROP + sunk), rel=5e-3)
    lines = ledger.lines(simulation.state)
    # the ledger: gravity's work and the damping's own stand together as body effects; truncation of the short impact
    assert abs(lines["residual"]) < 3e-3 * scale and lines["damping"] == lines["friction"] == 0.0
    assert lines["body_effects"] == pytest.approx(lines["kinetic"] + lines["elastic_normal"], abs=3e-3 * scale)


def test_a_rocking_ball_decays_by_the_logarithmic_decrement(make):
    """ln((1 + alpha)/(1 - alpha)) a period, whatever the frequency: here that of the rolling spring; torques like forces."""
    alpha, rolling = 0.1, {"rolling_resistance": {"coefficient": 0.5}}
    simulation = dropped(make, alpha, 1.0, drop=0.0, **rolling)
    simulation.integrator.advance_to(time=2e-3)
    B, E = simulation.state.B, simulation.state.E
    B[0, body.SPIN + 1], E[0, body_extra.ANGULAR_MOMENTUM + 1] = 1.0, E[0, body_extra.INERTIA]
    ledger, energy, spins = Ledger(simulation.state), make.kinetic(simulation), []
    earlier = ledger.lines(simulation.state)["residual"]
    while len(spins) < 20000 and np.count_nonzero(np.diff(np.sign(spins))) < 9:
        make.advance(simulation)
        spins.append(make.spin(simulation)[1])
    turns = np.flatnonzero(np.diff(np.sign(spins)))
    peaks = [np.abs(spins[a:b]).max() for a, b in zip(turns, turns[1:], strict=False)]
    # the sign turns at a step, with omega dt = 0.08: 7e-4, and a quarter with half the step
    decrement = 2.0 * np.log(peaks[0] / peaks[-1]) / (len(peaks) - 1)
    assert decrement == pytest.approx(math.log((1.0 + alpha) / (1.0 - alpha)), rel=2e-3)
    # the work of the torques, but for truncation
    assert abs(ledger.lines(simulation.state)["residual"] - earlier) < 1e-3 * energy


def test_it_ends_with_the_settling(make):
    settle = 2e-4
    simulation = dropped(make, 0.5, settle)
    simulation.integrator.advance_to(time=settle)
    start, speed = simulation.state.time, make.velocity(simulation)[2]
    # the step that ends the settling may be half damped: 1 in 1000 steps
    assert speed == pytest.approx(-0.5 * GRAVITY * start, rel=2e-3)
    force = simulation.state.bodies.force[0]
    assert np.array_equal(force, simulation.state.bodies.mass[0] * np.array([0.0, 0.0, -GRAVITY]))
    simulation.integrator.advance_to(time=1.5 * settle)
    # free fall: only round-off
    assert make.velocity(simulation)[2] - speed == pytest.approx(-GRAVITY * (simulation.state.time - start), rel=1e-10)

    with pytest.raises(InputError, match=r"effects.local_damping: acts while the debris settles, and this scene has no"):
        dropped(make, 0.3, 0.0)
