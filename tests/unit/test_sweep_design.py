"""A sweep: values and order of its axes, every fault of its file at once; pictures and data frames of made-up results."""

import math

import numpy as np
import pytest
from balls import BALLS
from thirdbody.errors import InputError, UsageError
from thirdbody.palette import STATE_COLORS
from thirdbody.scene.model import Scene
from thirdbody.studies.folder import average, save_plan
from thirdbody.studies.plan import make_plan
from thirdbody.studies.point import DONE, FAILED, PointResult, write_result
from thirdbody.studies.sweep_file import read_sweep, sweep_of_options, sweep_of_python
from thirdbody.sweeps import Sweep


def of_file(folder, text):
    path = folder / "sweep.toml"
    path.write_text('sweep = 1\nscene = "scene.toml"\n' + text, encoding="utf-8")
    return read_sweep(path)


def of_options(*vary, **options):
    return list(sweep_of_options("scene.toml", vary, options).points)


def faults(call):
    with pytest.raises(InputError) as report:
        call()
    return str(report.value).splitlines()


def test_a_grid_combines_all_values_the_last_axis_fastest():
    points = of_options("pairs.0.friction=0.1:0.3:3", "debris.0.seed=7,8")
    assert [tuple(point.values()) for point in points] == [(0.1, 7), (0.1, 8), (0.2, 7), (0.2, 8), (0.3, 7), (0.3, 8)]
    # keys joined by a comma get the same values
    joined = [{"pairs.0.friction": mu, "pairs.1.friction": mu} for mu in (0.1, 0.2)]
    assert of_options("pairs.0.friction,pairs.1.friction=0.1,0.2") == joined
    points = [{"mu": 0.1, "seed": 1}, {"mu": 0.2, "seed": 5}]
    assert list(sweep_of_python(points, {}).points) == points
    [fault] = faults(lambda: of_options("a=0:1:20000", "b=0:1:20000"))
    assert "400000000 points, at most 1000000" in fault
    # Each is the nearest float to the exact value: 0.05 + 2 * 0.05 in floats is 0.15000000000000002.
    values = [point["mu"] for point in of_options("mu=0.05:0.6:12")]
    assert values == [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6]
    # quantities keep their unit and whole numbers stay whole
    for given, values in (
        ("load=1 mN:3 mN:3", ["1 mN", "2 mN", "3 mN"]), ("load=0.1 mN:10 mN:3:log", ["0.1 mN", "1 mN", "10 mN"]),
        ("x=0:1:3", [0, 0.5, 1]), ("x=0.3:0.5:1", [0.3]), ("level=mindlin,mdr", ["mindlin", "mdr"]),
        ("load=1 mN, 2 mN", ["1 mN", "2 mN"]),
        ('size=["1 um", "2 um"], ["3 um", "4 um"]', [["1 um", "2 um"], ["3 um", "4 um"]]),
    ):  # fmt: skip
        assert [value for point in of_options(given) for value in point.values()] == values, given
    counts = [point["count"] for point in of_options("count=10:40:4")]
    assert counts == [10, 20, 30, 40] and all(isinstance(count, int) for count in counts)


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
    # zip takes values side by side
    assert of_options("a=1,2,3", "b=0.1:0.3:3", design="zip") == [{"a": 1, "b": 0.1}, {"a": 2, "b": 0.2}, {"a": 3, "b": 0.3}]
    [fault] = faults(lambda: of_options("a=1,2,3", "b=1,2", design="zip"))
    assert fault.startswith("design: ") and "a 3, b 2" in fault
    # designs say what they lack
    for options, text in (
        ({"design": "sobol"}, "samples: required key is missing"),
        ({"design": "sobol", "samples": 100}, "samples: Sobol points come in powers of two, such as 64 or 128, got 100"),
        ({"samples": 8}, "samples: only sobol and latin_hypercube designs have samples"),
        ({"design": "spiral"}, "design: 'spiral' is not one of 'grid'"),
    ):
        [fault] = faults(lambda options=options: of_options("a=1,2", **options))
        assert text in fault


def test_samples_fill_the_space_of_the_axes():
    """One of n points in each n-th of every axis: so for a Latin hypercube, and for 2^k Sobol points."""
    mu = {"mu": {"from": 0.1, "to": 0.9}}
    vary = mu | {"load": {"from": "1 mN", "to": "1000 mN", "scale": "log"}, "seed": [1, 2]}
    for design in ("sobol", "latin_hypercube"):
        points = list(sweep_of_python(vary, {"design": design, "samples": 16}).points)
        assert sorted(int(16 * (point["mu"] - 0.1) / 0.8) for point in points) == list(range(16))
        loads = [point["load"].split() for point in points]
        loads = [float(number) * {"mN": 1.0, "N": 1000.0}[unit] for number, unit in loads]
        assert sorted(int(16 * math.log10(load) / 3.0) for load in loads) == list(range(16))
        assert sorted(point["seed"] for point in points) == 8 * [1] + 8 * [2]
        again, same, other = (sweep_of_python(mu, {"design": design, "samples": 16, "seed": seed}).points for seed in (2, 2, 3))
        assert again == same != other
    # options give sampled intervals too
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


