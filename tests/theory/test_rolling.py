"""A ball that slides or rolls, down a slope and between two plates; a long particle does so where a rigid ellipse does."""

import math
import shutil

import closed_forms
import numpy as np
import pytest
import three_spot_theory as theory
from pages import ROOT
from shape_map import boundary, closed_form, read_map
from slow import slow
import thirdbody
from thirdbody.assembly.simulation import build
from thirdbody.debris.spheroid import corrugation
from thirdbody.kernels.tables import record
from thirdbody.scene.model import ConstantVelocity, Motion

RADIUS = 1e-3
SLOPE = (5.0, 0.0, -5.0)


def slope_ball(make, friction):
    one = [make.ball(RADIUS, (5.0, 5.0, RADIUS))]
    simulation = build(make.scene(one, {"ball": make.STEEL}, lower="ball", friction=friction, restitution=0.3, gravity=SLOPE))
    simulation.integrator.advance_to(time=5.0005e-3)
    return simulation


@pytest.mark.parametrize("friction", [0.2, slow(0.28)])
def test_ball_slides_down_a_slope(make, friction):
    simulation = slope_ball(make, friction)
    speed, spin = closed_forms.sliding_sphere(friction, 5.0, 5.0, RADIUS, simulation.state.time)
    # it lands with a bounce of some 1e-5 m/s: while that dies out friction is mu N at its mean only, and near 2/7 it sticks for
    # moments
    assert make.velocity(simulation)[0] == pytest.approx(speed, rel=1e-4)
    assert make.spin(simulation)[1] == pytest.approx(spin, rel=2e-4, abs=1e-12)
    assert make.label(simulation) == "sliding"
    contact, weight, g, nu = make.contact(simulation), 5.0 * make.ball_mass(make.STEEL, RADIUS), make.STEEL.shear(), 0.3
    # the bounce has died out: 1e-8 of the weight is left after 5 ms
    assert contact[record.NORMAL_FORCE] == pytest.approx(weight, rel=1e-6)
    assert contact[record.OVERLAP] == pytest.approx(theory.hertz_overlap(theory.e_star(g, nu, g, nu), RADIUS, weight), rel=1e-6)
    assert contact[record.CONTACT_RADIUS] == pytest.approx(math.sqrt(RADIUS * contact[record.OVERLAP]), rel=1e-9)
    assert contact[record.FRICTION_LIMIT] == pytest.approx(friction * weight, rel=1e-6)


@pytest.mark.parametrize("friction", [0.29, slow(1.0)])
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


SPEED, LOAD, FRICTION = 10.0, 1.0, 0.3


@pytest.fixture(scope="module", params=["explicit", "implicit"])
def pinched(make, request):
    """A ball pressed between plates, the upper one suddenly at V: (integrator, labels, columns). Columns: time over the slip
    time, v/V, omega R'/V, |T| over mu N at the lower and upper plate; R' is the distance from centre to contact plane."""
    one, drag = make.ball(RADIUS, (5.0, 5.0, RADIUS)), Motion(x=[ConstantVelocity(velocity=SPEED)])
    keys = {"friction": FRICTION, "restitution": 0.3, "integrator": request.param}
    simulation = make.under_patches([one], {"ball": make.STEEL}, LOAD, drag, **keys)
    slip_time = closed_forms.pinched_sphere_slip_time(make.ball_mass(make.STEEL, RADIUS), FRICTION, LOAD, SPEED)
    simulation.integrator.advance_to(time=simulation.settle)
    start, labels, rows = simulation.state.time, [make.label(simulation)], []
    for part in np.arange(0.05, 2.01, 0.05):
        simulation.integrator.advance_to(time=start + part * slip_time)
        R = simulation.state.slots.R
        arm = RADIUS - 0.5 * R[0, record.OVERLAP]
        forces = np.linalg.norm(R[:, record.TANGENTIAL_FORCE3], axis=1) / (FRICTION * LOAD)
        moved = (simulation.state.time - start) / slip_time
        rows.append((moved, make.velocity(simulation)[0] / SPEED, make.spin(simulation)[1] * arm / SPEED, *forces))
        labels.append(make.label(simulation))
    return request.param, labels, np.array(rows).T


