"""`thirdbody balance FILE` and `thirdbody map`: faults of the file, the table, JSON, the pictures."""

import json
import math

import numpy as np
import pytest
from balls import edited
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from portable import drawn as inked
from thirdbody_three_spot import regime_map
from thirdbody_three_spot.balance import Forecast, Point, Result, balance
from thirdbody_three_spot.balance_command import balance_command, plot, table
from thirdbody_three_spot.balance_file import BalanceFile
from thirdbody_three_spot.regime_map import COLORS, MapPoint, draw_map
from three_spot_theory import regime
import thirdbody
from thirdbody.errors import InputError, OutputError, UsageError
from thirdbody.palette import STATE_COLORS

FILE = """\
balance = 1
[materials.upper]
shear_modulus = "80 GPa"
poisson_ratio = 0.3
[materials.lower]
shear_modulus = "60 GPa"
poisson_ratio = 0.35
[materials.particle]
shear_modulus = "120 GPa"
poisson_ratio = 0.2
[friction]
upper = 0.3
lower = 0.3
[particle]
weight = "0 N"
spots = [
  {side = "upper", x = "0.2 um", z = "2 um", radius = "2 um"},
  {side = "lower", x = "-2 um", z = "-2 um", radius = "1 um"},
  {side = "lower", x = "1.5 um", z = "-2 um", radius = "1.5 um"},
]
[path]
indentation = "10 nm"
drag = "12 nm"
steps = 24
"""


@pytest.fixture
def write(tmp_path):
    def make(*changes):
        path = tmp_path / "particle.toml"
        path.write_text(edited(FILE, *changes), encoding="utf-8")
        return path

    return make


def test_json_has_the_promised_keys_and_tangential_forces_in_space_are_vectors(write, capsys, tmp_path):
    balance_command(write(), json=True, level="mindlin", out=tmp_path / "a.png")
    seen = capsys.readouterr()
    report = json.loads(seen.out, parse_constant=lambda word: pytest.fail(word))
    assert seen.err == f"{tmp_path / 'a.png'}\n" and (tmp_path / "a.png").exists()  # warnings are in the JSON
    assert {"points", "forecast", "moduli"} <= report.keys() and len(report["points"]) == 25
    keys = {"indentation", "drag", "N", "T", "w", "u", "phi", "spots", "label", "reason", "margins"}
    assert all(point.keys() == keys for point in report["points"])
    assert report["forecast"].keys() == {"mu_required", "t_min", "t_max", "possible"}
    first, last = report["points"][0], report["points"][-1]
    assert (first["drag"], first["indentation"]) == (0.0, 10e-9) and last["drag"] == pytest.approx(12e-9, rel=1e-12)
    assert len(first["N"]) == 3 and isinstance(first["T"][0], float) and isinstance(first["phi"], float)
    assert report["moduli"]["upper"]["e_star"] == pytest.approx(129729729729.730, rel=1e-13)  # Eq. 4
    assert report["moduli"]["lower"]["g_star"] == pytest.approx(94117647058.8235, rel=1e-13)  # Eq. 14
    result = balance(write(("steps = 24", "steps = 2\ndirection = [0, 1]")), "mindlin")
    point = result.points[-1]
    assert not result.planar and (len(point.T[0]), len(point.u), len(point.phi)) == (2, 2, 3)


def test_the_table_reports_what_changes_stops_and_cannot_be_compared(write, capsys):
    balance_command(write(), level="mindlin")
    report = capsys.readouterr()
    assert "forecast: sticks for mu from 0, slides for mu from 0 to 0.55; possible: sticking, sliding" in report.out
    assert "sliding   friction_limit" in report.out
    # a particle without weight that slides on both sides: any place along the drag is in balance
    assert len(report.err.splitlines()) == 1 and "its place along the drag is undetermined" in report.err
    lines = table(balance(write(('  {side = "lower", x = "1.5 um", z = "-2 um", radius = "1.5 um"},\n', "")), "mindlin"))
    assert "no static state exists while it is pressed" in lines[-1]
    balance_command(write(('shear_modulus = "80 GPa"', 'youngs_modulus = "5 GPa"')), level="mindlin")
    # by hand with G = 5/2.6 GPa: beta = (.6/120 - .4/G)/(1.6/120 + 1.4/G), particle first (Eq. 3)
    assert "upper side: not elastically similar (Dundurs' beta -0.274)" in capsys.readouterr().err


