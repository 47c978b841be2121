"""Runs without inertia (`solver.inertia = false`): no flight, no energy made, and a number that says when they are too fast."""

import math

import numpy as np
import pytest
from each import each
from steel import SCENES
import thirdbody
from thirdbody.assembly.integrator import FAST, SLOW, inertial_number
from thirdbody.assembly.simulation import build
from thirdbody.engine.accuracy import CREATED_ENERGY_GUARD, NEGLIGIBLE, created_fractions
from thirdbody.engine.guards import Ledger
from thirdbody.engine.upper_plate import Segment, mean_value
from thirdbody.errors import GuardStop, InputError
from thirdbody.kernels.tables import body, run_totals
from thirdbody.runner.verdicts import patches_not_carried
from thirdbody.scene.model import ConstantVelocity, Motion, Scene, Stroke

MICRO, LOAD, SIZE = 5e-6, 1e-4, 2e-4


def one(make, body, speed=1e-3, **keys):
    keys = {"friction": 0.3, "restitution": 0.3, "size": SIZE, "integrator": "implicit", "inertia": False} | keys
    motion = keys.pop("motion", Motion(x=[ConstantVelocity(velocity=speed)]))
    return make.under_patches([body], {"ball": make.STEEL}, LOAD, motion, **keys)


def ensemble(count, speed, **settings):
    scene = Scene.load(SCENES / "sheared_debris.toml")
    return build(scene.with_settings({
        "debris.0.count": str(count), "contact.debris_contact": "none", "solver.integrator": "implicit",
        "solver.inertia": "false", "plates.upper.motion.x.velocity": f"{speed} m/s", "solver.distance": "6 um",
        "output.every": "0.5 um",
    } | settings))  # fmt: skip


def test_a_body_that_nothing_presses_does_not_fly_on(make):
    """A body without mass has no flight: where both plates have left it, it stays."""
    simulation = one(make, make.ball(MICRO, (1e-4, 1e-4, 2.0 * MICRO), (1.0, 0.0, 0.5), (0.0, 1e5, 0.0)), settle=1e-7)
    simulation.state.patches.height[0] += 1e-6  # the patch is still on its way down
    start = simulation.state.B[0].copy()
    simulation.integrator.advance_to(time=1e-9)
    assert not make.touching(simulation).any()
    # on the way of a flight, 1e-9 m; without inertia nothing moves it but what is left unbalanced: 1e-9 contact radii
    assert simulation.state.bodies.position[0] == pytest.approx(start[body.POSITION3], abs=1e-15)
    assert np.abs(make.velocity(simulation)).max() < 1e-9
    assert patches_not_carried(simulation) == 1
    simulation.integrator.advance_to(time=1e-3)
    assert patches_not_carried(simulation) == 0


def test_rolling_makes_no_energy_without_inertia():
    """Rolling up and down again must not make what the plate did not give: forces change over a step that is a contact wide."""
    simulation = ensemble(30, 1e-3)
    integrator = simulation.integrator
    integrator.advance_to(time=simulation.settle)
    for stop in np.arange(1, 13) * 5e-7:
        integrator.advance_to(distance=float(stop))
        made = -integrator.totals[:, run_totals.NUMERICAL_LOSS] / integrator.totals[:, run_totals.PLATE_WORK_SIZE]
        # of second order in the length of a step; the force at its end alone, of first order, makes .14 here
        assert made.max() < 0.01
    assert Ledger(simulation.state).lines(simulation.state)["kinetic"] == 0.0


LAW = """
import dataclasses
import math
from thirdbody.plugin import HERTZ, MINDLIN, LawFamily, Normal, Plugin, kernel

@kernel
def boastful(c, p):
    a = math.sqrt(c.radius * c.overlap)
    force = 4.0 / 3.0 * p.e_star * a * c.overlap
    return Normal(force, a, 2.0 * force * c.overlap, 0.0, 1.5 * force / (math.pi * a * a), c.radius)

LAW = dataclasses.replace(HERTZ, name="boastful", kernel=boastful)
PLUGIN = Plugin("boastful", families=(LawFamily("boastful", {"only": (LAW, MINDLIN)}, "only"),))
"""


