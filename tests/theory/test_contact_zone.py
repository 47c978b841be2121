"""Pressure profiles: the macroscopic contact, the loads that bodies carry in it, and what happens at its edge."""

import math

import numpy as np
import pytest
from edge_rig import MICRO, MODULUS, PLACES, SIZE, rig, zone_row
from scipy.integrate import quad
from steel import STEEL
import thirdbody
from thirdbody.assembly.contact_zone import contact_zone, hertz_contact
from thirdbody.engine.guards import Ledger
from thirdbody.kernels import contact_zone as kernel
from thirdbody.kernels.tables import patch, record, run_totals
from thirdbody.scene import model
from thirdbody.scene.pressure import Hertz, Punch, Uniform

integrators = pytest.mark.parametrize("integrator", ["explicit", "implicit"])


@pytest.mark.parametrize("where", [1.001, 1.1, 2.0, 5.0])
def test_the_gap_outside_is_that_of_the_displaced_half_space(where):
    """Ball: Sneddon's displacement of a paraboloid, by quadrature; cylinder: slope of the line load, integrated twice."""
    a, radius = 5e-5, 1e-2
    r, depth = where * a, a * a / radius
    # r^2/2R less the approach, plus the displacement (2/pi) integral of (depth - t^2/R)/sqrt(r^2 - t^2), t = r sin(angle) up to a
    angle, exact = math.asin(a / r), {"epsabs": 0.0, "epsrel": 1e-12}
    lifted = quad(lambda u: depth - (r * math.sin(u)) ** 2 / radius, 0.0, angle, **exact)[0] * 2.0 / math.pi
    expected = r * r / (2.0 * radius) - depth + lifted
    assert kernel.gap.py_func(r, 0.0, zone_row(kernel.BALL, a, radius)) == pytest.approx(expected, rel=1e-6, abs=1e-12 * depth)
    assert kernel.gap.py_func(0.6 * r, 0.8 * r, zone_row(kernel.BALL, a, radius)) == pytest.approx(
        expected, rel=1e-6, abs=1e-12 * depth
    )

    def slope(x):  # x/R less (2/pi E*) integral of p0 sqrt(1 - s^2/a^2)/(x - s), with p0 = E* a/2R
        inner = quad(lambda u: math.sin(u) ** 2 / (x / a - math.cos(u)), 0.0, math.pi, **exact)[0]
        return x / radius - a / (math.pi * radius) * inner

    line = quad(slope, a, r, epsabs=0.0, epsrel=1e-8)[0]
    assert kernel.gap.py_func(-r, 7.0, zone_row(kernel.CYLINDER, a, radius)) == pytest.approx(line, rel=1e-6, abs=1e-12 * depth)


@pytest.mark.parametrize("profile", [
    Hertz(profile="hertz", body="ball", radius=1e-2, load=0.5), Hertz(profile="hertz", body="cylinder", radius=1e-2, load=50.0),
    Punch(profile="punch", width=(2e-4, 1e-4), edge=2e-5, load=0.5),
])  # fmt: skip
def test_the_pressure_carries_the_load(make, profile):
    upper = model.UpperPlate(material="ball", support="load_per_particle", pressure=profile)
    plates = model.Plates(lower=model.LowerPlate(material="ball"), upper=upper)
    scene = make.scene([make.ball(MICRO, (2e-4, 2e-4, MICRO))], {"ball": make.STEEL}, plates=plates, size=SIZE,
                       domain=model.Domain(size=(SIZE, SIZE), periodic=False))  # fmt: skip
    contact = contact_zone(scene, profile, MODULUS, np.full((1, 2), 0.5 * SIZE))[0]
    row = contact.row
    n = 1000
    x = (np.arange(n) + 0.5) / n * SIZE - 0.5 * SIZE
    cells = sum(kernel.pressure.py_func(a, b, row) for a in x[::2] for b in x[::2]) * (2.0 * SIZE / n) ** 2
    # cells of a hundredth of the half width: square roots at the edge leave 1e-3
    assert contact.peak * cells == pytest.approx(profile.load, rel=2e-3)


