"""Pivoting friction: a pinched ball stops spinning, sways elastically below the limit; spins of balls that meet head-on."""

import math

import numpy as np
import pytest
from thirdbody_three_spot import theory

from thirdbody.engine.energy import Ledger
from thirdbody.kernels.columns import body, body_extra, record, run_totals
from thirdbody.scene.model import ConstantVelocity, Effects, Motion

RADIUS, LOAD, MIDDLE, FRICTION = 5e-6, 1e-4, 1e-4, 0.3
FULL_SLIP = 3.0 * math.pi / 16.0  # moment over mu N a of a Hertz contact that slips throughout, in torsion


def named(**options):
    return Effects(named={"pivoting": options})


def pinched(make, integrator, spin, **options):
    """A ball at rest between two plates, settled under the load, that is then given a spin about the normal (rad/s)."""
    one = make.ball(RADIUS, (MIDDLE, MIDDLE, RADIUS))
    still = Motion(x=[ConstantVelocity(velocity=0.0)])
    keys = {"friction": FRICTION, "restitution": 0.3, "size": 2.0 * MIDDLE, "settle": 0.0, "duration": 1.0}
    keys |= {"integrator": integrator, "effects": named(**options), "patch": {"damping": 7e-5}}
    simulation = make.under_patches([one], {"ball": make.STEEL}, LOAD, still, **keys)
    simulation.integrator.advance_to(time=4e-6)
    B, E = simulation.state.B, simulation.state.E
    B[0, body.SPIN + 2], E[0, body_extra.ANGULAR_MOMENTUM + 2] = spin, spin * E[0, body_extra.INERTIA]
    return simulation


def follow(make, simulation, duration, every):
    start, rows = simulation.state.time, []
    for time in np.arange(every, duration, every):
        simulation.integrator.advance_to(time=start + time)
        rows.append((simulation.state.time - start, make.spin(simulation)[2]))
    return np.array(rows).T


def spot_of(make):
    """Of Hertz' contact between the ball and a plane: limit of the moment [N m], stiffness 16/3 G a^3 in series [N m/rad]."""
    g, nu = make.STEEL.shear(), make.STEEL.poisson_ratio
    a = math.sqrt(RADIUS * theory.hertz_overlap(theory.e_star(g, nu, g, nu), RADIUS, LOAD))
    return FULL_SLIP * FRICTION * LOAD * a, 16.0 / 3.0 * 0.5 * g * a**3


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_pinched_ball_stops_spinning(make, integrator):
    """Two spots brake it at 2 (3 pi/16) mu N a/I, and all of its energy goes into friction; then it sways below the limit."""
    spin = 4e5
    simulation = pinched(make, integrator, spin)
    state, inertia = simulation.state, simulation.state.E[0, body_extra.INERTIA]
    ledger = Ledger(state)
    before = ledger.lines(state)
    limit, k = spot_of(make)
    rate = 2.0 * limit / inertia
    time, spins = follow(make, simulation, 0.9 * spin / rate, 0.15 * spin / rate)
    slope, start = np.polyfit(time, spins, 1)
    # the load still trembles by 1e-6 of itself; the implicit steps have a tolerance of 1e-4
    assert slope == pytest.approx(-rate, rel=1e-5)
    # while the springs load, over the angle limit/k, they brake by half the limit in the mean: 1.5e-3 of the spin
    assert start - spin == pytest.approx(0.5 * rate * limit / k / spin, abs=2e-4 * spin)
    contacts = state.slots.R[state.slots.histories.slip > 0.0]
    # each opposes the spin about its own normal
    assert contacts[:, record.TWIST_MOMENT] * contacts[:, record.NORMAL + 2] == pytest.approx([-limit, -limit], rel=1e-5)
    assert contacts[:, record.TWIST_LIMIT] == pytest.approx([limit, limit], rel=1e-5)
    lines = ledger.lines(state)
    stored = 2.0 * 0.5 * limit**2 / k
    assert lines["elastic_tangential"] == pytest.approx(stored, rel=1e-4)
    lost = 0.5 * inertia * (spin**2 - spins[-1] ** 2) - stored
    assert lines["friction"] - before["friction"] == pytest.approx(lost, rel=1e-3)
    assert abs(lines["residual"] - before["residual"]) < 1e-6 * lost
    simulation.integrator.advance_to(time=state.time + 0.2 * spin / rate)
    # it stands still but for the swing on its springs, which hold half of what they stored at the limit at the most
    assert abs(make.spin(simulation)[2]) < 1.01 * math.sqrt(2.0 * stored / inertia)
    assert state.B[0, body.FRICTION_WORK] == pytest.approx(0.5 * inertia * spin**2, rel=0.02)


