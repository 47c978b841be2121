"""Plug-ins: found, refused, told about; an edited law is never run from a stale cache."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

import thirdbody
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

FLIGHT = """\
scene = 1
[materials.steel]
youngs_modulus = "210 GPa"
poisson_ratio = 0.30
density = "7850 kg/m3"
[[debris]]
material = "steel"
kind = "spheres"
radius = "5 um"
positions = [["10 um", "10 um", "10 um"]]
[domain]
size = ["80 um", "60 um"]
[effects]
push = true
[solver]
duration = "1 us"
[output]
every = "1 us"
"""


def fly(folder: Path, out: str, installed: Path | None = None) -> float:
    """Speed along x after 1 us under the push, simulated in a process of its own, with a folder of installed packages."""
    command = [sys.executable, "-m", "thirdbody.cli.main", "run", "flight.toml", "-o", out, "-q", "--plugin", "push.py"]
    paths = os.pathsep.join(filter(None, [str(installed or ""), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": paths})
    assert done.returncode == 0, done.stderr
    with thirdbody.open(folder / out) as run:
        return float(run.bodies(-1)["velocity"][0, 0]) / float(run.times[-1])


def test_an_edited_plug_in_is_compiled_anew(tmp_path):
    """The acceleration is push over mass, so doubling the constant in the file must double it; back again, too."""
    (tmp_path / "flight.toml").write_text(FLIGHT)
    found = []
    for k, push in enumerate(("1e-9", "2e-9", "1e-9")):
        (tmp_path / "push.py").write_text(PUSH.format(push=push))
        found.append(fly(tmp_path, f"run{k}"))
    mass = 7850.0 * 4.0 / 3.0 * np.pi * 5e-6**3
    # a constant force: velocity Verlet is exact, what is left is rounding over some thousand steps
    assert found == pytest.approx([1e-9 / mass, 2e-9 / mass, 1e-9 / mass], rel=1e-10)
    assert found[0] == found[2]


def test_an_edited_neighbour_of_a_plug_in_is_noticed(tmp_path):
    """The kernel's own file stays the same; what changes is a kernel that it takes from a file beside it."""
    (tmp_path / "flight.toml").write_text(FLIGHT)
    beside = "import sys\nsys.path.insert(0, __file__.rpartition('/')[0])\nfrom push_strength import strength\n"
    (tmp_path / "push.py").write_text(beside + PUSH.format(push="strength(b)"))
    found = []
    for k, push in enumerate(("1e-9", "3e-9")):
        source = f"from thirdbody.plugin import kernel\n@kernel\ndef strength(b):\n    return {push}\n"
        (tmp_path / "push_strength.py").write_text(source)
        found.append(fly(tmp_path, f"run{k}"))
    assert found[1] == pytest.approx(3.0 * found[0], rel=1e-10)


@pytest.mark.parametrize("part", ["helper.py", "strength.txt"])
def test_an_edited_part_of_an_installed_package_is_noticed(part, tmp_path):
    """A plug-in takes a kernel from a package, which multiplies it by a number that it reads from a file."""
    (tmp_path / "flight.toml").write_text(FLIGHT)
    (tmp_path / "push.py").write_text("from push_package.helper import strength\n" + PUSH.format(push="strength(b)"))
    package = tmp_path / "site-packages" / "push_package"
    package.mkdir(parents=True)
    read = "float((Path(__file__).parent / 'strength.txt').read_text())"
    helper = f"from pathlib import Path\nfrom numba import njit\nREAD = {read}\n@njit\ndef strength(b):\n    return {{}} * READ\n"
    found = []
    for k, factor in enumerate((1.0, 3.0)):
        (package / "helper.py").write_text(helper.format(factor if part == "helper.py" else 1.0))
        (package / "strength.txt").write_text(str(1e-9 * (factor if part == "strength.txt" else 1.0)))
        found.append(fly(tmp_path, f"run{k}", package.parent))
    assert found[1] == pytest.approx(3.0 * found[0], rel=1e-10)


