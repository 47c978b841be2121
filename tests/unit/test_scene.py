"""The scene file: what is read, how every fault is told and where, and that saving loses nothing."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from thirdbody.errors import InputError, OutputError
from thirdbody.scene.locate import locate
from thirdbody.scene.model import (
    Constant,
    Contact,
    Domain,
    Effects,
    Irregular,
    Lognormal,
    LowerPlate,
    Material,
    Output,
    Pair,
    Plates,
    Scene,
    Solver,
    Spheres,
    UpperPlate,
)

GOOD = """\
scene = 1
title = "what it shows"
[materials.steel]
youngs_modulus = "210 GPa"
poisson_ratio = 0.30
density = "7850 kg/m3"
[[pairs]]
between = ["steel", "steel"]
friction = 0.30
restitution = 0.60
[[debris]]
material = "steel"
kind = "irregular"
count = 2000
seed = 1
size = {distribution = "lognormal", median = "10 um", sigma = 0.2, min = "5 um", max = "20 um"}
spheres = [4, 8]
aspect = [1.0, 0.8, 0.6]
placement = "layer"
[domain]
size = ["600 um", "400 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
motion = {x = {velocity = "1 m/s"}}
[contact]
law = "three_spot"
level = "mdr"
springs = 32
debris_contact = "auto"
[effects]
gravity = ["0 m/s2", "0 m/s2", "-9.81 m/s2"]
[solver]
integrator = "auto"
time_step = "auto"
distance = "20 um"
initial_overlap = "refuse"
[output]
every = "0.5 um"
"""
PAIR = '[[pairs]]\nbetween = ["steel", "steel"]\nfriction = 0.30\nrestitution = 0.60\n'
SIZE = 'size = {distribution = "lognormal", median = "10 um", sigma = 0.2, min = "5 um", max = "20 um"}'
LATER = "is known but not available in this version; available:"


def changed(*changes: tuple[str, str]) -> str:
    """The good scene with each text replaced; fails when a text to replace is not there."""
    text = GOOD
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    return text


def faults_of(text: str) -> list[str]:
    """Every fault of the text, as told."""
    with pytest.raises(InputError) as caught:
        Scene.parse(text, "x.toml")
    return [str(fault).removeprefix("x.toml:") for fault in caught.value.faults]


def test_the_good_scene_is_read():
    scene = Scene.parse(GOOD)
    (debris,) = scene.debris
    assert isinstance(debris, Irregular)
    assert debris.size == Lognormal(median=10e-6, sigma=0.2, min=5e-6, max=20e-6)
    assert (debris.count, debris.spheres, debris.velocity) == (2000, (4, 8), (0.0, 0.0, 0.0))
    assert scene.domain == Domain(size=(600e-6, 400e-6))
    assert scene.plates.upper is not None
    assert (scene.plates.upper.load, scene.plates.upper.motion.velocity()) == (0.1e-3, (1.0, 0.0))
    assert scene.contact.options == {"springs": 32}
    assert scene.effects.gravity == (0.0, 0.0, -9.81)
    assert (scene.solver.distance, scene.solver.settle) == (20e-6, "auto")
    assert (scene.output.every, scene.output.every_kind) == (0.5e-6, "distance")
    assert scene.pair("steel", "steel").friction == 0.3


def test_either_modulus_gives_both():
    by_young = Material(youngs_modulus=210e9, poisson_ratio=0.25, density=7850)
    by_shear = Material(shear_modulus="84 GPa", poisson_ratio=0.25, density=7850)  # 210 / (2 * 1.25)
    assert by_young.shear() == by_shear.shear() == 84e9
    assert by_young.young() == by_shear.young() == 210e9


def test_the_level_belongs_to_the_default_law():
    assert Contact().level == "mindlin"
    assert Contact(law="other").level is None


# one change, the one fault that must be told
ONE_FAULT = [
    # misspelt keys, at every depth, with nothing else told
    ([("title =", "titel =")], "2:1: titel: unknown key, did you mean 'title'?"),
    ([("[materials.steel]", "[material.steel]")], "3:1: material: unknown key, did you mean 'materials'?"),
    (
        [("youngs_modulus", "young_modulus")],
        "4:1: materials.steel.young_modulus: unknown key, did you mean 'youngs_modulus'?",
    ),
    ([("[[pairs]]", "[[pair]]")], "7:1: pair: unknown key, did you mean 'pairs'?"),
    ([("friction", "frictoin")], "9:1: pairs[0].frictoin: unknown key, did you mean 'friction'?"),
    ([("count =", "cuont =")], "14:1: debris[0].cuont: unknown key, did you mean 'count'?"),
    ([("median =", "mdian =")], "16:37: debris[0].size.mdian: unknown key, did you mean 'median'?"),
    ([("[plates.lower]", "[plates.lowr]")], "22:1: plates.lowr: unknown key, did you mean 'lower'?"),
    ([("load =", "laod =")], "27:1: plates.upper.laod: unknown key, did you mean 'load'?"),
    (
        [("velocity =", "velocty =")],
        "28:16: plates.upper.motion.x.velocty: unknown key, did you mean 'velocity'?",
    ),
    ([("distance =", "distnce =")], "39:1: solver.distnce: unknown key, did you mean 'distance'?"),
    ([("every =", "evry =")], "42:1: output.evry: unknown key, did you mean 'every'?"),
    (
        [('["600 um", "400 um"]', '["6 um", "4 um"]\nz = 1')],
        "22:1: domain.z: unknown key, known: periodic, size",
    ),
    # missing keys
    ([("scene = 1\n", "")], "1:1: scene: required key is missing: write scene = 1"),
    ([("poisson_ratio = 0.30\n", "")], "3:1: materials.steel.poisson_ratio: required key is missing"),
    (
        [('kind = "irregular"\n', "")],
        "11:1: debris[0].kind: required key is missing: one of 'irregular', 'spheres'",
    ),
    ([('[output]\nevery = "0.5 um"\n', "")], "1:1: output: required key is missing"),
    ([('every = "0.5 um"\n', "")], "41:1: output.every: required key is missing"),
    ([('load = "0.1 mN"\n', "")], "24:1: plates.upper: give one of load, pressure, gap"),
    ([('distance = "20 um"\n', "")], "36:1: solver: give one of distance, duration"),
    (
        [('youngs_modulus = "210 GPa"\n', "")],
        "3:1: materials.steel: give one of youngs_modulus, shear_modulus",
    ),
    # units
    (
        [('"210 GPa"', '"210 um"')],
        "4:1: materials.steel.youngs_modulus: '210 um' is a length, expected a pressure",
    ),
    (
        [('median = "10 um"', 'median = "10 mu"')],
        "16:37: debris[0].size.median: unknown unit 'mu', did you mean 'um'?",
    ),
    (
        [('"1 m/s"', "1.5")],
        '28:16: plates.upper.motion.x.velocity: no unit: write "1.5 m/s" or another unit of velocity',
    ),
    ([('"400 um"]', "400]")], '21:19: domain.size[1]: no unit: write "400 um" or another unit of length'),
    ([(SIZE, "size = 3")], '16:1: debris[0].size: no unit: write "3 um" or another unit of length'),
    ([(SIZE, 'size = "3 N"')], "16:1: debris[0].size: '3 N' is a force, expected a length"),
    (
        [('time_step = "auto"', 'time_step = "1 um"')],
        "38:1: solver.time_step: '1 um' is a length, expected a time or 'auto'",
    ),
    (
        [('"0.5 um"', "0.5")],
        '42:1: output.every: no unit: write "0.5 um" or another unit of length or time',
    ),
    ([('"0.5 um"', '"5 MPa"')], "42:1: output.every: '5 MPa' is a pressure, expected a length or a time"),
    (
        [('"0.5 um"', '"5 us"\nevery_kind = "time"')],
        "43:1: output.every_kind: unknown key: the unit of every says whether it is a length or a time",
    ),
    # ranges
    ([('"5 um"', '"-5 um"')], "16:69: debris[0].size.min: '-5 um' must be greater than 0"),
    ([('"5 um"', '"50 um"')], "16:69: debris[0].size.min: min must be less than max"),
    ([("count = 2000", "count = -5")], "14:1: debris[0].count: -5 must be at least 1"),
    ([("count = 2000", "count = 20.0")], "14:1: debris[0].count: expected a whole number, got 20.0"),
    ([("count = 2000", 'count = "20"')], "14:1: debris[0].count: expected a whole number, got '20'"),
    ([("seed = 1", "seed = true")], "15:1: debris[0].seed: expected a whole number, got true"),
    (
        [("= 0.30\ndensity", "= 0.7\ndensity")],
        "5:1: materials.steel.poisson_ratio: 0.7 must be greater than -1 and at most 0.5",
    ),
    (
        [("restitution = 0.60", "restitution = 0.0")],
        "10:1: pairs[0].restitution: 0.0 must be greater than 0 and at most 1",
    ),
    ([("friction = 0.30", "friction = nan")], "9:1: pairs[0].friction: nan is not a finite number"),
    ([('"1 m/s"', "inf")], "28:16: plates.upper.motion.x.velocity: inf is not a finite number"),
    ([("[4, 8]", "[8, 4]")], "17:1: debris[0].spheres: the least, 8, is more than the most, 4"),
    ([("[4, 8]", "65")], "17:1: debris[0].spheres: 65 must be at least 1 and at most 64"),
    (
        [("[1.0, 0.8, 0.6]", "[1.0, 0.8]")],
        "18:1: debris[0].aspect: expected a list of 3 values, got 2 of them",
    ),
    ([("0.8, 0.6]", "0.8,\n 1.6]")], "19:2: debris[0].aspect[2]: 1.6 must be greater than 0 and at most 1"),
    ([("scene = 1", "scene = 2")], "1:1: scene: 2 must be 1"),
    # types
    ([('"what it shows"', "5")], "2:1: title: expected a text, got 5"),
    ([("[[debris]]", "[debris]")], "11:1: debris: expected a list of tables [[debris]], got a table"),
    (
        [('"400 um"]', '"400 um"]\nperiodic = "yes"')],
        "22:1: domain.periodic: expected true or false, got 'yes'",
    ),
    ([("{x = {velocity", "{x = 1, y = {velocity")], "28:11: plates.upper.motion.x: expected a table, got 1"),
    (
        [('["0 m/s2", "0 m/s2", "-9.81 m/s2"]', '"9.81 m/s2"')],
        "35:1: effects.gravity: expected a list of 3 values, got '9.81 m/s2'",
    ),
    # choices
    (
        [('"irregular"', '"irregulr"')],
        "13:1: debris[0].kind: 'irregulr' is not one of 'irregular', 'spheres'",
    ),
    (
        [('"lognormal"', '"weibull"')],
        "16:9: debris[0].size.distribution: 'weibull' is not one of 'constant', 'lognormal', 'normal', 'uniform'",
    ),
    (
        [('"load_per_particle"', '"foo"')],
        "26:1: plates.upper.support: 'foo' is not one of 'rigid', 'load_per_particle'",
    ),
    # known to the file format, but not yet
    ([('"irregular"', '"spots"')], f"13:1: debris[0].kind: kind = 'spots' {LATER} 'irregular', 'spheres'"),
    ([('"layer"', '"dense"')], f"19:1: debris[0].placement: placement = 'dense' {LATER} 'layer'"),
    (
        [('"load_per_particle"', '"foundation"')],
        f"26:1: plates.upper.support: support = 'foundation' {LATER} 'rigid', 'load_per_particle'",
    ),
    (
        [('load = "0.1 mN"', 'closing = "1 um/s"')],
        f"27:1: plates.upper.closing: closing = '1 um/s' {LATER} load, pressure, gap",
    ),
    (
        [('{velocity = "1 m/s"}', '{ramp = "1 m/s2"}')],
        f"28:16: plates.upper.motion.x.ramp: ramp = '1 m/s2' {LATER} velocity",
    ),
    (
        [('integrator = "auto"', 'integrator = "implicit"')],
        f"37:1: solver.integrator: integrator = 'implicit' {LATER} 'auto', 'explicit'",
    ),
    ([('"refuse"', '"relax"')], f"40:1: solver.initial_overlap: initial_overlap = 'relax' {LATER} 'refuse'"),
    # keys that exclude each other
    (
        [('load = "0.1 mN"', 'load = "0.1 mN"\ngap = "5 um"')],
        "28:1: plates.upper.gap: give only one of load, pressure, gap: load is given too",
    ),
    (
        [('load = "0.1 mN"', 'gap = "5 um"')],
        "27:1: plates.upper.gap: support = 'load_per_particle' takes a load, not a gap",
    ),
    (
        [('distance = "20 um"', 'distance = "20 um"\nduration = "1 s"')],
        "40:1: solver.duration: give only one of distance, duration: distance is given too",
    ),
    (
        [('[plates.lower]\nmaterial = "steel"\n', "")],
        "22:1: plates.upper: an upper plate needs a lower one: add [plates.lower]",
    ),
    # between tables
    (
        [('between = ["steel", "steel"]', 'between = ["steel", "stel"]')],
        "8:21: pairs[0].between[1]: unknown material 'stel', did you mean 'steel'?",
    ),
    (
        [('[plates.lower]\nmaterial = "steel"', '[plates.lower]\nmaterial = "brass"')],
        "23:1: plates.lower.material: unknown material 'brass', known: steel",
    ),
    ([(PAIR, PAIR + PAIR)], "12:1: pairs[1].between: 'steel' and 'steel' are given by pairs[0] already"),
    (
        [(PAIR, "")],
        "1:1: pairs: no pair for 'steel' and 'steel', which can meet (debris[0] and plates.lower): "
        'add a [[pairs]] table with between = ["steel", "steel"]',
    ),
    (
        [('"0.5 um"', '"1 ns"'), ('"1 m/s"', '"0 m/s"')],
        "39:1: solver.distance: a distance needs an upper plate that moves: "
        "add plates.upper.motion, or give duration instead",
    ),
    (
        [('distance = "20 um"', 'duration = "1 us"'), ('"1 m/s"', '"0 m/s"')],
        "42:1: output.every: a length of sliding needs an upper plate that moves: "
        "add plates.upper.motion, or give a time",
    ),
    # not TOML
    (
        [('"20 um"\ninit', '"20 um" x\ninit')],
        "39:20: not valid TOML: Expected newline or end of document after a statement",
    ),
    ([("seed = 1", "seed = 1\nseed = 2")], "16:9: not valid TOML: Cannot overwrite a value"),
    ([('"0.5 um"\n', "[1,")], "42:12: not valid TOML: Unclosed array"),
]


@pytest.mark.parametrize(("changes", "told"), ONE_FAULT, ids=[told.split(": ")[1] for _, told in ONE_FAULT])
def test_one_fault_is_told_once_and_in_its_place(changes, told):
    assert faults_of(changed(*changes)) == [told]


def test_all_faults_are_told_at_once_in_the_order_of_the_file():
    text = changed(
        ("youngs_modulus", "young_modulus"),
        ("count = 2000", "count = 0"),
        ('median = "10 um"', 'median = "10 MPa"'),
        ('gravity = ["0 m/s2", "0', 'gravity = [0, "0'),
        (PAIR, ""),
    )
    assert [fault.split(": ")[1] for fault in faults_of(text)] == [
        "pairs",
        "materials.steel.young_modulus",
        "debris[0].count",
        "debris[0].size.median",
        "effects.gravity[0]",
    ]


@pytest.mark.parametrize("text", ["debris = []", ""])
def test_no_debris_at_all(text):
    start, end = GOOD.index("[[debris]]"), GOOD.index("[domain]")
    found = faults_of(text + "\n" + GOOD[:start] + GOOD[end:])
    assert [fault.partition(": ")[2] for fault in found] == [
        "debris: at least one [[debris]] table is needed"
    ]


def test_an_empty_file_names_all_that_is_missing():
    keys = {fault.split(": ")[1] for fault in faults_of("")}
    assert keys == {"scene", "materials", "debris", "domain", "solver", "output"}


BALLS = '[[debris]]\nkind = "spheres"\nmaterial = "steel"\n{}\n[domain]'


def balls(lines: str) -> str:
    """The good scene with a population of spheres in place of the irregular one."""
    start, end = GOOD.index("[[debris]]"), GOOD.index("[domain]")
    return GOOD[:start] + BALLS.format(lines) + GOOD[end + len("[domain]") :]


def test_spheres_at_positions():
    scene = Scene.parse(
        balls(
            'radius = "5 um"\npositions = [["0 m", "0 m", "5 um"], ["20 um", "0 m", "5 um"]]\norientation = [2, 0, 0, 0]'
        )
    )
    (debris,) = scene.debris
    assert isinstance(debris, Spheres)
    assert (debris.count, debris.placement, debris.orientation) == (2, None, (1.0, 0.0, 0.0, 0.0))
    assert debris.positions == ((0.0, 0.0, 5e-6), (20e-6, 0.0, 5e-6))


def test_spheres_of_one_shape_in_a_layer():
    (debris,) = Scene.parse(
        balls('shape = [{radius = "5 um"}, {center = ["4 um", "0 m", "0 m"], radius = "3 um"}]\ncount = 7')
    ).debris
    assert isinstance(debris, Spheres)
    assert (debris.count, debris.placement) == (7, "layer")
    assert debris.shape is not None
    assert [ball.center[0] for ball in debris.shape] == [0.0, 4e-6]


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ("count = 1", "11:1: debris[0]: give one of radius, shape"),
        ('radius = "1 um"', "11:1: debris[0].count: required key is missing: give count, or positions"),
        ('radius = "-1 um"\ncount = 1', "14:1: debris[0].radius: '-1 um' must be greater than 0"),
        ("shape = []\ncount = 1", "14:1: debris[0].shape: the list is empty"),
        (
            'shape = [{radius = "1 um"},\n  {center = ["0 m", "x", "0 m"], radius = "1 um"}]\ncount = 1',
            "15:21: debris[0].shape[1].center[1]: cannot read 'x' as a length: write for example \"10 um\"",
        ),
        (
            'radius = "1 um"\ncount = 3\npositions = [["0 m", "0 m", "0 m"]]',
            "15:1: debris[0].count: 3 is not the number of positions, 1",
        ),
        (
            'radius = "1 um"\nplacement = "layer"\npositions = [["0 m", "0 m", "0 m"]]',
            "15:1: debris[0].placement: give only one of placement, positions",
        ),
        (
            'radius = "1 um"\npositions = [["0 m", "0 m", "0 m"]]\norientation = [0, 0, 0, 0]',
            "16:1: debris[0].orientation: a quaternion (w, x, y, z) of length zero is no orientation",
        ),
        (
            'radius = "1 um"\ncount = 1\norientation = [1, 0, 0, 0]',
            "16:1: debris[0].orientation: needs positions: a layer chooses the pose of each body",
        ),
    ],
)
def test_faults_of_spheres(lines, told):
    assert faults_of(balls(lines)) == [told]


BRASS = '[materials.brass]\nshear_modulus = "40 GPa"\npoisson_ratio = 0.3\ndensity = "8400 kg/m3"\n'


def missing_pairs(debris: str, contact: str = "auto") -> set[str]:
    """Who lacks a pair, for brass debris between steel plates of which only the steel pair is given."""
    start, end = GOOD.index("[[debris]]"), GOOD.index("[domain]")
    text = (
        GOOD[:start]
        + BRASS
        + debris
        + GOOD[end:].replace('debris_contact = "auto"', f'debris_contact = "{contact}"')
    )
    return {fault.split("(")[1].split(")")[0] for fault in faults_of(text)}


def ball(material: str, count: int) -> str:
    return f'[[debris]]\nkind = "spheres"\nmaterial = "{material}"\nradius = "1 um"\ncount = {count}\n'


def test_pairs_are_needed_only_where_materials_can_meet():
    plate = "debris[0] and plates.lower"
    assert missing_pairs(ball("brass", 5)) == {plate, "the bodies of debris[0]"}
    assert missing_pairs(ball("brass", 5), "none") == {plate}
    assert missing_pairs(ball("brass", 1)) == {plate}  # one body meets no other
    # the brass-steel pair of the plate also serves the two populations
    assert missing_pairs(ball("brass", 1) + ball("steel", 1)) == {plate}
    assert missing_pairs(ball("brass", 1) + ball("brass", 1)) == {plate, "debris[0] and debris[1]"}


def test_positions_inside_every_form_of_toml():
    text = """\
# [comment]
top = 'lit # no comment'
"quoted key" = 1
a . b = {k1 = [1, {k2 = "}", k3 = 2}], "k\\u00344" = 3} # {k9 = 1}
multi = [
  "x]", # ]
  [ 'y', "z\\"" ],
]
long = \"\"\"
fake = 1
"" \\\"\"\" \"\"\"\"
raw = '''
[fake]
'''''
[t.u]
v = 1979-05-27 07:32:00
[[arr]]
w = 1
[arr.sub]
q = 1
[[arr]]
w = 2
[[arr.deep]]
e = +1.5e3
"""
    tomllib.loads(text)  # or the test itself is wrong
    at = locate(text)
    assert at[("top",)] == (2, 1)
    assert at[("quoted key",)] == (3, 1)
    assert at[("a", "b")] == (4, 1)
    assert at[("a", "b", "k1")] == (4, 10)
    assert at[("a", "b", "k1", 1)] == (4, 19)
    assert at[("a", "b", "k1", 1, "k2")] == (4, 20)
    assert at[("a", "b", "k1", 1, "k3")] == (4, 30)
    assert at[("a", "b", "k4")] == (4, 40)
    assert at[("multi", 0)] == (6, 3)
    assert at[("multi", 1, 1)] == (7, 10)
    assert at[("t", "u", "v")] == (16, 1)
    assert at[("arr", 0, "sub", "q")] == (20, 1)
    assert at[("arr", 1)] == (21, 1)
    assert at[("arr", 1, "w")] == (22, 1)
    assert at[("arr", 1, "deep", 0, "e")] == (24, 1)
    assert not any("fake" in place or "k9" in place for place in at)
    assert locate(text.replace("\n", "\r\n")) == at


def test_files_that_cannot_be_read(tmp_path, monkeypatch):
    def told(path):
        with pytest.raises(InputError) as caught:
            Scene.load(path)
        (fault,) = caught.value.faults
        return str(fault).removeprefix(str(path))

    assert told(tmp_path / "none.toml") == ": no such file"
    assert told(tmp_path) == ": is a folder, expected a scene file"
    latin = tmp_path / "latin.toml"
    latin.write_bytes("scene = 1\ntitle = 'r\N{LATIN SMALL LETTER O WITH DIAERESIS}'\n".encode("latin-1"))
    assert told(latin) == ":2:11: is not UTF-8 text: save it as UTF-8"

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", refuse)
    assert told(latin) == ": cannot be read: Permission denied"


def test_load_and_save(tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())  # as some editors write
    scene = Scene.load(path)
    scene.save(tmp_path / "b.toml")
    assert Scene.load(tmp_path / "b.toml") == scene == Scene.parse(GOOD)
    with pytest.raises(OutputError, match="cannot be written"):
        scene.save(tmp_path / "nowhere" / "c.toml")


def test_option_values_that_toml_cannot_hold():
    scene = Scene.parse(GOOD)
    odd = scene.model_copy(update={"contact": Contact(springs=object)})
    with pytest.raises(InputError, match="contact.springs: .* cannot be written to a scene file"):
        odd.to_toml()


# Python

STEEL = Material(youngs_modulus=210e9, poisson_ratio=0.3, density=7850)


def test_a_scene_built_in_python_is_the_one_of_the_file():
    scene = Scene(
        title="what it shows",
        materials={"steel": STEEL},
        pairs=[Pair(between=("steel", "steel"), friction=0.3, restitution=0.6)],
        debris=[
            Irregular(
                material="steel",
                count=2000,
                size={"distribution": "lognormal", "median": 1e-5, "sigma": 0.2, "min": "5 um", "max": 20e-6},
                spheres=(4, 8),
                aspect=np.array([1.0, 0.8, 0.6]),
            )
        ],
        domain=Domain(size=("600 um", 400e-6)),
        plates=Plates(
            lower=LowerPlate(material="steel"),
            upper={
                "material": "steel",
                "support": "load_per_particle",
                "load": 1e-4,
                "motion": {"x": {"velocity": 1}},
            },
        ),
        contact=Contact(level="mdr", springs=32),
        effects=Effects(gravity=(0, 0, -9.81)),
        solver=Solver(distance=20e-6),
        output=Output(every=0.5e-6, every_kind="distance"),
    )
    assert scene == Scene.parse(GOOD)


def test_faults_in_python_are_input_errors_with_all_faults():
    with pytest.raises(InputError) as caught:
        UpperPlate(material="steel", load="1 mN", gap=-1.0, colour="red")
    told = [str(fault) for fault in caught.value.faults]
    assert told == [
        "colour: unknown key, known: damping, gap, load, mass, material, motion, pressure, support",
        "gap: give only one of load, pressure, gap: load is given too",
    ]
    with pytest.raises(InputError, match="every: no unit: .* or give every_kind"):
        Output(every=1e-6)
    with pytest.raises(InputError, match="every: '1 s' is not a distance"):
        Output(every="1 s", every_kind="distance")
    with pytest.raises(InputError, match=r"materials\.a\.density: -1 must be greater than 0"):
        Scene.parse(GOOD).model_copy() and Scene(materials={"a": {"density": -1}})


# --set


def test_settings_replace_values_and_their_alternatives():
    scene = Scene.parse(GOOD, "x.toml").with_settings(
        {
            "solver.duration": "1 us",
            "debris.0.count": "20",
            "debris[0].size": "12 um",
            "plates.upper.support": "rigid",
            "plates.upper.gap": "3 um",
            "domain.size.1": "1 mm",
            "contact.springs": "64",
        }
    )
    assert (scene.solver.duration, scene.solver.distance) == (1e-6, None)
    assert scene.debris[0].count == 20
    assert isinstance(scene.debris[0], Irregular) and scene.debris[0].size == Constant(value=12e-6)
    assert scene.plates.upper is not None
    assert (scene.plates.upper.gap, scene.plates.upper.load) == (3e-6, None)
    assert scene.domain.size == (600e-6, 1e-3)
    assert scene.contact.options == {"springs": 64}
    assert str(scene.fault(("contact", "springs"), "too many")) == "--set: contact.springs: too many"
    assert str(scene.fault(("contact", "law"), "odd")) == "x.toml:30:1: contact.law: odd"


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"solvr.distance": "1 um"}, ["solvr: unknown key, did you mean 'solver'?"]),
        ({"solver.distnce": "1 um"}, ["solver.distnce: unknown key, did you mean 'distance'?"]),
        ({"solver.distance": "1 MPa"}, ["solver.distance: '1 MPa' is a pressure, expected a length"]),
        ({"solver.distance": "1"}, ['solver.distance: no unit: write "1 um" or another unit of length']),
        ({"debris.0.count": "0"}, ["debris[0].count: 0 must be at least 1"]),
        ({"debris.3.count": "2"}, ["debris.3.count: debris has no entry '3': its entries are 0 to 0"]),
        ({"title.x": "2"}, ["title.x: title = 'what it shows' is not a table"]),
        (
            {"solver.distance": "1 um", "solver.duration": "1 s"},
            ["solver.duration: give only one of distance, duration: distance is given too"],
        ),
        ({"": "1"}, ["expected a path such as solver.distance"]),
    ],
)
def test_faults_of_settings(given, told):
    with pytest.raises(InputError) as caught:
        Scene.parse(GOOD).with_settings(given)
    assert [str(fault) for fault in caught.value.faults] == ["--set: " + text for text in told]


# save and load, for many scenes

finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=0, exclude_min=True, allow_infinity=False)
fraction = st.floats(min_value=0, max_value=1, exclude_min=True)
name = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
three = st.tuples(finite, finite, finite)
toml_value = st.recursive(
    st.booleans() | st.integers() | finite | name,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(name, inner, max_size=3),
    max_leaves=6,
)
free_key = name.filter(
    lambda key: key not in {"law", "level", "debris_contact", "gravity", "options", "named"}
)
sizes = st.one_of(
    st.builds(Constant, value=positive),
    st.builds(Lognormal, median=positive, sigma=positive),
    st.builds(Lognormal, median=positive, sigma=positive, min=st.just(1e-9), max=st.floats(1e-8, 1)),
)
irregular = st.builds(
    lambda low, more, **rest: Irregular(spheres=(low, low + more), **rest),
    low=st.integers(1, 32), more=st.integers(0, 32), material=st.just("m"), count=st.integers(1),
    seed=st.integers(0), size=sizes, aspect=st.tuples(fraction, fraction, fraction), velocity=three,
    angular_velocity=three,
)  # fmt: skip
spheres = st.builds(
    Spheres, material=st.just("m"), radius=positive, positions=st.lists(three, min_size=1, max_size=3),
    orientation=st.none() | st.tuples(finite, finite, finite, finite).filter(lambda q: any(q)), velocity=three,
)  # fmt: skip
uppers = st.builds(
    lambda support, key, value, **rest: UpperPlate(
        material="m", **{"support": support, ("load" if support != "rigid" else key): value}, **rest
    ),
    support=st.sampled_from(["rigid", "load_per_particle"]), key=st.sampled_from(["load", "pressure", "gap"]),
    value=positive, motion=st.builds(lambda v: {"y": {"velocity": v}}, finite.filter(bool)),
    mass=st.none() | positive,
)  # fmt: skip
scenes = st.builds(
    lambda key, title, debris, upper, young, contact, effects, every: Scene(
        title=title,
        materials={"m": Material(**{key: young}, poisson_ratio=0.5, density=1.0), title: STEEL},
        pairs=[{"between": ["m", "m"], "friction": 0, "restitution": 1}],
        debris=debris,
        domain={"size": [young, 1.0], "periodic": False},
        plates={"lower": {"material": "m"}, "upper": upper},
        contact=Contact(options=contact),
        effects=Effects(named=effects),
        solver={"distance": young, "settle": 0},
        output={"every": every, "every_kind": "distance"},
    ),
    key=st.sampled_from(["youngs_modulus", "shear_modulus"]), title=name.filter(lambda text: text != "m"),
    debris=st.lists(irregular | spheres, min_size=1, max_size=3), upper=uppers, young=positive,
    contact=st.dictionaries(free_key, toml_value, max_size=3),
    effects=st.dictionaries(free_key, toml_value, max_size=2), every=positive,
)  # fmt: skip


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(scenes)
def test_saving_loses_nothing(scene):
    text = scene.to_toml()
    again = Scene.parse(text)
    assert again == scene
    assert again.to_toml() == text
    # every key that tomllib sees is located, so that any fault has its place
    assert places_of(tomllib.loads(text)) <= set(locate(text))


def places_of(node, place=()):
    """Every place in the document."""
    inner = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    found = {place} if place else set()
    for key, value in inner:
        found |= places_of(value, (*place, key))
    return found


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_any_damaged_scene_is_read_or_told_as_input_error(data):
    document = tomllib.loads(GOOD)
    place = data.draw(st.sampled_from(sorted(places_of(document), key=str)))
    node = document
    for key in place[:-1]:
        node = node[key]
    node[place[-1]] = data.draw(toml_value | st.just(math.nan))
    path = ".".join(map(str, place))
    try:
        Scene.parse(GOOD).with_settings({path: node[place[-1]]})
    except InputError as error:
        assert error.faults and all(fault.message for fault in error.faults)


def test_the_model_starts_without_the_slow_libraries():
    code = (
        "import json, sys, thirdbody.scene.model; print(json.dumps([m for m in sys.modules if '.' not in m]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    slow = {"numba", "h5py", "vtk", "vtkmodules", "pyvista", "pint", "matplotlib", "scipy", "pandas"}
    assert not slow & set(json.loads(done.stdout))
