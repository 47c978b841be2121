"""Moments of contacts: rolling resistance and pivoting friction brake, hold, rock, and change the spins in an impact."""

import math

import numpy as np
import pytest
import three_spot_theory as theory
from thirdbody.assembly.simulation import build
from thirdbody.engine.explicit import bound
from thirdbody.engine.guards import Ledger
from thirdbody.kernels.tables import body, body_extra, record, run_totals
from thirdbody.scene.model import ConstantVelocity, Effects, Motion

RADIUS, GRAVITY = 1e-3, 9.81
CLOSED = 1e-3  # largest residual of the energy ledger, as in every shipped scene


def named(coefficient, gravity=None, **options):
    return Effects(gravity=gravity, named={"rolling_resistance": {"coefficient": coefficient, **options}})


def on_plane(make, effects, velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0), friction=0.3, restitution=0.3):
    one = [make.ball(RADIUS, (5.0, 5.0, RADIUS), velocity, spin)]
    return build(make.scene(one, {"ball": make.STEEL}, friction, restitution, "ball", effects=effects))


def stiffness(make, mu_r, weight):
    """k_r = 2.25 k_n (mu_r R)^2, N m, with k_n = 2 E* a of Hertz' contact under a weight (N)."""
    g, nu = make.STEEL.shear(), make.STEEL.poisson_ratio
    e = theory.e_star(g, nu, g, nu)
    contact_radius = math.sqrt(RADIUS * theory.hertz_overlap(e, RADIUS, weight))
    return 2.25 * 2.0 * e * contact_radius * (mu_r * RADIUS) ** 2


def test_rolling_ball_is_braked(make):
    """About the point of contact (7/5) m R^2 dw/dt = -mu_r R m g: a = -(5/7) mu_r g, of which friction carries all."""
    speed, mu_r = 0.1, 0.1
    simulation = on_plane(make, named(mu_r, (0.0, 0.0, -GRAVITY)), (speed, 0.0, 0.0), (0.0, speed / RADIUS, 0.0))
    ledger = Ledger(simulation.state)
    simulation.integrator.advance_to(time=4e-3)
    lost = speed - make.velocity(simulation)[0]
    # while it lands the load swings about m g, for some 1e-4 of the time; the arm is R - d/2 with d/R = 1e-6
    assert lost == pytest.approx(5.0 / 7.0 * mu_r * GRAVITY * simulation.state.time, rel=2e-4)
    assert make.spin(simulation)[1] * RADIUS == pytest.approx(make.velocity(simulation)[0], rel=1e-5)
    contact = make.contact(simulation)
    weight = GRAVITY * make.ball_mass(make.STEEL, RADIUS)
    assert contact[record.TANGENTIAL_FORCE] == pytest.approx(-5.0 / 7.0 * mu_r * weight, rel=1e-3)
    # the moment opposes the spin about y and stands at its limit
    assert contact[record.MOMENT3] == pytest.approx([0.0, -mu_r * RADIUS * weight, 0.0], rel=1e-6, abs=1e-12 * weight)
    assert contact[record.MOMENT_LIMIT] == pytest.approx(mu_r * RADIUS * weight, rel=1e-6)
    lines = ledger.lines(simulation.state)
    assert ledger.relative_residual(simulation.state, lines["residual"]) < CLOSED
    # what the moment took, it took as mu_r R m g times the angle; landing with a bounce takes 1e-8 of that
    rolled = (speed - 0.5 * lost) * simulation.state.time / RADIUS
    assert lines["friction"] == pytest.approx(mu_r * RADIUS * weight * rolled, rel=1e-2)


@pytest.mark.parametrize("share", [0.9, 2.0])
def test_ball_on_a_slope_stays_below_the_angle_of_rolling_friction(make, share):
    """It stays if tan(angle) < mu_r, else a = (5/7) g (sin - mu_r cos); friction would hold more."""
    mu_r, duration = 0.1, 5e-3
    slope = math.atan(share * mu_r)
    gravity = (GRAVITY * math.sin(slope), 0.0, -GRAVITY * math.cos(slope))
    simulation = on_plane(make, named(mu_r, gravity, damping=0.3), friction=0.5)
    simulation.integrator.advance_to(time=0.4 * duration)
    start, before = simulation.state.time, make.velocity(simulation)[0]
    simulation.integrator.advance_to(time=duration)
    rate = (make.velocity(simulation)[0] - before) / (GRAVITY * (simulation.state.time - start))
    if share < 1.0:
        # the spring is damped: what is left of its swing has died out
        assert abs(rate) < 1e-5 and abs(before) < 1e-5 * GRAVITY * start
    else:
        # landing and yielding are over; the load still trembles by 1e-6 of the weight
        assert rate == pytest.approx(5.0 / 7.0 * (math.sin(slope) - mu_r * math.cos(slope)), rel=1e-4)
        assert make.label(simulation) == "rolling"