def test_a_pinched_ball_slips_as_long_as_momentum_says_then_rolls_without_force(pinched):
    """mu N above and 3/7 mu N below speed it up evenly, until v = V/2 after 7 m V/(20 mu N)."""
    integrator, _, (time, v, omega, below, above) = pinched
    slipping = (time > (0.1 if integrator == "explicit" else 0.2)) & (time < 0.96)
    # the elastic deflection lags by .1 % of V
    assert v[slipping] == pytest.approx(0.5 * time[slipping], abs=1e-3)
    assert omega[slipping] == pytest.approx(0.5 * time[slipping], abs=1e-3)
    assert above[slipping] == pytest.approx(1.0, rel=1e-6)
    assert below[slipping] == pytest.approx(3.0 / 7.0, rel=1e-3)
    slope, offset = np.polyfit(time[slipping], v[slipping], 1)
    # the straight part meets v = V/2 where slip ends; the lag of the first contact period is some 1e-3 of the slip time
    assert (0.5 - offset) / slope == pytest.approx(1.0, abs=2e-3 if integrator == "explicit" else 1e-3)
    integrator, labels, (time, v, omega, below, above) = pinched
    after, (half, _) = time > 1.3, closed_forms.pinched_sphere_rolling(1.0, 1.0)
    # explicit: the tangential springs ring down within a few of their periods, 1/30 of the slip time each; implicit: dashpots and
    # BDF2 damp them, at steps of about their period
    left = 1e-9 if integrator == "explicit" else 1e-6
    assert v[after] == pytest.approx(half, abs=left)
    assert omega[after] == pytest.approx(half, abs=left)
    assert max(below[after].max(), above[after].max()) < (1e-9 if integrator == "explicit" else 1e-5)
    assert labels[0] == "sticking" and set(np.array(labels[1:])[time > 0.3]) == {"rolling"}


SWEEPS = ROOT / "scenes" / "sweeps"


@pytest.mark.parametrize(
    ("friction", "beside", "state"),
    [(0.7, 0.985, "sliding"), (0.7, 1.015, "rolling"), slow(0.1, 0.985, "sliding"), slow(0.1, 1.015, "rolling")],
)
def test_a_long_particle_slides_below_the_closed_form_and_rolls_above(friction, beside, state, tmp_path):
    # 1.5 %: 40 spheres follow the spheroid to 0.08 % of its size; an indentation of 0.1 % of it rounds the contacts off.
    # Measured at seven frictions, the state changes between 0.995 and 1.005 of the closed form.
    ratio = float(beside * closed_form(np.float64(friction)))
    settings = {"pairs.0.friction": friction, "debris.0.axial_ratio": ratio, "output.every": "10 um"}
    scene = thirdbody.Scene.load(SWEEPS / "long_particle.toml").with_settings(settings)
    with thirdbody.run(scene, out=tmp_path / "run", progress=False) as run:
        assert run.state_names[run.states[-1, 0]] == state
        assert corrugation("prolate", ratio, 40)[0] < 1e-3
        if state == "sliding":
            assert run.series["friction_coefficient"][-1] == pytest.approx(friction, rel=1e-6)


@pytest.mark.full(kind="slow")
def test_the_shipped_sweep_finds_the_closed_form(tmp_path):
    for name in ("long_particle.toml", "shape_against_friction.toml"):
        shutil.copy(SWEEPS / name, tmp_path)
    thirdbody.sweep(tmp_path / "shape_against_friction.toml", out=tmp_path / "sweep", progress=False)
    found = read_map(tmp_path / "sweep")
    assert len(found.friction) == 12 and len(found.ratio) == 53
    # points are 2 % apart, so the boundary between them lies within 1 % of a state's last point; 2 % is the claim of the gallery
    assert boundary(found) == pytest.approx(closed_form(found.friction), rel=0.02)