def test_faults_at_once_with_line_and_nearest_name_and_each_alone(write):
    path = write(
        ("poisson_ratio = 0.3\n", "poisson_ratio = 0.7\n"), ('"60 GPa"', '"60 um"'), ('side = "upper"', 'side = "top"'),
        ("[friction]\nupper = 0.3", "[friction]\nuper = 0.3"), ('drag = "12 nm"', 'drag = "12 nm"\nload = "1 N"'),
    )  # fmt: skip
    with pytest.raises(InputError) as problem:
        BalanceFile.load(path)
    report = str(problem.value)
    for part in (
        "particle.toml:4:1: materials.upper.poisson_ratio: 0.7 must be", "materials.lower.shear_modulus", "did you mean 'upper'?",
        "'top' is not one of 'lower', 'upper'", "give only one of indentation, load",
    ):  # fmt: skip
        assert part in report
    assert len(problem.value.faults) == 5 and problem.value.exit_code == 3
    for change, text in [
        (("balance = 1\n", ""), "write balance = 1"), (('weight = "0 N"', "quaternion = [1, 0, 0, 0]"), "turns a clump"),
        (('z = "2 um"', 'z = "-3 um"'), "not above the lower ones"), (("steps = 24", "direction = [0, 0]"), "has no length"),
        (('indentation = "10 nm"\n', ""), "give one of indentation, load"), (("steps = 24", "steps = 24 nm"), "not valid TOML"),
    ]:  # fmt: skip
        with pytest.raises(InputError) as problem:
            BalanceFile.load(write(change))
        assert text in str(problem.value) and len(problem.value.faults) == 1
    with pytest.raises(InputError, match="no such file"):
        balance("nowhere.toml", "mindlin")
    with pytest.raises(InputError, match="pivoting"):  # an effect that a balance does not have
        balance(write(("[path]", "[effects]\npivoting = {}\n[path]")))


def test_the_picture(write, tmp_path):
    for number, change in enumerate((("steps = 24", "direction = [1, 1]"), ('"12 nm"', '"0 nm"'))):
        result, picture = balance(write(change), "mindlin"), tmp_path / f"{number}.png"
        plot(result, picture, "particle")
        assert picture.read_bytes().startswith(b"\x89PNG") and inked(picture) > 0.02
    with pytest.raises(UsageError, match="a picture ends in"):
        plot(result, tmp_path / "picture.doc")
    with pytest.raises(OutputError, match="cannot be written"):
        plot(result, tmp_path / "none" / "picture.png")


