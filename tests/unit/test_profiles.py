"""Profiles, means over an output interval and the shear zone of a bed against closed forms; what a run does with them."""

import csv
import math
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from balls import BALLS, edited
from matplotlib.figure import Figure
import thirdbody
from thirdbody.errors import InputError
from thirdbody.kernels.table import Rows
from thirdbody.kernels.tables import DEBRIS, LOWER, ONLY_LOWER, UPPER, body, contact_state, domain, patch, record, sphere
from thirdbody.palette import STATE_COLORS
from thirdbody.plot.summary_page import PANELS
from thirdbody.scene.model import Scene
from thirdbody.trajectory.bed_measures import EDGE, rising_profile, shear_zone
from thirdbody.trajectory.profiles import Profiler, Slabs, line_parts, sphere_parts
from thirdbody.trajectory.sampling import SAMPLES, IntervalMeans

L, W, H = 60e-6, 40e-6, 50e-6  # m
R, DENSITY = 5e-6, 7850.0
BALL = 4.0 / 3.0 * math.pi * R**3


def volumes(slabs, centres, radii):
    parts, moments = sphere_parts(slabs, centres, radii)
    return dense(slabs, parts, len(radii)), dense(slabs, parts._replace(amount=moments), len(radii))


def dense(slabs, parts, rows):
    table = np.zeros((rows, slabs.count))
    np.add.at(table, (parts.thing, parts.slab), parts.amount)
    return table


def test_spheres_are_cut_into_caps_lines_in_proportion_and_nothing_is_lost():
    slabs = Slabs(0.0, 4.0, 4)
    volume, moment = volumes(slabs, np.array([1.0, 2.25, 0.5, 9.0]), np.array([1.0, 0.5, 1.0, 1.0]))
    assert volume[0] == pytest.approx([2.0 / 3.0 * math.pi] * 2 + [0.0, 0.0])
    assert moment[0] == pytest.approx([-0.25 * math.pi, 0.25 * math.pi, 0.0, 0.0])
    cap = math.pi * 0.25**2 * (3.0 * 0.5 - 0.25) / 3.0  # height 0.25 of a sphere of radius 0.5
    assert volume[1] == pytest.approx([0.0, cap, math.pi / 6.0 - cap, 0.0]) and moment[1].sum() == pytest.approx(0.0, abs=1e-15)
    assert volume[2].sum() == pytest.approx(math.pi * 1.5**2 * (3.0 - 1.5) / 3.0)  # the lowest half of its radius is outside
    assert not volume[3].any()
    lines = dense(slabs, line_parts(slabs, np.array([0.5, 2.5, 1.5, -1.0, 1.25]), np.array([2.0, -2.0, 0.0, 2.0, 0.5])), 5)
    found = [[0.25, 0.5, 0.25, 0], [0.25, 0.5, 0.25, 0], [0, 1, 0, 0], [0.5, 0, 0, 0], [0, 1, 0, 0]]
    assert lines == pytest.approx(np.array(found))
    slabs, rng = Slabs(0.0, 4.0, 5, periodic=True), np.random.default_rng(1)
    centres, radii = rng.uniform(-9.0, 9.0, 50), rng.uniform(0.1, 1.9, 50)
    volume, moment = volumes(slabs, centres, radii)
    assert volume.sum(axis=1) == pytest.approx(4.0 / 3.0 * math.pi * radii**3)
    assert moment.sum(axis=1) == pytest.approx(0.0, abs=1e-12)
    assert volume == pytest.approx(volumes(slabs, centres + 4.0, radii)[0], abs=1e-12)
    assert dense(slabs, line_parts(slabs, centres, rng.uniform(-2.0, 2.0, 50)), 50).sum(axis=1) == pytest.approx(1.0)


