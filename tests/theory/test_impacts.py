"""Impacts against closed forms: Hertz' elastic impact, restitution, order of the integrator, and Chung and Ooi's tests 1 to 3.

Chung and Ooi, Benchmark tests for verifying discrete element modelling codes at particle impact level, Granular Matter 13
(2011) 643. Their rigid plane is a plate a million times stiffer than the ball in E and G.
"""

import itertools
import math

import closed_forms
import numpy as np
import pytest
import three_spot_theory as theory

from thirdbody.laws.damping import damping_number, restitution_of
from thirdbody.scene.model import Ball

RESOLVED = 200  # steps per contact time where a closed form is the judge: the undamped error falls with its square (tested below)
TRUNCATION = 1e-4
"""Largest sample and contact time at `RESOLVED` steps: (2.87/200)^2/2 = 1.0e-4 at most; and E* of the rigid plane, 1e-6."""

# Young's modulus Pa, Poisson's ratio, density kg/m3
BALLS = {"glass": (48e9, 0.2, 2800.0), "limestone": (20e9, 0.25, 2500.0)}
PLANES = {"aluminium alloy": (70e9, 0.3, 2699.0), "magnesium alloy": (40e9, 0.35, 1800.0)}
SWEEP = {"aluminium oxide": (380e9, 0.23, 4000.0), "cast iron": (100e9, 0.25, 7000.0)}


def pair(make, numbers, radius):
    material = make.solid(*numbers)
    g, nu = material.shear(), material.poisson_ratio
    return make.ball_mass(material, radius) / 2.0, radius / 2.0, theory.e_star(g, nu, g, nu)


def plane(make, numbers, radius):
    material = make.solid(*numbers)
    g, nu = material.shear(), material.poisson_ratio
    return make.ball_mass(material, radius), radius, theory.e_star(g, nu, math.inf, nu)


def balls_impact(make, numbers, radius, speed):
    step = hertz(pair(make, numbers, radius), 2.0 * speed)[2] / RESOLVED
    simulation = make.two_balls(make.solid(*numbers), radius, (speed, 0.0, 0.0), time_step=step)
    S = simulation.state.S

    def gap():
        apart = S[1, 0] - S[0, 0] - 2.0 * radius
        return apart, make.velocity(simulation, 1)[0] - make.velocity(simulation, 0)[0]

    return simulation, make.impact(simulation, gap)


def hertz(effective, speed):
    return (
        closed_forms.impact_overlap(*effective, speed),
        closed_forms.impact_force(*effective, speed),
        closed_forms.impact_duration(*effective, speed),
    )


def plane_start(make, numbers, radius, speed, count=RESOLVED, **keys):
    """A ball that falls with `speed` on a rigid plane, `count` steps per elastic contact time."""
    step = hertz(plane(make, numbers, radius), speed)[2] / count
    return make.ball_on_plane(make.solid(*numbers), radius, (0.0, 0.0, -speed), time_step=step, **keys)


def check_peaks(found, expected):
    overlap, force, duration = expected
    assert found.overlap.max() == pytest.approx(overlap, rel=TRUNCATION)
    assert found.normal.max() == pytest.approx(force, rel=TRUNCATION)
    assert found.end == pytest.approx(duration, rel=TRUNCATION)
    assert np.all(found.tangential == 0.0)


@pytest.mark.parametrize("name", BALLS)
def test_chung_ooi_1_two_balls(make, name):
    simulation, found = balls_impact(make, BALLS[name], 0.01, 10.0)
    check_peaks(found, hertz(pair(make, BALLS[name], 0.01), 20.0))
    # elastic: equal masses exchange their velocities
    assert make.velocity(simulation, 1)[0] == pytest.approx(10.0, rel=TRUNCATION)


@pytest.mark.parametrize("name", PLANES)
def test_chung_ooi_2_ball_on_a_rigid_plane(make, name):
    simulation = plane_start(make, PLANES[name], 0.1, 0.2)
    check_peaks(make.plane_impact(simulation), hertz(plane(make, PLANES[name], 0.1), 0.2))
    assert make.velocity(simulation)[2] == pytest.approx(0.2, rel=TRUNCATION)


def test_chung_ooi_3_restitution(make):
    speed, radius = 3.9, 2.5e-3
    for name, restitution in itertools.product(SWEEP, (0.2, 0.4, 0.6, 0.8, 1.0)):
        simulation = plane_start(make, SWEEP[name], radius, speed, restitution=restitution)
        make.leave(simulation, simulation.state.dt * RESOLVED)
        # order 1.25 (tested below): .3 % at e = .2 and 200 steps, less for less damping
        assert make.velocity(simulation)[2] / speed == pytest.approx(restitution, rel=4e-3), (name, restitution)


NUMBERS = (210e9, 0.3, 7850.0)


