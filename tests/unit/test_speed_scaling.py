"""The same drive at another speed: the same path in another time; a bed at the speed of a given inertial number."""

import itertools
import json
import math

import pytest
from each import each
from steel import scene_text
from thirdbody.api import run
from thirdbody.assembly.bed import Bed
from thirdbody.assembly.schedule import schedule
from thirdbody.assembly.simulation import build
from thirdbody.engine.upper_plate import at_time
from thirdbody.errors import InputError
from thirdbody.report.scene_check import Check, check_report
from thirdbody.runner.outlook import speed_report
from thirdbody.scene.model import Scene
from thirdbody.scene.speed import at_speed

BALL = '[[debris]]\nmaterial = "steel"\nkind = "spheres"\nradius = "5 um"\n'
AT = 'positions = [["50 um", "50 um", "5 um"]]'
SOLVER = '{length}\nsettle = "3 us"\ntime_step = "1 ns"'
TEXT = scene_text(BALL + AT, '["100 um", "100 um"]', "{upper}", solver=SOLVER, every="{every}")
SETTLED = 3e-6
TIMES = [0.0, 1e-7, 0.5e-6, 1e-6, 1.7e-6, 2.5e-6, 4e-6]
MOTIONS = {
    "velocity": '{velocity = "1 m/s"}', "reversal": '[{velocity = "1 m/s", duration = "1 us"}, {velocity = "-2 m/s"}]',
    "ramp": '{ramp = "2 m/s", duration = "1 us"}',
    "pause": '[{ramp = "2 m/s", duration = "0.5 us"}, {pause = "0.5 us"}, {velocity = "1 m/s"}]',
    "sine": '{stroke = "1 um", frequency = "300 kHz"}',
    "triangle": '[{stroke = "1 um", frequency = "500 kHz", shape = "triangle", cycles = 1.5}, {velocity = "1 m/s"}]',
    "table": '[{table = "path.csv"}, {velocity = "-1 m/s"}]',
}  # fmt: skip


@pytest.fixture
def read(tmp_path):
    (tmp_path / "path.csv").write_text("time (us), displacement (um)\n0, 0\n1, 0.5\n2, -0.5\n")
    (tmp_path / "load.csv").write_text("time (us), load (mN)\n0, 2\n1, 3\n2, 1\n")

    def scene(upper, length='duration = "4 us"', every="1 us"):
        return Scene.parse(TEXT.format(upper=upper, length=length, every=every), folder=tmp_path)

    return scene


def test_the_plate_takes_the_same_path_in_another_time_and_distances_stay(read):
    for motion, axis, factor in itertools.product(MOTIONS.values(), "xy", (1.0 / 3.0, 84.0)):
        given = read(f'load = "2 mN"\nmotion = {{{axis} = {motion}}}')
        before, after = schedule(given, SETTLED), schedule(at_speed(given, factor), SETTLED)
        for t in TIMES:
            there = before.displacement_at(SETTLED + t)
            # sums and products of a few numbers near 1 um: rounding only, of the time since the start, too
            bound = pytest.approx(there, rel=1e-9, abs=1e-6 * 1e-9 * (1.0 + factor))
            assert after.displacement_at(SETTLED + t / factor) == bound, (motion, axis, factor)
        assert after.top_speed() == pytest.approx(factor * before.top_speed(), rel=1e-12)
    # a table goes on from where the plate is, and a ramp from its last slope
    motion = f'[{{velocity = "1 m/s", duration = "1 us"}}, {MOTIONS["table"][1:].split("}")[0]}}}, {MOTIONS["ramp"]}]'
    made = schedule(read(f'load = "2 mN"\nmotion = {{x = {motion}}}'), 0.0)
    assert [made.displacement_at(t * 1e-6)[0] for t in (2, 3, 4, 5)] == pytest.approx([1.5e-6, 0.5e-6, 1e-6, 3e-6], rel=1e-9)
    # a load stays at its place on the path
    for loading in ('[{load = "4 mN", duration = "1 us"}, {pause = "0.5 us"}, {load = "1 mN"}]', '{table = "load.csv"}'):
        given, factor = read(f'load = "2 mN"\nloading = {loading}\nmotion = {{x = {{velocity = "1 m/s"}}}}'), 7.0
        before, after = schedule(given, SETTLED).load, schedule(at_speed(given, factor), SETTLED).load
        for t in TIMES:
            assert at_time(after, SETTLED + t / factor) == pytest.approx(at_time(before, SETTLED + t), rel=1e-9)
    moving = 'load = "2 mN"\nmotion = {x = {velocity = "1 m/s"}}'
    timed = at_speed(read(moving), 4.0)
    assert (timed.solver.duration, timed.output.every) == (1e-6, 0.25e-6)
    spaced = at_speed(read(moving, 'distance = "4 um"', "1 um"), 4.0)
    assert (spaced.solver.distance, spaced.solver.duration, spaced.output.every) == (4e-6, None, 1e-6)
    assert at_speed(read('gap = "20 um"\nclosing = "1 m/s"'), 3.0).plates.upper.closing == 3.0
    assert timed.solver.settle == spaced.solver.settle == SETTLED and timed.solver.time_step == 1e-9
    # the scene of another speed is a scene
    given = read(f'load = "2 mN"\nmotion = {{x = {MOTIONS["table"]}, y = {MOTIONS["triangle"]}}}')
    scaled = at_speed(given, 2.5)
    again = Scene.parse(scaled.to_toml(), folder=given.beside(""))
    assert again == scaled and again.plates.upper.motion.x[0].speed == 2.5
    assert at_speed(given, 1.0) == given
    assert scaled.fault(("solver",), "x") == given.fault(("solver",), "x")


