"""Names that no file system takes, 300 letters: one line and the exit code of what was asked, in every command."""

from __future__ import annotations

import pytest

LONG = "a" * 300
"""Messages tell at least its first 200 letters."""

READ = [
    (["run", f"{LONG}.toml"], 3), (["check", LONG], 3), (["resume", LONG], 3), (["states", LONG], 3), (["plot", LONG], 3),
    (["render", LONG, "-o", "x.png"], 3), (["export", LONG, "--csv", "x"], 3), (["cost", LONG], 3), (["shapes", LONG], 3),
    (["balance", LONG], 3), (["laws", "--check", f"{LONG}.py"], 2), (["check", "scene.toml", "--plugin", f"{LONG}.py"], 2),
]  # fmt: skip
WRITTEN = [
    ["run", "scene.toml", "-o", LONG], ["run", "scene.toml", "-o", f"{LONG}/run"], ["run", "scene.toml", "-o", f"runs/{LONG}"],
    ["run", "scene.toml", "-o", LONG, "--overwrite"], ["cost", "scene.toml", "-q", "-o", LONG], ["new", LONG],
]  # fmt: skip
FROM_A_RUN = [
    ["plot", "run", "-o", f"{LONG}.png"], ["plot", "run", "-o", f"{LONG}/x.png"], ["render", "run", "-o", f"{LONG}.html"],
    ["render", "run", "-o", f"{LONG}/x.png"], ["export", "run", "--csv", LONG], ["export", "run", "--pvd", LONG],
    ["export", "run", "--csv", f"{LONG}/x"],
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "code"), [*READ, *((arguments, 5) for arguments in WRITTEN)])
def test_a_name_that_is_too_long(arguments, code, balls, command, tmp_path):
    balls()
    report = command(*arguments)
    assert report.code == code, report.err
    faults = [line for line in report.err.splitlines() if not line.startswith("warning: ")]  # those are of the scene
    assert len(faults) == 1 and LONG[:200] in faults[0] and "Traceback" not in report.err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def test_a_name_that_is_too_long_for_what_is_made_from_a_run(balls, command, tmp_path):
    balls()
    assert command("run", "scene.toml", "-o", "run", "-q").code == 0
    for arguments in FROM_A_RUN:
        report = command(*arguments)
        assert report.code == 5, (arguments, report.err)
        assert report.err.count("\n") == 1 and LONG[:200] in report.err and "Traceback" not in report.err
        assert sorted(path.name for path in tmp_path.iterdir()) == ["run", "scene.toml"]


@pytest.mark.parametrize("letters", range(230, 256, 5))
def test_a_name_that_is_nearly_too_long(letters, balls, command, tmp_path):
    """The name itself may be allowed, and that of the file beside it not, which is written first."""
    balls()
    report = command("new", "b" * letters)
    assert report.code in (0, 5) and "Traceback" not in report.err
    assert (tmp_path / ("b" * letters)).exists() == (report.code == 0)
