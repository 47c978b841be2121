"""Velocity accommodation: closed forms for one body and for a bed, the sum for any bodies, and runs of balls and flakes."""

from types import SimpleNamespace

import ensembles
import numpy as np
import pytest
from balls import BALLS, edited
from each import each

import thirdbody
from thirdbody.engine.contact_rows import AllRows
from thirdbody.engine.upper_plate import Schedule, Segment
from thirdbody.kernels import schedule as motion
from thirdbody.kernels.columns import contact_state, record
from thirdbody.kernels.columns.sides import DEBRIS, LOWER, UPPER
from thirdbody.kernels.predicates import BASINS
from thirdbody.scene.model import Scene
from thirdbody.trajectory.accommodation import accommodation, parts_of, plate_speed, transmitting_weights
from thirdbody.trajectory.accommodation_fractions import accommodation_fractions, accommodation_text, short_accommodation_text
from thirdbody.trajectory.names import ACCOMMODATION

R = 5e-6  # m
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
    world = SimpleNamespace(upper=upper, lower=0, debris_meets=meet)
    rows = SimpleNamespace(velocity=velocity, spin=spin)
    return SimpleNamespace(bodies=rows, slots=slots, body=np.arange(len(bodies)), n_bodies=len(bodies), world=world, time=1.0)


def parts(*arguments, **keys):
    return list(parts_of(accommodation(DRAG, kinematics_of(*arguments, **keys))).values())


# velocity and spin of a body between two plates, and the upper slip, lower slip and rolling that follow [V]
ONE_BODY = {
    "roller": (0.5, 0.5 / R, (0.0, 0.0, 1.0)),
    "carried by the upper plate": (1.0, 0.0, (0.0, 1.0, 0.0)),
    "left behind by the upper plate": (0.0, 0.0, (1.0, 0.0, 0.0)),
    "flake that slips on both": (0.3, 0.0, (0.7, 0.3, 0.0)),
    "roller that slips at the top": (0.4, 0.4 / R, (0.2, 0.0, 0.8)),
    "spun by nothing": (0.5, -0.1 / R, (0.6, 0.6, -0.2)),
}


@each(ONE_BODY)
def test_one_body_between_the_plates(name):
    velocity, spin, expected = ONE_BODY[name]
    found = parts([(velocity * V, spin * V)], [(0, TOP, 1e-4), (0, BOTTOM, 1e-4)])
    # the weights are 1: only sums and one product are rounded
    assert found == pytest.approx([*(V * x for x in expected), 0.0], abs=1e-13 * V)


def test_beds_are_sheared_between_the_bodies_that_pass_load_on():
    bodies = [(0.1 * V, 0.2 * V / R), (0.5 * V, 0.4 * V / R), (0.9 * V, 0.05 * V / R)]
    between = (DEBRIS, (0.0, 0.0, R))
    contacts = [(0, BOTTOM, 2e-4), (1, between, 3e-4), (2, TOP, 2e-4)]
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
    p, q = transmitting_weights(np.array([2.0, 3.0, 0.0]), np.array([2.0, 1.0, 2.0]), False)
    assert p == pytest.approx([2.0 / 3.0, 1.0 / 3.0, 0.0]) and (p == q).all()
    assert transmitting_weights(np.array([1.0, 0.0]), np.array([0.0, 1.0]), False) is None


def test_the_parts_add_up_to_the_speed_of_the_plate_for_any_bodies():
    rng = np.random.default_rng(1)
    for meet in (True, False):
        count = 40
        places = [(int(rng.integers(3)), tuple(rng.normal(0.0, R, 3))) for _ in range(90)]
        contacts = [(int(rng.integers(count)), place, rng.exponential(1e-4)) for place in places]
        found = parts(rng.normal(0.0, [V, V / R], (count, 2)), contacts, meet)
        assert sum(found) == pytest.approx(V, rel=1e-12)  # rounding of some hundred terms of the size of V
        assert meet or found[3] == 0.0


def test_a_plate_that_turns_still_has_the_speed_with_which_it_came():
    stroke = Segment(0.0, motion.TRIANGLE, 0.0, 10e-6, 5.0)  # 10 um, 5 Hz: 100 um/s
    state = SimpleNamespace(time=0.1, world=SimpleNamespace(upper=SimpleNamespace(schedule=Schedule(x=(stroke,)))))
    assert plate_speed(state, DRAG) == pytest.approx(100e-6)
    state.time = 0.15
    assert plate_speed(state, DRAG) == pytest.approx(-100e-6)


