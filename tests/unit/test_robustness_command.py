"""`thirdbody hard`: its table, its picture, and its exit code."""

from __future__ import annotations

import json

import pytest
from portable import drawn

from thirdbody.cli import main as cli
from thirdbody.errors import InputError, UsageError
from thirdbody.studies.robustness import plot, report
from thirdbody.studies.robustness.time_steps import Row

SOUND = Row("rigid_plane", "a stiff one", "explicit", "mindlin", 1e-3, 0.5, (), 5.0, "at 7: energy")
LEFT = Row("rigid_plane", "a stiff one", "implicit", "exact", 1e-10, 0.5)
BROKEN = Row("no_friction", "mu = 0", "explicit", "mindlin", 0.3, 0.5, ("shear force: 1 (at most 0)",))
TIGHT = Row("no_friction", "mu = 0", "explicit", "mdr", 1e-3, 0.5, (), 1.0, "at 1.2: energy")


@pytest.fixture
def command(monkeypatch, capsys, tmp_path):
    """Run `thirdbody hard`; gives exit code, out and err."""
    monkeypatch.chdir(tmp_path)

    def run(*words):
        monkeypatch.setattr("sys.argv", ["thirdbody", "hard", *map(str, words)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        report = capsys.readouterr()
        return stop.value.code or 0, report.out, report.err

    return run


def test_a_sound_case_is_reported_and_drawn(command, tmp_path):
    code, out, err = command("overlapping_start", "--quick", "-o", "table.png")
    assert code == 0
    assert "overlapping_start" in out and "implicit" in out and "2 of 2 hold" in out
    assert drawn(tmp_path / "table.png") > 0.02
    assert "overlapping_start, explicit, coulomb" in err


def test_json(command):
    code, out, err = command("overlapping_start", "--json", "-q")
    rows = json.loads(out)
    assert code == 0 and not err
    assert [row["integrator"] for row in rows] == ["explicit", "implicit"]
    assert all(row["holds"] and row["factor"] is None for row in rows)


@pytest.mark.parametrize("found, message", [(BROKEN, "shear force: 1"), (TIGHT, "is 1 times the automatic one, not 1.2 to 10")])
def test_a_case_that_fails_ends_with_exit_code_4(command, monkeypatch, found, message):
    monkeypatch.setattr(report, "rows", lambda *_, **__: iter([SOUND, found]))
    code, out, err = command("rigid_plane", "-q")
    assert code == 4
    assert "1 of 2 hold" in out and "5 x" in out and "FAILS" in out
    assert "1 of 2 hard cases fail" in err and f"no_friction, explicit, {found.level}" in err and message in err


def test_faults_of_the_call_come_before_the_work(command, monkeypatch):
    monkeypatch.setattr(report, "rows", lambda *_, **__: pytest.fail("the cases were run"))
    code, _, err = command("rigid_plane", "-o", "table.bmp")
    assert code == 2 and "table.bmp: a picture ends in .png, .pdf, .svg" in err
    code, _, err = command("rigid_plain")
    assert code == 2 and "did you mean 'rigid_plane'?" in err


def test_the_picture_shows_every_row():
    figure = plot.picture([report.as_json(row) for row in (SOUND, LEFT, BROKEN)], (1.2, 10.0))
    energy, step = figure.axes
    assert [text.get_text() for text in energy.get_yticklabels()] == ["rigid plane", "no friction"]
    points = {float(line.get_xdata()[0]) for line in energy.lines}
    assert {1e-3, 1e-10, 0.3} <= points
    assert 5.0 in {float(line.get_xdata()[-1]) for line in step.lines}
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["mindlin", "exact", "explicit", "implicit", "fails"]


def test_nothing_to_draw(tmp_path):
    with pytest.raises(InputError, match="nothing to draw"):
        plot.picture([], (1.2, 10.0))
    with pytest.raises(UsageError, match="a picture ends in"):
        plot.draw_stability([{}], tmp_path / "a.txt", (1.2, 10.0))


def test_equal_tables_give_equal_pictures(tmp_path):
    rows = [report.as_json(row) for row in (SOUND, LEFT)]
    for name in ("a.png", "b.png"):
        plot.draw_stability(rows, tmp_path / name, (1.2, 10.0))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
