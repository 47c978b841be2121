"""The implicit integrator against closed forms, the quasi-static solver and the explicit integrator."""

import math

import numpy as np
import pytest
import three_spot_theory as theory
from slow import slow
from steel import SCENES
from thirdbody_three_spot.balance import balance
from thirdbody.assembly.simulation import build
from thirdbody.engine.guards import Ledger
from thirdbody.kernels.tables import patch, record
from thirdbody.scene.model import ConstantVelocity, Effects, Motion, Ramp, Scene

LEVELS = ("coulomb", "mindlin", slow("mdr"), slow("exact"))
MICRO, LOAD, MIDDLE = 5e-6, 1e-4, 1e-4
CLOSED = 1e-6
"""Largest residual of the ledger: Newton's method leaves 1e-9 of the forces unbalanced in a step, corners of the laws 1e-6."""


def drag(speed):
    return Motion(x=[ConstantVelocity(velocity=speed)])


def ramp(speed):
    return Motion(x=[Ramp(ramp=speed, duration=5e-7), ConstantVelocity(velocity=speed)])


def micro(make, debris, motion, integrator="implicit", **keys):
    """Bodies of some micrometres under 0.1 mN each."""
    keys = {"friction": 0.3, "restitution": 0.3, "size": 2.0 * MIDDLE} | keys
    return make.under_patches(debris, {"ball": make.STEEL}, keys.pop("load", LOAD), motion, integrator=integrator, **keys)


def path(simulation, stops, number=0):
    """Place (m) and attitude (times the size, m) of a body, relative to the start, at sliding distances after settling."""
    simulation.integrator.advance_to(time=simulation.settle)
    rows = []
    for stop in stops:
        simulation.integrator.advance_to(distance=stop)
        bodies = simulation.state.bodies
        rows.append(np.concatenate([bodies.position[number] - MIDDLE, MICRO * bodies.quaternion[number]]))
    return np.array(rows)


def test_steps_are_of_second_order(make):
    """A ball without friction, slowed by a uniform drag: v = v0 exp(-rate t), with steps of one length."""
    rate, v0, spin, duration = 1e6, 0.3, 2e4, 2e-6
    lengths, errors = np.array([6e-8, 3e-8, 1.5e-8, 7.5e-9]), []
    for length in lengths:
        one = make.ball(MICRO, (MIDDLE, MIDDLE, MICRO), (v0, 0.0, 0.0), (0.0, 0.0, spin))
        effects = Effects(named={"damping": {"rate": f"{rate} 1/s"}})
        keys = {"friction": 0.0, "tolerance": 1.0, "largest_step": length, "settle": 0.0, "effects": effects}
        simulation = micro(make, [one], drag(1.0), **keys)
        simulation.integrator.advance_to(time=duration)
        assert simulation.integrator.summary()["longest_step"] == pytest.approx(length, rel=1e-3)
        decay = math.exp(-rate * duration)
        path = v0 / rate * (1.0 - decay)
        gone = simulation.state.bodies.position[0, 0] - MIDDLE
        found = (make.velocity(simulation)[0] / v0, make.spin(simulation)[2] / spin, decay * gone / path)
        errors.append(np.abs(np.array(found) / decay - 1.0))
    slopes = np.polyfit(np.log(lengths), np.log(errors), 1)[0]
    # the first steps are shorter, two of them of backward Euler: they grow to the length within a dozen, a share of the run that
    # falls with the length; lengths near that of the first step would show their order
    assert slopes == pytest.approx([2.0, 2.0, 2.0], abs=0.05)


