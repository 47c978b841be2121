"""Beds: measures and velocity accommodation against closed forms, a column at rest, the verdict on slow shear, short runs."""

import json
import math
from pathlib import Path
from types import SimpleNamespace

import ensembles
import h5py
import numpy as np
import pytest
from balls import BALLS, edited
from each import each
from layer import write_layer
from steel import scene_text
import thirdbody
from thirdbody.assembly.simulation import build
from thirdbody.bodies.clump import clump
from thirdbody.engine.candidates import AllRows
from thirdbody.engine.placed import Placed
from thirdbody.engine.state import World, assemble
from thirdbody.engine.upper_plate import Schedule, Segment
from thirdbody.granular_flow import friction_increase, inertia_verdict, median_by_mass
from thirdbody.kernels import schedule as motion
from thirdbody.kernels.plates import BASINS
from thirdbody.kernels.tables import DEBRIS, LOWER, UPPER, body, body_extra, contact_state, record
from thirdbody.plot.summary_page import page
from thirdbody.report.tables import run_report
from thirdbody.runner.run_folder import RunFolder
from thirdbody.runner.run_loop import RunLoop
from thirdbody.trajectory import bed as beds
from thirdbody.trajectory.accommodation import accommodation, parts_of, transmitting_weights
from thirdbody.trajectory.bed_measures import BedMeasures, unbalanced_force
from thirdbody.trajectory.drag import Drag
from thirdbody.trajectory.names import ACCOMMODATION, BED

R, DENSITY, MODULUS, PRESSURE = 5e-6, 7850.0, 1e11, 1e6
LOAD, SIDE, FRAMES = 1e-4, 40e-6, 41
LAWLESS = SimpleNamespace(history=(), memory=0, contact_memory=0, moments=False, rolling=0, loss="", measures=None,
                          has_effects=False)  # fmt: skip