@pytest.mark.parametrize("ratio", [0.0, 0.05])
def test_below_the_limit_a_ball_sways_on_its_springs(make, ratio):
    """Frequency (2 k/I)^(1/2) of two spots; a dashpot of each lets it decay at C/I = 2 zeta (k (2/5) m R^2)^(1/2)/I."""
    limit, k = spot_of(make)
    inertia = 0.4 * make.ball_mass(make.STEEL, RADIUS) * RADIUS**2
    omega, decay = math.sqrt(2.0 * k / inertia), 2.0 * ratio * math.sqrt(0.4) * math.sqrt(k / 0.4 / inertia)
    spin = 0.5 * limit / k * omega
    simulation = pinched(make, "explicit", spin, damping=ratio)
    friction = simulation.state.A[run_totals.FRICTION_WORK]
    time, spins = follow(make, simulation, 4.0 * 2.0 * math.pi / omega, 0.1 / omega)
    turned = math.sqrt(omega**2 - decay**2)
    expected = np.exp(-decay * time) * (np.cos(turned * time) - decay / turned * np.sin(turned * time))
    # velocity Verlet is off by (omega dt)^2/24 = 2e-6 of the frequency; the dashpot acts by the velocity before, an error of
    # first order in omega dt = 6e-3 of the damping
    assert spins == pytest.approx(spin * expected, abs=1e-3 * spin)
    # below the limit friction dissipates nothing but what a load that still trembles takes
    assert simulation.state.A[run_totals.FRICTION_WORK] - friction < 1e-6 * 0.5 * inertia * spin**2


def test_an_impact_changes_the_spins_by_the_moment_of_its_load(make):
    """I dw = (3 pi/16) mu int N a dt for balls that spin against each other: N a = 4/3 E* R* d^2, in an elastic impact

    d^2 dt integrates to (4/5) D^3/v B(6/5, 1/2), with the largest overlap D and the relative speed v.
    """
    speed, spin, radius = 1.0, 1e6, 1e-3
    keys = {"effects": named(), "friction": FRICTION, "restitution": 1.0}
    simulation = make.two_balls(make.STEEL, radius, (speed, 0.0, 0.0), (spin, 0.0, 0.0), **keys)
    ledger, before = Ledger(simulation.state), make.kinetic(simulation)
    make.leave(simulation, 2e-6)
    g, nu = make.STEEL.shear(), make.STEEL.poisson_ratio
    e, mass = theory.e_star(g, nu, g, nu), make.ball_mass(make.STEEL, radius)
    deepest = (15.0 / 16.0 * 0.5 * mass * (2.0 * speed) ** 2 / (e * math.sqrt(0.5 * radius))) ** 0.4
    beta = math.gamma(1.2) * math.gamma(0.5) / math.gamma(1.7)
    impulse = 4.0 / 3.0 * e * 0.5 * radius * 0.8 * deepest**3 / (2.0 * speed) * beta
    change = FULL_SLIP * FRICTION * impulse / (0.4 * mass * radius**2)
    spins = simulation.state.bodies.spin[:, 0]
    # the springs yield at a turn of some 1e-2, which takes 1e-3 of the impact at its light ends
    assert spin - spins[0] == pytest.approx(change, rel=1e-3)
    assert spins[0] == pytest.approx(-spins[1], rel=1e-12)  # rounding: equal and opposite moments
    lines = ledger.lines(simulation.state)
    assert lines["elastic_tangential"] == 0.0, "what the spring held is released when the contact opens"
    # velocity Verlet in the corner where a spring begins to slip: an error of second order in the step
    assert lines["friction"] == pytest.approx(before - make.kinetic(simulation), rel=1e-4)
    assert abs(lines["residual"]) < 1e-4 * lines["friction"]


def test_check_reminds_of_it_where_a_ball_spins_between_plates(make):
    still = Motion(x=[ConstantVelocity(velocity=0.0)])
    for spin, keys in ((1e4, {}), (0.0, {}), (1e4, {"effects": named()})):
        one = make.ball(RADIUS, (MIDDLE, MIDDLE, RADIUS), spin=(0.0, 0.0, spin))
        simulation = make.under_patches([one], {"ball": make.STEEL}, LOAD, still, friction=FRICTION, **keys)
        assert sum("effects.pivoting" in text for text in simulation.warnings) == (1 if spin and not keys else 0)