def test_error_falls_with_the_tolerance(make):
    """A clump that is dropped, pressed, dragged at 1 m/s, turns and tips into another seat: place and attitude all along."""
    stops, body = np.arange(1, 9) * 2.5e-7, make.clump(make.LUMP, gap=2.1e-6)
    # at three times the step it differs by 4e-10 m
    expected = path(micro(make, [body], ramp(1.0), "explicit", time_step=4e-10), stops)
    assert np.ptp(expected, axis=0).max() > 5e-7 and np.ptp(expected[:, 4:], axis=0).max() > 1e-7  # it moves and turns
    errors, steps = [], []
    for tolerance in (8e-3, 5e-4, 3e-5):
        simulation = micro(make, [body], ramp(1.0), tolerance=tolerance)
        errors.append(np.abs(path(simulation, stops) - expected).max())
        steps.append(simulation.integrator.summary()["steps"])
    assert np.all(np.diff(errors) < 0.0) and np.all(np.diff(steps) > 0)
    # the error of a second-order method goes as (allowed error of a step)^(2/3); a start of slip or a lift-off costs more: ^(1/2)
    assert errors[-1] / errors[0] < (3e-5 / 8e-3) ** 0.5
    # some hundred steps, each allowed 3e-5 of a contact radius of 0.2 um, add up to some 1e-9, which tipping amplifies
    assert errors[-1] < 5e-9


@pytest.mark.parametrize("level", LEVELS)
def test_ball_rolls_at_half_the_speed_at_any_speed(make, level):
    speed = 1e-3
    simulation = micro(make, [make.ball(MICRO, (MIDDLE, MIDDLE, MICRO))], drag(speed), level=level)
    simulation.integrator.advance_to(time=simulation.settle)
    simulation.integrator.advance_to(distance=2e-6)
    start = simulation.state.bodies.position[0, 0]
    force = make.mean_force(simulation, 8e-6)
    # Rigid rolling over the way that is left; the contacts' creep is T/k_t, and T is nothing.
    assert simulation.state.bodies.position[0, 0] - start == pytest.approx(4e-6, rel=1e-5)
    assert make.velocity(simulation)[0] == pytest.approx(0.5 * speed, rel=1e-5)
    arm = MICRO - 0.5 * simulation.state.slots.records.overlap[0]
    assert make.spin(simulation)[1] == pytest.approx(0.5 * speed / arm, rel=1e-5) and abs(force[0]) < 1e-6 * LOAD
    assert make.label(simulation) == "rolling" and simulation.integrator.summary()["steps"] < 1000


def test_rolling_resistance_is_what_the_plate_feels(make):
    """Two contacts resist with mu_r R N each, the plate's force turns the ball about the lower one: T 2 R = 2 mu_r R N."""
    mu_r = 0.1
    effects = Effects(named={"rolling_resistance": {"coefficient": mu_r}})
    simulation = micro(make, [make.ball(MICRO, (MIDDLE, MIDDLE, MICRO))], drag(1e-3), effects=effects)
    simulation.integrator.advance_to(time=simulation.settle)
    simulation.integrator.advance_to(distance=2e-6)
    force = make.mean_force(simulation, 2e-6)
    # the arm is R - d/2, and d/R is 1e-3
    assert force[0] / LOAD == pytest.approx(-mu_r, rel=2e-3) and make.velocity(simulation)[0] == pytest.approx(5e-4, rel=1e-3)
    assert make.label(simulation) == "rolling"


@pytest.mark.parametrize("level", LEVELS)
def test_flake_slides_with_mu(make, level):
    mu = 0.2
    simulation = micro(make, [make.clump(make.HEXAGON)], drag(1e-3), level=level, friction=mu)
    simulation.integrator.advance_to(time=simulation.settle)
    assert make.label(simulation) == "sticking"
    simulation.integrator.advance_to(distance=2e-7)
    force = make.mean_force(simulation, 2e-7)
    # both sides have one mu, so either slides; what the patch's dashpot carries as the flake tilts is 1e-6 of the load
    assert -force[0] == pytest.approx(mu * LOAD, rel=1e-5) and force[1] == pytest.approx(0.0, abs=1e-5 * mu * LOAD)
    assert force[2] == pytest.approx(LOAD, rel=1e-5) and make.label(simulation) == "sliding"