@integrators
def test_a_body_at_rest_carries_the_pressure_of_its_place(make, integrator):
    profile = Hertz(profile="hertz", body="ball", radius=1.0, load=1e-2)
    simulation = rig(make, PLACES, profile, integrator=integrator, settle=2e-6)
    a = hertz_contact(profile, profile.load, SIZE, MODULUS)[0]
    square = np.sum(PLACES**2, axis=1) / a**2
    shape = np.sqrt(np.maximum(1.0 - square, 0.0))
    assert 0 < np.count_nonzero(shape) < len(shape)
    expected = 1e-2 * shape / shape.sum()
    state = simulation.state
    assert state.P[:, patch.LOAD].sum() == pytest.approx(1e-2, rel=1e-14)
    assert state.P[:, patch.LOAD] == pytest.approx(expected, rel=1e-9)
    simulation.integrator.advance_to(time=2e-5)
    force = np.zeros(len(PLACES))
    R, slots = state.slots.R, state.slots
    upper = slots.histories.slip > 0.0
    for k in np.flatnonzero(upper):
        if R[k, record.NORMAL + 2] < 0.0:
            force[state.order[state.body[slots.own[k]]]] += R[k, record.NORMAL_FORCE]
    assert force == pytest.approx(expected, rel=1e-6, abs=1e-15)


@integrators
def test_a_uniform_pressure_is_a_load_per_particle(make, integrator):
    motion = model.Motion(x=[model.ConstantVelocity(velocity=0.5)])
    uniform = rig(make, PLACES, Uniform(profile="uniform", load=5e-4), motion, integrator=integrator, settle=1e-6)
    keys = {"integrator": integrator, "settle": 1e-6, "friction": 0.3, "restitution": 0.5, "size": SIZE, "periodic": False}
    debris = [make.ball(MICRO, (0.5 * SIZE + x, 0.5 * SIZE + y, MICRO)) for x, y in PLACES]
    single = make.under_patches(debris, {"ball": make.STEEL}, 1e-4, motion, **keys)
    for simulation in (uniform, single):
        simulation.integrator.advance_to(time=3e-6)
    a, b = (s.state.A[run_totals.UPPER_FORCE3] for s in (uniform, single))
    assert np.max(np.abs(a - b)) < 1e-14 * 5e-4
    assert uniform.state.bodies.position == pytest.approx(single.state.bodies.position, rel=1e-14)


@integrators
def test_debris_may_carry_a_part_of_the_load(make, integrator):
    profile = Hertz(profile="hertz", body="ball", radius=1.0, load=1e-2, debris_fraction=0.25)
    simulation = rig(make, PLACES, profile, integrator=integrator, settle=2e-6)
    assert simulation.state.P[:, patch.LOAD].sum() == pytest.approx(0.25e-2, rel=1e-14)
    simulation.integrator.advance_to(time=1e-6)
    assert simulation.state.A[run_totals.DIRECT_FORCE + 2] == pytest.approx(0.75e-2, rel=1e-14)


@integrators
def test_a_shifted_rig_does_the_same(make, integrator):
    motion, paths = model.Motion(x=[model.ConstantVelocity(velocity=1.0)]), []
    profile = Hertz(profile="hertz", body="ball", radius=1.0, load=2e-3)
    for shift in (0.0, 1.3e-4):
        simulation = rig(make, PLACES, profile, motion, integrator=integrator, settle=1e-6, shift=shift)
        simulation.integrator.advance_to(time=6e-6)
        paths.append(simulation.state.bodies.position[:, :2] - shift)
    # rounding of places: 1e-16 of the domain, grown by contacts that close
    assert paths[0] == pytest.approx(paths[1], abs=1e-12)


