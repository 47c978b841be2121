"""Plug-ins: found, refused, shown about; an edited law is never run from a stale cache."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from steel import scene_text
import thirdbody
from thirdbody.cli import command_group
from thirdbody.errors import UsageError
from thirdbody.laws import registry
from thirdbody.laws.registry import discover

DMT = Path(__file__).parents[2] / "plugins" / "dmt_adhesion.py"

# a uniform push on every body along x, N
PUSH = """\
from typing import NamedTuple
from thirdbody.plugin import BodyEffect, Plugin, Wrench, kernel
class Numbers(NamedTuple):
    scale: float
@kernel
def push(b, p):
    return Wrench({push} * p.scale, 0.0, 0.0, 0.0, 0.0, 0.0)
PLUGIN = Plugin("push", effects=(BodyEffect("push", push, Numbers, lambda options: Numbers(1.0), "Newton 1687"),))
"""
BALL = '[[debris]]\nmaterial = "steel"\nkind = "spheres"\nradius = "5 um"\npositions = [["10 um", "10 um", "10 um"]]\n'


def flown(folder, edits):
    """Speed along x over time under the push after each edit of files, {path: text}, each in a process of its own."""
    (folder / "flight.toml").write_text(scene_text(f"{BALL}[effects]\npush = true", '["80 um", "60 um"]'))
    found, paths = [], os.pathsep.join(filter(None, [str(folder / "site"), os.environ.get("PYTHONPATH")]))
    for k, texts in enumerate(edits):
        for name, text in texts.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        words = [sys.executable, "-m", "thirdbody", "run", "flight.toml", "-o", f"run{k}", "-q", "--plugin", "push.py"]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": paths})
        assert done.returncode == 0, done.stderr
        with thirdbody.open(folder / f"run{k}") as run:
            found.append(float(run.bodies(-1)["velocity"][0, 0]) / float(run.times[-1]))
    return found


# what a kernel reaches is part of the name of its module: tests/unit/test_dependencies.py
@pytest.mark.full(kind="slow")
def test_an_edited_neighbour_of_a_plug_in_is_noticed(tmp_path):
    beside = "import sys\nsys.path.insert(0, __file__.rpartition('/')[0])\nfrom push_strength import strength\n"
    source = "from thirdbody.plugin import kernel\n@kernel\ndef strength(b):\n    return {}\n"
    first = {"push.py": beside + PUSH.format(push="strength(b)"), "push_strength.py": source.format("1e-9")}
    found = flown(tmp_path, [first, {"push_strength.py": source.format("3e-9")}, {"push_strength.py": source.format("1e-9")}])
    mass = 7850.0 * 4.0 / 3.0 * np.pi * 5e-6**3
    # a constant force: velocity Verlet is exact, what is left is rounding over some thousand steps
    assert found == pytest.approx([1e-9 / mass, 3e-9 / mass, 1e-9 / mass], rel=1e-10)


@pytest.mark.full(kind="slow")
@pytest.mark.parametrize("part", ["helper.py", "strength.txt"])
def test_an_edited_part_of_an_installed_package_is_noticed(part, tmp_path):
    """A plug-in takes a kernel from a package, which multiplies it by a number that it reads from a file."""
    read = "float((Path(__file__).parent / 'strength.txt').read_text())"
    helper = f"from pathlib import Path\nfrom numba import njit\nREAD = {read}\n@njit\ndef strength(b):\n    return {{}} * READ\n"
    first = {"push.py": "from push_package.helper import strength\n" + PUSH.format(push="strength(b)"),
             "site/push_package/helper.py": helper.format(1.0), "site/push_package/strength.txt": "1e-9"}  # fmt: skip
    found = flown(tmp_path, [first, {f"site/push_package/{part}": helper.format(3.0) if part == "helper.py" else "3e-9"}])
    assert found[1] == pytest.approx(3.0 * found[0], rel=1e-10)


class Point:
    def __init__(self, name, result):
        self.name, self.result, self.module = name, result, f"module_of_{name}"

    def load(self):
        if isinstance(self.result, Exception):
            raise self.result
        return self.result


@pytest.fixture
def installed(monkeypatch):
    real, commands = registry.entry_points, command_group.command_points()

    def put(wanted, *points):
        def found(group):
            return [*real(group=group), *(points if group == wanted else [])]

        monkeypatch.setattr(registry, "entry_points", found)
        named = {point.name: point for point in points if wanted == command_group.COMMAND_GROUP}
        monkeypatch.setattr(command_group, "command_points", lambda: commands | named)

    return put


def test_a_broken_plug_in_is_reported_and_stops_nothing(installed, balls, command):
    installed("thirdbody.plugins", Point("rusty", ModuleNotFoundError("No module named 'rust'")), Point("empty", object()))
    report = command("laws")
    assert report.code == 0
    assert "plug-in rusty did not load: ModuleNotFoundError: No module named 'rust'" in report.out
    assert "plug-in empty did not load: TypeError: the entry point is a object, not a Plugin(...)" in report.out
    assert "three_spot" in report.out
    balls()
    assert command("check", "scene.toml").code == 0
    balls(("[solver]", '[contact]\nlaw = "rusty"\n[solver]'))
    report = command("check", "scene.toml")
    assert report.code == 3 and "no law 'rusty' is installed" in report.err and "No module named 'rust'" in report.err


def test_two_plug_ins_with_one_name_are_refused(installed, balls, command):
    installed("thirdbody.plugins", Point("twin", registry.load_file(DMT)))
    with pytest.raises(UsageError, match="both bring 'dmt_adhesion'"):
        discover([DMT])
    balls()
    report = command("check", "scene.toml", "--plugin", DMT)
    assert report.code == 2 and "both bring 'dmt_adhesion'" in report.err and "Traceback" not in report.err


def test_a_plug_in_brings_a_command(installed, command):
    import typer

    def weigh(grams: float, twice: bool = False) -> None:
        """Weigh debris."""
        typer.echo(f"{2 * grams if twice else grams:g} g")

    installed("thirdbody.commands", Point("weigh", weigh))
    assert command("weigh", "3", "--twice").out == "6 g\n"
    assert "Weigh debris." in command("weigh", "--help").out
    report = command("weigh", "heavy")
    assert report.code == 2 and "'grams'" in report.err


def test_help_lists_commands_of_plug_ins_without_importing_them(installed, command):
    installed("thirdbody.commands", Point("weigh", AssertionError("imported")))
    report = command("--help")
    assert report.code == 0 and "weigh" in report.out and "module_of_weigh" in report.out
    shown = " ".join(report.out.split())
    assert "balance Balance of a single particle between two bodies" in shown and "map Draw the map of regimes" in shown


def test_a_broken_command_is_reported(installed, command):
    installed("thirdbody.commands", Point("weigh", ImportError("no scales")))
    report = command("weigh", "3")
    assert report.code == 2 and "Traceback" not in report.err
    assert "weigh: this command of module_of_weigh does not load: ImportError: no scales" in report.err
    # and a plug-in cannot take the name of a command
    installed("thirdbody.commands", Point("laws", ImportError("never loaded")))
    assert "three_spot" in command("laws").out


def test_the_template_works_from_a_file_and_changes_the_result(balls, command):
    """DMT pulls each plate towards the ball by 2 pi w R, so the gap is that of the load plus the pull: d ~ N^(2/3). Pressed at
    rest, overlap at either plate; the comparison holds to what is left of the settling, well below the effect."""
    work, radius, load = 0.5, 5e-6, 1e-4
    still = [('motion = {x = {velocity = "0.5 m/s"}}\n', ""), ('distance = "0.1 um"\nsettle = "1 us"', 'duration = "40 us"'),
             ('every = "0.05 um"', 'every = "40 us"'), ('"7e-5 kg/s"', '"7e-4 kg/s"')]  # fmt: skip
    balls(*still)
    assert command("run", "scene.toml", "-o", "dry", "-q").code == 0
    balls(*still, ("[solver]", f'[effects.dmt_adhesion]\nwork_of_adhesion = "{work} J/m2"\n[solver]'))
    report = command("run", "scene.toml", "-o", "without", "-q")
    assert report.code == 3 and "no effect 'dmt_adhesion' is installed" in report.err and "--plugin FILE" in report.err
    assert command("run", "scene.toml", "-o", "sticky", "-q", "--plugin", DMT).code == 0
    with thirdbody.open("dry") as dry, thirdbody.open("sticky") as sticky:
        sunk = [2.0 * radius - run.series["gap"][-1] for run in (dry, sticky)]
        expected = (1.0 + 2.0 * np.pi * work * radius / load) ** (2.0 / 3.0)
        assert sunk[1] / sunk[0] == pytest.approx(expected, rel=1e-3)
        assert expected > 1.05


def test_a_typo_in_a_kernel_or_a_dimension_is_reported_alike_by_the_suite_and_by_a_scene(balls, command, tmp_path):
    text = DMT.read_text(encoding="utf-8")
    balls(("[solver]", '[effects.dmt_adhesion]\nwork_of_adhesion = "50 mJ/m2"\n[solver]'))
    for k, (right, wrong, *words) in enumerate(
        [
            ("p.work_of_adhesion *", "p.work_of_adhesoin *", "'work_of_adhesoin'", '.py", line {line}'),
            ("Adhesion(-pull_off,", "Adhesion(-pull_of,", "NameError", "'pull_of'"),
            ("Adhesion(-pull_off, -pull_off * c.overlap)", "Adhesion(-pull_off)", "Adhesion", "'stored'"),
        ]
    ):
        assert text.count(right) == 1
        words = [word.format(line=text[: text.index(right)].count("\n") + 1) for word in words]
        (tmp_path / f"law{k}.py").write_text(text.replace(right, wrong), encoding="utf-8")
        report = command("laws", "--check", f"law{k}.py")
        (line,) = [line for line in report.out.splitlines() if line.startswith("FAIL")]
        assert report.code == 2 and "dmt_adhesion" in line and "cannot be compiled" in line and "pipeline" not in line
        assert all(word in line for word in words), line
        report = command("check", "scene.toml", "--plugin", f"law{k}.py")
        assert report.code == 2 and report.err.count("\n") == 1 and all(word in report.err for word in words), report.err
        assert report.err.startswith("thirdbody: dmt_adhesion: cannot be compiled: ")
    text = DMT.read_text(encoding="utf-8")
    (tmp_path / "law.py").write_text(text.replace('"energy_per_area"', '"energy_per_aera"'), encoding="utf-8")
    balls(("[solver]", '[effects.dmt_adhesion]\nwork_of_adhesion = "50 mJ/m2"\n[solver]'))
    for arguments in (("laws", "--check", "law.py"), ("check", "scene.toml", "--plugin", "law.py")):
        report = command(*arguments)
        assert report.code == 2 and "option 'work_of_adhesion': unknown dimension 'energy_per_aera'" in report.err
        assert "did you mean 'energy_per_area'?" in report.err and "law.py" in report.err and report.err.count("\n") == 1
