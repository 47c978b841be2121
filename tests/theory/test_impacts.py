"""Impacts against closed forms: Hertz, restitution, the order of the integrator, Chung and Ooi's tests 1 to 3 (Granular Matter
13, 2011, 643; their rigid plane is a plate a million times stiffer than the ball), plastic flow by Thornton and Ning."""

import itertools
import math

import closed_forms
import numpy as np
import pytest
import three_spot_theory as theory
from each import each
from scipy.integrate import quad
from thirdbody_effects import elastic_plastic as plastic
from thirdbody.assembly.simulation import build
from thirdbody.engine.guards import Ledger
from thirdbody.kernels.tables import body, body_extra
from thirdbody.laws.damping import damping_number, restitution_of
from thirdbody.laws.data import Contact
from thirdbody.laws.generated import plain
from thirdbody.scene.model import Ball, Effects, Material
from thirdbody.scene.model import Contact as ContactTable
from thirdbody.statics.contacts import response
from thirdbody.units import pretty

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
        return S[1, 0] - S[0, 0] - 2.0 * radius, make.velocity(simulation, 1)[0] - make.velocity(simulation, 0)[0]

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


def test_impacts_are_of_second_order_and_damped_ones_of_order_five_quarters(make):
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
    # the dashpot's force starts like x^.25 v, whose sum over steps is h^1.25 off
    counts, errors = (80, 160, 320, 640, 1280), []
    for count in counts:
        simulation = plane_start(make, NUMBERS, 1e-3, 1.0, count, restitution=0.3)
        make.leave(simulation, simulation.state.dt * count)
        errors.append(abs(make.velocity(simulation)[2] / 0.3 - 1.0))
    # a slope fitted over a decade and a half, with the analytic parts of order 2 still in it
    assert order(counts, errors) == pytest.approx(1.25, abs=0.08)
    assert errors[-1] < 3e-4


YIELD = 1.5e9
BALL = Material(youngs_modulus=210e9, poisson_ratio=0.3, density=7850.0, yield_strength=YIELD)
RADIUS = 1e-3
FLOWS = Effects(named={"elastic_plastic": {}})

# Thornton and Ning's closed form, to the digits of Thornton 1997, Eq. 25
RESTITUTION = {1.0: 1.0, 2.0: 0.930626, 5.0: 0.773337, 10.0: 0.658558, 100.0: 0.374299}

modulus, pressure = 115e9, 2.4e9
first = (math.pi * pressure / (2.0 * modulus)) ** 2  # overlap at first yield over the radius
at_yield = math.pi**3 * pressure**3 / (6.0 * modulus**2)  # force over the squared radius
numbers = plastic.YieldParameters(modulus, pressure, first)


def law(overlap, history=(0.0, 0.0)):
    return plain(plastic.elastic_plastic)(Contact(overlap, 1.0, *8 * [0.0]), numbers, history)


def loading(overlap):
    """Force of virgin loading, over the squared radius: Hertz, then the straight line (Thornton and Ning, Eqs. 8 and 10)."""
    if overlap < first:
        return 4.0 / 3.0 * modulus * overlap**1.5
    return at_yield + math.pi * pressure * (overlap - first)


def yield_speed(modulus, density):
    """Speed of a ball on a plane at first yield: half m V^2 = (2/5) N_y d_y."""
    return math.pi**2 / (2.0 * math.sqrt(10.0)) * math.sqrt((1.6 * YIELD) ** 5 / (modulus**4 * density))


def restitution(ratio):
    """Thornton 1997, Eq. 25, of an impact at `ratio` times the speed at first yield."""
    y = 1.0 / ratio
    root = y + 2.0 * math.sqrt(6.0 / 5.0 - y * y / 5.0)
    return math.sqrt(6.0 * math.sqrt(3.0) / 5.0) * math.sqrt(1.0 - y * y / 6.0) * (y / root) ** 0.25