def rocked(make, mu_r, ratio=0.0):
    """A settled ball without friction, set spinning so that its spring stays elastic: simulation, frequency, 1/s, spin."""
    simulation = on_plane(make, named(mu_r, (0.0, 0.0, -GRAVITY), damping=ratio), friction=0.0)
    simulation.integrator.advance_to(time=2e-3)
    weight = GRAVITY * simulation.state.B[0, body.MASS]
    k_r = stiffness(make, mu_r, weight)
    omega = math.sqrt(k_r / simulation.state.E[0, body_extra.INERTIA])
    spin = 0.5 * mu_r * RADIUS * weight / k_r * omega
    spun(simulation, 1, spin)
    return simulation, omega, spin


def spun(simulation, axis, spin):
    B, E = simulation.state.B, simulation.state.E
    B[0, body.SPIN + axis], E[0, body_extra.ANGULAR_MOMENTUM + axis] = spin, spin * E[0, body_extra.INERTIA]


def follow(make, simulation, times, axis):
    """(times since now, spins about an axis), s and rad/s."""
    start, rows = simulation.state.time, []
    for time in times:
        simulation.integrator.advance_to(time=start + time)
        rows.append((simulation.state.time - start, make.spin(simulation)[axis]))
    return np.array(rows).T


@pytest.mark.parametrize("ratio", [0.0, 0.02])
def test_rocking_has_the_frequency_of_its_spring_and_the_decay_of_its_dashpot(make, ratio):
    """C = 2 zeta sqrt(k_r (7/5) m R^2), so a ball that turns in its place, I = (2/5) m R^2, decays at C/(2 I)."""
    simulation, omega, spin = rocked(make, 0.5, ratio)
    friction, own = simulation.state.A[run_totals.FRICTION_WORK], ratio * math.sqrt(3.5)
    time, spins = follow(make, simulation, np.arange(0.02, 4.0 if ratio else 8.0, 0.02) * 2.0 * math.pi / omega, 1)
    turned = omega * math.sqrt(1.0 - own**2) * time
    expected = np.exp(-own * omega * time) * (np.cos(turned) - own / math.sqrt(1.0 - own**2) * np.sin(turned))
    # velocity Verlet's own error is (omega dt)^2/24 = 3e-5 of the frequency, here over 16 pi of phase; the velocity that feeds
    # the dashpot is predicted, an error of first order in omega dt = 0.02 of the small damping
    assert spins == pytest.approx(spin * expected, abs=5e-3 * spin)
    if ratio == 0.0:
        assert abs(spins[time > 7.0 * 2.0 * math.pi / omega]).max() == pytest.approx(spin, rel=1e-3)
        # below the limit nothing is dissipated but what a load that still trembles by 1e-6 of itself takes
        energy = 0.5 * simulation.state.bodies.inertia[0, 0] * spin**2
        assert simulation.state.A[run_totals.FRICTION_WORK] - friction < 1e-5 * energy


@pytest.mark.parametrize("partners", ["plane", "equal balls"])
def test_an_impact_changes_the_spin_by_mu_r_r_star_times_the_impulse(make, partners):
    """I dw = -mu_r R* 2 m v for a head-on elastic impact without friction: R* is R at a plane and R/2 between equal balls."""
    mu_r, speed, spin = 0.3, 1.0, 1e5
    keys = {"effects": named(mu_r), "time_step": 2e-8}
    if partners == "plane":
        simulation = make.ball_on_plane(make.STEEL, RADIUS, (0.0, 0.0, -speed), (0.0, spin, 0.0), **keys)
    else:
        simulation = make.two_balls(make.STEEL, RADIUS, (speed, 0.0, 0.0), (0.0, spin, 0.0), **keys)
    ledger, before = Ledger(simulation.state), make.kinetic(simulation)
    make.leave(simulation, 2e-6)
    change = -mu_r * (RADIUS if partners == "plane" else 0.5 * RADIUS) * 2.0 * speed / (0.4 * RADIUS**2)
    # the spring yields at a turn of 0.3 d/(mu_r R*), which takes 1e-3 of the impact and far less of the impulse
    assert make.spin(simulation)[1] - spin == pytest.approx(change, rel=2e-3)
    lines = ledger.lines(simulation.state)
    assert abs(lines["residual"]) < CLOSED * before
    assert lines["elastic_tangential"] == 0.0, "what the spring held is released when the contact opens"
    assert lines["friction"] == pytest.approx(before - make.kinetic(simulation), abs=CLOSED * before)