# entry points -------------------------------------------------------------------------------------------------------------


class Point:
    """An installed entry point that gives what it is told to."""

    def __init__(self, name: str, result: object):
        self.name, self.result, self.module = name, result, f"module_of_{name}"

    def load(self) -> object:
        if isinstance(self.result, Exception):
            raise self.result
        return self.result


@pytest.fixture
def installed(monkeypatch):
    """Puts entry points of a group beside those that are really installed."""
    real = registry.entry_points

    def put(wanted: str, *points: Point) -> None:
        def found(group: str) -> list[object]:
            return [*real(group=group), *(points if group == wanted else [])]

        monkeypatch.setattr(registry, "entry_points", found)
        monkeypatch.setattr("thirdbody.cli.command_group.entry_points", found)

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


def test_a_law_of_a_broken_plug_in_is_reported_with_the_reason(installed, balls, command):
    installed("thirdbody.plugins", Point("rusty", ModuleNotFoundError("No module named 'rust'")))
    balls(("[solver]", '[contact]\nlaw = "rusty"\n[solver]'))
    report = command("check", "scene.toml")
    assert report.code == 3
    assert "no law 'rusty' is installed" in report.err and "No module named 'rust'" in report.err


def test_two_plug_ins_with_one_name_are_refused(installed, balls, command):
    installed("thirdbody.plugins", Point("twin", registry.load_file(DMT)))
    with pytest.raises(UsageError, match="both bring 'dmt_adhesion'"):
        discover([DMT])
    balls()
    report = command("check", "scene.toml", "--plugin", DMT)
    assert report.code == 2 and "both bring 'dmt_adhesion'" in report.err and "Traceback" not in report.err


def test_real_entry_points_bring_the_flagship():
    found = discover()
    assert "three_spot" in found.families and not found.failures


# commands -----------------------------------------------------------------------------------------------------------------


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
    point = Point("weigh", AssertionError("imported"))
    installed("thirdbody.commands", point)
    report = command("--help")
    assert report.code == 0 and "weigh" in report.out and "module_of_weigh" in report.out


def test_help_reports_what_a_command_of_a_plug_in_does(command):
    report = " ".join(command("--help").out.split())
    assert "balance Balance of a single particle between two bodies" in report and "map Draw the map of regimes" in report


def test_a_broken_command_is_reported(installed, command):
    installed("thirdbody.commands", Point("weigh", ImportError("no scales")))
    report = command("weigh", "3")
    assert report.code == 2 and "Traceback" not in report.err
    assert "weigh: this command of module_of_weigh does not load: ImportError: no scales" in report.err


def test_a_plug_in_cannot_take_the_name_of_a_command(installed, command):
    installed("thirdbody.commands", Point("laws", ImportError("never loaded")))
    assert "three_spot" in command("laws").out


def test_entry_points_have_what_the_commands_use():
    """The stand-in above must not hide a change of the real class."""
    point = EntryPoint("weigh", "scales:weigh", "thirdbody.commands")
    assert (point.name, point.module, point.attr) == ("weigh", "scales", "weigh")


# the template -------------------------------------------------------------------------------------------------------------


def test_the_template_works_from_a_file_and_changes_the_result(balls, command):
    """DMT pulls each plate towards the ball by 2 pi w R, so the gap is that of the load plus the pull: d ~ N^(2/3).

    Pressed at rest, overlap at either plate; the comparison holds to what is left of the settling, well below the effect.
    """
    work, radius, load = 0.5, 5e-6, 1e-4
    still = [
        ('motion = {x = {velocity = "0.5 m/s"}}\n', ""),
        ('distance = "0.1 um"\nsettle = "1 us"', 'duration = "40 us"'),
        ('every = "0.05 um"', 'every = "40 us"'),
        ('"7e-5 kg/s"', '"7e-4 kg/s"'),
    ]
    balls(*still)
    assert command("run", "scene.toml", "-o", "dry", "-q").code == 0
    balls(*still, ("[solver]", f'[effects.dmt_adhesion]\nwork_of_adhesion = "{work} J/m2"\n[solver]'))
    report = command("run", "scene.toml", "-o", "without", "-q")
    assert report.code == 3 and "no effect 'dmt_adhesion' is installed" in report.err
    assert command("run", "scene.toml", "-o", "sticky", "-q", "--plugin", DMT).code == 0
    with thirdbody.open("dry") as dry, thirdbody.open("sticky") as sticky:
        sunk = [2.0 * radius - run.series["gap"][-1] for run in (dry, sticky)]
        expected = (1.0 + 2.0 * np.pi * work * radius / load) ** (2.0 / 3.0)
        assert sunk[1] / sunk[0] == pytest.approx(expected, rel=1e-3)
        assert expected > 1.05