@each(RESTITUTION)
def test_restitution_of_the_law(ratio):
    """Elastic energy at the largest overlap over that of the impact, from forces by quadrature; table: six digits."""
    assert restitution(ratio) == pytest.approx(RESTITUTION[ratio], abs=5e-7)
    energy = ratio**2 * 0.4 * at_yield * first
    root = math.sqrt(at_yield**2 + 2.0 * math.pi * pressure * (energy - 0.4 * at_yield * first))
    more = (root - at_yield) / math.pi / pressure
    result, history = law(first + more)
    # quadrature: 1e-10; the force has a corner at first yield
    released = quad(lambda x: law(x, history)[0].force, 0.0, first + more, epsabs=0.0, epsrel=1e-11, limit=400)[0]
    assert math.sqrt(released / energy) == pytest.approx(restitution(ratio), rel=1e-8)
    assert result.stored == pytest.approx(released, rel=1e-8)
    assert result.stored + result.dissipated == pytest.approx(energy, rel=1e-13)


def test_press_release_and_press_again():
    m = 6.0 * first
    overlaps = np.linspace(0.0, m, 60)[1:]
    assert [law(x)[0].force for x in overlaps] == pytest.approx([loading(x) for x in overlaps], rel=1e-13)
    history = law(m)[1]
    # elastic: the way back is the way in, up to the old force, without a step
    assert history == law(0.5 * m, history)[1] == law(0.9 * m, law(0.01 * m, history)[1])[1]
    assert law(m, history)[0].force == pytest.approx(loading(m), rel=1e-13)
    peak = math.sqrt(m)  # contact radius at m, a^2 = R m: that of the flattened sphere, too
    assert law(m, history)[0].contact_radius == pytest.approx(peak, rel=1e-13)
    # Hertz with R_p = 4 E* a^3/(3 N) about the permanent indentation
    flat = 4.0 * modulus * peak**3 / (3.0 * loading(m))
    dent = m - peak**2 / flat
    for x in np.linspace(dent, m, 9)[1:]:
        found = law(x, history)[0]
        assert found.force == pytest.approx(4.0 / 3.0 * modulus * math.sqrt(flat) * (x - dent) ** 1.5, rel=1e-11)
        assert found.contact_radius == pytest.approx(math.sqrt(flat * (x - dent)), rel=1e-11)
        assert found.dissipated == 0.0 and found.peak_pressure <= pressure
    # in the dent: no force, no energy, and the memory stays
    assert law(0.9 * dent, history) == (plastic.Normal(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), history)
    # beyond: it flows on as if it had never been released, however the way is cut into steps
    assert law(2.0 * m, history)[1] == law(2.0 * m)[1]
    cut = sum(law(b, law(a)[1])[0].dissipated for a, b in zip(overlaps, overlaps[1:], strict=False))
    assert cut == pytest.approx(history[1], rel=1e-12)
    # below first yield it is Hertz
    for x in first * np.array([1e-12, 0.1, 0.5, 0.999]):
        found, history = law(x)
        assert found.force == pytest.approx(4.0 / 3.0 * modulus * x**1.5, rel=1e-14)
        assert law(0.3 * x, history)[0].force == pytest.approx(4.0 / 3.0 * modulus * (0.3 * x) ** 1.5, rel=1e-14)
        assert found.dissipated == history[1] == 0.0
    assert law(first)[0].peak_pressure == pytest.approx(pressure, rel=1e-14)


def impact(make, ratio, count, **keys):
    e = 2.0 * BALL.shear() / (1.0 - BALL.poisson_ratio)  # of a rigid plane, to 1e-6
    speed, mass = ratio * yield_speed(e, BALL.density), make.ball_mass(BALL, RADIUS)
    duration = 2.943 * (1.25 * mass / (e * math.sqrt(RADIUS))) ** 0.4 * speed**-0.2
    tables = {"effects": FLOWS, "contact": ContactTable(law="hertz_mindlin", level="frictionless")} | keys
    simulation = make.ball_on_plane(BALL, RADIUS, (0.0, 0.0, -speed), time_step=duration / count, **tables)
    ledger = Ledger(simulation.state)
    make.leave(simulation, duration)
    return make.velocity(simulation)[2] / speed, ledger, simulation


