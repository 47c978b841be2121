"""Axes and designs of a sweep: values, their order, and every fault of a sweep file at once."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from thirdbody.errors import InputError
from thirdbody.studies.sweep.sweep_file import Definition, read_sweep, sweep_of_options, sweep_of_python

HEAD = 'sweep = 1\nscene = "scene.toml"\n'


def of_file(folder: Path, text: str) -> Definition:
    path = folder / "sweep.toml"
    path.write_text(HEAD + text, encoding="utf-8")
    return read_sweep(path)


def of_options(*vary: str, **options: object) -> list[dict]:
    return list(sweep_of_options("scene.toml", vary, options).points)


def faults(call) -> list[str]:
    with pytest.raises(InputError) as report:
        call()
    return str(report.value).splitlines()


def test_a_grid_combines_all_values_the_last_axis_fastest():
    points = of_options("pairs.0.friction=0.1:0.3:3", "debris.0.seed=7,8")
    assert [tuple(point.values()) for point in points] == [(0.1, 7), (0.1, 8), (0.2, 7), (0.2, 8), (0.3, 7), (0.3, 8)]


def test_values_of_an_interval_are_the_numbers_a_user_would_write():
    """Each is the nearest float to the exact value: 0.05 + 2 * 0.05 in floats is 0.15000000000000002."""
    values = [point["mu"] for point in of_options("mu=0.05:0.6:12")]
    assert values == [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6]


def test_quantities_keep_their_unit_and_whole_numbers_stay_whole():
    assert [point["load"] for point in of_options("load=1 mN:3 mN:3")] == ["1 mN", "2 mN", "3 mN"]
    assert [point["load"] for point in of_options("load=0.1 mN:10 mN:3:log")] == ["0.1 mN", "1 mN", "10 mN"]
    counts = [point["count"] for point in of_options("count=10:40:4")]
    assert counts == [10, 20, 30, 40] and all(isinstance(count, int) for count in counts)
    assert [point["x"] for point in of_options("x=0:1:3")] == [0, 0.5, 1]
    assert of_options("x=0.3:0.5:1") == [{"x": 0.3}]


def test_keys_joined_by_a_comma_get_the_same_values():
    assert of_options("pairs.0.friction,pairs.1.friction=0.1,0.2") == [
        {"pairs.0.friction": mu, "pairs.1.friction": mu} for mu in (0.1, 0.2)
    ]


def test_options_read_lists_and_texts():
    assert [point["size"] for point in of_options('size=["1 um", "2 um"], ["3 um", "4 um"]')] == [
        ["1 um", "2 um"],
        ["3 um", "4 um"],
    ]
    assert [point["level"] for point in of_options("level=mindlin,mdr")] == ["mindlin", "mdr"]
    assert [point["load"] for point in of_options("load=1 mN, 2 mN")] == ["1 mN", "2 mN"]


def test_paths_may_be_written_as_tables_and_keys_move_together(tmp_path):
    definition = of_file(
        tmp_path,
        """
        [vary]
        pairs.0.friction = {from = 0.1, to = 0.2, count = 2}
        debris.0.count = [5, 6]
        [[together]]
        "plates.upper.load" = ["1 mN", "2 mN"]
        "debris.0.seed" = [1, 2]
        """,
    )
    assert len(definition.points) == 8 and len(definition.axes) == 3
    assert definition.points[1] == {
        "pairs.0.friction": 0.1, "debris.0.count": 5, "plates.upper.load": "2 mN", "debris.0.seed": 2,
    }  # fmt: skip


def test_zip_takes_values_side_by_side(tmp_path):
    assert of_options("a=1,2,3", "b=0.1:0.3:3", design="zip") == [{"a": 1, "b": 0.1}, {"a": 2, "b": 0.2}, {"a": 3, "b": 0.3}]
    [fault] = faults(lambda: of_options("a=1,2,3", "b=1,2", design="zip"))
    assert fault.startswith("design: ") and "a 3, b 2" in fault


@pytest.mark.parametrize("design", ["sobol", "latin_hypercube"])
def test_samples_fill_the_space_of_the_axes(design):
    """One of n points in each n-th of every axis: so for a Latin hypercube, and for 2^k Sobol points."""
    points = list(
        sweep_of_python(
            {"mu": {"from": 0.1, "to": 0.9}, "load": {"from": "1 mN", "to": "1000 mN", "scale": "log"}, "seed": [1, 2]},
            {"design": design, "samples": 16},
        ).points
    )  # fmt: skip
    assert sorted(int(16 * (point["mu"] - 0.1) / 0.8) for point in points) == list(range(16))
    loads = [float(str(point["load"]).split()[0]) * {"mN": 1.0, "N": 1000.0}[str(point["load"]).split()[1]] for point in points]
    assert sorted(int(16 * math.log10(load) / 3.0) for load in loads) == list(range(16))
    assert sorted(point["seed"] for point in points) == 8 * [1] + 8 * [2]
    again = sweep_of_python({"mu": {"from": 0.1, "to": 0.9}}, {"design": design, "samples": 16, "seed": 2}).points
    assert again == sweep_of_python({"mu": {"from": 0.1, "to": 0.9}}, {"design": design, "samples": 16, "seed": 2}).points
    assert again != sweep_of_python({"mu": {"from": 0.1, "to": 0.9}}, {"design": design, "samples": 16, "seed": 3}).points


def test_options_give_sampled_intervals_too():
    points = of_options("mu=0.1:10:log", "x=0:1", design="sobol", samples=8)
    assert sorted(int(4 * (math.log10(point["mu"]) + 1.0)) for point in points) == list(range(8))
    assert sorted(int(8 * point["x"]) for point in points) == list(range(8))
    counts = [point["count"] for point in of_options("count=3:6:whole", design="sobol", samples=8)]
    assert sorted(counts) == [3, 3, 4, 4, 5, 5, 6, 6] and {type(count) for count in counts} == {int}
    [fault] = faults(lambda: of_options("count=0.5:6:whole", design="sobol", samples=8))
    assert 'scale = "whole" needs ends that are whole numbers' in fault


def test_points_come_from_a_table(tmp_path):
    (tmp_path / "points.csv").write_text("plates.upper.load [mN],pairs[0].friction,name\n1,0.2,first\n2,0.3,second\n")
    definition = of_file(tmp_path, 'points = "points.csv"')
    assert definition.points == (
        {"plates.upper.load": "1 mN", "pairs.0.friction": 0.2, "name": "first"},
        {"plates.upper.load": "2 mN", "pairs.0.friction": 0.3, "name": "second"},
    )
    (tmp_path / "points.csv").write_text("a,a,\n1,2,3\n1,2\n,2,3\n")
    report = faults(lambda: of_file(tmp_path, 'points = "points.csv"'))
    assert len(report) == 4 and all(f"points.csv:{line}: " in text for line, text in zip((1, 1, 3, 4), report, strict=True))


def test_points_come_from_a_list():
    points = [{"mu": 0.1, "seed": 1}, {"mu": 0.2, "seed": 5}]
    assert list(sweep_of_python(points, {}).points) == points


def test_all_faults_of_a_file_are_reported_at_once(tmp_path):
    report = faults(
        lambda: of_file(
            tmp_path,
            """desgn = "grid"
            keep = "some"
            [vary]
            a = {from = 0.1, to = 0.5}
            b = {from = "1 mN", to = "2 um", count = 3}
            c = {from = 0, to = 1, count = 3, scale = "log"}
            d = 5
            e = []
            f = {from = 1, too = 2, count = 3}
            """,
        )
    )
    text = "\n".join(report)
    assert (
        "sweep.toml:3:1: desgn: unknown key, did you mean 'design'?" in text and "'some' is not one of 'all', 'summary'" in text
    )
    report = faults(
        lambda: of_file(
            tmp_path,
            """[vary]
            a = {from = 0.1, to = 0.5}
            b = {from = "1 mN", to = "2 um", count = 3}
            c = {from = 0, to = 1, count = 3, scale = "log"}
            d = 5
            e = []
            f = {from = 1, too = 2, count = 3}
            [[together]]
            g = [1, 2]
            h = [1, 2, 3]
            a = [1, 2]
            """,
        )
    )
    words = {
        4: "a.count: required key is missing: the number of values",
        5: "b: '1 mN' and '2 um' are a force and a length",
        6: 'c: scale = "log" needs ends above 0',
        7: "d: expected a list of values or a table {from, to, count}, got 5",
        8: "e: expected at least one value",
        9: "f.too: unknown key, did you mean 'to'?",
    }
    for line, text in words.items():
        assert any(f"sweep.toml:{line}:" in one and text in one for one in report), (line, text, report)
    assert any("a is varied twice" in one for one in report)
    assert any("moved together, but with 2 values of g, 3 values of h" in one for one in report)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"design": "sobol"}, "samples: required key is missing"),
        ({"design": "sobol", "samples": 100}, "samples: Sobol points come in powers of two, such as 64 or 128, got 100"),
        ({"samples": 8}, "samples: only sobol and latin_hypercube designs have samples"),
        ({"design": "spiral"}, "design: 'spiral' is not one of 'grid'"),
    ],
)
def test_designs_say_what_they_lack(options, text):
    [fault] = faults(lambda: of_options("a=1,2", **options))
    assert text in fault


def test_too_many_points_are_refused_before_they_are_listed():
    [fault] = faults(lambda: of_options("a=0:1:20000", "b=0:1:20000"))
    assert "400000000 points, at most 1000000" in fault