def test_made_energy_stops_an_implicit_run(tmp_path):
    """A law that stores five times what it is given: the ledger closes, for the integrator's own line takes the difference."""
    law = tmp_path / "boastful.py"
    law.write_text(LAW)
    settings = {
        "debris.0.count": "3", "contact.debris_contact": "none", "solver.integrator": "implicit", "solver.distance": "0.2 um",
        "output.every": "0.1 um", "contact.law": "boastful", "contact.level": "only",
    }  # fmt: skip
    scene = Scene.load(SCENES / "sheared_debris.toml").with_settings(settings)
    with pytest.raises(GuardStop, match=r"t = \S+ s: the integrator has created energy: \d+ % .* by body \d at \(") as stopped:
        thirdbody.run(scene, out=tmp_path / "run", plugins=[law], threads=1, progress=False)
    assert stopped.value.exit_code == 4
    with thirdbody.open(tmp_path / "run") as run:
        assert run.frames >= 1 and run.summary()["stopped"]


def created(bodies, common, **rows):
    """Created fractions of bodies; rows: what a body loses and its dashpots dissipate [J]; `common`: what the plate exchanges."""
    totals = np.zeros((bodies, run_totals.WIDTH))
    for number, (loss, spent) in rows.items():
        totals[int(number[1:])][[run_totals.NUMERICAL_LOSS, run_totals.DAMPING_WORK]] = loss, spent
    whole = totals.sum(axis=0)
    whole[run_totals.DAMPING_WORK] += common
    return created_fractions(totals, np.zeros(bodies), whole)


@each([1e-30, 1e-11])
def test_energy_created_by_one_body_is_refused_at_every_scale(scale):
    """The scale is that of the run: neither idle neighbours nor weak loads hide a body that creates what others exchange."""
    alone, _ = created(1, 0.0, b0=(-0.13 * scale, scale))
    assert alone == pytest.approx(0.13)
    loaded, _ = created(4, 0.0, b0=(-0.13 * scale, scale), b1=(0.0, 1e-6 * scale), b2=(0.0, scale), b3=(0.0, scale))
    assert loaded[0] == pytest.approx(0.13) and (loaded[1:] <= 0.0).all()
    # an idle body that goes on creating energy is stopped at a thousandth of what the mean body exchanges
    idle, _ = created(4, 4.0 * scale, b0=(-1.1 * NEGLIGIBLE * CREATED_ENERGY_GUARD * scale, 1e-6 * scale))
    assert idle[0] > CREATED_ENERGY_GUARD


def ball(make, speed, **keys):
    return one(make, make.ball(MICRO, (1e-4, 1e-4, MICRO)), speed, **keys)


def test_inertial_number_of_a_ball(make):
    """v sqrt((m + M)/(W d)); the patch weighs as much as the ball."""
    found = inertial_number(ball(make, 0.1).state)
    mass = 4.0 / 3.0 * math.pi * MICRO**3 * make.STEEL.density
    assert found.number == pytest.approx(0.1 * math.sqrt(2.0 * mass / (LOAD * 2.0 * MICRO)), rel=1e-12)
    assert found.speed == pytest.approx(0.1)
    speed, length = 0.1, 1e-6
    stroke = Motion(x=[Stroke(stroke=length, frequency=speed / (math.pi * length))])
    whole, short = inertial_number(ball(make, speed).state), inertial_number(ball(make, 0.0, motion=stroke).state)
    assert short.number == pytest.approx(whole.number * math.sqrt(2.0 * MICRO / length), rel=1e-9)


def test_fast_motion_without_inertia_is_warned_of_and_refused(make):
    unit = inertial_number(ball(make, 1.0).state).number
    words = "inertial number"
    assert not any(words in text for text in ball(make, 0.99 * SLOW / unit).warnings)
    assert any(words in text for text in ball(make, 1.01 * SLOW / unit).warnings)
    with pytest.raises(InputError, match="inertial number .* of body 0 is 0.33.*leave solver.inertia out") as refused:
        ball(make, 1.1 * FAST / unit)
    assert [fault.key for fault in refused.value.faults] == ["solver.inertia"]
    assert not any(words in text for text in ball(make, 1.1 * FAST / unit, inertia=True).warnings)


def test_mean_of_a_load_that_jumps_and_grows():
    """1 until 2 s, then from 0 evenly to 4 at 4 s, where it stays."""
    axis = (Segment(0.0, 0, 1.0), Segment(2.0, 0, 0.0, 2.0), Segment(4.0, 0, 4.0))
    assert mean_value(axis, 0.0, 2.0) == pytest.approx(1.0)
    assert mean_value(axis, 1.0, 5.0) == pytest.approx((1.0 + 4.0 + 4.0) / 4.0)
    assert mean_value(axis, 3.0, 3.0) == pytest.approx(2.0)