@integrators
def test_the_friction_of_a_rig_is_that_of_debris_and_plates(make, integrator):
    """Rolling balls: no friction of debris; one body leaves, and the plates carry its load with their friction."""
    motion = model.Motion(x=[model.Ramp(ramp=20.0, duration=1e-6), model.ConstantVelocity(velocity=20.0)])
    profile = Punch(profile="punch", width=(6e-5, SIZE), edge=4e-6, load=4e-4)
    simulation = rig(
        make, [(-2.8e-5, 0.0), (0.0, 2e-5), (1e-5, -2e-5), (2e-5, 0.0)], profile, motion, integrator=integrator, settle=1e-6
    )
    state, ledger = simulation.state, Ledger(simulation.state)
    starts = state.bodies.position[:, 0].copy()
    for time in np.arange(1, 6) * 5e-7:
        simulation.integrator.advance_to(time=float(time), watch=lambda: ledger.watch(state))
        ledger.watch(state)
        loads, direct = state.P[:, patch.LOAD] @ state.P[:, patch.INSIDE], state.A[run_totals.DIRECT_FORCE3]
        assert loads + direct[2] == pytest.approx(4e-4, rel=1e-12)
        if state.A[run_totals.PLATE_SPEED] > 0.0:
            assert direct[0] == pytest.approx(-0.1 * direct[2], rel=1e-9, abs=1e-15)
    simulation.integrator.advance_to(time=5e-6)
    ledger.watch(state)
    assert np.count_nonzero(state.P[:, patch.INSIDE]) < 4 and state.A[run_totals.DIRECT_WORK] > 0.0
    lines = ledger.lines(state)
    assert ledger.relative_residual(state, lines["residual"]) < 2e-3
    assert np.all(state.bodies.position[:, 0] >= starts)


def test_a_rolling_ball_comes_back(make):
    """At x0 + X/2 it carries the pressure of x0 - X/2, and is back at x0 after each cycle."""
    stroke, load = 2e-5, 2e-4
    motion = model.Motion(x=[model.Stroke(stroke=stroke, frequency=2e3)])
    profile = Hertz(profile="hertz", body="cylinder", radius=1e3, load=load)
    places = [(-1e-5, 0.0), (3e-5, 0.0), (0.0, 1e-5)]
    simulation = rig(make, places, profile, motion, integrator="implicit", settle=1e-5, tolerance=1e-5)
    state, x0 = simulation.state, 0.5 * SIZE + np.array(places)[:, 0]
    simulation.integrator.advance_to(time=1e-5)
    a = hertz_contact(profile, profile.load, SIZE, MODULUS)[0]
    nominal = state.P[:, patch.NOMINAL_LOAD]
    for part in (0.25, 0.5, 1.0):
        simulation.integrator.advance_to(time=1e-5 + part / 2e3)
        moved = 0.5 * stroke * (1.0 - math.cos(2.0 * math.pi * part))
        x = state.bodies.position[:, 0]
        # creep of a rolling contact and its start: a few contact radii of 30 nm
        assert x == pytest.approx(x0 + 0.5 * moved, abs=2e-7)
        place = (x - 0.5 * SIZE - moved) / a
        assert state.P[:, patch.LOAD] == pytest.approx(nominal * np.sqrt(np.maximum(1.0 - place**2, 0.0)), rel=1e-4)
    assert np.all(state.P[:, patch.INSIDE] == 1.0)


@integrators
def test_what_the_upper_body_leaves_behind_is_out(make, integrator):
    """Free of friction, bodies stay where they are. The contact, 60 um wide, goes on by 100 um: all are outside after 88 um, and
    out after 5 um more, but for the last one; the plates carry the load."""
    motion = model.Motion(x=[model.ConstantVelocity(velocity=20.0)])
    profile = Punch(profile="punch", width=(6e-5, SIZE), edge=4e-6, load=4e-4, out_after=5e-6)
    positions = [(-2.8e-5, 0.0), (0.0, 2e-5), (1e-5, -2e-5), (2.8e-5, 0.0)]
    simulation = rig(make, positions, profile, motion, friction=0.0, integrator=integrator, settle=1e-6)
    assert simulation.labeller.states[-1] == "out" and simulation.labeller.reasons[-1] == "left_contact"
    for way, inside, out in ((1e-5, 3, 1), (6.1e-5, 0, 3), (7e-5, 0, 4)):
        simulation.integrator.advance_to(time=1e-6 + way / 20.0)
        labels = simulation.integrator.label()[:, 0]
        assert np.count_nonzero(simulation.state.P[:, patch.INSIDE]) == inside
        assert np.count_nonzero(labels == len(simulation.labeller.states) - 1) == out
    assert simulation.state.A[run_totals.DIRECT_FORCE + 2] == pytest.approx(4e-4, rel=1e-14)


