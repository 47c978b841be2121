"""The same drive at another speed: every kind of motion and load takes the same path in another time."""

import math

import pytest
from steel import STEEL

from thirdbody.assembly.schedule import schedule
from thirdbody.engine.upper_plate import at_time
from thirdbody.scene.model import Scene
from thirdbody.scene.speed_scale import at_speed

TEXT = (
    STEEL
    + """\
[[debris]]
material = "steel"
kind = "spheres"
radius = "5 um"
positions = [["50 um", "50 um", "5 um"]]
[domain]
size = ["100 um", "100 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
{upper}
[solver]
{length}
settle = "3 us"
time_step = "1 ns"
[output]
every = "{every}"
"""
)

SETTLED = 3e-6
TIMES = [0.0, 1e-7, 0.5e-6, 1e-6, 1.7e-6, 2.5e-6, 4e-6]

MOTIONS = {
    "velocity": '{velocity = "1 m/s"}',
    "reversal": '[{velocity = "1 m/s", duration = "1 us"}, {velocity = "-2 m/s"}]',
    "ramp": '{ramp = "2 m/s", duration = "1 us"}',
    "pause": '[{ramp = "2 m/s", duration = "0.5 us"}, {pause = "0.5 us"}, {velocity = "1 m/s"}]',
    "sine": '{stroke = "1 um", frequency = "300 kHz"}',
    "triangle": '[{stroke = "1 um", frequency = "500 kHz", shape = "triangle", cycles = 1.5}, {velocity = "1 m/s"}]',
    "table": '[{table = "path.csv"}, {velocity = "-1 m/s"}]',
}
LOADS = {"load": '[{load = "4 mN", duration = "1 us"}, {pause = "0.5 us"}, {load = "1 mN"}]', "table": '{table = "load.csv"}'}


@pytest.fixture
def read(tmp_path):
    """Return a reader of the scene above; its tables lie beside it."""
    (tmp_path / "path.csv").write_text("time (us), displacement (um)\n0, 0\n1, 0.5\n2, -0.5\n")
    (tmp_path / "load.csv").write_text("time (us), load (mN)\n0, 2\n1, 3\n2, 1\n")

    def scene(upper: str, length: str = 'duration = "4 us"', every: str = "1 us") -> Scene:
        return Scene.parse(TEXT.format(upper=upper, length=length, every=every), folder=tmp_path)

    return scene


@pytest.mark.parametrize("factor", [1.0 / 3.0, 84.0])
@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_the_plate_takes_the_same_path_in_another_time(read, motion, axis, factor):
    scene = read(f'load = "2 mN"\nmotion = {{{axis} = {motion}}}')
    before, after = schedule(scene, SETTLED), schedule(at_speed(scene, factor), SETTLED)
    for t in TIMES:
        there = before.displacement_at(SETTLED + t)
        # sums and products of a few numbers near 1 um: rounding only, of the time since the start, too
        assert after.displacement_at(SETTLED + t / factor) == pytest.approx(there, rel=1e-9, abs=1e-6 * 1e-9 * (1.0 + factor))
    assert after.top_speed() == pytest.approx(factor * before.top_speed(), rel=1e-12)


@pytest.mark.parametrize("loading", LOADS.values(), ids=LOADS)
def test_a_load_stays_at_its_place_on_the_path(read, loading):
    scene, factor = read(f'load = "2 mN"\nloading = {loading}\nmotion = {{x = {{velocity = "1 m/s"}}}}'), 7.0
    before, after = schedule(scene, SETTLED).load, schedule(at_speed(scene, factor), SETTLED).load
    for t in TIMES:
        assert at_time(after, SETTLED + t / factor) == pytest.approx(at_time(before, SETTLED + t), rel=1e-9)


def test_lengths_in_time_are_divided_and_distances_stay(read):
    moving = 'load = "2 mN"\nmotion = {x = {velocity = "1 m/s"}}'
    timed = at_speed(read(moving), 4.0)
    assert (timed.solver.duration, timed.output.every) == (1e-6, 0.25e-6)
    spaced = at_speed(read(moving, 'distance = "4 um"', "1 um"), 4.0)
    assert (spaced.solver.distance, spaced.solver.duration, spaced.output.every) == (4e-6, None, 1e-6)
    assert timed.solver.settle == spaced.solver.settle == SETTLED and timed.solver.time_step == 1e-9


def test_a_gap_closes_at_another_speed(read):
    scene = read('gap = "20 um"\nclosing = "1 m/s"')
    assert at_speed(scene, 3.0).plates.upper.closing == 3.0


def test_the_scene_of_another_speed_is_a_scene(read):
    scene = read(f'load = "2 mN"\nmotion = {{x = {MOTIONS["table"]}, y = {MOTIONS["triangle"]}}}')
    scaled = at_speed(scene, 2.5)
    again = Scene.parse(scaled.to_toml(), folder=scene.beside(""))
    assert again == scaled and again.plates.upper.motion.x[0].speed == 2.5
    assert at_speed(scene, 1.0) == scene
    assert scaled.fault(("solver",), "x") == scene.fault(("solver",), "x")


@pytest.mark.parametrize("factor", [0.0, -1.0, math.inf, math.nan])
def test_a_factor_is_positive(read, factor):
    with pytest.raises(ValueError, match="must be greater than 0"):
        at_speed(read('load = "2 mN"'), factor)
