"""Hard cases that the explicit engine meets with the levels `coulomb` and `mindlin`."""

from __future__ import annotations

import math
from pathlib import Path

import closed_forms
import numpy as np
import pytest
from thirdbody_three_spot import theory

from thirdbody.assembly.simulation import build
from thirdbody.errors import GuardStop, InputError
from thirdbody.kernels.columns import contact_state, record, run_totals
from thirdbody.runner.simulate import run
from thirdbody.scene.model import ConstantVelocity, Contact, Domain, Motion, Scene, UpperPlate
from thirdbody.trajectory.reader import open_run

SCENES = Path(__file__).parents[2] / "scenes"
RADIUS = 1e-3


def pair_impact(make, materials, radii, speed, count=200):
    """Head-on impact of two balls, undamped, at `count` steps per contact time.

    Returns (simulation, reduced mass, reduced radius, E*, impact).
    """
    names = list(materials)
    a, b = materials[names[0]], materials[names[-1]]
    masses = [make.ball_mass(m, r) for m, r in zip((a, b), radii, strict=True)]
    mass, radius = masses[0] * masses[1] / sum(masses), radii[0] * radii[1] / sum(radii)
    e = theory.e_star(a.shear(), a.poisson_ratio, b.shear(), b.poisson_ratio)
    step = closed_forms.impact_duration(mass, radius, e, speed) / count
    gap = 1e-15 * max(radii)
    bodies = [
        make.ball(radii[0], (-radii[0] - gap, 0.0, 0.0), (speed, 0.0, 0.0), material=names[0]),
        make.ball(radii[1], (radii[1] + gap, 0.0, 0.0), material=names[-1]),
    ]
    simulation = build(make.scene(bodies, materials, friction=0.3, time_step=step), force=True)
    S = simulation.state.S

    def opening():
        apart = S[1, 0] - S[0, 0] - sum(radii)
        return apart, make.velocity(simulation, 1)[0] - make.velocity(simulation, 0)[0]

    return simulation, mass, radius, e, make.impact(simulation, opening)


@pytest.mark.parametrize("heavy_first", [False, True])
def test_mass_ratio_of_a_million(make, heavy_first):
    """Size ratio 10, mass ratio 1e6: the light ball bounces as off a wall, momentum holds to rounding."""
    light = make.STEEL
    heavy = make.solid(210e9, 0.3, 7850.0 * 1e3)
    materials = {"heavy": heavy, "light": light} if heavy_first else {"light": light, "heavy": heavy}
    radii = (10.0 * RADIUS, RADIUS) if heavy_first else (RADIUS, 10.0 * RADIUS)
    simulation, mass, radius, e, found = pair_impact(make, materials, radii, 1.0)
    assert simulation.state.bodies.mass.max() / simulation.state.bodies.mass.min() == pytest.approx(1e6, rel=1e-9)
    # second order at 200 steps: 5e-5 of overlap and time (test_impacts)
    assert found.overlap.max() == pytest.approx(closed_forms.impact_overlap(mass, radius, e, 1.0), rel=1e-4)
    assert found.end == pytest.approx(closed_forms.impact_duration(mass, radius, e, 1.0), rel=1e-4)
    masses = simulation.state.bodies.mass
    before = masses[0] * 1.0
    p, _ = make.momenta(simulation)
    # 200 steps with half a unit in the last place of the larger momentum each
    assert p[0] == pytest.approx(before, rel=1e-13)
    expected = (masses[0] - masses[1]) / masses.sum(), 2.0 * masses[0] / masses.sum()
    for number in (0, 1):
        # the relative speed is exact to 1e-6 (test_impacts)
        assert abs(make.velocity(simulation, number)[0] - expected[number]) < 2e-6 * max(abs(expected[0]), abs(expected[1]))
    assert np.all(make.spin(simulation) == 0.0)


@pytest.mark.parametrize("nu", [0.0, 0.49, 0.499999, 0.5, -0.5])
def test_limits_of_poisson_ratio(make, nu):
    material = make.solid(1e9, nu, 1000.0)
    *_, mass, radius, e, found = pair_impact(make, {"ball": material}, (RADIUS, RADIUS), 1.0)
    assert found.overlap.max() == pytest.approx(closed_forms.impact_overlap(mass, radius, e, 1.0), rel=1e-4)
    assert found.normal.max() == pytest.approx(closed_forms.impact_force(mass, radius, e, 1.0), rel=1e-4)


