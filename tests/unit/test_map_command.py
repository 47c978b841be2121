"""`thirdbody map`: the numbers it prints and the pictures it draws."""

import json
from functools import partial

import numpy as np
import pytest
from matplotlib.figure import Figure
from thirdbody_three_spot import regime_map
from thirdbody_three_spot.regime_map import COLORS, MapPoint, draw_map
from three_spot_theory import regime

from thirdbody.palette import STATE_COLORS


@pytest.fixture
def command(command):
    return partial(command, "map")


def test_the_suffix_is_the_format(command, tmp_path):
    assert command() == (0, "map.png\n", "")
    data = (tmp_path / "map.png").read_bytes()
    assert data.startswith(b"\x89PNG") and len(data) > 20_000  # an empty canvas of this size takes 8 kB
    code, out, err = command("--json", "-o", "b.svg")  # stays JSON beside a picture
    assert code == 0 and json.loads(out)["fig2"]["H"] == 1.0 and err == "b.svg\n"
    assert (tmp_path / "b.svg").read_bytes().startswith(b"<?xml")


def test_json_reports_fig_2_and_the_limits(command, tmp_path):
    code, out, err = command("--json", "--H", "0.6", "--half-width", "0.25")
    assert code == 0 and err == "" and not list(tmp_path.iterdir())
    report = json.loads(out)
    fig, limits = report["fig2"], report["regimes"]
    n, z = np.meshgrid(fig["n_2"], fig["zeta_2"])
    # moments about S over N_1 x_1, with N_3 = N_1 - N_2: 1 + n_2 zeta_2 - (1 - n_2) zeta_3 = H
    assert np.allclose(1.0 + n * z - (1.0 - n) * np.array(fig["zeta_3"]), 0.6, rtol=0.0, atol=1e-13)  # zeta_3 up to 40
    x = np.array(limits["x_1"])
    assert np.allclose(limits["t_min"], x - 0.25) and np.allclose(limits["t_max"], x + 0.25)
    assert np.allclose(limits["mu_required"], np.maximum(np.abs(x) - 0.25, 0.0))  # how far x_1 is outside the lower spots


def test_areas_and_points_are_drawn_where_they_are():
    for x_1, mu, name in ((0.0, 0.4, "sliding"), (0.0, 0.6, "sticking"), (0.9, 0.3, "rolling"), (0.9, 0.5, "sliding"),
                          (-0.9, 0.3, "rolling"), (-0.9, 0.5, "sticking")):  # fmt: skip
        assert regime(x_1, 0.5, mu) == name  # t_max = x_1 + .5, t_min = x_1 - .5
    axes = Figure().subplots()
    regime_map._draw_regimes(axes, 0.5)
    areas = {name: [c for c in axes.collections if np.allclose(c.get_facecolor()[0][:3], regime_map._pale(COLORS[name]))]
             for name in regime_map.REGIMES}  # fmt: skip
    assert all(len(found) == 1 for found in areas.values())
    random = np.random.default_rng(3)
    for x, mu in zip(random.uniform(-1.05, 1.55, 100), random.uniform(0.0, 1.0, 100), strict=True):
        painted = [name for name, (area,) in areas.items() if any(p.contains_point((x, mu)) for p in area.get_paths())]
        assert painted == [regime(x, 0.5, mu)]
    middle = {line.get_linestyle(): float(np.interp(0.1, *line.get_data())) for line in axes.lines[:3]}
    assert middle == pytest.approx({"-": 0.6, "--": -0.4, ":": -0.6})  # t_max, t_min, -t_max, in the order of the legend
    assert [style for _, style in regime_map.LINES] == ["-", "--", ":"] and "max" in regime_map.LINES[0][0]
    assert [(text.get_text(), text.xy[0]) for text in axes.texts] == [("spot 2", -0.5), ("spot 3", 0.5)]
    fig2 = Figure().subplots()
    regime_map._draw_fig2(fig2, 1.2)
    for lines, level in zip(fig2.collections, regime_map.LEVELS, strict=True):  # n_2 zeta_2 + 1 - H = (1 - n_2) zeta_3
        n, z = np.concatenate([path.vertices for path in lines.get_paths()]).T
        assert np.abs(n * z - 0.2 - (1.0 - n) * level).max() < 1e-3 and lines.get_linewidth()[0] == (2.0 if level == 0.0 else 1.1)
    assert {name: STATE_COLORS[name] for name in COLORS} == COLORS  # those of every other picture


def test_the_legend_explains_every_mark(tmp_path, monkeypatch):
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    states = ("rolling", "sticking", "sliding")
    places = [(x, mu) for x in np.linspace(-1.0, 1.5, 12) for mu in np.linspace(0.05, 0.95, 12)]
    draw_map(tmp_path / "map.png", points=[MapPoint(*place, states[k % 3]) for k, place in enumerate(places)])
    (figure,) = drawn
    figure.draw_without_rendering()
    right = figure.axes[1]
    marks = [right.transData.transform(line.get_xydata()[0]) for line in right.lines if line.get_marker() != "None"]
    assert len(marks) == 144 and len(right.texts) == 2  # the two lower spots
    assert np.allclose(right.transData.inverted().transform(marks), places)
    report = [text.get_text() for text in figure.legends[0].get_texts()]
    computed = [f"computed: {regime_map.WORDS[name]}" for name in states]
    assert [text for text in report if text.startswith("computed: ")] == computed
    assert len([text for text in report if text.startswith("theory: ")]) == 3