VARY = """[vary]
a = {from = 0.1, to = 0.5}
b = {from = "1 mN", to = "2 um", count = 3}
c = {from = 0, to = 1, count = 3, scale = "log"}
d = 5
e = []
f = {from = 1, too = 2, count = 3}
"""


def test_all_faults_of_a_file_are_reported_at_once(tmp_path):
    text = "\n".join(faults(lambda: of_file(tmp_path, 'desgn = "grid"\nkeep = "some"\n' + VARY)))
    assert "sweep.toml:3:1: desgn: unknown key, did you mean 'design'?" in text
    assert "'some' is not one of 'all', 'summary'" in text
    report = faults(lambda: of_file(tmp_path, VARY + "[[together]]\ng = [1, 2]\nh = [1, 2, 3]\na = [1, 2]\n"))
    for fault in [
        "4:a.count: required key is missing: the number of values", "5:b: '1 mN' and '2 um' are a force and a length",
        '6:c: scale = "log" needs ends above 0', "7:d: expected a list of values or a table {from, to, count}, got 5",
        "8:e: expected at least one value", "9:f.too: unknown key, did you mean 'to'?",
    ]:  # fmt: skip
        line, _, words = fault.partition(":")
        assert any(f"sweep.toml:{line}:" in one and words in one for one in report), (fault, report)
    assert any("a is varied twice" in one for one in report)
    assert any("moved together, but with 2 values of g, 3 values of h" in one for one in report)


MU, LOAD, SEED = "pairs.0.friction", "plates.upper.load", "debris.0.seed"


def finished(folder, vary, failed=-1, **options):
    """A sweep whose friction is friction + 1000 load + seed/100, and whose bodies roll with probability friction."""
    plan = make_plan(Scene.parse(BALLS), sweep_of_python(vary, options), folder)
    save_plan(plan, folder)
    for point in plan.points:
        values = {column.key: column.values[point.number] for column in plan.columns}
        friction = values[MU] + 1000.0 * values.get(LOAD, 0.0) + values.get(SEED, 0) / 100.0
        results = dict.fromkeys(plan.results, 0.0) | {"friction_coefficient": friction, "fraction_rolling": values[MU]}
        done = PointResult(point.number, DONE, "", 0, 1.5, results)
        write_result(point, PointResult(point.number, FAILED, "why", 4, 1.0) if point.number == failed else done)
    return Sweep(folder)


def test_means_over_seeds_have_the_standard_error_which_is_the_bar_of_curves(tmp_path):
    shown = average(finished(tmp_path, {MU: [0.1, 0.2], SEED: [1, 2, 3]}, failed=0), MU, None)
    assert shown.x.tolist() == [0.1, 0.2] and shown.largest == 3 and shown.averaged == (SEED,)
    # seeds 1, 2, 3: mean 2, standard deviation 1; the failed point of seed 1 is left out; rounding of a few sums
    assert shown.values["friction_coefficient"] == pytest.approx([0.125, 0.22], rel=1e-12)
    assert shown.errors["friction_coefficient"] == pytest.approx([0.005, 0.01 / np.sqrt(3.0)], rel=1e-12)
    sweep = finished(tmp_path, {MU: {"from": 0.1, "to": 0.5, "count": 5}, LOAD: ["0.1 mN", "1 mN"], SEED: [1, 2, 3]})
    figure = sweep.plot(tmp_path / "curves.png")
    first = figure.axes[0]
    assert (tmp_path / "curves.png").stat().st_size > 10_000
    assert first.get_title() == "friction coefficient" and first.get_xlabel() == MU
    assert [text.get_text() for text in first.get_legend().get_texts()] == ["load = 100 µN", "load = 1 mN"]
    curves = [container.lines[0].get_xydata() for container in first.containers]
    expected = [[mu, mu + load + 0.02] for load in (0.1, 1.0) for mu in (0.1, 0.2, 0.3, 0.4, 0.5)]
    assert np.concatenate(curves) == pytest.approx(np.array(expected), rel=1e-12)
    [(lower, upper), *_] = (bar[:, 1] for bar in first.containers[0].lines[2][0].get_segments())
    assert upper - lower == pytest.approx(0.02 / np.sqrt(3.0), rel=1e-9)  # seeds 1, 2, 3 in hundredths
    assert "mean over debris.0.seed (3 points; bars: standard error)" in figure.get_suptitle()