@integrators
def test_a_body_that_leaves_an_open_domain_is_out(make, integrator):
    """Thrown over the end, 4 um away, at 20 m/s; the plates carry all that it does not, here its load of the start."""
    profile = Punch(profile="punch", width=(6e-5, SIZE), edge=4e-6, load=4e-4)
    debris = [
        make.ball(MICRO, (SIZE - 4e-6, 2e-4, 1.01 * MICRO), velocity=(20.0, 0.0, 0.0)),
        make.ball(MICRO, (2e-4, 2e-4, MICRO)),
    ]
    upper = model.UpperPlate(material="ball", support="load_per_particle", pressure=profile)
    simulation = make.build(make.scene(
        debris, {"ball": make.STEEL}, plates=model.Plates(lower=model.LowerPlate(material="ball"), upper=upper),
        contact=model.Contact(debris_contact="none"), solver=model.Solver(duration=1.0, settle=1e-7, integrator=integrator),
        domain=model.Domain(size=(SIZE, SIZE), periodic=False, ends="open"),
    ))  # fmt: skip
    first, out = int(np.argmax(simulation.state.bodies.position[:, 0])), len(simulation.labeller.states) - 1
    for time, left in ((1.5e-7, False), (4e-7, True), (1e-6, True)):
        simulation.integrator.advance_to(time=time)
        assert (simulation.integrator.label()[first, 0] == out) == left
        assert simulation.state.A[run_totals.DIRECT_FORCE + 2] == pytest.approx(0.0, abs=1e-18)


PUNCH_SCENE = f"""{STEEL}[domain]
size = ["120 um", "40 um"]
periodic = false
ends = "open"
[[debris]]
material = "steel"
kind = "irregular"
count = 60
spheres = [4, 8]
aspect = [1.0, 0.8, 0.6]
size = {{distribution = "lognormal", median = "2 um", sigma = 0.1, min = "1.5 um", max = "3 um"}}
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
pressure = {{profile = "punch", width = ["60 um", "40 um"], edge = "4 um", load = "2 mN", out_after = "10 um"}}
motion = {{x = {{stroke = "20 um", frequency = "5 kHz"}}}}
[plates.contact]
friction = 0.1
[contact]
debris_contact = "none"
[solver]
duration = "100 us"
[output]
every = "5 us"
"""


@pytest.mark.full(kind="slow")
def test_both_integrators_agree_on_a_rig(tmp_path):
    """Half a cycle of a rig in which inertia is small, 60 clumps. Labels of both differ where bodies tip, as between the plates
    (`tests/scenes/test_both_integrators.py`)."""
    runs = []
    for integrator in ("implicit", "explicit"):
        scene = model.Scene.parse(PUNCH_SCENE).with_settings({"solver.integrator": integrator})
        runs.append(thirdbody.run(scene, out=tmp_path / integrator))
    one, other = runs
    assert np.mean(one.states == other.states) > 0.95
    ejected = [run.series["ejected"][-1] for run in runs]
    assert ejected[0] > 5 and abs(ejected[0] - ejected[1]) <= 0.03 * 60
    friction = [np.mean(run.series["friction_coefficient"][2:]) for run in runs]
    assert friction[0] == pytest.approx(friction[1], rel=0.01)
    assert max(run.summary()["energy_residual"] for run in runs) < 1e-3


