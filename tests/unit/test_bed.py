"""Beds: measures of states made by hand against closed forms, a column of balls at rest, the verdict on how slow shear is."""

import json
import math
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from each import each
from layer import write_layer
from steel import STEEL

import thirdbody
from thirdbody.assembly.simulation import build
from thirdbody.bodies.clump import clump
from thirdbody.engine.placed import Placed
from thirdbody.engine.state import World, assemble
from thirdbody.granular_flow import friction_increase, inertia_verdict, median_by_mass
from thirdbody.kernels.columns import body
from thirdbody.plot.summary_page import page
from thirdbody.report.tables import run_report
from thirdbody.runner.run_folder import RunFolder
from thirdbody.runner.run_loop import RunLoop
from thirdbody.trajectory.bed_measures import BedMeasures, Interval
from thirdbody.trajectory.bed_verdict import bed_warning, softness_verdict, steady
from thirdbody.trajectory.names import BED, SERIES

R, DENSITY, MODULUS, PRESSURE = 5e-6, 7850.0, 1e11, 1e6
LAWLESS = SimpleNamespace(history=(), memory=0, contact_memory=0, moments=False, rolling=0, loss="", measures=None,
                          has_effects=False)  # fmt: skip


def state_of(shapes, positions, size):
    """A state of clumps at rest in a periodic domain."""
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
    return BedMeasures(state, MODULUS).series(Interval(PRESSURE, velocities, gap), elastic)


def test_the_solid_fraction_of_a_crystal():
    for layers in (4, 5, 9):  # one layer is left out at each plate
        series = measured(*crystal(layers))
        assert tuple(series) == BED and series["solid_fraction"] == pytest.approx(math.pi / 6.0, rel=1e-12)
    assert all(SERIES[name].unit == "1" for name in BED)
    series = measured(*crystal(2))  # a layer is no bed
    assert all(math.isnan(series[name]) for name in ("inertial_number", "inertial_number_largest", "solid_fraction"))
    state, gap = crystal(9)
    state.S[:, 2] += 0.7 * R
    # the slab cuts balls at both ends at the same height of the crystal: what one end loses the other gains
    assert measured(state, gap)["solid_fraction"] == pytest.approx(math.pi / 6.0, rel=1e-12)


def test_clumps_count_with_the_volume_of_their_union():
    pair = clump([[-0.5 * R, 0.0, 0.0], [0.5 * R, 0.0, 0.0]], [R, R])
    lens = math.pi * (4.0 * R + R) * (2.0 * R - R) ** 2 / 12.0  # of two equal balls at the distance R
    volume = 8.0 / 3.0 * math.pi * R**3 - lens
    positions = [[2.0 * R, 2.0 * R, (1.0 + 2.0 * k) * R] for k in range(10)]
    state = state_of([pair] * 10, positions, (4.0 * R, 4.0 * R))
    d = 2.0 * np.cbrt(0.75 * volume / math.pi)
    assert BedMeasures(state, MODULUS).median == pytest.approx(d, rel=1e-9)
    # a largest diameter is left out at each plate: six whole clumps, and of two what the cut leaves of their balls
    cut = 4.0 * R - d
    outer = (4.0 * R**3 - cut**2 * (3.0 * R - cut)) / (4.0 * R**3) if cut < 2.0 * R else 0.0
    inside = 8.0 - 2.0 * outer if d < 2.0 * R else 6.0 + 2.0 * (cut**2 * (3.0 * R - cut)) / (4.0 * R**3)
    expected = inside * volume / ((4.0 * R) ** 2 * (20.0 * R - 2.0 * d))
    assert measured(state, 20.0 * R)["solid_fraction"] == pytest.approx(expected, rel=1e-9)


def test_the_inertial_number_of_plane_shear():
    small, large = clump([[0.0, 0.0, 0.0]], [R]), clump([[0.0, 0.0, 0.0]], [1.2 * R])
    z = np.linspace(R, 39.0 * R, 60)
    positions = np.column_stack([np.zeros(60), np.zeros(60), z])
    state = state_of([small] * 50 + [large] * 10, positions, (40.0 * R, 40.0 * R))
    rate = 1e4
    velocities = np.column_stack([np.zeros(60), -rate * z, np.zeros(60)])
    series = measured(state, 40.0 * R, velocities)
    expected = rate * 2.0 * R * math.sqrt(DENSITY / PRESSURE)
    assert series["inertial_number"] == pytest.approx(expected, rel=1e-9)
    assert series["inertial_number_largest"] == pytest.approx(1.2 * expected, rel=1e-9)
    assert series["softness"] == pytest.approx((MODULUS / PRESSURE) ** (2.0 / 3.0), rel=1e-14)


def test_the_median_is_by_mass():
    diameters = np.array([1.0] * 100 + [3.0] * 10)
    assert median_by_mass(diameters, diameters**3) == 3.0  # 270 of 370
    assert median_by_mass(diameters, np.ones(110)) == 1.0


