"""Wrong sweeps: one clear message with everything that is wrong, before anything is written."""

from __future__ import annotations

import pytest
from balls import BALLS

MU = "pairs.0.friction"
SWEEP = f'sweep = 1\nscene = "balls.toml"\n[vary]\n"{MU}" = [0.1, 0.2]\n'


@pytest.fixture
def files(tmp_path):
    (tmp_path / "balls.toml").write_text(BALLS, encoding="utf-8")
    (tmp_path / "sweep.toml").write_text(SWEEP, encoding="utf-8")
    return tmp_path


def vary(*values: str) -> list[str]:
    return ["balls.toml", *(word for value in values for word in ("--vary", value))]


@pytest.mark.parametrize(
    ("arguments", "code", "texts"),
    [
        (vary("pairs.0.frction=0.1,0.2"), 3, ["pairs[0].frction: unknown key, did you mean 'friction'?"]),
        (vary(f"{MU}=0.1:0.5"), 3, [".count: required key is missing: the number of values"]),
        (vary(f"{MU}=0.1:0.5:x"), 3, [".count: expected a whole number, got 'x'"]),
        (vary(f"{MU}=0.1:0.5:4:loga"), 3, [".scale: 'loga' is not one of 'linear', 'log', 'whole'"]),
        (vary("plates.upper.load=1 mN:2:3"), 3, ["'1 mN' and 2 are a force and a pure number"]),
        (vary("plates.upper.load=1,2"), 3, ["plates.upper.load: 1 has no unit, expected a unit of force"]),
        (vary("plates.upper.load=1 mM:2 mM:3"), 3, ["unknown unit 'mM'"]),
        (vary("debris.2.count=1,2"), 3, ["debris.2.count: debris has no entry '2': its entries are 0 to 0"]),
        (vary(MU), 3, [f"{MU}: write KEY=FROM:TO:COUNT or KEY=A,B,C"]),
        (vary(f"{MU}=0.1,0.2", f"{MU}=0.3"), 3, ["is varied twice"]),
        ([*vary(f"{MU}=0.1"), "--result", "lod"], 3, ["'lod' is no result, did you mean 'load'?"]),
        ([*vary("contact.level=mindlin,mindlim")], 3, ["contact.level: 'mindlim' is not a level", "did you mean 'mindlin'"]),
        (["balls.toml"], 2, ["balls.toml: is a scene; say what to vary"]),
        (["sweep.toml", "--vary", f"{MU}=0.1"], 2, ["sweep.toml: is a sweep file; --vary goes with a scene"]),
        (["sweep.toml", "--design", "zip"], 2, ["--design: only with --vary"]),
        (["nothing.toml"], 3, ["nothing.toml: no such file"]),
        (["nothing.toml", "--vary", f"{MU}=0.1"], 3, ["nothing.toml: no such file"]),
        (["."], 3, ["is no folder of a sweep"]),
        (["sweep.toml", "--retry", "done"], 2, ["write --retry failed"]),
        ([*vary(f"{MU}=0.1"), "-o", "balls.toml"], 5, ["balls.toml: exists already"]),
        ([*vary(f"{MU}=0.1"), "-o", "balls.toml/inside"], 5, ["balls.toml/inside: cannot be made"]),
    ],
)  # fmt: skip
def test_wrong_arguments_are_named(files, command, arguments, code, texts):
    before = sorted(files.rglob("*"))
    report = command("sweep", *arguments)
    assert report.code == code, report
    assert all(text in report.err for text in texts), report.err
    assert "Traceback" not in report.err and sorted(files.rglob("*")) == before


def test_wrong_keys_hide_no_others_and_blame_no_results(files, command):
    report = command("sweep", *vary("pairs.0.frction=0.1,0.2", "debris.0.sed=1,2"))
    assert report.code == 3 and report.err.splitlines() == [
        "pairs[0].frction: unknown key, did you mean 'friction'?",
        "debris[0].sed: unknown key, did you mean 'seed'?",
    ]


def test_all_faults_of_all_points_are_reported_once_with_their_line(files, command):
    (files / "sweep.toml").write_text(
        """sweep = 1
scene = "balls.toml"
results = ["load", "friktion"]
[settings]
"solver.distnce" = "1 um"
[vary]
"pairs.0.friction" = [0.1, -0.2]
debris.0.cout = [1, 2, 3]
plates.upper.load = {from = 1, to = 2, count = 40}
""",
        encoding="utf-8",
    )
    report = command("sweep", "sweep.toml")
    lines = report.err.splitlines()
    assert report.code == 3 and len(lines) <= 45, report.err
    for text in (
        "sweep.toml:3:", "'friktion' is no result", "did you mean 'distance'",
        "sweep.toml:7:1: pairs[0].friction: -0.2 must be at least 0",
        "sweep.toml:8:1: debris[0].cout: unknown key, did you mean 'count'?", "sweep.toml:9:1: plates.upper.load: 1 has no unit",
    ):  # fmt: skip
        assert sum(text in line for line in lines) == 1, (text, report.err)


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('scene = "balls.toml"', 'scene = "ball.toml"', "sweep.toml:2:1: scene: ball.toml: no such file"),
        ("sweep = 1\n", "", "sweep: required key is missing: write sweep = 1"),
        ("sweep = 1", "sweep = 2", "sweep.toml:1:1: sweep: 2 must be 1"),
        ("[0.1, 0.2]", "[0.1, 0.2", "sweep.toml:"),
        ("[vary]", "[vry]", "sweep.toml:3:1: vry: unknown key, did you mean 'vary'?"),
        (f'[vary]\n"{MU}" = [0.1, 0.2]\n', "", "give the points: [vary], [[together]] or points"),
        ("[vary]", 'points = "points.csv"\n[vary]', "points of a CSV file are given too"),
    ],
)
def test_wrong_files_are_named(files, command, old, new, text):
    (files / "sweep.toml").write_text(SWEEP.replace(old, new), encoding="utf-8")
    report = command("sweep", "sweep.toml")
    assert report.code == 3 and text in report.err, report.err
    assert not (files / "sweeps").exists()


def test_a_damaged_folder_is_named(files, command):
    (files / "old").mkdir()
    (files / "old" / "sweep.json").write_text("{")
    for words in (["sweep", "old", "--resume"], ["plot", "old"]):
        report = command(*words)
        assert report.code == 3 and report.err == "thirdbody: old/sweep.json: is damaged\n"