def state_of(position, velocity=None, spin=None, contacts=(), offsets=((0.0, 0.0, 0.0),), volume=None):
    """A state of clumps of balls at `offsets`; contacts: (owner, partner or side, point, partner's point, force on the owner)."""
    n, each = len(position), len(offsets)
    B, S, P = np.zeros((n, body.WIDTH)), np.zeros((n * each, sphere.WIDTH)), np.zeros((1, patch.WIDTH))
    volume = BALL if volume is None else volume
    B[:, body.POSITION3], B[:, body.MASS] = position, DENSITY * volume
    B[:, body.VELOCITY3] = 0.0 if velocity is None else velocity
    B[:, body.SPIN3] = 0.0 if spin is None else spin
    S[:, sphere.POSITION3] = np.repeat(position, each, axis=0) + np.tile(offsets, (n, 1))
    S[:, sphere.RADIUS], P[:, patch.HEIGHT] = R, H
    table, histories = np.zeros((len(contacts), record.WIDTH)), np.zeros((len(contacts), contact_state.MIN_WIDTH))
    histories[:, contact_state.SLIP] = contact_state.CLOSED
    owners, partners, sides = [], [], []
    for row, (owner, partner, point, other, force) in zip(table, contacts, strict=True):
        owners.append(owner * each)
        partners.append(-1 if partner in ("lower", "upper") else partner * each)
        sides.append({"lower": LOWER, "upper": UPPER}.get(partner, DEBRIS))
        row[record.POINT3], row[record.PARTNER_POINT3] = point, other
        force, normal = np.array(force, float), -np.array(point, float) / np.linalg.norm(point)
        row[record.NORMAL3], row[record.NORMAL_FORCE] = normal, force @ normal
        row[record.TANGENTIAL_FORCE3] = force - (force @ normal) * normal
    slots = SimpleNamespace(
        histories=Rows((histories, contact_state)), records=Rows((table, record)), own=np.array(owners, int),
        partner=np.array(partners, int), sides=np.array(sides, int), R=table, count=len(contacts),
    )  # fmt: skip
    world = SimpleNamespace(upper=SimpleNamespace(heights=np.zeros(1)), size=(L, W), periodic=True)
    D = np.zeros(domain.WIDTH)
    D[domain.LENGTH_X], D[domain.LENGTH_Y] = L, W
    return SimpleNamespace(side=np.zeros(n * each, np.int8), D=D,
        bodies=Rows((B, body)), spheres=Rows((S, sphere)), P=P, slots=slots, world=world, n_bodies=n,
        body=np.repeat(np.arange(n), each), rayleigh_radius=np.full(n, np.cbrt(3.0 * volume / (4.0 * math.pi))),
    )  # fmt: skip


def profiles(state, bins=10, axis=2):
    profiler = Profiler(bins, axis)
    return profiler.profiles(profiler(state), state)


FORCE = np.array([2e-4, -1e-4, 1e-3])  # of the lower plate on what it carries, N


def test_a_crooked_column_carries_the_force_of_the_plates_in_every_slab():
    z = np.array([5.0, 15.0, 25.0, 35.0, 45.0]) * 1e-6
    x = 3e-6 * np.array([1.0, -1.0, 1.0, -1.0, 1.0])
    contacts = [(0, "lower", (0.0, 0.0, -R), (0.0, 0.0, 0.0), FORCE), (4, "upper", (0.0, 0.0, R), (0.0, 0.0, 0.0), -FORCE)]
    for k in range(4):  # the upper ball owns the contact, at the middle between both centres
        half = 0.5 * np.array([x[k] - x[k + 1], 0.0, -2.0 * R])
        contacts.append((k + 1, k, half, -half, FORCE))
    found = profiles(state_of(np.column_stack([x, 0.0 * x, z]), contacts=contacts))
    stress = found["contact_stress"].reshape(-1, 3, 3)
    # rounding of some ten sums
    assert stress[:, :, 2] * L * W == pytest.approx(np.tile(FORCE, (10, 1)), rel=1e-12)
    assert found["coordination_number"] == pytest.approx(2.0)
    assert not found["kinetic_stress"].any()