def test_oblique_impact_is_smooth_up_to_incompressible(make):
    """Rebound of a ball that sticks and slips, as nu goes to 1/2: no jump, no gap."""
    found = []
    for nu in (0.49, 0.4999, 0.499999, 0.5):
        material = make.solid(1e9, nu, 1000.0)
        simulation = make.ball_on_plane(material, RADIUS, (0.8, 0.0, -1.0), friction=0.5, time_step=2e-7)
        make.leave(simulation, 2e-5)
        found.append([*make.velocity(simulation), RADIUS * make.spin(simulation)[1]])
    change = np.abs(np.array(found) - found[-1]).max(axis=1)
    assert np.all(np.isfinite(found))
    # everything is proportional to .5 - nu, with a factor of order one
    assert np.all(change[:-1] < 3.0 * (0.5 - np.array([0.49, 0.4999, 0.499999])) + 1e-9)


def test_soft_on_stiff(make):
    soft, stiff = make.solid(210e6, 0.45, 1000.0), make.solid(210e9, 0.3, 7850.0)
    *_, mass, radius, e, found = pair_impact(make, {"soft": soft, "stiff": stiff}, (RADIUS, RADIUS), 1.0)
    assert found.overlap.max() == pytest.approx(closed_forms.impact_overlap(mass, radius, e, 1.0), rel=1e-4)
    assert found.end == pytest.approx(closed_forms.impact_duration(mass, radius, e, 1.0), rel=1e-4)


def test_without_friction_a_dragged_ball_stays_where_it_is(make):
    upper = UpperPlate(material="ball", load=1.0, motion=Motion(x=[ConstantVelocity(velocity=1.0)]))
    one = [make.ball(RADIUS, (5.0, 5.0, RADIUS), spin=(3.0, 4.0, 5.0))]
    simulation = build(make.scene(one, {"ball": make.STEEL}, lower="ball", upper=upper, friction=0.0, restitution=0.5))
    simulation.integrator.advance_to(time=simulation.settle + 1e-3)
    assert np.all(simulation.state.slots.records.tangential_force == 0.0)
    assert np.all(make.velocity(simulation)[:2] == 0.0)
    # from the angular momentum and back: two roundings
    assert make.spin(simulation) == pytest.approx([3.0, 4.0, 5.0], rel=1e-15)
    assert make.label(simulation) == "sliding"


# 5e-8 s: 100 steps or more per contact; "auto": 16 to 25 at these speeds.
@pytest.mark.parametrize("step, truncation", [(5e-8, 1e-5), ("auto", 2e-3)])
@pytest.mark.parametrize("degrees", [20, 36, 60, 76])
@pytest.mark.parametrize("friction", [0.1, 1.0, 1e3, 1e9])
@pytest.mark.parametrize("level", ["coulomb", "mindlin", "mdr", "exact"])
def test_no_level_makes_energy(make, level, friction, degrees, step, truncation):
    angle, law = math.radians(degrees), Contact(law="three_spot", level=level)
    start = (math.sin(angle), 0.0, -math.cos(angle))
    material = make.solid(210e9, 0.1, 7850.0)
    simulation = make.ball_on_plane(material, RADIUS, start, friction=friction, time_step=step, contact=law)
    energy = make.kinetic(simulation)
    make.leave(simulation, 1e-5)
    # truncation, which has either sign; the displacement form gives 1e-2 and more
    assert make.kinetic(simulation) / energy <= 1.0 + truncation


def test_a_contact_that_opened_remembers_nothing(make):
    simulation = make.ball_on_plane(make.STEEL, RADIUS, (1.0, 0.5, -1.0), friction=1e3, time_step=5e-8)
    make.advance(simulation, 50)
    assert np.abs(simulation.state.slots.H[0, contact_state.LAW : contact_state.LAW + 3]).max() > 0.0
    make.leave(simulation, 1e-5)
    # but for the work and way of which the body is told at the next search
    assert np.all(simulation.state.slots.H == 0.0)
    # what the spring still held is booked as dissipated, not lost
    assert simulation.state.A[run_totals.FRICTION_WORK] > 0.0


PERIOD = 0.1


def crossing(make, corner):
    """Force and torque history of two balls that graze each other while both drift in x and y, starting about `corner`."""
    normal = np.array([0.8, 0.5, math.sqrt(1.0 - 0.89)])
    drift, gap = np.array([30.0, 20.0, 0.0]), RADIUS * (1.0 + 1e-9)
    bodies = []
    for sign in (-1.0, 1.0):
        where = np.array([*corner, 0.05]) + sign * gap * normal
        where[:2] %= PERIOD
        push = drift - sign * 0.5 * normal + sign * np.array([0.0, 0.0, 0.4])
        bodies.append(make.ball(RADIUS, where, push, (100.0, 200.0, -50.0)))
    domain = Domain(size=(PERIOD, PERIOD), periodic=True)
    tables = make.scene(bodies, {"ball": make.STEEL}, friction=0.3, restitution=0.8, time_step=5e-8, domain=domain)
    simulation = build(tables)
    rows = []
    for _ in range(300):
        make.advance(simulation)
        contact = make.contact(simulation)
        rows.append(
            np.concatenate([[contact[record.NORMAL_FORCE]], contact[record.TANGENTIAL_FORCE3], simulation.state.bodies.torque[0]])
        )
    return np.array(rows)


