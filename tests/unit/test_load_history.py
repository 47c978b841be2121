"""Loads of the upper plate that change: what a scene may say, and the schedule that comes of it."""

from __future__ import annotations

import pytest
from steel import STEEL

from thirdbody.assembly.schedule import schedule
from thirdbody.errors import InputError
from thirdbody.scene.model import Scene

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
duration = "1 us"
[output]
every = "1 us"
"""
)


def read(loading: str, held: str = 'load = "2 mN"') -> Scene:
    return Scene.parse(TEXT.format(upper=f"{held}\nloading = {loading}"))


def factors(scene: Scene, start: float, times: list[float]) -> list[float]:
    """The load over the first one at these times after settling, s."""
    axis = schedule(scene, start).load
    return [[piece for piece in axis if piece.start <= start + t][-1].value(start + t) for t in times]


STAGES = '[{pause = "1 us"}, {load = "0 N", duration = "2 us"}, {pause = "1 us"}, {load = "20 N"}]'


def test_stages_follow_each_other_and_the_last_load_stays():
    times = [0.0, 0.9e-6, 2e-6, 3.5e-6, 3.999e-6, 4e-6, 1.0]
    # straight lines between numbers of a few digits: rounding only
    assert factors(read(STAGES), 3e-6, times) == pytest.approx([1.0, 1.0, 0.5, 0.0, 0.0, 1e4, 1e4], rel=1e-9, abs=1e-9)


def test_before_the_debris_has_settled_the_load_is_the_first_one():
    axis = schedule(read(STAGES), 3e-6).load
    assert axis[0].start == 0.0 and axis[0].value(2.9e-6) == 1.0


@pytest.mark.parametrize(
    ("start", "end", "largest"),
    [(0.0, 9.9, 1e4), (0.0, 3.5e-6, 1.0), (2e-6, 3.9e-6, 0.5), (3.1e-6, 3.9e-6, 0.0), (3e-6, 4e-6, 1e4)],
)
def test_largest_load_between_two_times(start, end, largest):
    """What the explicit time step must foresee: also a jump just ahead."""
    found = schedule(read(STAGES), 0.0).largest_load(start, end)
    assert found == pytest.approx(largest, rel=1e-9, abs=1e-9)


def test_a_table_of_loads(tmp_path):
    (tmp_path / "load.csv").write_text("time (us), load (mN)\n0, 2\n1, 4\n3, 0\n")
    path = tmp_path / "scene.toml"
    path.write_text(TEXT.format(upper='load = "2 mN"\nloading = {table = "load.csv"}'))
    assert factors(Scene.load(path), 0.0, [0.5e-6, 1e-6, 2e-6, 5e-6]) == pytest.approx([1.5, 2.0, 1.0, 0.0], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("time (us), displacement (um)\n0, 0\n1, 1\n", "expected 'load (unit)'"),
        ("time (us), load (um)\n0, 0\n1, 1\n", "expected a force"),
        ("time (us), load (mN)\n0, 1\n1, -1\n", "line 3: a load is never negative"),
        ("time (us), load (mN)\n1, 1\n2, 1\n", "the first row must be time 0"),
        ("time (us), load (mN)\n0, 1\n0, 2\n", "times must grow"),
        ("time (us), load (mN)\n0, 1\n1, nan\n", "not a finite number"),
        ("time (us), load (mN)\n0, 1\n", "at least two rows"),
    ],
)
def test_a_wrong_table_is_reported_with_its_line(tmp_path, rows, message):
    (tmp_path / "load.csv").write_text(rows)
    path = tmp_path / "scene.toml"
    path.write_text(TEXT.format(upper='load = "2 mN"\nloading = {table = "load.csv"}'))
    with pytest.raises(InputError, match="plates.upper.loading.table") as caught:
        schedule(Scene.load(path), 0.0)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("loading", "message"),
    [
        ('{load = "-1 N"}', "plates.upper.loading.load"),
        ('{load = "1 um"}', "expected a force"),
        ('[{lode = "1 N"}]', "did you mean 'load'"),
        ("[]", "the list of stages is empty"),
        ('[{load = "1 N", duration = "0 s"}]', "duration"),
        ("3", "expected a table such as"),
    ],
)
def test_wrong_loads_are_refused(loading, message):
    with pytest.raises(InputError) as caught:
        read(loading)
    assert message in str(caught.value)


def test_a_plate_at_a_gap_has_no_load_to_change():
    with pytest.raises(InputError, match="plates.upper.loading: changes a load"):
        read('{load = "1 N"}', 'gap = "20 um"')


def test_loads_survive_writing_and_reading():
    scene = read(STAGES)
    assert Scene.parse(scene.to_toml()).plates.upper == scene.plates.upper