def test_two_balls_keep_their_angular_momentum(make):
    keys = {"effects": named(0.5, damping=0.2), "friction": 0.3, "restitution": 0.7}
    simulation = make.two_balls(make.STEEL, RADIUS, (1.0, 0.3, 0.0), (300.0, 4000.0, -2000.0), **keys)
    state = simulation.state
    state.bodies.spin[1] *= 0.2  # not mirror images: the total is not zero by symmetry
    state.bodies.angular_momentum[1] *= 0.2
    before = make.momenta(simulation)
    scale = float(np.abs(state.bodies.angular_momentum).sum())
    spins = state.bodies.spin.copy()
    make.leave(simulation, 2e-6)
    after = make.momenta(simulation)
    assert np.abs(state.bodies.spin - spins).max() > 100.0
    # round-off of some hundred steps
    assert np.allclose(after[1], before[1], rtol=0.0, atol=1e-12 * scale)
    assert np.allclose(after[0], before[0], rtol=0.0, atol=1e-12 * scale / RADIUS)


@pytest.mark.parametrize("mu_r", [0.0, 1.0])
def test_the_rolling_spring_counts_in_the_bound_of_the_time_step(make, mu_r):
    """2/omega of the sway and turn of a ball on its tangential and rolling springs, against the bound that the engine takes."""
    simulation = on_plane(make, named(mu_r, (0.0, 0.0, -1e4)), restitution=1.0)
    make.advance(simulation, 50)
    state, a = simulation.state, make.contact(simulation)[record.CONTACT_RADIUS]
    mass, inertia = state.bodies.mass[0], state.bodies.inertia[0, 0]
    g, nu = make.STEEL.shear(), make.STEEL.poisson_ratio
    k_t, k_r = 2.0 * theory.g_star(g, nu, g, nu) * a, 2.25 * 2.0 * theory.e_star(g, nu, g, nu) * a * (mu_r * RADIUS) ** 2
    coupled = k_t * RADIUS / math.sqrt(mass * inertia)
    matrix = np.array([[k_t / mass, coupled], [coupled, (k_t * RADIUS**2 + k_r) / inertia]])
    limit = 2.0 / math.sqrt(np.linalg.eigvalsh(matrix)[-1])
    # the bound tr(K^16)^(1/16) is at most 12 % high in the eigenvalue: two such modes alone make it 4 %
    assert limit / math.sqrt(1.12) < bound(state, simulation.integrator.materials, 0, 0.0).stability < limit


SMALL, LOAD, MIDDLE, FRICTION = 5e-6, 1e-4, 1e-4, 0.3
FULL_SLIP = 3.0 * math.pi / 16.0  # moment over mu N a of a Hertz contact that slips throughout, in torsion


def pivoting(**options):
    return Effects(named={"pivoting": options})


STILL = Motion(x=[ConstantVelocity(velocity=0.0)])


def pinched(make, integrator, spin, **options):
    """A ball at rest between two plates, settled under the load, that is then given a spin about the normal (rad/s)."""
    one = make.ball(SMALL, (MIDDLE, MIDDLE, SMALL))
    keys = {"friction": FRICTION, "restitution": 0.3, "size": 2.0 * MIDDLE, "settle": 0.0, "duration": 1.0}
    keys |= {"integrator": integrator, "effects": pivoting(**options), "patch": {"damping": 7e-5}}
    simulation = make.under_patches([one], {"ball": make.STEEL}, LOAD, STILL, **keys)
    simulation.integrator.advance_to(time=4e-6)
    spun(simulation, 2, spin)
    return simulation


