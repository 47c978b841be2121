"""Faulty scenes and calls through the real command: one clear message, the right exit code, nothing left behind."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

import thirdbody

GIVEN = 'positions = [["10 um", "10 um", "5 um"], ["{x}", "10 um", "{z}"]]'
OTHER = '[materials.glass]\nyoungs_modulus = "70 GPa"\npoisson_ratio = 0.2\ndensity = "2500 kg/m3"\n[[pairs]]'


def given(x: str, z: str = "5 um") -> tuple[str, str]:
    """Two balls at given positions, the second one at x, z."""
    return "count = 4\nseed = 1", GIVEN.format(x=x, z=z)


# what is spoilt; where the fault stands (line:column: key); words that the message must hold
FAULTS = {
    # keys at several levels, with the nearest name
    "key at the top": ([("title", "titel")], "1:1: titel", ["did you mean 'title'"]),
    "key of a material": ([("density", "densty")], "6:1: materials.steel.densty", ["did you mean 'density'"]),
    "key of a plate": ([("load =", "laod =")], "24:1: plates.upper.laod", ["did you mean 'load'"]),
    "key in a list": ([("radius", "raduis")], "14:1: debris[0].raduis", ["did you mean 'radius'"]),
    "key deep in a line": ([("velocity", "velosity")], "26:16: plates.upper.motion.x.velosity", ["'velocity'"]),
    "name of a table": ([("[solver]", "[slover]")], "27:1: slover", ["did you mean 'solver'"]),
    # values
    "wrong unit": ([('"5 um"', '"5 N"')], "14:1: debris[0].radius", ["'5 N' is a force, expected a length"]),
    "unknown unit": ([('"5 um"', '"5 mu"')], "14:1: debris[0].radius", ["unknown unit 'mu'"]),
    "bare number": ([('"0.1 mN"', "0.0001")], "24:1: plates.upper.load", ["0.0001 has no unit", "force (pN, nN,"]),
    "negative radius": ([('"5 um"', '"-5 um"')], "14:1: debris[0].radius", ["'-5 um' must be greater than 0"]),
    "friction not a number": ([("friction = 0.30", "friction = nan")], "9:1: pairs[0].friction", ["nan", "finite"]),
    "radius not a number": ([('"5 um"', '"nan um"')], "14:1: debris[0].radius", ["nan"]),
    "restitution above one": ([("0.60", "1.60")], "10:1: pairs[0].restitution", ["1.6", "at most 1"]),
    "zero bodies": ([("count = 4", "count = 0")], "15:1: debris[0].count", ["0 must be at least 1"]),
    "no debris": ([("[[debris]]", "[[effects.x]]")], "1:1: debris", ["at least one [[debris]] table is needed"]),
    # names of materials
    "missing pair": (
        [("[[pairs]]", OTHER), ('[plates.lower]\nmaterial = "steel"', '[plates.lower]\nmaterial = "glass"')],
        "11:1: pairs",
        ["no pair for 'steel' and 'glass'", "debris[0] and plates.lower", "add a [[pairs]] table"],
    ),
    "unknown material": (
        [('[plates.lower]\nmaterial = "steel"', '[plates.lower]\nmaterial = "stel"')],
        "20:1: plates.lower.material",
        ["unknown material 'stel', did you mean 'steel'"],
    ),
    # keys that exclude each other
    "load and gap": ([('load = "0.1 mN"', 'load = "0.1 mN"\ngap = "9 um"')], "25:1: plates.upper.gap", ["only one"]),
    "upper without lower": ([('[plates.lower]\nmaterial = "steel"\n', "")], "19:1: plates.upper", ["[plates.lower]"]),
    # known to the format, but later
    "foundation without stiffness": (
        [('"load_per_particle"', '"foundation"')],
        "21:1: plates.upper.stiffness",
        ["missing", "1e4 N/m"],
    ),
    "stroke without frequency": (
        [('{velocity = "0.5 m/s"}', '{stroke = "1 um"}')],
        "26:11: plates.upper.motion.x.frequency",
        ["missing"],
    ),
    "integrator": ([('settle = "1 us"', 'integrator = "verlet"')], "29:1: solver.integrator", ["'explicit'", "'implicit'"]),
    "rate test": ([('settle = "1 us"', "rate_test = 3")], "29:1: solver.rate_test", ["thirdbody cost SCENE", "mu_of_inertia"]),
    "relaxed": ([('settle = "1 us"', 'initial_overlap = "relaxed"')], "29:1: solver.initial_overlap", ["'refuse', 'relax'"]),
    "heaps": ([('"spheres"', '"heaps"')], "13:1: debris[0].kind", ["is not one of", "'spheres'", "'spots'", "'file'"]),
    "heap": ([("seed = 1", 'placement = "heap"')], "16:1: debris[0].placement", ["'layer'", "'dense'"]),
    "springs": ([("[solver]", "[contact]\nsprings = 32\n[solver]")], "28:1: contact.springs", ["belongs to", "mdr"]),
    "half a spring": (
        [("[solver]", '[contact]\nlevel = "mdr"\nsprings = 32.5\n[solver]')],
        "27:1: contact.law",
        ["springs = 32.5 must be a whole number"],
    ),
    "too few springs": (
        [("[solver]", '[contact]\nlevel = "mdr"\nsprings = 2\n[solver]')],
        "29:1: contact.springs",
        ["between 4"],
    ),
    # names of laws, levels, effects and their options
    "law": ([("[solver]", '[contact]\nlaw = "three_spt"\n[solver]')], "28:1: contact.law", ["'three_spot'"]),
    "level": (
        [("[solver]", '[contact]\nlevel = "mindln"\n[solver]')],
        "28:1: contact.level",
        ["not a level of 'three_spot', did you mean 'mindlin'"],
    ),
    "option of the law": (
        [("[solver]", "[contact]\nstiffnes = 3\n[solver]")],
        "28:1: contact.stiffnes",
        ["unknown key", "known: debris_contact, law, level"],
    ),
    "effect": ([("[solver]", "[effects]\ndampin = 1\n[solver]")], "28:1: effects.dampin", ["'damping'"]),
    "option of an effect": (
        [("[solver]", '[effects.damping]\nrat = "1 1/s"\n[solver]')],
        "28:1: effects.damping.rat",
        ["unknown key, did you mean 'rate'"],
    ),
    "missing option of an effect": (
        [("[solver]", "[effects.damping]\n[solver]")],
        "27:1: effects.damping",
        ["required key 'rate' is missing"],
    ),
    "unit of an effect": (
        [("[solver]", '[effects.damping]\nrate = "1 m"\n[solver]')],
        "28:1: effects.damping.rate",
        ["'1 m' is a length, expected a rate"],
    ),
    "range of an effect": (
        [("[solver]", '[effects.damping]\nrate = "-1 1/s"\n[solver]')],
        "28:1: effects.damping.rate",
        ["-1 1/s must be at least 0"],
    ),
    # what only the building of the bodies shows
    "overlapping start": ([given("19 um")], "15:42: debris[0].positions[1]", ["bodies 0 and 1 overlap by 1 um"]),
    "overlap through the border": ([given("79 um")], "", []),  # 11 um apart through the border: none
    "inside the lower plate": (
        [given("40 um", "4 um")],
        "15:42: debris[0].positions[1]",
        ["body 1 starts 1 um deep in the lower plate"],
    ),
    "outside the domain": (
        [given("-10 um"), ('"60 um"]', '"60 um"]\nperiodic = false')],
        "15:42: debris[0].positions[1]",
        ["body 1 starts at x, y = -10 um, 10 um", "0 to 80 um"],
    ),
    "gap smaller than a particle": (
        [('"load_per_particle"', '"rigid"'), ('load = "0.1 mN"', 'gap = "9 um"')],
        "24:1: plates.upper.gap",
        ["9 um is smaller than body 0, which is 10 um tall"],
    ),
    "domain too small for the layer": (
        [('["80 um", "60 um"]', '["22 um", "22 um"]'), ("count = 4", "count = 5")],
        "18:1: domain.size",
        ["no space for body", "of 5 bodies placed", "make domain.size larger or count smaller"],
    ),
    "domain smaller than a body": ([('["80 um", "60 um"]', '["9 um", "60 um"]')], "18:1: domain.size", ["does not fit"]),
    "count out of all proportion": (
        [("count = 4", "count = 10000000")],
        "15:1: debris[0].count",
        ["would cover the domain (80 um by 60 um)", "lower count or enlarge domain.size"],
    ),
    "narrow periodic domain": (
        [('["80 um", "60 um"]', '["19 um", "60 um"]'), ("count = 4", "count = 2")],
        "18:1: domain.size",
        ["a periodic side must be at least 21.2 um"],
    ),
    "time step 100 times too large": (
        [('settle = "1 us"', 'settle = "1 us"\ntime_step = "500 ns"')],
        "30:1: solver.time_step",
        ["500 ns is above the bound 5.29 ns", '"auto" would take 1.06 ns', "--force"],
    ),
    "time step that never ends": (
        [('settle = "1 us"', 'settle = "1 us"\ntime_step = "1e-25 s"')],
        "30:1: solver.time_step",
        ["steps for 1.2 us", '"auto" would take'],
    ),
    # not TOML
    "syntax": ([("seed = 1", "seed = = 1")], "16:8", ["not valid TOML"]),
    "key twice": ([("seed = 1", "count = 5")], "16:10", ["not valid TOML", "overwrite"]),
}
SOUND = [name for name, (_, _, words) in FAULTS.items() if not words]


@pytest.mark.parametrize("name", [name for name in FAULTS if name not in SOUND])
def test_a_fault_of_the_scene_is_reported_with_its_place(name, balls, command, tmp_path):
    changes, place, words = FAULTS[name]
    balls(*changes)
    for report in (command("check", "scene.toml"), command("run", "scene.toml", "--quiet")):
        assert report.code == 3
        lines = report.err.strip().splitlines()
        assert len(lines) == 1, report.err
        assert lines[0].startswith(f"thirdbody: scene.toml:{place}: "), lines[0]
        for word in words:
            assert word in lines[0]
        assert not report.out and "Traceback" not in report.err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


@pytest.mark.parametrize("name", SOUND)
def test_what_only_resembles_a_fault_is_accepted(name, balls, command):
    balls(*FAULTS[name][0])
    assert command("check", "scene.toml").code == 0


def test_several_faults_are_reported_at_once(balls, command):
    balls(("density", "densty"), ("count = 4", "count = -4"), ('"0.5 m/s"', '"0.5 m"'))
    report = command("check", "scene.toml")
    assert report.code == 3
    assert [line.split(": ")[1] for line in report.err.splitlines()] == [
        "materials.steel.densty",
        "debris[0].count",
        "plates.upper.motion.x.velocity",
    ]


# arguments after the command, the exit code, words of the one message
CALLS = {
    "missing file": (["no.toml"], 3, ["no.toml: no such file"]),
    "folder": (["."], 3, [".: is a folder, expected a scene file"]),
    "not UTF-8": (["latin.toml"], 3, ["latin.toml:1:10", "UTF-8"]),
    "unknown --set key": (["scene.toml", "--set", "solver.distnce=1 um"], 3, ["--set: solver.distnce", "'distance'"]),
    "unknown --set table": (["scene.toml", "--set", "slover.distance=1 um"], 3, ["--set: slover", "'solver'"]),
    "--set beyond a list": (["scene.toml", "--set", "debris.1.count=3"], 3, ["--set: debris.1.count", "0 to 0"]),
    "--set of a wrong unit": (["scene.toml", "--set", "solver.distance=1 N"], 3, ["--set: solver.distance", "a force"]),
    "--set without a value": (["scene.toml", "--set", "solver.distance"], 2, ["write KEY=VALUE"]),
    "missing plug-in": (["scene.toml", "--plugin", "no.py"], 2, ["plug-in no.py: no such file"]),
    "broken plug-in": (["scene.toml", "--plugin", "broken.py"], 2, ["broken.py", "ZeroDivisionError"]),
    "plug-in without PLUGIN": (["scene.toml", "--plugin", "empty.py"], 2, ["empty.py", "PLUGIN = Plugin(...)"]),
    "plug-in that is a folder": (["scene.toml", "--plugin", "."], 2, ["plug-in .: no such file"]),
    "plug-in that does not compile": (
        ["scene.toml", "--plugin", "kernel.py", "--set", "effects.wrong=true"],
        2,
        ["wrong: cannot be compiled", "'nothing'", "kernel.py"],
    ),
}
RUNS = {
    "no threads": (["scene.toml", "--threads", "0"], 2, ["--threads"]),
    "threads in words": (["scene.toml", "--threads", "two"], 2, ["--threads"]),
    "existing folder": (["scene.toml", "-o", "here"], 5, ["here: exists already", "--overwrite"]),
    "folder of something else": (["scene.toml", "-o", "here", "--overwrite"], 5, ["here: is not the folder of a run"]),
    "a file in place of the folder": (["scene.toml", "-o", "broken.py", "--overwrite"], 5, ["broken.py", "not the folder"]),
    "a file above the folder": (["scene.toml", "-o", "broken.py/run"], 5, ["broken.py/run", "is not a folder"]),
}
KERNEL = """
from typing import NamedTuple
from thirdbody.plugin import Adhesion, Law, Plugin, kernel
class Numbers(NamedTuple):
    w: float