@pytest.mark.parametrize("corner", [(0.0, 0.05), (0.05, 0.0), (0.0, 0.0), (PERIOD - 2e-4, PERIOD - 1e-4)])
def test_crossing_a_periodic_face_changes_nothing(make, corner):
    inside, across = crossing(make, (0.05, 0.05)), crossing(make, corner)
    assert inside[:, 0].max() > 0.0 and inside[-1, 0] == 0.0
    # rounding of the coordinates, 1e-17 m, against the largest overlap of some 5 um: 1e-11 of the largest force
    for column in range(inside.shape[1]):
        assert np.abs(across[:, column] - inside[:, column]).max() < 1e-10 * np.abs(inside[:, column]).max()


FLAKES = {"debris.0.count": "4", "domain.size": ["50 um", "40 um"], "solver.distance": "1 um", "solver.settle": "1 us"}


def test_time_step_that_is_too_large_is_refused(tmp_path):
    scene = Scene.load(SCENES / "sliding_flakes.toml").with_settings(FLAKES)
    step = 100.0 * build(scene).state.dt
    with pytest.raises(InputError, match="above the bound"):
        run(scene.with_settings({"solver.time_step": f"{step} s"}), tmp_path / "out", progress=False)


def test_forced_time_step_is_stopped_and_what_was_computed_is_kept(tmp_path):
    scene = Scene.load(SCENES / "sliding_flakes.toml").with_settings(FLAKES)
    step = 100.0 * build(scene).state.dt
    forced = scene.with_settings({"solver.time_step": f"{step} s", "output.every": "10 ns"})
    with pytest.raises(GuardStop, match="stopped at t = .*step"):
        run(forced, tmp_path / "out", progress=False, force=True)
    kept = open_run(tmp_path / "out")
    assert len(kept.times) >= 1
    assert np.all(np.isfinite(kept.bodies(len(kept.times) - 1)["position"]))
    assert kept.summary()["finished"] is False
    assert "stopped at" in kept.summary()["stopped"]


def test_overlapping_start_is_refused(make):
    bodies = [make.ball(RADIUS, (sign * 0.99 * RADIUS, 0.0, 0.0)) for sign in (-1.0, 1.0)]
    with pytest.raises(InputError, match="overlap"):
        build(make.scene(bodies, {"ball": make.STEEL}))


def test_head_on_impact_of_a_perfectly_symmetric_pair(make):
    """0/0 in every tangential direction: no slip, no friction, no spin, nothing that is not a number."""
    simulation = make.two_balls(make.STEEL, RADIUS, (1.0, 0.0, 0.0), friction=1e9, time_step=5e-8)
    make.leave(simulation, 1e-5)
    assert np.all(make.velocity(simulation)[1:] == 0.0) and np.all(make.spin(simulation) == 0.0)
    assert make.velocity(simulation)[0] == -make.velocity(simulation, 1)[0]


FLAKE = """
scene = 1
[materials.steel]
youngs_modulus = "210 GPa"
poisson_ratio = 0.3
density = "7850 kg/m3"
[[pairs]]
between = ["steel", "steel"]
friction = 0.2
restitution = {restitution}
[[debris]]
material = "steel"
kind = "spheres"
shape = [{shape}]
positions = [["20 um", "20 um", "2 um"]]
[domain]
size = ["40 um", "40 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.2 mN"
motion = {{x = {{velocity = "0.1 m/s"}}}}
[solver]
distance = "50 nm"
[output]
every = "5 nm"
"""


@pytest.mark.parametrize("restitution", [0.6, 0.1])
def test_dashpots_of_many_spots_add_up(tmp_path, restitution):
    """Fourteen spots, each with the dashpot that its own restitution asks for: the body creeps, and the step must know."""
    corners = [(0.0, 0.0)] + [(3.0 * math.cos(k * math.pi / 3.0), 3.0 * math.sin(k * math.pi / 3.0)) for k in range(6)]
    shape = ", ".join(f'{{center = ["{x} um", "{y} um", "0 um"], radius = "2 um"}}' for x, y in corners)
    scene = Scene.parse(FLAKE.format(restitution=restitution, shape=shape))
    with run(scene, out=tmp_path / "run", progress=False) as done:
        # with the frequency alone as bound the residual was 450 and the friction coefficient .06
        assert done.summary()["energy_residual"] < 1e-2
        assert done.series["friction_coefficient"][-1] == pytest.approx(0.2, rel=1e-3)
        # what the dashpots lose is less than what goes in
        assert done.series["energy_damping"][-1] < done.series["energy_plate_work"][-1]