@pytest.mark.parametrize("ratio", [1.0, 100.0])
def test_restitution_of_an_impact(make, ratio):
    """Order two: what is missed is the largest overlap between two steps. |error| n^2 < 1 for n from 100 to 1600 steps."""
    count = 400
    e, ledger, simulation = impact(make, ratio, count)
    assert abs(e - RESTITUTION[ratio]) < 1.0 / count**2 + 5e-7  # digits of the table
    lines, state = ledger.lines(simulation.state), simulation.state
    assert ledger.relative_residual(state, lines["residual"]) < 1e-5  # order two, too
    assert lines["plastic"] == pytest.approx((1.0 - restitution(ratio) ** 2) * ledger.start, abs=1e-5 * ledger.start)
    assert lines["friction"] == pytest.approx(0.0, abs=1e-14 * ledger.start)
    assert state.E[0, body_extra.NORMAL_LOSS] == lines["plastic"] and state.B[0, body.FRICTION_WORK] >= lines["plastic"]


def test_two_balls_share_the_work(make):
    speed = 10.0 * yield_speed(BALL.shear() / (1.0 - BALL.poisson_ratio), BALL.density)
    simulation = make.two_balls(BALL, RADIUS, (speed, 0.0, 0.0), effects=FLOWS, time_step=2e-9)
    energy = make.kinetic(simulation)
    make.leave(simulation, 1e-6)
    work = simulation.state.E[:, body_extra.NORMAL_LOSS]
    assert work[0] == work[1] and work.sum() + make.kinetic(simulation) == pytest.approx(energy, rel=1e-4)  # of 500 steps


def test_the_bound_of_the_time_step_is_for_unloading(make):
    """It is for the stiffness 2 E* a of a contact that turns back."""
    physics = impact(make, 1.0, 100)[2].state.physics
    e = 2.0 * BALL.shear() / (1.0 - BALL.poisson_ratio) / (1.0 + 1e-6)
    deep = 30.0 * (math.pi * 1.6 * YIELD / (2.0 * e)) ** 2 * RADIUS
    found = response(physics, np.array([deep]), np.array([RADIUS]), physics.kinds[0, 1:])
    assert found.stiffness[0] == pytest.approx(2.0 * e * math.sqrt(RADIUS * deep), rel=1e-12)
    assert found.stiffness[0] > 5.0 * math.pi * 1.6 * YIELD * RADIUS  # of the flow


def test_the_level_without_it_keeps_hertz(make):
    simulation = make.ball_on_plane(BALL, RADIUS, (0.0, 0.0, -1.0))
    assert [law.name for law in simulation.choice.chain.laws][0] == "hertz"
    named = build(simulation.scene.with_settings({"effects.elastic_plastic": {"yield_ratio": 2.8}}))
    assert [law.name for law in named.choice.chain.laws if law.stage == "normal"] == ["elastic_plastic"]
    # `check` tells first yield of either: of the pressure where contacts are computed as elastic, and where they flow
    for built, ratio in ((simulation, 1.6), (named, 2.8)):
        reason = next(row["reason"] for row in built.expected.parts() if row["part"] == "first yield")
        e = 2.0 * BALL.shear() / (1.0 - BALL.poisson_ratio)
        force = math.pi**3 * RADIUS**2 * (ratio * YIELD) ** 3 / (6.0 * e**2)
        speed = yield_speed(e, BALL.density) * (ratio / 1.6) ** 2.5
        assert f"from {pretty(force, 'force')} on a sphere" in reason
        assert f"at {pretty(speed, 'velocity')} in its impact" in reason and ("contacts flow" in reason) == (built is named)
