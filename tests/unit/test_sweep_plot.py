"""Pictures and data frames of a sweep, from results that are put into its folder without a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from balls import BALLS

from thirdbody.errors import InputError, UsageError
from thirdbody.scene.model import Scene
from thirdbody.studies.sweep.averages import average
from thirdbody.studies.sweep.plan import make_plan
from thirdbody.studies.sweep.point import DONE, FAILED, PointResult, write_result
from thirdbody.studies.sweep.reader import Sweep
from thirdbody.studies.sweep.sweep_file import sweep_of_python
from thirdbody.studies.sweep.sweep_folder import save_plan

MU, LOAD, SEED = "pairs.0.friction", "plates.upper.load", "debris.0.seed"


def finished(folder: Path, vary: dict, failed: int = -1, **options: object) -> Sweep:
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


def test_means_over_seeds_have_the_standard_error(tmp_path):
    sweep = finished(tmp_path, {MU: [0.1, 0.2], SEED: [1, 2, 3]}, failed=0)
    shown = average(sweep, MU, None)
    assert shown.x.tolist() == [0.1, 0.2] and shown.largest == 3 and shown.averaged == (SEED,)
    # seeds 1, 2, 3: mean 2, standard deviation 1; the failed point of seed 1 is left out; rounding of a few sums
    assert shown.values["friction_coefficient"] == pytest.approx([0.125, 0.22], rel=1e-12)
    assert shown.errors["friction_coefficient"] == pytest.approx([0.005, 0.01 / np.sqrt(3.0)], rel=1e-12)


def test_curves_have_bars_and_a_colour_per_value_of_the_second_axis(tmp_path):
    sweep = finished(tmp_path, {MU: {"from": 0.1, "to": 0.5, "count": 5}, LOAD: ["0.1 mN", "1 mN"], SEED: [1, 2]})
    figure = sweep.plot(tmp_path / "curves.png")
    first = figure.axes[0]
    assert (tmp_path / "curves.png").stat().st_size > 10_000
    assert first.get_title() == "friction coefficient" and first.get_xlabel() == MU
    assert [text.get_text() for text in first.get_legend().get_texts()] == ["load = 100 µN", "load = 1 mN"]
    curves = [container.lines[0].get_xydata() for container in first.containers]
    expected = [[mu, mu + load + 0.015] for load in (0.1, 1.0) for mu in (0.1, 0.2, 0.3, 0.4, 0.5)]
    assert np.concatenate(curves) == pytest.approx(np.array(expected), rel=1e-12)
    assert "mean over debris.0.seed (2 points; bars: standard error)" in figure.get_suptitle()


def test_states_have_their_colours_and_named_panels_are_drawn_alone(tmp_path):
    sweep = finished(tmp_path, {MU: [0.1, 0.2, 0.3]})
    assert [axes.get_title() for axes in sweep.plot().axes] == [
        "friction coefficient", "states at the end, fraction of the bodies", "ever rolling, fraction of the bodies",
    ]  # fmt: skip
    assert [axes.get_title() for axes in sweep.plot(panels=["load"]).axes] == ["load"]


def test_maps_show_each_point_in_its_cell(tmp_path):
    loads = {"from": "0.01 mN", "to": "100 mN", "count": 9, "scale": "log"}
    figure = finished(tmp_path, {MU: {"from": 0.1, "to": 0.5, "count": 5}, LOAD: loads}, failed=7).plot(x=MU, y=LOAD)
    panel = next(axes for axes in figure.axes if axes.get_title() == "rolling at the end, fraction of the bodies")
    cells = panel.collections[0].get_array()
    assert cells.shape == (9, 5) and panel.get_yscale() == "log" and panel.get_ylabel() == "plates.upper.load [mN]"
    assert np.ma.count_masked(np.ma.masked_invalid(cells)) == 1  # the failed point
    # point 7 of 9 loads: mu = 0.1, the eighth load
    assert np.isnan(np.ma.filled(cells, np.nan)[7, 0]) and float(cells[0, 4]) == 0.5


def test_sampled_points_are_drawn_where_they_are(tmp_path):
    ends = {MU: {"from": 0.1, "to": 0.5}, LOAD: {"from": "0.1 mN", "to": "1 mN"}}
    sweep = finished(tmp_path, ends, design="sobol", samples=16)
    offsets = np.asarray(sweep.plot().axes[0].collections[0].get_offsets())
    # mN to the prefix of the axis; products of floats
    assert offsets == pytest.approx(np.column_stack([sweep.column(MU), 1e6 * np.array(sweep.column(LOAD))]), rel=1e-12)


def test_wrong_axes_and_panels_are_refused_with_the_nearest_name(tmp_path):
    sweep = finished(tmp_path, {MU: [0.1, 0.2], "title": ["first", "second"]})
    for options, text in (
        ({"x": "pairs.0.frction"}, "did you mean 'pairs.0.friction'"), ({"panels": ["lod"]}, "did you mean 'load'"),
        ({"x": "title"}, "its values are texts"), ({"out": tmp_path / "picture.xyz"}, ".png"),
    ):  # fmt: skip
        with pytest.raises(UsageError, match=text):
            sweep.plot(**options)
    plan = make_plan(Scene.parse(BALLS), sweep_of_python({MU: [0.1]}, {}), tmp_path / "new")
    save_plan(plan, tmp_path / "new")
    with pytest.raises(InputError, match="no point is done"):
        Sweep(tmp_path / "new").plot()


def test_tables_of_pandas_and_xarray(tmp_path):
    vary = {(SEED, LOAD): [(1, 1e-4), (2, 2e-4), (3, 3e-4)], MU: [0.1, 0.2]}
    sweep = finished(tmp_path, vary, failed=5)
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
