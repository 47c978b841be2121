"""Loads of the upper plate that change: what a scene may say, and the schedule that comes of it."""

import pytest
from steel import STEEL

from thirdbody.assembly.schedule import schedule
from thirdbody.errors import InputError
from thirdbody.scene.model import Scene

TEXT = (
    STEEL
    + """[[debris]]\nmaterial = "steel"\nkind = "spheres"\nradius = "5 um"\npositions = [["50 um", "50 um", "5 um"]]
[domain]\nsize = ["100 um", "100 um"]\n[plates.lower]\nmaterial = "steel"\n[plates.upper]\nmaterial = "steel"
{upper}\n[solver]\nduration = "1 us"\n[output]\nevery = "1 us"\n"""
)


def read(loading, held='load = "2 mN"'):
    return Scene.parse(TEXT.format(upper=f"{held}\nloading = {loading}"))


def factors(scene, start, times):
    """The load over the first one at these times after settling, s."""
    axis = schedule(scene, start).load
    return [[piece for piece in axis if piece.start <= start + t][-1].value(start + t) for t in times]


STAGES = '[{pause = "1 us"}, {load = "0 N", duration = "2 us"}, {pause = "1 us"}, {load = "20 N"}]'


def test_stages_follow_each_other_and_the_last_load_stays():
    times = [0.0, 0.9e-6, 2e-6, 3.5e-6, 3.999e-6, 4e-6, 1.0]
    # straight lines between numbers of a few digits: rounding only
    assert factors(read(STAGES), 3e-6, times) == pytest.approx([1.0, 1.0, 0.5, 0.0, 0.0, 1e4, 1e4], rel=1e-9, abs=1e-9)
    # before the debris has settled the load is the first one
    axis = schedule(read(STAGES), 3e-6).load
    assert axis[0].start == 0.0 and axis[0].value(2.9e-6) == 1.0


def test_largest_load_between_two_times():
    # what the explicit time step must foresee: also a jump just ahead
    for start, end, largest in (
        (0.0, 9.9, 1e4),
        (0.0, 3.5e-6, 1.0),
        (2e-6, 3.9e-6, 0.5),
        (3.1e-6, 3.9e-6, 0.0),
        (3e-6, 4e-6, 1e4),
    ):
        assert schedule(read(STAGES), 0.0).largest_load(start, end) == pytest.approx(largest, rel=1e-9, abs=1e-9)


def table_scene(folder, rows):
    (folder / "load.csv").write_text(rows)
    (folder / "scene.toml").write_text(TEXT.format(upper='load = "2 mN"\nloading = {table = "load.csv"}'))
    return Scene.load(folder / "scene.toml")


def test_a_table_of_loads_right_and_wrong(tmp_path):
    scene = table_scene(tmp_path, "time (us), load (mN)\n0, 2\n1, 4\n3, 0\n")
    assert factors(scene, 0.0, [0.5e-6, 1e-6, 2e-6, 5e-6]) == pytest.approx([1.5, 2.0, 1.0, 0.0], rel=1e-9, abs=1e-12)
    for rows, message in (
        ("time (us), displacement (um)\n0, 0\n1, 1\n", "expected 'load (unit)'"),
        ("time (us), load (um)\n0, 0\n1, 1\n", "expected a force"),
        ("time (us), load (mN)\n0, 1\n1, -1\n", "line 3: a load is never negative"),
        ("time (us), load (mN)\n1, 1\n2, 1\n", "the first row must be time 0"),
        ("time (us), load (mN)\n0, 1\n0, 2\n", "times must grow"),
        ("time (us), load (mN)\n0, 1\n1, nan\n", "not a finite number"),
        ("time (us), load (mN)\n0, 1\n", "at least two rows"),
    ):
        with pytest.raises(InputError, match="plates.upper.loading.table") as caught:
            schedule(table_scene(tmp_path, rows), 0.0)
        assert message in str(caught.value)


def test_wrong_loads_are_refused():
    for loading, message in (
        ('{load = "-1 N"}', "plates.upper.loading.load"),
        ('{load = "1 um"}', "expected a force"),
        ('[{lode = "1 N"}]', "did you mean 'load'"),
        ("[]", "the list of stages is empty"),
        ('[{load = "1 N", duration = "0 s"}]', "duration"),
        ("3", "expected a table such as"),
    ):
        with pytest.raises(InputError) as caught:
            read(loading)
        assert message in str(caught.value)
    with pytest.raises(InputError, match="plates.upper.loading: changes a load"):
        read('{load = "1 N"}', 'gap = "20 um"')


def test_loads_survive_writing_and_reading():
    scene = read(STAGES)
    assert Scene.parse(scene.to_toml()).plates.upper == scene.plates.upper