def test_states_have_their_colours_and_named_panels_are_drawn_alone(tmp_path):
    sweep = finished(tmp_path, {MU: [0.1, 0.2, 0.3]})
    assert [axes.get_title() for axes in sweep.plot().axes] == [
        "friction coefficient", "states at the end, fraction of the bodies", "ever rolling, fraction of the bodies",
    ]  # fmt: skip
    assert {axes.containers[0].lines[0].get_color() for axes in sweep.plot().axes[1:]} == {STATE_COLORS["rolling"]}
    assert [axes.get_title() for axes in sweep.plot(panels=["load"]).axes] == ["load"]
    # sampled points are drawn where they are
    ends = {MU: {"from": 0.1, "to": 0.5}, LOAD: {"from": "0.1 mN", "to": "1 mN"}}
    sweep = finished(tmp_path, ends, design="sobol", samples=16)
    offsets = np.asarray(sweep.plot().axes[0].collections[0].get_offsets())
    # mN to the prefix of the axis; products of floats
    assert offsets == pytest.approx(np.column_stack([sweep.column(MU), 1e6 * np.array(sweep.column(LOAD))]), rel=1e-12)


def test_maps_show_each_point_in_its_cell(tmp_path):
    loads = {"from": "0.01 mN", "to": "100 mN", "count": 9, "scale": "log"}
    figure = finished(tmp_path, {MU: {"from": 0.1, "to": 0.5, "count": 5}, LOAD: loads}, failed=7).plot(x=MU, y=LOAD)
    panel = next(axes for axes in figure.axes if axes.get_title() == "rolling at the end, fraction of the bodies")
    cells = panel.collections[0].get_array()
    assert panel.collections[0].get_clim() == (0.0, 1.0) and panel.get_xlabel() == MU
    assert cells.shape == (9, 5) and panel.get_yscale() == "log" and panel.get_ylabel() == "plates.upper.load [mN]"
    assert np.ma.count_masked(np.ma.masked_invalid(cells)) == 1  # the failed point
    # point 7 of 9 loads: mu = 0.1, the eighth load
    assert np.isnan(np.ma.filled(cells, np.nan)[7, 0]) and float(cells[0, 4]) == 0.5
    # wrong axes and panels are refused with the nearest name
    sweep = finished(tmp_path, {MU: [0.1, 0.2], "title": ["first", "second"]})
    for options, text in (
        ({"x": "pairs.0.frction"}, "did you mean 'pairs.0.friction'"), ({"panels": ["lod"]}, "did you mean 'load'"),
        ({"x": "title"}, "its values are texts"), ({"out": tmp_path / "picture.xyz"}, ".png"),
    ):  # fmt: skip
        with pytest.raises(UsageError, match=text):
            sweep.plot(**options)
    save_plan(make_plan(Scene.parse(BALLS), sweep_of_python({MU: [0.1]}, {}), tmp_path / "new"), tmp_path / "new")
    with pytest.raises(InputError, match="no point is done"):
        Sweep(tmp_path / "new").plot()


def test_tables_of_pandas_and_xarray(tmp_path):
    sweep = finished(tmp_path, {(SEED, LOAD): [(1, 1e-4), (2, 2e-4), (3, 3e-4)], MU: [0.1, 0.2]}, failed=5)
    # the constructor puts axes by single keys first
    assert list(sweep.axes.items()) == [(MU, "1"), (SEED, "1"), (LOAD, "N")]
    data = sweep.to_pandas()
    assert len(data) == 6 and data.attrs["units"][LOAD] == "N" and data["exit_code"].tolist() == [0, 0, 0, 0, 0, 4]
    assert data["reason"].tolist()[-1] == "why" and np.isnan(data["friction_coefficient"].iloc[-1])
    xarray = pytest.importorskip("xarray")
    grid = sweep.to_xarray()
    assert isinstance(grid, xarray.Dataset) and grid.sizes == {MU: 2, SEED: 3}
    assert grid[LOAD].dims == (SEED,) and grid[LOAD].values.tolist() == [1e-4, 2e-4, 3e-4]
    # 0.2 + 0.2 + 0.02: sums of floats
    assert float(grid["friction_coefficient"].sel({MU: 0.2, SEED: 2})) == pytest.approx(0.42, rel=1e-12)
    assert grid["status"].values.ravel().tolist() == 5 * ["done"] + ["failed"]