def test_the_mean_flow_has_no_energy_of_fluctuation():
    state, gap = crystal(6)
    state.B[:, body.VELOCITY3] = np.outer(1e4 * state.bodies.position[:, 2], [0.6, 0.8, 0.0]) + [3.0, 0.0, 0.1]
    kinetic = 0.5 * float(state.bodies.mass @ np.sum(state.bodies.velocity**2, axis=1))
    assert measured(state, gap, elastic=kinetic)["kinetic_energy_ratio"] < 1e-20  # rounding of velocities, squared
    up = np.resize([0.2, -0.2], state.n_bodies)
    state.B[:, body.VELOCITY + 2] += up
    expected = 0.5 * float(state.bodies.mass @ up**2) / kinetic
    assert measured(state, gap, elastic=kinetic)["kinetic_energy_ratio"] == pytest.approx(expected, rel=1e-12)


LOAD, SIDE = 1e-4, 40e-6
COLUMN = f"""\
{STEEL}\
[[debris]]
material = "steel"
kind = "file"
file = "column.csv"
[domain]
size = ["40 um", "40 um"]
[plates]
lower = {{material = "steel"}}
upper = {{material = "steel", support = "rigid", load = "0.1 mN"}}
[contact]
law = "three_spot"
level = "mindlin"
[solver]
integrator = "explicit"
settle = "6 us"
duration = "1 us"
[output]
every = "0.25 us"
"""


@pytest.fixture
def column(tmp_path):
    """Four balls on one another."""
    rows = [f"20,20,{5.0 + 10.0 * k},5,{k}" for k in range(4)]
    (tmp_path / "column.csv").write_text("\n".join(["center_x (um),center_y (um),center_z (um),radius (um),clump", *rows]))
    path = tmp_path / "column.toml"
    path.write_text(COLUMN)
    return thirdbody.Scene.load(path)


def test_a_column_of_balls_at_rest_has_the_measures_of_statics(column, tmp_path):
    with thirdbody.run(column, out=tmp_path / "run", progress=False) as run:
        series = {name: run.series[name][-1] for name in BED}
        bed, summary = run.bed, run.summary()
    e_star = 210e9 / (2.0 * (1.0 - 0.3**2))
    between, plate = ((9.0 * LOAD**2 / (16.0 * e_star**2 * radius)) ** (1.0 / 3.0) for radius in (0.5 * R, R))
    # what is left of the oscillations after six microseconds is far below a thousandth
    assert series["overlap_ratio"] == pytest.approx((3.0 * between + 2.0 * plate) / 5.0 / R, rel=1e-3)
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
    alone = column.with_settings({"contact.debris_contact": "none"})
    loop = RunLoop(build(alone), RunFolder(tmp_path))
    assert loop.means is None and loop.maker.bed is None
    assert not set(BED) & set(loop.maker.frame(None).series)
    with thirdbody.open(write_layer(tmp_path / "run.vtkhdf", 3, 4)) as run:
        assert run.bed is None and "bed_verdict" not in run.summary()


FRAMES = 41


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
        assert "solver.inertial_number = 0.001" in bed_warning(bed)
        titles = [axes.get_title(loc="left") for axes in page(run, ["bed"]).axes]
        assert titles == [f"Bed: {bed.verdict}"]
    run_report(folder, json=False)
    printed = capsys.readouterr()
    assert bed.verdict in printed.out and "stiff: kappa = 12000" in printed.out
    assert "the bed is not quasi-static" in printed.err
    run_report(folder, json=True)
    assert json.loads(capsys.readouterr().out)["bed_verdict"] == bed.verdict


DRAGS = [
    ({"dragged": False}, 20, 40),
    ({"dragged": True, "stroke": False, "second_half": np.arange(FRAMES) > 24}, 25, 40),
    # four cycles, then part of a fifth: the last two whole ones, without the frame at which the third begins
    ({"dragged": True, "stroke": True, "cycles": [slice(k, k + 9) for k in (0, 8, 16, 24)]}, 17, 32),
    ({"dragged": True, "stroke": True, "cycles": [], "second_half": np.arange(FRAMES) > 30}, 31, 40),
]


@each(DRAGS)
def test_the_steady_part(row):
    drag, first, last = row
    run = SimpleNamespace(frames=FRAMES, series={"friction_coefficient": np.full(FRAMES, 0.3)}, drag=SimpleNamespace(**drag))
    assert np.flatnonzero(steady(run)).tolist() == list(range(first, last + 1))


def test_the_verdicts_give_the_number_and_what_it_means():
    assert inertia_verdict(8e-4) == "quasi-static: I = 0.0008, friction within 0.0007 of its slow limit"
    assert inertia_verdict(1e-6) == "quasi-static: I = 0.000001, friction within 0.0001 of its slow limit"
    assert inertia_verdict(4e-3) == "nearly quasi-static: I = 0.004 raises friction by about 0.004"
    assert inertia_verdict(0.02) == "not quasi-static: I = 0.02 raises friction by about 0.02"
    for softness, word in ((1.2e4, "stiff: kappa = 12000"), (2e3, "fairly stiff"), (500.0, "soft: kappa = 500")):
        said = softness_verdict(softness, 1e-4)
        assert said.startswith(word) and "0.01 % of the radius" in said


def test_the_rise_is_that_of_the_published_law():
    # Jop et al.: mu_s = tan 20.9, mu_2 = tan 32.76, I_0 = 0.279; two digits are printed
    low, high, scale = np.tan(np.radians(20.9)), np.tan(np.radians(32.76)), 0.279
    for number in (1e-3, 1e-2, 0.1, 1.0):
        assert friction_increase(number) == pytest.approx((high - low) / (scale / number + 1.0), rel=0.01)
