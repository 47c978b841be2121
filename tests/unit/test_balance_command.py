"""`thirdbody balance FILE`: the file and its faults, the table, JSON, the picture."""

import json
import math

import pytest
from portable import drawn
from thirdbody_three_spot.balance import balance
from thirdbody_three_spot.balance_command import balance_command, table
from thirdbody_three_spot.balance_file import BalanceFile
from thirdbody_three_spot.balance_plot import plot

import thirdbody
from thirdbody.errors import InputError, OutputError, UsageError

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
        text = FILE
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new, 1)
        path = tmp_path / "particle.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return make


def test_json_has_the_promised_keys(write, capsys):
    balance_command(write(), json=True, level="mindlin")
    report = json.loads(capsys.readouterr().out, parse_constant=lambda word: pytest.fail(word))
    assert {"points", "forecast", "moduli"} <= report.keys() and len(report["points"]) == 25
    keys = {"indentation", "drag", "N", "T", "w", "u", "phi", "spots", "label", "reason", "margins"}
    assert all(point.keys() == keys for point in report["points"])
    assert report["forecast"].keys() == {"mu_required", "t_min", "t_max", "possible"}
    first, last = report["points"][0], report["points"][-1]
    assert (first["drag"], first["indentation"]) == (0.0, 10e-9) and last["drag"] == pytest.approx(12e-9, rel=1e-12)
    assert len(first["N"]) == 3 and isinstance(first["T"][0], float) and isinstance(first["phi"], float)
    assert report["moduli"]["upper"]["e_star"] == pytest.approx(129729729729.730, rel=1e-13)  # Eq. 4


def test_in_space_tangential_forces_are_vectors(write):
    result = balance(write(("steps = 24", "steps = 2\ndirection = [0, 1]")), "mindlin")
    point = result.points[-1]
    assert not result.planar and (len(point.T[0]), len(point.u), len(point.phi)) == (2, 2, 3)


def test_the_table_reports_what_changes_stops_and_cannot_be_compared(write, capsys):
    balance_command(write(), level="mindlin")
    report = capsys.readouterr()
    assert "forecast: sticks for mu from 0, slides for mu from -0.325 to 0.55; possible: sticking, sliding" in report.out
    assert "sliding   friction_limit" in report.out
    # a particle without weight that slides on both sides: any place along the drag is in balance
    assert len(report.err.splitlines()) == 1 and "its place along the drag is undetermined" in report.err
    lines = table(balance(write(('  {side = "lower", x = "1.5 um", z = "-2 um", radius = "1.5 um"},\n', "")), "mindlin"))
    assert "no static state exists while it is pressed" in lines[-1]
    balance_command(write(('shear_modulus = "80 GPa"', 'youngs_modulus = "5 GPa"')), level="mindlin")
    assert "upper side: not elastically similar" in capsys.readouterr().err


def test_all_faults_at_once_with_line_and_nearest_name(write):
    path = write(
        ("poisson_ratio = 0.3\n", "poisson_ratio = 0.7\n"),
        ('"60 GPa"', '"60 um"'),
        ("[friction]\nupper = 0.3", "[friction]\nuper = 0.3"),
        ('side = "upper"', 'side = "top"'),
        ('drag = "12 nm"', 'drag = "12 nm"\nload = "1 N"'),
    )
    with pytest.raises(InputError) as problem:
        BalanceFile.load(path)
    report = str(problem.value)
    for part in (
        "particle.toml:4:1: materials.upper.poisson_ratio: 0.7 must be", "materials.lower.shear_modulus", "did you mean 'upper'?",
        "'top' is not one of 'lower', 'upper'", "give only one of indentation, load",
    ):  # fmt: skip
        assert part in report
    assert len(problem.value.faults) == 5 and problem.value.exit_code == 3


FAULTS = [
    (("balance = 1\n", ""), "write balance = 1"), (('weight = "0 N"', "quaternion = [1, 0, 0, 0]"), "turns a clump"),
    (('z = "2 um"', 'z = "-3 um"'), "not above the lower ones"), (("steps = 24", "direction = [0, 0]"), "has no length"),
    (('indentation = "10 nm"\n', ""), "give one of indentation, load"), (("steps = 24", "steps = 24 nm"), "not valid TOML"),
]  # fmt: skip


def test_single_faults(write):
    for change, text in FAULTS:
        with pytest.raises(InputError) as problem:
            BalanceFile.load(write(change))
        assert text in str(problem.value) and len(problem.value.faults) == 1
    with pytest.raises(InputError, match="no such file"):
        balance("nowhere.toml", "mindlin")
    with pytest.raises(InputError, match="pivoting"):  # an effect that a balance does not have
        balance(write(("[path]", "[effects]\npivoting = {}\n[path]")))


def test_the_picture(write, tmp_path):
    for number, change in enumerate((("steps = 24", "direction = [1, 1]"), ('"12 nm"', '"0 nm"'))):
        result = balance(write(change), "mindlin")
        picture = tmp_path / f"{number}.png"
        plot(result, picture, "particle")
        assert picture.read_bytes().startswith(b"\x89PNG") and drawn(picture) > 0.02
    with pytest.raises(UsageError, match="a picture ends in"):
        plot(result, tmp_path / "picture.doc")
    with pytest.raises(OutputError, match="cannot be written"):
        plot(result, tmp_path / "none" / "picture.png")


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
        assert [hertz[1] + g * other, hertz[2] + g * one] == pytest.approx(sinks, rel=1e-9)
        assert g * other > 0.005 * hertz[1]