BED = scene_text(
    BALL + 'count = 60\nseed = 2\nplacement = "dense"', '["40 um", "25 um"]',
    'pressure = "2.5 MPa"\nmotion = {x = {velocity = "1 mm/s"}}',
    solver='distance = "0.2 um"\nsettle = "0.2 us"\ninertial_number = 0.05', every="0.05 um",
)  # fmt: skip
# 60 balls of 10 um on 1000 um2: 52 um at a solid fraction of 0.6, 5.2 layers
HEIGHT = 60 * math.pi / 6.0 * 1e-15 / 0.6 / 1000e-12
INERTIAL_TIME = 10e-6 * math.sqrt(7850.0 / 2.5e6)


def scene(**settings) -> Scene:
    return Scene.parse(BED, "bed.toml").with_settings({key.replace("__", "."): value for key, value in settings.items()})


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    return run(scene(), tmp_path_factory.mktemp("scaled") / "run", 1, False)


def test_the_estimate_is_that_of_the_formulas():
    bed = build(scene()).bed
    number = 1e-3 / HEIGHT * INERTIAL_TIME
    assert (bed.height, bed.pressure, bed.diameter) == pytest.approx((HEIGHT, 2.5e6, 10e-6), rel=1e-12)  # rounding
    assert bed.inertial_number == pytest.approx(number, rel=1e-12)
    assert bed.softness == pytest.approx((210e9 / (2.0 * (1.0 - 0.3**2)) / 2.5e6) ** (2.0 / 3.0), rel=1e-12)
    # on 1e-9 m2 the load of every patch; the load of the plate and a preload of every spring
    springs = {"plates.upper.support": "foundation", "plates.upper.stiffness": "1 N/m", "plates.upper.preload": "0.1 mN"}
    for more, pressure in (({}, 6e7), (springs, 7e6)):
        bed = build(scene().with_settings(NO_PRESSURE | EACH | more | {"solver.inertial_number": None})).bed
        assert bed.pressure == pytest.approx(pressure, rel=1e-12)
    # a high bed shears in ten diameters and a short stroke within itself
    bed = Bed(1e-3, 1e6, 1e4, 1e-5, 2e-5, 1e11, 1.0, math.inf)
    assert bed.shear_rate == pytest.approx(1.0 / 1e-4)
    assert bed._replace(stroke=2e-6).shear_rate == pytest.approx(1.0 / 2e-6)
    assert bed.inertial_number == pytest.approx(1e4 * 1e-5 * 0.1)


def test_the_speed_is_that_of_the_wanted_inertial_number_and_never_above():
    built = build(scene())
    scale, number = built.speed_scale, built.bed.inertial_number
    assert scale.requested == 1e-3 and scale.computed == built.schedule.top_speed() == scale.factor * 1e-3
    assert scale.factor == float(f"{scale.factor:.1e}")  # two digits
    assert 0.05 / 1.1 < scale.inertial_number == scale.factor * number <= 0.05
    lowered = build(scene(plates__upper__motion__x__velocity="100 m/s")).speed_scale
    assert lowered.factor < 1.0 and 0.05 / 1.1 < lowered.inertial_number <= 0.05
    assert built.planned_distance == 0.2e-6
    assert built.scene_time(built.planned_time) - built.settle == pytest.approx(0.2e-6 / 1e-3, rel=1e-9)
    # a stroke keeps its length and changes its frequency
    stroke = {"stroke": "0.1 um", "frequency": "100 Hz"}
    built = build(scene(plates__upper__motion__x=stroke, solver__duration="0.02 s", output__every="2 ms"))
    scale, segment = built.speed_scale, built.schedule.x[0]
    assert segment.b == 0.1e-6 and segment.c == pytest.approx(2.0 * math.pi * 100.0 * scale.factor)
    assert built.scene.solver.duration == pytest.approx(0.02 / scale.factor)
    # a rate of v over the stroke, which is far shorter than the bed is high
    assert scale.inertial_number == pytest.approx(math.pi * 100.0 * scale.factor * INERTIAL_TIME)