def three_spot(level, **settings):
    scene = Scene.load(SCENES / "three_spot.toml")
    return build(scene.with_settings({"contact.level": level, "solver.integrator": "implicit"} | settings))


@pytest.mark.parametrize(("level", "inertia"), [("mindlin", True), ("mindlin", False), slow("mdr", True), slow("exact", True)])
def test_three_spot_particle_slides_as_theory_says(make, level, inertia):
    """Gross sliding: T = mu N at every spot, and N_2/N_1 = (x_3 - x_1 + mu h)/(x_3 - x_2)."""
    simulation = three_spot(level, **{"solver.inertia": inertia})
    simulation.integrator.advance_to(time=simulation.settle)
    simulation.integrator.advance_to(distance=1e-7)
    R = simulation.state.slots.R
    loaded = R[R[:, record.CONTACT_RADIUS] > 0.0]
    normal = dict(zip(np.round(loaded[:, record.POINT] * 1e6), loaded[:, record.NORMAL_FORCE], strict=True))
    ratio = normal[-2.0] / normal[0.0]
    # the tilt of 1e-3 moves each spot of radius 2 um or less, on arms of 2 um: 4e-9 m of 3.5 um
    assert ratio == pytest.approx(theory.lower_force_fraction((0.2e-6, -2e-6, 1.5e-6), 0.3 * 4e-6), rel=2e-3)
    friction = np.linalg.norm(loaded[:, record.TANGENTIAL_FORCE3], axis=1)
    assert friction == pytest.approx(0.3 * loaded[:, record.NORMAL_FORCE], rel=1e-6)
    assert make.plate_force(simulation)[0] / LOAD == pytest.approx(0.3, rel=1e-4 if inertia else 1e-6)


@pytest.mark.parametrize("level", LEVELS[1:])
def test_three_spot_particle_follows_the_static_path(make, level):
    """Friction force over drag, from pressing through partial slip to sliding, against `balance`."""
    scene = Scene.load(SCENES / "three_spot.toml")
    sides = {side: scene.materials[side] for side in ("upper", "lower", "particle")}
    given = {
        "materials": {name: {"shear_modulus": m.shear(), "poisson_ratio": m.poisson_ratio} for name, m in sides.items()},
        "friction": {"upper": 0.3, "lower": 0.3}, "path": {"load": 1e-4, "drag": 2e-8, "steps": 60}, "particle": {"weight": 0.0,
        "spots": [{"side": s.side, "x": s.x, "y": 0.0, "z": s.z, "radius": s.radius} for s in scene.debris[0].spots]},
    }  # fmt: skip
    expected = balance(given, level)
    simulation = three_spot(level, **{"plates.upper.motion.x.velocity": "-1 mm/s"})
    simulation.integrator.advance_to(time=simulation.settle)
    worst = 0.0
    for point in expected.points[1:]:
        simulation.integrator.advance_to(distance=point.drag)
        worst = max(worst, abs(make.plate_force(simulation)[0] / LOAD - sum(point.T[:1]) / LOAD))
    # the static solver has linear kinematics (a tilt of 1e-3), the other presses by a dashpot that leaves T a little different
    assert worst < 3e-3


def slid(make, level, **keys):
    """(lines of the ledger, its relative residual) of a flake that slid by 3 um."""
    simulation = micro(make, [make.clump(make.HEXAGON)], drag(1e-3), level=level, **keys)
    ledger, state = Ledger(simulation.state), simulation.state
    simulation.integrator.advance_to(time=simulation.settle, watch=lambda: ledger.watch(state))
    simulation.integrator.advance_to(distance=3e-6, watch=lambda: ledger.watch(state))
    assert state.P[0, patch.DISPLACEMENT2] == pytest.approx([3e-6, 0.0], rel=1e-9)  # step by step
    lines = ledger.lines(state)
    return lines, ledger.relative_residual(state, lines["residual"])