def test_restitution_does_not_depend_on_speed(make):
    """The same number over six decades of speed, and the scene's; up to 1 cm/s also with the automatic step of 60 a contact."""
    for restitution in (0.9, 0.3):
        found = []
        for speed in (1e-5, 1e-3, 1e-2, 1.0, 10.0):
            simulation = plane_start(make, NUMBERS, 1e-3, speed, restitution=restitution)
            make.leave(simulation, simulation.state.dt * RESOLVED)
            found.append(make.velocity(simulation)[2] / speed)
            if speed in (1e-5, 1e-2):
                simulation = make.ball_on_plane(make.STEEL, 1e-3, (0.0, 0.0, -speed), restitution=restitution)
                make.leave(simulation, hertz(plane(make, NUMBERS, 1e-3), speed)[2])
                assert make.velocity(simulation)[2] / speed == pytest.approx(restitution, rel=0.01)
        # truncation at 200 steps, as above
        assert found == pytest.approx([restitution] * len(found), rel=2.5e-3)
        # the equation of motion has no scale of its own: what is left is rounding of z near the radius, 1e-19 of 1e-10 m
        assert np.ptp(found) < 1e-6


def test_a_clump_leaves_with_the_restitution_of_its_number_of_contacts(make):
    """n equal contacts are one with sqrt(n) times the damping number; a warning says so with both numbers."""
    for count in (1, 2, 3, 7):
        angles = 2.0 * math.pi / count * np.arange(count)
        ring = 0.95e-3 / math.sin(math.pi / count) if count > 1 else 0.0  # neighbours overlap by a twentieth
        shape = tuple(Ball(center=(ring * math.cos(x), ring * math.sin(x), 0.0), radius=1e-3) for x in angles)
        body = make.Spheres(material="ball", shape=shape, positions=((5.0, 5.0, 1e-3),), velocity=(0.0, 0.0, -0.1))
        materials = {"ball": make.STEEL, "plane": make.stiffened(make.STEEL)}
        simulation = make.build(make.scene([body], materials, lower="plane", restitution=0.6, time_step=2e-8))
        make.leave(simulation, 1e-5)
        theory = restitution_of(math.sqrt(count) * damping_number(0.6))  # .6, .5, .44, .31
        assert make.velocity(simulation)[2] / 0.1 == pytest.approx(theory, rel=4e-3)  # 400 steps an impact, order 1.25
        assert any(f"{theory:.2g} on {count} (its" in text for text in simulation.warnings) == (count > 1)


def order(counts, errors):
    return -np.polyfit(np.log(counts), np.log(errors), 1)[0]


def test_undamped_impact_is_of_second_order(make):
    counts, late, deep, slow = (40, 80, 160, 320), [], [], []
    overlap, _, duration = hertz(plane(make, NUMBERS, 1e-3), 1.0)
    overlap *= (1.0 + 1.0 / make.RIGID) ** 0.4  # the plane is not quite rigid
    duration *= (1.0 + 1.0 / make.RIGID) ** 0.4
    for count in counts:
        simulation = plane_start(make, NUMBERS, 1e-3, 1.0, count)
        found = make.plane_impact(simulation)
        late.append(abs(found.end / duration - 1.0))
        top = found.overlap.argmax()
        # the top between samples: a parabola through three of them is exact to the fourth order of the step
        a, b, c = np.polyfit(np.array([-1.0, 0.0, 1.0]), found.overlap[top - 1 : top + 2], 2)
        deep.append(abs((c - b**2 / (4.0 * a)) / overlap - 1.0))
        slow.append(abs(make.velocity(simulation)[2] - 1.0))
    # slopes differ from 2 by the next term, some (1/40)^1 of the first
    assert order(counts, late) == pytest.approx(2.0, abs=0.05)
    assert order(counts, deep) == pytest.approx(2.0, abs=0.07)
    assert late[-1] < 1e-5 and deep[-1] < 1e-5
    # a symmetric method on a symmetric impact: what is left is the kink of x^1.5 where the contact ends, order 2.5 and more
    assert order(counts, slow) > 2.5
    assert slow[-1] < 1e-6


def test_damped_impact_is_of_order_five_quarters(make):
    """The dashpot's force starts like x^.25 v, whose sum over steps is h^1.25 off."""
    counts, errors = (80, 160, 320, 640, 1280), []
    for count in counts:
        simulation = plane_start(make, NUMBERS, 1e-3, 1.0, count, restitution=0.3)
        make.leave(simulation, simulation.state.dt * count)
        errors.append(abs(make.velocity(simulation)[2] / 0.3 - 1.0))
    # a slope fitted over a decade and a half, with the analytic parts of order 2 still in it
    assert order(counts, errors) == pytest.approx(1.25, abs=0.08)
    assert errors[-1] < 3e-4
