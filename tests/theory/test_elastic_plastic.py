"""Plastic flow against Thornton and Ning: restitution, the cycle of press and release, work per body and in the ledger."""

import math

import numpy as np
import pytest
from each import each
from scipy.integrate import quad
from thirdbody_effects import elastic_plastic as plastic

from thirdbody.assembly.simulation import build
from thirdbody.engine.guards import Ledger
from thirdbody.kernels.tables import body, body_extra
from thirdbody.laws.data import Contact
from thirdbody.laws.generated import plain
from thirdbody.scene.model import Contact as ContactTable
from thirdbody.scene.model import Effects, Material
from thirdbody.statics.contacts import response
from thirdbody.units import pretty

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
        reason = next(row["reason"] for row in built.parts() if row["part"] == "first yield")
        e = 2.0 * BALL.shear() / (1.0 - BALL.poisson_ratio)
        force = math.pi**3 * RADIUS**2 * (ratio * YIELD) ** 3 / (6.0 * e**2)
        speed = yield_speed(e, BALL.density) * (ratio / 1.6) ** 2.5
        assert f"from {pretty(force, 'force')} on a sphere" in reason
        assert f"at {pretty(speed, 'velocity')} in its impact" in reason and ("contacts flow" in reason) == (built is named)