# faults of a plug-in file ---------------------------------------------------------------------------------------------------

TYPOS = {
    "a field that is not there": ("p.work_of_adhesion *", "p.work_of_adhesoin *", ["'work_of_adhesoin'", 'law.py", line {line}']),
    "a name that is not there": ("Adhesion(-pull_off,", "Adhesion(-pull_of,", ["NameError", "'pull_of'"]),
    "a function that is not there": ("math.pi *", "math.pie *", ["'math'", "'pie'"]),
    "an answer that lacks a part": (
        "Adhesion(-pull_off, -pull_off * c.overlap)",
        "Adhesion(-pull_off)",
        ["Adhesion", "'stored'"],
    ),
}


@pytest.mark.parametrize(("right", "wrong", "words"), TYPOS.values(), ids=TYPOS)
def test_a_typo_in_a_kernel_is_reported_alike_by_the_suite_and_by_a_scene(right, wrong, words, balls, command, tmp_path):
    text = DMT.read_text(encoding="utf-8")
    assert text.count(right) == 1
    words = [word.format(line=text[: text.index(right)].count("\n") + 1) for word in words]
    (tmp_path / "law.py").write_text(text.replace(right, wrong), encoding="utf-8")
    balls(("[solver]", '[effects.dmt_adhesion]\nwork_of_adhesion = "50 mJ/m2"\n[solver]'))
    report = command("laws", "--check", "law.py")
    (line,) = [line for line in report.out.splitlines() if line.startswith("FAIL")]
    assert report.code == 2 and "dmt_adhesion" in line and "cannot be compiled" in line and "pipeline" not in line
    assert all(word in line for word in words), line
    report = command("check", "scene.toml", "--plugin", "law.py")
    assert (
        report.code == 2
        and report.err.startswith("thirdbody: dmt_adhesion: cannot be compiled: ")
        and report.err.count("\n") == 1
    )
    assert all(word in report.err for word in words), report.err


@pytest.mark.parametrize("arguments", [("laws", "--check", "law.py"), ("check", "scene.toml", "--plugin", "law.py")])
def test_an_option_of_an_unknown_dimension_is_refused_when_the_file_is_read(arguments, balls, command, tmp_path):
    text = DMT.read_text(encoding="utf-8")
    (tmp_path / "law.py").write_text(text.replace('"energy_per_area"', '"energy_per_aera"'), encoding="utf-8")
    balls(("[solver]", '[effects.dmt_adhesion]\nwork_of_adhesion = "50 mJ/m2"\n[solver]'))
    report = command(*arguments)
    assert report.code == 2 and "option 'work_of_adhesion': unknown dimension 'energy_per_aera'" in report.err
    assert "did you mean 'energy_per_area'?" in report.err and "law.py" in report.err and report.err.count("\n") == 1


def test_an_effect_that_is_missing_is_reported_with_the_option_that_brings_it(balls, command):
    balls(("[solver]", '[effects.dmt_adhesion]\nwork_of_adhesion = "50 mJ/m2"\n[solver]'))
    report = command("check", "scene.toml")
    assert report.code == 3 and "no effect 'dmt_adhesion' is installed" in report.err and "--plugin FILE" in report.err