def test_table_and_picture_of_a_path_by_hand(monkeypatch, tmp_path):
    """The first spot slides from point 8 on, the particle from 15, and the third spot opens at the last, 29."""
    points = [
        Point(10e-9, k * 1e-9, [2e-3, 0.0, 1e-3 * (k < 29)], [3e-4, 0.0, -1e-4], 4e-9, 5e-9, -2e-3,
              ["slide" if k > 7 else "stick", "open", "partial" if k < 29 else "open"], "sliding" if k > 14 else "sticking",
              "friction_limit", {"friction_spots": [0.0, 1.0, 0.4]}) for k in range(30)
    ]  # fmt: skip
    result = Result(points, Forecast(0.5, None, None, []), {}, "mdr", True, None, [])
    lines = table(result)
    assert lines[0] == "forecast: sticks for mu from 0.5, never slides; possible: none"
    assert [int(line.split()[0]) for line in lines[2:]] == [0, 2, 5, 7, 8, 10, 12, 14, 15, 17, 19, 22, 24, 27, 29]  # nm
    assert lines[1].split() == ["drag", "indentation", "N1", "N2", "N3", "w", "spots", "label", "reason"]
    assert lines[6].split()[:3] == ["8", "nm", "10"] and "slide open partial  sticking  friction_limit" in lines[6]
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    plot(result, tmp_path / "picture.png")
    force, friction, tilt, bars = drawn[0].axes
    assert [(c.get_label(), *c.get_xydata()[28]) for c in force.lines] == [("spot 1", 28.0, 2.0), ("spot 3", 28.0, 1.0)]
    assert [c.get_ydata()[28] for c in (*friction.lines[:2], *tilt.lines)] == pytest.approx([1.0, -0.6, -2.0])
    assert math.isnan(friction.lines[1].get_ydata()[29])  # open
    assert ["(mN)" in force.get_ylabel(), "(mrad)" in tilt.get_ylabel(), "(nm)" in bars.get_xlabel()] == [True] * 3
    assert [text.get_text() for text in bars.get_yticklabels()] == ["particle", "spot 1", "spot 3"]
    whole = [(to_hex(bar.get_facecolor()).upper(), *bar.get_center()) for bar in bars.patches if bar.get_center()[1] == 0.0]
    assert whole == [(STATE_COLORS["sticking"], 7.0, 0.0), (STATE_COLORS["sliding"], 22.0, 0.0)]


def test_the_package_and_the_command_line_have_the_function(write, monkeypatch, capsys):
    assert thirdbody.balance is balance and "balance" in dir(thirdbody)
    with pytest.raises(AttributeError, match="has no attribute 'balanse'"):
        thirdbody.balanse  # noqa: B018
    from thirdbody.cli.main import main

    monkeypatch.setattr("sys.argv", ["thirdbody", "balance", str(write(("steps = 24", "step = 24"))), "--json"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 3 and "path.step: unknown key, did you mean 'steps'?" in capsys.readouterr().err


def test_close_spots_share_the_plate(write):
    """d_i = (N_i/K_i)^(2/3) + g N_j at every point of the path, with g of the lower plate; the lone upper spot is Hertz'."""
    near = ('x = "-2 um"', 'x = "-0.5 um"'), ('x = "1.5 um"', 'x = "0.5 um"')
    result = balance(write(*near, ("[path]", "[effects]\nclose_spots = {}\n[path]")), "mindlin")
    assert result.stopped is None
    g = (1.0 - 0.35) / (2.0 * math.pi * 60e9) / 1e-6
    e_low, e_up = (1.0 / (0.5 * (1.0 - nu) / shear + 0.5 * 0.8 / 120e9) for nu, shear in ((0.35, 60e9), (0.3, 80e9)))
    for point in result.points[:: len(result.points) // 4]:
        (above, one, other), turn = point.N, point.phi
        hertz = [(n / (4.0 / 3.0 * e * math.sqrt(r))) ** (2.0 / 3.0)
                 for n, e, r in ((above, e_up, 2e-6), (one, e_low, 1e-6), (other, e_low, 1.5e-6))]  # fmt: skip
        # w down, phi about y: a spot at x sinks by w + x phi
        sinks = [point.w + x * turn for x in (-0.5e-6, 0.5e-6)]
        assert [hertz[1] + g * other, hertz[2] + g * one] == pytest.approx(sinks, rel=1e-9) and g * other > 0.005 * hertz[1]


def test_the_suffix_is_the_format_and_json_reports_fig_2_and_the_limits(command, tmp_path):
    assert command("map") == (0, "map.png\n", "")
    data = (tmp_path / "map.png").read_bytes()
    assert data.startswith(b"\x89PNG") and len(data) > 20_000  # an empty canvas of this size takes 8 kB
    code, out, err = command("map", "--json", "-o", "b.svg")  # stays JSON beside a picture
    assert code == 0 and json.loads(out)["fig2"]["H"] == 1.0 and err == "b.svg\n"
    assert (tmp_path / "b.svg").read_bytes().startswith(b"<?xml")
    code, out, err = command("map", "--json", "--H", "0.6", "--half-width", "0.25")
    assert code == 0 and err == "" and len(list(tmp_path.iterdir())) == 2  # no more files
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
