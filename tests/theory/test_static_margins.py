"""Distance from static equilibrium: the margins `force_balance` and `moment_balance`, and the reason `unbalanced`."""

import numpy as np
import pytest
from steel import SCENES
from thirdbody_three_spot import LABELLER
from thirdbody_three_spot.balance import balance

import thirdbody
from thirdbody.assembly.simulation import build

RADIUS, SPEED = 1e-5, 0.05


def report(simulation, number=0):
    row = simulation.integrator.label()[number]
    margins = dict(zip(LABELLER.margins, row[2:].tolist(), strict=False))
    return LABELLER.states[int(row[0])], LABELLER.reasons[int(row[1])], margins


def test_a_ball_in_an_impact_is_unbalanced_until_it_flies_and_by_moments_if_oblique(make):
    """No gravity, so only inertia balances the contact."""
    impact = make.ball_on_plane(make.STEEL, RADIUS, (0.0, 0.0, -SPEED), restitution=0.6)
    make.advance(impact, 10)
    state, reason, margins = report(impact)
    assert (state, reason) == ("sticking", "unbalanced")
    # the contact force is the whole sum: 1 - 1/0.05
    assert margins["force_balance"] == pytest.approx(-19.0, rel=1e-12)
    assert margins["moment_balance"] == 1.0  # it acts through the centre
    while make.touching(impact).any():
        make.advance(impact, 5)
    assert make.velocity(impact)[2] > 0.0
    state, reason, margins = report(impact)
    assert (state, reason) == ("free", "none")  # without a contact there is no condition to violate
    assert set(margins.values()) == {1.0}
    simulation = make.ball_on_plane(make.STEEL, RADIUS, (SPEED, 0.0, -SPEED), friction=0.3)
    make.advance(simulation, 10)
    _, reason, margins = report(simulation)
    assert reason == "unbalanced"
    # it slides: 0.3 N at the arm R, and the lever is 2 R
    assert margins["moment_balance"] == pytest.approx(1.0 - 0.3 / 2.0 / 0.05, rel=1e-9)


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_particle_in_slow_drag_is_in_static_equilibrium(integrator):
    scene = thirdbody.Scene.load(SCENES / "three_spot.toml").with_settings({"solver.integrator": integrator})
    built = build(scene)
    built.integrator.advance_to(time=built.settle)
    built.integrator.advance_to(distance=3e-9)
    _, reason, margins = report(built)
    assert reason != "unbalanced"
    # at 10 mm/s inertia is less than a thousandth of the friction at work; the explicit particle still rings a little
    assert min(margins["force_balance"], margins["moment_balance"]) > 0.9


def test_equilibria_of_balance_are_balanced():
    result = balance(SCENES / "balance" / "three_spot.toml", "mindlin")
    margins = [(point.margins["force_balance"], point.margins["moment_balance"]) for point in result.points]
    # Newton's method leaves 1e-12 of the forces, twenty times that of the margin
    assert np.min(margins) == pytest.approx(1.0, abs=1e-9)
    assert "unbalanced" not in {point.reason for point in result.points}