@kernel
def wrong(c, n, p):
    return Adhesion(-p.w * c.nothing, 0.0)
LAW = Law("wrong", "adhesion", wrong, Numbers, lambda pair, options: Numbers(1.0), "none")
PLUGIN = Plugin("wrong", effects=(LAW,))
"""


@pytest.mark.parametrize(
    ("verb", "name"), [("check", name) for name in CALLS] + [("run", name) for name in CALLS | RUNS], ids=str
)
def test_a_fault_of_the_call_is_reported(verb, name, balls, command, tmp_path):
    arguments, code, words = (CALLS | RUNS)[name]
    balls()
    (tmp_path / "latin.toml").write_bytes(b'title = "\xb5m"\n')
    (tmp_path / "broken.py").write_text("1 / 0\n")
    (tmp_path / "empty.py").write_text("x = 1\n")
    (tmp_path / "kernel.py").write_text(KERNEL)
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "precious").write_text("x")
    before = everything(tmp_path)
    report = command(verb, *arguments)
    assert report.code == code, report
    for word in words:
        assert word in report.err
    assert not report.out and "Traceback" not in report.err
    assert everything(tmp_path) == before


def everything(folder):
    return sorted(path for path in folder.rglob("*") if "__pycache__" not in path.parts)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="nothing is read-only for the superuser")
def test_a_read_only_folder_is_reported(balls, command, tmp_path):
    balls()
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    report = command("run", "scene.toml", "-o", "locked/run")
    assert report.code == 5 and "read-only" in report.err and "Traceback" not in report.err


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (["chek", "scene.toml"], 2, "did you mean 'check'?"),
        (["--verison"], 2, "--version"),
        (["check"], 2, "SCENE"),
        (["check", "scene.toml", "--sett", "a=b"], 2, "--set"),
        ([], 2, ""),
        (["states", "."], 3, "no such run"),
        (["states", "nothing"], 3, "nothing: no such run"),
        (["states", "scene.toml"], 3, "not a run of thirdbody"),
        (["render", "nothing", "-o", "x.png"], 3, "nothing: no such run"),
        (["laws", "--check", "nothing.py"], 2, "nothing.py: no such file"),
        (["new", "scene.toml"], 5, "scene.toml: exists already"),
        (["new", "no/scene.toml"], 5, "cannot be written"),
    ],
)
def test_other_calls_that_cannot_work(arguments, code, word, balls, command):
    balls()
    report = command(*arguments)
    assert report.code == code and word in report.err and "Traceback" not in report.err


def test_frames_that_are_not_there(balls, command):
    balls()
    assert command("run", "scene.toml", "-o", "run", "--quiet").code == 0
    for arguments in (["states", "run", "--frame", "99"], ["render", "run", "--frame", "99", "-o", "x.png"]):
        report = command(*arguments)
        assert report.code == 3 and "no frame 99; frames are from -4 to 3" in report.err and "Traceback" not in report.err
    report = command("render", "run", "-o", "x.png", "--color", "velocty")
    assert report.code == 3 and "did you mean 'velocity'" in report.err
    report = command("render", "run", "-o", "x.jpg")
    assert report.code == 3 and "name it .png" in report.err


def test_a_forced_time_step_is_stopped_by_a_guard_and_keeps_what_it_has(balls, command):
    balls(('settle = "1 us"', 'settle = "1 us"\ntime_step = "500 ns"'))
    assert command("run", "scene.toml", "-o", "run").code == 3
    report = command("run", "scene.toml", "-o", "run", "--force")
    assert report.code == 4
    last = report.err.splitlines()[-1]
    assert last.startswith("thirdbody: stopped at t = ") and "body" in last and "guard" in last
    with thirdbody.open("run") as run:
        assert run.frames >= 1 and not run.summary()["finished"] and run.summary()["stopped"] == last[11:]
    assert command("states", "run").code == 0


def test_a_guard_in_the_middle_keeps_the_frames_before_it(balls, command):
    """A ball flies out of an open domain: 25 us at 1 m/s from 25 um before its end, a frame every 2 us."""
    balls(
        ("count = 4\nseed = 1", 'positions = [["55 um", "30 um", "6 um"]]\nvelocity = ["1 m/s", "0 m/s", "0 m/s"]'),
        ('"60 um"]', '"60 um"]\nperiodic = false'),
        ('[plates.upper]\nmaterial = "steel"\nsupport = "load_per_particle"\nload = "0.1 mN"\n', "[effects]\n"),
        ('damping = "7e-5 kg/s"\nmotion = {x = {velocity = "0.5 m/s"}}\n', ""),
        ('distance = "0.1 um"\nsettle = "1 us"', 'duration = "40 us"'),
        ('every = "0.05 um"', 'every = "2 us"'),
    )
    report = command("run", "scene.toml", "-o", "run", "--quiet")
    assert report.code == 4 and "body 0 at (8e-05" in report.err and "left the domain" in report.err
    with thirdbody.open("run") as run:
        assert run.frames == 13  # 0, 2, ... 24 us
        x = [run.bodies(k)["position"][0, 0] for k in range(run.frames)]
        # free flight: exact to rounding of some ten thousand additions
        assert np.allclose(x, 55e-6 + run.times, rtol=1e-10)


def test_the_real_command_says_the_same(balls, tmp_path):
    """Once in a process of its own: the entry point, its exit code and its standard error."""
    balls(("density", "densty"))
    call = [sys.executable, "-m", "thirdbody.cli.main", "run", "scene.toml"]
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 3 and not done.stdout
    assert done.stderr == "thirdbody: scene.toml:6:1: materials.steel.densty: unknown key, did you mean 'density'?\n"
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def test_a_bug_of_ours_asks_for_a_report(balls, command, monkeypatch):
    balls()
    monkeypatch.setattr("thirdbody.assembly.simulation.populate", lambda scene: 1 / 0)
    report = command("check", "scene.toml")
    assert report.code == 1 and "Traceback" in report.err and "please report it" in report.err