def test_shares_in_words_leave_nothings_out():
    fractions = {"upper_slip": 0.321, "lower_slip": -0.02, "rolling": 0.699, "shear": 0.0}
    text = "70 % rolling, 32 % slip at the upper plate, \u22122 % slip at the lower plate"
    assert accommodation_text(fractions).replace("\u00a0", " ") == text
    assert short_accommodation_text(fractions).replace("\u00a0", " ") == "70 % rolling, 30 % slip"


RAMP = [{"ramp": "0.5 m/s", "duration": "1 us"}, {"velocity": "0.5 m/s"}]
FLAKE = [{"center": [f"{x} um", f"{y} um", "0 um"], "radius": "2 um"} for x, y in ((-3, 0), (3, 0), (0, 0), (0, 3), (0, -3))]


def run_of(folder, **changes):
    smooth = {"plates.upper.motion": {"x": RAMP}, "plates.upper.damping": "7e-4 kg/s", "solver.distance": "2 um"}
    scene = Scene.parse(BALLS).with_settings(smooth | {"output.every": "0.2 um"} | changes)
    return thirdbody.run(scene, out=folder, progress=False)


def check_sum(run):
    """In every interval after the ramp the parts add up to the path of the plate over its time."""
    total = sum(run.series[name] for name in ACCOMMODATION)
    means = np.diff(run.series["displacement"]) / np.diff(run.times)
    settled = run.series["distance"][:-1] > 0.25e-6
    # time and displacement of an output have some 1e-13 of rounding
    assert settled.sum() > 5 and total[1:][settled] == pytest.approx(means[settled], rel=1e-9)


def test_balls_only_roll(tmp_path):
    with run_of(tmp_path / "balls") as run:
        check_sum(run)
        assert accommodation_fractions(run)["rolling"] == pytest.approx(1.0, abs=0.01)  # elastic creep and the ramp's vibration
        assert run.summary()["accommodation"] == accommodation_fractions(run)
        assert run.units["accommodation_rolling"] == "m/s"


def test_flakes_only_slip(tmp_path):
    flakes = {"debris.0": {"material": "steel", "kind": "spheres", "count": 4, "shape": FLAKE, "seed": 1}}
    with run_of(tmp_path / "flakes", **flakes) as run:
        check_sum(run)
        fractions = accommodation_fractions(run)
        assert fractions["upper_slip"] + fractions["lower_slip"] == pytest.approx(1.0, abs=0.01)
        assert "slip" in run.plot(panels=["accommodation"]).axes[0].get_title(loc="left")


def test_a_plate_at_rest_has_no_parts(tmp_path):
    text = edited(BALLS, ('motion = {x = {velocity = "0.5 m/s"}}\n', ""), ('distance = "0.1 um"', 'duration = "0.1 us"'))
    with thirdbody.run(Scene.parse(edited(text, ("0.05 um", "1 us"))), out=tmp_path / "rest", progress=False) as run:
        assert not set(ACCOMMODATION) & set(run.series) and "accommodation" not in run.summary()


def test_an_implicit_stroke_has_the_speed_of_its_sine(tmp_path):
    length, frequency = 2e-6, 5.0
    text = edited(ensembles.SCENE, ('distance = "0.1 um"', 'duration = "0.2 s"'), ("0.05 um", "8 ms"))
    text = edited(text, ('velocity = "10 mm/s"', 'stroke = "2 um", frequency = "5 Hz"'))
    with thirdbody.run(Scene.parse(text), out=tmp_path / "stroke", progress=False) as run:
        u = run.series["displacement"]
        speed = 2.0 * np.pi * frequency * np.sqrt(np.maximum(u * (length - u), 0.0))  # u = (length/2) (1 - cos(2 pi frequency t))
        total = sum(run.series[name] for name in ACCOMMODATION)
        # near the turns the root magnifies rounding of the displacement, 1e-16 of the length, to 1e-8
        loaded = np.isfinite(total)
        assert loaded[1:].all() and abs(total[loaded]) == pytest.approx(speed[loaded], abs=1e-6 * speed.max())
        assert np.nanmin(total) < 0.0
        assert run.summary()["accommodation"]["shear"] == 0.0
