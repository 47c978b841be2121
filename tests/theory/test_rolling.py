"""A ball that slides and a ball that rolls: down a slope and between two plates."""

from __future__ import annotations

import math

import closed_forms
import numpy as np
import pytest
from thirdbody_three_spot import theory

from thirdbody.assembly.simulation import build
from thirdbody.kernels.columns import record
from thirdbody.scene.model import ConstantVelocity, Motion, UpperPlate

RADIUS = 1e-3
SLOPE = (5.0, 0.0, -5.0)
RUN = 5.0005e-3


def slope_ball(make, friction):
    """A steel ball after `RUN` seconds on a slope of 45 degrees that it touched at time zero."""
    one = [make.ball(RADIUS, (5.0, 5.0, RADIUS))]
    simulation = build(make.scene(one, {"ball": make.STEEL}, lower="ball", friction=friction, restitution=0.3, gravity=SLOPE))
    simulation.integrator.advance_to(time=RUN)
    return simulation


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.2, 0.28])
def test_ball_slides_down_a_slope(make, friction):
    simulation = slope_ball(make, friction)
    speed, spin = closed_forms.sliding_sphere(friction, 5.0, 5.0, RADIUS, simulation.state.time)
    # it lands with a bounce of some 1e-5 m/s: while that dies out friction is mu N at its mean only, and near 2/7 it sticks for
    # moments
    assert make.velocity(simulation)[0] == pytest.approx(speed, rel=1e-4)
    assert make.spin(simulation)[1] == pytest.approx(spin, rel=2e-4, abs=1e-12)
    assert make.label(simulation) == "sliding"


@pytest.mark.parametrize("friction", [0.29, 0.4, 1.0])
def test_ball_rolls_down_a_slope(make, friction):
    simulation = slope_ball(make, friction)
    assert closed_forms.slope_sphere_rolls(friction, 5.0, 5.0)
    # a rolling solid ball accelerates by 5/7 of the slope; friction needs 2/7 of it
    speed = 5.0 / 7.0 * 5.0 * simulation.state.time
    assert make.velocity(simulation)[0] == pytest.approx(speed, rel=1e-4)
    assert make.spin(simulation)[1] * RADIUS == pytest.approx(speed, rel=1e-4)
    contact = make.contact(simulation)
    assert contact[record.TANGENTIAL_FORCE] / contact[record.NORMAL_FORCE] == pytest.approx(-2.0 / 7.0, rel=1e-3)
    assert make.label(simulation) == "rolling"


def test_settled_weight_is_carried_by_hertz_contact(make):
    simulation = slope_ball(make, 0.2)
    weight = 5.0 * make.ball_mass(make.STEEL, RADIUS)
    g, nu = make.STEEL.shear(), make.STEEL.poisson_ratio
    e = theory.e_star(g, nu, g, nu)
    contact = make.contact(simulation)
    # the bounce has died out: 1e-8 of the weight is left after 5 ms
    assert contact[record.NORMAL_FORCE] == pytest.approx(weight, rel=1e-6)
    assert contact[record.OVERLAP] == pytest.approx(theory.hertz_overlap(e, RADIUS, weight), rel=1e-6)
    assert contact[record.CONTACT_RADIUS] == pytest.approx(math.sqrt(RADIUS * contact[record.OVERLAP]), rel=1e-9)
    assert contact[record.FRICTION_LIMIT] == pytest.approx(0.2 * weight, rel=1e-6)


@pytest.fixture(scope="module")
def pinched(make):
    """(slip time, plate speed, history): a ball pressed between plates, the upper one suddenly at V.

    History rows: time since the start over the slip time, v/V, omega R'/V, |T| over mu N at the lower and upper plate; R' is
    the distance from the centre to the contact planes.
    """
    speed, load, friction = 10.0, 1.0, 0.3
    upper = UpperPlate(material="ball", load=load, motion=Motion(x=[ConstantVelocity(velocity=speed)]))
    one = [make.ball(RADIUS, (5.0, 5.0, RADIUS))]
    tables = make.scene(one, {"ball": make.STEEL}, lower="ball", upper=upper, friction=friction, restitution=0.3)
    # by explicit steps: the implicit ones are tested against the same forms elsewhere
    simulation = build(tables.with_settings({"solver.integrator": "explicit"}))
    slip_time = closed_forms.pinched_sphere_slip_time(make.ball_mass(make.STEEL, RADIUS), friction, load, speed)
    simulation.integrator.advance_to(time=simulation.settle)
    start, labels = simulation.state.time, [make.label(simulation)]
    rows = []
    for part in np.arange(0.05, 2.01, 0.05):
        simulation.integrator.advance_to(time=start + part * slip_time)
        R = simulation.state.slots.R
        arm = RADIUS - 0.5 * R[0, record.OVERLAP]
        forces = np.linalg.norm(R[:, record.TANGENTIAL_FORCE3], axis=1) / (friction * load)
        moved = (simulation.state.time - start) / slip_time
        rows.append((moved, make.velocity(simulation)[0] / speed, make.spin(simulation)[1] * arm / speed, *forces))
        labels.append(make.label(simulation))
    return np.array(rows), labels


def test_pinched_ball_is_dragged_evenly_until_it_rolls(pinched):
    time, v, omega, below, above = pinched[0].T
    slipping = (time > 0.1) & (time < 0.99)
    # mu N above, 3/7 mu N below, constant: v = V/2 at the slip time; elastic deflection lags by .1 % of V
    assert v[slipping] == pytest.approx(0.5 * time[slipping], abs=1e-3)
    assert omega[slipping] == pytest.approx(0.5 * time[slipping], abs=1e-3)
    assert above[slipping] == pytest.approx(1.0, rel=1e-6)
    assert below[slipping] == pytest.approx(3.0 / 7.0, rel=1e-3)


def test_slip_ends_at_the_predicted_time(pinched):
    time, v, *_ = pinched[0].T
    slope, offset = np.polyfit(time[2:18], v[2:18], 1)
    # the straight part meets v = V/2 where slip ends; the lag of the first contact period is some 1e-3 of the slip time
    assert (0.5 - offset) / slope == pytest.approx(1.0, abs=2e-3)


def test_pinched_ball_ends_rolling_without_force(pinched, make):
    time, v, omega, below, above = pinched[0].T
    after = time > 1.3
    # the tangential springs ring down within a few of their periods, 1/30 of the slip time each
    half, _ = closed_forms.pinched_sphere_rolling(1.0, 1.0)
    assert v[after] == pytest.approx(half, abs=1e-9)
    assert omega[after] == pytest.approx(half, abs=1e-9)
    assert np.all(below[after] < 1e-9) and np.all(above[after] < 1e-9)


def test_pinched_ball_is_labelled(pinched):
    rows, labels = pinched
    assert labels[0] == "sticking"
    assert set(np.array(labels[1:])[rows[:, 0] > 0.3]) == {"rolling"}