@pytest.mark.parametrize("level", LEVELS[1:])
def test_ledger_closes_and_nothing_is_lost_where_nothing_tips(make, level):
    lines, residual = slid(make, level)
    assert residual < CLOSED and abs(lines["numerical"]) < 1e-3 * lines["plate_work"]
    # what goes in leaves as friction: mu N times the way, but for the elastic way of the start, 2 s_c = 10 nm
    assert lines["friction"] == pytest.approx(0.3 * LOAD * 3e-6, rel=5e-3)


@pytest.mark.parametrize("level", LEVELS[2:])
def test_friction_takes_what_a_renewed_patch_held_however_long_the_step(make, level):
    """A patch that slides by its radius is new; what the old one held goes to friction, whatever the length of the steps."""
    long, short = (slid(make, level, largest_step=step) for step in (2e-7, 2e-8))
    assert max(long[1], short[1]) < CLOSED
    shares = [lines["numerical"] / lines["plate_work"] for lines, _ in (long, short)]
    assert max(map(abs, shares)) < 1e-3
    # what the settling left is in both; with the energy of the renewed material left out, the long steps lose 1.1e-3 more
    assert shares[0] == pytest.approx(shares[1], abs=1e-6)


def test_a_scheduled_load_is_that_of_the_end_of_the_step(make):
    rise = {"loading": [{"load": 3.0 * LOAD, "duration": 1e-6}]}
    simulation = micro(make, [make.ball(MICRO, (MIDDLE, MIDDLE, MICRO))], drag(1e-3), patch=rise)
    simulation.integrator.advance_to(time=simulation.settle + 5e-7)
    assert simulation.state.P[0, patch.LOAD] == pytest.approx(2.0 * LOAD, rel=1e-9)


def test_neither_repetition_nor_the_order_of_bodies_changes_a_bit(make):
    """Four shapes in two orders: the same bits, where nothing follows from the mean body."""
    shapes = [make.LUMP, make.HEXAGON, make.LUMP[:3], make.HEXAGON[:5]]
    bodies = [make.clump(shape, 3e-5 + 4e-5 * k) for k, shape in enumerate(shapes)]
    keys = {"patch": {"mass": 1e-11, "damping": 1e-4}, "settle": 2e-5}
    runs = [micro(make, order, drag(1e-3), **keys) for order in (bodies, bodies, bodies[::-1])]
    for simulation in runs:
        simulation.integrator.advance_to(time=simulation.settle)
        simulation.integrator.advance_to(distance=1e-6)
    first, again, turned = (simulation.state.B for simulation in runs)
    assert np.array_equal(first, again) and np.array_equal(first, turned[::-1])


EFFECTS = {
    "gravity": {"gravity": (0.0, 4e5, -1e5)},
    "damping": {"named": {"damping": {"rate": "1e7 1/s"}}},
    "rolling_resistance": {"gravity": (2e5, -1e5, 0.0), "named": {"rolling_resistance": {"coefficient": 0.05}}},
}


@pytest.mark.parametrize("name", EFFECTS)
def test_effects_act_as_in_the_explicit_integrator(make, name):
    """Weights of a hundredth of the load and brakes that count at 1 m/s, on a clump that turns as it is dragged."""
    stops, effects = np.arange(1, 5) * 2.5e-7, Effects(**EFFECTS[name])
    explicit = path(micro(make, [make.clump(make.LUMP)], ramp(1.0), "explicit", effects=effects), stops)
    plain = path(micro(make, [make.clump(make.LUMP)], ramp(1.0), tolerance=3e-5), stops)
    ours = path(micro(make, [make.clump(make.LUMP)], ramp(1.0), tolerance=3e-5, effects=effects), stops)
    assert np.abs(plain - explicit).max() > 5e-9, "the effect does nothing"
    # as without effects: 3e-5 of a contact radius of .2 um, in some hundred steps
    assert np.abs(ours - explicit).max() < 2e-9