def test_check_prints_both_speeds_and_both_wall_times():
    built = build(scene())
    report = check_report(built)
    scale = report["speed_scale"]
    assert scale["target"] == 0.05 and scale["requested_wall_time"] > 2.0 * report["estimated_wall_time"]
    assert report["bed"]["inertial_number"] == pytest.approx(scale["inertial_number"])
    assert report["bed"]["shear_rate"] == pytest.approx(scale["factor"] * built.bed.shear_rate)
    # steps take 4 of 10 s and are so many times as many at the speed asked for
    longer = built.scene_time(built.planned_time) / built.planned_time
    assert speed_report(built, 10.0, 4.0)["requested_wall_time"] == pytest.approx(6.0 + 4.0 * longer)
    assert report["scene"]["plates"]["upper"]["motion"] == {"x": {"velocity": "1 mm/s"}}  # the scene as it was given
    text = str(Check(report))
    assert f"speed: 1 mm/s requested, computed at {scale['text'].split(' at ')[1]}; about" in text and " instead of " in text
    assert "debris of 5.2 layers of 10 um (median diameter), inertial number 0.0" in text
    assert "not quasi-static" in text and json.dumps(report["bed"])
    # a fast bed gives a warning with the remedy
    fast = build(scene(solver__inertial_number=None, plates__upper__motion__x__velocity="10 m/s"))
    warning = next(text for text in fast.warnings if "not quasi-static: its inertial number" in text)
    assert "solver.inertial_number = 0.001 would run at 93" in warning and "times as many steps" in warning
    # an unscaled speed is computed bit for bit as it was given
    assert fast.scene is fast.requested and fast.time_scale == 1.0 and fast.scene_time(1.0) == 1.0
    slow = build(scene(solver__inertial_number=None))
    assert not any("inertial number" in text for text in slow.warnings) and slow.speed_scale is None
    # the number has a range
    for number in (0.0, -1e-3, 1e-9, 0.5, "1 mm/s", True):
        with pytest.raises(InputError, match="inertial_number"):
            scene(solver__inertial_number=number)


def test_a_run_keeps_both_times(finished):
    series, summary = finished.series, finished.summary()
    scale = summary["speed_scale"]
    # the first frame is that of the start, the second that of the end of settling
    elapsed, given = (series[name][-1] - series[name][1] for name in ("time", "scene_time"))
    assert given == pytest.approx(scale["factor"] * elapsed, rel=1e-9)  # rounding
    assert given == pytest.approx((series["distance"][-1] - series["distance"][1]) / 1e-3, rel=1e-9)
    assert series["scene_time"][0] == series["time"][0] == 0.0
    assert summary["scene_time"] == series["scene_time"][-1] and finished.units["scene_time"] == "s"
    assert finished.header["speed_scale"]["text"] == scale["text"]
    assert Scene.parse(finished.scene_text) == scene()


NO_PRESSURE = {"plates.upper.pressure": None}
EACH = {"plates.upper.support": "load_per_particle", "plates.upper.load": "1 mN"}
REFUSED = {
    "no motion": ({"plates.upper.motion": None, "solver.duration": "1 us", "output.every": "1 us"}, "here it rests"),
    "implicit": ({"solver.integrator": "implicit"}, "the implicit integrator takes slow motion as it is"),
    "no contact": ({"contact.debris_contact": "none"}, "whose bodies meet each other"),
    "gap": (NO_PRESSURE | {"plates.upper.gap": "80 um"}, "needs a pressure"),
    "patches": (NO_PRESSURE | EACH, "each patch of support = 'load_per_particle' has a mass"),
    "two layers": ({"debris.0.count": 24}, "this debris fills 2.1"),
    "no load": ({"plates.upper.loading": {"load": "0 N", "duration": "1 us"}}, "needs a load at all times"),
    "drag in time": ({"effects.damping": {"rate": "1e4 1/s"}}, "would change what damping does, which acts in time"),
    "heavy plate": ({"plates.upper.mass": "1 kg"}, "the plate would follow the bed too slowly"),
    "dashpot": ({"plates.upper.damping": "1 kg/s"}, "the dashpot would carry"),
}


@each(REFUSED)
def test_a_speed_that_would_change_the_result_is_refused(case):
    settings, words = REFUSED[case]
    with pytest.raises(InputError) as error:
        build(scene().with_settings(settings))
    (fault,) = error.value.faults
    assert words in fault.message and fault.key.startswith(("solver.inertial_number", "plates.upper."))
    assert error.value.exit_code == 3
