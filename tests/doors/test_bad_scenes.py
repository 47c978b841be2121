"""Faulty scenes through the real command: one clear message, the right exit code, nothing left behind."""

import os

import numpy as np
import pytest
import thirdbody

OTHER = '[materials.glass]\nyoungs_modulus = "70 GPa"\npoisson_ratio = 0.2\ndensity = "2500 kg/m3"\n[[pairs]]'
LOWER, DOMAIN = '[plates.lower]\nmaterial = "steel"', '["80 um", "60 um"]'


def given(x, z="5 um"):
    return "count = 4\nseed = 1", f'positions = [["10 um", "10 um", "5 um"], ["{x}", "10 um", "{z}"]]'


def above(text):
    return "[solver]", f"{text}\n[solver]"


def solver(text):
    return 'settle = "1 us"', text


# what is spoilt; where the fault stands (line:column: key); words that the message must hold (more: `unit/test_scene_faults.py`)
FAULTS = [
    # keys and values
    (("[solver]", "[slover]"), "27:1: slover", "did you mean 'solver'"),
    (('"0.1 mN"', "0.0001"), "24:1: plates.upper.load", "0.0001 has no unit", "force (pN, nN,"),
    (('"5 um"', '"nan um"'), "14:1: debris[0].radius", "nan"),
    # names of materials
    ([("[[pairs]]", OTHER), (LOWER, LOWER.replace("steel", "glass"))], "11:1: pairs", "no pair for 'steel' and 'glass'",
     "debris[0] and plates.lower", "add a [[pairs]] table"),
    # keys that exclude each other or need others
    (('{velocity = "0.5 m/s"}', '{stroke = "1 um"}'), "26:11: plates.upper.motion.x.frequency", "missing"),
    # words of a list
    (solver('integrator = "verlet"'), "29:1: solver.integrator", "'explicit'", "'implicit'"),
    (solver("rate_test = 3"), "29:1: solver.rate_test", "thirdbody cost SCENE", "mu_of_inertia"),
    (solver('initial_overlap = "relaxed"'), "29:1: solver.initial_overlap", "'refuse', 'relax'"),
    # names of laws, levels, effects and their options
    (above("[contact]\nsprings = 32"), "28:1: contact.springs", "belongs to", "mdr"),
    (above('[contact]\nlevel = "mdr"\nsprings = 32.5'), "27:1: contact.law", "springs = 32.5 must be a whole number"),
    (above('[contact]\nlevel = "mdr"\nsprings = 2'), "29:1: contact.springs", "between 4"),
    (above('[contact]\nlaw = "three_spt"'), "28:1: contact.law", "'three_spot'"),
    (above('[contact]\nlevel = "mindln"'), "28:1: contact.level", "not a level of 'three_spot', did you mean 'mindlin'"),
    (above("[contact]\nstiffnes = 3"), "28:1: contact.stiffnes", "unknown key", "known: debris_contact, law, level"),
    (above("[effects]\ndampin = 1"), "28:1: effects.dampin", "'damping'"),
    (above('[effects.damping]\nrat = "1 1/s"'), "28:1: effects.damping.rat", "unknown key, did you mean 'rate'"),
    (above("[effects.damping]"), "27:1: effects.damping", "required key 'rate' is missing"),
    (above('[effects.damping]\nrate = "1 m"'), "28:1: effects.damping.rate", "'1 m' is a length, expected a rate"),
    (above('[effects.damping]\nrate = "-1 1/s"'), "28:1: effects.damping.rate", "-1 1/s must be at least 0"),
    # what only the building of the bodies shows
    (given("19 um"), "15:42: debris[0].positions[1]", "bodies 0 and 1 overlap by 1 um"),
    (given("40 um", "4 um"), "15:42: debris[0].positions[1]", "body 1 starts 1 um deep in the lower plate"),
    ([given("-10 um"), ('"60 um"]', '"60 um"]\nperiodic = false')], "15:42: debris[0].positions[1]",
     "body 1 starts at x, y = -10 um, 10 um", "0 to 80 um"),
    ([given("90 um"), ('"60 um"]', '"60 um"]\nperiodic = false')], "15:42: debris[0].positions[1]", "x, y = 90 um, 10 um"),
    ([('"load_per_particle"', '"rigid"'), ('load = "0.1 mN"', 'gap = "9 um"')], "24:1: plates.upper.gap",
     "9 um is smaller than body 0, which is 10 um tall"),
    ([(DOMAIN, '["22 um", "22 um"]'), ("count = 4", "count = 5")], "18:1: domain.size", "no space for body",
     "of 5 bodies placed", "make domain.size larger or count smaller"),
    ((DOMAIN, '["9 um", "60 um"]'), "18:1: domain.size", "does not fit"),
    (("count = 4", "count = 10000000"), "15:1: debris[0].count", "would cover the domain (80 um by 60 um)",
     "lower count or enlarge domain.size"),
    ([(DOMAIN, '["19 um", "60 um"]'), ("count = 4", "count = 2")], "18:1: domain.size",
     "a periodic side must be at least 21.2 um"),
    (solver('settle = "1 us"\ntime_step = "500 ns"'), "30:1: solver.time_step", "500 ns is above the bound 5.29 ns",
     '"auto" would take 1.06 ns', "--force"),
    (solver('settle = "1 us"\ntime_step = "1e-25 s"'), "30:1: solver.time_step", "steps for 1.2 us", '"auto" would take'),
    (("seed = 1", "count = 5"), "16:10", "not valid TOML", "overwrite"),
]  # fmt: skip