def test_plane_couette_flow_integrates_to_the_speed_of_the_plate():
    rng, V = np.random.default_rng(2), 0.5
    z = rng.uniform(R, H - R, 20000)
    position = np.column_stack([rng.uniform(0.0, L, len(z)), rng.uniform(0.0, W, len(z)), z])
    velocity = np.outer(V * z / H, [1.0, 0.0, 0.0])
    found = profiles(state_of(position, velocity, np.tile([0.0, V / H / 2.0, 0.0], (len(z), 1))), 25)
    v, position = found["velocity"][:, 0], found["position"]
    assert position == pytest.approx((np.arange(25) + 0.5) * H / 25)
    # away from the plates the profile is the flow itself: of 20 000 balls the mean of a slab is right to a few thousandths
    middle = (position > 2.0 * R) & (position < H - 2.0 * R)
    assert v[middle] == pytest.approx(V * position[middle] / H, rel=0.01)
    assert np.polyfit(position[middle], v[middle], 1)[0] * H == pytest.approx(V, rel=0.01)
    assert found["angular_velocity"][:, 1] == pytest.approx(V / H / 2.0)
    # no momentum is lost to the slabs, whatever the rotation
    momentum = np.sum(found["solid_fraction"] * v) * DENSITY * L * W * H / 25
    assert momentum == pytest.approx(DENSITY * BALL * velocity[:, 0].sum(), rel=1e-12)
    assert np.mean(found["solid_fraction"]) == pytest.approx(len(z) * BALL / (L * W * H), rel=1e-12)


def test_a_gas_a_cut_ball_a_clump_and_an_empty_slab_have_their_closed_forms():
    omega = 1e4
    state = state_of(np.array([[0.0, 0.0, 0.5 * H]]), spin=np.array([[0.0, omega, 0.0]]))
    # the centroid of half a ball is 3/8 R from its centre
    assert profiles(state, 2)["velocity"][:, 0] == pytest.approx([-0.375 * R * omega, 0.375 * R * omega])
    c, mean = 2.0, np.array([0.3, 0.0, -0.1])
    velocity = mean + c * np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    found = profiles(state_of(np.tile([0.0, 0.0, 0.5 * H], (4, 1)), velocity), 1)
    stress = found["kinetic_stress"].reshape(3, 3)
    expected = np.diag([2.0, 0.0, 2.0]) * DENSITY * BALL * c**2 / (L * W * H)
    assert stress == pytest.approx(expected, abs=1e-12 * expected.max())
    assert found["velocity"][0] == pytest.approx(mean)
    offsets, volume = ((0.0, 0.0, 0.0), (R, 0.0, 0.0)), 1.6 * BALL
    state = state_of(np.array([[0.0, 0.0, 0.25 * H]]), np.array([[1.0, 0.0, 0.0]]), offsets=offsets, volume=volume)
    found = profiles(state, 2)
    assert found["solid_fraction"] == pytest.approx([volume / (L * W * H / 2.0), 0.0])
    assert found["velocity"][0] == pytest.approx([1.0, 0.0, 0.0]) and np.isnan(found["velocity"][1]).all()
    across = profiles(state, 4, axis=0)
    assert across["position"] == pytest.approx((np.arange(4) + 0.5) * L / 4)
    assert np.sum(across["solid_fraction"]) == pytest.approx(volume / (L * W * H / 4.0))
    state.side[:] = ONLY_LOWER  # a spot: the volume of its body is not known
    assert np.isnan(profiles(state, 2)["solid_fraction"]).all()


RAMP = 'motion = {x = [{ramp = "0.5 m/s", duration = "1 us"}, {velocity = "0.5 m/s"}]}'
ROLLERS = edited(BALLS, ('motion = {x = {velocity = "0.5 m/s"}}', RAMP), ("7e-5 kg/s", "7e-4 kg/s"), ("0.1 um", "2 um"))


@pytest.fixture(scope="module")
def rolled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("profiles") / "run"
    with thirdbody.run(Scene.parse(edited(ROLLERS, ("0.05 um", "0.2 um")) + "profiles = 8\n"), out=folder, progress=False) as run:
        yield run