def spot_of(make):
    """Of Hertz' contact between the ball and a plane: limit of the moment [N m], stiffness 16/3 G a^3 in series [N m/rad]."""
    g, nu = make.STEEL.shear(), make.STEEL.poisson_ratio
    a = math.sqrt(SMALL * theory.hertz_overlap(theory.e_star(g, nu, g, nu), SMALL, LOAD))
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
    time, spins = follow(make, simulation, np.arange(0.15, 0.9, 0.15) * spin / rate, 2)
    slope, start = np.polyfit(time, spins, 1)
    # the load still trembles by 1e-6 of itself; the implicit steps have a tolerance of 1e-4
    assert slope == pytest.approx(-rate, rel=1e-5)
    # while the springs load, over the angle limit/k, they brake by half the limit in the mean: 1.5e-3 of the spin
    assert start - spin == pytest.approx(0.5 * rate * limit / k / spin, abs=2e-4 * spin)
    contacts = state.slots.R[state.slots.histories.slip > 0.0]
    # each opposes the spin about its own normal
    assert contacts[:, record.TWIST_MOMENT] * contacts[:, record.NORMAL + 2] == pytest.approx([-limit, -limit], rel=1e-5)
    assert contacts[:, record.TWIST_LIMIT] == pytest.approx([limit, limit], rel=1e-5)
    lines, stored = ledger.lines(state), 2.0 * 0.5 * limit**2 / k
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
    inertia = 0.4 * make.ball_mass(make.STEEL, SMALL) * SMALL**2
    omega, decay = math.sqrt(2.0 * k / inertia), 2.0 * ratio * math.sqrt(0.4) * math.sqrt(k / 0.4 / inertia)
    spin = 0.5 * limit / k * omega
    simulation = pinched(make, "explicit", spin, damping=ratio)
    friction = simulation.state.A[run_totals.FRICTION_WORK]
    time, spins = follow(make, simulation, np.arange(0.1, 8.0 * math.pi, 0.1) / omega, 2)
    turned = math.sqrt(omega**2 - decay**2)
    expected = np.exp(-decay * time) * (np.cos(turned * time) - decay / turned * np.sin(turned * time))
    # velocity Verlet is off by (omega dt)^2/24 = 2e-6 of the frequency; the dashpot acts by the velocity before, an error of
    # first order in omega dt = 6e-3 of the damping
    assert spins == pytest.approx(spin * expected, abs=1e-3 * spin)
    # below the limit friction dissipates nothing but what a load that still trembles takes
    assert simulation.state.A[run_totals.FRICTION_WORK] - friction < 1e-6 * 0.5 * inertia * spin**2


def test_an_impact_changes_the_spins_by_the_moment_of_its_load(make):
    """I dw = (3 pi/16) mu int N a dt for balls that spin against each other: N a = 4/3 E* R* d^2, in an elastic impact d^2 dt
    integrates to (4/5) D^3/v B(6/5, 1/2), with the largest overlap D and the relative speed v."""
    speed, spin, radius = 1.0, 1e6, 1e-3
    keys = {"effects": pivoting(), "friction": FRICTION, "restitution": 1.0}
    simulation = make.two_balls(make.STEEL, radius, (speed, 0.0, 0.0), (spin, 0.0, 0.0), **keys)
    ledger, before = Ledger(simulation.state), make.kinetic(simulation)
    make.leave(simulation, 2e-6)
    g, nu = make.STEEL.shear(), make.STEEL.poisson_ratio
    e, mass = theory.e_star(g, nu, g, nu), make.ball_mass(make.STEEL, radius)
    deepest = (15.0 / 16.0 * 0.5 * mass * (2.0 * speed) ** 2 / (e * math.sqrt(0.5 * radius))) ** 0.4
    beta = math.gamma(1.2) * math.gamma(0.5) / math.gamma(1.7)
    impulse = 4.0 / 3.0 * e * 0.5 * radius * 0.8 * deepest**3 / (2.0 * speed) * beta
    change, spins = FULL_SLIP * FRICTION * impulse / (0.4 * mass * radius**2), simulation.state.bodies.spin[:, 0]
    # the springs yield at a turn of some 1e-2, which takes 1e-3 of the impact at its light ends
    assert spin - spins[0] == pytest.approx(change, rel=1e-3)
    assert spins[0] == pytest.approx(-spins[1], rel=1e-12)  # rounding: equal and opposite moments
    lines = ledger.lines(simulation.state)
    assert lines["elastic_tangential"] == 0.0, "what the spring held is released when the contact opens"
    # velocity Verlet in the corner where a spring begins to slip: an error of second order in the step
    assert lines["friction"] == pytest.approx(before - make.kinetic(simulation), rel=1e-4)
    assert abs(lines["residual"]) < 1e-4 * lines["friction"]


def test_check_reminds_of_it_where_a_ball_spins_between_plates(make):
    for spin, keys in ((1e4, {}), (0.0, {}), (1e4, {"effects": pivoting()})):
        one = make.ball(SMALL, (MIDDLE, MIDDLE, SMALL), spin=(0.0, 0.0, spin))
        simulation = make.under_patches([one], {"ball": make.STEEL}, LOAD, STILL, friction=FRICTION, **keys)
        assert sum("effects.pivoting" in text for text in simulation.warnings) == (1 if spin and not keys else 0)