def test_a_fault_of_the_scene_is_reported_with_its_place(balls, command, tmp_path):
    for k, (changes, place, *words) in enumerate(FAULTS):
        balls(*([changes] if isinstance(changes, tuple) else changes))
        for verb in ("check", "run")[: 1 + (k % 9 == 0)]:
            report = command(verb, "scene.toml")
            lines = report.err.strip().splitlines()
            assert report.code == 3 and len(lines) == 1 and not report.out, (place, report)
            assert lines[0].startswith(f"thirdbody: scene.toml:{place}: "), lines[0]
            assert all(word in lines[0] for word in words), (words, lines[0])
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]
    balls(given("79 um"))  # 11 um apart through the border
    assert command("check", "scene.toml").code == 0
    # several faults are reported at once
    balls(("density", "densty"), ("count = 4", "count = -4"), ('"0.5 m/s"', '"0.5 m"'))
    report = command("check", "scene.toml")
    places = ["materials.steel.densty", "debris[0].count", "plates.upper.motion.x.velocity"]
    assert report.code == 3 and [line.split(": ")[1] for line in report.err.splitlines()] == places


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="nothing is read-only for the superuser")
def test_a_read_only_folder_is_reported(balls, command, tmp_path):
    balls()
    (tmp_path / "locked").mkdir(mode=0o500)
    report = command("run", "scene.toml", "-o", "locked/run")
    assert report.code == 5 and "read-only" in report.err and "Traceback" not in report.err


def test_a_forced_time_step_is_stopped_by_a_guard_and_keeps_what_it_has(balls, command):
    balls(('settle = "1 us"', 'settle = "1 us"\ntime_step = "500 ns"'))
    assert command("run", "scene.toml", "-o", "run").code == 3
    report = command("run", "scene.toml", "-o", "run", "--force")
    last = report.err.splitlines()[-1]
    assert report.code == 4 and last.startswith("thirdbody: stopped at t = ") and "body" in last and "guard" in last
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
        ('distance = "0.1 um"\nsettle = "1 us"', 'duration = "40 us"'), ('every = "0.05 um"', 'every = "2 us"'),
    )  # fmt: skip
    report = command("run", "scene.toml", "-o", "run", "--quiet")
    assert report.code == 4 and "body 0 at (8e-05" in report.err and "left the domain" in report.err
    with thirdbody.open("run") as run:
        assert run.frames == 13  # 0, 2, ... 24 us
        x = [run.bodies(k)["position"][0, 0] for k in range(run.frames)]
        # free flight: exact to rounding of some ten thousand additions
        assert np.allclose(x, 55e-6 + run.times, rtol=1e-10)


def test_a_bug_of_ours_asks_for_a_report(balls, command, monkeypatch):
    balls()
    monkeypatch.setattr("thirdbody.assembly.simulation.populate", lambda scene: 1 / 0)
    report = command("check", "scene.toml")
    assert report.code == 1 and "Traceback" in report.err and "please report it" in report.err