def state_of(shapes, positions, size):
    n = len(shapes)
    still, upright = np.zeros((n, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    none = np.zeros(n, np.int64)
    placed = Placed(shapes, np.full(n, DENSITY), none, none, np.array(positions), upright, still, still)
    return assemble(placed, World(size, True, False, 0, None, True), LAWLESS, 1e-7)


def crystal(layers: int, side: int = 4, radius: float = R):
    """A simple cubic packing of touching balls that fills its domain from z = 0; its height."""
    ball = clump([[0.0, 0.0, 0.0]], [radius])
    steps = np.stack(np.meshgrid(*[np.arange(k) for k in (side, side, layers)], indexing="ij"), -1).reshape(-1, 3)
    return state_of([ball] * len(steps), (2.0 * steps + 1.0) * radius, (2.0 * side * radius,) * 2), 2.0 * layers * radius


def measured(state, gap, velocities=None, elastic=0.0):
    velocities = state.bodies.velocity if velocities is None else velocities
    return BedMeasures(state, MODULUS).series(PRESSURE, velocities, gap, elastic)


def test_the_solid_fraction_of_a_crystal_and_of_clumps():
    for layers in (4, 5, 9):  # one layer is left out at each plate
        series = measured(*crystal(layers))
        assert tuple(series) == BED and series["solid_fraction"] == pytest.approx(math.pi / 6.0, rel=1e-12)
    series = measured(*crystal(2))  # a layer is no bed
    assert all(math.isnan(series[name]) for name in ("inertial_number", "inertial_number_largest", "solid_fraction"))
    state, gap = crystal(9)
    state.S[:, 2] += 0.7 * R
    # the slab cuts balls at both ends at the same height of the crystal: what one end loses the other gains
    assert measured(state, gap)["solid_fraction"] == pytest.approx(math.pi / 6.0, rel=1e-12)
    pair = clump([[-0.5 * R, 0.0, 0.0], [0.5 * R, 0.0, 0.0]], [R, R])
    lens = math.pi * (4.0 * R + R) * (2.0 * R - R) ** 2 / 12.0  # of two equal balls at the distance R
    volume = 8.0 / 3.0 * math.pi * R**3 - lens
    state = state_of([pair] * 10, [[2.0 * R, 2.0 * R, (1.0 + 2.0 * k) * R] for k in range(10)], (4.0 * R, 4.0 * R))
    d = 2.0 * np.cbrt(0.75 * volume / math.pi)
    assert BedMeasures(state, MODULUS).median == pytest.approx(d, rel=1e-9)
    # a largest diameter is left out at each plate: six whole clumps, and of two what the cut leaves of their balls
    cut = 4.0 * R - d
    inside = 6.0 + 2.0 * (cut**2 * (3.0 * R - cut)) / (4.0 * R**3)
    expected = inside * volume / ((4.0 * R) ** 2 * (20.0 * R - 2.0 * d))
    assert measured(state, 20.0 * R)["solid_fraction"] == pytest.approx(expected, rel=1e-9)


def test_plane_shear_has_its_inertial_number_and_no_energy_of_fluctuation():
    small, large = clump([[0.0, 0.0, 0.0]], [R]), clump([[0.0, 0.0, 0.0]], [1.2 * R])
    z = np.linspace(R, 39.0 * R, 60)
    positions = np.column_stack([np.zeros(60), np.zeros(60), z])
    state = state_of([small] * 50 + [large] * 10, positions, (40.0 * R, 40.0 * R))
    rate = 1e4
    series = measured(state, 40.0 * R, np.column_stack([np.zeros(60), -rate * z, np.zeros(60)]))
    expected = rate * 2.0 * R * math.sqrt(DENSITY / PRESSURE)
    assert series["inertial_number"] == pytest.approx(expected, rel=1e-9)
    assert series["inertial_number_largest"] == pytest.approx(1.2 * expected, rel=1e-9)
    assert series["softness"] == pytest.approx((MODULUS / PRESSURE) ** (2.0 / 3.0), rel=1e-14)
    diameters = np.array([1.0] * 100 + [3.0] * 10)
    assert median_by_mass(diameters, diameters**3) == 3.0  # 270 of 370
    assert median_by_mass(diameters, np.ones(110)) == 1.0
    state, gap = crystal(6)
    state.B[:, body.VELOCITY3] = np.outer(1e4 * state.bodies.position[:, 2], [0.6, 0.8, 0.0]) + [3.0, 0.0, 0.1]
    kinetic = 0.5 * float(state.bodies.mass @ np.sum(state.bodies.velocity**2, axis=1))
    assert measured(state, gap, elastic=kinetic)["kinetic_energy_ratio"] < 1e-20  # rounding of velocities, squared
    up = np.resize([0.2, -0.2], state.n_bodies)
    state.B[:, body.VELOCITY + 2] += up
    spin = 1e5 * R * R * state.bodies.mass  # of balls, 2/5 m R^2
    state.B[:, body.SPIN], state.E[:, body_extra.ANGULAR_MOMENTUM] = 1e5, 0.4 * spin
    expected = 0.5 * (float(state.bodies.mass @ up**2) + 0.4e5 * spin.sum()) / kinetic
    assert measured(state, gap, elastic=kinetic)["kinetic_energy_ratio"] == pytest.approx(expected, rel=1e-12)


@pytest.fixture
def column(tmp_path):
    rows = [f"20,20,{5.0 + 10.0 * k},5,{k}" for k in range(4)]
    (tmp_path / "column.csv").write_text("\n".join(["center_x (um),center_y (um),center_z (um),radius (um),clump", *rows]))
    debris = '[[debris]]\nmaterial = "steel"\nkind = "file"\nfile = "column.csv"'
    solver = 'integrator = "explicit"\nsettle = "6 us"\nduration = "1 us"'
    upper = 'support = "rigid"\nload = "0.1 mN"\n[contact]\nlaw = "three_spot"\nlevel = "mindlin"'
    (tmp_path / "column.toml").write_text(scene_text(debris, '["40 um", "40 um"]', upper, solver=solver, every="0.25 us"))
    return thirdbody.Scene.load(tmp_path / "column.toml")


def test_a_column_of_balls_at_rest_has_the_measures_of_statics(column, tmp_path):
    with thirdbody.run(column, out=tmp_path / "run", progress=False) as run:
        series = {name: run.series[name][-1] for name in BED}
        bed, summary = run.bed, run.summary()
        assert run.series["active"][-1] == 1.0  # all are pressed from above and from below
    e_star = 210e9 / (2.0 * (1.0 - 0.3**2))
    between, plate = ((9.0 * LOAD**2 / (16.0 * e_star**2 * radius)) ** (1.0 / 3.0) for radius in (0.5 * R, R))
    # what is left of the oscillations after six microseconds is far below a thousandth
    assert series["overlap_ratio"] == pytest.approx((3.0 * between + 2.0 * plate) / 5.0 / R, rel=1e-3)
    rows = np.zeros((2, record.WIDTH))  # a contact of 5 N between two balls, one of 15 N with a plate; on the bodies 3 and 1 N
    rows[:, record.NORMAL_FORCE], rows[0, record.TANGENTIAL_FORCE] = (3.0, 15.0), 4.0
    slots = SimpleNamespace(R=rows, own=np.zeros(2, int), partner=np.array([1, -1]))
    state = SimpleNamespace(slots=slots, body=np.arange(2), B=np.zeros((2, body.FORCE + 3)))
    state.B[:, body.FORCE] = 3.0, -1.0
    assert unbalanced_force(state, np.arange(2)) == pytest.approx(0.2)
    assert series["softness"] == pytest.approx((e_star * SIDE**2 / LOAD) ** (2.0 / 3.0), rel=1e-3)
    assert series["coordination_number"] == 2.0  # three contacts of two balls, two of one
    assert series["unbalanced_force"] < 1e-3 and series["kinetic_energy_ratio"] < 1e-6
    assert abs(series["inertial_number"]) < 1e-6
    # the middle half of the gap holds two balls; their overlaps take some 1e-3 of it
    assert series["solid_fraction"] == pytest.approx(2.0 * 4.0 / 3.0 * math.pi * R**3 / (SIDE**2 * 4.0 * R), rel=3e-3)
    assert bed.quasi_static is True and summary["quasi_static"] is True
    assert summary["softness"] == bed.means["softness"] == pytest.approx(series["softness"], rel=1e-3)
    assert summary["bed_verdict"].startswith("quasi-static: I = ")


def test_what_is_no_bed_has_no_measures(column, tmp_path):
    loop = RunLoop(build(column.with_settings({"contact.debris_contact": "none"})), RunFolder(tmp_path))
    assert loop.means is None and loop.maker.bed is None
    assert not set(BED) & set(loop.maker.frame(None).series)
    sliced = RunLoop(build(column.with_settings({"output.profiles": 5})), RunFolder(tmp_path))
    assert "profiles" in sliced.means.samplers  # means over the output interval
    with thirdbody.open(write_layer(tmp_path / "run.vtkhdf", 3, 4)) as run:
        assert run.bed is None and "bed_verdict" not in run.summary()


@pytest.fixture
def folder(tmp_path) -> Path:
    """A finished run of a bed whose inertial number is 0.5 in the first half and scatters about 0.02 in the second."""
    path = write_layer(tmp_path / "run.vtkhdf", 3, FRAMES)
    number = np.where(np.arange(FRAMES) <= FRAMES // 2, 0.5, 0.02 + 0.002 * np.resize([1.0, -1.0], FRAMES))
    values = dict.fromkeys(BED, np.full(FRAMES, 0.5)) | {"softness": np.full(FRAMES, 1.2e4)}
    values |= {"inertial_number": number, "inertial_number_largest": 1.5 * number}
    with h5py.File(path, "r+") as file:
        for name, row in values.items():
            file["series"].create_dataset(name, data=row).attrs["units"] = "1"
        summary = {"finished": True, "wall_time": 1.0, "steps": 10, "sphere_steps_per_second": 1.0, "energy_residual": 1e-6}
        file["scene"].create_dataset("summary", data=np.bytes_(json.dumps(summary))).attrs["json"] = np.uint8(1)
    return tmp_path


def test_every_output_has_the_mean_over_the_steady_part(folder, capsys):
    with thirdbody.open(folder) as run:
        bed, summary = run.bed, run.summary()
        mean = run.series["inertial_number"][FRAMES // 2 + 1 :].mean()
        assert bed.means["inertial_number"] == summary["inertial_number"] == pytest.approx(mean, rel=1e-12)
        # values that alternate count as independent: 0.002 / sqrt(20), and the factor for the estimated mean
        assert 0.002 / 20**0.5 < bed.errors["inertial_number"] < 0.0007
        assert summary["quasi_static"] is False and bed.verdict == summary["bed_verdict"] == inertia_verdict(mean)
        assert "solver.inertial_number = 0.001" in beds.bed_warning(bed)
        (axes,) = page(run, ["bed"]).axes
        drawn = {line.get_label(): line.get_ydata() for line in axes.lines}
        assert axes.get_title(loc="left") == f"Bed: {bed.verdict}" and axes.get_yscale() == "log"
        assert drawn["inertial number"][-1] == run.series["inertial_number"][-1]
        assert [1e-3, 1e-3] in map(list, drawn.values())
    run_report(folder, json=False)
    printed = capsys.readouterr()
    assert bed.verdict in printed.out and "stiff: kappa = 12000" in printed.out
    assert "the bed is not quasi-static" in printed.err
    run_report(folder, json=True)
    assert json.loads(capsys.readouterr().out)["bed_verdict"] == bed.verdict
    for number, slow in ((1.1e-3, False), (0.9e-3, True)):  # up to 1e-3
        with h5py.File(folder / "run.vtkhdf", "r+") as file:
            file["series/inertial_number"][...] = number
        with thirdbody.open(folder) as run:
            assert run.bed.quasi_static is slow


DRAGS = [
    ({"dragged": False, "during": np.arange(FRAMES) > 0}, 20, 40),
    ({"dragged": False, "during": np.arange(FRAMES) > 20}, 30, 40),
    ({"dragged": True, "stroke": False, "second_half": np.arange(FRAMES) > 24}, 25, 40),
    # four cycles, then part of a fifth: the last two whole ones, without the frame at which the third begins
    ({"dragged": True, "stroke": True, "cycles": [slice(k, k + 9) for k in (0, 8, 16, 24)]}, 17, 32),
    ({"dragged": True, "stroke": True, "cycles": [], "second_half": np.arange(FRAMES) > 30}, 31, 40),
]


@each(DRAGS)
def test_the_steady_part(row):
    drag, first, last = row
    result = Drag(SimpleNamespace(frames=FRAMES, series={"friction_coefficient": np.full(FRAMES, 0.3)}))
    vars(result).update(drag)
    assert np.flatnonzero(result.steady).tolist() == list(range(first, last + 1))


def test_the_verdicts_give_the_number_and_the_rise_is_that_of_the_published_law():
    assert inertia_verdict(8e-4) == "quasi-static: I = 0.0008, friction within 0.0007 of its slow limit"
    assert inertia_verdict(4e-3) == "nearly quasi-static: I = 0.004 raises friction by about 0.004"
    assert inertia_verdict(0.02) == "not quasi-static: I = 0.02 raises friction by about 0.02"
    limits = {1e4: "stiff: kappa = 10000", 9.9e3: "fairly stiff", 1e3: "fairly stiff", 990.0: "soft: kappa = 990"}
    for softness, word in limits.items():
        said = beds.softness_verdict(softness, 1e-4)
        assert said.startswith(word) and "0.01 % of the radius" in said
    # Jop et al.: mu_s = tan 20.9, mu_2 = tan 32.76, I_0 = 0.279; two digits are printed
    low, high, scale = np.tan(np.radians(20.9)), np.tan(np.radians(32.76)), 0.279
    for number in (1e-3, 1e-2, 0.1, 1.0):
        assert friction_increase(number) == pytest.approx((high - low) / (scale / number + 1.0), rel=0.01)


V = 0.5  # m/s
DRAG = np.array([1.0, 0.0, 0.0])
CODES = {LOWER: -1, UPPER: -1 - BASINS, DEBRIS: 0}
TOP, BOTTOM = (UPPER, (0.0, 0.0, R)), (LOWER, (0.0, 0.0, -R))


def kinematics_of(bodies, contacts, meet=True):
    """A state of `bodies` (velocity, spin) along x and about y, and of `contacts` (body, (side, point), normal force)."""
    own, place, force = zip(*contacts, strict=True)
    side, point = zip(*place, strict=True)
    velocity, spin = np.zeros((len(bodies), 3)), np.zeros((len(bodies), 3))
    velocity[:, 0], spin[:, 1] = np.array(bodies).T
    H, records = np.zeros((len(own), contact_state.MIN_WIDTH)), np.zeros((len(own), record.WIDTH))
    H[:, contact_state.SLIP] = 1e-300  # closed
    records[:, record.NORMAL_FORCE], records[:, record.POINT3] = force, point
    slots = SimpleNamespace(partner=np.array([CODES[each] for each in side]), own=np.array(own), rows=AllRows(H, records))
    upper = SimpleNamespace(schedule=Schedule(x=(Segment(0.0, motion.POLYNOMIAL, 0.0, V),)))
    world = SimpleNamespace(upper=upper, lower=0, debris_meets=meet, walls=False)
    rows = SimpleNamespace(velocity=velocity, spin=spin)
    return SimpleNamespace(bodies=rows, slots=slots, body=np.arange(len(bodies)), n_bodies=len(bodies), world=world, time=1.0,
                           sprung=False)  # fmt: skip


def parts(*arguments, **keys):
    return list(parts_of(accommodation(DRAG, kinematics_of(*arguments, **keys))).values())


# velocity and spin of a body between two plates, and the upper slip, lower slip and rolling that follow [V]
ONE_BODY = {
    "roller": (0.5, 0.5 / R, (0.0, 0.0, 1.0)), "carried by the upper plate": (1.0, 0.0, (0.0, 1.0, 0.0)),
    "left behind by the upper plate": (0.0, 0.0, (1.0, 0.0, 0.0)), "flake that slips on both": (0.3, 0.0, (0.7, 0.3, 0.0)),
    "roller that slips at the top": (0.4, 0.4 / R, (0.2, 0.0, 0.8)), "spun by nothing": (0.5, -0.1 / R, (0.6, 0.6, -0.2)),
}  # fmt: skip


@each(ONE_BODY)
def test_one_body_between_the_plates(name):
    velocity, spin, expected = ONE_BODY[name]
    state = kinematics_of([(velocity * V, spin * V)], [(0, TOP, 1e-4), (0, BOTTOM, 1e-4)])
    for drag in (DRAG, DRAG[[1, 0, 2]]):
        # the weights are 1: only sums and one product are rounded
        found = list(parts_of(accommodation(drag, state)).values())
        assert found == pytest.approx([V * x for x in (*expected, 0)], abs=1e-13 * V)
        rows, plate = state.bodies, state.world.upper  # all turned about z by a right angle
        rows.velocity, rows.spin = rows.velocity[:, [1, 0, 2]], -rows.spin[:, [1, 0, 2]]
        plate.schedule = Schedule(y=plate.schedule.x)


def test_beds_are_sheared_between_the_bodies_that_pass_load_on_and_told_in_words():
    bodies = [(0.1 * V, 0.2 * V / R), (0.5 * V, 0.4 * V / R), (0.9 * V, 0.05 * V / R)]
    contacts = [(0, BOTTOM, 2e-4), (1, (DEBRIS, (0.0, 0.0, R)), 3e-4), (2, TOP, 2e-4)]
    # upper: V - 0.9 V - 0.05 V; lower: 0.1 V - 0.2 V; rolling: 0.05 V + 0.2 V; shear: 0.9 V - 0.1 V; not the body in the middle
    assert parts(bodies, contacts) == pytest.approx([0.05 * V, -0.1 * V, 0.25 * V, 0.8 * V], abs=1e-13 * V)
    ball, thrown = (0.5 * V, 0.5 * V / R), (7.0 * V, 0.0)
    contacts = [(0, TOP, 1e-4), (0, BOTTOM, 1.3e-4), (1, BOTTOM, 5e-4)]
    for meet in (True, False):  # the second body rests on the lower plate: no load comes from the upper one
        assert parts([ball, thrown], contacts, meet) == pytest.approx([0.0, 0.0, V, 0.0], abs=1e-13 * V)
    assert np.isnan(parts([ball], [(0, TOP, 1e-4)], False)).all()
    p, q = transmitting_weights(np.array([2.0, 3.0, 0.0]), np.array([2.0, 1.0, 2.0]), True)
    # body 0 and a third of body 1's load go straight down, the other 2 N through body 1, between bodies, and body 2
    assert p == pytest.approx([0.4, 0.6, 0.0]) and q == pytest.approx([0.4, 0.2, 0.4])
    fractions = {"upper_slip": 0.321, "lower_slip": -0.02, "rolling": 0.699, "shear": 0.0}
    text = "70 % rolling, 32 % slip at the upper plate, \u22122 % slip at the lower plate"
    assert beds.accommodation_text(fractions).replace("\u00a0", " ") == text
    assert beds.short_accommodation_text(fractions).replace("\u00a0", " ") == "70 % rolling, 30 % slip"


RAMP = [{"ramp": "0.5 m/s", "duration": "1 us"}, {"velocity": "0.5 m/s"}]
FLAKE = [{"center": [f"{x} um", f"{y} um", "0 um"], "radius": "2 um"} for x, y in ((-3, 0), (3, 0), (0, 0), (0, 3), (0, -3))]


def run_of(folder, **changes):
    smooth = {"plates.upper.motion": {"x": RAMP}, "plates.upper.damping": "7e-4 kg/s", "solver.distance": "2 um"}
    scene = thirdbody.Scene.parse(BALLS).with_settings(smooth | {"output.every": "0.2 um"} | changes)
    return thirdbody.run(scene, out=folder, progress=False)


def check_sum(run):
    total = sum(run.series[name] for name in ACCOMMODATION)
    means = np.diff(run.series["displacement"]) / np.diff(run.times)
    settled = run.series["distance"][:-1] > 0.25e-6
    # time and displacement of an output have some 1e-13 of rounding
    assert settled.sum() > 5 and total[1:][settled] == pytest.approx(means[settled], rel=1e-9)


def test_balls_only_roll_flakes_only_slip_and_a_plate_at_rest_has_no_parts(tmp_path):
    with run_of(tmp_path / "balls") as run:
        check_sum(run)
        assert beds.accommodation_fractions(run.drag)["rolling"] == pytest.approx(1.0, abs=0.01)  # creep and the ramp's vibration
        assert run.summary()["accommodation"] == beds.accommodation_fractions(run.drag)
        assert run.units["accommodation_rolling"] == "m/s"
    flakes = {"debris.0": {"material": "steel", "kind": "spheres", "count": 4, "shape": FLAKE, "seed": 1}}
    with run_of(tmp_path / "flakes", **flakes) as run:
        check_sum(run)
        fractions = beds.accommodation_fractions(run.drag)
        assert fractions["upper_slip"] + fractions["lower_slip"] == pytest.approx(1.0, abs=0.01)
        axes = run.plot(panels=["accommodation"]).axes[0]
        assert "slip" in axes.get_title(loc="left")
        # areas reach up to the line of the plate, whose steps end at their frames
        x, y = axes.lines[0].get_data()
        for factor, inside in ((0.98, True), (1.02, False)):
            points = np.column_stack((0.5 * (x[:-1] + x[1:]), factor * y[1:]))
            within = [area.get_paths()[0].contains_points(points) for area in axes.collections]
            assert (np.any(within, axis=0) == inside).all()
    text = edited(BALLS, ('motion = {x = {velocity = "0.5 m/s"}}\n', ""), ('distance = "0.1 um"', 'duration = "0.1 us"'))
    with thirdbody.run(thirdbody.Scene.parse(edited(text, ("0.05 um", "1 us"))), out=tmp_path / "rest", progress=False) as run:
        assert not set(ACCOMMODATION) & set(run.series) and "accommodation" not in run.summary()


def test_an_implicit_stroke_has_the_speed_of_its_sine(tmp_path):
    length, frequency = 2e-6, 5.0
    text = edited(ensembles.SCENE, ('distance = "0.1 um"', 'duration = "0.2 s"'), ("0.05 um", "8 ms"))
    text = edited(text, ('velocity = "10 mm/s"', 'stroke = "2 um", frequency = "5 Hz"'))
    with thirdbody.run(thirdbody.Scene.parse(text), out=tmp_path / "stroke", progress=False) as run:
        u = run.series["displacement"]
        speed = 2.0 * np.pi * frequency * np.sqrt(np.maximum(u * (length - u), 0.0))  # u = (length/2) (1 - cos(2 pi frequency t))
        total = sum(run.series[name] for name in ACCOMMODATION)
        # near the turns the root magnifies rounding of the displacement, 1e-16 of the length, to 1e-8
        loaded = np.isfinite(total)
        assert loaded[1:].all() and abs(total[loaded]) == pytest.approx(speed[loaded], abs=1e-6 * speed.max())
        assert np.nanmin(total) < 0.0
        assert run.summary()["accommodation"]["shear"] == 0.0