def test_a_rig_of_bodies_that_may_meet(tmp_path):
    """Debris and plates carry the load together; dashpots and inertia of the patches take up to 1 % of it at 1 m/s."""
    friction = []
    for integrator in ("explicit", "implicit"):
        keys = {
            "solver.integrator": integrator,
            "solver.duration": "10 us",
            "contact.debris_contact": "auto",
            "debris.0.count": 90,
        }
        run = thirdbody.run(model.Scene.parse(PUNCH_SCENE).with_settings(keys), out=tmp_path / integrator)
        loads = (run.series["direct_force"] + run.series["upper_force"])[1:, 2]
        assert loads == pytest.approx(2e-3, rel=1e-2) and run.summary()["energy_residual"] < 1e-4
        friction.append(run.summary()["friction_coefficient"])
    assert friction[0] == pytest.approx(friction[1], rel=0.01)


@integrators
@pytest.mark.parametrize("wide", [0.9, 1.5])
def test_a_worn_ball_presses_on_its_scar(make, integrator, wide):
    """V = pi a_w^4/(4 R): once the scar is wider than Hertz' contact every body in it carries P/(pi a_w^2) times the share of the
    domain that it had at the start, at most P in all; the others sink as the gap does."""
    profile, load = Hertz(profile="hertz", body="ball", radius=1.0, load=1e-2), 1e-2
    places = np.random.default_rng(2).uniform(-8e-5, 8e-5, (40, 2))
    upper = {"material": "ball", "support": "load_per_particle", "pressure": profile, "motion": {"x": {"velocity": 1e-3}}}
    tables = {
        "plates": {"lower": {"material": "ball"}, "upper": upper, "contact": {"friction": 0.1}, "wear": {"distance": 1.0}},
        "measures": {"cell": 1e-5, "wear": {"plates": "1e-30 m3/J"}},
        "contact": {"level": "mindlin", "debris_contact": "none"},
        "solver": {"duration": 1.0, "integrator": integrator, "settle": 2e-6},
        "domain": {"size": (SIZE, SIZE)},
    }
    debris = [make.ball(MICRO, (0.5 * SIZE + x, 0.5 * SIZE + y, MICRO)) for x, y in places]
    simulation = make.build(make.scene(debris, {"ball": make.STEEL}, friction=0.3, restitution=0.5, **tables))
    state, wear = simulation.state, simulation.state.wear
    simulation.integrator.advance_to(time=2e-6)
    P, a = state.P[state.patch], hertz_contact(profile, load, SIZE, MODULUS)[0]
    scar, distance = wide * a, np.hypot(*places[state.order].T)
    nominal, gaps, before = P[0, patch.NOMINAL_LOAD], state.world.zone.gaps, P[:, patch.LOAD].copy()
    state.maps[wear.map, 1] += math.pi * scar**4 / 4.0 / state.maps[wear.map, 1].size
    wear.take(simulation.integrator)
    now = state.P[state.patch]
    if wide < 1.0:
        assert now[:, patch.LOAD] == pytest.approx(before, abs=1e-9 * load)  # outside they move against a dashpot
        return
    inside = distance < scar
    assert np.count_nonzero(distance < a) < np.count_nonzero(inside) < len(places)
    # p0 = 3 P/(2 pi a^2) times the share is the nominal load
    expected = np.where(inside, nominal * load / (math.pi * scar**2) / (1.5 * load / (math.pi * a * a)), 0.0)
    expected *= min(1.0, load / expected.sum())
    assert now[:, patch.LOAD] == pytest.approx(expected, rel=1e-9, abs=1e-9 * load)
    sunk = gaps - np.maximum(distance**2 - scar**2, 0.0) / 2.0
    assert (P[:, patch.HEIGHT] - now[:, patch.HEIGHT])[~inside] == pytest.approx(sunk[~inside], rel=1e-6)
    simulation.integrator.advance_to(time=2e-5)
    assert state.A[run_totals.UPPER_FORCE + 2] == pytest.approx(expected.sum(), rel=1e-3)