def test_a_run_records_profiles_of_balls_that_roll_also_in_tables_and_pictures(rolled, tmp_path):
    found, frames = rolled.profiles, rolled.frames
    assert found["velocity"].shape == (frames, 8, 3) and found["contact_stress"].shape == (frames, 8, 3, 3)
    assert rolled.units["contact_stress"] == "Pa" and rolled.header["profiles"] == {"bins": 8, "axis": "z"}
    assert sum(found[f"fraction_{name}"] for name in rolled.state_names) == pytest.approx(1.0)
    assert found["position"][-1, -1] == pytest.approx(rolled.series["gap"][-1] * 7.5 / 8.0, rel=1e-3)
    # a ball that rolls without slip is at rest below and as fast as the plate above, a straight line between
    series, late = rolled.series, np.flatnonzero(rolled.series["distance"] > 1e-6)
    stress = (rolled.profiles["contact_stress"] + rolled.profiles["kinetic_stress"]) * np.prod(rolled.header["domain"]["size"])
    assert stress[late, :, 2, 2] == pytest.approx(np.tile(series["upper_force"][late, 2, None], 8), rel=0.01)
    for k, gap in zip(late, series["gap"][late], strict=True):
        volume, moment = volumes(Slabs(0.0, gap, 8), np.array([gap / 2.0]), np.array([R]))
        # the ball vibrates about rolling by a fraction of a per cent of the speed
        expected = 0.5 * (gap / 2.0 + (moment / volume)[0]) / gap
        assert rolled.profiles["velocity"][k, :, 0] == pytest.approx(expected, abs=0.01 * 0.5)
    rolled.export(csv=tmp_path / "tables", frame=3)
    with open(tmp_path / "tables" / "profiles.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8 and float(rows[2]["contact_stress_xz [Pa]"]) == rolled.profiles["contact_stress"][3, 2, 0, 2]
    assert float(rows[5]["velocity_x [m/s]"]) == rolled.profiles["velocity"][3, 5, 0] and rows[5]["slab"] == "5"
    assert len(rolled.to_pandas("profiles")) == 8 * rolled.frames
    names = ["velocity_profile", "solid_profile", "stress_profile", "states_profile"]
    drawn = {axes.get_label(): axes for axes in rolled.plot(panels=names).axes}
    assert list(drawn) == names
    line = drawn["velocity_profile"].lines[0]
    assert len(line.get_xdata()) == 8 and "velocity" in drawn["velocity_profile"].get_xlabel()


def test_without_the_key_there_is_nothing(shared_run):
    with thirdbody.open(shared_run("layer")) as run:
        assert run.profiles == {} and "profiles" not in run.header
        with h5py.File(run.path) as file:
            assert "profiles" not in file
        with pytest.raises(AttributeError, match="output.profiles"):
            run.to_pandas("profiles")


def test_faulty_and_good_keys():
    for value, message in (
        ("0", "output.profiles: 0 must be at least 1 and at most 1000"),
        ("{bins = 2000}", "output.profiles.bins: 2000 must be at least 1 and at most 1000"),
        ('{bins = 20, axis = "w"}', "output.profiles.axis: 'w' is not one of 'x', 'y', 'z'"),
        ("{bins = 20, bin = 3}", "output.profiles.bin: unknown key, did you mean 'bins'?"),
    ):
        with pytest.raises(InputError) as error:
            Scene.parse(f"{BALLS}profiles = {value}\n")
        assert message in str(error.value)
    upper = BALLS[BALLS.index("[plates.upper]") : BALLS.index("[solver]")]
    text = edited(BALLS, (upper, ""), ("0.05 um", "1 us"), ('distance = "0.1 um"', 'duration = "1 us"'))
    with pytest.raises(InputError, match="between two plates: add plates.lower and plates.upper"):
        Scene.parse(f"{text}profiles = 5\n")
    for value in ("profiles = 20\n", '[output.profiles]\nbins = 20\naxis = "x"\n'):  # saved as it was given
        scene = Scene.parse(BALLS + value)
        assert value in scene.to_toml() and Scene.parse(scene.to_toml()) == scene


END = 2.0


def means_of(function, duration=END):
    state = SimpleNamespace(time=0.0)
    return IntervalMeans(state, {"value": lambda now: np.array([function(now.time), 1.0])}, lambda: duration), state


def finished(means, state, times, end=END):
    for state.time in times:
        means.watch()
    state.time = end
    return means.finish()["value"]


def test_means_are_those_of_the_trapezoidal_rule_and_an_interval_begins_anew():
    line = finished(*means_of(lambda t: 3.0 + 2.0 * t), np.sort(np.random.default_rng(1).uniform(0.0, END, 500)))
    assert line == pytest.approx([3.0 + END, 1.0], rel=1e-13)  # rounding of some thirty sums
    parabola = finished(*means_of(lambda t: t**2), np.linspace(0.0, END, 1001)[1:-1])
    # h^2/12 times the second derivative, 2, with h of a 32nd of the interval, or one watch more
    assert 0.0 < parabola[0] - END**2 / 3.0 < 1.1 * (END / SAMPLES) ** 2 / 6.0
    # without an expected end every instant is sampled: exact with a corner on a sample
    corner = finished(*means_of(lambda t: abs(t - 1.0), np.inf), np.linspace(0.0, END, 2001)[1:-1])
    assert corner[0] == pytest.approx(0.5, rel=1e-12)
    assert means_of(lambda t: 7.0)[0].finish()["value"].tolist() == [7.0, 1.0]  # without time the present value
    means, state = means_of(lambda t: t)
    for start, end in ((0.0, 2.0), (2.0, 3.0)):
        mean = finished(means, state, np.linspace(start, end, 100)[1:-1], end)
        assert mean[0] == pytest.approx(0.5 * (start + end), rel=1e-13)


def test_restored_means_go_on_bit_for_bit_and_others_are_refused():
    times = np.linspace(0.0, END, 777)[1:]
    reference = finished(*means_of(np.sin), times)
    first, state = means_of(np.sin)
    for state.time in times[:300]:
        first.watch()
    saved = {name: array.copy() for name, array in first.export_state().items()}
    second, state = means_of(np.sin)
    second.restore(saved)
    assert np.array_equal(finished(second, state, times[300:]), reference)
    del saved["sum_value"]
    with pytest.raises(ValueError, match="sum_value is missing"):
        second.restore(saved)


def test_profiles_are_drawn_along_the_motion_of_the_plate():
    """Back and forth along y, 2 um in 1 and in 3 us; the bed holds the upper plate back by 1 kPa, drags the lower by 0.8 kPa."""
    steps = 1e-6 * np.array([0.0, 9.0, 2.0, -2.0])
    side, stress, velocity = np.sign(steps), np.zeros((4, 2, 3, 3)), np.zeros((4, 2, 3))
    stress[..., 2, 2], stress[..., 1, 2], velocity[..., 1] = 3e3, -1e3 * side[:, None], side[:, None] * [0.25, 0.75]
    found = {"position": 1e-6 * np.tile([1.0, 3.0], (4, 1)), "velocity": velocity, "contact_stress": 0.75 * stress,
             "kinetic_stress": 0.25 * stress, "fraction_rolling": np.tile([[0.0], [0.0], [0.2], [0.6]], 2)}  # fmt: skip
    forces = np.zeros((2, 4, 3))  # N, on 2 um by 5 um
    forces[..., 1], forces[..., 2] = 1e-8 * np.outer([-1.0, 0.8], side), [[3e-8], [-3e-8]]
    run = SimpleNamespace(profiles=found, header={"profiles": {"axis": "z"}, "domain": {"size": [2e-6, 5e-6]}},
                          times=1e-6 * np.array([0.0, 1.0, 2.0, 5.0]),
                          plates=lambda k: {"position": np.tile([0.0, steps[: k + 1].sum(), 1.0], (8, 1))})  # fmt: skip
    drag = SimpleNamespace(steps=steps, durations=1e-6 * np.array([0, 1, 1, 3]), headings=np.outer(side, [0.0, 1.0, 0.0]),
                           steady=np.array([False, False, True, True]))  # fmt: skip
    run.drag = drag
    data = SimpleNamespace(run=run, drag=drag, start=0, frames=4, fractions=["rolling"],
                           series={"upper_force": forces[0], "lower_force": forces[1]}, colors=STATE_COLORS)  # fmt: skip
    axes = Figure().subplots(3)
    for one, name in zip(axes, ("velocity", "stress", "states"), strict=True):
        PANELS[f"{name}_profile"].draw(one, data)
    drawn = [[*entry.get_xdata(), *entry.get_ydata()] for entry in (*axes[0].lines, *axes[1].lines)]
    wanted = ((0.25, 0.75, 1, 3), (0, 1, 0, 4), (3, 3, 1, 3), (1, 1, 1, 3), (3, 3, 0, 4), (0.8, 1, 0, 4))
    np.testing.assert_allclose(drawn, wanted, atol=1e-9)
    assert [entry.get_label() for entry in axes[1].lines[:3]] == ["normal", "shear", "plates"]
    np.testing.assert_allclose([(bar.get_width(), bar.get_y()) for bar in axes[2].patches], [(0.5, 0), (0.5, 2)], atol=1e-9)


HEIGHT, DIAMETER, SPEED = 100e-6, 10e-6, 2.0


def bed_of_points(n=500):
    rng = np.random.default_rng(1)
    return np.sort(rng.uniform(0.0, HEIGHT, n)), rng.uniform(1.0, 3.0, n)


def flow(along, angle=0.3):
    """Velocities of that size in one direction, on a common drift."""
    return along[:, None] * [math.cos(angle), math.sin(angle), 0.0] + [0.4, -0.1, 0.05]


def test_shear_zones_of_couette_flow_of_a_band_and_of_two_blocks_that_slide():
    (z, mass), rate = bed_of_points(), SPEED / HEIGHT
    low, high = (np.average(z[end], weights=mass[end]) for end in (z <= z[0] + DIAMETER, z >= z[-1] - DIAMETER))
    edges = [low + fraction * (high - low) for fraction in (EDGE, 1.0 - EDGE)]
    for angle in (0.0, 0.3, math.pi, -2.0):
        zone = shear_zone(z, flow(rate * z, angle), mass, DIAMETER)
        assert zone.rate == pytest.approx(rate, rel=1e-11)  # rounding of differences of velocities
        assert [zone.bottom, zone.top] == pytest.approx(edges, rel=1e-11)
    z, mass = bed_of_points(5000)
    bottom, top = 30e-6, 60e-6
    zone = shear_zone(z, flow(SPEED * np.clip((z - bottom) / (top - bottom), 0.0, 1.0)), mass, DIAMETER)
    # plateaus and the band are straight lines: only the neighbours of an edge are interpolated
    assert zone.rate == pytest.approx(SPEED / (top - bottom), rel=1e-9)
    assert [zone.bottom, zone.top] == pytest.approx([33e-6, 57e-6], rel=1e-9)
    z, mass = bed_of_points()
    zone = shear_zone(z, flow(np.where(z > 0.37 * HEIGHT, SPEED, 0.0)), mass, DIAMETER)
    assert zone.rate == pytest.approx(SPEED / DIAMETER, rel=1e-12)
    assert zone.top - zone.bottom < 0.1 * DIAMETER and zone.bottom == pytest.approx(0.37 * HEIGHT, rel=0.02)
    # a bed that moves as a whole has no rate, one layer no zone
    assert shear_zone(z, flow(np.zeros(len(z))), mass, DIAMETER).rate == pytest.approx(0.0, abs=1e-9)
    assert shear_zone(0.1 * z, flow(z), mass, DIAMETER) is None
    # the profile never falls and is the nearest one
    values = np.array([1.0, 3.0, 2.0, 2.0, 5.0, 4.0])
    weights = np.array([1.0, 2.0, 1.0, 1.0, 3.0, 1.0])
    pooled = [1.0, 2.5, 2.5, 2.5, 4.75, 4.75]  # means of the runs that fall, by weight
    assert rising_profile(values, weights) == pytest.approx(pooled, rel=1e-14)
